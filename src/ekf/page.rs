//! `index.html` of `tune-ekf`: what a person wants to see before trusting an estimate.

use super::{
    document::{Document, Tuned},
    evaluate::{Consistency, ConsistencyVerdict, EvaluatedRun, LONGEST_LAG, ObjectEvaluation},
    region::{Region, Regions, region_at},
    rise::{Hit, Response, responses},
    settings::{FilterSettings, Object},
};
use crate::{
    report::{
        Axis, Band, Curve, HeatMap, LinePlot, Page, Scale, Stroke, Table, heat_map, line_plot,
        path_plot,
    },
    stats::median,
};
use std::f64::consts::TAU;

const INK: [u8; 3] = [29, 39, 51];
const GREY: [u8; 3] = [160, 168, 178];
const BLUE: [u8; 3] = [31, 105, 180];
const ORANGE: [u8; 3] = [208, 112, 24];
const GREEN: [u8; 3] = [52, 140, 86];

const WIDE: (u32, u32) = (980, 300);
const BOARD: (u32, u32) = (480, 560);
/// Columns and rows of the map of regions.
const CELLS: [usize; 2] = [64, 84];
/// Where the strikers stand on the map (m): the home positions of the platform.
const HOME: [Option<[f64; 2]>; 2] = [Some([0.0, -0.1]), Some([0.0, 0.1])];
/// Frames on the map of ellipses.
const ELLIPSE_FRAMES: usize = 180;
/// Standard deviations of an ellipse that holds 95 % of a normal distribution in the plane.
const ELLIPSE_SIGMAS: f64 = 2.447_746_83;
/// Ellipses are drawn larger by this, or they would be dots.
const ELLIPSE_SCALE: f64 = 10.0;
/// Length of the velocity traces (s).
const TRACE_SECONDS: f64 = 3.0;
/// Time after an impact that is drawn (s).
const RESPONSE_SECONDS: f64 = 0.25;

/// The page.
#[must_use]
pub fn page(tuned: &Tuned) -> String {
    let document = &tuned.document;
    let mut page = Page::new("State estimate");
    page.lead(&lead(document));
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

/// Millimetres or mm/s with two digits behind the point.
fn milli(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{:.2}", 1e3 * value))
}

fn lead(document: &Document) -> String {
    let ball = document.evaluation.first();
    let velocity = ball.map_or_else(String::new, |own| {
        format!(
            " The velocity of the {} is {} mm/s off (upstream's settings: {} mm/s).",
            own.object.name(),
            milli(own.velocity_rmse_m_per_s),
            milli(own.upstream_velocity_rmse_m_per_s)
        )
    });
    format!(
        "Tuned on {} runs ({:.0} s), judged on {} others ({:.0} s).{velocity}",
        document.train.runs,
        document.train.duration_s,
        document.validation.runs,
        document.validation.duration_s
    )
}

fn regions(page: &mut Page, document: &Document) {
    let filter = &document.filter;
    page.section("Regions");
    let Some(ball) = &filter.ball.ball else { return };
    page.paragraph(
        "Process noise by the ball's predicted path, with both strikers at home. Where regions overlap \
         their noise is added; near a wall it acts across that wall only. The bounce itself is in \
         the transition, with its own scatter.",
    );
    let regions = Regions::new(&filter.board, filter.ball.open_psd_m2_per_s3, ball);
    let density = |place: [f64; 2]| {
        let (_, [qx, qy]) = regions.along(place, place, &HOME);
        (qx + qy).log10()
    };
    let name = |place: [f64; 2]| region_at(filter, place, &HOME) as usize as f64;
    let maps = [
        board_map(filter, "log10 of the noise density, x plus y (m2/s3)", &density),
        board_map(filter, "0 open, 1 wall x, 2 wall y, 3 striker, 4 goal", &name),
    ];
    page.pictures_in_row(&maps);
    page.table(&region_table(document));
}

fn board_map(filter: &FilterSettings, title: &str, value: &dyn Fn([f64; 2]) -> f64) -> String {
    let half = [filter.board.short_side_m / 2.0, filter.board.long_side_m / 2.0];
    let centre = |axis: usize, cell: usize| {
        half[axis] * (2.0 * (cell as f64 + 0.5) / CELLS[axis] as f64 - 1.0)
    };
    let row = |row: usize| {
        (0..CELLS[0]).map(|column| value([centre(0, column), centre(1, row)])).collect()
    };
    heat_map(&HeatMap {
        title: title.to_owned(),
        x: "x (m)".to_owned(),
        y: "y (m)".to_owned(),
        x_range: (-half[0], half[0]),
        y_range: (-half[1], half[1]),
        values: (0..CELLS[1]).map(row).collect(),
        cells: Vec::new(),
        size: BOARD,
    })
}

fn region_table(document: &Document) -> Table {
    let head = ["object, region", "train detections", "visits", "added noise (m2/s3)", "tuned"];
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
        "The {} in the first 1.5 s of {}: places with their 95 % ellipses, drawn {ELLIPSE_SCALE} times \
         as large as they are.",
        object.name(),
        run.name
    ));
    page.legend(&[("estimate", BLUE), ("detections", GREY), ("95 %, ten times", ORANGE)]);
    let frames = &run.frames[..run.frames.len().min(ELLIPSE_FRAMES)];
    let estimates: Vec<_> = frames.iter().filter_map(|f| f.estimates[object.index()]).collect();
    let seen = frames.iter().filter_map(|f| f.frame.seen.positions[object.index()]);
    let curve = |colour, points| Curve { colour, stroke: Stroke::Solid, points };
    let mut curves = vec![curve(INK, outline(&tuned.document.filter))];
    curves.extend(estimates.iter().skip(1).step_by(3).map(|own| curve(ORANGE, ellipse(own))));
    curves.push(curve(GREY, seen.map(|[x, y]| (x, y)).collect()));
    curves.push(curve(BLUE, estimates.iter().map(|own| (own.mean[0], own.mean[1])).collect()));
    page.picture(&path_plot(&LinePlot {
        title: "Board".to_owned(),
        x: "x (m)".to_owned(),
        y: Axis { label: "y (m)".to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves,
        size: (620, 720),
    }));
}

