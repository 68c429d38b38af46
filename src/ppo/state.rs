//! Complete state of a learner for resuming.

use super::{Deviations, Moments, PpoError};
use crate::nn::{Network, TrainerState};

/// State of a learner; settings and spaces are stored by the caller.
///
/// Random numbers need no state: shuffles are keyed by seed, update and epoch, actions by seed,
/// step and environment.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnerState {
    /// Seed of the run.
    pub seed: u64,
    /// Number of updates done.
    pub updates: u64,
    /// Learning rate at the end of the last update.
    pub learning_rate: f32,
    /// Network of the means, or of means and value with a shared trunk.
    pub policy: TrainerState,
    /// Network of the value, if it has its own.
    pub critic: Option<TrainerState>,
    /// Log standard deviations of the policy.
    pub deviations: Deviations,
    /// Moments of the observations.
    pub observed: Moments,
    /// Moments of the critic's targets.
    pub targets: Moments,
}

impl LearnerState {
    /// Check that the sizes equal those of `expected`.
    pub(super) fn check_fits(&self, expected: &Self) -> Result<(), PpoError> {
        for (what, found, expected) in [
            ("policy network", policy_widths(&self.policy), policy_widths(&expected.policy)),
            ("critic network", critic_widths(self), critic_widths(expected)),
            ("deviations", deviation_sizes(self), deviation_sizes(expected)),
            ("moments", moment_sizes(self), moment_sizes(expected)),
        ] {
            if found != expected {
                return Err(PpoError::State { what, found, expected });
            }
        }
        Ok(())
    }
}

fn widths(network: &Network) -> impl Iterator<Item = usize> {
    let outputs = network.layers.iter().map(|layer| layer.outputs);
    std::iter::once(network.inputs()).chain(outputs)
}

/// Widths of parameters and both moments.
fn policy_widths(state: &TrainerState) -> Vec<usize> {
    [&state.network, &state.moment1, &state.moment2].into_iter().flat_map(widths).collect()
}

fn critic_widths(state: &LearnerState) -> Vec<usize> {
    state.critic.as_ref().map_or_else(Vec::new, policy_widths)
}

fn deviation_sizes(state: &LearnerState) -> Vec<usize> {
    let Deviations { logarithms, moment1, moment2 } = &state.deviations;
    [logarithms, moment1, moment2].map(Vec::len).to_vec()
}

fn moment_sizes(state: &LearnerState) -> Vec<usize> {
    let both = [&state.observed, &state.targets];
    both.into_iter().flat_map(|m| [m.mean.len(), m.squares.len()]).collect()
}
