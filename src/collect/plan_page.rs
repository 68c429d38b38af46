//! What a dry run shows: where the carriages would go, how fast, and every run of the plan.
//!
//! Everything is text; only the binary writes files. `plan.json` is the plan itself and can be
//! given back.

use super::{CheckedPlan, CheckedRun, MotionExtremes, PlanError};
use crate::{
    gantry::{Pattern, Rectangle, Reference, Robot},
    recording::Split,
    report::{Axis, Curve, LinePlot, Page, Scale, Stroke, Table, line_plot, path_plot},
};
use std::fmt::Write as _;

const INK: [u8; 3] = [29, 39, 51];
const GREY: [u8; 3] = [160, 168, 178];
const BLUE: [u8; 3] = [31, 105, 180];
const ORANGE: [u8; 3] = [208, 112, 24];
/// Of the paths, one for each pattern in the order of [`Pattern::ALL`].
const COLOURS: [[u8; 3]; 10] = [
    BLUE,
    ORANGE,
    [52, 140, 86],
    [190, 60, 60],
    [126, 84, 170],
    [120, 184, 210],
    [214, 160, 40],
    [200, 90, 150],
    [90, 110, 60],
    [110, 80, 60],
];

/// Points of a path closer than this (m) are drawn as one.
const DRAWN_STEP: f64 = 0.002;
/// The board stands upright.
const PATHS: (u32, u32) = (640, 800);
const WIDE: (u32, u32) = (980, 260);

/// The files of a dry run.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanPage {
    /// `index.html`.
    pub index_html: String,
    /// `plan.csv`, one row for each run.
    pub plan_csv: String,
    /// `plan.json`, which [`Plan::from_json`](super::Plan::from_json) reads.
    pub plan_json: String,
}

/// Shows what was checked for `robot`.
///
/// # Errors
/// When the plan cannot be written as JSON.
pub fn plan_page(checked: &CheckedPlan, robot: &Robot) -> Result<PlanPage, PlanError> {
    let mut page = Page::new(&format!("Plan: {}", checked.plan().name));
    page.lead(&lead(checked));
    page.paragraph(&safety_summary(checked, robot));
    paths(&mut page, checked, robot);
    speeds(&mut page, checked);
    patterns(&mut page, checked);
    runs(&mut page, checked);
    let (plan_csv, plan_json) = (csv(checked), checked.plan().to_json()?);
    Ok(PlanPage { index_html: page.finish(), plan_csv, plan_json })
}

/// Names of the patterns of the plan, in the order of [`Pattern::ALL`], with their colours.
fn kinds(checked: &CheckedPlan) -> Vec<(&'static str, [u8; 3])> {
    let all = Pattern::ALL.into_iter().zip(COLOURS);
    all.map(|(pattern, colour)| (pattern.name(), colour))
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
        "{} runs ({judging} held out) for {}, {} samples at {} Hz: {:.1} min of runs, {:.1} min with \
         the moves between them. Nothing has moved.",
        plan.runs.len(),
        players(checked),
        plan.samples(),
        plan.rate_hz,
        plan.samples() as f64 / plan.rate_hz / 60.0,
        checked.duration_s() / 60.0,
    )
}

