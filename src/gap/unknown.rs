//! Unexplained dependence of the final residual on a regressor. Its name is `unknown.<regressor>[<band>]`, and the
//! verdict is `unexplained`.
//!
//! A smooth dependence is a mean per bin of a regressor (time, own and other velocity, speed, acceleration, position),
//! tested block by block as in the screen. A periodic one is a spectral line, its sine and cosine tested jointly. Both
//! must explain a session to which they were not fitted.

use crate::stats::f_tail;

use super::{
    evidence::{joint, least_squares, without},
    fit::Fit,
    problem::{Linear, Part, Point, Problem, dot},
    whiten::{self, Filters},
};
use std::f64::consts::TAU;

/// Bins of a regressor.
const BINS: usize = 8;

/// Lowest and highest frequency of a line (Hz), where the signals are sampled fast enough.
const LINES_HZ: (f64, f64) = (0.15, 20.0);

/// Unexplained dependence of the residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// `unknown.<regressor>[<band>]`.
    pub name: String,
    /// Signal in which it is largest.
    pub signal: String,
    /// Fraction of the whitened squared error that it explains.
    pub fraction: f64,
    /// F statistic of the block test.
    pub statistic: f64,
    /// Tail probability, corrected for `comparisons`.
    pub p_value: f64,
    /// Number of comparisons.
    pub comparisons: usize,
}

/// Regressor of one channel.
struct Regressor {
    name: String,
    channel: usize,
    /// Values by part and by sample of the channel.
    values: Vec<Vec<f64>>,
}

/// Strongest significant dependence of the residual at `found`.
#[must_use]
pub(super) fn strongest(
    train: &Problem<'_>,
    held_out: &Problem<'_>,
    found: &Fit,
    held_point: &Point,
    filters: &Filters,
) -> Option<Unknown> {
    let thresholds = train.thresholds();
    let linear = train.linear(&found.point, &[], filters);
    let held = held_out.linear(held_point, &[], filters);
    let total = dot(&linear.residual, &linear.residual);
    let held_total = dot(&held.residual, &held.residual);
    let smooth = regressors(train);
    let smooth_held = regressors(held_out);
    let lines = line_frequencies(train);
    let signals = train.parts.first().map_or(0, |part| part.stage.channels().len());
    let tries = smooth.len() + signals * lines.len();
    let mut best: Option<Unknown> = None;
    let mut consider = |unknown: Unknown| {
        if best.as_ref().is_none_or(|best| best.fraction < unknown.fraction) {
            best = Some(unknown);
        }
    };
    for (own, other) in smooth.iter().zip(&smooth_held) {
        let edges = bin_edges(own);
        let columns = binned(train, own, &edges, filters);
        let Some(weights) = least_squares(&columns, &linear.residual) else { continue };
        let fraction = explained(&columns, &weights, &linear.residual) / total;
        let elsewhere = binned(held_out, other, &edges, filters);
        let carried = explained_by(&elsewhere, &weights, &held.residual) / held_total;
        let (statistic, p) = joint(&columns, &linear.residual, &linear.blocks);
        let p_value = p * tries as f64;
        if p_value < thresholds.family_error
            && thresholds.reference_excess < fraction
            && thresholds.min_amplitude * fraction < carried
        {
            let name = format!("unknown.{}[{}]", own.name, band(&edges));
            let signal = train.parts[0].stage.channels()[own.channel].signal.clone();
            consider(Unknown { name, signal, fraction, statistic, p_value, comparisons: tries });
        }
    }
    for (frequency, signal) in strong_lines(train, &linear, &lines) {
        let columns = line(train, frequency, signal, filters, &linear);
        let Some(found) = least_squares(&columns, &linear.residual) else { continue };
        let fraction = explained(&columns, &found, &linear.residual) / total;
        if fraction < thresholds.reference_excess {
            continue;
        }
        let elsewhere = line(held_out, frequency, signal, filters, &held);
        let carried = least_squares(&elsewhere, &held.residual)
            .map_or(0.0, |own| explained(&elsewhere, &own, &held.residual) / held_total);
        let (statistic, p) = joint(&columns, &linear.residual, &linear.blocks);
        let p_value = p * tries as f64;
        if p_value < thresholds.family_error && thresholds.min_amplitude * fraction < carried {
            let name = format!("unknown.time[{frequency:.2} Hz]");
            let signal = train.parts[0].stage.channels()[signal].signal.clone();
            consider(Unknown { name, signal, fraction, statistic, p_value, comparisons: tries });
        }
    }
    best
}

