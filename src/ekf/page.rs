//! `index.html` of `tune-ekf`: tuning, consistency and accuracy of the state estimate.

use super::{
    document::{Document, Tuned},
    evaluate::{Consistency, ConsistencyVerdict, EvaluatedRun, LONGEST_LAG, ObjectEvaluation},
    region::{Region, Regions, region_at},
    rise::{Hit, Response, responses},
    settings::{FilterSettings, Object},
};
use crate::{
    report::{Axis, Badge, Chart, Colour, Grid, Page, Points, Series, Table, with_same_y},
    stats::median,
};
use std::f64::consts::TAU;

/// Columns and rows of the map of regions.
const CELLS: [usize; 2] = [64, 84];
/// Positions of both strikers on the map (m): the home positions of the platform.
const HOME: [Option<[f64; 2]>; 2] = [Some([0.0, -0.1]), Some([0.0, 0.1])];
/// Frames on the map of ellipses.
const ELLIPSE_FRAMES: usize = 180;
/// Semi-axis of the 95 % ellipse of a normal distribution in the plane (standard deviations).
const ELLIPSE_SIGMAS: f64 = 2.447_746_83;
/// Magnification of the ellipses, which would otherwise be dots.
const ELLIPSE_SCALE: f64 = 10.0;
/// Length of the velocity traces (s).
const TRACE_SECONDS: f64 = 3.0;
/// Length of the step responses after an impact (s).
const RESPONSE_SECONDS: f64 = 0.25;

/// Page of a tuned filter.
#[must_use]
pub fn page(tuned: &Tuned) -> String {
    let document = &tuned.document;
    let mut page = Page::new("State estimate");
    badge(&mut page, document);
    page.lead(&lead(document));
    page.key_figures(&key_figures(document));
    for warning in &document.warnings {
        page.warning(warning);
    }
    regions(&mut page, document);
    ellipses(&mut page, tuned);
    consistency(&mut page, document);
    whiteness(&mut page, document);
    bounces(&mut page, tuned);
    trace(&mut page, tuned);
    settings(&mut page, document);
    provenance(&mut page, document);
    page.finish()
}

/// State how many regions have a consistent NIS.
fn badge(page: &mut Page, document: &Document) {
    let checks: Vec<bool> = document
        .evaluation
        .iter()
        .flat_map(|own| &own.regions)
        .filter_map(|region| region.nis?.verdict)
        .map(|verdict| verdict == ConsistencyVerdict::Consistent)
        .collect();
    let within = checks.iter().filter(|within| **within).count();
    let tone = if within == checks.len() { Badge::Good } else { Badge::Warn };
    match checks.len() {
        0 => page.badge("consistency not tested: too few detections", Badge::Warn),
        all => page.badge(&format!("NIS consistent in {within} of {all} regions"), tone),
    }
}

fn key_figures(document: &Document) -> Vec<(&'static str, String)> {
    let Some(own) = document.evaluation.first() else { return Vec::new() };
    let speed = |value| format!("{} mm/s", milli(value));
    vec![
        ("object", own.object.name().to_owned()),
        ("velocity RMSE, tuned filter", speed(own.velocity_rmse_m_per_s)),
        ("velocity RMSE, upstream settings", speed(own.upstream_velocity_rmse_m_per_s)),
        ("gated measurements", format!("{:.2} %", 100.0 * own.gated_fraction)),
    ]
}

/// Millimetres or mm/s with two digits behind the point.
fn milli(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{:.2}", 1e3 * value))
}

fn lead(document: &Document) -> String {
    format!(
        "Extended Kalman filter tuned on {} runs ({:.0} s) and evaluated on {} held-out runs ({:.0} s).",
        document.train.runs,
        document.train.duration_s,
        document.validation.runs,
        document.validation.duration_s
    )
}

/// Colours of the regions, in the order of [`Region::ALL`].
const REGION_COLOURS: [Colour; 5] =
    [Colour::Grey, Colour::Blue, Colour::Teal, Colour::Orange, Colour::Purple];

