//! Signal over time at its largest residual: measured, simulated before and after, and the residuals.

use super::{
    text::shown_unit,
    view::{PartView, View},
};
use crate::report::{Axis, Chart, Colour, Points, Ranges, Series};
use std::ops::Range;

/// Length of the drawn window (s).
const WINDOW: f64 = 3.0;

/// Length of the moving average that finds the largest residual (s).
const MOMENT: f64 = 0.5;

/// Shortest run that is preferred (s).
const LEAST_RUN: f64 = 0.5;

/// Charts of one signal with their session and time window.
pub(super) struct Trace {
    /// Index of the session among those of the view.
    pub(super) part: usize,
    /// Start and end of the window (s since the session began).
    pub(super) window: Range<f64>,
    /// Signal and residuals, with a shared cursor.
    pub(super) charts: Vec<Chart>,
}

/// Name of the group of these charts.
const GROUP: &str = "trace";

/// Window of a channel: session, channel and samples.
struct Place {
    part: usize,
    channel: usize,
    samples: Range<usize>,
}

/// Charts of `signal`; `None` without usable samples. `floor` is its noise floor.
pub(super) fn trace(view: &View<'_>, signal: &str, floor: Option<f64>) -> Option<Trace> {
    let place = worst(view, signal)?;
    let part = &view.parts[place.part];
    let channel = part.channel(place.channel);
    let at = |sample: usize| channel.times[sample];
    let window = at(place.samples.start)..at(place.samples.end - 1);
    let charts =
        vec![signal_chart(part, &place, signal, channel.unit), residual_chart(part, &place, floor)];
    Some(Trace { part: place.part, window, charts })
}

/// Run with the largest mean squared residual, and in it the window around the largest moving average.
fn worst(view: &View<'_>, signal: &str) -> Option<Place> {
    let mut best: Option<(bool, f64, Place)> = None;
    for (index, part) in view.parts.iter().enumerate() {
        let Some(channel) = part.stage.channels().iter().position(|own| own.signal == signal)
        else {
            continue;
        };
        let times = &part.channel(channel).times;
        for run in &part.channel(channel).runs {
            let Some(square) = part.mean_square(channel, run.clone()) else { continue };
            let long = LEAST_RUN <= times[run.end - 1] - times[run.start];
            let better = best
                .as_ref()
                .is_none_or(|(other_long, other, _)| (*other_long, *other) < (long, square));
            if better {
                best = Some((long, square, Place { part: index, channel, samples: run.clone() }));
            }
        }
    }
    let (.., mut place) = best?;
    let part = &view.parts[place.part];
    place.samples = around_worst(part, place.channel, place.samples);
    Some(place)
}

/// Samples of `run` in a window around the largest moving average of the squared residual.
fn around_worst(part: &PartView<'_>, channel: usize, run: Range<usize>) -> Range<usize> {
    let times = &part.channel(channel).times;
    let mut worst = (0.0, times[run.start]);
    let (mut sum, mut first) = (0.0, run.start);
    let square = |sample: usize| {
        let [before, _] = part.residual(channel, sample);
        if before.is_finite() { before * before } else { 0.0 }
    };
    for last in run.clone() {
        sum += square(last);
        while MOMENT < times[last] - times[first] {
            sum -= square(first);
            first += 1;
        }
        if worst.0 < sum {
            worst = (sum, 0.5 * (times[first] + times[last]));
        }
    }
    let end = times[run.end - 1].min((worst.1 + 0.5 * WINDOW).max(times[run.start] + WINDOW));
    let start = times[run.start].max(end - WINDOW);
    let index = |time: f64| run.start + times[run.clone()].partition_point(|at| *at < time);
    index(start)..(index(end) + 1).min(run.end)
}

fn points(place: &Place, times: &[f64], value: impl Fn(usize) -> f64) -> Points {
    place.samples.clone().map(|sample| (times[sample], value(sample))).collect()
}

fn signal_chart(part: &PartView<'_>, place: &Place, signal: &str, unit: &str) -> Chart {
    let channel = part.channel(place.channel);
    let points = |values: &[f64]| points(place, &channel.times, |sample| values[sample]);
    Chart::of_lines(
        &format!("{signal}: measured and simulated"),
        Axis::new("time in the session", "s"),
        Axis::new(signal, unit),
    )
    .in_group(&format!("{GROUP}-{signal}"))
    .with_height(320)
    .with(Series::line("measured", Colour::Ink, points(&channel.measured)))
    .with(Series::line("simulated before", Colour::Orange, points(&part.before[place.channel])))
    .with(Series::dashed("simulated after", Colour::Blue, points(&part.after[place.channel])))
}

fn residual_chart(part: &PartView<'_>, place: &Place, floor: Option<f64>) -> Chart {
    let channel = part.channel(place.channel);
    let (factor, unit) = shown_unit(channel.unit);
    let counts = |sample: &usize| part.usable[place.channel][*sample];
    let counted = place.samples.clone().find(counts).unwrap_or(place.samples.end);
    let residual = |column: usize| {
        points(place, &channel.times, |sample| {
            // The first samples of a run are not used, but they are no outliers either.
            let both = if sample < counted {
                part.difference(place.channel, sample)
            } else {
                part.residual(place.channel, sample)
            };
            factor * both[column]
        })
    };
    let band = |floor: f64| -> Ranges {
        let ends = [place.samples.start, place.samples.end - 1];
        ends.map(|sample| (channel.times[sample], -factor * floor, factor * floor)).into()
    };
    Chart::of_lines(
        "Residual: measured minus simulated",
        Axis::new("time in the session", "s"),
        Axis::new("residual", &unit),
    )
    .in_group(&format!("{GROUP}-{}", channel.signal))
    .with_height(260)
    .with_all(floor.map(|floor| Series::band("noise floor", Colour::Grey, band(floor))))
    .with(Series::line("before", Colour::Orange, residual(0)))
    .with(Series::line("after", Colour::Blue, residual(1)))
}
