//! Score of a match: points, and games won.

use crate::{
    recording::topic::Player,
    referee::{LiveReferee, Rules, Span},
};
use serde::Serialize;
use std::fmt;

/// When a match is won.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MatchFormat {
    /// Points that win a game, at least 1; 6 by the rules of KLASK.
    pub points_per_game: u32,
    /// Largest number of games, odd: 1 for a single game.
    pub best_of: u32,
}

/// Score of a match.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MatchScore {
    /// Points of the left and the right player in the current game, or in the last one of a match that is won.
    pub points: [u32; 2],
    /// Games won by the left and the right player; zero without a [`MatchFormat`].
    pub games: [u32; 2],
}

impl MatchScore {
    /// Score after `episodes`; without a `format` the whole match is one game without an end.
    #[must_use]
    pub fn of(episodes: &[Span], format: Option<MatchFormat>) -> Self {
        let mut score = Self::default();
        let mut game_over = false;
        for scorer in episodes.iter().filter_map(|episode| episode.scorer) {
            if score.winner(format).is_some() {
                break;
            }
            if std::mem::take(&mut game_over) {
                score.points = [0; 2];
            }
            let points = &mut score.points[scorer as usize];
            *points += 1;
            if format.is_some_and(|format| format.points_per_game <= *points) {
                score.games[scorer as usize] += 1;
                game_over = true;
            }
        }
        score
    }

    /// Player who has won the match: more than half of the games.
    #[must_use]
    pub fn winner(&self, format: Option<MatchFormat>) -> Option<Player> {
        let most = format?.best_of;
        Player::BOTH.into_iter().find(|player| most < 2 * self.games[*player as usize])
    }
}

impl fmt::Display for MatchScore {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [left, right] = self.points;
        write!(to, "{left} : {right}")?;
        match self.games {
            [0, 0] => Ok(()),
            [left, right] => write!(to, " (games {left} : {right})"),
        }
    }
}

/// Referee of the match that is being played, with its score.
pub(super) struct Scoring {
    referee: LiveReferee,
    format: Option<MatchFormat>,
    score: MatchScore,
}

impl Scoring {
    pub(super) fn new(format: Option<MatchFormat>) -> Self {
        let referee = LiveReferee::new(Rules::default());
        Self { referee, format, score: MatchScore::default() }
    }

    pub(super) fn referee(&mut self) -> &mut LiveReferee {
        &mut self.referee
    }

    pub(super) fn score(&self) -> MatchScore {
        self.score
    }

    /// Take what the referee has seen; return the score if it has changed.
    pub(super) fn update(&mut self) -> Option<MatchScore> {
        let score = MatchScore::of(self.referee.episodes(), self.format);
        let before = std::mem::replace(&mut self.score, score);
        (before != score).then_some(score)
    }

    pub(super) fn is_over(&self) -> bool {
        self.score.winner(self.format).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::referee::Outcome;

    /// Episodes with these scorers: `l`, `r`, or nobody.
    fn episodes(scorers: &str) -> Vec<Span> {
        let scorer = |own: char| match own {
            'l' => Some(Player::Left),
            'r' => Some(Player::Right),
            _ => None,
        };
        let of = |own| Span { start: 0.0, end: 1.0, outcome: Outcome::Goal, scorer: scorer(own) };
        scorers.chars().map(of).collect()
    }

    #[test]
    fn games_end_at_their_points_and_a_match_with_most_games() {
        let of = |scorers: &str, points_per_game, best_of| {
            let format = Some(MatchFormat { points_per_game, best_of });
            let score = MatchScore::of(&episodes(scorers), format);
            (score.points, score.games, score.winner(format))
        };
        assert_eq!(of("lr-l", 2, 1), ([2, 1], [1, 0], Some(Player::Left)));
        assert_eq!(of("ll", 2, 3), ([2, 0], [1, 0], None));
        // The next point is the first of the next game.
        assert_eq!(of("llr", 2, 3), ([0, 1], [1, 0], None));
        assert_eq!(of("llrrrlr", 2, 3), ([1, 2], [1, 2], Some(Player::Right)));
        // After the match nothing counts.
        assert_eq!(of("llrr", 1, 1), ([1, 0], [1, 0], Some(Player::Left)));
    }

    #[test]
    fn without_a_format_a_match_is_one_game_without_an_end() {
        let score = MatchScore::of(&episodes("lllllllrr-"), None);
        assert_eq!((score.points, score.games, score.winner(None)), ([7, 2], [0, 0], None));
        assert_eq!(score.to_string(), "7 : 2");
        assert_eq!(MatchScore { points: [2, 1], games: [1, 1] }.to_string(), "2 : 1 (games 1 : 1)");
    }
}