fn regions(page: &mut Page, document: &Document) {
    let filter = &document.filter;
    page.section("Process noise by region");
    let Some(ball) = &filter.ball.ball else { return };
    page.paragraph(
        "Process noise along the predicted path of the ball, with both strikers at home. Noise adds where regions \
         overlap; near a wall it acts across that wall only. The transition model covers the impact itself, \
         with its own noise.",
    );
    let regions = Regions::new(&filter.board, filter.ball.open_psd_m2_per_s3, ball);
    let density = |place: [f64; 2]| {
        let (_, [qx, qy]) = regions.along(place, place, &HOME);
        (qx + qy).log10()
    };
    let class = |place: [f64; 2]| region_at(filter, place, &HOME) as usize as f64;
    let names = Region::ALL.iter().map(|region| region.title().to_owned());
    let (x, y) = board_edges(filter);
    let noise = Grid::of_numbers(cells(filter, &density), x, y, "noise density (m²/s³)");
    let classes = names.zip(REGION_COLOURS).collect();
    page.charts(&[
        on_board("Process noise, x plus y", filter).with_grid(noise.of_logarithms()),
        on_board("Regions", filter).with_grid(Grid::of_classes(
            cells(filter, &class),
            x,
            y,
            classes,
        )),
    ]);
    page.table(&region_table(document));
}

/// Edges of the board along x and y (m).
fn board_edges(filter: &FilterSettings) -> ((f64, f64), (f64, f64)) {
    let half = [filter.board.short_side_m / 2.0, filter.board.long_side_m / 2.0];
    ((-half[0], half[0]), (-half[1], half[1]))
}

/// Empty chart of the board.
fn on_board(title: &str, filter: &FilterSettings) -> Chart {
    let (x, y) = board_edges(filter);
    Chart::of_plane(
        title,
        Axis::new("x", "m").within(x.0, x.1),
        Axis::new("y", "m").within(y.0, y.1),
    )
    .with_equal_axes()
    .with_height(520)
}

/// `value` at the centre of each cell of the board, `[row][column]`.
fn cells(filter: &FilterSettings, value: &dyn Fn([f64; 2]) -> f64) -> Vec<Vec<f64>> {
    let half = [filter.board.short_side_m / 2.0, filter.board.long_side_m / 2.0];
    let centre = |axis: usize, cell: usize| {
        half[axis] * (2.0 * (cell as f64 + 0.5) / CELLS[axis] as f64 - 1.0)
    };
    let row = |row: usize| {
        (0..CELLS[0]).map(|column| value([centre(0, column), centre(1, row)])).collect()
    };
    (0..CELLS[1]).map(row).collect()
}

fn region_table(document: &Document) -> Table {
    let head =
        ["object, region", "training detections", "visits", "process noise (m²/s³)", "tuned"];
    let mut rows = Vec::new();
    for tuning in &document.tuning {
        for region in &tuning.regions {
            let psd = noise(document.filter.object(tuning.object), region.region);
            rows.push(vec![
                format!("{}, {}", tuning.object.name(), region.region.title()),
                region.samples.to_string(),
                region.visits.to_string(),
                format!("{psd:.2e}"),
                if region.tuned { "yes".to_owned() } else { "no, default".to_owned() },
            ]);
        }
    }
    Table { head: head.map(str::to_owned).to_vec(), rows }
}

fn noise(own: &super::ObjectSettings, region: Region) -> f64 {
    let ball = own.ball.unwrap_or_default();
    match region {
        Region::Open => own.open_psd_m2_per_s3,
        Region::NearWallX => ball.near_wall_x_psd_m2_per_s3,
        Region::NearWallY => ball.near_wall_y_psd_m2_per_s3,
        Region::NearStriker => ball.near_striker_psd_m2_per_s3,
        Region::GoalRim => ball.goal_rim_psd_m2_per_s3,
    }
}

