//! `index.html` of a gap: what is missing, how sure that is, and where it shows.

mod spectrum;
mod state;
mod steps;
mod text;
mod trace;
pub(in crate::gap) mod view;

use self::{
    text::{count, digits, number, percent, probability, sentence, shown_unit, with_interval},
    view::View,
};
use super::{
    find::Found,
    findings::{
        Document, IdentifiedEffect, NextExperiment, ParameterChange, RejectedEffect,
        SignalResidual, Verdict,
    },
    floor::{Floor, FloorSource},
    numbers::ParameterEstimate,
    rounds::{Added, Outcome},
};
use crate::{
    effects::{self, Effect},
    provenance::Provenance,
    recording::Split,
    report::{Axis, Curve, LinePlot, Page, Scale, Stroke, Table, line_plot},
    twin::{Session, StageKind},
};

const INK: [u8; 3] = [29, 39, 51];
const GREY: [u8; 3] = [120, 128, 138];
const BLUE: [u8; 3] = [31, 105, 180];
const ORANGE: [u8; 3] = [222, 126, 34];
/// Colours of signals.
const PALETTE: [[u8; 3]; 6] =
    [BLUE, [208, 88, 24], [52, 140, 86], [146, 78, 168], [190, 60, 60], [110, 96, 60]];

/// Most candidates that are shown without a click.
const SHOWN_CANDIDATES: usize = 8;

/// Share of the floor below which a gap is clearly smaller than it.
const BELOW_FLOOR: f64 = 0.9;

/// Times the loss of the named candidate from which another's is told as a multiple.
const FAR_WORSE: f64 = 2.0;

/// The page of `found`, which was found in `sessions`.
#[must_use]
pub fn page(
    found: &Found<'_>,
    title: &str,
    provenance: &Provenance,
    sessions: &[Session],
) -> String {
    let document = &found.document;
    let mut page = Page::new(title);
    verdict(&mut page, document);
    effects(&mut page, document);
    gaps(&mut page, found);
    places(&mut page, found, sessions);
    evidence(&mut page, found);
    refits(&mut page, &document.parameter_changes);
    making(&mut page, provenance, sessions);
    page.finish()
}

fn verdict(page: &mut Page, document: &Document) {
    page.lead(&document.summary);
    page.paragraph(&format!("Verdict: {}.", verdict_words(document.verdict)));
    if let Some(text) = closed(document) {
        page.paragraph(&text);
    }
    for class in &document.indistinguishable {
        page.paragraph(&format!(
            "These names explain the data equally well: {}. What would decide: {}.",
            class.names.join(", "),
            class.experiment
        ));
    }
    if let Some(next) = &document.next_experiment {
        let NextExperiment { command, motion, decides } = next;
        page.paragraph(&format!("Next experiment: {motion}. It decides {decides}."));
        command.iter().for_each(|command| page.code(command));
    }
    for warning in document.warnings.iter().filter(|warning| **warning != document.summary) {
        page.warning(&sentence(warning));
    }
}

fn verdict_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Named => {
            "named – every effect passed all checks, also on data that was not fitted"
        }
        Verdict::None => "none – nothing is missing above the noise",
        Verdict::RefitOnly => "refit only – the structure is complete, values have moved",
        Verdict::Ambiguous => "ambiguous – several names explain the data equally well",
        Verdict::Unexplained => {
            "unexplained – something is missing that the catalogue does not have"
        }
        Verdict::NotTestable => "not testable – these recordings cannot show it",
        Verdict::DifferentMachine => "different machine – the twin describes another one",
        Verdict::InputNotConnected => "input not connected – command and motion are unrelated",
    }
}

/// By how much the gap of the signal with the largest share fell.
fn closed(document: &Document) -> Option<String> {
    let signal = &document.localization.first()?.signal;
    let gap = document.residuals.iter().find(|gap| gap.signal == *signal)?;
    let (before, after, data) = match (gap.validation_before, gap.validation_after) {
        (Some(before), Some(after)) => (before, after, "data that was not fitted"),
        _ => (gap.train_before?, gap.train_after?, "the fitted data"),
    };
    let (factor, unit) = shown_unit(&gap.unit);
    let floor = gap.noise_floor.map_or_else(String::new, |floor| {
        format!("; its noise floor is {} {unit}", number(factor * floor))
    });
    Some(format!(
        "The gap of {signal} goes from {} to {} {unit} RMS on {data}{floor}.",
        number(factor * before),
        number(factor * after)
    ))
}

