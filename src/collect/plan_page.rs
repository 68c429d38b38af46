//! Result of a dry run: commanded paths, velocities, and every run of the plan.
//!
//! Everything is text; only the binary writes files. `plan.json` is the plan itself; `collect` reads it.

use super::{CheckedPlan, CheckedRun, MotionExtremes, PlanError};
use crate::{
    gantry::{Pattern, Rectangle, Reference, Robot},
    recording::Split,
    report::{Axis, Badge, Chart, Colour, Page, Points, Series, Table, with_same_y},
};
use std::fmt::Write as _;

/// Smallest distance of two drawn points of a path (m).
const DRAWN_STEP: f64 = 0.002;

/// Files of a dry run.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanPage {
    /// `index.html`.
    pub index_html: String,
    /// `plan.csv`, one row for each run.
    pub plan_csv: String,
    /// `plan.json`, which [`Plan::from_json`](super::Plan::from_json) reads.
    pub plan_json: String,
}

/// Page of a plan that was checked for `robot`.
///
/// # Errors
/// When the plan cannot be written as JSON.
pub fn plan_page(checked: &CheckedPlan, robot: &Robot) -> Result<PlanPage, PlanError> {
    let mut page = Page::new(&format!("Plan: {}", checked.plan().name));
    page.badge("safety-checked, nothing has moved", Badge::Good);
    page.lead(&lead(checked));
    page.key_figures(&key_figures(checked, robot));
    page.paragraph(&safety_summary(checked, robot));
    paths(&mut page, checked, robot);
    speeds(&mut page, checked);
    patterns(&mut page, checked);
    runs(&mut page, checked);
    let (plan_csv, plan_json) = (csv(checked), checked.plan().to_json()?);
    Ok(PlanPage { index_html: page.finish(), plan_csv, plan_json })
}

/// Names of the patterns of the plan, in the order of [`Pattern::ALL`], with their colours.
fn kinds(checked: &CheckedPlan) -> Vec<(&'static str, Colour)> {
    let all = Pattern::ALL.into_iter().enumerate();
    all.map(|(index, pattern)| (pattern.name(), Colour::of_series(index)))
        .filter(|(name, _)| of_kind(checked, name).next().is_some())
        .collect()
}

fn of_kind<'a>(checked: &'a CheckedPlan, name: &str) -> impl Iterator<Item = &'a CheckedRun> {
    checked.runs().iter().filter(move |run| run.planned().pattern.name() == name)
}

fn players(checked: &CheckedPlan) -> String {
    let names: Vec<&str> = checked.players().iter().map(|player| player.name()).collect();
    match names.as_slice() {
        [one] => format!("the {one} player"),
        _ => "both players at once".to_owned(),
    }
}

fn lead(checked: &CheckedPlan) -> String {
    let plan = checked.plan();
    let judging = plan.runs.iter().filter(|run| run.split == Split::Validation).count();
    format!(
        "{} runs ({judging} held out for validation) for {}: {} samples at {} Hz.",
        plan.runs.len(),
        players(checked),
        plan.samples(),
        plan.rate_hz,
    )
}

