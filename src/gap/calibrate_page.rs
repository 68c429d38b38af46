//! Page of `calibrate`: parameters with intervals, their correlations, and the residuals before and after.

use super::{
    find::Found,
    fit,
    page::{localization, provenance_section, residuals, text, unit},
    rounds::Outcome,
};
use crate::{
    provenance::Provenance,
    report::{Axis, Badge, Chart, Colour, Grid, Page, Series, Table},
    twin::{Session, Twin, Value},
};

/// Smallest correlation that the text reports: above it, two parameters are hardly separable.
const STRONG: f64 = 0.9;

/// Page of the calibration `found`, whose twin is in the file called `twin`.
#[must_use]
pub fn calibration_page(
    found: &Found<'_>,
    twin: &str,
    provenance: &Provenance,
    sessions: &[Session],
) -> String {
    let document = &found.document;
    let rows = parameters(found);
    let mut page = Page::new(&format!("Calibration: {twin}"));
    let (words, tone) = badge(found, &rows);
    page.badge(&words, tone);
    page.lead(&document.summary);
    page.key_figures(&key_figures(found, &rows));
    for warning in document.doubts() {
        page.warning(&text::sentence(warning));
    }
    page.section("Parameters");
    page.paragraph("Values with 95 % confidence intervals, before and after the fit.");
    interval_chart(&rows).iter().for_each(|chart| page.chart(chart));
    page.table_of_words(&parameter_table(&rows));
    correlations(&mut page, found);
    residuals(&mut page, found);
    localization::section(&mut page, found, sessions);
    provenance_section(
        &mut page,
        provenance,
        sessions,
        &format!("The twin is in {twin} in the same folder."),
    );
    page.finish()
}

/// One parameter of the twin.
struct Row {
    effect: &'static str,
    location: String,
    parameter: &'static str,
    unit: &'static str,
    /// Value of the initial twin, if it has the effect.
    before: Option<f64>,
    after: Value,
}

impl Row {
    fn label(&self) -> String {
        let effect = self.effect.rsplit('.').next().unwrap_or(self.effect).replace('_', " ");
        format!("{}\n{effect}, {}", text::label(self.parameter), self.location)
    }

    /// Return whether the interval contains zero, so that not even the sign is known.
    fn is_undetermined(&self) -> bool {
        self.after.ci95.is_some_and(|[low, high]| low <= 0.0 && 0.0 <= high)
    }
}

/// Value of a parameter in `twin`.
fn value(twin: &Twin, effect: &str, location: &str, index: usize) -> Option<f64> {
    let own = twin
        .instances
        .iter()
        .find(|instance| instance.effect.name == effect && instance.axis.to_string() == location);
    Some(own?.values.get(index)?.value)
}

fn parameters(found: &Found<'_>) -> Vec<Row> {
    let start = found.outcomes.first().map(|outcome| &outcome.start.twin);
    let mut rows = Vec::new();
    for instance in &found.twin.instances {
        let location = instance.axis.to_string();
        let pairs = instance.effect.parameters.iter().zip(&instance.values).enumerate();
        rows.extend(pairs.map(|(index, (parameter, after))| Row {
            effect: instance.effect.name,
            before: start.and_then(|twin| value(twin, instance.effect.name, &location, index)),
            location: location.clone(),
            parameter: parameter.name,
            unit: parameter.unit,
            after: *after,
        }));
    }
    rows
}

fn badge(found: &Found<'_>, rows: &[Row]) -> (String, Badge) {
    if !found.document.verdict.is_about_the_machine() {
        return ("not calibrated".to_owned(), Badge::Bad);
    }
    match rows.iter().filter(|row| row.is_undetermined()).count() {
        0 => ("calibrated".to_owned(), Badge::Good),
        count => (format!("{} not determined", text::count(count, "parameter")), Badge::Warn),
    }
}

fn key_figures(found: &Found<'_>, rows: &[Row]) -> Vec<(&'static str, String)> {
    let fitted = rows.iter().filter(|row| row.after.ci95.is_some()).count();
    let mut figures = vec![("fitted parameters", format!("{fitted} of {}", rows.len()))];
    let residuals = || found.document.residuals.iter();
    let worst = |of: fn(&super::SignalResidual) -> Option<f64>| {
        let ratios = residuals().filter_map(|own| Some(of(own)? / own.noise_floor?));
        ratios.filter(|ratio| ratio.is_finite()).reduce(f64::max)
    };
    let before = worst(|own| own.validation_before.or(own.train_before));
    let after = worst(|own| own.validation_after.or(own.train_after));
    if let (Some(before), Some(after)) = (before, after) {
        let both = format!("{} → {}", text::number(before), text::number(after));
        figures.push(("largest residual RMS in multiples of the noise floor", both));
    }
    figures.push(("signals", residuals().count().to_string()));
    figures
}