/// The run in which the ball (or, without one, any object) is seen longest.
fn longest(runs: &[EvaluatedRun], object: Object) -> Option<&EvaluatedRun> {
    let known = |run: &EvaluatedRun| {
        run.frames.iter().filter(|frame| frame.estimates[object.index()].is_some()).count()
    };
    runs.iter().max_by_key(|run| known(run)).filter(|run| 0 < known(run))
}

fn shown(document: &Document) -> Object {
    document.evaluation.first().map_or(Object::Ball, |own| own.object)
}

fn ellipses(page: &mut Page, tuned: &Tuned) {
    let object = shown(&tuned.document);
    let Some(run) = longest(&tuned.runs, object) else { return };
    page.section("Covariance");
    page.paragraph(&format!(
        "Position of the {} in the first 1.5 s of {}, with 95 % ellipses magnified {ELLIPSE_SCALE} times.",
        object.name(),
        run.name
    ));
    let frames = &run.frames[..run.frames.len().min(ELLIPSE_FRAMES)];
    let estimates: Vec<_> = frames.iter().filter_map(|f| f.estimates[object.index()]).collect();
    let seen = frames.iter().filter_map(|f| f.frame.seen.positions[object.index()]);
    let drawn = estimates.iter().skip(1).step_by(3).map(ellipse).collect();
    let track = estimates.iter().map(|own| (own.mean[0], own.mean[1])).collect();
    page.chart(
        &on_board("Detections and estimates", &tuned.document.filter)
            .with(Series::line("", Colour::Ink, outline(&tuned.document.filter)).quiet())
            .with(
                Series::lines("95 % ellipse, magnified", Colour::Orange, drawn)
                    .with_width(1.0)
                    .quiet(),
            )
            .with(Series::rings("detection", Colour::Grey, seen.map(|[x, y]| (x, y)).collect()))
            .with(Series::line("estimate", Colour::Blue, track))
            .with_height(640),
    );
}

fn outline(filter: &FilterSettings) -> Points {
    let (x, y) = (filter.board.short_side_m / 2.0, filter.board.long_side_m / 2.0);
    vec![(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
}

/// Points of the position ellipse: the Cholesky factor of the covariance times a circle.
fn ellipse(own: &super::Estimate) -> Points {
    let [xx, xy, yy] = [own.covariance[0][0], own.covariance[0][1], own.covariance[1][1]];
    let a = xx.sqrt();
    let b = xy / a;
    let c = (yy - b * b).max(0.0).sqrt();
    let size = ELLIPSE_SCALE * ELLIPSE_SIGMAS;
    (0..=24)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 24.0).sin_cos();
            (own.mean[0] + size * a * cos, own.mean[1] + size * (b * cos + c * sin))
        })
        .collect()
}

fn consistency(page: &mut Page, document: &Document) {
    page.section("Consistency and accuracy on held-out runs");
    page.paragraph(
        "NIS is the normalized innovation squared, with the expected value 2. NEES is the normalized estimation \
         error squared, with the expected value 4; it needs ground truth. Brackets hold the 95 % acceptance \
         interval of a consistent filter. Above the interval the filter is overconfident, below it is conservative. \
         The velocity reference is ground truth, or else the slope of the detections on both sides.",
    );
    let head = [
        "object, region",
        "detections",
        "NIS",
        "NEES",
        "velocity RMSE (mm/s)",
        "upstream RMSE (mm/s)",
    ];
    let mut rows = Vec::new();
    for own in &document.evaluation {
        rows.push(vec![
            format!("{}, all", own.object.name()),
            own.detections.to_string(),
            format!("{:.2} % gated", 100.0 * own.gated_fraction),
            String::new(),
            milli(own.velocity_rmse_m_per_s),
            milli(own.upstream_velocity_rmse_m_per_s),
        ]);
        for region in &own.regions {
            rows.push(vec![
                format!("{}, {}", own.object.name(), region.region.title()),
                region.nis.map_or(0, |nis| nis.samples).to_string(),
                checked(region.nis.as_ref()),
                checked(region.nees.as_ref()),
                milli(region.velocity_rmse_m_per_s),
                milli(region.upstream_velocity_rmse_m_per_s),
            ]);
        }
    }
    page.table(&Table { head: head.map(str::to_owned).to_vec(), rows });
    for own in &document.evaluation {
        if let (Some(predicted), Some(stale)) =
            (own.predicted_position_rmse_m, own.unpredicted_position_rmse_m)
        {
            page.paragraph(&format!(
                "{}: latency {:.1} ms. Position error with prediction over the latency: {:.2} mm; without: {:.2} mm.",
                own.object.name(),
                1e3 * document.filter.latency_s,
                1e3 * predicted,
                1e3 * stale
            ));
        }
    }
}

