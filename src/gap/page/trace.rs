//! A signal over time, where the gap is largest: measured, before, after, and what is left.

use super::{
    BLUE, GREY, INK, ORANGE,
    text::shown_unit,
    view::{PartView, View},
};
use crate::report::{Axis, Band, Curve, LinePlot, Scale, Stroke, line_plot};
use std::ops::Range;

/// Length of the window that is drawn (s).
const WINDOW: f64 = 3.0;

/// Length over which the worst moment is looked for (s).
const MOMENT: f64 = 0.5;

/// Shortest run that is drawn while there are longer ones (s).
const LEAST_RUN: f64 = 0.5;

/// The pictures of one signal with what they show.
pub(super) struct Trace {
    /// Index of the session among those of the view.
    pub(super) part: usize,
    /// Start and end of the window (s since the session began).
    pub(super) window: Range<f64>,
    /// The signal, below it the residuals, and the residual after alone where the one before hides
    /// it.
    pub(super) pictures: Vec<String>,
}

/// How many times larger the residual before must be to hide the one after.
const HIDDEN: f64 = 5.0;

/// Where a window lies: session, its channel, and its samples.
struct Place {
    part: usize,
    channel: usize,
    samples: Range<usize>,
}

/// The pictures of `signal`; `None` where nothing of it counts. `floor` is its noise floor.
pub(super) fn trace(view: &View<'_>, signal: &str, floor: Option<f64>) -> Option<Trace> {
    let place = worst(view, signal)?;
    let part = &view.parts[place.part];
    let channel = part.channel(place.channel);
    let at = |sample: usize| channel.times[sample];
    let window = at(place.samples.start)..at(place.samples.end - 1);
    let mut pictures = vec![
        signal_picture(part, &place, signal, channel.unit),
        residual_picture(part, &place, floor, &[(ORANGE, 0), (BLUE, 1)]),
    ];
    let [before, after] = [0, 1].map(|column| largest(part, &place, column));
    if HIDDEN * after < before {
        pictures.push(residual_picture(part, &place, floor, &[(BLUE, 1)]));
    }
    Some(Trace { part: place.part, window, pictures })
}

/// The run with the largest mean squared gap, and in it the window about the worst moment.
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

/// The samples of `run` in a window about the moment with the largest squared gap.
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

fn points(place: &Place, times: &[f64], value: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
    place.samples.clone().map(|sample| (times[sample], value(sample))).collect()
}

fn signal_picture(part: &PartView<'_>, place: &Place, signal: &str, unit: &str) -> String {
    let channel = part.channel(place.channel);
    let curve = |colour, stroke, values: &[f64]| Curve {
        colour,
        stroke,
        points: points(place, &channel.times, |sample| values[sample]),
    };
    line_plot(&LinePlot {
        title: signal.to_owned(),
        x: "time in the session (s)".to_owned(),
        y: Axis { label: format!("{signal} ({unit})"), scale: Scale::Linear },
        bands: Vec::new(),
        curves: vec![
            curve(INK, Stroke::Solid, &channel.measured),
            curve(ORANGE, Stroke::Solid, &part.before[place.channel]),
            curve(BLUE, Stroke::Dashed, &part.after[place.channel]),
        ],
        size: (980, 320),
    })
}

/// Largest residual of one column in the window.
fn largest(part: &PartView<'_>, place: &Place, column: usize) -> f64 {
    let values = place.samples.clone().map(|sample| part.residual(place.channel, sample)[column]);
    values.map(f64::abs).fold(0.0, f64::max)
}

/// The residuals of `columns`, each in its colour.
fn residual_picture(
    part: &PartView<'_>,
    place: &Place,
    floor: Option<f64>,
    columns: &[([u8; 3], usize)],
) -> String {
    let channel = part.channel(place.channel);
    let (factor, unit) = shown_unit(channel.unit);
    let counts = |sample: &usize| part.usable[place.channel][*sample];
    let counted = place.samples.clone().find(counts).unwrap_or(place.samples.end);
    let curve = |(colour, column): ([u8; 3], usize)| Curve {
        colour,
        stroke: Stroke::Solid,
        points: points(place, &channel.times, |sample| {
            // The first samples of a run do not count, but they are no outliers either.
            let both = if sample < counted {
                part.difference(place.channel, sample)
            } else {
                part.residual(place.channel, sample)
            };
            factor * both[column]
        }),
    };
    let band = |floor: f64| {
        let points = [place.samples.start, place.samples.end - 1]
            .map(|sample| (channel.times[sample], -factor * floor, factor * floor));
        Band { colour: GREY, points: points.to_vec() }
    };
    line_plot(&LinePlot {
        title: match columns {
            [_] => "measured less simulated after, enlarged".to_owned(),
            _ => "measured less simulated".to_owned(),
        },
        x: "time in the session (s)".to_owned(),
        y: Axis { label: format!("residual ({unit})"), scale: Scale::Linear },
        bands: floor.map(band).into_iter().collect(),
        curves: columns.iter().copied().map(curve).collect(),
        size: (980, 240),
    })
}
