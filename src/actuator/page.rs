//! `index.html` of `fit-actuator`: what a person wants to see before trusting the model.

use super::{
    Ablation, Cell, Run,
    coverage::{AxisCoverage, CELLS},
    evaluation::{Component, ErrorRow, Evaluation, HORIZONS_S, LONGEST_HORIZON_S},
    study::{Study, Summary},
};
use crate::report::{
    Axis, Band, Curve, HeatMap, LinePlot, Page, Scale, Stroke, Table, heat_map, line_plot,
};

const INK: [u8; 3] = [29, 39, 51];
const GREY: [u8; 3] = [160, 168, 178];
const BLUE: [u8; 3] = [31, 105, 180];
const ORANGE: [u8; 3] = [208, 112, 24];
const GREEN: [u8; 3] = [52, 140, 86];
const RED: [u8; 3] = [190, 60, 60];

const WIDE: (u32, u32) = (980, 300);
const HALF: (u32, u32) = (480, 380);
/// Length of the traces that are drawn (s); the file holds the whole runs.
const TRACE_SECONDS: f64 = 6.0;

/// The page.
#[must_use]
pub fn page(study: &Study, summary: &Summary) -> String {
    let mut page = Page::new("Actuator model");
    page.lead(&lead(summary));
    page.paragraph(&format!("On held-out runs, {}.", summary.verdict));
    for warning in &summary.warnings {
        page.warning(&capitalised(warning));
    }
    errors(&mut page, summary);
    traces(&mut page, study);
    growth(&mut page, study);
    ablation(&mut page, summary);
    curves(&mut page, study);
    coverage(&mut page, study, summary);
    patterns(&mut page, summary);
    provenance(&mut page, summary);
    page.finish()
}

fn capitalised(sentence: &str) -> String {
    let mut characters = sentence.chars();
    let first = characters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(characters).chain(['.']).collect()
}