fn checked(consistency: Option<&Consistency>) -> String {
    let Some(own) = consistency else { return "-".to_owned() };
    let word = match own.verdict {
        Some(ConsistencyVerdict::Consistent) => "",
        Some(verdict) => &format!(" {}", verdict.name()),
        None => " not tested: few samples",
    };
    format!("{:.2} ({:.2} to {:.2}){word}", own.mean, own.band95[0], own.band95[1])
}

fn whiteness(page: &mut Page, document: &Document) {
    page.section("Whiteness of innovations");
    page.paragraph(
        "Autocorrelation of normalized innovations. The innovations of an optimal filter are white: 95 % of the \
         values lie in the band.",
    );
    page.charts(&with_same_y(document.evaluation.iter().map(autocorrelation).collect()));
}

fn autocorrelation(own: &ObjectEvaluation) -> Chart {
    let white = &own.whiteness;
    let points = |values: &[f64]| -> Points {
        values.iter().enumerate().map(|(k, value)| (k as f64 + 1.0, *value)).collect()
    };
    let limit = white.limit95;
    let band = vec![(1.0, -limit, limit), (LONGEST_LAG as f64, -limit, limit)];
    Chart::of_lines(
        &format!("{}: {:.0} % within the band", own.object.name(), 100.0 * white.fraction_within),
        Axis::new("lag", "detections"),
        Axis::new("autocorrelation", ""),
    )
    .with(Series::band("95 % of white noise", Colour::Grey, band))
    .with(Series::marked("x", Colour::Blue, points(&white.autocorrelation[0])))
    .with(Series::marked("y", Colour::Orange, points(&white.autocorrelation[1])))
}

fn bounces(page: &mut Page, tuned: &Tuned) {
    let document = &tuned.document;
    page.section("Step response of the velocity after an impact");
    if document.bounces.is_empty() {
        page.paragraph("The held-out runs contain no impact of the ball.");
        return;
    }
    let head = [
        "ball against",
        "impacts",
        "rise time to 63 %, median (frames)",
        "95th percentile (frames)",
        "median (ms)",
        "upstream, median (frames)",
        "upstream, median (ms)",
    ];
    let rows = document.bounces.iter().map(|own| {
        vec![
            hit_title(own.hit).to_owned(),
            own.impacts.to_string(),
            format!("{:.1}", own.own.median_frames),
            format!("{:.1}", own.own.p95_frames),
            format!("{:.1}", 1e3 * own.own.median_s),
            format!("{:.1}", own.upstream.median_frames),
            format!("{:.1}", 1e3 * own.upstream.median_s),
        ]
    });
    page.table(&Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() });
    let all = responses(&tuned.runs, &document.filter);
    let charts: Vec<Chart> =
        document.bounces.iter().map(|own| response_chart(&all, own.hit)).collect();
    page.charts(&with_same_y(charts));
}

fn hit_title(hit: Hit) -> &'static str {
    match hit {
        Hit::Wall => "a wall",
        Hit::Striker => "a striker",
    }
}

