//! Prewhitening: residuals of real machines are coloured. Tests and intervals that assume white noise are far
//! overconfident.
//!
//! For each signal, an autoregressive model is fitted to the residual of the base model (Yule-Walker equations). The
//! Bayesian information criterion selects its order, up to [`MOST_ORDER`]. Measurement, base columns and candidate columns are
//! filtered with its inverse and divided by the standard deviation of the innovations (Ljung, "System Identification",
//! 2nd ed., chapter 7). Every stretch of a signal begins with the predictors of lower order. So no sample is lost, and no
//! run influences another (Prais and Winsten; Brockwell and Davis, "Time Series: Theory and Methods", 2nd ed., section 5.2).

use crate::twin::Stage;
use faer::{Mat, linalg::solvers::Solve};
use std::collections::BTreeMap;

/// Highest order of the autoregressive model.
const MOST_ORDER: usize = 12;

/// Fraction of a residual's variance that counts as white, for any spectrum. An incomplete base model leaves a strongly
/// coloured residual. Full whitening would shift the weight of the fit from the slow errors, which are the gap, to the
/// fast noise. The tests by blocks account for the remaining colour.
const SOFTENING: f64 = 1.0;

/// Samples that each order of the model needs.
const SAMPLES_PER_ORDER: usize = 10;

/// Longest dropout of a signal that is bridged for the filter (samples); after a longer one the filter restarts.
const LONGEST_BRIDGE: usize = 8;

/// Prediction of a sample from those before it.
#[derive(Debug, Clone, PartialEq)]
struct Predictor {
    /// Weights of the preceding samples, the nearest first.
    coefficients: Vec<f64>,
    /// Standard deviation of its error, in the signal's unit.
    standard_deviation: f64,
}

impl Predictor {
    /// Error of the prediction of `values[k]`, in standard deviations.
    fn innovation(&self, values: &[f64], k: usize) -> f64 {
        let past = values[..k].iter().rev().zip(&self.coefficients);
        let predicted: f64 = past.map(|(value, weight)| value * weight).sum();
        (values[k] - predicted) / self.standard_deviation
    }
}

/// Inverse of one signal's autoregressive model.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// Predictors of the first samples of a stretch, from order 0 on.
    starts: Vec<Predictor>,
    /// Predictor of all others.
    settled: Predictor,
}

impl Filter {
    /// Filter of white noise with this standard deviation, in the signal's unit.
    fn white(standard_deviation: f64) -> Self {
        Self {
            starts: Vec::new(),
            settled: Predictor { coefficients: Vec::new(), standard_deviation },
        }
    }

    /// Innovations of the `values` of one stretch, in standard deviations.
    fn apply(&self, values: &[f64], innovations: &mut Vec<f64>) {
        let starts = self.starts.iter().take(values.len()).enumerate();
        innovations.clear();
        innovations.extend(starts.map(|(k, own)| own.innovation(values, k)));
        let Predictor { coefficients, standard_deviation } = &self.settled;
        let order = coefficients.len();
        let Some(later) = values.get(order..) else { return };
        let inverse_deviation = 1.0 / standard_deviation;
        innovations.extend(later.iter().map(|value| inverse_deviation * value));
        // Lag by lag over the whole stretch, so that the processor vectorizes over samples.
        for (lag, weight) in coefficients.iter().enumerate() {
            let weight = inverse_deviation * weight;
            let past = &values[order - 1 - lag..];
            for (value, past) in innovations[order..].iter_mut().zip(past) {
                *value -= weight * past;
            }
        }
    }
}

/// Filters by signal.
pub type Filters = BTreeMap<String, Filter>;

/// Stage, its used samples, and its residual `[channel][sample]`.
pub(super) type Residual<'a> = (&'a dyn Stage, &'a Layout, &'a [Vec<f64>]);

/// Row of the whitened problem: a used sample.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Index of the channel.
    pub channel: u32,
    /// Index of the sample.
    pub sample: u32,
    /// Index of the run.
    pub run: u32,
    /// Block of time to which it belongs, counted through the stage.
    pub block: u32,
}

/// Used samples of one stage, in order.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    /// All rows: run by run, channel by channel.
    pub rows: Vec<Row>,
    /// Rows of each run.
    pub runs: Vec<std::ops::Range<usize>>,
    /// Number of blocks.
    pub blocks: usize,
    /// Samples of each (run, channel) stretch without a long dropout, in the order of the rows.
    stretches: Vec<Stretch>,
}

