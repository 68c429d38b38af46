//! Parameters that need a global search, because the cost has many local minima in them.

use super::{backlash::BACKLASH, ripple_motor::RIPPLE_MOTOR};
use crate::{effects::Effect, stats::quantile};
use std::{f64::consts::TAU, iter::successors};

/// Global search over one parameter of an effect, in the residual of a twin.
#[derive(Debug, Clone, Copy)]
pub struct Scan {
    /// Index of the parameter.
    pub parameter: usize,
    /// Function from residuals over positions to start values, the best first; `longest` is the longest period, in
    /// ranges of the position.
    pub propose: fn(series: &[PhaseSeries], longest: f64) -> Vec<f64>,
}

/// Effects with a scanned parameter; the proposals replace that parameter in each probe.
pub static SCANS: &[(&Effect, Scan)] = &[(&RIPPLE_MOTOR, Scan { parameter: 2, propose: periods })];

/// Effects whose loss has several minima in their magnitude. The load strikes the end of a gap of width b, crossed with
/// an acceleration a, after sqrt(2 b / a): with another width, the simulated impact is earlier or later than the measured
/// one, and leaves more than none.
static SEVERAL_MINIMA: &[&Effect] = &[&BACKLASH];

/// Ratio of neighbouring magnitudes that are tried for such an effect: an impact moves by less than 1 ms where the gap
/// is crossed in 16 ms.
const MAGNITUDE_RATIO: f64 = 1.12;

/// Magnitudes from which `effect` is fitted by the least loss, from the smallest probe to the largest plausible one;
/// none where its loss has one minimum.
#[must_use]
pub fn magnitudes(effect: &Effect) -> Vec<f64> {
    if !SEVERAL_MINIMA.iter().any(|own| own.name == effect.name) {
        return Vec::new();
    }
    let (_, largest) = effect.parameters[0].plausible;
    let smallest = effect.probes.iter().map(|probe| probe[0]).fold(largest, f64::min);
    let next = |magnitude: &f64| Some(MAGNITUDE_RATIO * magnitude);
    successors(Some(smallest), next).take_while(|magnitude| *magnitude <= largest).collect()
}

/// Frequencies per spectral line width, so that no line falls between two of them.
const PER_LINE: f64 = 4.0;
/// Fewest samples of a periodogram.
const LEAST_SAMPLES: usize = 8;
/// Largest number of frequencies.
const MOST_FREQUENCIES: usize = 4000;
/// Fraction of the travel that a sample must move to count.
const MOVING: f64 = 1e-4;
/// Quantile of the steps between samples that counts as slow.
const SLOW: f64 = 0.02;
/// Largest number of proposed periods: by power, and as many again by power over the background.
const PROPOSALS: usize = 3;
/// Ratio of the frequencies of a line and of the ends of its background: the residual of a wrong base model is red, so a
/// line is compared with its octave.
const BACKGROUND: f64 = std::f64::consts::SQRT_2;

/// Residual of one signal over the position on which its phase depends, at the same samples.
#[derive(Debug, Clone)]
pub struct PhaseSeries {
    /// Position.
    pub position: Vec<f64>,
    /// Residual.
    pub residual: Vec<f64>,
    /// Whether each sample is an average over its neighbours, so that it shows no period shorter than its steps.
    pub is_filtered: bool,
}

impl PhaseSeries {
    /// The moves forward and backward of this series, each by itself: the response of a loop to a wave turns its phase
    /// with the direction.
    #[must_use]
    pub fn by_direction(self) -> [Self; 2] {
        let part = |sign: f64| {
            let kept: Vec<usize> = (1..self.position.len().min(self.residual.len()))
                .filter(|k| 0.0 < sign * (self.position[*k] - self.position[*k - 1]))
                .collect();
            Self {
                position: kept.iter().map(|k| self.position[*k]).collect(),
                residual: kept.iter().map(|k| self.residual[*k]).collect(),
                is_filtered: self.is_filtered,
            }
        };
        [part(1.0), part(-1.0)]
    }
}