fn effects(page: &mut Page, document: &Document) {
    if document.effects.is_empty() {
        return;
    }
    page.section("What is missing");
    for (index, effect) in document.effects.iter().enumerate() {
        page.subsection(&format!("{}. {} on {}", index + 1, effect.name, effect.location));
        page.paragraph(&effect.explanation);
        let is_noise = effects::find(&effect.name).is_some_and(Effect::is_noise);
        if let Some(gain) = effect.validation_gain {
            let share = percent(gain);
            page.paragraph(&match is_noise {
                true => format!("It accounts for {share} of that on the validation sessions."),
                false => format!(
                    "It removes {share} of the squared whitened residual on the validation sessions."
                ),
            });
        }
        let evidence = &effect.evidence;
        page.paragraph(&format!(
            "p = {} on the {}, Bonferroni-corrected for {} comparisons.",
            probability(evidence.p_value),
            evidence.data,
            evidence.comparisons
        ));
        page.table_of_words(&parameters(effect));
    }
}

fn parameters(effect: &IdentifiedEffect) -> Table {
    let rows = effect.parameters.iter().map(|parameter| {
        let [value, interval] = with_interval(parameter.value, parameter.ci95);
        let remark = match (parameter.outside_plausible_range, parameter.ci95) {
            (true, _) => "outside the catalogue's plausible range, which is an estimate",
            (false, None) => "not determined by these data",
            _ => "",
        };
        vec![parameter.name.clone(), value, interval, unit(&parameter.unit), remark.to_owned()]
    });
    let head = ["parameter", "value", "95 % interval", "unit", "remark"].map(str::to_owned);
    Table { head: head.to_vec(), rows: rows.collect() }
}

/// A unit as it is written; a ratio has none.
fn unit(unit: &str) -> String {
    if unit == "1" || unit.is_empty() { "–".to_owned() } else { unit.to_owned() }
}

fn gaps(page: &mut Page, found: &Found<'_>) {
    if found.document.residuals.is_empty() {
        return;
    }
    page.section("The gap, signal by signal");
    page.paragraph(
        "RMS of what was measured less what was simulated: with the given twin (before) and with \
         the final one (after), on sessions that judge (held out) and on those that were fitted \
         (train). The floor is the scatter of the measurement itself, from measurements alone.",
    );
    page.table_of_words(&gap_table(&found.document.residuals));
    let low: Vec<&str> =
        found.document.residuals.iter().filter(ends_below).map(signal_of).collect();
    if !low.is_empty() {
        page.paragraph(&format!(
            "Of {} the gap ends below the floor: there the floor is too high, since it takes quick \
             changes of the motion for noise.",
            low.join(", ")
        ));
    }
    for (outcome, floors) in found.outcomes.iter().zip(&found.floors) {
        let Some((picture, legend)) = steps::picture(outcome, floors) else { continue };
        page.subsection(link_name(outcome.kind));
        page.paragraph(
            "How the gap of each signal falls as the twin is refitted and each effect is added; \
             the dashed line is the noise floor.",
        );
        let legend: Vec<(&str, [u8; 3])> =
            legend.iter().map(|(name, colour)| (name.as_str(), *colour)).collect();
        page.legend(&legend);
        page.picture(&picture);
    }
}

fn signal_of(gap: &SignalResidual) -> &str {
    &gap.signal
}

/// Whether what is left of a gap is clearly smaller than its floor.
fn ends_below(gap: &&SignalResidual) -> bool {
    let after = gap.validation_after.or(gap.train_after);
    after.zip(gap.noise_floor).is_some_and(|(after, floor)| after < BELOW_FLOOR * floor)
}

fn gap_table(gaps: &[SignalResidual]) -> Table {
    let rows = gaps.iter().map(|gap| {
        let (factor, unit) = shown_unit(&gap.unit);
        let cell = |value: Option<f64>| {
            value.map_or_else(|| "–".to_owned(), |value| number(factor * value))
        };
        vec![
            gap.signal.clone(),
            unit,
            cell(gap.noise_floor),
            cell(gap.validation_before),
            cell(gap.validation_after),
            cell(gap.train_before),
            cell(gap.train_after),
            format!("{}, band: {}", gap.noise_floor_source, gap.band),
        ]
    });
    let head = [
        "signal",
        "unit",
        "floor",
        "held out, before",
        "after",
        "train, before",
        "after",
        "how the floor was measured",
    ];
    Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
}

fn link_name(kind: StageKind) -> &'static str {
    match kind {
        StageKind::Drive => "Drive: commands to motor motion",
        StageKind::Camera => "Camera: carriage to the striker that the camera sees",
        StageKind::Ball => "Ball: pieces of free rolls as the camera sees them",
        StageKind::WholeRolls => "Ball: free rolls from end to end",
        StageKind::Axis => "Axis: command and motion of a single axis",
        StageKind::Estimator => "Estimator: positions to reported velocities",
    }
}

