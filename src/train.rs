//! Self-play: policies learn KLASK against earlier versions of themselves.
mod actuator;
mod arena;
mod block;
mod checkpoint;
mod curve;
mod elo;
mod error;
mod file;
mod judge;
mod message;
mod page;
mod pool;
mod reward;
mod run;
mod sample;
mod settings;
mod stored;
mod table;
mod tensorboard;

pub use actuator::{ActuatorSource, IDEAL, game_with_actuator};
pub use arena::{Arena, Count, Games, MatchScore};
pub use curve::{CurvePoint, TimeShares};
pub use elo::{
    BASE as ELO_BASE, EloRow, K as ELO_K, Played, expected_score, ratings, table as elo_table,
};
pub use error::{Mismatch, TrainError};
pub use file::{POLICY_METADATA, Summary, UPDATE_TOPIC, write_policy};
pub use judge::{Judged, LEARNER_NAME, Verdict, judge};
pub use page::page;
pub use pool::{Choice, Member, Opponent};
pub use reward::{Curriculum, RewardSettings, Step};
pub use run::{Checkpoint, Machine, Run};
pub use sample::{Moment, SampleGame, play_samples};
pub use settings::{
    ACTIONS, EvaluationSettings, OpponentMode, OpponentSettings, Preset, RandomizationKind,
    TrainSettings,
};
pub use stored::{StoredPolicy, read_checkpoint, read_policy};
pub use tensorboard::EventFile;