/// Periods of the residuals along the positions of `series`, the strongest first, in the unit of the position.
///
/// Lomb-Scargle periodogram with a floating mean (Lomb 1976, Scargle 1982): least squares of a sine, a
/// cosine and a constant at every frequency, summed over the series as fractions of their squares. The range is from
/// `longest` travels to the shortest period that the samples resolve where the motion is slow. Golden-section search
/// refines the strongest lines that are not neighbours. Empty where the position does not change.
#[must_use]
pub fn periods(series: &[PhaseSeries], longest: f64) -> Vec<f64> {
    let waves: Vec<Samples> = series.iter().filter_map(Samples::of).collect();
    let travel = waves.iter().map(|own| own.travel).fold(0.0, f64::max);
    let slow = waves.iter().map(|own| own.slow_step).fold(f64::INFINITY, f64::min);
    if waves.is_empty() {
        return Vec::new();
    }
    let step = 1.0 / (PER_LINE * travel);
    let first = 1.0 / (longest * travel);
    let count = ((0.5 / slow - first) / step) as usize;
    let count = count.clamp(1, MOST_FREQUENCIES);
    let mut powers = vec![0.0; count];
    for own in &waves {
        own.add_powers(first, step, &mut powers);
    }
    let refine = |index: usize| {
        let middle = first + step * index as f64;
        let height = |frequency| waves.iter().map(|own| own.power(frequency)).sum();
        1.0 / highest(height, middle - 0.9 * step, middle + step)
    };
    let mut lines = strongest(&powers);
    let standing_out = strongest(&over_background(&powers));
    lines.extend(
        standing_out.into_iter().filter(|line| is_apart(*line, &lines)).collect::<Vec<_>>(),
    );
    lines.into_iter().map(refine).collect()
}

/// Indices of the largest `powers`, the largest first, at least one line width apart: next to a line with a
/// distorted phase, its neighbour may be the true one.
fn strongest(powers: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..powers.len()).collect();
    order.sort_by(|a, b| powers[*b].total_cmp(&powers[*a]));
    let mut lines: Vec<usize> = Vec::new();
    for index in order {
        if lines.len() == PROPOSALS {
            break;
        }
        if is_apart(index, &lines) {
            lines.push(index);
        }
    }
    lines
}

/// Return whether a frequency is at least one line width from `lines`.
fn is_apart(index: usize, lines: &[usize]) -> bool {
    lines.iter().all(|line| PER_LINE <= line.abs_diff(index) as f64)
}

/// Powers over the median power of their octave.
fn over_background(powers: &[f64]) -> Vec<f64> {
    let ratio = |index: usize| {
        let place = 1.0 + index as f64;
        let (from, to) = ((place / BACKGROUND) as usize, (place * BACKGROUND) as usize);
        let octave = &powers[from.min(index)..to.clamp(index + 1, powers.len())];
        let background = quantile(octave, 0.5).unwrap_or(0.0);
        if 0.0 < background { powers[index] / background } else { 0.0 }
    };
    (0..powers.len()).map(ratio).collect()
}

/// Distance between neighbouring samples where the motion is slow (m), which limits the resolved period.
fn slow_step(position: &[f64], travel: f64) -> f64 {
    let steps: Vec<f64> = position
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|step| MOVING * travel < *step)
        .collect();
    quantile(&steps, SLOW).unwrap_or(travel)
}

/// Largest fraction of a period between a sample and its neighbours that shows the period: half of one is the limit
/// of any sampling.
const RESOLVED: f64 = 0.4;

/// Samples of a periodogram.
struct Samples {
    position: Vec<f64>,
    /// Residual less its mean.
    residual: Vec<f64>,
    /// Distance to the farther of the neighbours; zero where that does not matter.
    step: Vec<f64>,
    /// Sum of the squares of the residual.
    square: f64,
    travel: f64,
    slow_step: f64,
}

