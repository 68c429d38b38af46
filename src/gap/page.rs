//! `index.html` of `gap`: verdict, missing effects, residuals, evidence and decisions.

mod evidence;
pub(in crate::gap) mod localization;
mod spectrum;
mod state;
mod steps;
pub(in crate::gap) mod text;
mod trace;
pub(in crate::gap) mod view;

use self::text::{number, sentence, shown_unit, with_interval};
use super::{
    find::Found,
    findings::{
        Description, Document, IdentifiedEffect, NextExperiment, ParameterChange, SignalResidual,
        Verdict,
    },
    floor::FloorSource,
};
use crate::{
    provenance::Provenance,
    recording::Split,
    report::{Axis, Badge, Chart, Colour, Page, Series, Table, figure},
    twin::{Session, StageKind},
};

/// Fraction of the noise floor below which a residual is reported as smaller than the floor.
const BELOW_FLOOR: f64 = 0.9;

/// Page of `found`, identified from `sessions`.
#[must_use]
pub fn page(
    found: &Found<'_>,
    title: &str,
    provenance: &Provenance,
    sessions: &[Session],
) -> String {
    let document = &found.document;
    let mut page = Page::new(&format!("Gap report: {title}"));
    let (words, tone) = verdict_badge(document);
    page.badge(&words, tone);
    page.lead(&document.summary);
    page.paragraph(verdict_words(document.verdict));
    page.key_figures(&key_figures(document));
    notes(&mut page, document);
    effects(&mut page, document);
    residuals(&mut page, found);
    localization::section(&mut page, found, sessions);
    evidence::section(&mut page, found);
    changes(&mut page, &document.parameter_changes);
    evidence::journal(&mut page, &document.journal);
    evidence::rejected(&mut page, &document.rejected);
    let files = "Files in this folder: gap.json with the findings, twin.json with the final twin, gap.mcap with \
                 measured, simulated and residual signals.";
    provenance_section(&mut page, provenance, sessions, files);
    page.finish()
}

fn verdict_badge(document: &Document) -> (String, Badge) {
    let effects = text::count(document.effects.len(), "missing effect");
    match document.verdict {
        Verdict::Named => (format!("{effects} identified"), Badge::Good),
        Verdict::None => ("no missing effect".to_owned(), Badge::Good),
        Verdict::RefitOnly => ("parameters changed, no missing effect".to_owned(), Badge::Good),
        Verdict::Ambiguous => ("ambiguous".to_owned(), Badge::Warn),
        Verdict::Unexplained => ("unexplained residual".to_owned(), Badge::Warn),
        Verdict::NotTestable => ("not testable".to_owned(), Badge::Bad),
        Verdict::DifferentMachine => ("different machine".to_owned(), Badge::Bad),
        Verdict::InputNotConnected => ("input not connected".to_owned(), Badge::Bad),
    }
}

fn verdict_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Named => {
            "Verdict: named. Each effect passed all checks, also on data that was not fitted."
        }
        Verdict::None => "Verdict: none. All residuals are at the noise floor with the given twin.",
        Verdict::RefitOnly => {
            "Verdict: refit_only. The twin has all effects; values of known parameters changed."
        }
        Verdict::Ambiguous => "Verdict: ambiguous. Several effects explain the data equally well.",
        Verdict::Unexplained => {
            "Verdict: unexplained. The residual exceeds the noise floor, and no effect of the catalogue explains it."
        }
        Verdict::NotTestable => {
            "Verdict: not_testable. These recordings do not excite the effects enough for a test."
        }
        Verdict::DifferentMachine => {
            "Verdict: different_machine. The recordings do not belong to the machine of the twin."
        }
        Verdict::InputNotConnected => {
            "Verdict: input_not_connected. The motion does not depend on the recorded command."
        }
    }
}

/// Residual of a signal before and after, with the data behind both.
fn before_after(residual: &SignalResidual) -> Option<(f64, f64, &'static str)> {
    match (residual.validation_before, residual.validation_after) {
        (Some(before), Some(after)) => Some((before, after, "validation data")),
        _ => Some((residual.train_before?, residual.train_after?, "training data")),
    }
}

