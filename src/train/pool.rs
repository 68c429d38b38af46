//! Opponent pool: earlier policies or a script, and the sampling of opponents.
//!
//! Sources: the weights `0.9^(N-i-1)` and the update above a mean score difference of 0.7 are the
//! paper's (appendix A.2). The first opponent is untrained and stochastic while later ones play
//! mean actions, as in upstream. Unlike upstream, the window holds finished games only: it is empty
//! at first, not full of draws, and nothing is added without an outcome.

use super::{
    elo::{self, expected_score},
    settings::{OpponentMode, OpponentSettings, ScriptedWeights},
};
use crate::{
    opponent::{Moment, Scripted},
    ppo::{Policy, Scratch, StepIndex},
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::{borrow::Cow, collections::VecDeque};

/// Action selection of a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// Mean action.
    Mean,
    /// Action sampled around the mean.
    Random,
}

/// An opponent.
#[derive(Debug, Clone)]
pub enum Opponent {
    /// A frozen policy.
    Policy(Box<Policy>, Choice),
    /// A scripted player.
    Scripted(Scripted),
}

/// Rows of observations for which decisions are requested.
#[derive(Debug)]
pub(super) struct Question<'a> {
    /// Seed of the run.
    pub(super) seed: u64,
    /// Index of the control period.
    pub(super) step: u64,
    /// Environment of each row.
    pub(super) boards: &'a [u32],
    /// Observations, `[rows][width]`.
    pub(super) rows: &'a [f32],
    /// Speed of a full action (m/s).
    pub(super) speed: f32,
}

impl Opponent {
    /// Write velocities (m/s) for each row of `question` into `velocities`; `actions` is a reused
    /// buffer.
    pub(super) fn decide(
        &self,
        question: &Question<'_>,
        velocities: &mut [[f32; 2]],
        (scratch, actions): (&mut Scratch, &mut Vec<f32>),
    ) {
        let Question { seed, step, boards, rows, speed } = *question;
        match self {
            Self::Policy(policy, choice) => {
                actions.resize(2 * velocities.len(), 0.0);
                match choice {
                    Choice::Mean => policy.act_mean(rows, actions, scratch),
                    Choice::Random => {
                        let place = StepIndex { step, first_environment: boards[0] as usize };
                        policy.act_random((seed, "opponents", place), rows, actions, scratch);
                    }
                }
                for (velocity, action) in velocities.iter_mut().zip(actions.chunks_exact(2)) {
                    *velocity = velocity_of(action, speed);
                }
            }
            Self::Scripted(script) => {
                let width = rows.len() / velocities.len();
                let rows = rows.chunks_exact(width).zip(boards);
                for (velocity, (row, board)) in velocities.iter_mut().zip(rows) {
                    let moment = Moment { seed, board: u64::from(*board), step };
                    *velocity = script.velocity(row, moment, speed);
                }
            }
        }
    }
}

/// Velocity (m/s) of an action: clamped to -1 to 1, times `speed`.
pub(super) fn velocity_of(action: &[f32], speed: f32) -> [f32; 2] {
    [action[0], action[1]].map(|action| speed * action.clamp(-1.0, 1.0))
}

/// Description of a pool member.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Member {
    /// Name in tables: `update_8`, or that of a script.
    pub name: String,
    /// Number of updates of its training.
    pub update: u64,
    /// Its rating when it joined.
    pub rating: f64,
    /// Action selection.
    pub choice: Choice,
}

/// State of the pool without the policies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PoolState {
    pub(super) members: Vec<Member>,
    /// Scores of the last finished games: 1, 0, -1.
    pub(super) window: VecDeque<i8>,
    /// Running rating of the learner.
    pub(super) rating: f64,
}

/// A finished game of the learner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct GameResult {
    /// Index of the opponent.
    pub(super) opponent: u32,
    /// Score: 1 won, 0 drawn, -1 lost.
    pub(super) score: i8,
}