fn outline(filter: &FilterSettings) -> Vec<(f64, f64)> {
    let (x, y) = (filter.board.short_side_m / 2.0, filter.board.long_side_m / 2.0);
    vec![(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
}

/// Points of the ellipse of the place: the lower triangle of its covariance times a circle.
fn ellipse(own: &super::Estimate) -> Vec<(f64, f64)> {
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
        "NIS is the squared innovation over its covariance (2 when the filter is as sure as it may be), \
         NEES the squared error of the state over its covariance (4), where the truth is known. In \
         brackets where the mean of a consistent filter lies in 95 % of cases. Velocities are compared \
         with the truth, or else with the slope of the detections on both sides.",
    );
    let head =
        ["object, region", "detections", "NIS", "NEES", "velocity RMSE (mm/s)", "upstream (mm/s)"];
    let mut rows = Vec::new();
    for own in &document.evaluation {
        rows.push(vec![
            format!("{}, all", own.object.name()),
            own.detections.to_string(),
            format!("{:.2} % refused", 100.0 * own.gated_fraction),
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
                "{}: moved ahead by the latency of {:.1} ms the place is {:.2} mm off; left as it was, \
                 {:.2} mm.",
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
        None => " too few",
    };
    format!("{:.2} ({:.2} – {:.2}){word}", own.mean, own.band95[0], own.band95[1])
}

fn whiteness(page: &mut Page, document: &Document) {
    page.section("Innovations");
    page.paragraph(
        "Autocorrelation of normalised innovations; those of a filter that takes everything out of the \
         detections are white, with 95 % of the values in the band.",
    );
    let pictures: Vec<String> = document.evaluation.iter().map(autocorrelation).collect();
    page.legend(&[("x", BLUE), ("y", ORANGE)]);
    page.pictures_in_row(&pictures);
}

fn autocorrelation(own: &ObjectEvaluation) -> String {
    let white = &own.whiteness;
    let curve = |colour, values: &[f64]| Curve {
        colour,
        stroke: Stroke::Solid,
        points: values.iter().enumerate().map(|(k, value)| (k as f64 + 1.0, *value)).collect(),
    };
    let limit = white.limit95;
    line_plot(&LinePlot {
        title: format!("{}: {:.0} % within", own.object.name(), 100.0 * white.fraction_within),
        x: "lag (detections)".to_owned(),
        y: Axis { label: "autocorrelation".to_owned(), scale: Scale::Linear },
        bands: vec![Band {
            colour: GREY,
            points: vec![(1.0, -limit, limit), (LONGEST_LAG as f64, -limit, limit)],
        }],
        curves: vec![
            curve(BLUE, &white.autocorrelation[0]),
            curve(ORANGE, &white.autocorrelation[1]),
        ],
        size: (480, 300),
    })
}

fn bounces(page: &mut Page, tuned: &Tuned) {
    let document = &tuned.document;
    page.section("Velocity after a bounce");
    if document.bounces.is_empty() {
        page.paragraph("No bounce of the ball was found in the held-out runs.");
        return;
    }
    let head = [
        "ball against",
        "impacts",
        "frames to 63 %",
        "95 % within",
        "ms",
        "upstream: frames",
        "ms",
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
    page.legend(&[
        ("this filter, median", BLUE),
        ("upstream's settings, median", GREY),
        ("63 %", GREEN),
    ]);
    let pictures: Vec<String> =
        document.bounces.iter().map(|own| response_plot(&all, own.hit)).collect();
    page.pictures_in_row(&pictures);
}

fn hit_title(hit: Hit) -> &'static str {
    match hit {
        Hit::Wall => "a wall",
        Hit::Striker => "a striker",
    }
}

/// Medians over all impacts, by the frame after the impact.
fn response_plot(all: &[Response], hit: Hit) -> String {
    let of_kind: Vec<&Response> = all.iter().filter(|own| own.hit == hit).collect();
    let at = |k: usize, of: fn(&Response) -> &[f64]| {
        let values: Vec<f64> = of_kind.iter().filter_map(|own| of(own).get(k).copied()).collect();
        median(&values)
    };
    let curve = |colour, of: fn(&Response) -> &[f64]| Curve {
        colour,
        stroke: Stroke::Solid,
        points: (0..super::rise::LONGEST_FRAMES)
            .map_while(|k| Some((at(k, |own| &own.times_s)?, at(k, of)?)))
            .take_while(|(time, _)| *time < RESPONSE_SECONDS)
            .map(|(time, share)| (1e3 * time, share))
            .collect(),
    };
    let level = vec![(0.0, 0.632), (1e3 * RESPONSE_SECONDS, 0.632)];
    line_plot(&LinePlot {
        title: format!("Ball against {}", hit_title(hit)),
        x: "time since the impact (ms)".to_owned(),
        y: Axis { label: "share of the change".to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves: vec![
            Curve { colour: GREEN, stroke: Stroke::Dashed, points: level },
            curve(GREY, |own| &own.upstream),
            curve(BLUE, |own| &own.own),
        ],
        size: (480, 320),
    })
}

fn trace(page: &mut Page, tuned: &Tuned) {
    let object = shown(&tuned.document);
    let Some(run) = longest(&tuned.runs, object) else { return };
    page.section("Velocity of a held-out run");
    page.paragraph(&format!("{}, {}.", object.name(), run.name));
    page.legend(&[("truth or slope", INK), ("this filter", BLUE), ("upstream's settings", GREY)]);
    for axis in 0..2 {
        page.picture(&velocity_plot(run, object, axis));
    }
}

fn velocity_plot(run: &EvaluatedRun, object: Object, axis: usize) -> String {
    let index = object.index();
    let Some(began) = run.frames.first().map(|frame| frame.frame.seen.time) else {
        return String::new();
    };
    let points = |of: &dyn Fn(&super::evaluate::EvaluatedFrame) -> Option<f64>| -> Vec<(f64, f64)> {
        run.frames
            .iter()
            .filter_map(|frame| Some((frame.frame.seen.time.seconds_since(began), of(frame)?)))
            .take_while(|(time, _)| *time < TRACE_SECONDS)
            .collect()
    };
    let curve = |colour, points| Curve { colour, stroke: Stroke::Solid, points };
    line_plot(&LinePlot {
        title: format!("v{}", ["x", "y"][axis]),
        x: "time (s)".to_owned(),
        y: Axis { label: "velocity (m/s)".to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves: vec![
            curve(GREY, points(&|frame| Some(frame.upstream[index]?[axis + 2]))),
            curve(INK, points(&|frame| Some(frame.velocity[index]?[axis]))),
            curve(BLUE, points(&|frame| Some(frame.estimates[index]?.mean[axis + 2]))),
        ],
        size: WIDE,
    })
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
    page.section("How it was made");
    page.code(&document.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({})",
        document.provenance.crate_version, document.provenance.git_hash
    ));
    let rows = document.inputs.iter().map(|own| vec![own.name.clone(), own.sha256.clone()]);
    let head = ["input", "SHA-256"].map(str::to_owned).to_vec();
    page.table(&Table { head, rows: rows.collect() });
}