/// Residual of the signal with the largest localized fraction, in its unit and in multiples of the noise floor.
fn key_figures(document: &Document) -> Vec<(&'static str, String)> {
    let first = document.localization.first();
    let main = first.and_then(|place| {
        document.residuals.iter().find(|residual| residual.signal == place.signal)
    });
    let main = main.or_else(|| {
        let above = |residual: &&SignalResidual| {
            let before = before_after(residual).map_or(0.0, |(before, ..)| before);
            residual.noise_floor.map_or(0.0, |floor| before / floor)
        };
        document.residuals.iter().max_by(|a, b| above(a).total_cmp(&above(b)))
    });
    let mut figures = vec![
        ("effects added", document.effects.len().to_string()),
        ("parameters changed", document.parameter_changes.len().to_string()),
    ];
    let Some(residual) = main else { return figures };
    let Some((before, after, data)) = before_after(residual) else { return figures };
    let (factor, unit) = shown_unit(&residual.unit);
    figures.insert(0, ("signal with the largest residual", residual.signal.clone()));
    figures.insert(
        1,
        (
            if data == "validation data" {
                "residual RMS on validation data"
            } else {
                "residual RMS on training data"
            },
            format!("{} → {} {unit}", number(factor * before), number(factor * after)),
        ),
    );
    if let Some(floor) = residual.noise_floor.filter(|floor| 0.0 < *floor) {
        let times = |rms: f64| number(rms / floor);
        figures.insert(
            2,
            ("in multiples of the noise floor", format!("{} → {}", times(before), times(after))),
        );
    }
    figures
}

/// Indistinguishable effects, the next experiment, and warnings.
fn notes(page: &mut Page, document: &Document) {
    for set in &document.indistinguishable {
        page.paragraph(&format!(
            "These effects explain the data equally well: {}. Experiment that separates them: {}.",
            set.names.join(", "),
            set.experiment
        ));
    }
    if let Some(NextExperiment { command, motion, decides }) = &document.next_experiment {
        page.paragraph(&format!(
            "Next experiment: {} It decides {}.",
            sentence(motion),
            decides.trim_end_matches('.')
        ));
        command.iter().for_each(|command| page.code(command));
    }
    if let Some(description) = &document.description {
        described(page, description);
    }
    for warning in document.doubts() {
        page.warning(&sentence(warning));
    }
}

/// The sparse equation of an unexplained residual.
fn described(page: &mut Page, description: &Description) {
    page.section("Description of the unexplained residual");
    page.paragraph(&format!(
        "{}. F is the force along the coordinate that the simulation lacks. The equation describes the residual and \
         names no cause.",
        description.equation
    ));
    let rows = description.terms.iter().map(|term| {
        let [value, interval] = with_interval(term.coefficient, Some(term.ci95));
        vec![
            term.feature.clone(),
            term.location.to_string(),
            value,
            interval,
            unit(&term.unit),
            term.validation_gain.map_or("–".to_owned(), text::percent),
            term.indistinguishable.join(", "),
        ]
    });
    let head = [
        "feature",
        "axis",
        "coefficient",
        "95 % interval",
        "unit",
        "validation gain",
        "describe the data equally well",
    ];
    page.table_of_words(&Table::new(&head, rows.collect()));
    let rows = description.scales.iter().map(|own| {
        vec![
            own.symbol.clone(),
            own.quantity.clone(),
            number(own.origin),
            number(own.scale),
            unit(&own.unit),
        ]
    });
    page.table(&Table::new(&["symbol", "quantity", "origin", "scale", "unit"], rows.collect()));
}