/// Indices from here on are draws of a scripted player, one index for each unit of weight; they are equal for all
/// sizes of the pool.
const FIRST_SCRIPTED: u32 = 1 << 31;

/// Return whether `drawn` is the index of a scripted player beside the pool.
pub(super) fn is_scripted(drawn: u32) -> bool {
    FIRST_SCRIPTED <= drawn
}

/// Scripted player of an index; `None` for that of a pool member and for an index above the sum of the weights.
pub(super) fn scripted_of(drawn: u32, weights: ScriptedWeights) -> Option<Scripted> {
    let mut unit = drawn.checked_sub(FIRST_SCRIPTED)?;
    for (player, weight) in weights.players() {
        if unit < weight {
            return Some(player);
        }
        unit -= weight;
    }
    None
}

/// Opponents with their sampling weights.
#[derive(Debug, Clone)]
pub(super) struct Pool {
    settings: OpponentSettings,
    pub(super) opponents: Vec<Opponent>,
    pub(super) state: PoolState,
    /// Cumulative weights of the members; the last is 1.
    cumulative: Vec<f64>,
}

impl Pool {
    /// Pool at the start of training, with the untrained `policy`.
    pub(super) fn new(settings: OpponentSettings, policy: Policy) -> Self {
        let (opponent, name) = match settings.mode {
            OpponentMode::Scripted(script) => {
                (Opponent::Scripted(script), script.name().to_owned())
            }
            _ => (Opponent::Policy(Box::new(policy), Choice::Random), "update_0".to_owned()),
        };
        let member = Member { name, update: 0, rating: elo::BASE, choice: Choice::Random };
        let state = PoolState { members: vec![member], window: VecDeque::new(), rating: elo::BASE };
        Self::from_parts(settings, vec![opponent], state)
    }

    /// Restore a pool; one opponent for each member.
    pub(super) fn from_parts(
        settings: OpponentSettings,
        opponents: Vec<Opponent>,
        state: PoolState,
    ) -> Self {
        let mut pool = Self { settings, opponents, state, cumulative: Vec::new() };
        pool.weigh();
        pool
    }

    fn weigh(&mut self) {
        let weights = weights(self.settings.mode, self.settings.decay, self.opponents.len());
        let total: f64 = weights.iter().sum();
        let mut sum = 0.0;
        self.cumulative = weights
            .iter()
            .map(|weight| {
                sum += weight / total;
                sum
            })
            .collect();
    }

