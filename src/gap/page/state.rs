//! Residual over the state of the machine: motion, or position on the board.

use super::{
    text::shown_unit,
    view::{PartView, View},
};
use crate::{
    report::{Axis, Chart, Grid},
    stats::quantile,
    twin::Channel,
};
use std::ops::Range;

/// Columns and rows of a map.
const CELLS: (usize, usize) = (20, 16);

/// Fewest samples for which a cell is drawn.
const LEAST_SAMPLES: usize = 4;

/// Fraction of the samples at each end of an axis that are excluded from the map, so that a few outliers do not set its
/// scale.
const BEYOND: f64 = 0.005;

/// Fraction of the cells whose RMS is within the colours; the others have the darkest.
const WITHIN_SHADES: f64 = 0.98;

/// Half of the time over which a slope is taken (s): of a velocity, and of a position.
const SLOPE_TIME: (f64, f64) = (0.015, 0.03);

/// The state of one sample, and its squared residuals before and after.
struct Sample {
    state: [f64; 2],
    squares: [f64; 2],
}

/// Maps of one signal over one pair of coordinates.
pub(super) struct Maps {
    /// Coordinates, in words.
    pub(super) over: &'static str,
    /// Before and after, with one colour scale.
    pub(super) charts: [Chart; 2],
}

/// Coordinates of a map: quantities with units, and the state at each sample of a channel.
struct Coordinates {
    over: &'static str,
    labels: Labels,
    states: Vec<[f64; 2]>,
}

/// Maps of `signal` over the states that are relevant for it.
pub(super) fn maps(view: &View<'_>, signal: &str) -> Vec<Maps> {
    [board, motion].into_iter().filter_map(|kind| map(view, signal, kind)).collect()
}

/// Quantity and unit of both axes.
type Labels = [(String, String); 2];

type Kind = fn(&PartView<'_>, usize) -> Option<Coordinates>;

fn map(view: &View<'_>, signal: &str, kind: Kind) -> Option<Maps> {
    let mut samples: Vec<Sample> = Vec::new();
    let mut named: Option<(&'static str, Labels, &'static str)> = None;
    for (part, channel) in view.channels_of(signal) {
        let Some(coordinates) = kind(part, channel) else { continue };
        for sample in part.channel(channel).runs.iter().flat_map(Clone::clone) {
            let state = coordinates.states[sample];
            let squares = part.residual(channel, sample).map(|residual| residual * residual);
            if state.iter().chain(&squares).all(|value| value.is_finite()) {
                samples.push(Sample { state, squares });
            }
        }
        let unit = part.channel(channel).unit;
        named.get_or_insert((coordinates.over, coordinates.labels, unit));
    }
    let (over, labels, unit) = named?;
    if samples.len() < LEAST_SAMPLES {
        return None;
    }
    let ranges = [0, 1].map(|axis| middle_range(&samples, axis));
    let (factor, unit) = shown_unit(unit);
    let grids = [0, 1].map(|column| grid(&samples, ranges, column, factor));
    let mut cells: Vec<f64> =
        grids[0].iter().flatten().copied().filter(|value| value.is_finite()).collect();
    cells.sort_by(f64::total_cmp);
    let darkest = rounded_up(quantile(&cells, WITHIN_SHADES).filter(|value| 0.0 < *value)?);
    let chart = |column: usize, when: &str| {
        let [x, y] = &labels;
        let label = format!("residual RMS ({unit})");
        let grid = Grid::of_numbers(grids[column].clone(), ranges[0], ranges[1], label);
        Chart::of_plane(&format!("{signal}, {when}"), Axis::new(&x.0, &x.1), Axis::new(&y.0, &y.1))
            .with_grid(grid.within(0.0, darkest))
            .with_height(380)
    };
    Some(Maps { over, charts: [chart(0, "before"), chart(1, "after")] })
}

/// The range of one coordinate without its few outermost samples.
fn middle_range(samples: &[Sample], axis: usize) -> (f64, f64) {
    let values: Vec<f64> = samples.iter().map(|sample| sample.state[axis]).collect();
    let low = quantile(&values, BEYOND).unwrap_or(0.0);
    let high = quantile(&values, 1.0 - BEYOND).unwrap_or(1.0);
    let room = 0.03 * (high - low);
    if low < high { (low - room, high + room) } else { (low - 0.5, low + 0.5) }
}

/// The next number with two digits.
fn rounded_up(value: f64) -> f64 {
    let place = 10_f64.powi(1 - value.log10().floor() as i32);
    (value * place).ceil() / place
}

/// RMS by cell, `[row][column]`; NaN where there are too few samples.
fn grid(samples: &[Sample], ranges: [(f64, f64); 2], column: usize, factor: f64) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![(0.0, 0_usize); CELLS.0]; CELLS.1];
    let cell = |value: f64, (low, high): (f64, f64), count: usize| {
        let fraction = (value - low) / (high - low);
        (0.0..=1.0).contains(&fraction).then(|| ((fraction * count as f64) as usize).min(count - 1))
    };
    for sample in samples {
        let across = cell(sample.state[0], ranges[0], CELLS.0);
        let up = cell(sample.state[1], ranges[1], CELLS.1);
        if let (Some(across), Some(up)) = (across, up) {
            sums[up][across].0 += sample.squares[column];
            sums[up][across].1 += 1;
        }
    }
    let rms = |(sum, count): (f64, usize)| {
        if count < LEAST_SAMPLES { f64::NAN } else { factor * (sum / count as f64).sqrt() }
    };
    sums.into_iter().map(|row| row.into_iter().map(rms).collect()).collect()
}