fn effects(page: &mut Page, document: &Document) {
    if document.effects.is_empty() {
        return;
    }
    page.section("Missing effects");
    for (index, effect) in document.effects.iter().enumerate() {
        let location = effect.location.phrase();
        page.subsection(&format!("{}. {}{location}", index + 1, effect.name));
        page.paragraph(&effect.explanation);
        page.table_of_words(&parameters(effect));
    }
    let intervals = interval_chart(document);
    intervals.iter().for_each(|chart| page.chart(chart));
}

fn parameters(effect: &IdentifiedEffect) -> Table {
    let rows = effect.parameters.iter().map(|parameter| {
        let [value, interval] = with_interval(parameter.value, parameter.ci95);
        let remark = match (parameter.outside_plausible_range, parameter.ci95) {
            (true, _) => "outside the plausible range of the catalogue",
            (false, None) => "not identifiable from these data",
            _ => "",
        };
        vec![
            text::label(&parameter.name),
            value,
            interval,
            unit(&parameter.unit),
            remark.to_owned(),
        ]
    });
    Table::new(&["parameter", "value", "95 % interval", "unit", "remark"], rows.collect())
}

/// Parameters of all added effects with their intervals, each divided by its value.
fn interval_chart(document: &Document) -> Option<Chart> {
    let known: Vec<(String, f64, f64)> = document
        .effects
        .iter()
        .flat_map(|effect| effect.parameters.iter().map(move |one| (effect, one)))
        .filter_map(|(effect, one)| {
            let [low, high] = one.ci95?;
            let part = effect.name.rsplit('.').next().unwrap_or(&effect.name);
            let location = effect.location.phrase();
            let name = format!("{}\n{}{location}", text::label(&one.name), part.replace('_', " "));
            let ratios = [low / one.value, high / one.value];
            let ends = (ratios[0].min(ratios[1]), ratios[0].max(ratios[1]));
            (ends.0.is_finite() && ends.1.is_finite()).then_some((name, ends.0, ends.1))
        })
        .collect();
    if known.len() < 2 {
        return None;
    }
    let points = (0..known.len()).map(|k| (k as f64, 1.0)).collect();
    let ranges = known.iter().enumerate().map(|(k, one)| (k as f64, one.1, one.2)).collect();
    let names = known.into_iter().map(|one| one.0).collect();
    let chart = Chart::of_lines(
        "95 % intervals of the new parameters, relative to their estimates",
        Axis::of_categories("parameter", names),
        Axis::new("value / estimate", "").including(0.0),
    );
    let chart = chart.with(Series::level("zero", Colour::Grey, 0.0));
    Some(chart.with(Series::dots("estimate", Colour::Blue, points).with_whiskers(ranges)))
}

/// Unit as text; a ratio has none.
pub(in crate::gap) fn unit(unit: &str) -> String {
    if unit == "1" || unit.is_empty() { "–".to_owned() } else { unit.to_owned() }
}

pub(in crate::gap) fn residuals(page: &mut Page, found: &Found<'_>) {
    let residuals = &found.document.residuals;
    if residuals.is_empty() {
        return;
    }
    page.section("Residuals");
    page.paragraph(
        "RMS of measured minus simulated, with the given twin (before) and with the final twin (after). Validation \
         sessions were not fitted. The noise floor is the measurement noise, on a single axis with the model error of \
         the simulation. Where the given twin left a larger residual on its own recordings, that is the floor.",
    );
    for (outcome, floors) in found.outcomes.iter().zip(&found.floors) {
        let Some(chart) = steps::chart(outcome, floors) else { continue };
        page.subsection(stage_name(outcome.kind));
        page.chart(&chart);
    }
    page.table_of_words(&residual_table(residuals));
    for (source, reason) in [
        (FloorSource::Smoothness, "there: its estimate counts fast motion as noise"),
        (
            FloorSource::Propagated,
            "for this machine: it contains a general model error of a simulation",
        ),
    ] {
        let low: Vec<&str> = residuals
            .iter()
            .filter(|own| ends_below(own) && found.floor_source(&own.signal) == Some(source))
            .map(|own| own.signal.as_str())
            .collect();
        if !low.is_empty() {
            page.paragraph(&format!(
                "The final residual of {} is below the noise floor, which is too high {reason}.",
                low.join(", ")
            ));
        }
    }
}

