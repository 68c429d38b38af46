//! Proximal Policy Optimization (PPO) for small networks.
//!
//! A [`Learner`] acts in many environments at once, whose steps a [`Rollout`] collects;
//! [`Learner::learn`] updates the networks from a full rollout. Observations, actions and rewards
//! are plain numbers: nothing here depends on the game.
//!
//! ```
//! use klasktron::ppo::{End, Learner, StepIndex, PpoSettings, Rollout, RolloutShape, Scratch, Spaces};
//! use std::num::NonZeroUsize;
//!
//! # fn main() -> Result<(), klasktron::ppo::PpoError> {
//! let spaces = Spaces { observations: 1, actions: 1 };
//! let settings = PpoSettings { hidden: vec![16], minibatch: 64, ..PpoSettings::paper() };
//! let mut learner = Learner::new(&settings, spaces, 1)?;
//! let mut rollout = Rollout::new(RolloutShape { horizon: 8, environments: 16, spaces });
//! let mut scratch = Scratch::default();
//! for (number, mut step) in rollout.whole().steps.into_iter().enumerate() {
//!     step.observations.fill(0.5); // what the environments show
//!     learner.act(StepIndex { step: number as u64, first_environment: 0 }, &mut step, &mut scratch);
//!     for (reward, action) in step.rewards.iter_mut().zip(step.actions.iter()) {
//!         *reward = -action.powi(2); // what the environments make of it
//!     }
//!     step.ends.fill(End::Terminal);
//! }
//! let report = learner.learn(&rollout, &[0.0; 16], NonZeroUsize::MIN)?;
//! assert_eq!((report.update, report.samples, report.epochs), (1, 128, 4));
//! # Ok(())
//! # }
//! ```
//!
//! # Implementation details
//!
//! Implementation details decide whether PPO learns. Numbers refer to Huang et al., "The 37
//! Implementation Details of Proximal Policy Optimization" (ICLR Blog Track, 2022): G for its 13
//! core details, C for its 9 details of continuous actions. CleanRL is `ppo_continuous_action.py`
//! of vwxyzjn/cleanrl; rl_games is Denys88/rl_games, which upstream uses.
//!
//! | detail | choice | code |
//! |---|---|---|
//! | G1 vectorized architecture | fixed-length rollouts, continued from the previous one | [`Rollout`] |
//! | G2 orthogonal initialization, biases 0 | gains root 2, policy 0.01, value 1 | `orthogonal::network` |
//! | G3 Adam's epsilon | 1e-5, upstream 1e-8 | [`PpoSettings::adam_epsilon`], [`nn::Trainer`](crate::nn::Trainer) |
//! | G4 learning rate annealing | fixed, linear, or adaptive to the KL divergence (rl_games, `AdaptiveScheduler`) | [`Schedule`], `update::adapted` |
//! | G5 generalized advantage estimation | bootstrapped from the last observation of a truncated episode (Pardo et al. 2018) | [`Advantages::compute`] |
//! | G6 minibatches | every sample once per epoch, in an order keyed by seed, update and epoch | `batch::epochs` |
//! | G7 advantage normalization | over the minibatch, upstream over the batch; epsilon 1e-8 | [`AdvantageNormalization`], `batch::scaling` |
//! | G8 clipped surrogate objective | Schulman et al. 2017, equation 7 | `loss::policy_loss` |
//! | G9 value clipping | within the clip coefficient of the old value; the larger loss counts | [`ValueLoss`], `loss::value_loss` |
//! | G10 overall loss and entropy bonus | one loss and one optimizer step for both networks | `loss`, `update::Worker::minibatch` |
//! | G11 global gradient clipping | norm over all learned parameters, as PyTorch's `clip_grad_norm_` | `model::clip_scale` |
//! | G12 debug variables | losses, approximate KL, clip fraction, explained variance | [`UpdateReport`] |
//! | G13 shared or separate networks | both | [`NetworkLayout`] |
//! | C1 normal distribution | independent actions | [`Gaussian`] |
//! | C2 state-independent log standard deviation | learned, from 0; at most 0 in the paper preset | [`Deviations`] |
//! | C3 independent components | log-probabilities are added | [`Gaussian::log_probability`] |
//! | C4 separate networks | default; upstream shares | [`NetworkLayout`] |
//! | C5 action clipping by the environment | the unclipped action is learned from; its mean is drawn inside 1.1 (rl_games, `bound_loss`) | [`RolloutStep::actions`], `loss::sample_loss` |
//! | C6 observation normalization | running mean and variance (Chan et al. 1983), constant within an update | [`Moments`], [`Learner::learn`] |
//! | C7 observation clipping | 10 standard deviations, upstream 5 | [`Normalization`], [`nn::Standardizer`](crate::nn::Standardizer) |
//! | C8, C9 reward scaling and clipping | not used; instead the critic can use normalized values (rl_games, `normalize_value`) | [`PpoSettings::values`] |
//! | early stopping by KL | before a minibatch above 1.5 times the limit (Stable-Baselines3, `target_kl`) | [`PpoSettings::kl_stop`] |
//! | mirrored experience | half of each minibatch is reflected where the task is symmetric (Mittal et al. 2024) | [`Reflection`] |
//! | imitation | early in training, squared difference from a demonstrated action with a decaying weight (Schmitt et al. 2018) | [`Imitation`], `loss::sample_loss` |
//! | KL divergence | analytic, from means and standard deviations, not estimated from ratios | [`Gaussian::divergence_from`] |
//! | non-finite numbers | the whole update is discarded | `Learner::keep`, [`PpoError`] |
//!
//! # Determinism
//!
//! Equal settings, seeds and rollouts give equal learners for any number of threads: sums run in
//! the order of samples and of lanes (`update`), and random numbers are keyed by their use
//! (`noise`). A stored and resumed learner continues identically ([`LearnerState`]). Machines with
//! another vector width differ in the last digits.
//!
//! # Not implemented
//!
//! Discrete actions, recurrent networks and frame stacks; state-dependent standard deviations; more
//! than four actions, since the last layer is a kernel for narrow outputs.

mod advantage;
mod barrier;
mod batch;
pub mod checkpoint;
mod error;
mod gaussian;
mod learner;
mod loss;
mod model;
mod moments;
mod noise;
mod orthogonal;
mod policy;
mod reflection;
mod rollout;
mod settings;
mod state;
mod update;
mod workers;

pub use advantage::Advantages;
pub use error::PpoError;
pub use gaussian::Gaussian;
pub use learner::{Learner, StepIndex, UpdateReport};
pub use model::{Deviations, Scratch};
pub use moments::Moments;
pub use policy::Policy;
pub use reflection::Reflection;
pub use rollout::{End, Rollout, RolloutPart, RolloutShape, RolloutStep};
pub use settings::{
    AdvantageNormalization, Imitation, NetworkLayout, Normalization, PpoSettings, Schedule, Spaces,
    ValueLoss,
};
pub use state::LearnerState;
pub(crate) use workers::for_each;

#[cfg(test)]
mod tests;