fn safety_summary(checked: &CheckedPlan, robot: &Robot) -> String {
    let (limits, extremes) = (&robot.limits, checked.extremes());
    let [x, y] = extremes.max_axis_speed_m_per_s;
    format!(
        "Every sample was checked. Largest speed {:.3} m/s (x {x:.3}, y {y:.3}; limits {} in all, \
         {} along an axis); largest acceleration {:.1} m/s^2 along an axis (limit {}); fastest \
         motor {:.1} turns/s. Nearest to the workspace's edge, stopping distance included: {:.1} mm \
         (at least {:.1} mm are kept). The workspace is the field less {:.1} mm.",
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

fn outline(rectangle: &Rectangle, colour: [u8; 3], stroke: Stroke) -> Curve {
    let Rectangle { x_min_m, x_max_m, y_min_m, y_max_m } = *rectangle;
    let corners = [(x_min_m, y_min_m), (x_max_m, y_min_m), (x_max_m, y_max_m), (x_min_m, y_max_m)];
    Curve { colour, stroke, points: corners.into_iter().chain([corners[0]]).collect() }
}

fn path(reference: &Reference, colour: [u8; 3]) -> Curve {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for setpoint in reference.setpoints() {
        let [x, y] = setpoint.position;
        let far = |last: &(f64, f64)| DRAWN_STEP <= (x - last.0).hypot(y - last.1);
        if points.last().is_none_or(far) {
            points.push((x, y));
        }
    }
    Curve { colour, stroke: Stroke::Solid, points }
}

fn paths(page: &mut Page, checked: &CheckedPlan, robot: &Robot) {
    page.section("Where the carriages go");
    let kinds = kinds(checked);
    let mut legend = vec![("board", INK), ("field; dashed: workspace", GREY)];
    legend.extend(kinds.iter().copied());
    page.legend(&legend);
    // What fills the workspace is drawn first, so that the rest lies over it.
    let mut curves = Vec::new();
    for (name, colour) in kinds.iter().rev() {
        for run in of_kind(checked, name) {
            curves.extend(run.references().iter().map(|reference| path(reference, *colour)));
        }
    }
    let (x, y) = (robot.board.short_side_m / 2.0, robot.board.long_side_m / 2.0);
    let board = Rectangle { x_min_m: -x, x_max_m: x, y_min_m: -y, y_max_m: y };
    curves.push(outline(&board, INK, Stroke::Solid));
    for (player, workspace) in checked.players().iter().zip(checked.soft_limits()) {
        curves.push(outline(robot.workspace.of(*player), GREY, Stroke::Solid));
        curves.push(outline(workspace, GREY, Stroke::Dashed));
    }
    page.picture(&path_plot(&LinePlot {
        title: "Commanded paths of all runs, seen from above".to_owned(),
        x: "x, across (m)".to_owned(),
        y: Axis { label: "y, goal to goal (m)".to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves,
        size: PATHS,
    }));
}

fn speeds(page: &mut Page, checked: &CheckedPlan) {
    page.section("Velocity against time");
    let Some(player) = checked.players().first() else { return };
    page.paragraph(&format!("The fastest run of each pattern, {player} player."));
    page.legend(&[("x", BLUE), ("y", ORANGE)]);
    for (name, _) in kinds(checked) {
        let speed = |run: &CheckedRun| run.extremes().max_speed_m_per_s;
        let fastest = of_kind(checked, name).max_by(|a, b| speed(a).total_cmp(&speed(b)));
        let Some(run) = fastest else { continue };
        let Some(reference) = run.references().first() else { continue };
        let curve = |axis: usize, colour| {
            let timed = reference.setpoints().iter().enumerate();
            let points = timed.map(|(k, s)| (k as f64 * reference.dt(), s.velocity[axis]));
            Curve { colour, stroke: Stroke::Solid, points: points.collect() }
        };
        let planned = run.planned();
        page.picture(&line_plot(&LinePlot {
            title: format!("Run {}, {}", planned.number, planned.pattern),
            x: "time in the run (s)".to_owned(),
            y: Axis { label: "velocity (m/s)".to_owned(), scale: Scale::Linear },
            bands: Vec::new(),
            curves: vec![curve(0, BLUE), curve(1, ORANGE)],
            size: WIDE,
        }));
    }
}

fn patterns(page: &mut Page, checked: &CheckedPlan) {
    page.section("What each pattern is for");
    for (name, _) in kinds(checked) {
        let of_split = |split| of_kind(checked, name).filter(move |r| r.planned().split == split);
        if let Some(run) = of_kind(checked, name).next() {
            page.paragraph(&format!(
                "{name} ({} to fit, {} held out): {}",
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
        "Speeds, acceleration and the distance to the workspace's edge (stopping distance included) \
         are the extremes over all players.",
    );
    // The other columns are in the CSV table; more would not fit a page.
    let shown = |name: &str| HEADS.iter().position(|head| *head == name);
    let columns = [
        ("run", "run"),
        ("pattern", "pattern"),
        ("split", "split"),
        ("duration_s", "duration (s)"),
        ("max_speed_m_per_s", "speed (m/s)"),
        ("max_acceleration_m_per_s2", "acceleration (m/s²)"),
        ("edge_distance_m", "to edge (m)"),
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
    page.table(&Table { head, rows: rows.collect() });
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
        // The paths and one picture for each pattern.
        assert_eq!(page.index_html.matches("<svg").count(), 11);
        assert_eq!(plan_page(&checked, &robot).unwrap(), page);
    }
}
