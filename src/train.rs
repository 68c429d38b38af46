//! Self-play: policies learn KLASK against earlier versions of themselves.
mod arena;
mod block;
mod curve;
mod elo;
mod error;
mod pool;
mod reward;
mod run;
mod settings;
mod table;

pub use arena::{Arena, Count, Games, MatchScore};
pub use curve::{CurvePoint, TimeShares};
pub use elo::{BASE as ELO_BASE, EloRow, K as ELO_K, Played, expected_score, ratings, table as elo_table};
pub use error::TrainError;
pub use pool::{Choice, Member, Opponent};
pub use reward::{Curriculum, RewardSettings, Step};
pub use run::{Checkpoint, Machine, Run};
pub use settings::{
    ACTIONS, EvaluationSettings, OpponentMode, OpponentSettings, Preset, RandomizationKind,
    TrainSettings,
};
