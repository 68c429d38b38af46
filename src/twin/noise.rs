//! Noise of signals: measurement of the effects that change no value (`sensor.frame_jitter`,
//! `sensor.noise_model`, `sensor.frame_drop`, `sensor.encoder_quantisation`).
//!
//! Samples close in time are not independent, so standard errors come from leaving out one block at
//! a time (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 11). Values that
//! are not finite mark missing samples; nothing is differenced across them.

use crate::stats::{half_central_spread, median};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Frames of the camera that make a block.
pub(crate) const FRAMES_OF_A_BLOCK: usize = 60;

/// Fewest blocks of which a standard error can be formed.
const FEWEST_BLOCKS: usize = 5;

/// Standard error of a median, in those of a mean (normal errors).
const MEDIAN_ERROR: f64 = 1.2533;

/// Number of periods from which an interval is a pause, and no loss of frames.
const PAUSE_PERIODS: f64 = 30.0;

/// An estimate and its standard error, in one unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// Measured property of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseFinding {
    /// Value, in the unit of the effect's parameter.
    pub value: f64,
    /// Standard error of the value.
    pub standard_error: f64,
    /// Distance from no effect in standard errors, signed. It is that of the tested quantity, which
    /// is the variance for a jitter and the logarithm for a ratio.
    pub t: f64,
    /// Number of blocks behind the value; `t` has one degree of freedom fewer.
    pub blocks: usize,
}

/// `statistic` of all blocks, and its standard error from leaving out one at a time. The sums of
/// a block are added up, so that each statistic costs no more than one block.
fn jackknife<const N: usize>(
    blocks: &[[f64; N]],
    statistic: impl Fn(&[f64; N]) -> f64,
) -> Option<Estimate> {
    if blocks.len() < FEWEST_BLOCKS {
        return None;
    }
    let mut all = [0.0; N];
    for block in blocks {
        for (sum, value) in all.iter_mut().zip(block) {
            *sum += value;
        }
    }
    let without: Vec<f64> = blocks
        .iter()
        .map(|block| {
            let mut rest = all;
            for (sum, value) in rest.iter_mut().zip(block) {
                *sum -= value;
            }
            statistic(&rest)
        })
        .collect();
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let squares: f64 = without.iter().map(|value| (value - mean).powi(2)).sum();
    let (value, standard_error) = (statistic(&all), ((n - 1.0) / n * squares).sqrt());
    (value.is_finite() && standard_error.is_finite()).then_some(Estimate { value, standard_error })
}

/// Noise of one coordinate of the camera, with standard errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scattering {
    /// Variance of the time stamps (s^2); below zero by chance where they have none.
    pub timestamp_variance_s2: Estimate,
    /// Variance at rest of the part that changes from frame to frame (m^2), scaled to that of white
    /// noise.
    pub frame_to_frame_variance_m2: Estimate,
    /// Variance about the prediction at rest (m^2): the same for white noise, larger for smooth
    /// errors.
    pub total_variance_m2: Estimate,
    /// Mean square of the speed (m^2/s^2).
    pub mean_square_speed: f64,
    /// Number of blocks behind the estimates.
    pub blocks: usize,
}

