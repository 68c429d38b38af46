//! `index.html` of `fit-actuator`: accuracy of the model on held-out runs.

use super::{
    Ablation, Cell, Run,
    coverage::{AxisCoverage, CELLS},
    evaluation::{Component, ErrorRow, Evaluation, HORIZONS_S, LONGEST_HORIZON_S},
    study::{Study, Summary},
};
use crate::report::{
    Axis, Badge, Chart, Colour, Grid, Page, Points, Ranges, Series, Table, with_same_y,
};

/// Length of the drawn traces (s); `actuator.mcap` holds the whole runs.
const TRACE_SECONDS: f64 = 6.0;

/// Page of a study.
#[must_use]
pub fn page(study: &Study, summary: &Summary) -> String {
    let mut page = Page::new("Actuator model");
    badge(&mut page, summary);
    page.lead(&lead(summary));
    page.paragraph(&format!("On held-out runs, {}.", summary.verdict));
    page.key_figures(&key_figures(summary));
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

/// Compare the network with the best simpler model.
fn badge(page: &mut Page, summary: &Summary) {
    match summary.verdict.ci95_m_per_s {
        Some(ci) if ci.high < 0.0 => {
            page.badge("more accurate than the simpler models", Badge::Good);
        }
        Some(ci) if 0.0 < ci.low => page.badge("less accurate than a simpler model", Badge::Bad),
        _ => page.badge("no significant difference from a simpler model", Badge::Warn),
    }
}

fn key_figures(summary: &Summary) -> [(&'static str, String); 4] {
    let free = summary.free_running_rmse_m_per_s.last();
    [
        ("one-step RMSE", format!("{} mm/s", speed(summary.one_step_rmse_m_per_s.median))),
        (
            "simulation RMSE over 2 s",
            free.map_or_else(|| "–".to_owned(), |own| format!("{} mm/s", speed(own.spread.median))),
        ),
        ("held-out / training RMSE, one step", format!("{:.2}", summary.overfit_ratio)),
        ("training data", format!("{:.0} s", summary.train.duration_s)),
    ]
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
    format!(
        "Network with {} of command and velocity history, {} hidden layers of {} units, layout {}; \
         {}, evaluated on {} ({:.0} s).",
        count(chosen.history_steps, "step"),
        chosen.hidden_layers,
        chosen.width,
        chosen.layout,
        count(summary.seeds.len(), "seed"),
        count(summary.held_out.runs, "held-out run"),
        summary.held_out.duration_s,
    )
}

fn model_title(model: &str) -> &str {
    match model {
        "network" => "network (median seed)",
        "fopdt" => "first order plus dead time (FOPDT)",
        "arx" => "linear ARX",
        "ideal" => "ideal drive (velocity = command)",
        other => other,
    }
}

fn with_interval(row: &ErrorRow) -> String {
    match row.ci95_m_per_s {
        Some(ci) if row.rmse_m_per_s.is_finite() => {
            format!("{} ({} to {})", speed(row.rmse_m_per_s), speed(ci.low), speed(ci.high))
        }
        _ => speed(row.rmse_m_per_s),
    }
}

fn errors(page: &mut Page, summary: &Summary) {
    page.section("Accuracy compared with simpler models");
    page.paragraph(
        "Root mean square error (RMSE) of the velocity in mm/s on held-out runs, both axes. Brackets hold 95 % \
         intervals by bootstrap over runs. In simulation the model receives the measured history once, \
         then commands only.",
    );
    let rows =
        || summary.errors.iter().filter(|r| r.pattern == "all" && r.component == Component::Both);
    let mut head = vec!["model".to_owned(), "one step".to_owned()];
    head.extend(HORIZONS_S.map(|horizon| format!("simulation over {horizon} s")));
    head.push(format!("peak error over {} s", LONGEST_HORIZON_S));
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
        "Range over {}: one step {} to {} mm/s; simulation over {} (mm/s).",
        count(summary.seeds.len(), "seed"),
        speed(spread.min),
        speed(spread.max),
        free.join(", "),
    ));
    let lag = |axis: usize| {
        let lag = &summary.fopdt[axis];
        format!(
            "gain {:.3}, time constant {:.1} ms, dead time {:.1} ms",
            lag.gain,
            1e3 * lag.tau_s,
            1e3 * lag.delay_s
        )
    };
    page.paragraph(&format!("Fitted FOPDT model: x axis {}; y axis {}.", lag(0), lag(1)));
}

