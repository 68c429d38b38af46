//! `score.json`.

use super::{
    analysis::Episode,
    compare::Comparison,
    episodes::Outcome,
    matches::ScoredMatch,
    metric::{Figure, summarise},
};
use crate::recording::topic::Player;
use serde::Serialize;
use std::collections::BTreeMap;

/// Version of the document; raised when a field changes its meaning.
pub const SCHEMA_VERSION: u32 = 2;
/// Name of the file that holds the events, beside the document.
pub const EVENTS_FILE: &str = "events.mcap";

/// The score of some matches.
#[derive(Debug, Clone, Serialize)]
pub struct Score {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// One per match, in the order given.
    pub matches: Vec<MatchScore>,
    /// Over all episodes of all matches, by name of the metric.
    pub summary: BTreeMap<&'static str, Figure>,
    /// File with the events, beside this document.
    pub events_file: &'static str,
    /// Of `--compare`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Comparison>,
}

/// The score of one match.
#[derive(Debug, Clone, Serialize)]
pub struct MatchScore {
    /// The recording.
    pub file: String,
    /// Who has more points; none when nobody has.
    pub winner: Option<Player>,
    /// Length of the recording (s).
    pub duration_s: f64,
    /// In order of time.
    pub episodes: Vec<EpisodeScore>,
}

/// The score of one episode.
#[derive(Debug, Clone, Serialize)]
pub struct EpisodeScore {
    /// Since the recording began (s).
    pub start_s: f64,
    /// Since the recording began (s).
    pub end_s: f64,
    /// How it ended.
    pub outcome: Outcome,
    /// Who got the point.
    pub scorer: Option<Player>,
    /// Blocks and strikes of both.
    pub contacts: usize,
    /// Blocks of the left player.
    pub blocks_left: usize,
    /// Blocks of the right player.
    pub blocks_right: usize,
    /// Strikes of the left player.
    pub strikes_left: usize,
    /// Strikes of the right player.
    pub strikes_right: usize,
    /// Goal-directed strikes of the left player.
    pub goal_directed_left: usize,
    /// Goal-directed strikes of the right player.
    pub goal_directed_right: usize,
    /// Left player's possession, 0 to 1; none without a touch.
    pub possession_left: Option<f64>,
}

impl Score {
    /// The document of `matches`.
    #[must_use]
    pub fn new(matches: &[ScoredMatch], seed: u64) -> Self {
        let episodes = matches.iter().flat_map(|scored| &scored.analysis.episodes);
        Self {
            schema_version: SCHEMA_VERSION,
            summary: summarise(episodes, seed),
            matches: matches.iter().map(MatchScore::new).collect(),
            events_file: EVENTS_FILE,
            comparison: None,
        }
    }
}

impl MatchScore {
    fn new(scored: &ScoredMatch) -> Self {
        Self {
            file: scored.path.display().to_string(),
            winner: scored.analysis.winner(),
            duration_s: scored.analysis.duration(),
            episodes: scored.analysis.episodes.iter().map(EpisodeScore::new).collect(),
        }
    }
}

impl EpisodeScore {
    fn new(episode: &Episode) -> Self {
        Self {
            start_s: episode.span.start,
            end_s: episode.span.end,
            outcome: episode.span.outcome,
            scorer: episode.span.scorer,
            contacts: episode.contacts(),
            blocks_left: episode.blocks[0],
            blocks_right: episode.blocks[1],
            strikes_left: episode.strikes[0],
            strikes_right: episode.strikes[1],
            goal_directed_left: episode.goal_directed[0],
            goal_directed_right: episode.goal_directed[1],
            possession_left: episode.possession(Player::Left),
        }
    }
}