/// Sums of a least-squares fit of a constant, a sine and a cosine over the samples that resolve a frequency.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f64,
    s: f64,
    c: f64,
    ss: f64,
    sc: f64,
    y: f64,
    ys: f64,
    yc: f64,
}

impl Sums {
    fn add(&mut self, weight: f64, sine: f64, cosine: f64, residual: f64) {
        let (s, c, y) = (weight * sine, weight * cosine, weight * residual);
        self.n += weight;
        self.s += s;
        self.c += c;
        self.ss += s * sine;
        self.sc += s * cosine;
        self.y += y;
        self.ys += y * sine;
        self.yc += y * cosine;
    }

    /// Sum of squares that the sinusoid explains beyond the constant.
    fn power(&self) -> f64 {
        let Self { n, s, c, ss, sc, y, ys, yc } = *self;
        if n < LEAST_SAMPLES as f64 {
            return 0.0;
        }
        let (ys, yc) = (ys - y * s / n, yc - y * c / n);
        let (ss, cc, sc) = (ss - s * s / n, (n - ss) - c * c / n, sc - s * c / n);
        let determinant = ss * cc - sc * sc;
        if determinant <= 1e-9 * ss * cc {
            return 0.0;
        }
        (ys * ys * cc - 2.0 * ys * yc * sc + yc * yc * ss) / determinant
    }
}

impl Samples {
    /// The finite samples of `series`; `None` where there are too few, or nothing moves.
    fn of(series: &PhaseSeries) -> Option<Self> {
        let (position, mut residual): (Vec<f64>, Vec<f64>) = series
            .position
            .iter()
            .zip(&series.residual)
            .filter(|(q, r)| q.is_finite() && r.is_finite())
            .map(|(q, r)| (*q, *r))
            .unzip();
        let low = position.iter().copied().fold(f64::INFINITY, f64::min);
        let high = position.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let travel = high - low;
        if position.len() < LEAST_SAMPLES || travel <= 0.0 {
            return None;
        }
        let mean = residual.iter().sum::<f64>() / residual.len() as f64;
        residual.iter_mut().for_each(|own| *own -= mean);
        let square = residual.iter().map(|own| own * own).sum::<f64>();
        let step = |k: usize| {
            let beside = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
            let beside = beside.filter_map(|other| position.get(other));
            beside.map(|other| (other - position[k]).abs()).fold(0.0, f64::max)
        };
        let step = match series.is_filtered {
            true => (0..position.len()).map(step).collect(),
            false => vec![0.0; position.len()],
        };
        let slow_step = slow_step(&position, travel);
        (0.0 < square).then_some(Self { position, residual, step, square, travel, slow_step })
    }

    /// Fraction of the square that a sinusoid of `frequency` explains, over the samples that resolve it.
    fn power(&self, frequency: f64) -> f64 {
        let mut sums = Sums::default();
        for ((q, r), step) in self.position.iter().zip(&self.residual).zip(&self.step) {
            if step * frequency <= RESOLVED {
                let (sine, cosine) = (TAU * frequency * q).sin_cos();
                sums.add(1.0, sine, cosine, *r);
            }
        }
        sums.power() / self.square
    }

    /// Adds the power at `first`, `first + step` and so on to `powers`. The wave of each sample is turned on by its
    /// step, which costs no sine.
    fn add_powers(&self, first: f64, step: f64, powers: &mut [f64]) {
        let wave = |frequency: f64| {
            self.position.iter().map(move |q| (TAU * frequency * q).sin_cos()).collect::<Vec<_>>()
        };
        let (mut waves, turns) = (wave(first), wave(step));
        for (index, power) in powers.iter_mut().enumerate() {
            let frequency = first + step * index as f64;
            let mut sums = Sums::default();
            for (k, (own, (sine, cosine))) in waves.iter_mut().zip(&turns).enumerate() {
                let weight = f64::from(u8::from(self.step[k] * frequency <= RESOLVED));
                sums.add(weight, own.0, own.1, self.residual[k]);
                *own = (own.0 * cosine + own.1 * sine, own.1 * cosine - own.0 * sine);
            }
            *power += sums.power() / self.square;
        }
    }
}