fn parameter_table(rows: &[Row]) -> Table {
    let cells = rows.iter().map(|row| {
        let [after, interval] = text::with_interval(row.after.value, row.after.ci95);
        let remark = match row.after.ci95 {
            None => "not fitted",
            Some(_) if row.is_undetermined() => "not determined: the interval contains zero",
            Some(_) => "",
        };
        vec![
            row.effect.to_owned(),
            row.location.clone(),
            text::label(row.parameter),
            row.before.map_or_else(|| "–".to_owned(), text::number),
            after,
            interval,
            unit(row.unit),
            remark.to_owned(),
        ]
    });
    let head =
        ["effect", "location", "parameter", "before", "after", "95 % interval", "unit", "remark"];
    Table::new(&head, cells.collect())
}

/// Intervals of the fitted parameters, relative to their values.
fn interval_chart(rows: &[Row]) -> Option<Chart> {
    let known: Vec<(String, f64, f64, Option<f64>)> = rows
        .iter()
        .filter_map(|row| {
            let ratio = |value: f64| value / row.after.value;
            let [low, high] = row.after.ci95?.map(ratio);
            let finite = low.is_finite() && high.is_finite();
            finite.then(|| (row.label(), low.min(high), low.max(high), row.before.map(ratio)))
        })
        .collect();
    if known.is_empty() {
        return None;
    }
    let at = |index: usize| index as f64;
    let points = (0..known.len()).map(|k| (at(k), 1.0)).collect();
    let ranges = known.iter().enumerate().map(|(k, one)| (at(k), one.1, one.2)).collect();
    let before = known.iter().enumerate().filter_map(|(k, one)| Some((at(k), one.3?)));
    let before = before.filter(|(_, value)| value.is_finite()).collect();
    let names = known.iter().map(|one| one.0.clone()).collect();
    Some(
        Chart::of_lines(
            "95 % intervals, relative to the fitted value",
            Axis::of_categories("parameter", names),
            Axis::new("value / fitted value", "").including(0.0),
        )
        .with(Series::level("zero", Colour::Grey, 0.0))
        .with(Series::rings("before", Colour::Orange, before))
        .with(Series::dots("after", Colour::Blue, points).with_whiskers(ranges))
        .with_height(340),
    )
}

fn correlations(page: &mut Page, found: &Found<'_>) {
    type Correlated<'a, 'b> = (Vec<String>, Vec<Vec<f64>>, &'a Outcome<'b>);
    let all: Vec<Correlated<'_, '_>> = found
        .outcomes
        .iter()
        .filter(|outcome| 1 < outcome.last.slots.len())
        .map(|outcome| {
            let matrix = fit::correlations(&outcome.train, &outcome.last, &outcome.filters);
            (slot_names(outcome), matrix, outcome)
        })
        .collect();
    if all.is_empty() {
        return;
    }
    page.section("Correlations");
    page.paragraph(
        "Absolute correlation of the parameter estimates, from the Gauss-Newton covariance at the solution. The data \
         determine two strongly correlated parameters only in combination.",
    );
    for (names, matrix, outcome) in &all {
        let strong = strong_pairs(names, matrix);
        if !strong.is_empty() {
            page.warning(&format!("Correlations above {STRONG}: {}.", strong.join("; ")));
        }
        page.chart(&correlation_chart(super::page::stage_name(outcome.kind), names, matrix));
    }
}

/// Names of the fitted parameters of one stage.
fn slot_names(outcome: &Outcome<'_>) -> Vec<String> {
    let instance = |slot: &crate::twin::Slot| &outcome.last.point.twin.instances[slot.instance];
    let name = |slot: &crate::twin::Slot| {
        let own = instance(slot);
        let effect = own.effect.name.rsplit('.').next().unwrap_or(own.effect.name);
        let parameter = text::label(own.effect.parameters[slot.parameter].name);
        format!("{} {parameter}, {}", effect.replace('_', " "), own.axis)
    };
    outcome.last.slots.iter().map(name).collect()
}

fn strong_pairs(names: &[String], matrix: &[Vec<f64>]) -> Vec<String> {
    let pairs = (0..names.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
    let strong = pairs.filter(|(j, i)| STRONG < matrix[*j][*i].abs());
    strong.map(|(j, i)| format!("{} and {}: {:.2}", names[j], names[i], matrix[j][i])).collect()
}

fn correlation_chart(title: &str, names: &[String], matrix: &[Vec<f64>]) -> Chart {
    let count = names.len();
    // Categories are at 0, 1, 2 ..., in the middle of their cells.
    let edges = (-0.5, count as f64 - 0.5);
    let values = matrix.iter().map(|row| row.iter().map(|value| value.abs()).collect()).collect();
    let texts = matrix.iter().map(|row| row.iter().map(|value| format!("{value:.2}")).collect());
    let grid = Grid::of_numbers(values, edges, edges, "absolute correlation").within(0.0, 1.0);
    let parameters = (1..=count).map(|number| number.to_string()).collect();
    let rows = names.iter().enumerate().map(|(k, name)| format!("{}: {name}", k + 1)).collect();
    Chart::of_plane(
        title,
        Axis::of_categories("parameter", parameters),
        Axis::of_categories("", rows),
    )
    .with_grid(grid.with_text(texts.collect()))
    .with_height(110 + 34 * count as u32)
}