fn traces(page: &mut Page, study: &Study) {
    page.section("Measured and predicted");
    page.paragraph(&format!(
        "First {TRACE_SECONDS} s of the first held-out run of each pattern. After the history the model \
         receives commands only."
    ));
    let mut seen: Vec<&str> = Vec::new();
    for run in &study.dataset.held_out {
        if seen.contains(&run.pattern.as_str()) || run.len() <= study.history {
            continue;
        }
        seen.push(&run.pattern);
        let charts = with_same_y([0, 1].map(|axis| trace(study, run, axis)).into());
        let title = format!("{} (run {})", run.pattern, run.number);
        if seen.len() <= 2 {
            page.subsection(&title);
            page.charts(&charts);
        } else {
            page.folded_charts(&title, &charts);
        }
    }
}

fn trace(study: &Study, run: &Run, axis: usize) -> Chart {
    let (dt, first) = (study.dataset.dt(), study.history);
    let shown = run.len().min((TRACE_SECONDS / dt) as usize);
    let points = |values: &[[f64; 2]], from: usize| -> Points {
        let timed = values.iter().enumerate();
        let timed = timed.map(|(k, pair)| ((from + k) as f64 * dt, pair[axis]));
        timed.take(shown.saturating_sub(from)).collect()
    };
    let seeds: Vec<Points> = study
        .seeds
        .iter()
        .map(|seed| points(&study.whole_run(&seed.fit.model, run), first))
        .collect();
    let predicted =
        Series::dashed("network, median seed", Colour::Blue, seeds[study.chosen].clone());
    Chart::of_lines(
        &format!("Velocity along {}", ["x", "y"][axis]),
        Axis::new("time in the run", "s"),
        Axis::new("velocity", "m/s"),
    )
    .in_group(&format!("run-{}", run.number))
    .with(Series::line("command", Colour::Grey, points(&run.commands, 0)))
    .with(Series::line("measured", Colour::Ink, points(&run.velocities, 0)))
    .with(predicted.with_band(extremes(&seeds, 1.0)))
}

/// Range over seeds at each point of their common x, times `scale`.
fn extremes(seeds: &[Points], scale: f64) -> Ranges {
    let range = |k: usize| {
        let values = || seeds.iter().map(|seed| scale * seed[k].1);
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        (seeds[0][k].0, low, high)
    };
    (0..seeds[0].len()).map(range).collect()
}

fn growth(page: &mut Page, study: &Study) {
    page.section("Error against horizon");
    let points = |evaluation: &Evaluation| -> Points {
        evaluation.growth().into_iter().map(|(t, error)| (t, 1e3 * error)).collect()
    };
    let by_seed: Vec<Points> =
        study.seeds.iter().map(|judged| judged.evaluation.growth()).collect();
    let [ideal, lag, arx] = &study.baselines.evaluations;
    let network =
        Series::line("network, median seed", Colour::Blue, points(&study.chosen().evaluation));
    page.chart(
        &Chart::of_lines(
            "Simulation error by time since the last measurement",
            Axis::new("time since the last measurement", "s"),
            Axis::new("RMSE", "mm/s").logarithmic(),
        )
        .with(Series::line("ideal drive", Colour::Grey, points(ideal)))
        .with(Series::line("FOPDT", Colour::Orange, points(lag)))
        .with(Series::line("linear ARX", Colour::Green, points(arx)))
        .with(network.with_band(extremes(&by_seed, 1e3)))
        .with_height(340),
    );
}

fn ablation(page: &mut Page, summary: &Summary) {
    let Some(ablation) = &summary.ablation else { return };
    page.section("Ablation: history and width");
    let chosen = &ablation.cells[ablation.chosen];
    let best = &ablation.cells[ablation.best];
    let cross = ablation.cross_fitted_rmse_m_per_s.map_or_else(String::new, |error| {
        format!(
            " Selected on one half of the held-out runs and evaluated on the other half, in both \
             directions, the error is {} mm/s.",
            speed(error)
        )
    });
    page.paragraph(&format!(
        "Smallest simulation error: {}, {} units ({} mm/s). Selected, as the smallest network within \
         one standard error of it: {}, {} units ({} mm/s).{cross}",
        count(best.history_steps, "step"),
        best.width,
        speed(best.mean_rmse_m_per_s),
        count(chosen.history_steps, "step"),
        chosen.width,
        speed(chosen.mean_rmse_m_per_s),
    ));
    page.chart(&ablation_map(ablation));
    page.table(&ablation_table(ablation));
}