/// Maximum of the unimodal function `height` between `low` and `high`, by golden-section search, to a
/// ten-thousandth of their distance: a fit follows.
fn highest(height: impl Fn(f64) -> f64, low: f64, high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    const STEPS: usize = 20;
    let at = |place: f64| (place, height(place));
    let (mut low, mut high) = (low, high);
    let mut left = at(high - GOLDEN * (high - low));
    let mut right = at(low + GOLDEN * (high - low));
    for _ in 0..STEPS {
        if left.1 < right.1 {
            (low, left) = (left.0, right);
            right = at(low + GOLDEN * (high - low));
        } else {
            (high, right) = (right.0, left);
            left = at(high - GOLDEN * (high - low));
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filtered(position: &[f64], residual: &[f64]) -> PhaseSeries {
        PhaseSeries { position: position.to_vec(), residual: residual.to_vec(), is_filtered: true }
    }

    #[test]
    fn a_wave_is_found_whose_phase_turns_with_the_direction() {
        // Every step is longer than the period, and the wave of the way back is the negative of that of the way out.
        let period = 0.0029;
        let position: Vec<f64> =
            (0..6000).map(|k| 0.15 * (1.0 - (k as f64 * 0.0371).cos())).collect();
        let direction = |k: usize| (k as f64 * 0.0371).sin().signum();
        let residual = position
            .iter()
            .enumerate()
            .map(|(k, q)| direction(k) * (TAU * q / period).cos() + ((k * 7919) % 13) as f64 / 6.0)
            .collect();
        let series = PhaseSeries { position, residual, is_filtered: false };
        let found = periods(&series.by_direction(), 0.5);
        assert!((found[0] / period - 1.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn the_period_of_a_wave_is_found_between_the_frequencies_tried() {
        let position: Vec<f64> = (0..4000).map(|k| 0.1 * (1.0 - (k as f64 * 0.01).cos())).collect();
        let residual: Vec<f64> = position
            .iter()
            .enumerate()
            .map(|(k, q)| (TAU * q / 0.00731).sin() + 3.0 * q + ((k * 7919) % 13) as f64 / 13.0)
            .collect();
        let found = periods(&[filtered(&position, &residual)], 0.5);
        assert!(found.iter().any(|period| (period / 0.00731 - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_period_shorter_than_a_fast_step_shows_where_the_motion_is_slow() {
        // Seven tenths of the samples run at 4.7 mm a step, the rest at 0.3 mm.
        let mut position = vec![0.0];
        for k in 0..3000 {
            let step = if k % 1000 < 700 { 0.0047 } else { 0.0003 };
            let up = (k / 30) % 2 == 0;
            position.push(position[k] + if up { step } else { -step });
        }
        let wave = |q: &f64| (TAU * q / 0.0025).sin();
        let residual = position.iter().map(wave).collect::<Vec<f64>>();
        let found = periods(&[filtered(&position, &residual)], 0.5);
        assert!(found.iter().any(|period| (period / 0.0025 - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_constant_position_has_no_period() {
        assert!(periods(&[filtered(&[0.1; 50], &[1.0; 50])], 0.5).is_empty());
        assert!(periods(&[filtered(&[], &[])], 0.5).is_empty());
        assert!(periods(&[], 0.5).is_empty());
    }

    #[test]
    fn magnitudes_cover_the_plausible_range_of_an_effect_with_several_minima() {
        let widths = magnitudes(&BACKLASH);
        assert_eq!(widths[0], 5e-5);
        let (_, largest) = BACKLASH.parameters[0].plausible;
        let last = widths[widths.len() - 1];
        assert!(last <= largest && largest < MAGNITUDE_RATIO * last, "{last}");
        assert!(widths.windows(2).all(|pair| (pair[1] / pair[0] - MAGNITUDE_RATIO).abs() < 1e-12));
        assert!(magnitudes(&RIPPLE_MOTOR).is_empty());
    }
}
