//! Action distribution of the policy: independent normal distributions with state-independent
//! standard deviations.
//!
//! With `z = (a - mu) / sigma` and `d` actions:
//! `ln p(a) = -sum(z^2) / 2 - sum(ln sigma) - d ln(2 pi) / 2`,
//! entropy `sum(ln sigma) + d (1 + ln(2 pi)) / 2`, and between an old policy `o` and this one
//! `KL(o || this) = sum(ln(sigma / sigma_o) + (sigma_o^2 + (mu_o - mu)^2) / (2 sigma^2) - 1/2)`.

use crate::nn::MAX_OUTPUTS;

/// ln(2 pi)
const LN_2_PI: f32 = 1.837_877_1;

/// Log standard deviations, with derived values for many samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    actions: usize,
    /// ln sigma
    logarithms: [f32; MAX_OUTPUTS],
    /// sigma
    deviation: [f32; MAX_OUTPUTS],
    /// 1 / sigma
    inverse: [f32; MAX_OUTPUTS],
    log_deviation_sum: f32,
}

impl Gaussian {
    /// Distribution with 1 to 4 log standard deviations.
    #[must_use]
    pub fn new(log_deviations: &[f32]) -> Self {
        let mut gaussian = Self {
            actions: log_deviations.len(),
            logarithms: [0.0; MAX_OUTPUTS],
            deviation: [1.0; MAX_OUTPUTS],
            inverse: [1.0; MAX_OUTPUTS],
            log_deviation_sum: log_deviations.iter().sum(),
        };
        for (action, logarithm) in log_deviations.iter().enumerate() {
            gaussian.logarithms[action] = *logarithm;
            gaussian.deviation[action] = logarithm.exp();
            gaussian.inverse[action] = (-logarithm).exp();
        }
        gaussian
    }

    /// Number of actions.
    #[must_use]
    pub fn actions(&self) -> usize {
        self.actions
    }

    /// Natural logarithms of the standard deviations.
    #[must_use]
    pub fn log_deviations(&self) -> &[f32] {
        &self.logarithms[..self.actions]
    }

    /// Standard deviation of one action.
    #[must_use]
    pub fn deviation(&self, action: usize) -> f32 {
        self.deviation[action]
    }

    /// Inverse standard deviation of one action.
    #[inline]
    pub(super) fn inverse_deviation(&self, action: usize) -> f32 {
        self.inverse[action]
    }

    /// Standard score `(a - mu) / sigma` of one action.
    #[inline]
    pub(super) fn score(&self, action: usize, value: f32, mean: f32) -> f32 {
        (value - mean) * self.inverse[action]
    }

    /// Log density from the sum of the squared standard scores.
    #[inline]
    pub(super) fn log_probability_of(&self, squared_scores: f32) -> f32 {
        -0.5 * squared_scores - self.log_deviation_sum - 0.5 * LN_2_PI * self.actions as f32
    }

    /// Log density (nat) at `values` around `means`.
    #[must_use]
    pub fn log_probability(&self, values: &[f32], means: &[f32]) -> f32 {
        let squares = values.iter().zip(means).enumerate();
        self.log_probability_of(squares.map(|(i, (a, mu))| self.score(i, *a, *mu).powi(2)).sum())
    }

    /// Entropy (nat); negative for small standard deviations.
    #[must_use]
    pub fn entropy(&self) -> f32 {
        self.log_deviation_sum + 0.5 * (1.0 + LN_2_PI) * self.actions as f32
    }

    /// KL divergence (nat) from `old` around `old_means` to this distribution around `means`.
    #[must_use]
    #[inline]
    pub fn divergence_from(&self, old: &Self, old_means: &[f32], means: &[f32]) -> f32 {
        let mut sum = self.log_deviation_sum - old.log_deviation_sum;
        for (action, (old_mean, mean)) in old_means.iter().zip(means).enumerate() {
            let spread = old.deviation[action] * self.inverse[action];
            let shift = (old_mean - mean) * self.inverse[action];
            sum += 0.5 * (spread * spread + shift * shift - 1.0);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integral over the plane by a grid, as wide and fine as the integrands below need.
    fn integrate(f: impl Fn([f32; 2]) -> f64) -> f64 {
        const STEP: f64 = 0.02;
        let grid = || (-400..400).map(|i| STEP * f64::from(i));
        grid().map(|x| grid().map(|y| f([x as f32, y as f32])).sum::<f64>()).sum::<f64>()
            * STEP
            * STEP
    }

    #[test]
    fn closed_forms_agree_with_integrals() {
        let (new, old) = (Gaussian::new(&[-0.5, 0.2]), Gaussian::new(&[-0.3, -0.1]));
        let (mean, old_mean) = ([0.3, -0.2], [0.1, 0.25]);
        let log = |gaussian: &Gaussian, at: [f32; 2], mean| {
            f64::from(gaussian.log_probability(&at, mean))
        };
        let mass = integrate(|at| log(&new, at, &mean).exp());
        let entropy = integrate(|at| {
            let log = log(&new, at, &mean);
            -log * log.exp()
        });
        let divergence = integrate(|at| {
            let log_old = log(&old, at, &old_mean);
            log_old.exp() * (log_old - log(&new, at, &mean))
        });
        assert!((mass - 1.0).abs() < 1e-5, "{mass}");
        assert!((entropy - f64::from(new.entropy())).abs() < 1e-5, "{entropy}");
        let found = f64::from(new.divergence_from(&old, &old_mean, &mean));
        assert!((divergence - found).abs() < 1e-5, "{divergence} {found}");
        assert!(new.divergence_from(&new, &mean, &mean).abs() < 1e-6);
    }

    #[test]
    fn one_standard_normal_is_the_textbooks() {
        let gaussian = Gaussian::new(&[0.0]);
        // 1 / sqrt(2 pi e) at one standard deviation, entropy ln(2 pi e) / 2.
        assert!((gaussian.log_probability(&[1.0], &[0.0]).exp() - 0.241_970_72).abs() < 1e-7);
        assert!((gaussian.entropy() - 1.418_938_5).abs() < 1e-6);
    }
}
