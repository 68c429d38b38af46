//! Actor and critic: parameters, outputs, gradients and optimizer step.

use super::{
    Gaussian, NetworkLayout, PpoSettings, Spaces,
    loss::{LossSums, LossTerms, Sample, Slopes, sample_loss},
    orthogonal::{self, POLICY_GAIN, VALUE_GAIN},
};
use crate::nn::{Adam, BackwardScratch, MAX_OUTPUTS, Tape, Trainer, TrainerState};

/// Epsilon that PyTorch's `clip_grad_norm_` adds to the norm before dividing.
const NORM_EPSILON: f64 = 1e-6;

/// Both networks and the standard deviations.
#[derive(Debug, Clone)]
pub(super) struct Model {
    actions: usize,
    /// Network of the means; with a shared trunk its last output is the value.
    policy: Trainer,
    /// Network of the value, if it has its own.
    critic: Option<Trainer>,
    deviations: Deviations,
}

/// Log standard deviations of the policy with their Adam moments.
#[derive(Debug, Clone, PartialEq)]
pub struct Deviations {
    /// Natural logarithms of the standard deviations, `[actions]`.
    pub logarithms: Vec<f32>,
    /// Adam's first moments, `[actions]`.
    pub moment1: Vec<f32>,
    /// Adam's second moments, `[actions]`.
    pub moment2: Vec<f32>,
}

/// Tapes and gradients of both networks; one per thread, reused.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    pub(super) policy: Tape,
    critic: Tape,
    policy_slopes: Vec<f32>,
    critic_slopes: Vec<f32>,
    back: BackwardScratch,
}

impl Model {
    /// Build networks with orthogonal weights and zero biases.
    pub(super) fn new(settings: &PpoSettings, spaces: Spaces, seed: u64) -> Self {
        let adam = Self::adam(settings);
        let make = |heads: &[orthogonal::Head], name| {
            let hidden = &settings.hidden;
            let inputs = spaces.observations;
            let source = (seed, name);
            let network = orthogonal::network(inputs, hidden, settings.activation, heads, source);
            Trainer::new(&network, adam)
        };
        let (means, value) = ((spaces.actions, POLICY_GAIN), (1, VALUE_GAIN));
        let (policy, critic) = match settings.layout {
            NetworkLayout::Separate => (make(&[means], "policy"), Some(make(&[value], "critic"))),
            NetworkLayout::Shared => (make(&[means, value], "policy"), None),
        };
        let deviations = Deviations {
            logarithms: vec![settings.initial_log_deviation; spaces.actions],
            moment1: vec![0.0; spaces.actions],
            moment2: vec![0.0; spaces.actions],
        };
        Self { actions: spaces.actions, policy, critic, deviations }
    }

    fn adam(settings: &PpoSettings) -> Adam {
        Adam { epsilon: settings.adam_epsilon, ..Adam::default() }
    }

    /// Resume from parts whose shapes match.
    pub(super) fn resume(
        settings: &PpoSettings,
        (policy, critic): (&TrainerState, Option<&TrainerState>),
        deviations: &Deviations,
    ) -> Self {
        let adam = Self::adam(settings);
        Self {
            actions: deviations.logarithms.len(),
            policy: Trainer::resume(policy, adam),
            critic: critic.map(|state| Trainer::resume(state, adam)),
            deviations: deviations.clone(),
        }
    }

    /// Policy, critic and standard deviations for resuming.
    pub(super) fn parts(&self) -> (TrainerState, Option<TrainerState>, Deviations) {
        let critic = self.critic.as_ref().map(Trainer::state);
        (self.policy.state(), critic, self.deviations.clone())
    }

    /// Network of the means, followed by the value with a shared trunk.
    pub(super) fn policy(&self) -> &Trainer {
        &self.policy
    }

    pub(super) fn gaussian(&self) -> Gaussian {
        Gaussian::new(&self.deviations.logarithms)
    }

    /// Length of the flat gradient: policy, then critic.
    pub(super) fn parameter_count(&self) -> usize {
        self.policy.parameter_count() + self.critic.as_ref().map_or(0, Trainer::parameter_count)
    }

    pub(super) fn is_finite(&self) -> bool {
        self.policy.is_finite()
            && self.critic.as_ref().is_none_or(Trainer::is_finite)
            && self.deviations.logarithms.iter().all(|value| value.is_finite())
    }

    /// Compute means and value of each normalized observation in `scratch.policy.x`.
    pub(super) fn forward(&self, scratch: &mut Scratch) {
        self.policy.forward(&mut scratch.policy);
        if let Some(critic) = &self.critic {
            scratch.critic.x.clone_from(&scratch.policy.x);
            critic.forward(&mut scratch.critic);
        }
    }

    /// Compute only the values, of the normalized observations in `scratch.policy.x`.
    pub(super) fn forward_values(&self, scratch: &mut Scratch) {
        match &self.critic {
            None => self.policy.forward(&mut scratch.policy),
            Some(critic) => {
                scratch.critic.x.clone_from(&scratch.policy.x);
                critic.forward(&mut scratch.critic);
            }
        }
    }