fn places(page: &mut Page, found: &Found<'_>, sessions: &[Session]) {
    if found.outcomes.is_empty() {
        return;
    }
    page.section("Where it sits");
    if !found.document.localization.is_empty() {
        page.table_of_words(&place_table(&found.document));
    }
    for (outcome, floors) in found.outcomes.iter().zip(&found.floors) {
        link(page, found, outcome, floors, sessions);
        if let Some(unknown) = &outcome.unexplained {
            page.warning(&format!(
                "What is left here still depends on {}, and no effect of the catalogue explains it.",
                unknown.name
            ));
        }
    }
}

fn place_table(document: &Document) -> Table {
    let rows = document.localization.iter().map(|place| {
        vec![
            place.signal.clone(),
            place.stage.to_string(),
            place.location.clone(),
            percent(place.fraction),
            place.condition.clone(),
        ]
    });
    let head = ["signal", "domain", "axis", "share of its link's gap", "when"];
    Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// The pictures of one link: its signal with the largest share of the gap.
fn link(
    page: &mut Page,
    found: &Found<'_>,
    outcome: &Outcome<'_>,
    floors: &[Floor],
    sessions: &[Session],
) {
    let Some((signal, floor)) = main_signal(&found.document, outcome, floors) else { return };
    let view = View::of(outcome);
    page.subsection(link_name(outcome.kind));
    if let Some(trace) = trace::trace(&view, &signal, floor) {
        let name = session_name(sessions, &view, trace.part);
        page.paragraph(&format!(
            "{signal} where the gap is largest: {}, {:.1} to {:.1} s, {}. Below it what is left, \
             with the noise floor as a grey band.",
            name,
            trace.window.start,
            trace.window.end,
            if view.held_out { "held out" } else { "fitted" },
        ));
        page.legend(&[
            ("measured", INK),
            ("simulated before, and its residual", ORANGE),
            ("simulated after (dashed), and its residual", BLUE),
        ]);
        trace.pictures.iter().for_each(|picture| page.picture(picture));
    }
    for maps in state::maps(&view, &signal) {
        page.paragraph(&format!(
            "The residual over {}, before and after: each cell is the RMS of the samples in that \
             state; {}.",
            maps.over, maps.scale
        ));
        page.pictures_in_row(&maps.pictures);
    }
    spectra(page, &view, &signal, floor);
}

/// The signal with the largest share of a link's gap, and its floor.
fn main_signal(
    document: &Document,
    outcome: &Outcome<'_>,
    floors: &[Floor],
) -> Option<(String, Option<f64>)> {
    let channels = outcome.train.parts.first()?.stage.channels();
    let at = |signal: &str| channels.iter().position(|channel| channel.signal == signal);
    let placed = document.localization.iter().find_map(|place| at(&place.signal));
    let known = |floor: &&Floor| floor.source != FloorSource::Unknown && 0.0 < floor.rms;
    let before = outcome.train.rms(&outcome.start);
    let above = |index: usize| {
        let floor = floors.get(index).filter(known).map_or(f64::INFINITY, |floor| floor.rms);
        before.get(index).map_or(0.0, |rms| rms / floor)
    };
    let index =
        placed.or_else(|| (0..channels.len()).max_by(|a, b| above(*a).total_cmp(&above(*b))))?;
    let floor = floors.get(index).filter(known).map(|floor| floor.rms);
    Some((channels[index].signal.clone(), floor))
}

/// Name of the session behind part `part` of `view`.
fn session_name(sessions: &[Session], view: &View<'_>, part: usize) -> String {
    let split = if view.held_out { Split::Validation } else { Split::Train };
    let has = |session: &&Session| {
        session.split == split && session.stages().iter().any(|stage| stage.kind() == view.kind)
    };
    sessions.iter().filter(has).nth(part).map_or_else(
        || format!("session {}", part + 1),
        |session| format!("session {}", session.name),
    )
}

fn spectra(page: &mut Page, view: &View<'_>, signal: &str, floor: Option<f64>) {
    let mut both = [Vec::new(), Vec::new()];
    let mut unit_and_rate = None;
    for (part, channel) in view.channels_of(signal) {
        let own = part.channel(channel);
        unit_and_rate.get_or_insert((own.unit, own.rate_hz));
        for (all, own) in both.iter_mut().zip(part.stretches(channel)) {
            all.extend(own);
        }
    }
    let Some((unit, rate_hz)) = unit_and_rate else { return };
    let lengths: Vec<usize> = both[0].iter().map(Vec::len).collect();
    let Some(length) = spectrum::segment_length(&lengths) else { return };
    let (factor, unit) = shown_unit(unit);
    let mut curves = Vec::new();
    let mut segments = 0;
    for (stretches, colour) in both.iter().zip([ORANGE, BLUE]) {
        let Some(found) = spectrum::spectrum(stretches, rate_hz, length) else { continue };
        segments = found.segments;
        // The first bin is the mean, and the last holds half the frequencies of the others.
        let inner = 1..found.density.len().saturating_sub(1).max(1);
        let points = inner.map(|k| (k as f64 * found.bin_hz, factor * found.density[k].sqrt()));
        curves.push(Curve { colour, stroke: Stroke::Solid, points: points.collect() });
    }
    if let Some(floor) = floor {
        let level = factor * spectrum::white(floor, rate_hz).sqrt();
        let points = vec![(0.0, level), (0.5 * rate_hz, level)];
        curves.push(Curve { colour: GREY, stroke: Stroke::Dashed, points });
    }
    page.paragraph(&format!(
        "The residual by frequency, before and after (Welch's periodogram: {} of {length} samples \
         at {rate_hz:.0} Hz, Hann window): a peak is a resonance or a ripple, a rise to the left \
         slow physics; the dashed line is the noise floor, if it is white.",
        count(segments, "segment"),
    ));
    page.picture(&line_plot(&LinePlot {
        title: format!("Spectrum of the residual of {signal}"),
        x: "frequency (Hz)".to_owned(),
        y: Axis { label: format!("density ({unit}/√Hz)"), scale: Scale::Logarithmic },
        bands: Vec::new(),
        curves,
        size: (980, 300),
    }));
}

fn evidence(page: &mut Page, found: &Found<'_>) {
    let contested = found.outcomes.iter().any(|outcome| !outcome.added.is_empty());
    if !contested && found.document.rejected.is_empty() {
        return;
    }
    page.section("The evidence, and the runners-up");
    if contested {
        page.paragraph(
            "In each step the strongest candidates are simulated and fitted together with all \
             known parameters. Loss: the squared error of one sample on the fitted sessions, in \
             units of what a sample cannot be predicted by (whitened); the smaller the better.",
        );
    }
    for outcome in &found.outcomes {
        for step in &outcome.added {
            page.subsection(&format!("{} on {}", step.effect.name, step.axis));
            page.paragraph(&format!(
                "Its block statistic in the screen: F = {}, p = {} corrected for all tries.",
                number(step.statistic),
                probability(step.p_value),
            ));
            page.table_of_words(&contest(step));
        }
        moved_numbers(page, outcome);
    }
    rejected(page, &found.document.rejected);
}

fn contest(step: &Added) -> Table {
    let named = step.loss().filter(|named| 0.0 < *named);
    let rows = step.contest.iter().map(|one| {
        let worse = named.map_or_else(String::new, |named| match one.loss / named {
            ratio if ratio < FAR_WORSE => format!("{:+.2} %", 100.0 * (ratio - 1.0)),
            ratio => format!("{} times", number(ratio)),
        });
        let what = if step.is(one) {
            "named"
        } else if step.class.contains(&one.effect.name) {
            "cannot be told from it"
        } else if step.is_outshone_by(one) {
            "shows more clearly, but closes far less of the gap: its turn comes later"
        } else {
            ""
        };
        let loss = digits(one.loss, 5);
        vec![one.effect.name.to_owned(), one.axis.to_string(), loss, worse, what.to_owned()]
    });
    let head = ["candidate", "axis", "loss per sample", "against the named", ""];
    Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// How the fitted numbers of one link moved as effects were added.
fn moved_numbers(page: &mut Page, outcome: &Outcome<'_>) {
    let steps: Vec<&Added> = outcome.added.iter().filter(|step| !step.numbers.is_empty()).collect();
    if steps.is_empty() {
        return;
    }
    let mut stages = vec![("refitted".to_owned(), outcome.refitted_numbers.clone())];
    // The last word of a name is enough here, and keeps the table within the page.
    let short = |name: &str| format!("+ {}", name.rsplit('.').next().unwrap_or(name));
    stages.extend(steps.iter().map(|step| (short(step.effect.name), step.numbers.clone())));
    // An effect that was parted is one column.
    stages.dedup_by(|later, earlier| later.1 == earlier.1);
    let mut rows: Vec<&ParameterEstimate> = Vec::new();
    for number in stages.iter().flat_map(|(_, numbers)| numbers) {
        if !rows.iter().any(|row| row.name == number.name && row.location == number.location) {
            rows.push(number);
        }
    }
    let rows = rows.into_iter().map(|row| {
        let at = |numbers: &[ParameterEstimate]| {
            let own =
                numbers.iter().find(|own| own.name == row.name && own.location == row.location);
            own.map_or_else(|| "–".to_owned(), |own| number(own.value))
        };
        let mut cells = vec![row.name.clone(), row.location.to_string(), unit(&row.unit)];
        cells.extend(stages.iter().map(|(_, numbers)| at(numbers)));
        cells
    });
    let mut head = ["parameter", "axis", "unit"].map(str::to_owned).to_vec();
    head.extend(stages.iter().map(|(name, _)| name.clone()));
    page.subsection(&format!("How its numbers moved – {}", link_name(outcome.kind)));
    page.paragraph(
        "Everything is fitted again with each effect that is added, here by plain least squares (every \
         signal in units of its RMS), as published tables are. A number that moves made up for \
         what was missing before; one that moves far and is a constant of nature says that something \
         was.",
    );
    page.table(&Table { head, rows: rows.collect() });
}

fn rejected(page: &mut Page, rejected: &[RejectedEffect]) {
    if rejected.is_empty() {
        return;
    }
    page.subsection("Tried and not named");
    page.paragraph(
        "Every other effect of the catalogue on every axis, with the reason. F and p (not corrected \
         for the number of tries) are those of the screen; the held-out gain is the share of the \
         squared error that it removes on held-out data, where it was simulated again.",
    );
    let table = |rows: &[RejectedEffect]| Table {
        head: ["candidate", "axis", "F", "p", "held-out gain", "why not"]
            .map(str::to_owned)
            .to_vec(),
        rows: rows.iter().map(rejected_row).collect(),
    };
    if rejected.len() <= SHOWN_CANDIDATES {
        page.table_of_words(&table(rejected));
        return;
    }
    let (simulated, screened): (Vec<RejectedEffect>, Vec<RejectedEffect>) =
        rejected.iter().cloned().partition(|candidate| candidate.validation_gain.is_some());
    if !simulated.is_empty() {
        page.table_of_words(&table(&simulated));
    }
    if !screened.is_empty() {
        let summary = format!("{} that the screen rejected", count(screened.len(), "candidate"));
        page.folded_table_of_words(&summary, &table(&screened));
    }
}

fn rejected_row(candidate: &RejectedEffect) -> Vec<String> {
    vec![
        candidate.name.clone(),
        candidate.location.to_string(),
        candidate.statistic.map_or_else(|| "–".to_owned(), number),
        candidate.p_value.map_or_else(|| "–".to_owned(), probability),
        candidate.validation_gain.map_or_else(|| "–".to_owned(), percent),
        candidate.reason.clone(),
    ]
}

fn refits(page: &mut Page, refits: &[ParameterChange]) {
    if refits.is_empty() {
        return;
    }
    page.section("Known parameters that moved");
    page.paragraph("The fit left the value of the given twin, beyond the interval of both.");
    let rows = refits.iter().map(|refit| {
        let [after, interval] = with_interval(refit.after, refit.ci95);
        vec![
            refit.name.clone(),
            refit.location.to_string(),
            number(refit.before),
            after,
            interval,
            unit(&refit.unit),
        ]
    });
    let head = ["parameter", "axis", "before", "after", "95 % interval", "unit"];
    page.table(&Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() });
}

fn making(page: &mut Page, provenance: &Provenance, sessions: &[Session]) {
    page.section("How it was made");
    page.code(&provenance.command_line);
    page.paragraph(&format!(
        "klasktron {} ({}). Measured, simulated and residual signals lie in gap.mcap beside this \
         page, the findings in gap.json, the twin in twin.json.",
        provenance.crate_version, provenance.git_hash
    ));
    let rows = sessions.iter().map(|session| {
        let time: f64 = session.runs.iter().map(|run| run.span.end - run.span.start).sum();
        let purpose = if session.split == Split::Validation { "held out" } else { "fitted" };
        vec![
            session.name.clone(),
            purpose.to_owned(),
            session.runs.len().to_string(),
            format!("{time:.0} s"),
            session.sha256.clone(),
        ]
    });
    let head = ["session", "used as", "runs", "length", "SHA-256"].map(str::to_owned);
    page.table_of_words(&Table { head: head.to_vec(), rows: rows.collect() });
}

#[cfg(test)]
pub(in crate::gap) mod tests;
