//! Self-play training: policies learn KLASK against earlier versions of themselves.
//!
//! [`Run`] is the training loop: many environments of the [`game`](crate::game) fill a rollout, the
//! [`ppo`](crate::ppo) learner updates the policy, and from time to time the policy joins the pool
//! of its opponents.
//!
//! ```
//! use klasktron::{game::GameSettings, train::{Machine, Preset, Run, TrainSettings}};
//! use std::num::NonZeroUsize;
//! # fn main() -> Result<(), klasktron::train::TrainError> {
//! let mut settings = TrainSettings::preset(Preset::Paper);
//! (settings.environments, settings.ppo.horizon, settings.ppo.hidden) = (16, 8, vec![8]);
//! settings.steps = 2 * settings.transitions_per_update();
//! let machine = Machine { threads: NonZeroUsize::MIN, clock: || 0.0 };
//! let mut run = Run::new(&settings, &GameSettings::default(), machine)?;
//! while !run.is_done() {
//!     let point = run.update()?;
//!     assert_eq!(point.learning.samples, 128);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Implementation details
//!
//! Paper: KlaskTron, appendix A and B. Upstream: the KlaskTron repositories. The details of the
//! learner are listed in [`ppo`](crate::ppo).
//!
//! | detail | choice | code |
//! |---|---|---|
//! | observations | 12 standard values, or 8 more (paper A.3) | [`ObservationKind`](crate::game::ObservationKind) |
//! | actions | two, -1 to 1, clamped; times 0.4 m/s; slew and wall limiter are the game's (upstream) | `pool::velocity_of` |
//! | seats | the learner plays left in even environments, right in odd ones; both use their own frame | `table::seat` |
//! | reward | result plus shaping that decays with transitions (paper, equation 2) | [`RewardSettings`] |
//! | curricula | dense ball-to-goal, collision only, sparse (paper A.1) | [`Curriculum`] |
//! | episode ends | a time limit truncates an episode (bootstrapped from its last value); all other ends are terminal | `block::Block::pay` |
//! | opponents | drawn per episode, weight 0.9 to the power of the age (paper A.2) | `pool::weights` |
//! | first opponent | untrained, stochastic; later ones play their mean actions (upstream) | `pool::Pool::new` |
//! | pool update | mean score difference of the last finished games above 0.7 (paper A.2), over a full window | `pool::Pool::wants_update` |
//! | Elo | K 10, base 1200 (upstream); both seats, equal numbers of games, intervals | [`elo_table`] |
//! | evaluation | mean actions, one episode per environment, so that short games are not over-represented | [`Arena::play`] |
//! | domain randomization | the paper's table III, off by default | [`RandomizationKind`] |
//! | initial normalization | moments of observations from random play, before the first update | `run::look_around` |
//!
//! # Determinism
//!
//! Environments are stepped in blocks that do not depend on threads, random streams are keyed by
//! seed, environment and step, and sums run in the order of blocks. Equal settings therefore give
//! equal bytes on any number of threads. A checkpoint includes environments in the middle of their
//! episodes, so a resumed run equals an uninterrupted one.
//!
//! # Not implemented
//!
//! Upstream's other learners (FastSAC, Dreamer), its pretraining in another action space, noise on
//! observations, and assistance by initial velocities. Networks of learner and opponents have the
//! same layout.

mod actuator;
mod arena;
mod block;
mod checkpoint;
mod curve;
mod elo;
mod environments;
mod error;
mod evaluate;
mod file;
mod message;
mod page;
mod pool;
mod reward;
mod run;
mod sample;
mod seeds_page;
mod settings;
mod stored;
mod table;
mod tensorboard;

pub use actuator::{ActuatorSource, IDEAL, game_with_actuator, sensors_of};
pub use arena::{Arena, Count, GameResult, Games, MatchScore};
pub use curve::{CurvePoint, TimeShares};
pub use elo::{
    BASE as ELO_BASE, EloRow, K as ELO_K, Played, expected_score, ratings, table as elo_table,
};
pub use environments::{EnvironmentSource, Environments};
pub use error::{Mismatch, TrainError};
pub use evaluate::{Estimate, Evaluation, LEARNER_NAME, OpponentEvaluation, evaluate};
pub use file::{POLICY_METADATA, Summary, UPDATE_TOPIC, write_policy};
pub use page::page;
pub use pool::{Choice, Member, Opponent};
pub use reward::{Curriculum, RewardSettings, ShapingForm, Step};
pub use run::{Checkpoint, Machine, Run};
pub use sample::{Moment, SampleGame, play_samples};
pub use seeds_page::{SeedRun, seeds_page};
pub use settings::{
    ACTIONS, EvaluationSettings, OpponentMode, OpponentSettings, Preset, RandomizationKind,
    ScriptedWeights, StartSettings, TrainSettings,
};
pub use stored::{PolicyFormat, StoredPolicy, read_checkpoint, read_curve, read_policy};
pub(crate) use table::seat;
pub use tensorboard::EventFile;
