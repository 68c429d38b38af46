//! Localization of the residual: over time, over the state of the machine, and over frequency.

use super::{
    spectrum, stage_name, state,
    text::{self, count, percent, shown_unit},
    trace,
    view::View,
};
use crate::{
    gap::{
        find::Found,
        findings::Document,
        floor::{Floor, FloorSource},
        rounds::Outcome,
    },
    recording::Split,
    report::{Axis, Chart, Colour, Page, Series, Table},
    twin::Session,
};

/// Add the section.
pub(in crate::gap) fn section(page: &mut Page, found: &Found<'_>, sessions: &[Session]) {
    if found.outcomes.is_empty() {
        return;
    }
    page.section("Localization");
    if !found.document.localization.is_empty() {
        page.table_of_words(&table(&found.document));
    }
    for (outcome, floors) in found.outcomes.iter().zip(&found.floors) {
        stage(page, found, outcome, floors, sessions);
        if let Some(unknown) = &outcome.unexplained {
            page.warning(&format!(
                "The final residual still {}. No effect of the catalogue explains it.",
                text::dependence(&unknown.name)
            ));
        }
    }
}

fn table(document: &Document) -> Table {
    let rows = document.localization.iter().map(|place| {
        vec![
            place.signal.clone(),
            place.stage.to_string(),
            place.location.clone(),
            percent(place.fraction),
            place.condition.clone(),
        ]
    });
    let head = ["signal", "stage", "location", "fraction of the squared residual", "condition"];
    Table::new(&head, rows.collect())
}

/// Charts of one stage: its signal with the largest localized fraction.
fn stage(
    page: &mut Page,
    found: &Found<'_>,
    outcome: &Outcome<'_>,
    floors: &[Floor],
    sessions: &[Session],
) {
    let Some((signal, floor)) = main_signal(&found.document, outcome, floors) else { return };
    let view = View::of(outcome);
    page.subsection(stage_name(outcome.kind));
    if let Some(trace) = trace::trace(&view, &signal, floor) {
        page.paragraph(&format!(
            "{signal} at its largest residual: {}, {:.1} to {:.1} s, {} data.",
            session_name(sessions, &view, trace.part),
            trace.window.start,
            trace.window.end,
            if view.held_out { "validation" } else { "training" },
        ));
        trace.charts.iter().for_each(|chart| page.chart(chart));
    }
    for maps in state::maps(&view, &signal) {
        page.paragraph(&format!(
            "Residual over {}: RMS of the samples in each cell, before and after.",
            maps.over
        ));
        page.charts(&maps.charts);
    }
    spectra(page, &view, &signal, floor);
}

/// Signal with the largest localized fraction of a stage, and its noise floor.
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
    let mut chart = Chart::of_lines(
        &format!("Amplitude spectral density of the residual of {signal}"),
        Axis::new("frequency", "Hz"),
        Axis::new("density", &format!("{unit}/√Hz")).logarithmic(),
    );
    let mut segments = 0;
    let names = [("before", Colour::Orange), ("after", Colour::Blue)];
    for (stretches, (name, colour)) in both.iter().zip(names) {
        let Some(found) = spectrum::spectrum(stretches, rate_hz, length) else { continue };
        segments = found.segments;
        // The first bin is the mean, and the last holds half the frequencies of the others.
        let inner = 1..found.density.len().saturating_sub(1).max(1);
        let points = inner.map(|k| (k as f64 * found.bin_hz, factor * found.density[k].sqrt()));
        chart = chart.with(Series::line(name, colour, points.collect()));
    }
    if let Some(floor) = floor {
        let level = factor * spectrum::white(floor, rate_hz).sqrt();
        chart = chart.with(Series::level("noise floor, if white", Colour::Grey, level));
    }
    page.paragraph(&format!(
        "Spectrum of the residual, before and after (Welch's periodogram: {} of {length} samples at {rate_hz:.0} Hz, \
         Hann window). A peak indicates a resonance or a periodic disturbance; a rise towards low frequencies \
         indicates slow dynamics.",
        count(segments, "segment"),
    ));
    page.chart(&chart);
}
