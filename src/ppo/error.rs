//! What can go wrong.

/// Why a learner could not be made, fed, or go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PpoError {
    /// A setting is outside its range.
    #[error("PPO setting {name} is {value}, expected {low:e} to {high:e}")]
    Setting {
        /// Its name in [`super::PpoSettings`] or [`super::Spaces`].
        name: &'static str,
        /// What it is.
        value: f32,
        /// Smallest allowed value.
        low: f32,
        /// Largest allowed value.
        high: f32,
    },
    /// Numbers do not fit together.
    #[error("{what}: found {found}, expected {expected}")]
    Size {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// The environment or the caller delivered a number that is not finite.
    #[error(
        "update {update}: {what} of environment {environment} at step {step} of the rollout is not \
         finite; nothing was learned from this rollout"
    )]
    NonFiniteInput {
        /// Which update it would have been, counted from 1.
        update: u64,
        /// Which array.
        what: &'static str,
        /// Step of the rollout, from 0.
        step: usize,
        /// Number of the environment, from 0.
        environment: usize,
    },
    /// Learning left the range of numbers.
    #[error(
        "update {update}, epoch {epoch}, minibatch {minibatch}: {what} is not finite; the learner \
         is as it was before this update: lower learning_rate or max_gradient_norm"
    )]
    NonFiniteLearning {
        /// Which update, counted from 1.
        update: u64,
        /// Which pass, counted from 1.
        epoch: usize,
        /// Which minibatch of the pass, counted from 1.
        minibatch: usize,
        /// What left the range.
        what: &'static str,
    },
    /// A state to continue from has other shapes than the settings ask for.
    #[error("{what} of the state: found {found:?}, expected {expected:?}")]
    State {
        /// Which part.
        what: &'static str,
        /// Widths or sizes in the state.
        found: Vec<usize>,
        /// Widths or sizes that the settings give.
        expected: Vec<usize>,
    },
}

/// Refuses a count that is not the expected one.
pub(super) fn expect_size(
    what: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), PpoError> {
    if found == expected { Ok(()) } else { Err(PpoError::Size { what, found, expected }) }
}