fn ablation_map(ablation: &Ablation) -> Chart {
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
    let shade =
        |cell: Option<&Cell>| cell.map_or(f64::NAN, |c| (1e3 * c.mean_rmse_m_per_s).log10());
    let text =
        |cell: Option<&Cell>| cell.map_or_else(String::new, |cell| speed(cell.mean_rmse_m_per_s));
    let row = |history: &usize| widths.iter().map(|width| cell(*history, *width)).collect();
    let rows: Vec<Vec<Option<&Cell>>> = histories.iter().map(row).collect();
    let names = |values: &[usize]| values.iter().map(ToString::to_string).collect();
    // Categories stand at 0, 1, 2 ..., in the middle of their cells.
    let edges = |count: usize| (-0.5, count as f64 - 0.5);
    let cells = rows.iter().map(|row| row.iter().map(|cell| text(*cell)).collect()).collect();
    let values = rows.iter().map(|row| row.iter().map(|cell| shade(*cell)).collect()).collect();
    let grid = Grid::of_numbers(
        values,
        edges(widths.len()),
        edges(histories.len()),
        "simulation RMSE (mm/s)",
    );
    Chart::of_plane(
        "Simulation RMSE over 2 s (mm/s), mean over seeds",
        Axis::of_categories("hidden units per layer", names(&widths)),
        Axis::of_categories("history (steps)", names(&histories)),
    )
    .with_grid(grid.of_logarithms().with_text(cells))
    .with_height(340)
}

fn ablation_table(ablation: &Ablation) -> Table {
    let head = [
        "history (steps)",
        "hidden units",
        "parameters",
        "seeds",
        "one step (mm/s)",
        "simulation (mm/s)",
        "standard error",
    ];
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
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    for judged in &study.seeds {
        let curve = &judged.fit.curve;
        train.push(curve.iter().map(|e| (e.epoch as f64, 1e3 * e.train_rmse_m_per_s)).collect());
        let known =
            curve.iter().filter_map(|e| Some((e.epoch as f64, 1e3 * e.held_out_rmse_m_per_s?)));
        held_out.push(known.collect());
    }
    page.chart(
        &Chart::of_lines(
            "One-step RMSE of every seed",
            Axis::new("epoch", ""),
            Axis::new("RMSE", "mm/s").logarithmic(),
        )
        .with(Series::lines("training runs", Colour::Blue, train))
        .with(Series::lines("held-out runs", Colour::Orange, held_out)),
    );
}

fn coverage(page: &mut Page, study: &Study, summary: &Summary) {
    page.section("Coverage");
    page.paragraph(&format!(
        "Density of the training samples. The model extrapolates in blank cells, which hold {:.2} % of the \
         held-out samples.",
        100.0 * summary.held_out_fraction_outside_coverage
    ));
    let span = |of: fn(&AxisCoverage) -> f64| {
        study.coverage.axes.iter().map(of).fold(f64::MIN_POSITIVE, f64::max)
    };
    let spans = [span(|own| own.command_span_m_per_s), span(|own| own.velocity_span_m_per_s)];
    let charts = ["x", "y"].into_iter().zip(&study.coverage.axes);
    let charts: Vec<Chart> =
        charts.map(|(axis, coverage)| coverage_map(axis, coverage, spans)).collect();
    page.charts(&charts);
}

/// Map of one axis; `spans` are the largest command and velocity of both, so that their maps compare.
fn coverage_map(axis: &str, coverage: &AxisCoverage, spans: [f64; 2]) -> Chart {
    let shade = |count: u32| if count == 0 { f64::NAN } else { f64::from(count).log10() };
    let values = (0..CELLS)
        .map(|row| (0..CELLS).map(|column| shade(coverage.counts[column][row])).collect())
        .collect();
    let (command, velocity) = (coverage.command_span_m_per_s, coverage.velocity_span_m_per_s);
    let grid =
        Grid::of_numbers(values, (-command, command), (-velocity, velocity), "samples in a cell");
    Chart::of_plane(
        &format!("Training samples, {axis} axis"),
        Axis::new("command", "m/s").within(-spans[0], spans[0]),
        Axis::new("velocity", "m/s").within(-spans[1], spans[1]),
    )
    .with_grid(grid.of_logarithms())
    .with_height(380)
}

fn patterns(page: &mut Page, summary: &Summary) {
    page.section("Accuracy by pattern and axis");
    page.paragraph("RMSE of the median seed in mm/s, with 95 % intervals.");
    let head = ["pattern", "axis", "one step", "simulation over 2 s", "peak error"];
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
    page.section("Provenance");
    page.code(&summary.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({}); {} player, {:.0} Hz; trained on {} runs, {} samples ({:.0} s).",
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