/// Noise of a camera coordinate, from its `residual` (m) and the speed of the object along it (m/s)
/// at the same frames, in order.
///
/// The second difference of the residual, scaled to the variance of a white residual, removes its
/// smooth part: a wrong latency also grows with speed, but smoothly. Its square is regressed on the
/// squared speed. The slope is the variance of the time stamps, the intercept that of the
/// positions.
#[must_use]
pub fn scattering(residual: &[f64], speed: &[f64], block: usize) -> Option<Scattering> {
    let n = residual.len().min(speed.len());
    let (residual, speed) = (&residual[..n], &speed[..n]);
    let mut blocks = Vec::new();
    for start in (0..n).step_by(block.max(1)) {
        let mut sums = [0.0; 7];
        for k in start.max(1)..(start + block.max(1)).min(n.saturating_sub(1)) {
            let y = (residual[k - 1] - 2.0 * residual[k] + residual[k + 1]).powi(2) / 6.0;
            // The three stamps share the difference as 1 : 4 : 1.
            let x = (speed[k - 1].powi(2) + 4.0 * speed[k].powi(2) + speed[k + 1].powi(2)) / 6.0;
            let z = residual[k].powi(2);
            if x.is_finite() && y.is_finite() {
                for (sum, term) in sums.iter_mut().zip([1.0, x, y, z, x * x, x * y, x * z]) {
                    *sum += term;
                }
            }
        }
        if 0.0 < sums[0] {
            blocks.push(sums);
        }
    }
    let slope = |[n, x, y, _, xx, xy, _]: &[f64; 7]| (n * xy - x * y) / (n * xx - x * x);
    let still = |[n, x, y, _, xx, xy, _]: &[f64; 7]| (xx * y - x * xy) / (n * xx - x * x);
    let whole = |[n, x, _, z, xx, _, xz]: &[f64; 7]| (xx * z - x * xz) / (n * xx - x * x);
    let (count, squares) =
        blocks.iter().fold((0.0, 0.0), |all, own| (all.0 + own[0], all.1 + own[1]));
    Some(Scattering {
        timestamp_variance_s2: jackknife(&blocks, slope)?,
        frame_to_frame_variance_m2: jackknife(&blocks, still)?,
        total_variance_m2: jackknife(&blocks, whole)?,
        mean_square_speed: squares / count,
        blocks: blocks.len(),
    })
}

/// Frames that are missing from an even sequence or repeated, by blocks of time.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameLosses {
    /// Seconds and number of all intervals, seconds and number of those of about one period, and repeated frames.
    blocks: Vec<[f64; 5]>,
    /// Standard error of the median interval, in periods: it is the middle of the intervals of about one period.
    doubt: f64,
}

/// Fraction of the frames that were lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LostFraction {
    /// The fraction; below zero by chance where no frame is lost.
    pub fraction: Estimate,
    /// Number of blocks behind the estimate.
    pub blocks: usize,
}

impl FrameLosses {
    /// Losses of frames taken at `times` (s, in the order of arrival), some of which only repeat
    /// the one before.
    ///
    /// Jitter moves time from one interval to the next and removes none, for any distribution. It
    /// is as often early as late, like the difference of two equal errors. So the mean of the
    /// intervals near the median is the period of the camera, and the mean of all exceeds it by the
    /// lost frames. A much longer interval is a pause of the recording.
    #[must_use]
    pub fn new(times: &[f64], repeated: &[bool], block: usize) -> Option<Self> {
        let intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let period = median(&intervals)?;
        if period <= 0.0 {
            return None;
        }
        let spread = half_central_spread(&intervals)?;
        let doubt = MEDIAN_ERROR * spread / (intervals.len() as f64).sqrt() / period;
        let sums = |intervals: &[(f64, bool)]| {
            intervals.iter().filter(|(own, _)| own.abs() < PAUSE_PERIODS * period).fold(
                [0.0; 5],
                |[all, count, single, singles, again], (own, repeated)| {
                    let is_single = (own - period).abs() < 0.5 * period;
                    let weight = f64::from(u8::from(is_single));
                    let again = again + f64::from(u8::from(*repeated));
                    [all + own, count + 1.0, single + weight * own, singles + weight, again]
                },
            )
        };
        let intervals: Vec<(f64, bool)> =
            intervals.into_iter().zip(repeated.iter().skip(1).copied()).collect();
        Some(Self { blocks: intervals.chunks(block.max(1)).map(sums).collect(), doubt })
    }

    /// Fraction of frames lost in all of `parts`; `None` for too few frames.
    #[must_use]
    pub fn fraction(parts: &[&Self]) -> Option<LostFraction> {
        let blocks: Vec<[f64; 5]> = parts.iter().flat_map(|part| part.blocks.clone()).collect();
        let lost = |[all, count, single, singles, again]: &[f64; 5]| {
            let period = single / singles;
            1.0 - (count - again) * period / all
        };
        let found = jackknife(&blocks, lost)?;
        let doubts = parts.iter().map(|part| part.doubt.powi(2)).sum::<f64>().sqrt();
        let doubt = doubts / parts.len().max(1) as f64;
        let standard_error = found.standard_error.hypot(doubt);
        let fraction = Estimate { standard_error, ..found };
        Some(LostFraction { fraction, blocks: blocks.len() })
    }
}

