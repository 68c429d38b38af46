//! The referee: from the recording of a match to its events and its score.
//!
//! It judges hardware, virtual and simulated matches alike, from `/camera/detections`, or from
//! `/board/state` where there is nothing better (imported bags). A contact lasts less than a frame, and
//! between two frames a ball of 1 m/s moves 8 mm, so contacts are found from the motion between frames:
//! the ball's track is divided into free rolls where that makes it most likely, and each change of
//! velocity is given the cause (wall, striker at its position between the frames, cup) that explains its
//! position, time and direction best.
//!
//! ```
//! use klasktron::referee::{EventKind, Frame, Rules, analyze};
//! // A ball that rolls to the right wall and back, 1 m/s in and 0.8 m/s out.
//! let frames: Vec<Frame> = (0..60)
//!     .map(|k| {
//!         let time = f64::from(k) / 120.0;
//!         let x = if time < 0.253 { -0.1 + time } else { 0.153 - 0.8 * (time - 0.253) };
//!         Frame { time, ball: Some([x, 0.05]), strikers: [None; 2] }
//!     })
//!     .collect();
//! let events = analyze(&frames, &Rules::default()).events;
//! assert_eq!(events.len(), 1);
//! assert_eq!(events[0].kind, EventKind::WallBounce);
//! assert!((events[0].time - 0.253).abs() < 0.001);
//! assert!((events[0].speed_out() - 0.8).abs() < 0.05);
//! ```
//!
//! # What happened
//!
//! Every threshold is a field of [`Rules`].
//!
//! | event | when |
//! |---|---|
//! | `wall_bounce` | the ball's velocity changes at a wall by at least [`Rules::least_impulse`] |
//! | `block`, `strike`, `touch` | it changes at a striker; impulses of one striker belong to one touch while the ball stays with it or for [`Rules::same_touch`] |
//! | `goal` | the ball is over a cup for [`Rules::goal_stay`], or vanishes in it; its time is that of the crossing of the edge |
//! | `rim_out` | it was over a cup and comes out sooner |
//! | `striker_in_goal` | a striker's centre is over its own cup for [`Rules::striker_stay`]: a point for the other player |
//! | `timeout` | the ball has lain still for [`Rules::timeout_after`] |
//! | `ball_lost` | the ball has not been seen for [`Rules::lost_after`], nor did it vanish in a cup |
//! | `restart` | the ball is on the board again, and no striker in its cup |
//!
//! An episode is play from the beginning or a restart to a goal, a striker in its goal, a timeout or a
//! lost ball. What happens between episodes is no event.
//!
//! # What the words mean
//!
//! A touch is a block, a strike or neither, never two; contacts are blocks plus strikes.
//!
//! **Defensive block**: a touch that is no strike, on a ball that came towards the toucher's own goal
//! line by at least [`Rules::least_approach`], and left with less of that motion.
#![doc = include_str!("referee/pictures/block.svg")]
//!
//! **Offensive strike**: a touch after which the ball moves towards the opponent's goal line by at
//! least [`Rules::least_approach`], faster than it came.
#![doc = include_str!("referee/pictures/strike.svg")]
//!
//! **Goal-directed hit**: a strike whose straight way on leads over the opponent's cup.
#![doc = include_str!("referee/pictures/goal_directed.svg")]
//!
//! **Possession**: the share of the time since an episode's first touch during which a player was the
//! last who touched the ball.
#![doc = include_str!("referee/pictures/possession.svg")]
//!
//! # What it does not do
//!
//! Biscuits are not detected by the camera, so they are not judged. Two bounces at one wall, or two
//! impulses of striker and wall, within one frame are one. Spin is not estimated.

mod analysis;
mod compare;
mod document;
mod episodes;
mod event;
mod events_file;
mod frames;
mod impacts;
mod matches;
mod metric;
mod page;
mod rolls;
mod rules;
mod sight;
mod table;
mod touches;
mod vector;

pub use analysis::{Episode, MatchAnalysis, analyze};
pub use compare::{Comparison, Difference, Group, compare};
pub use document::{EVENTS_FILE, EpisodeScore, MatchScore, SCHEMA_VERSION, Score};
pub use episodes::{Outcome, Span};
pub use event::{Event, EventKind};
pub use events_file::write_events;
pub use frames::{Frame, MatchFrames, Source};
pub use matches::{ScoredMatch, analyze_matches};
pub use metric::{Figure, Metric, summarise};
pub use page::page;
pub use rules::Rules;
pub use table::write_episodes;

use crate::recording::RecordingError;
use std::path::PathBuf;

/// Why a match cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum RefereeError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// It does not say where the ball was.
    #[error(
        "{}: neither /camera/detections nor /board/state; the topics that it has are: {}",
        path.display(), if topics.is_empty() { "none" } else { topics }
    )]
    NoFrames {
        /// The file.
        path: PathBuf,
        /// Topics with messages.
        topics: String,
    },
}

/// A word, in one sentence and one picture.
struct Definition {
    word: &'static str,
    sentence: &'static str,
    picture: &'static str,
}

/// The words of the score, as pages explain them.
const DEFINITIONS: [Definition; 4] = [
    Definition {
        word: "Defensive block",
        sentence: "A touch that is no strike, on a ball that came towards the toucher's own goal line \
                   by at least 0.1 m/s, and left with less of that motion.",
        picture: include_str!("referee/pictures/block.svg"),
    },
    Definition {
        word: "Offensive strike",
        sentence: "A touch after which the ball moves towards the opponent's goal line by at least \
                   0.1 m/s, faster than it came.",
        picture: include_str!("referee/pictures/strike.svg"),
    },
    Definition {
        word: "Goal-directed hit",
        sentence: "A strike whose straight way on leads over the opponent's cup.",
        picture: include_str!("referee/pictures/goal_directed.svg"),
    },
    Definition {
        word: "Possession",
        sentence: "The share of the time since an episode's first touch during which a player was the \
                   last who touched the ball.",
        picture: include_str!("referee/pictures/possession.svg"),
    },
];