fn explained(columns: &[Vec<f64>], weights: &[f64], residual: &[f64]) -> f64 {
    columns.iter().zip(weights).map(|(column, weight)| weight * dot(column, residual)).sum()
}

/// Squared error that given weights remove.
fn explained_by(columns: &[Vec<f64>], weights: &[f64], residual: &[f64]) -> f64 {
    let left = without(columns, weights, residual);
    dot(residual, residual) - dot(&left, &left)
}

/// Regressors for the residual of each channel, from measurements alone.
fn regressors(problem: &Problem<'_>) -> Vec<Regressor> {
    let Some(first) = problem.parts.first() else { return Vec::new() };
    let count = first.stage.channels().len();
    let mut all = Vec::new();
    for channel in 0..count {
        let mut add = |name: &str, of: &dyn Fn(&Part<'_>) -> Vec<f64>| {
            let values = problem.parts.iter().map(of).collect();
            all.push(Regressor { name: name.to_owned(), channel, values });
        };
        let signal = &first.stage.channels()[channel].signal;
        let kind = signal.rsplit('.').next().unwrap_or(signal);
        let name = |what: &str| format!("{kind}_{what}");
        add(&name("own"), &|part| part.stage.channels()[channel].measured.clone());
        add(&name("size"), &|part| {
            part.stage.channels()[channel].measured.iter().map(|value| value.abs()).collect()
        });
        add(&name("slope"), &|part| slope(&part.stage.channels()[channel]));
        add("time", &|part| part.stage.channels()[channel].times.clone());
        for other in (0..count).filter(|other| *other != channel) {
            let other_signal = first.stage.channels()[other].signal.replace('.', "_");
            add(&other_signal, &|part| {
                let (own, other) = (&part.stage.channels()[channel], &part.stage.channels()[other]);
                let mut cursor = 0;
                own.times
                    .iter()
                    .map(|time| {
                        while cursor + 1 < other.times.len() && other.times[cursor + 1] <= *time {
                            cursor += 1;
                        }
                        other.measured.get(cursor).copied().unwrap_or(f64::NAN)
                    })
                    .collect()
            });
        }
    }
    all
}

fn slope(channel: &crate::twin::Channel) -> Vec<f64> {
    let (times, values) = (&channel.times, &channel.measured);
    let last = times.len().saturating_sub(1);
    (0..times.len())
        .map(|k| {
            let (before, after) = (k.saturating_sub(2), (k + 2).min(last));
            (values[after] - values[before]) / (times[after] - times[before]).max(1e-9)
        })
        .collect()
}

/// Inner edges of the bins: quantiles of the regressor.
fn bin_edges(regressor: &Regressor) -> Vec<f64> {
    let all: Vec<f64> =
        regressor.values.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    (1..BINS).filter_map(|k| crate::stats::quantile(&all, k as f64 / BINS as f64)).collect()
}

fn band(edges: &[f64]) -> String {
    match (edges.first(), edges.last()) {
        (Some(low), Some(high)) => format!("{low:.3} to {high:.3}"),
        _ => "all".to_owned(),
    }
}

/// Whitened columns, one per bin, for the mean residual of one channel in that bin.
fn binned(
    problem: &Problem<'_>,
    regressor: &Regressor,
    edges: &[f64],
    filters: &Filters,
) -> Vec<Vec<f64>> {
    (0..=edges.len())
        .map(|bin| {
            let mut column = Vec::with_capacity(problem.rows());
            for (part, values) in problem.parts.iter().zip(&regressor.values) {
                let mut change: Vec<Vec<f64>> = part
                    .stage
                    .channels()
                    .iter()
                    .map(|channel| vec![0.0; channel.times.len()])
                    .collect();
                for (value, own) in change[regressor.channel].iter_mut().zip(values) {
                    let place = edges.partition_point(|edge| edge <= own);
                    *value = if place == bin { 1.0 } else { 0.0 };
                }
                let order = whiten::in_order(part.stage, filters);
                column.extend(part.layout.whitened(&change, &order));
            }
            column
        })
        .collect()
}