/// Median over all impacts, by the frame after the impact.
fn response_chart(all: &[Response], hit: Hit) -> Chart {
    let of_kind: Vec<&Response> = all.iter().filter(|own| own.hit == hit).collect();
    let at = |k: usize, of: fn(&Response) -> &[f64]| {
        let values: Vec<f64> = of_kind.iter().filter_map(|own| of(own).get(k).copied()).collect();
        median(&values)
    };
    let points = |of: fn(&Response) -> &[f64]| -> Points {
        (0..super::rise::LONGEST_FRAMES)
            .map_while(|k| Some((at(k, |own| &own.times_s)?, at(k, of)?)))
            .take_while(|(time, _)| *time < RESPONSE_SECONDS)
            .map(|(time, part)| (1e3 * time, part))
            .collect()
    };
    Chart::of_lines(
        &format!("Ball against {}, median of {} impacts", hit_title(hit), of_kind.len()),
        Axis::new("time since the impact", "ms"),
        Axis::new("fraction of the velocity change", ""),
    )
    .with(Series::level("63 %", Colour::Grey, 0.632))
    .with(Series::marked("upstream settings", Colour::Orange, points(|own| &own.upstream)))
    .with(Series::marked("tuned filter", Colour::Blue, points(|own| &own.own)))
    .with_height(320)
}

fn trace(page: &mut Page, tuned: &Tuned) {
    let object = shown(&tuned.document);
    let Some(run) = longest(&tuned.runs, object) else { return };
    page.section("Velocity in a held-out run");
    page.paragraph(&format!("Object: {}. Run: {}.", object.name(), run.name));
    for axis in 0..2 {
        if let Some(chart) = velocity_chart(run, object, axis) {
            page.chart(&chart);
        }
    }
}

fn velocity_chart(run: &EvaluatedRun, object: Object, axis: usize) -> Option<Chart> {
    let index = object.index();
    let began = run.frames.first()?.frame.seen.time;
    let points = |of: &dyn Fn(&super::evaluate::EvaluatedFrame) -> Option<f64>| -> Points {
        run.frames
            .iter()
            .filter_map(|frame| Some((frame.frame.seen.time.seconds_since(began), of(frame)?)))
            .take_while(|(time, _)| *time < TRACE_SECONDS)
            .collect()
    };
    let upstream = points(&|frame| Some(frame.upstream[index]?[axis + 2]));
    let reference = points(&|frame| Some(frame.velocity[index]?[axis]));
    let own = points(&|frame| Some(frame.estimates[index]?.mean[axis + 2]));
    let chart = Chart::of_lines(
        &format!("Velocity along {}", ["x", "y"][axis]),
        Axis::new("time", "s"),
        Axis::new("velocity", "m/s"),
    );
    let chart = chart.in_group("velocity").with(Series::line(
        "upstream settings",
        Colour::Orange,
        upstream,
    ));
    let chart = chart.with(Series::line("reference velocity", Colour::Ink, reference));
    Some(chart.with(Series::dashed("tuned filter", Colour::Blue, own).with_width(2.2)))
}

fn settings(page: &mut Page, document: &Document) {
    page.section("Settings");
    let text = serde_json::to_value(document.filter).unwrap_or_default();
    let mut rows = Vec::new();
    flatten("", &text, &mut rows);
    page.table(&Table { head: vec!["setting".to_owned(), "value".to_owned()], rows });
}

/// Every number with its path.
fn flatten(path: &str, value: &serde_json::Value, rows: &mut Vec<Vec<String>>) {
    match value {
        serde_json::Value::Object(fields) => {
            for (name, value) in fields {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                flatten(&path, value, rows);
            }
        }
        other => {
            let text =
                other.as_f64().map_or_else(|| other.to_string(), |value| format!("{value:.6}"));
            rows.push(vec![path.to_owned(), text]);
        }
    }
}

fn provenance(page: &mut Page, document: &Document) {
    page.section("Provenance");
    page.code(&document.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({})",
        document.provenance.crate_version, document.provenance.git_hash
    ));
    let rows = document.inputs.iter().map(|own| vec![own.name.clone(), own.sha256.clone()]);
    let head = ["input", "SHA-256"].map(str::to_owned).to_vec();
    page.table(&Table { head, rows: rows.collect() });
}