    /// Opponent of an index that [`draw`](Self::draw) returned.
    pub(super) fn opponent(&self, drawn: u32) -> Cow<'_, Opponent> {
        match scripted_of(drawn, self.settings.scripted_weights) {
            Some(script) => Cow::Owned(Opponent::Scripted(script)),
            None => Cow::Borrowed(&self.opponents[drawn as usize]),
        }
    }

    /// Sample the opponent of the episode that begins in environment `board` at control period
    /// `step`.
    pub(super) fn draw(&self, seed: u64, board: u64, step: u64) -> u32 {
        let scripted = self.settings.scripted_fraction;
        if self.opponents.len() < 2 && scripted == 0.0 {
            return 0;
        }
        let mut stream = Stream::numbered(seed, "train.opponent", &[board, step]);
        if 0.0 < scripted && f64::from(stream.uniform_f32(0.0, 1.0)) < scripted {
            return FIRST_SCRIPTED
                + stream.below(self.settings.scripted_weights.total() as usize) as u32;
        }
        let draw = f64::from(stream.uniform_f32(0.0, 1.0));
        let last = self.cumulative.len() - 1;
        self.cumulative.iter().position(|sum| draw < *sum).unwrap_or(last) as u32
    }

    /// Add finished games; returns the mean of the learner's rating over them. Games against
    /// scripted players beside the pool do not count.
    pub(super) fn take_in(&mut self, results: impl Iterator<Item = GameResult>) -> f64 {
        let (mut sum, mut count) = (0.0, 0u32);
        let own = |result: &GameResult| !is_scripted(result.opponent);
        for GameResult { opponent, score } in results.filter(own) {
            let state = &mut self.state;
            if state.window.len() == self.settings.window_games {
                state.window.pop_front();
            }
            state.window.push_back(score);
            let other = state.members[opponent as usize].rating;
            let points = f64::midpoint(f64::from(score), 1.0);
            state.rating += elo::K * (points - expected_score(state.rating, other));
            sum += state.rating;
            count += 1;
        }
        if count == 0 { self.state.rating } else { sum / f64::from(count) }
    }

    /// Mean score difference over the window, if it is full.
    pub(super) fn score(&self) -> Option<f64> {
        let window = &self.state.window;
        let full = window.len() == self.settings.window_games;
        full.then(|| {
            window.iter().map(|score| f64::from(*score)).sum::<f64>() / window.len() as f64
        })
    }

    /// Return whether the score difference exceeds the threshold.
    pub(super) fn wants_update(&self) -> bool {
        let scripted = matches!(self.settings.mode, OpponentMode::Scripted(_));
        !scripted && self.score().is_some_and(|score| self.settings.update_score < score)
    }

    /// Add a copy of the learner after `update` updates, and clear the window.
    pub(super) fn push(&mut self, policy: Policy, update: u64) {
        let name = format!("update_{update}");
        let rating = self.state.rating;
        self.state.members.push(Member { name, update, rating, choice: Choice::Mean });
        self.opponents.push(Opponent::Policy(Box::new(policy), Choice::Mean));
        self.state.window.clear();
        self.weigh();
    }

    /// Remove the oldest members above the limit; returns their number.
    pub(super) fn forget_oldest(&mut self) -> usize {
        let excess = self.opponents.len().saturating_sub(self.settings.most);
        self.opponents.drain(..excess);
        self.state.members.drain(..excess);
        self.weigh();
        excess
    }
}

