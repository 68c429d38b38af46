//! Loss of one sample and its derivatives.
//!
//! Schulman et al., "Proximal Policy Optimization Algorithms" (2017), equation 7, with ratio
//! `rho = p(a) / p_old(a)`, advantage `A`, value `v`, target `R` and clip `c`:
//!
//! ```text
//! L = -min(rho A, clamp(rho, 1 - c, 1 + c) A) + value_coef l_v - entropy_coef H + bounds_coef b
//! ```
//!
//! `l_v` is half the squared error `(v - R)^2`, or the larger of it and of
//! `(v_old + clamp(v - v_old, -c, c) - R)^2 / 2`. `b` is the squared excess of each mean over 1.1 in
//! magnitude (rl_games, `a2c_continuous.py`, `bound_loss`). Early in training, `imitation_coef m` is
//! added: `m` is half the squared difference of the means from a demonstrated action. The loss of a
//! minibatch is the mean. The entropy does not depend on the sample and is added once per minibatch.

use super::{Gaussian, PpoSettings, ValueLoss};
use crate::nn::MAX_OUTPUTS;

/// Magnitude of a mean up to which the bounds loss is zero.
const SOFT_BOUND: f32 = 1.1;

/// Constants of a minibatch.
#[derive(Debug, Clone, Copy)]
pub(super) struct LossTerms {
    pub(super) clip_coef: f32,
    pub(super) value_loss: ValueLoss,
    pub(super) value_coef: f32,
    pub(super) bounds_coef: f32,
    pub(super) imitation_coef: f32,
    /// Current policy.
    pub(super) new: Gaussian,
    /// Policy that acted.
    pub(super) old: Gaussian,
    /// Normalized advantage: `(A - advantage_mean) * advantage_scale`.
    pub(super) advantage_mean: f32,
    pub(super) advantage_scale: f32,
    /// Inverse number of samples in the minibatch.
    pub(super) weight: f32,
}

impl LossTerms {
    pub(super) fn new(settings: &PpoSettings, new: Gaussian, old: Gaussian) -> Self {
        Self {
            clip_coef: settings.clip_coef,
            value_loss: settings.value_loss,
            value_coef: settings.value_coef,
            bounds_coef: settings.bounds_coef,
            imitation_coef: 0.0,
            new,
            old,
            advantage_mean: 0.0,
            advantage_scale: 1.0,
            weight: 1.0,
        }
    }
}

/// One sample as recorded when the policy acted; values are in the critic's own unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The first ones are used, as many as the policy has actions; so for the means.
    pub(super) actions: [f32; MAX_OUTPUTS],
    pub(super) old_means: [f32; MAX_OUTPUTS],
    pub(super) old_log_probability: f32,
    pub(super) advantage: f32,
    pub(super) target: f32,
    pub(super) old_value: f32,
    pub(super) demonstration: Option<[f32; MAX_OUTPUTS]>,
}

/// Derivatives of the minibatch's loss with respect to one sample's outputs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slopes {
    pub(super) means: [f32; MAX_OUTPUTS],
    pub(super) value: f32,
}

/// Sums over samples, in double precision.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct LossSums {
    /// Policy loss.
    pub(super) policy: f64,
    /// Value loss, without its coefficient.
    pub(super) value: f64,
    /// Bounds loss, without its coefficient.
    pub(super) bounds: f64,
    /// Imitation loss, without its coefficient.
    pub(super) imitation: f64,
    /// KL divergence from the policy that acted (nat).
    pub(super) divergence: f64,
    /// Number of samples with a ratio outside the clip range.
    pub(super) clipped: f64,
    /// Derivative of the minibatch's loss with respect to the log standard deviations.
    pub(super) log_deviation_slopes: [f64; MAX_OUTPUTS],
}

impl LossSums {
    pub(super) fn add(&mut self, other: &Self) {
        self.policy += other.policy;
        self.value += other.value;
        self.bounds += other.bounds;
        self.imitation += other.imitation;
        self.divergence += other.divergence;
        self.clipped += other.clipped;
        for (sum, slope) in self.log_deviation_slopes.iter_mut().zip(other.log_deviation_slopes) {
            *sum += slope;
        }
    }
}

/// Add the sample's losses to `sums` and return its derivatives.
#[inline]
pub(super) fn sample_loss(
    terms: &LossTerms,
    sample: Sample,
    means: &[f32],
    value: f32,
    sums: &mut LossSums,
) -> Slopes {
    let mut slopes = Slopes { means: [0.0; MAX_OUTPUTS], value: 0.0 };
    let mut scores = [0.0; MAX_OUTPUTS];
    let mut squares = 0.0;
    for (action, (a, mean)) in sample.actions.iter().zip(means).enumerate() {
        scores[action] = terms.new.score(action, *a, *mean);
        squares += scores[action] * scores[action];
    }
    let log_slope = policy_loss(terms, sample, terms.new.log_probability_of(squares), sums);
    for (action, mean) in means.iter().enumerate() {
        let excess = mean - mean.clamp(-SOFT_BOUND, SOFT_BOUND);
        sums.bounds += f64::from(excess * excess);
        slopes.means[action] = log_slope * scores[action] * terms.new.inverse_deviation(action)
            + 2.0 * terms.bounds_coef * terms.weight * excess;
        sums.log_deviation_slopes[action] +=
            f64::from(log_slope * (scores[action] * scores[action] - 1.0));
    }
    if let Some(demonstration) = sample.demonstration {
        for ((slope, mean), action) in slopes.means.iter_mut().zip(means).zip(demonstration) {
            let difference = mean - action;
            sums.imitation += f64::from(0.5 * difference * difference);
            *slope += terms.imitation_coef * terms.weight * difference;
        }
    }
    sums.divergence += f64::from(terms.new.divergence_from(&terms.old, &sample.old_means, means));
    slopes.value = terms.value_coef * terms.weight * value_loss(terms, sample, value, sums);
    slopes
}

/// Clipped objective; returns its derivative with respect to the log-probability.
#[inline]
fn policy_loss(
    terms: &LossTerms,
    sample: Sample,
    log_probability: f32,
    sums: &mut LossSums,
) -> f32 {
    let advantage = (sample.advantage - terms.advantage_mean) * terms.advantage_scale;
    let ratio = (log_probability - sample.old_log_probability).exp();
    let held = ratio.clamp(1.0 - terms.clip_coef, 1.0 + terms.clip_coef);
    let (free, clipped) = (ratio * advantage, held * advantage);
    sums.policy -= f64::from(free.min(clipped));
    sums.clipped += f64::from(u8::from(terms.clip_coef < (ratio - 1.0).abs()));
    // The loss is flat if the clipped term is the smaller one.
    if clipped < free { 0.0 } else { -free * terms.weight }
}

/// Critic's loss; returns its derivative with respect to the value.
#[inline]
fn value_loss(terms: &LossTerms, sample: Sample, value: f32, sums: &mut LossSums) -> f32 {
    let error = value - sample.target;
    let moved = value - sample.old_value;
    let held = sample.old_value + moved.clamp(-terms.clip_coef, terms.clip_coef) - sample.target;
    let left = terms.value_loss == ValueLoss::Clipped && terms.clip_coef < moved.abs();
    let flat = left && error * error < held * held;
    let counted = if flat { held } else { error };
    sums.value += 0.5 * f64::from(counted * counted);
    // The clipped value does not depend on the value.
    if flat { 0.0 } else { error }
}
