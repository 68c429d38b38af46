//! Proximal Policy Optimization on small networks.
//!
//! A [`Learner`] acts in many environments at once, whose steps a [`Rollout`] collects; [`Learner::learn`]
//! turns a full one into better networks. It knows observations, actions and rewards as numbers, and
//! nothing of any game.
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
//! # The details
//!
//! Whether PPO works is a matter of details. Numbers are those of Huang et al., "The 37
//! Implementation Details of Proximal Policy Optimization" (ICLR Blog Track, 2022): G for its 13 of
//! the core, C for its 9 of continuous actions. CleanRL is `ppo_continuous_action.py` of
//! vwxyzjn/cleanrl, rl_games is Denys88/rl_games, which upstream uses.
//!
//! | detail | here | done by |
//! |---|---|---|
//! | G1 vectorised architecture | rollouts of fixed length go on where the last ended | [`Rollout`] |
//! | G2 orthogonal initialisation, biases 0 | gains root 2, policy 0.01, value 1 | `orthogonal::network` |
//! | G3 Adam's epsilon | 1e-5, upstream 1e-8 | [`PpoSettings::adam_epsilon`], [`nn::Trainer`](crate::nn::Trainer) |
//! | G4 rate annealing | fixed, linear, or by divergence (rl_games, `AdaptiveScheduler`) | [`Schedule`], `update::adapted` |
//! | G5 generalised advantage estimation | with the value of the last observation where an episode is cut off (Pardo et al. 2018) | [`Advantages::compute`] |
//! | G6 minibatches | every sample once in each pass, in an order named after seed, update and pass | `batch::epochs` |
//! | G7 advantage normalisation | over the minibatch, upstream over the batch; epsilon 1e-8 | [`AdvantageNormalization`], `batch::scaling` |
//! | G8 clipped objective | Schulman et al. 2017, equation 7 | `loss::policy_loss` |
//! | G9 value clipping | within the clip coefficient of the old value, the larger loss counts | [`ValueLoss`], `loss::value_loss` |
//! | G10 whole loss and entropy bonus | one loss, one step for both networks | `loss`, `update::Worker::minibatch` |
//! | G11 gradient clipping | norm over everything that is learned, as PyTorch's `clip_grad_norm_` | `model::clip_scale` |
//! | G12 debug variables | losses, divergence, clip fraction, explained variance | [`UpdateReport`] |
//! | G13 shared or separate networks | both | [`NetworkLayout`] |
//! | C1 normal distribution | independent actions | [`Gaussian`] |
//! | C2 deviations that do not depend on the state | logarithms are learned, from 0; the paper preset keeps them at 0 or below | [`Deviations`] |
//! | C3 independent components | log-probabilities are added | [`Gaussian::log_probability`] |
//! | C4 separate networks | default; upstream shares | [`NetworkLayout`] |
//! | C5 actions are limited by the environment | the unlimited action is learned from; its mean is drawn inside 1.1 (rl_games, `bound_loss`) | [`RolloutStep::actions`], `loss::sample_loss` |
//! | C6 observation normalisation | running mean and variance (Chan et al. 1983), fixed within an update | [`Moments`], [`Learner::learn`] |
//! | C7 observation clipping | 10 deviations, upstream 5 | [`Normalization`], [`nn::Standardizer`](crate::nn::Standardizer) |
//! | C8, C9 reward scaling and clipping | none; instead the critic can see standardised values (rl_games, `normalize_value`) | [`PpoSettings::values`] |
//! | stop by divergence | before a minibatch above 1.5 times the limit (Stable-Baselines3, `target_kl`) | [`PpoSettings::kl_stop`] |
//! | divergence | exact, from means and deviations, not estimated from ratios | [`Gaussian::divergence_from`] |
//! | numbers that are not finite | nothing of the update is kept | `Learner::keep`, [`PpoError`] |
//!
//! # Bytes
//!
//! Equal settings, seeds and rollouts give equal learners, whatever the number of threads: sums run
//! in the order of samples and of lanes (`update`), and random numbers belong to places
//! (`noise`). Stored and resumed learners go on alike ([`LearnerState`]). Between machines of
//! different vector width the last digits differ.
//!
//! # Left out on purpose
//!
//! Discrete actions, recurrent networks, frame stacks and the game of any of these; deviations that
//! depend on the state; more than four actions, since the last layer is a kernel for narrow outputs.

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
pub use rollout::{End, Rollout, RolloutPart, RolloutShape, RolloutStep};
pub use settings::{
    AdvantageNormalization, NetworkLayout, Normalization, PpoSettings, Schedule, Spaces, ValueLoss,
};
pub use state::LearnerState;
pub(crate) use workers::for_each;

#[cfg(test)]
mod tests;