#[derive(Debug, Clone)]
struct Stretch {
    channel: usize,
    samples: std::ops::Range<usize>,
    /// `true` for each measured sample; the others are bridged.
    counts: Vec<bool>,
    first_row: usize,
}

impl Layout {
    /// Layout of `stage` with the measured samples `usable[channel][sample]`.
    #[must_use]
    pub fn new(stage: &dyn Stage, usable: &[Vec<bool>]) -> Self {
        let channels = stage.channels();
        let mut layout = Self::default();
        let runs = channels.first().map_or(0, |channel| channel.runs.len());
        for run in 0..runs {
            let first_row = layout.rows.len();
            let begin = channels
                .iter()
                .filter_map(|channel| channel.times.get(channel.runs[run].start))
                .copied()
                .fold(f64::INFINITY, f64::min);
            let mut last_block = 0;
            for (index, channel) in channels.iter().enumerate() {
                for samples in stretches(&usable[index], channel.runs[run].clone()) {
                    let counts = usable[index][samples.clone()].to_vec();
                    let row = layout.rows.len();
                    for sample in samples.clone() {
                        if usable[index][sample] {
                            let block =
                                ((channel.times[sample] - begin) / stage.block_seconds()) as usize;
                            last_block = last_block.max(block + 1);
                            layout.rows.push(Row {
                                channel: index as u32,
                                sample: sample as u32,
                                run: run as u32,
                                block: (layout.blocks + block) as u32,
                            });
                        }
                    }
                    layout.stretches.push(Stretch {
                        channel: index,
                        samples,
                        counts,
                        first_row: row,
                    });
                }
            }
            layout.blocks += last_block;
            layout.runs.push(first_row..layout.rows.len());
        }
        layout
    }

    /// `values[channel][sample]`, whitened, in the order of the rows.
    #[must_use]
    pub fn whitened(&self, values: &[Vec<f64>], filters: &[Filter]) -> Vec<f64> {
        let mut out = vec![0.0; self.rows.len()];
        let (mut bridged, mut innovations) = (Vec::new(), Vec::new());
        for stretch in &self.stretches {
            let filter = &filters[stretch.channel];
            bridge(
                &values[stretch.channel][stretch.samples.clone()],
                &stretch.counts,
                &mut bridged,
            );
            filter.apply(&bridged, &mut innovations);
            let rows = out[stretch.first_row..].iter_mut();
            let counted = innovations.iter().zip(&stretch.counts);
            let counted = counted.filter(|(_, counts)| **counts).map(|(value, _)| value);
            rows.zip(counted).for_each(|(row, value)| *row = *value);
        }
        out
    }

    /// Bridged stretches of one channel, for fitting its model.
    fn bridged_stretches(&self, channel: usize, values: &[f64]) -> Vec<Vec<f64>> {
        self.stretches
            .iter()
            .filter(|stretch| stretch.channel == channel)
            .map(|stretch| {
                let mut bridged = Vec::new();
                bridge(&values[stretch.samples.clone()], &stretch.counts, &mut bridged);
                bridged
            })
            .collect()
    }
}

/// Pieces of `run` without a dropout longer than [`LONGEST_BRIDGE`].
fn stretches(usable: &[bool], run: std::ops::Range<usize>) -> Vec<std::ops::Range<usize>> {
    let mut pieces = Vec::new();
    let mut start = None;
    let mut last = 0;
    for sample in run {
        if !usable[sample] {
            continue;
        }
        if let Some(begin) = start
            && last + LONGEST_BRIDGE < sample
        {
            pieces.push(begin..last + 1);
            start = Some(sample);
        }
        start = start.or(Some(sample));
        last = sample;
    }
    pieces.extend(start.map(|begin| begin..last + 1));
    pieces
}

/// Copy `values`, with straight lines over unused samples.
fn bridge(values: &[f64], counts: &[bool], out: &mut Vec<f64>) {
    out.clear();
    out.extend_from_slice(values);
    let mut before = 0;
    for k in 1..out.len() {
        if !counts[k] {
            continue;
        }
        for gap in before + 1..k {
            let fraction = (gap - before) as f64 / (k - before) as f64;
            out[gap] = out[before] + fraction * (out[k] - out[before]);
        }
        before = k;
    }
}

