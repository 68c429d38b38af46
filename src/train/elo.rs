//! Elo ratings: base 1200, K = 10, scale 400, half a point for a draw.
//!
//! Source: the KlaskTron repository (`evaluate_agents.py`) and the paper; the formula is Elo's. The
//! expected score of A against B is `1 / (1 + 10^((R_B - R_A) / 400))`. After a game the rating
//! changes by `R_A += K (score - expected)`.
//!
//! Unlike upstream, every pair plays the same number of games from both seats, and ratings have
//! intervals: games are resampled with replacement and in a new order ([`bootstrap_ci95`]).

use crate::stats::{Interval, bootstrap_ci95};
use serde::{Deserialize, Serialize};

/// Initial rating.
pub const BASE: f64 = 1200.0;
/// Maximum change of a rating by one game.
pub const K: f64 = 10.0;
/// Rating difference at which the odds are ten to one.
const SCALE: f64 = 400.0;

/// Expected score of a player of rating `own` against `other`, 0 to 1.
#[must_use]
pub fn expected_score(own: f64, other: f64) -> f64 {
    1.0 / (1.0 + 10f64.powf((other - own) / SCALE))
}

/// A game between two players, given by their indices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Played {
    /// The two players.
    pub players: [usize; 2],
    /// Score of the first player: 1 won, 0.5 drawn, 0 lost.
    pub score: f64,
}

/// Ratings of `count` players after `games`, applied in order.
#[must_use]
pub fn ratings<'a>(count: usize, games: impl IntoIterator<Item = &'a Played>) -> Vec<f64> {
    let mut ratings = vec![BASE; count];
    for Played { players: [a, b], score } in games {
        let change = K * (score - expected_score(ratings[*a], ratings[*b]));
        ratings[*a] += change;
        ratings[*b] -= change;
    }
    ratings
}

/// One row of the Elo table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EloRow {
    /// Name of the player.
    pub player: String,
    /// Rating after all games in the order in which they were played.
    pub rating: f64,
    /// 95 % interval by bootstrap over games.
    pub ci95: Option<Interval>,
    /// Number of games of this player.
    pub games: u64,
}

/// Elo table, best first; equal ratings by name.
#[must_use]
pub fn table(names: &[String], games: &[Played], seed: u64) -> Vec<EloRow> {
    let found = ratings(names.len(), games);
    let mut rows: Vec<EloRow> = names
        .iter()
        .enumerate()
        .map(|(player, name)| EloRow {
            player: name.clone(),
            rating: found[player],
            ci95: bootstrap_ci95(games, seed, |drawn| {
                ratings(names.len(), drawn.iter().copied())[player]
            }),
            games: games.iter().filter(|game| game.players.contains(&player)).count() as u64,
        })
        .collect();
    rows.sort_by(|a, b| b.rating.total_cmp(&a.rating).then_with(|| a.player.cmp(&b.player)));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    #[test]
    fn ratings_follow_the_formula() {
        assert_eq!(expected_score(1200.0, 1200.0), 0.5);
        // 400 apart: ten to one.
        assert!((expected_score(1600.0, 1200.0) - 10.0 / 11.0).abs() < 1e-12);
        let first = Played { players: [0, 1], score: 1.0 };
        let found = ratings(2, &[first]);
        assert_eq!(found, [1205.0, 1195.0]);
        // Second game: expected 1 / (1 + 10^(-10/400)) = 0.514387, so 4.85613 are won.
        let found = ratings(2, &[first, first]);
        assert!((found[0] - 1_209.856_13).abs() < 1e-4, "{found:?}");
        assert!((found[0] + found[1] - 2400.0).abs() < 1e-9);
        let draw = Played { players: [1, 0], score: 0.5 };
        assert_eq!(ratings(2, &[draw]), [1200.0, 1200.0]);
    }

    #[test]
    fn the_table_finds_the_order_of_players_of_known_strength() {
        let strengths = [1400.0, 1200.0, 1000.0];
        let names = ["strong", "middle", "weak"].map(str::to_owned);
        let mut stream = Stream::new(4, "games");
        let mut games = Vec::new();
        for _ in 0..60 {
            for players in [[0, 1], [2, 0], [1, 2]] {
                let expected = expected_score(strengths[players[0]], strengths[players[1]]);
                let won = f64::from(stream.uniform_f32(0.0, 1.0)) < expected;
                games.push(Played { players, score: f64::from(u8::from(won)) });
            }
        }
        let rows = table(&names, &games, 0);
        let order: Vec<&str> = rows.iter().map(|row| row.player.as_str()).collect();
        assert_eq!(order, ["strong", "middle", "weak"]);
        for row in &rows {
            let ci95 = row.ci95.unwrap();
            assert_eq!(row.games, 120);
            assert!(ci95.low < row.rating && row.rating < ci95.high, "{row:?}");
        }
        assert!(rows[2].ci95.unwrap().high < rows[0].ci95.unwrap().low);
    }
}
