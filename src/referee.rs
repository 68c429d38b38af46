//! The referee: events and score of a match from its recording.
//!
//! It evaluates hardware, virtual and simulated matches alike, from `/camera/detections`, or from
//! `/board/state` if there are no detections (imported bags). A contact lasts less than a frame,
//! and a ball of 1 m/s moves 8 mm between two frames, so contacts are inferred from the motion. The
//! ball's track is segmented into free rolls by maximum likelihood. Each velocity change is
//! assigned to the cause (wall, striker at its interpolated position, cup) that best explains its
//! position, time and direction.
//!
//! ```
//! use klasktron::referee::{EventKind, Frame, Rules, analyze};
//! // A ball that rolls to the right wall and back, 1 m/s in and 0.8 m/s out.
//! let frames: Vec<Frame> = (0..60)
//!     .map(|k| {
//!         let time = f64::from(k) / 120.0;
//!         let x = if time < 0.253 { -0.1 + time } else { 0.153 - 0.8 * (time - 0.253) };
//!         Frame { time, ball: Some([x, 0.05]), ..Frame::default() }
//!     })
//!     .collect();
//! let events = analyze(&frames, &Rules::default()).events;
//! assert_eq!(events.len(), 1);
//! assert_eq!(events[0].kind, EventKind::WallBounce);
//! assert!((events[0].time - 0.253).abs() < 0.001);
//! assert!((events[0].speed_out() - 0.8).abs() < 0.05);
//! ```
//!
//! # Events
//!
//! All thresholds are fields of [`Rules`].
//!
//! | event | definition |
//! |---|---|
//! | `wall_bounce` | the ball's velocity changes at a wall by at least [`Rules::least_impulse`] |
//! | `block`, `strike`, `touch` | the velocity changes at a striker; impulses of one striker belong to one touch while the ball stays with it or for [`Rules::same_touch`] |
//! | `goal` | the ball is over a cup for [`Rules::goal_stay`], or vanishes in it; its time is that of crossing the edge |
//! | `rim_out` | the ball was over a cup and leaves it sooner |
//! | `striker_in_goal` | own goal: a striker's centre is over its own cup for [`Rules::striker_stay`] |
//! | `two_biscuits` | two biscuits are within [`Rules::biscuit_within`] of one striker for [`Rules::biscuit_stay`]: the other player gets the point |
//! | `timeout` | the ball has been at rest for [`Rules::timeout_after`] |
//! | `ball_lost` | the ball has not been detected for [`Rules::lost_after`] and did not vanish in a cup |
//! | `restart` | the ball is on the board again, and no striker is in its cup or has two biscuits |
//!
//! An episode lasts from the beginning or a restart to a goal, an own goal, two biscuits, a timeout or
//! a lost ball. Motion between episodes causes no events.
//!
//! # Definitions
//!
//! A touch is a block, a strike or neither, never both; contacts are blocks plus strikes.
//!
//! **Defensive block**: a touch other than a strike, on a ball that approached the player's own
//! goal line at [`Rules::least_approach`] or more and left with less of that velocity.
#![doc = include_str!("referee/pictures/block.svg")]
//!
//! **Offensive strike**: a touch after which the ball approaches the opponent's goal line at
//! [`Rules::least_approach`] or more, faster than before.
#![doc = include_str!("referee/pictures/strike.svg")]
//!
//! **Goal-directed hit**: a strike whose straight continuation passes over the opponent's cup.
#![doc = include_str!("referee/pictures/goal_directed.svg")]
//!
//! **Possession**: the fraction of the time since an episode's first touch during which a player
//! was the last to touch the ball.
#![doc = include_str!("referee/pictures/possession.svg")]
//!
//! # Limits
//!
//! Biscuits count only where `/camera/frame` has them: recordings with the detector of this program. Two bounces at one wall, or two
//! impulses of striker and wall, within one frame count as one. Spin is not estimated.

mod analysis;
mod compare;
mod document;
mod episodes;
mod event;
mod events_file;
mod frames;
mod impacts;
mod live;
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
pub use live::LiveReferee;
pub use matches::{ScoredMatch, analyze_matches};
pub use metric::{Figure, Metric, summarise};
pub use page::page;
pub use rules::Rules;
pub use table::write_episodes;

use crate::recording::RecordingError;
use std::path::PathBuf;

/// Error of evaluating a match.
#[derive(Debug, thiserror::Error)]
pub enum RefereeError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The recording has no ball positions.
    #[error(
        "{}: neither /camera/detections nor /board/state; its topics are: {}",
        path.display(), if topics.is_empty() { "none" } else { topics }
    )]
    NoFrames {
        /// The recording.
        path: PathBuf,
        /// Topics of the recording.
        topics: String,
    },
}

/// Definition of a term, with one sentence and one picture.
struct Definition {
    word: &'static str,
    sentence: &'static str,
    picture: &'static str,
}

/// Terms of the score, as defined on pages.
const DEFINITIONS: [Definition; 4] = [
    Definition {
        word: "Defensive block",
        sentence: "A touch other than a strike, on a ball that approached the player's own goal line at \
                   0.1 m/s or more and left with less of that velocity.",
        picture: include_str!("referee/pictures/block.svg"),
    },
    Definition {
        word: "Offensive strike",
        sentence: "A touch after which the ball approaches the opponent's goal line at 0.1 m/s or \
                   more, faster than before.",
        picture: include_str!("referee/pictures/strike.svg"),
    },
    Definition {
        word: "Goal-directed hit",
        sentence: "A strike whose straight continuation passes over the opponent's cup.",
        picture: include_str!("referee/pictures/goal_directed.svg"),
    },
    Definition {
        word: "Possession",
        sentence: "The fraction of the time since an episode's first touch during which a player was \
                   the last to touch the ball.",
        picture: include_str!("referee/pictures/possession.svg"),
    },
];
