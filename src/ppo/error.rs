//! Errors of PPO.

/// Error of building, feeding or updating a learner.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PpoError {
    /// A setting is outside its range.
    #[error("PPO setting {name} is {value}, expected {low:e} to {high:e}")]
    Setting {
        /// Its name in [`super::PpoSettings`] or [`super::Spaces`].
        name: &'static str,
        /// Value of the setting.
        value: f32,
        /// Smallest allowed value.
        low: f32,
        /// Largest allowed value.
        high: f32,
    },
    /// Counts that do not match.
    #[error("{what}: found {found}, expected {expected}")]
    Size {
        /// Name of the count.
        what: &'static str,
        /// Count found.
        found: usize,
        /// Count expected.
        expected: usize,
    },
    /// A non-finite number from the environment or the caller.
    #[error(
        "update {update}: {what} of environment {environment} at step {step} of the rollout is not \
         finite; nothing was learned from this rollout"
    )]
    NonFiniteInput {
        /// Index of the update, from 1.
        update: u64,
        /// Name of the array.
        what: &'static str,
        /// Step of the rollout, from 0.
        step: usize,
        /// Index of the environment, from 0.
        environment: usize,
    },
    /// A non-finite number in learning.
    #[error(
        "update {update}, epoch {epoch}, minibatch {minibatch}: {what} is not finite; the learner \
         is as it was before this update: lower learning_rate or max_gradient_norm"
    )]
    NonFiniteLearning {
        /// Index of the update, from 1.
        update: u64,
        /// Index of the epoch, from 1.
        epoch: usize,
        /// Index of the minibatch in the epoch, from 1.
        minibatch: usize,
        /// Name of the non-finite value.
        what: &'static str,
    },
    /// A state to resume from whose shapes differ from the settings.
    #[error("{what} of the state: found {found:?}, expected {expected:?}")]
    State {
        /// Part of the state.
        what: &'static str,
        /// Widths or sizes in the state.
        found: Vec<usize>,
        /// Widths or sizes by the settings.
        expected: Vec<usize>,
    },
}

/// Check that a count equals the expected one.
pub(super) fn expect_size(
    what: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), PpoError> {
    if found == expected { Ok(()) } else { Err(PpoError::Size { what, found, expected }) }
}