/// Position on the board, for camera signals.
fn board(part: &PartView<'_>, channel: usize) -> Option<Coordinates> {
    let own = part.channel(channel);
    let stem = own.signal.strip_suffix(&format!("_{}", own.axis))?;
    let coordinate = |axis: &str| {
        let name = format!("{stem}_{axis}");
        let found = part.stage.channels().iter().find(|other| other.signal == name);
        found.filter(|other| other.unit == "m" && other.times.len() == own.times.len())
    };
    let (x, y) = (coordinate("x")?, coordinate("y")?);
    let states = x.measured.iter().zip(&y.measured).map(|(x, y)| [*x, *y]).collect();
    let labels = ["x", "y"].map(|axis| (axis.to_owned(), "m".to_owned()));
    Some(Coordinates { over: "the position on the board", labels, states })
}

/// Velocity and acceleration along the signal's own axis.
fn motion(part: &PartView<'_>, channel: usize) -> Option<Coordinates> {
    let own = part.channel(channel);
    let rates = |unit: &str| {
        [
            ("velocity".to_owned(), format!("{unit}/s")),
            ("acceleration".to_owned(), format!("{unit}/s²")),
        ]
    };
    let over = "velocity and acceleration";
    if let Some(unit) = length_of_velocity(own.unit) {
        return Some(Coordinates { over, labels: rates(unit), states: of_velocity(own) });
    }
    if own.unit == "m" || own.unit == "rad" {
        let half = half_steps(own, SLOPE_TIME.1);
        let velocity = slopes(own, &own.measured, half);
        let acceleration = slopes(own, &velocity, half);
        let states = velocity.into_iter().zip(acceleration).map(|(v, a)| [v, a]).collect();
        return Some(Coordinates { over, labels: rates(own.unit), states });
    }
    let partner = part
        .stage
        .channels()
        .iter()
        .find(|other| other.axis == own.axis && length_of_velocity(other.unit).is_some());
    let Some(partner) = partner else { return Some(own_slope(own)) };
    let unit = length_of_velocity(partner.unit)?;
    let motion = of_velocity(partner);
    let states = own.times.iter().map(|time| motion[nearest(&partner.times, *time)]).collect();
    (!partner.times.is_empty()).then(|| Coordinates { over, labels: rates(unit), states })
}

/// Value and slope of a signal by whose side no motion was recorded.
fn own_slope(own: &Channel) -> Coordinates {
    let slopes = slopes(own, &own.measured, half_steps(own, SLOPE_TIME.0));
    let states = own.measured.iter().zip(slopes).map(|(value, slope)| [*value, slope]).collect();
    let labels = [
        (own.signal.clone(), own.unit.to_owned()),
        ("slope".to_owned(), format!("{}/s", own.unit)),
    ];
    Coordinates { over: "the signal itself and its slope", labels, states }
}

fn length_of_velocity(unit: &str) -> Option<&str> {
    unit.strip_suffix("/s")
}

fn of_velocity(channel: &Channel) -> Vec<[f64; 2]> {
    let acceleration = slopes(channel, &channel.measured, half_steps(channel, SLOPE_TIME.0));
    channel.measured.iter().zip(acceleration).map(|(v, a)| [*v, a]).collect()
}

fn half_steps(channel: &Channel, time: f64) -> usize {
    ((time * channel.rate_hz).round() as usize).max(1)
}

/// Slope of `values` at each sample, from `half` samples before to `half` after in the same run.
fn slopes(channel: &Channel, values: &[f64], half: usize) -> Vec<f64> {
    let mut found = vec![f64::NAN; values.len()];
    for Range { start, end } in channel.runs.iter().cloned() {
        let inner = found.iter_mut().enumerate().take(end.saturating_sub(half)).skip(start + half);
        for (sample, slope) in inner {
            let (from, to) = (sample - half, sample + half);
            *slope = (values[to] - values[from]) / (channel.times[to] - channel.times[from]);
        }
    }
    found
}

/// Index of the time nearest to `time`; 0 in an empty list.
fn nearest(times: &[f64], time: f64) -> usize {
    let after = times.partition_point(|at| *at < time);
    let before = after.saturating_sub(1);
    match (times.get(before), times.get(after)) {
        (Some(early), Some(late)) if late - time < time - early => after,
        _ => before,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Domain;

    #[test]
    fn slopes_stay_within_a_run() {
        let times: Vec<f64> = (0..10).map(|k| 0.1 * f64::from(k)).collect();
        let channel = Channel {
            signal: "motor_a.velocity".into(),
            unit: "m/s",
            domain: Domain::Drive,
            axis: "a",
            rate_hz: 10.0,
            measured: times.iter().map(|t| 3.0 * t).collect(),
            times,
            runs: vec![0..4, 4..10],
        };
        let found = slopes(&channel, &channel.measured, 1);
        assert!(found[0].is_nan() && found[3].is_nan() && found[4].is_nan() && found[9].is_nan());
        assert!((found[1] - 3.0).abs() < 1e-9 && (found[6] - 3.0).abs() < 1e-9);
    }

    #[test]
    fn the_nearest_time_is_found() {
        let times = [0.0, 1.0, 2.0];
        assert_eq!([-1.0, 0.4, 0.6, 9.0].map(|time| nearest(&times, time)), [0, 0, 1, 2]);
        assert_eq!(nearest(&[], 1.0), 0);
    }

    #[test]
    fn a_cell_holds_the_rms_of_its_samples() {
        let sample = |x: f64, square: f64| Sample { state: [x, 0.5], squares: [square, 0.0] };
        let samples: Vec<Sample> =
            (0..6).map(|_| sample(0.01, 4.0)).chain([sample(0.99, 9.0)]).collect();
        let found = grid(&samples, [(0.0, 1.0), (0.0, 1.0)], 0, 1e3);
        assert_eq!(found[8][0], 2e3);
        assert!(found[8][19].is_nan());
    }
}