    /// Means after [`forward`](Self::forward), `[rows]` of `[actions]`.
    pub(super) fn means<'a>(&self, scratch: &'a Scratch) -> impl Iterator<Item = &'a [f32]> {
        let actions = self.actions;
        let outputs = self.policy.stack().outputs();
        scratch.policy.y.chunks_exact(outputs).map(move |row| &row[..actions])
    }

    /// Values after [`forward`](Self::forward), `[rows]`.
    pub(super) fn values<'a>(&self, scratch: &'a Scratch) -> impl Iterator<Item = f32> + use<'a> {
        let (values, every, first) = match &self.critic {
            None => (&scratch.policy.y, self.actions + 1, self.actions),
            Some(_) => (&scratch.critic.y, 1, 0),
        };
        values.iter().skip(first).step_by(every).copied()
    }

    /// Add losses and gradient of the samples whose observations are in `scratch.policy.x`.
    pub(super) fn accumulate(
        &self,
        terms: &LossTerms,
        samples: impl Iterator<Item = Sample>,
        (gradient, sums): (&mut [f32], &mut LossSums),
        scratch: &mut Scratch,
    ) {
        self.forward(scratch);
        self.slopes(terms, samples, sums, scratch);
        let Scratch { policy, critic, policy_slopes, critic_slopes, back } = scratch;
        let (policy_gradient, critic_gradient) =
            gradient.split_at_mut(self.policy.parameter_count());
        self.policy.accumulate(policy, policy_slopes, policy_gradient, back);
        if let Some(trainer) = &self.critic {
            trainer.accumulate(critic, critic_slopes, critic_gradient, back);
        }
    }

    /// Derivatives of the loss with respect to the outputs.
    fn slopes(
        &self,
        terms: &LossTerms,
        samples: impl Iterator<Item = Sample>,
        sums: &mut LossSums,
        scratch: &mut Scratch,
    ) {
        let Scratch { policy, critic, policy_slopes, critic_slopes, .. } = scratch;
        let outputs = self.policy.stack().outputs();
        policy_slopes.resize(policy.y.len(), 0.0);
        critic_slopes.resize(critic.y.len(), 0.0);
        let rows = policy.y.chunks_exact(outputs).zip(policy_slopes.chunks_exact_mut(outputs));
        for (row, (sample, (y, dy))) in samples.zip(rows).enumerate() {
            let means = &y[..self.actions];
            let value = if self.critic.is_some() { critic.y[row] } else { y[self.actions] };
            let Slopes { means, value } = sample_loss(terms, sample, means, value, sums);
            dy[..self.actions].copy_from_slice(&means[..self.actions]);
            match self.critic {
                Some(_) => critic_slopes[row] = value,
                None => dy[self.actions] = value,
            }
        }
    }

    /// Flat gradient of the next step, in its two parts.
    pub(super) fn gradients_mut(&mut self) -> [&mut [f32]; 2] {
        let critic = self.critic.as_mut().map_or(Default::default(), Trainer::gradient_mut);
        [self.policy.gradient_mut(), critic]
    }

    /// Current gradient, network by network.
    #[cfg(test)]
    pub(super) fn gradients(&self) -> Vec<crate::nn::Network> {
        std::iter::once(&self.policy).chain(&self.critic).map(Trainer::gradient).collect()
    }

    /// One Adam step with the current gradient and the derivatives `slopes` of the log standard
    /// deviations, all multiplied by `scale`.
    pub(super) fn update(
        &mut self,
        slopes: &[f64; MAX_OUTPUTS],
        (learning_rate, scale): (f32, f32),
        settings: &PpoSettings,
    ) {
        self.policy.update_scaled(learning_rate, scale);
        if let Some(critic) = &mut self.critic {
            critic.update_scaled(learning_rate, scale);
        }
        let steps = self.policy.steps();
        self.deviations.update(slopes, (learning_rate, scale, settings.adam_epsilon), steps);
        if let Some(most) = settings.most_log_deviation {
            self.deviations.logarithms.iter_mut().for_each(|value| *value = value.min(most));
        }
    }
}

impl Deviations {
    /// The step of [`Trainer::update`] for the log standard deviations.
    fn update(
        &mut self,
        slopes: &[f64; MAX_OUTPUTS],
        (learning_rate, scale, epsilon): (f32, f32, f32),
        steps: i32,
    ) {
        let Adam { beta1, beta2, .. } = Adam::default();
        let correction = |beta: f32| (1.0 - f64::from(beta).powi(steps)) as f32;
        let moments = self.moment1.iter_mut().zip(&mut self.moment2);
        for ((value, slope), (m, v)) in self.logarithms.iter_mut().zip(slopes).zip(moments) {
            let g = *slope as f32 * scale;
            *m = beta1 * *m + (1.0 - beta1) * g;
            *v = beta2 * *v + (1.0 - beta2) * g * g;
            let root = (*v / correction(beta2)).sqrt() + epsilon;
            *value -= learning_rate / correction(beta1) * *m / root;
        }
    }
}

/// Factor on a gradient of this `norm`, so that it is not above `largest`.
pub(super) fn clip_scale(norm: f64, largest: Option<f32>) -> f32 {
    largest.map_or(1.0, |largest| (f64::from(largest) / (norm + NORM_EPSILON)).min(1.0) as f32)
}