/// Step of the grid on which `positions` (m) lie; 0 if they lie on no grid. `t` is the root of
/// twice the Rayleigh statistic of the differences on that grid.
///
/// Differences of neighbours are whole multiples of the step, and so are the differences between
/// these, in order of magnitude. Several of both are tried as the step, each refined by ever larger
/// differences. The largest step that fits nearly all differences is chosen.
#[must_use]
pub fn encoder_quantisation(positions: &[f64]) -> Option<NoiseFinding> {
    /// Differences below this are rounding (m).
    const ROUNDING_M: f64 = 1e-9;
    const FEWEST: usize = 30;
    let ordered = |differences: &mut dyn Iterator<Item = f64>| {
        let mut kept: Vec<f64> = differences.filter(|size| ROUNDING_M < *size).collect();
        kept.sort_by(f64::total_cmp);
        kept
    };
    let steps = ordered(&mut positions.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
    if steps.len() < FEWEST {
        return None;
    }
    let gaps = ordered(&mut steps.windows(2).map(|pair| pair[1] - pair[0]));
    let some = |of: &[f64], shares: &[f64]| -> Vec<f64> {
        let at = |share: &f64| of.get((share * of.len().saturating_sub(1) as f64) as usize);
        shares.iter().filter_map(at).copied().collect()
    };
    let mut guesses = some(&steps, &[0.0, 0.005, 0.02, 0.05, 0.1, 0.25, 0.5]);
    guesses.extend(some(&gaps, &[0.1, 0.25, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99]));
    let grids: Vec<Grid> = guesses
        .into_iter()
        .map(|guess| on_grid(&steps, guess))
        .filter(|grid| FEWEST.max(steps.len() / 10) <= grid.count)
        .collect();
    let best = grids
        .iter()
        .filter(|grid| grid.is_one())
        .max_by(|a, b| a.step.total_cmp(&b.step))
        .or_else(|| grids.iter().max_by(|a, b| a.coherence.total_cmp(&b.coherence)))?;
    Some(NoiseFinding {
        value: if best.is_one() { best.step } else { 0.0 },
        standard_error: best.error,
        t: (2.0 * best.count as f64).sqrt() * best.coherence,
        blocks: best.count,
    })
}

/// Grid with the quality of its fit to the differences.
struct Grid {
    step: f64,
    error: f64,
    /// Length of the mean phasor of the differences on the grid; those within its first half step
    /// count against it.
    coherence: f64,
    /// Number of differences that were used.
    count: usize,
    /// Fraction of them whose multiple of the step is not one of the two most frequent.
    others: f64,
}

impl Grid {
    /// Return whether it is a grid. Differences of one or two magnitudes, as at constant speeds,
    /// make no grid.
    fn is_one(&self) -> bool {
        0.9 < self.coherence && 0.02 < self.others
    }
}

/// Grid near `guess` that fits `steps` (in order of magnitude) best. A difference is used while the
/// error of the step so far leaves its multiple certain.
fn on_grid(steps: &[f64], guess: f64) -> Grid {
    const KNOWN_TO: f64 = 0.02;
    let (mut step, mut weight, mut moment, mut squares) = (guess, 0.0_f64, 0.0, 0.0);
    let (mut cosine, mut sine) = (0.0, 0.0);
    let mut seen: Vec<f64> = Vec::with_capacity(steps.len());
    for size in steps {
        let multiple = (size / step).round();
        if 0.2 < multiple * KNOWN_TO / (1.0 + weight).sqrt() {
            break;
        }
        seen.push(multiple);
        if multiple < 1.0 {
            cosine -= 1.0;
            continue;
        }
        let (s, c) = (TAU * size / step).sin_cos();
        (cosine, sine) = (cosine + c, sine + s);
        squares += (size - multiple * step).powi(2);
        weight += multiple * multiple;
        moment += multiple * size;
        step = moment / weight;
    }
    let n = seen.len().max(1) as f64;
    let mut frequent: Vec<usize> =
        seen.chunk_by(|a, b| a == b).filter(|same| 1.0 <= same[0]).map(<[f64]>::len).collect();
    frequent.sort_unstable_by(|a, b| b.cmp(a));
    let others = frequent.iter().skip(2).sum::<usize>() as f64 / n;
    Grid {
        step,
        error: (squares / n / weight.max(1.0)).sqrt(),
        coherence: cosine.max(0.0).hypot(sine) / n,
        count: seen.len(),
        others,
    }
}

#[cfg(test)]
mod tests;