/// Autoregressive models of the residuals of several stages of one kind.
#[must_use]
pub(super) fn fit_filters(parts: &[Residual<'_>]) -> Filters {
    let mut by_signal: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    for (stage, layout, residual) in parts {
        for (index, channel) in stage.channels().iter().enumerate() {
            by_signal
                .entry(channel.signal.clone())
                .or_default()
                .extend(layout.bridged_stretches(index, &residual[index]));
        }
    }
    by_signal
        .into_iter()
        .map(|(signal, pieces)| (signal, autoregressive(&pieces, SOFTENING)))
        .collect()
}

/// Filters that only scale: one over the RMS of each signal's residual.
#[must_use]
pub(super) fn scale_filters(parts: &[Residual<'_>]) -> Filters {
    let mut filters = fit_filters(parts);
    for (signal, filter) in &mut filters {
        let (mut sum, mut count) = (0.0, 0_usize);
        for (stage, layout, residual) in parts {
            for row in &layout.rows {
                if stage.channels()[row.channel as usize].signal == *signal {
                    sum += residual[row.channel as usize][row.sample as usize].powi(2);
                    count += 1;
                }
            }
        }
        *filter = Filter::white((sum / count.max(1) as f64).sqrt().max(f64::MIN_POSITIVE));
    }
    filters
}

/// Filters in the order of a stage's channels.
#[must_use]
pub(super) fn in_order(stage: &dyn Stage, filters: &Filters) -> Vec<Filter> {
    stage
        .channels()
        .iter()
        .map(|channel| filters.get(&channel.signal).cloned().unwrap_or_else(|| Filter::white(1.0)))
        .collect()
}

/// Yule-Walker equations for every order, the order by the Bayesian information criterion. `softening` is the variance of white
/// noise, as a fraction of that of the pieces, that is added to the model. The covariances are sums over all pieces, divided by
/// the number of all samples, so that every order is stable (Brockwell and Davis, sections 7.2 and 8.1).
fn autoregressive(pieces: &[Vec<f64>], softening: f64) -> Filter {
    let mut sums = [0.0; MOST_ORDER + 1];
    for piece in pieces {
        for (lag, sum) in sums.iter_mut().enumerate() {
            *sum += piece
                .iter()
                .zip(piece.iter().skip(lag))
                .map(|(one, other)| one * other)
                .sum::<f64>();
        }
    }
    let count = pieces.iter().map(Vec::len).sum::<usize>();
    let n = count.max(1) as f64;
    let total = sums[0].max(f64::MIN_POSITIVE);
    let mut predictors: Vec<Predictor> = Vec::new();
    let (mut best_order, mut best_score) = (0, f64::INFINITY);
    for order in 0..=MOST_ORDER.min(count / SAMPLES_PER_ORDER) {
        let left = Mat::from_fn(order, order, |i, j| {
            sums[i.abs_diff(j)] + if i == j { softening * total } else { 0.0 }
        });
        let right = Mat::from_fn(order, 1, |i, _| sums[i + 1]);
        let solution = left.partial_piv_lu().solve(&right);
        let weight = |i: usize| if i == 0 { 1.0 } else { -solution[(i - 1, 0)] };
        let rest: f64 = (0..=order)
            .flat_map(|i| (0..=order).map(move |j| (i, j)))
            .map(|(i, j)| weight(i) * weight(j) * sums[i.abs_diff(j)])
            .sum();
        let rest = rest.max(1e-12 * total);
        let score = n * (rest / n).ln() + order as f64 * n.ln();
        if score < best_score {
            (best_order, best_score) = (order, score);
        }
        predictors.push(Predictor {
            coefficients: (0..order).map(|i| solution[(i, 0)]).collect(),
            standard_deviation: (rest / n).sqrt(),
        });
    }
    let settled = predictors.swap_remove(best_order);
    predictors.truncate(best_order);
    Filter { starts: predictors, settled }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    /// Samples of each process.
    const COUNT: usize = 40_000;

    /// Largest correlation of white noise of this length at any of [`LAGS`] lags: four standard deviations.
    const BAND: f64 = 4.0 / 200.0;

    const LAGS: usize = 20;

    /// Innovations of the processes.
    const DEVIATION: f64 = 2.0;

    /// Autoregressive process with these `weights` of the preceding samples.
    fn process(seed: u64, weights: &[f64]) -> Vec<f64> {
        let mut stream = Stream::new(seed, "whiten");
        let mut values = vec![0.0; weights.len()];
        for _ in 0..COUNT + 1000 {
            let normal: f64 = (0..12).map(|_| f64::from(stream.uniform_f32(-0.5, 0.5))).sum();
            let past = values.iter().rev().zip(weights);
            let next = past.map(|(value, weight)| weight * value).sum::<f64>() + DEVIATION * normal;
            values.push(next);
        }
        values.split_off(values.len() - COUNT)
    }

    /// Innovations of `values` under `filter`.
    fn innovations(values: &[f64], filter: &Filter) -> Vec<f64> {
        let own = |k| filter.settled.standard_deviation * filter.settled.innovation(values, k);
        (MOST_ORDER..values.len()).map(own).collect()
    }

    fn covariance(values: &[f64], lag: usize) -> f64 {
        let products = values.iter().zip(&values[lag..]).map(|(one, other)| one * other);
        products.sum::<f64>() / values.len() as f64
    }

    #[test]
    fn a_process_is_whitened_and_the_variance_of_its_innovations_recovered() {
        for weights in [&[][..], &[0.7], &[1.2, -0.5], &[0.5, 0.1, -0.3]] {
            let values = process(1, weights);
            let filter = autoregressive(std::slice::from_ref(&values), 0.0);
            for (index, weight) in weights.iter().enumerate() {
                assert!(
                    (filter.settled.coefficients[index] - weight).abs() < BAND,
                    "{weights:?}: {filter:?}"
                );
            }
            assert!(
                (filter.settled.standard_deviation / DEVIATION - 1.0).abs() < BAND,
                "{weights:?}: {filter:?}"
            );
            let rest = innovations(&values, &filter);
            for lag in 1..=LAGS {
                let correlation = covariance(&rest, lag) / covariance(&rest, 0);
                assert!(correlation.abs() < BAND, "{weights:?}, lag {lag}: {correlation}");
            }
        }
    }

    /// Short stretches are white from their first sample on, so none has to be left out.
    #[test]
    fn the_first_samples_of_a_stretch_are_as_white_as_the_others() {
        const LENGTH: usize = 5;
        const TOLERANCE: f64 = 0.06;
        let values = process(2, &[1.2, -0.5]);
        let filter = autoregressive(std::slice::from_ref(&values), 0.0);
        let mut innovations = Vec::new();
        let mut products = [[0.0; LENGTH]; LENGTH];
        for stretch in values.chunks_exact(LENGTH) {
            filter.apply(stretch, &mut innovations);
            for (row, one) in products.iter_mut().zip(&innovations) {
                row.iter_mut().zip(&innovations).for_each(|(sum, other)| *sum += one * other);
            }
        }
        let count = (COUNT / LENGTH) as f64;
        for (i, row) in products.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((sum / count - expected).abs() < TOLERANCE, "{i} {j}: {}", sum / count);
            }
        }
    }

    #[test]
    fn the_order_is_that_of_the_process() {
        for weights in [&[][..], &[0.7], &[1.2, -0.5]] {
            let orders: Vec<usize> = (0..5)
                .map(|seed| autoregressive(&[process(seed, weights)], 0.0).starts.len())
                .collect();
            let right = orders.iter().filter(|order| **order == weights.len()).count();
            assert!(4 <= right, "{weights:?}: {orders:?}");
        }
    }

    #[test]
    fn softening_adds_white_noise_to_the_normal_equations() {
        let values = process(3, &[0.6]);
        let gram = |lag: usize| covariance(&values, lag);
        let filter = autoregressive(std::slice::from_ref(&values), SOFTENING);
        let order = filter.settled.coefficients.len();
        assert!(1 <= order);
        // The normal equations with the softened variance hold for the coefficients.
        for i in 0..order {
            let softened = SOFTENING * gram(0) * filter.settled.coefficients[i];
            let left: f64 = (0..order)
                .map(|j| gram(i.abs_diff(j)) * filter.settled.coefficients[j])
                .sum::<f64>()
                + softened;
            assert!((left / gram(0) - gram(i + 1) / gram(0)).abs() < BAND, "{filter:?}");
        }
        let variance = covariance(&innovations(&values, &filter), 0);
        assert!(
            (filter.settled.standard_deviation.powi(2) / variance - 1.0).abs() < BAND,
            "{filter:?} {variance}"
        );
    }
}