/// Sampling weight of each of `count` members, oldest first.
fn weights(mode: OpponentMode, decay: f64, count: usize) -> Vec<f64> {
    let of = |index: usize| match mode {
        OpponentMode::Enhanced => decay.powi((count - index - 1) as i32),
        OpponentMode::Best => f64::from(u8::from(index + 1 == count)),
        OpponentMode::Uniform | OpponentMode::Scripted(_) => 1.0,
    };
    (0..count).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ppo::{Learner, PpoSettings, Spaces},
        train::{Preset, TrainSettings},
    };

    fn policy() -> Policy {
        let spaces = Spaces { observations: 12, actions: 2 };
        let settings = PpoSettings { hidden: vec![4], ..PpoSettings::paper() };
        Learner::new(&settings, spaces, 1).unwrap().policy()
    }

    fn pool(mode: OpponentMode, window_games: usize, members: u64) -> Pool {
        let settings = TrainSettings::preset(Preset::Paper).opponents;
        let settings = OpponentSettings { mode, window_games, ..settings };
        let mut pool = Pool::new(settings, policy());
        (1..members).for_each(|update| pool.push(policy(), update));
        pool
    }

    #[test]
    fn weights_are_those_of_each_mode() {
        let found = weights(OpponentMode::Enhanced, 0.9, 3);
        for (found, expected) in found.iter().zip([0.81, 0.9, 1.0]) {
            assert!((found - expected).abs() < 1e-12);
        }
        assert_eq!(weights(OpponentMode::Uniform, 0.9, 3), [1.0; 3]);
        assert_eq!(weights(OpponentMode::Best, 0.9, 3), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn opponents_are_drawn_by_their_weights() {
        let shares = |mode| {
            let pool = pool(mode, 8, 3);
            let mut counts = [0u32; 3];
            (0..30_000).for_each(|board| counts[pool.draw(5, board, 7) as usize] += 1);
            counts.map(|count| f64::from(count) / 30_000.0)
        };
        // 0.81 + 0.9 + 1 = 2.71; a fraction of 30,000 draws has a standard deviation of at most
        // 0.0029.
        let expected = [0.81, 0.9, 1.0].map(|weight| weight / 2.71);
        for (found, expected) in shares(OpponentMode::Enhanced).iter().zip(expected) {
            assert!((found - expected).abs() < 0.012, "{found} {expected}");
        }
        for found in shares(OpponentMode::Uniform) {
            assert!((found - 1.0 / 3.0).abs() < 0.012, "{found}");
        }
        assert_eq!(shares(OpponentMode::Best), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn scripted_players_beside_the_pool_are_drawn_and_do_not_count() {
        let mut pool = pool(OpponentMode::Best, 2, 1);
        pool.settings.scripted_fraction = 0.4;
        let drawn: Vec<u32> = (0..30_000).map(|board| pool.draw(5, board, 7)).collect();
        let share = |wanted: &dyn Fn(u32) -> bool| {
            drawn.iter().filter(|drawn| wanted(**drawn)).count() as f64 / 30_000.0
        };
        assert!((share(&is_scripted) - 0.4).abs() < 0.012);
        let weights = pool.settings.scripted_weights;
        for (script, expected) in [(Scripted::Stationary, 0.08), (Scripted::Chaser, 0.16)] {
            let found = share(&|drawn| scripted_of(drawn, weights) == Some(script));
            assert!((found - expected).abs() < 0.012, "{script}: {found}");
        }
        let opponent = drawn.iter().copied().find(|drawn| is_scripted(*drawn)).unwrap();
        pool.take_in([GameResult { opponent, score: 1 }; 3].into_iter());
        assert_eq!((pool.score(), pool.state.rating), (None, elo::BASE));
    }

    #[test]
    fn only_a_full_window_of_finished_games_updates_the_pool() {
        let mut pool = pool(OpponentMode::Enhanced, 20, 1);
        let play = |pool: &mut Pool, scores: &[i8]| {
            pool.take_in(scores.iter().map(|score| GameResult { opponent: 0, score: *score }))
        };
        play(&mut pool, &[1; 19]);
        assert_eq!((pool.score(), pool.wants_update()), (None, false));
        play(&mut pool, &[-1, -1, -1]);
        // The last 20: 17 won, 3 lost: exactly 0.7 does not pass.
        assert_eq!((pool.score(), pool.wants_update()), (Some(0.7), false));
        play(&mut pool, &[1; 17]);
        assert_eq!(pool.score(), Some(0.7));
        play(&mut pool, &[1]);
        assert!(pool.wants_update());
        pool.push(policy(), 3);
        assert_eq!((pool.score(), pool.opponents.len()), (None, 2));
        assert_eq!(pool.state.members[1].name, "update_3");
    }

    #[test]
    fn the_rating_of_the_learner_follows_its_games() {
        let mut pool = pool(OpponentMode::Enhanced, 20, 1);
        let won = GameResult { opponent: 0, score: 1 };
        let drawn = GameResult { opponent: 0, score: 0 };
        let mean = pool.take_in([won].into_iter());
        assert_eq!((mean, pool.state.rating), (1205.0, 1205.0));
        pool.take_in([drawn].into_iter());
        assert!(pool.state.rating < 1205.0, "a draw against a weaker one costs");
    }

    #[test]
    fn the_oldest_are_forgotten_and_a_script_is_alone() {
        let mut pool = pool(OpponentMode::Uniform, 8, 5);
        pool.settings.most = 2;
        assert_eq!(pool.forget_oldest(), 3);
        let names: Vec<&str> = pool.state.members.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["update_3", "update_4"]);
        let mut pool = self::pool(OpponentMode::Scripted(Scripted::Chaser), 1, 1);
        pool.take_in([GameResult { opponent: 0, score: 1 }].into_iter());
        assert!(!pool.wants_update());
        assert_eq!(pool.state.members[0].name, "chaser");
    }
}