fn key_figures(checked: &CheckedPlan, robot: &Robot) -> [(&'static str, String); 4] {
    let (plan, limits, extremes) = (checked.plan(), &robot.limits, checked.extremes());
    let minutes = plan.samples() as f64 / plan.rate_hz / 60.0;
    [
        ("recorded time", format!("{minutes:.1} min")),
        ("total time with moves between runs", format!("{:.1} min", checked.duration_s() / 60.0)),
        (
            "largest speed (limit)",
            format!("{:.2} m/s ({})", extremes.max_speed_m_per_s, limits.total_speed_m_per_s),
        ),
        (
            "smallest distance to the soft limits (required)",
            format!(
                "{:.1} mm ({:.1})",
                1e3 * extremes.edge_distance_m,
                1e3 * limits.tracking_margin_m
            ),
        ),
    ]
}

fn safety_summary(checked: &CheckedPlan, robot: &Robot) -> String {
    let (limits, extremes) = (&robot.limits, checked.extremes());
    let [x, y] = extremes.max_axis_speed_m_per_s;
    format!(
        "All samples passed the safety check. Largest speed {:.3} m/s (x {x:.3}, y {y:.3}; limits: total {}, per \
         axis {}). Largest acceleration {:.1} m/s² along an axis (limit {}). Fastest motor {:.1} turns/s. \
         Smallest distance to the soft limits {:.1} mm with the stopping distance included (required: {:.1} mm). \
         The soft limits are the workspace minus {:.1} mm on each side.",
        extremes.max_speed_m_per_s,
        limits.total_speed_m_per_s,
        limits.speed_m_per_s,
        extremes.max_acceleration_m_per_s2,
        limits.slew_m_per_s2,
        extremes.max_motor_turns_per_s,
        1e3 * extremes.edge_distance_m,
        1e3 * limits.tracking_margin_m,
        1e3 * robot.clearance_m,
    )
}

fn outline(rectangle: &Rectangle) -> Points {
    let Rectangle { x_min_m, x_max_m, y_min_m, y_max_m } = *rectangle;
    let corners = [(x_min_m, y_min_m), (x_max_m, y_min_m), (x_max_m, y_max_m), (x_min_m, y_max_m)];
    corners.into_iter().chain([corners[0]]).collect()
}

fn path(reference: &Reference) -> Points {
    let mut points: Points = Vec::new();
    for setpoint in reference.setpoints() {
        let [x, y] = setpoint.position;
        let far = |last: &(f64, f64)| DRAWN_STEP <= (x - last.0).hypot(y - last.1);
        if points.last().is_none_or(far) {
            points.push((x, y));
        }
    }
    points
}

fn paths(page: &mut Page, checked: &CheckedPlan, robot: &Robot) {
    page.section("Commanded paths");
    // Patterns that fill the workspace are drawn first, so that the others lie over them.
    let paths = kinds(checked).into_iter().rev().map(|(name, colour)| {
        let runs = of_kind(checked, name).flat_map(CheckedRun::references);
        Series::lines(name, colour, runs.map(path).collect()).with_width(1.2)
    });
    let (x, y) = (robot.board.short_side_m / 2.0, robot.board.long_side_m / 2.0);
    let board = Rectangle { x_min_m: -x, x_max_m: x, y_min_m: -y, y_max_m: y };
    let workspaces = checked.players().iter().map(|player| {
        let edge = outline(robot.workspace.of(*player));
        Series::line(&format!("workspace, {player} player"), Colour::Grey, edge).quiet()
    });
    let limits = checked.players().iter().zip(checked.soft_limits()).map(|(player, limits)| {
        let name = format!("soft limits, {player} player");
        Series::dashed(&name, Colour::Grey, outline(limits)).quiet()
    });
    page.chart(
        &Chart::of_plane(
            "Commanded paths of all runs, seen from above",
            Axis::new("x, across the board", "m"),
            Axis::new("y, goal to goal", "m"),
        )
        .with_equal_axes()
        .with_height(640)
        .with(Series::line("board", Colour::Ink, outline(&board)).quiet())
        .with_all(paths)
        .with_all(workspaces)
        .with_all(limits),
    );
}

fn speeds(page: &mut Page, checked: &CheckedPlan) {
    page.section("Commanded velocities");
    let Some(player) = checked.players().first() else { return };
    page.paragraph(&format!("Fastest run of each pattern, {player} player."));
    let chart = |run: &CheckedRun| {
        let reference = run.references().first()?;
        let curve = |axis: usize| {
            let timed = reference.setpoints().iter().enumerate();
            timed.map(|(k, s)| (k as f64 * reference.dt(), s.velocity[axis])).collect()
        };
        let planned = run.planned();
        let chart = Chart::of_lines(
            &format!("{}, run {}", planned.pattern.name(), planned.number),
            Axis::new("time in the run", "s"),
            Axis::new("velocity", "m/s"),
        );
        let chart = chart.with(Series::line("x", Colour::Blue, curve(0)));
        Some(chart.with(Series::line("y", Colour::Orange, curve(1))).with_height(240))
    };
    let speed = |run: &CheckedRun| run.extremes().max_speed_m_per_s;
    let kinds = kinds(checked);
    let fastest = kinds.iter().filter_map(|(name, _)| {
        of_kind(checked, name).max_by(|a, b| speed(a).total_cmp(&speed(b)))
    });
    page.charts(&with_same_y(fastest.filter_map(chart).collect()));
}

fn patterns(page: &mut Page, checked: &CheckedPlan) {
    page.section("Purpose of each pattern");
    for (name, _) in kinds(checked) {
        let of_split = |split| of_kind(checked, name).filter(move |r| r.planned().split == split);
        if let Some(run) = of_kind(checked, name).next() {
            page.paragraph(&format!(
                "{name} ({} for training, {} held out): {}",
                of_split(Split::Train).count(),
                of_split(Split::Validation).count(),
                run.planned().pattern.purpose()
            ));
        }
    }
}

const HEADS: [&str; 11] = [
    "run",
    "pattern",
    "split",
    "samples",
    "duration_s",
    "max_speed_m_per_s",
    "max_speed_x_m_per_s",
    "max_speed_y_m_per_s",
    "max_acceleration_m_per_s2",
    "edge_distance_m",
    "max_motor_turns_per_s",
];

/// One run under [`HEADS`], without its pattern's parameters.
fn cells(checked: &CheckedPlan, run: &CheckedRun) -> Vec<String> {
    let planned = run.planned();
    let MotionExtremes {
        max_speed_m_per_s,
        max_axis_speed_m_per_s: [x, y],
        max_acceleration_m_per_s2,
        edge_distance_m,
        max_motor_turns_per_s,
    } = *run.extremes();
    let duration = planned.samples as f64 / checked.plan().rate_hz;
    vec![
        planned.number.to_string(),
        planned.pattern.name().to_owned(),
        planned.split.to_string(),
        planned.samples.to_string(),
        format!("{duration:.2}"),
        format!("{max_speed_m_per_s:.4}"),
        format!("{x:.4}"),
        format!("{y:.4}"),
        format!("{max_acceleration_m_per_s2:.3}"),
        format!("{edge_distance_m:.4}"),
        format!("{max_motor_turns_per_s:.2}"),
    ]
}

fn runs(page: &mut Page, checked: &CheckedPlan) {
    page.section("Runs");
    page.paragraph(
        "Speeds, acceleration and distance to the soft limits (stopping distance included) are the extremes over all \
         players.",
    );
    // The CSV table has the other columns too.
    let shown = |name: &str| HEADS.iter().position(|head| *head == name);
    let columns = [
        ("run", "run"),
        ("pattern", "pattern"),
        ("split", "split"),
        ("duration_s", "duration (s)"),
        ("max_speed_m_per_s", "speed (m/s)"),
        ("max_acceleration_m_per_s2", "acceleration (m/s²)"),
        ("edge_distance_m", "distance to limit (m)"),
    ];
    let mut head: Vec<String> = columns.iter().map(|(_, title)| (*title).to_owned()).collect();
    head.push("parameters".to_owned());
    let rows = checked.runs().iter().map(|run| {
        let all = cells(checked, run);
        let chosen = columns.iter().filter_map(|(name, _)| all.get(shown(name)?));
        let text = run.planned().pattern.to_string();
        let parameters = text.split_once(':').map_or("", |(_, rest)| rest).replace(',', ", ");
        chosen.cloned().chain([parameters]).collect()
    });
    page.table_of_words(&Table { head, rows: rows.collect() });
}

fn csv(checked: &CheckedPlan) -> String {
    let mut text = format!("{},parameters\n", HEADS.join(","));
    for run in checked.runs() {
        let written =
            writeln!(text, "{},\"{}\"", cells(checked, run).join(","), run.planned().pattern);
        written.unwrap_or_else(|_grows| unreachable!("a String grows"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        collect::{Plan, Schedule, check_plan},
        recording::topic::Player,
    };

    #[test]
    fn a_dry_run_shows_every_run_and_gives_the_plan_back() {
        let schedule = Schedule { seconds: 4.0, repeat: 2, ..Schedule::default() };
        let plan = Plan::from_patterns(&Pattern::ALL, &schedule).unwrap();
        let robot = Robot::default();
        let checked = check_plan(&plan, &robot, &Player::BOTH).unwrap();
        let page = plan_page(&checked, &robot).unwrap();
        assert_eq!(Plan::from_json(&page.plan_json).unwrap(), plan);
        assert_eq!(page.plan_csv.lines().count(), 1 + plan.runs.len());
        let columns = |line: &str| line.split('"').next().unwrap().matches(',').count();
        assert!(page.plan_csv.lines().all(|line| columns(line) == 11), "{}", page.plan_csv);
        for pattern in Pattern::ALL {
            assert!(page.index_html.contains(&crate::report::escape(pattern.purpose())));
        }
        // The paths and one chart for each pattern.
        assert_eq!(page.index_html.matches("<figure class=\"chart\"").count(), 11);
        assert_eq!(plan_page(&checked, &robot).unwrap(), page);
    }
}