/// A speed in mm/s, the unit of the whole page, with three digits that count.
fn speed(value: f64) -> String {
    let value = 1e3 * value;
    match value.abs() {
        size if !size.is_finite() => "diverges".to_owned(),
        size if size < 10.0 => format!("{value:.2}"),
        size if size < 100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// `1 step`, `2 steps`.
fn count(number: usize, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

fn lead(summary: &Summary) -> String {
    let chosen = &summary.chosen;
    let free = summary.free_running_rmse_m_per_s.last();
    format!(
        "{} of history, {} x {} units, layout {}: one step ahead the median of {} is {} mm/s off, \
         free-running over {} s {} mm/s, on {} ({:.0} s).",
        count(chosen.history_steps, "step"),
        chosen.hidden_layers,
        chosen.width,
        chosen.layout,
        count(summary.seeds.len(), "seed"),
        speed(summary.one_step_rmse_m_per_s.median),
        free.map_or(0.0, |f| f.horizon_s),
        free.map_or_else(String::new, |f| speed(f.spread.median)),
        count(summary.held_out.runs, "held-out run"),
        summary.held_out.duration_s,
    )
}

fn model_title(model: &str) -> &str {
    match model {
        "network" => "network (its median seed)",
        "fopdt" => "first order plus dead time",
        "arx" => "linear ARX",
        "ideal" => "ideal (v = command)",
        other => other,
    }
}

fn with_interval(row: &ErrorRow) -> String {
    match row.ci95_m_per_s {
        Some(ci) if row.rmse_m_per_s.is_finite() => {
            format!("{} ({} – {})", speed(row.rmse_m_per_s), speed(ci.low), speed(ci.high))
        }
        _ => speed(row.rmse_m_per_s),
    }
}

fn errors(page: &mut Page, summary: &Summary) {
    page.section("How wrong it is, beside simpler models");
    page.paragraph(
        "Root mean square error in mm/s on held-out runs, both axes; in brackets the 95 % interval \
         by bootstrap over runs. Free-running: the model gets the measured history once, then only \
         commands.",
    );
    let rows =
        || summary.errors.iter().filter(|r| r.pattern == "all" && r.component == Component::Both);
    let mut head = vec!["model".to_owned(), "one step".to_owned()];
    head.extend(HORIZONS_S.map(|horizon| format!("over {horizon} s")));
    head.push(format!("peak over {} s", LONGEST_HORIZON_S));
    let mut table = Table { head, rows: Vec::new() };
    for model in ["network", "arx", "fopdt", "ideal"] {
        let of_model: Vec<&ErrorRow> = rows().filter(|row| row.model == model).collect();
        let mut cells = vec![model_title(model).to_owned()];
        cells.extend(of_model.iter().map(|row| with_interval(row)));
        cells.extend(of_model.last().map(|row| speed(row.peak_m_per_s)));
        table.rows.push(cells);
    }
    page.table(&table);
    let spread = &summary.one_step_rmse_m_per_s;
    let free: Vec<String> = summary
        .free_running_rmse_m_per_s
        .iter()
        .map(|f| format!("{} s {} to {}", f.horizon_s, speed(f.spread.min), speed(f.spread.max)))
        .collect();
    page.paragraph(&format!(
        "Over {}: one step {} to {}; free-running over {} (mm/s). Held-out over training \
         error, one step: {:.1}.",
        count(summary.seeds.len(), "seed"),
        speed(spread.min),
        speed(spread.max),
        free.join(", "),
        summary.overfit_ratio
    ));
    let lag = |axis: usize| {
        let lag = &summary.fopdt[axis];
        format!(
            "gain {:.3}, time constant {:.1} ms, delay {:.1} ms",
            lag.gain,
            1e3 * lag.tau_s,
            1e3 * lag.delay_s
        )
    };
    page.paragraph(&format!("The fitted first order plus dead time: x {}; y {}.", lag(0), lag(1)));
}

fn traces(page: &mut Page, study: &Study) {
    page.section("Measured and predicted");
    page.paragraph(&format!(
        "The first held-out run of each pattern, its first {TRACE_SECONDS} s, free-running \
         throughout: after the history the model sees only commands."
    ));
    page.legend(&[
        ("measured", INK),
        ("network, median seed (band: all seeds)", BLUE),
        ("command", GREY),
    ]);
    let mut seen: Vec<&str> = Vec::new();
    for run in &study.dataset.held_out {
        if seen.contains(&run.pattern.as_str()) || run.len() <= study.history {
            continue;
        }
        seen.push(&run.pattern);
        let pictures = [0, 1].map(|axis| trace(study, run, axis));
        let title = format!("{} (run {})", run.pattern, run.number);
        if seen.len() <= 2 {
            page.paragraph(&title);
            pictures.iter().for_each(|picture| page.picture(picture));
        } else {
            page.folded_pictures(&title, &pictures);
        }
    }
}

fn trace(study: &Study, run: &Run, axis: usize) -> String {
    let (dt, first) = (study.dataset.dt(), study.history);
    let shown = run.len().min((TRACE_SECONDS / dt) as usize);
    let points = |values: &[[f64; 2]], from: usize| -> Vec<(f64, f64)> {
        let timed = values.iter().enumerate();
        let timed = timed.map(|(k, pair)| ((from + k) as f64 * dt, pair[axis]));
        timed.take(shown.saturating_sub(from)).collect()
    };
    let seeds: Vec<Vec<(f64, f64)>> = study
        .seeds
        .iter()
        .map(|seed| points(&study.whole_run(&seed.fit.model, run), first))
        .collect();
    let band = (0..seeds[0].len())
        .map(|k| {
            let values = || seeds.iter().map(|seed| seed[k].1);
            let (low, high) =
                (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
            (seeds[0][k].0, low, high)
        })
        .collect();
    let curve = |colour, stroke, points| Curve { colour, stroke, points };
    line_plot(&LinePlot {
        title: format!("{} velocity, {}", ["x", "y"][axis], run.pattern),
        x: "time in the run (s)".to_owned(),
        y: Axis { label: "velocity (m/s)".to_owned(), scale: Scale::Linear },
        bands: vec![Band { colour: BLUE, points: band }],
        curves: vec![
            curve(GREY, Stroke::Solid, points(&run.commands, 0)),
            curve(INK, Stroke::Solid, points(&run.velocities, 0)),
            curve(BLUE, Stroke::Dashed, seeds[study.chosen].clone()),
        ],
        size: WIDE,
    })
}

fn growth(page: &mut Page, study: &Study) {
    page.section("Error against horizon");
    page.legend(&[
        ("network, median seed (band: all seeds)", BLUE),
        ("linear ARX", GREEN),
        ("first order plus dead time", ORANGE),
        ("ideal", GREY),
    ]);
    let curve = |colour, evaluation: &Evaluation| {
        let points = evaluation.growth().into_iter().map(|(t, error)| (t, 1e3 * error)).collect();
        Curve { colour, stroke: Stroke::Solid, points }
    };
    let by_seed: Vec<Vec<(f64, f64)>> =
        study.seeds.iter().map(|seed| seed.evaluation.growth()).collect();
    let band = (0..by_seed[0].len())
        .map(|k| {
            let values = || by_seed.iter().map(|seed| seed[k].1);
            let (low, high) =
                (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
            (by_seed[0][k].0, 1e3 * low, 1e3 * high)
        })
        .collect();
    let [ideal, lag, arx] = &study.baselines.evaluations;
    page.picture(&line_plot(&LinePlot {
        title: "Free-running error at each time after the start".to_owned(),
        x: "time since the last measurement (s)".to_owned(),
        y: Axis { label: "RMS error (mm/s)".to_owned(), scale: Scale::Logarithmic },
        bands: vec![Band { colour: BLUE, points: band }],
        curves: vec![
            curve(GREY, ideal),
            curve(ORANGE, lag),
            curve(GREEN, arx),
            curve(BLUE, &study.chosen().evaluation),
        ],
        size: (980, 340),
    }));
}

fn ablation(page: &mut Page, summary: &Summary) {
    let Some(ablation) = &summary.ablation else { return };
    page.section("Ablation");
    let chosen = &ablation.cells[ablation.chosen];
    let best = &ablation.cells[ablation.best];
    let cross = ablation.cross_fitted_rmse_m_per_s.map_or_else(String::new, |error| {
        format!(
            " Chosen on one half of the held-out runs and evaluated on the other, both ways, the \
             error is {} mm/s.",
            speed(error)
        )
    });
    page.paragraph(&format!(
        "Smallest free-running error: {}, {} units ({} mm/s). Chosen, as the smallest network \
         within one standard error of it: {}, {} units ({} mm/s).{cross}",
        count(best.history_steps, "step"),
        best.width,
        speed(best.mean_rmse_m_per_s),
        count(chosen.history_steps, "step"),
        chosen.width,
        speed(chosen.mean_rmse_m_per_s),
    ));
    page.picture(&ablation_map(ablation));
    page.table(&ablation_table(ablation));
}

fn ablation_map(ablation: &Ablation) -> String {
    let sorted = |value: fn(&Cell) -> usize| {
        let mut values: Vec<usize> = ablation.cells.iter().map(value).collect();
        values.sort_unstable();
        values.dedup();
        values
    };
    let (histories, widths) = (sorted(|c| c.history_steps), sorted(|c| c.width));
    let cell = |history: usize, width: usize| {
        ablation.cells.iter().find(|c| (c.history_steps, c.width) == (history, width))
    };
    let shade = |cell: Option<&Cell>| cell.map_or(f64::NAN, |c| c.mean_rmse_m_per_s.log10());
    let text = |cell: Option<&Cell>| {
        cell.map_or_else(String::new, |cell| {
            let history = count(cell.history_steps, "step");
            format!("{history}, {} units: {}", cell.width, speed(cell.mean_rmse_m_per_s))
        })
    };
    let row = |history: &usize| widths.iter().map(|width| cell(*history, *width)).collect();
    let rows: Vec<Vec<Option<&Cell>>> = histories.iter().map(row).collect();
    heat_map(&HeatMap {
        title: "Free-running error (mm/s), mean over seeds; shade: log10 of m/s".to_owned(),
        x: "width".to_owned(),
        y: "history".to_owned(),
        x_range: (0.0, widths.len() as f64),
        y_range: (0.0, histories.len() as f64),
        values: rows.iter().map(|row| row.iter().map(|cell| shade(*cell)).collect()).collect(),
        cells: rows.iter().map(|row| row.iter().map(|cell| text(*cell)).collect()).collect(),
        size: (760, 320),
    })
}

fn ablation_table(ablation: &Ablation) -> Table {
    let head =
        ["history", "width", "parameters", "seeds", "one step", "free-running", "std. error"];
    let rows = ablation.cells.iter().map(|cell| {
        vec![
            cell.history_steps.to_string(),
            cell.width.to_string(),
            cell.parameters.to_string(),
            cell.seeds.to_string(),
            speed(cell.one_step_rmse_m_per_s),
            speed(cell.mean_rmse_m_per_s),
            speed(cell.standard_error_m_per_s),
        ]
    });
    Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
}

fn curves(page: &mut Page, study: &Study) {
    page.section("Learning curves");
    page.legend(&[("training runs", BLUE), ("held-out runs", RED)]);
    let mut drawn = Vec::new();
    for seed in &study.seeds {
        let curve = &seed.fit.curve;
        drawn.push(Curve {
            colour: BLUE,
            stroke: Stroke::Solid,
            points: curve.iter().map(|e| (e.epoch as f64, 1e3 * e.train_rmse_m_per_s)).collect(),
        });
        let held_out =
            curve.iter().filter_map(|e| Some((e.epoch as f64, 1e3 * e.held_out_rmse_m_per_s?)));
        drawn.push(Curve { colour: RED, stroke: Stroke::Solid, points: held_out.collect() });
    }
    page.picture(&line_plot(&LinePlot {
        title: "One step ahead, every seed".to_owned(),
        x: "epoch".to_owned(),
        y: Axis { label: "RMS error (mm/s)".to_owned(), scale: Scale::Logarithmic },
        bands: Vec::new(),
        curves: drawn,
        size: (980, 320),
    }));
}

fn coverage(page: &mut Page, study: &Study, summary: &Summary) {
    page.section("Coverage");
    page.paragraph(&format!(
        "Where the fitted samples lie; blank cells were never seen, and there the model \
         extrapolates. Outside lie {:.2} % of the held-out samples.",
        100.0 * summary.held_out_fraction_outside_coverage
    ));
    let maps = ["x", "y"].into_iter().zip(&study.coverage.axes);
    let maps: Vec<String> = maps.map(|(axis, coverage)| coverage_map(axis, coverage)).collect();
    page.pictures_in_row(&maps);
}

fn coverage_map(axis: &str, coverage: &AxisCoverage) -> String {
    let (command, velocity) = (coverage.command_span_m_per_s, coverage.velocity_span_m_per_s);
    let shade = |count: u32| if count == 0 { f64::NAN } else { f64::from(count).log10() };
    let values = (0..CELLS)
        .map(|row| (0..CELLS).map(|column| shade(coverage.counts[column][row])).collect())
        .collect();
    heat_map(&HeatMap {
        title: format!("{axis}: log10 of the samples in each cell"),
        x: format!("{axis} command (m/s)"),
        y: format!("{axis} velocity (m/s)"),
        x_range: (-command, command),
        y_range: (-velocity, velocity),
        values,
        cells: Vec::new(),
        size: HALF,
    })
}

fn patterns(page: &mut Page, summary: &Summary) {
    page.section("By pattern and axis");
    page.paragraph("The median seed, in mm/s.");
    let head = ["pattern", "axis", "one step", "free-running", "peak free-running"];
    let mut rows = Vec::new();
    let network = || summary.errors.iter().filter(|row| row.model == "network");
    for row in network().filter(|row| row.horizon_s == 0.0) {
        let same = |other: &&ErrorRow| {
            (&other.pattern, other.component, other.horizon_s)
                == (&row.pattern, row.component, LONGEST_HORIZON_S)
        };
        let free = network().find(same);
        rows.push(vec![
            row.pattern.clone(),
            row.component.name().to_owned(),
            with_interval(row),
            free.map_or_else(String::new, with_interval),
            free.map_or_else(String::new, |free| speed(free.peak_m_per_s)),
        ]);
    }
    page.table(&Table { head: head.map(str::to_owned).to_vec(), rows });
}

fn provenance(page: &mut Page, summary: &Summary) {
    page.section("How it was made");
    page.code(&summary.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({}); {} player, {:.0} Hz; fitted to {} runs, {} samples ({:.0} s).",
        summary.provenance.crate_version,
        summary.provenance.git_hash,
        summary.player,
        summary.rate_hz,
        summary.train.runs,
        summary.train.samples,
        summary.train.duration_s
    ));
    let rows = summary.inputs.iter().map(|input| {
        vec![input.name.clone(), input.session.clone().unwrap_or_default(), input.sha256.clone()]
    });
    let head = ["input", "session", "SHA-256"].map(str::to_owned).to_vec();
    page.table(&Table { head, rows: rows.collect() });
}
