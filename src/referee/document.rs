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

/// Version of the document; increased when a field changes its name or meaning.
pub const SCHEMA_VERSION: u32 = 2;
/// Name of the file of the events, in the same folder.
pub const EVENTS_FILE: &str = "events.mcap";

/// Score of matches.
#[derive(Debug, Clone, Serialize)]
pub struct Score {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Scores by match, in the order given.
    pub matches: Vec<MatchScore>,
    /// Metrics over all episodes of all matches, by name.
    pub summary: BTreeMap<&'static str, Figure>,
    /// Name of the file of the events, in the same folder.
    pub events_file: &'static str,
    /// Matches without an episode, as sentences; they count in no metric.
    pub warnings: Vec<String>,
    /// Comparison of two groups (`--compare`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Comparison>,
}

/// Score of one match.
#[derive(Debug, Clone, Serialize)]
pub struct MatchScore {
    /// File of the recording.
    pub file: String,
    /// Player with more points; null for a draw.
    pub winner: Option<Player>,
    /// Duration of the recording (s).
    pub duration_s: f64,
    /// Episodes in order of time.
    pub episodes: Vec<EpisodeScore>,
}

/// Score of one episode.
#[derive(Debug, Clone, Serialize)]
pub struct EpisodeScore {
    /// Start time since the recording began (s).
    pub start_s: f64,
    /// End time since the recording began (s).
    pub end_s: f64,
    /// End of the episode.
    pub outcome: Outcome,
    /// Player who got the point; null without a point.
    pub scorer: Option<Player>,
    /// Number of blocks and strikes of both players.
    pub contacts: usize,
    /// Number of blocks of the left player.
    pub blocks_left: usize,
    /// Number of blocks of the right player.
    pub blocks_right: usize,
    /// Number of strikes of the left player.
    pub strikes_left: usize,
    /// Number of strikes of the right player.
    pub strikes_right: usize,
    /// Number of goal-directed strikes of the left player.
    pub goal_directed_left: usize,
    /// Number of goal-directed strikes of the right player.
    pub goal_directed_right: usize,
    /// Possession of the left player, 0 to 1; null without a touch.
    pub possession_left: Option<f64>,
}

impl Score {
    /// Score document of `matches`.
    #[must_use]
    pub fn new(matches: &[ScoredMatch], seed: u64) -> Self {
        let episodes = matches.iter().flat_map(|scored| &scored.analysis.episodes);
        Self {
            schema_version: SCHEMA_VERSION,
            summary: summarise(episodes, seed),
            matches: matches.iter().map(MatchScore::new).collect(),
            events_file: EVENTS_FILE,
            warnings: matches.iter().filter_map(without_episode).collect(),
            comparison: None,
        }
    }
}

/// Warning about a match without an episode.
fn without_episode(scored: &ScoredMatch) -> Option<String> {
    scored.analysis.episodes.is_empty().then(|| {
        format!(
            "{}: no episode: the ball is never detected in play, so the recording counts in no metric; \
             check the camera with `klasktron info`",
            scored.path.display()
        )
    })
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