/// Figure of the residuals after each step, one chart for each stage, as SVG; `None` where no signal has a noise floor.
///
/// # Errors
/// A sentence that says why it cannot be drawn.
pub fn residual_figure(found: &Found<'_>) -> Option<Result<String, String>> {
    let stages = found.outcomes.iter().zip(&found.floors);
    let charts: Vec<Chart> = stages
        .filter_map(|(outcome, floors)| {
            let chart = steps::chart(outcome, floors)?;
            Some(chart.titled(&format!("{} (residual after each step)", stage_name(outcome.kind))))
        })
        .collect();
    (!charts.is_empty()).then(|| figure(&charts))
}

/// Return whether a final residual is clearly smaller than its noise floor.
fn ends_below(residual: &SignalResidual) -> bool {
    let after = residual.validation_after.or(residual.train_after);
    after.zip(residual.noise_floor).is_some_and(|(after, floor)| after < BELOW_FLOOR * floor)
}

fn residual_table(residuals: &[SignalResidual]) -> Table {
    let rows = residuals.iter().map(|residual| {
        let (factor, unit) = shown_unit(&residual.unit);
        let cell = |value: Option<f64>| {
            value.map_or_else(|| "–".to_owned(), |value| number(factor * value))
        };
        vec![
            residual.signal.clone(),
            unit,
            cell(residual.noise_floor),
            cell(residual.validation_before),
            cell(residual.validation_after),
            cell(residual.train_before),
            cell(residual.train_after),
            format!("{}, band: {}", residual.noise_floor_source, residual.band),
        ]
    });
    let head = [
        "signal",
        "unit",
        "noise floor",
        "validation, before",
        "validation, after",
        "training, before",
        "training, after",
        "source of the noise floor",
    ];
    Table::new(&head, rows.collect())
}

pub(in crate::gap) fn stage_name(kind: StageKind) -> &'static str {
    match kind {
        StageKind::Drive => "Drive: command to motor motion",
        StageKind::Camera => "Camera: carriage to detected striker",
        StageKind::Ball => "Ball: short pieces of free rolls",
        StageKind::WholeRolls => "Ball: complete free rolls",
        StageKind::Axis => "Axis: command to motion of a single axis",
        StageKind::Estimator => "Estimator: position to reported velocity",
    }
}

fn changes(page: &mut Page, changes: &[ParameterChange]) {
    if changes.is_empty() {
        return;
    }
    page.section("Parameter changes");
    page.paragraph("Known parameters whose new value differs significantly from the given twin.");
    let rows = changes.iter().map(|change| {
        let [after, interval] = with_interval(change.after, change.ci95);
        vec![
            change.name.clone(),
            change.location.to_string(),
            number(change.before),
            after,
            interval,
            unit(&change.unit),
        ]
    });
    let head = ["parameter", "location", "before", "after", "95 % interval", "unit"];
    page.table(&Table::new(&head, rows.collect()));
}

/// Add the provenance; `files` lists the files in the same folder.
pub(in crate::gap) fn provenance_section(
    page: &mut Page,
    provenance: &Provenance,
    sessions: &[Session],
    files: &str,
) {
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({}). {files}",
        provenance.crate_version, provenance.git_hash
    ));
    let rows = sessions.iter().map(|session| {
        let time: f64 = session.runs.iter().map(|run| run.span.end - run.span.start).sum();
        let purpose = if session.split == Split::Validation { "validation" } else { "training" };
        vec![
            session.name.clone(),
            purpose.to_owned(),
            session.runs.len().to_string(),
            format!("{time:.0} s"),
            session.sha256.clone(),
        ]
    });
    let head = ["session", "used for", "runs", "length", "SHA-256"];
    page.table_of_words(&Table::new(&head, rows.collect()));
}

#[cfg(test)]
pub(in crate::gap) mod tests;
