//! A frozen policy for opponents, evaluation and export.

use super::{Gaussian, Scratch, StepIndex, noise::Noise};
use crate::nn::{Network, Stack, Standardizer};

/// Maximum number of rows that are evaluated by the network at once.
const ROWS: usize = 128;

/// Normalization, network of the means, and standard deviations.
#[derive(Debug, Clone)]
pub struct Policy {
    network: Network,
    stack: Stack,
    standardizer: Standardizer,
    gaussian: Gaussian,
}

impl Policy {
    /// Build a policy from its parts; the network has a hidden layer and at most 4 outputs.
    ///
    /// # Panics
    /// When the network has another shape, or the parts do not match.
    #[must_use]
    pub fn new(network: Network, standardizer: Standardizer, gaussian: Gaussian) -> Self {
        assert!(network.inputs() == standardizer.columns(), "one standardisation for each input");
        assert!(network.outputs() == gaussian.actions(), "one deviation for each output");
        Self { stack: Stack::new(&network), network, standardizer, gaussian }
    }

    /// Network after the normalization, as plain data.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Normalization of the observations.
    #[must_use]
    pub fn standardizer(&self) -> &Standardizer {
        &self.standardizer
    }

    /// Action distribution around the means.
    #[must_use]
    pub fn gaussian(&self) -> &Gaussian {
        &self.gaussian
    }

    /// Write the mean actions for `observations`, `[rows][inputs]`, into `actions`,
    /// `[rows][outputs]`; trained policies play with these.
    pub fn act_mean(&self, observations: &[f32], actions: &mut [f32], scratch: &mut Scratch) {
        let (inputs, outputs) = (self.network.inputs(), self.network.outputs());
        let rows = observations.chunks(ROWS * inputs).zip(actions.chunks_mut(ROWS * outputs));
        for (observations, actions) in rows {
            let tape = &mut scratch.policy;
            tape.x.resize(observations.len(), 0.0);
            self.standardizer.apply(observations, &mut tape.x);
            self.stack.forward(tape);
            actions.copy_from_slice(&tape.y);
        }
    }

    /// Sample actions, with the noise called `name` of `seed` at the given key.
    pub fn act_random(
        &self,
        (seed, name, place): (u64, &str, StepIndex),
        observations: &[f32],
        actions: &mut [f32],
        scratch: &mut Scratch,
    ) {
        self.act_mean(observations, actions, scratch);
        let noise = Noise::new(seed, name).at(place.step);
        let outputs = self.network.outputs();
        for (row, actions) in actions.chunks_exact_mut(outputs).enumerate() {
            let mut means = [0.0; crate::nn::MAX_OUTPUTS];
            means[..outputs].copy_from_slice(actions);
            let environment = place.first_environment + row;
            noise.act(environment, &self.gaussian, &means[..outputs], actions);
        }
    }
}
