//! Chirp and multisine.
//!
//! Chirp: `f(t) = f0 (f1 / f0)^s(t)` with `s` rising from 0 to 1 and falling within a period. Its
//! phase, the integral of `2 pi f`, is continuous.
//!
//! Multisine: `v(t) = A sum cos(2 pi h_n t / T + phi_n)` with integers `h_n` spaced evenly in the
//! logarithm of the band. x has the even and y the odd ones, so cross-coupling shows at lines that
//! are not the axis's own. Phases: Schroeder's `-pi n (n - 1) / N` (IEEE Trans. Inf. Theory 16,
//! 1970). Then single phases are redrawn and kept where that lowers the crest factor: the lowest
//! crest factor gives most power within the speed limit.

use super::{Pattern, TrajectoryError, course::Grid};
use crate::seed::Stream;
use std::f64::consts::{PI, TAU};

/// Highest frequency as a fraction of the rate of commands.
const HIGHEST_FRACTION: f64 = 0.4;
/// Largest number of redraws of one phase, and of terms that they may cost.
const DRAWS: usize = 128;
const TERMS: usize = 2_000_000;

fn check_band(name: &'static str, f1: f64, grid: &Grid<'_>) -> Result<(), TrajectoryError> {
    let largest = HIGHEST_FRACTION * grid.rate;
    if f1 <= largest {
        return Ok(());
    }
    Err(TrajectoryError::FrequencyTooHigh { pattern: name, value: f1, rate_hz: grid.rate, largest })
}

/// Return the speeds (m/s) of a chirp.
pub(super) fn chirp(pattern: &Pattern, grid: &Grid<'_>) -> Result<Vec<f64>, TrajectoryError> {
    let Pattern::Chirp { f0_hz, f1_hz, speed_m_per_s, period_s, .. } = *pattern else {
        return Ok(Vec::new());
    };
    check_band(pattern.name(), f1_hz, grid)?;
    let half = (period_s / 2.0).max(grid.dt());
    let growth = (f1_hz / f0_hz).ln();
    // Phase in turns since the start of a rise of length `half`.
    let rise = |t: f64| f0_hz * half / growth * ((growth * t / half).exp() - 1.0);
    let turns = |t: f64| {
        let (whole, rest) = ((t / (2.0 * half)).floor(), t % (2.0 * half));
        let within =
            if rest < half { rise(rest) } else { 2.0 * rise(half) - rise(2.0 * half - rest) };
        whole * 2.0 * rise(half) + within
    };
    let speed = |index: usize| speed_m_per_s * (TAU * turns(index as f64 * grid.dt())).sin();
    Ok((0..grid.samples).map(speed).collect())
}

/// Return the velocities (m/s) of a multisine on both axes.
pub(super) fn multisine(
    pattern: &Pattern,
    grid: &Grid<'_>,
) -> Result<Vec<[f64; 2]>, TrajectoryError> {
    let Pattern::Multisine { lines, f0_hz, f1_hz, speed_m_per_s, period_s } = *pattern else {
        return Ok(Vec::new());
    };
    check_band(pattern.name(), f1_hz, grid)?;
    let period = ((period_s * grid.rate).round() as usize).max(2);
    let all = harmonics(lines, [f0_hz, f1_hz], period as f64 / grid.rate)?;
    let mut stream = Stream::new(grid.seed, "multisine");
    let axes = [0, 1].map(|axis| {
        let own: Vec<usize> = all.iter().copied().skip(axis).step_by(2).collect();
        one_period(&own, period, speed_m_per_s, &mut stream)
    });
    Ok((0..grid.samples).map(|k| [axes[0][k % period], axes[1][k % period]]).collect())
}

/// Return `2 lines` integer numbers of turns in `period` (s), spread over the band (Hz).
pub(super) fn harmonics(
    lines: u32,
    [f0, f1]: [f64; 2],
    period: f64,
) -> Result<Vec<usize>, TrajectoryError> {
    const ROUNDING: f64 = 1e-9;
    let lowest = ((f0 * period - ROUNDING).ceil().max(1.0)) as usize;
    let highest = (f1 * period + ROUNDING).floor() as usize;
    let count = 2 * lines as usize;
    let room = (highest + 1).saturating_sub(lowest);
    if room < count {
        return Err(TrajectoryError::TooManyLines { lines, largest: (room / 2) as u32 });
    }
    let ratio = highest as f64 / lowest as f64;
    let mut chosen = Vec::with_capacity(count);
    let mut next = lowest;
    for index in 0..count {
        let even = lowest as f64 * ratio.powf(index as f64 / (count - 1) as f64);
        let latest = highest + 1 - (count - index);
        let harmonic = (even.round() as usize).clamp(next, latest);
        chosen.push(harmonic);
        next = harmonic + 1;
    }
    Ok(chosen)
}

/// Return one period (samples) of equal sines at `harmonics` with a peak of `peak` (m/s).
fn one_period(harmonics: &[usize], period: usize, peak: f64, stream: &mut Stream) -> Vec<f64> {
    let count = harmonics.len() as f64;
    let mut phases: Vec<f64> =
        (0..harmonics.len()).map(|n| -PI * n as f64 * (n as f64 + 1.0) / count).collect();
    let mut best = sum(harmonics, &phases, period);
    for draw in 0..DRAWS.min(TERMS / (period * harmonics.len())) {
        let changed = draw % harmonics.len();
        let before = phases[changed];
        phases[changed] = TAU * f64::from(stream.uniform_f32(0.0, 1.0));
        let drawn = sum(harmonics, &phases, period);
        if peak_of(&drawn) < peak_of(&best) {
            best = drawn;
        } else {
            phases[changed] = before;
        }
    }
    let scale = peak / peak_of(&best);
    best.into_iter().map(|value| value * scale).collect()
}

fn sum(harmonics: &[usize], phases: &[f64], period: usize) -> Vec<f64> {
    let at = |k: usize| {
        let term = |(harmonic, phase): (&usize, &f64)| {
            (TAU * (harmonic * k % period) as f64 / period as f64 + phase).cos()
        };
        harmonics.iter().zip(phases).map(term).sum()
    };
    (0..period).map(at).collect()
}

fn peak_of(values: &[f64]) -> f64 {
    values.iter().fold(f64::MIN_POSITIVE, |peak, value| peak.max(value.abs()))
}