/// Frequencies at the resolution of the longest part, up to half the sample rate of the fastest signal.
fn line_frequencies(problem: &Problem<'_>) -> Vec<f64> {
    let channels = problem.parts.iter().flat_map(|part| part.stage.channels());
    let rate = channels.map(|channel| channel.rate_hz).fold(0.0, f64::max);
    let (lowest, highest) = (LINES_HZ.0, LINES_HZ.1.min(0.5 * rate));
    let length = problem
        .parts
        .iter()
        .filter_map(|part| {
            let times = &part.stage.channels().first()?.times;
            Some(times.last()? - times.first()?)
        })
        .fold(0.0, f64::max);
    if length < 5.0 {
        return Vec::new();
    }
    let step = 0.5 / length;
    let count = ((highest - lowest) / step).max(0.0) as usize;
    (0..count).map(|k| lowest + k as f64 * step).collect()
}

/// Disturbance that depends on no measured quantity: the signal of `problem` with the largest excess, and the frequency
/// band with the middle 80 % of its energy.
#[must_use]
pub(super) fn disturbance(problem: &Problem<'_>, point: &Point) -> Option<Unknown> {
    let twin = &point.twin;
    let channels = problem.parts.first()?.stage.channels();
    let ratio = |k: usize, (sum, count): (f64, usize)| {
        let known = twin.reference_residuals.iter().find(|own| own.signal == channels[k].signal)?;
        Some((sum / (known.residual_rms.powi(2) * count as f64), k))
    };
    let ratios = problem.squares(point).into_iter().enumerate();
    let (most, signal) =
        ratios.filter_map(|(k, own)| ratio(k, own)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let lines = line_frequencies(problem);
    let rows: Vec<f64> = rows_of(problem, point);
    let energies: Vec<f64> =
        energies(problem, &rows, &lines).iter().map(|line| line[signal]).collect();
    let total: f64 = energies.iter().sum();
    let edge = |fraction: f64| {
        let mut sum = 0.0;
        let place = energies.iter().position(|energy| {
            sum += energy;
            fraction * total <= sum
        });
        place.map_or(0.0, |place| lines[place])
    };
    let blocks = problem.blocks().count as f64;
    let p_value = f_tail(most, blocks, blocks);
    (p_value < problem.thresholds().family_error).then(|| Unknown {
        name: format!("unknown.time[{:.1} to {:.1} Hz]", edge(0.1), edge(0.9)),
        signal: channels[signal].signal.clone(),
        fraction: 1.0 - 1.0 / most,
        statistic: most,
        p_value,
        comparisons: 1,
    })
}

/// Residual of every row, as measured.
fn rows_of(problem: &Problem<'_>, point: &Point) -> Vec<f64> {
    let residuals = problem.residuals(point);
    let parts = problem.parts.iter().zip(&residuals);
    parts
        .flat_map(|(part, residual)| {
            let value = |row: &whiten::Row| residual[row.channel as usize][row.sample as usize];
            part.layout.rows.iter().map(value)
        })
        .collect()
}

/// Bin length of the scan for lines, in periods of the highest line: it costs 7 % of the amplitude there.
const SCAN_BIN_PERIODS: f64 = 0.2;

/// Lines and signals with enough energy to be tested.
fn strong_lines(problem: &Problem<'_>, linear: &Linear, lines: &[f64]) -> Vec<(f64, usize)> {
    let strong =
        0.5 * problem.thresholds().reference_excess * dot(&linear.residual, &linear.residual);
    let energies = energies(problem, &linear.residual, lines);
    let all = lines.iter().zip(&energies);
    all.flat_map(|(line, energy)| {
        let of_line = energy.iter().enumerate().filter(move |(_, energy)| strong < **energy);
        of_line.map(|(signal, _)| (*line, signal))
    })
    .collect()
}

/// Energy of `rows` along each line, per signal: `[line][signal]`. Sums over short bins of time, rotated from sample to
/// sample, take a hundredth of the time of exact columns.
fn energies(problem: &Problem<'_>, rows: &[f64], lines: &[f64]) -> Vec<Vec<f64>> {
    let signals = problem.parts.first().map_or(0, |part| part.stage.channels().len());
    let mut energy = vec![vec![0.0; signals]; lines.len()];
    let Some(highest) = lines.last() else { return energy };
    let bin_length = SCAN_BIN_PERIODS / highest;
    let mut row = 0;
    for part in &problem.parts {
        let channels = part.stage.channels();
        let mut bins = vec![Vec::<f64>::new(); signals];
        let mut counts = vec![0.0; signals];
        for own in &part.layout.rows {
            let signal = own.channel as usize;
            let times = &channels[signal].times;
            let bin = ((times[own.sample as usize] - times[0]) / bin_length) as usize;
            if bins[signal].len() <= bin {
                bins[signal].resize(bin + 1, 0.0);
            }
            bins[signal][bin] += rows[row];
            counts[signal] += 1.0;
            row += 1;
        }
        for (line, energy) in lines.iter().zip(&mut energy) {
            let (turn_sine, turn_cosine) = (TAU * line * bin_length).sin_cos();
            for ((bins, count), energy) in bins.iter().zip(&counts).zip(energy) {
                let (mut sine, mut cosine) = (0.0_f64, 1.0_f64);
                let (mut along_sine, mut along_cosine) = (0.0, 0.0);
                for value in bins {
                    along_sine += sine * value;
                    along_cosine += cosine * value;
                    (sine, cosine) = (
                        sine * turn_cosine + cosine * turn_sine,
                        cosine * turn_cosine - sine * turn_sine,
                    );
                }
                *energy += 2.0 * (along_sine * along_sine + along_cosine * along_cosine)
                    / f64::max(*count, 1.0);
            }
        }
    }
    energy
}

/// Whitened sine and cosine in time on one signal.
fn line(
    problem: &Problem<'_>,
    frequency: f64,
    signal: usize,
    filters: &Filters,
    linear: &Linear,
) -> Vec<Vec<f64>> {
    [0.0, 0.25]
        .map(|phase| {
            let mut column = Vec::with_capacity(problem.rows());
            for part in &problem.parts {
                let order = whiten::in_order(part.stage, filters);
                let change: Vec<Vec<f64>> = part
                    .stage
                    .channels()
                    .iter()
                    .enumerate()
                    .map(|(index, channel)| {
                        let sine = |t: &f64| (TAU * (frequency * t + phase)).sin();
                        if index == signal {
                            channel.times.iter().map(sine).collect()
                        } else {
                            vec![0.0; channel.times.len()]
                        }
                    })
                    .collect();
                column.extend(part.layout.whitened(&change, &order));
            }
            linear.take_nuisances_from(&mut column);
            column
        })
        .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        gap::test_stage::TestStage,
        twin::{Machine, Stage, Twin},
    };

    /// Lines of a signal of 20 s at 100 Hz, and the one with the most energy of a sine at `frequency` (Hz).
    fn scanned(frequency: f64) -> (Vec<f64>, f64) {
        let twin = Twin::nominal(Machine::Axis);
        let stage = TestStage::camera(&twin, |_, time| (TAU * frequency * time).sin(), 1);
        let problem = Problem::new(&[&stage as &dyn Stage], &twin);
        let lines = line_frequencies(&problem);
        let part = &problem.parts[0];
        let measured = &part.stage.channels()[0].measured;
        let rows: Vec<f64> =
            part.layout.rows.iter().map(|row| measured[row.sample as usize]).collect();
        let energies = energies(&problem, &rows, &lines);
        let most = (0..lines.len()).max_by(|a, b| energies[*a][0].total_cmp(&energies[*b][0]));
        let found = lines[most.unwrap()];
        (lines, found)
    }

    #[test]
    fn a_line_is_found_at_its_frequency() {
        for frequency in [0.5, 3.0, 17.3] {
            let (lines, found) = scanned(frequency);
            assert!((found - frequency).abs() < 0.03, "{frequency} {found}");
            assert!(lines.last().is_some_and(|last| *last < LINES_HZ.1));
        }
    }

    /// A recording whose time in ms was read as seconds.
    #[test]
    fn lines_beyond_half_the_sample_rate_are_not_scanned() {
        let twin = Twin::nominal(Machine::Axis);
        let stage = TestStage::camera(&twin, |_, time| time.sin(), 1).slower(100.0);
        let problem = Problem::new(&[&stage as &dyn Stage], &twin);
        let lines = line_frequencies(&problem);
        assert!(lines.iter().all(|line| *line < 0.5), "{:?}", lines.last());
        assert!(energies(&problem, &vec![0.0; 2000], &[]).is_empty());
    }
}
