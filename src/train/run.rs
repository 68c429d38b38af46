//! Training loop: environments and learner, update by update.
//!
//! At every checkpoint ([`TrainSettings::checkpoint_updates`]) the state of the learner, the pool,
//! all environments and some counters is stored. A resumed run continues with the bytes of an
//! uninterrupted one.

use super::{
    TrainError,
    block::{Block, BlockState, Scene, ranges},
    curve::{CurvePoint, Tally, TimeShares},
    environments::{EnvironmentSource, Environments},
    pool::{Opponent, Pool, PoolState},
    settings::TrainSettings,
    table::Tables,
};
use crate::{
    game::{
        ActuatorQueries, BiscuitSettings, ClockFn, EpisodeSettings, GameError, GameSettings, Games,
        ObservedGames, Outcomes, PreviousCommands,
    },
    opponent::{Moment, Scripted},
    ppo::{Learner, LearnerState, Policy, PpoError, Rollout, RolloutPart, RolloutShape, for_each},
    recording::topic::Player,
    seed::Stream,
};
use std::num::NonZeroUsize;

/// Number of environments of the random play before the first update.
const LOOK_BOARDS: usize = 256;
/// Number of control periods of that random play.
const LOOK_STEPS: u64 = 100;
/// Interval of observations taken from it (control periods).
const LOOK_EVERY: u64 = 10;

/// Resources of a run.
#[derive(Debug, Clone, Copy)]
pub struct Machine {
    /// Number of threads; results do not depend on it.
    pub threads: NonZeroUsize,
    /// Clock in seconds since any instant; only [`TimeShares`] depends on it.
    pub clock: ClockFn,
}

/// Complete state for resuming a run.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    /// State of the learner.
    pub(super) learner: LearnerState,
    /// Counters of the pool; its policies are in [`opponents`](Self::opponents).
    pub(super) pool: PoolState,
    /// Opponents, one per member.
    pub(super) opponents: Vec<Opponent>,
    /// Queries of the actuator models so far.
    pub(super) queries: ActuatorQueries,
    /// Learning curve so far.
    pub(super) curve: Vec<CurvePoint>,
    /// Environments by block; empty before the first update, and where they cannot be saved.
    pub(super) boards: Vec<BlockState>,
}

/// A training run.
#[derive(Debug)]
pub struct Run {
    settings: TrainSettings,
    game: GameSettings,
    machine: Machine,
    /// Builder of the environments; `None` for simulated games.
    source: Option<Box<dyn EnvironmentSource>>,
    learner: Learner,
    pool: Pool,
    blocks: Vec<Block>,
    rollout: Rollout,
    last_values: Vec<f32>,
    curve: Vec<CurvePoint>,
    /// Queries before the run was resumed.
    queries: ActuatorQueries,
    checkpoint: Checkpoint,
    times: TimeShares,
}

/// Work of one block in one update.
struct Work<'a> {
    block: &'a mut Block,
    part: RolloutPart<'a>,
    last_values: &'a mut [f32],
}

impl Run {
    /// Start a run. `game` defines the actuator model; its randomization is that of the settings.
    ///
    /// # Errors
    /// When a setting is outside its range.
    pub fn new(
        settings: &TrainSettings,
        game: &GameSettings,
        machine: Machine,
    ) -> Result<Self, TrainError> {
        settings.check()?;
        let game = game_of(settings, game);
        let mut learner = Learner::new(&settings.learner(), settings.spaces(), settings.seed)?;
        look_around(&mut learner, settings, &game)?;
        let pool = Pool::new(settings.opponents, learner.policy());
        let checkpoint = Checkpoint {
            learner: learner.state(),
            pool: pool.state.clone(),
            opponents: pool.opponents.clone(),
            queries: ActuatorQueries::default(),
            curve: Vec::new(),
            boards: Vec::new(),
        };
        Self::assemble(settings, game, machine, checkpoint)
    }

    /// Resume from a checkpoint of the same settings, except for [`TrainSettings::steps`].
    ///
    /// # Errors
    /// When a setting is outside its range, or the checkpoint has networks of other sizes.
    pub fn resume(
        settings: &TrainSettings,
        game: &GameSettings,
        machine: Machine,
        checkpoint: Checkpoint,
    ) -> Result<Self, TrainError> {
        settings.check()?;
        Self::assemble(settings, game_of(settings, game), machine, checkpoint)
    }

    fn assemble(
        settings: &TrainSettings,
        game: GameSettings,
        machine: Machine,
        checkpoint: Checkpoint,
    ) -> Result<Self, TrainError> {
        game.check()?;
        let TrainSettings { seed, environments, .. } = settings;
        let (updates, threads) = (settings.updates(), machine.threads);
        log::info!(
            "seed {seed}, {environments} environments, {updates} updates, {threads} threads"
        );
        let spaces = settings.spaces();
        let shape = RolloutShape {
            horizon: settings.ppo.horizon,
            environments: settings.environments,
            spaces,
        };
        let Checkpoint { opponents, pool, queries, curve, .. } = checkpoint.clone();
        let learner = Learner::resume(&settings.learner(), spaces, &checkpoint.learner)?;
        Ok(Self {
            learner: match settings.reflection() {
                Some(reflection) => learner.with_reflection(reflection),
                None => learner,
            },
            pool: Pool::from_parts(settings.opponents, opponents, pool),
            blocks: Vec::new(),
            rollout: Rollout::new(shape),
            last_values: vec![0.0; settings.environments],
            curve,
            queries,
            checkpoint,
            times: TimeShares::default(),
            settings: settings.clone(),
            game,
            machine,
            source: None,
        })
    }

    /// The same run in the environments of `source`; [`game`](Self::game) remains that of the
    /// evaluation.
    #[must_use]
    pub fn in_environments(self, source: Box<dyn EnvironmentSource>) -> Self {
        Self { source: Some(source), ..self }
    }

    /// Settings of the run.
    #[must_use]
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// The game.
    #[must_use]
    pub fn game(&self) -> &GameSettings {
        &self.game
    }

    /// The game of the evaluation, with its time limit; the ball begins at rest.
    #[must_use]
    pub fn evaluation_game(&self) -> GameSettings {
        let time_limit = self.settings.evaluation.time_limit_s;
        let EpisodeSettings {
            moving_fraction,
            served_fraction,
            aligned_fraction,
            continued_fraction,
            ..
        } = EpisodeSettings::default();
        let episode = EpisodeSettings {
            time_limit,
            moving_fraction,
            served_fraction,
            aligned_fraction,
            continued_fraction,
            ..self.game.episode
        };
        GameSettings { episode, ..self.game.clone() }
    }

    /// Learning curve so far, oldest first.
    #[must_use]
    pub fn curve(&self) -> &[CurvePoint] {
        &self.curve
    }

    /// The current policy.
    #[must_use]
    pub fn policy(&self) -> Policy {
        self.learner.policy()
    }

    /// Time profile so far.
    #[must_use]
    pub fn times(&self) -> TimeShares {
        self.times
    }

    /// Names and policies of the pool, oldest first.
    pub(super) fn pool(&self) -> &Pool {
        &self.pool
    }

    /// The newest checkpoint.
    #[must_use]
    pub fn checkpoint(&self) -> &Checkpoint {
        &self.checkpoint
    }

    /// Queries of the actuator models so far.
    #[must_use]
    pub fn queries(&self) -> ActuatorQueries {
        self.blocks.iter().map(|block| block.tables.observed.queries()).fold(self.queries, plus)
    }

    /// Return whether all updates are done.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.settings.updates() <= self.learner.updates()
    }

    /// Return whether the next update begins with a checkpoint.
    #[must_use]
    pub fn is_at_checkpoint(&self) -> bool {
        self.learner.updates().is_multiple_of(self.settings.checkpoint_updates)
    }

    /// Run one update: a rollout, and learning from it.
    ///
    /// # Errors
    /// [`TrainError::NotFinite`] when a value becomes non-finite; the learner and the newest
    /// checkpoint are then unchanged.
    pub fn update(&mut self) -> Result<&CurvePoint, TrainError> {
        let begun = (self.machine.clock)();
        if self.blocks.is_empty() {
            self.set_up()?;
        }
        if self.is_at_checkpoint() {
            self.keep_checkpoint();
        }
        let before = self.times_of_blocks();
        self.roll_out()?;
        let played = (self.machine.clock)();
        let report = self
            .learner
            .learn(&self.rollout, &self.last_values, self.machine.threads)
            .map_err(|error| self.stopped(&error))?;
        let learned = (self.machine.clock)();
        let tally = self.tally();
        let policy_s = tally.spent.policy;
        let elo = self.pool.take_in(tally.results.iter().copied());
        self.curve.push(point(&self.settings, &tally, (elo, self.pool.opponents.len()), report));
        if self.pool.wants_update() {
            self.pool.push(self.learner.policy(), self.learner.updates());
        }
        self.count_time([begun, played, learned], before, policy_s);
        let (updates, played_s, learned_s) =
            (self.learner.updates(), played - begun, learned - played);
        log::debug!("update {updates}: rollout {played_s:.3} s, learning {learned_s:.3} s");
        Ok(&self.curve[self.curve.len() - 1])
    }

    /// Time of all blocks in game steps so far (s): physics and actuators.
    fn times_of_blocks(&self) -> [f64; 2] {
        self.blocks
            .iter()
            .map(|block| block.tables.observed.spent())
            .fold([0.0; 2], |sum, spent| [sum[0] + spent.physics, sum[1] + spent.actuators])
    }

    fn count_time(&mut self, [begun, played, learned]: [f64; 3], before: [f64; 2], policy_s: f64) {
        let threads = self.machine.threads.get() as f64;
        let after = self.times_of_blocks();
        let [physics, actuators] = [after[0] - before[0], after[1] - before[1]];
        let now = (self.machine.clock)();
        let times = &mut self.times;
        times.wall_s += now - begun;
        times.physics_s += physics;
        times.actuator_s += actuators;
        times.policy_s += policy_s;
        times.learning_s += threads * (learned - played);
        let all = threads * (now - begun);
        let rest = all - threads * (learned - played) - physics - actuators - policy_s;
        times.other_s += rest.max(0.0);
        times.transitions += self.settings.transitions_per_update();
    }

    /// Create the environments from the checkpoint, or new ones.
    fn set_up(&mut self) -> Result<(), TrainError> {
        let Self { settings, game, machine, pool, checkpoint, source, .. } = self;
        let starts = Stream::new(settings.seed, "train.boards").below(1 << 62) as u64;
        let step = self.learner.updates() * settings.ppo.horizon as u64;
        let mut kept = checkpoint.boards.iter();
        let blocks = ranges(settings.environments).into_iter().map(|range| {
            let observed: Box<dyn Environments> = match &source {
                Some(source) => source.build(range.clone(), machine.clock)?,
                None => {
                    let mut games = ObservedGames::new(Games::range(range.clone(), game, starts)?);
                    games.set_clock(machine.clock);
                    Box::new(games)
                }
            };
            let tables = Tables::over(observed, range, game, settings.layout());
            match kept.next() {
                Some(state) => Block::restore(tables, state),
                None => Ok(Block::new(tables, pool, settings.seed, step)),
            }
        });
        self.blocks = blocks.collect::<Result<_, GameError>>()?;
        Ok(())
    }

    fn keep_checkpoint(&mut self) {
        let forgotten = self.pool.forget_oldest();
        self.blocks.iter_mut().for_each(|block| block.forget_opponents(forgotten));
        self.checkpoint = Checkpoint {
            learner: self.learner.state(),
            pool: self.pool.state.clone(),
            opponents: self.pool.opponents.clone(),
            queries: self.queries(),
            curve: self.curve.clone(),
            boards: match self.learner.updates() {
                0 => Vec::new(),
                _ => {
                    self.blocks.iter().map(Block::state).collect::<Option<_>>().unwrap_or_default()
                }
            },
        };
    }

    fn roll_out(&mut self) -> Result<(), TrainError> {
        let scene = Scene {
            learner: &self.learner,
            pool: &self.pool,
            reward: &self.settings.reward,
            seed: self.settings.seed,
            first_step: self.learner.updates() * self.settings.ppo.horizon as u64,
            environments: self.settings.environments,
            clock: self.machine.clock,
        };
        let ranges = ranges(self.settings.environments);
        let mut rest = self.last_values.as_mut_slice();
        let mut works = Vec::with_capacity(ranges.len());
        for (block, part) in self.blocks.iter_mut().zip(self.rollout.split(&ranges)) {
            let (last_values, others) = rest.split_at_mut(block.tables.len());
            rest = others;
            works.push(Work { block, part, last_values });
        }
        let mut outcomes = vec![Ok(()); works.len()];
        let items = works.into_iter().zip(&mut outcomes).collect();
        for_each(self.machine.threads, items, |(work, outcome): (Work<'_>, &mut _)| {
            let Work { block, part, last_values } = work;
            *outcome = block.play(&scene, part, last_values);
        });
        let failed = outcomes.into_iter().find_map(Result::err);
        failed.map_or(Ok(()), |error| Err(self.stopped_game(error)))
    }

    /// Sum of the tallies of all blocks; resets them.
    fn tally(&mut self) -> Tally {
        let mut all = Tally::default();
        for block in &mut self.blocks {
            let tally = std::mem::take(&mut block.tally);
            all.results.extend(tally.results);
            all.returns += tally.returns;
            all.episode_steps += tally.episode_steps;
            all.hits += tally.hits;
            all.own_goals += tally.own_goals;
            all.spent.policy += tally.spent.policy;
        }
        all
    }

    fn not_finite(&self, reason: String) -> TrainError {
        let updates = self.learner.updates();
        TrainError::NotFinite {
            transitions: updates * self.settings.transitions_per_update(),
            update: updates + 1,
            seed: self.settings.seed,
            reason,
        }
    }

    fn stopped(&self, error: &PpoError) -> TrainError {
        self.not_finite(error.to_string())
    }

    fn stopped_game(&self, error: GameError) -> TrainError {
        match error {
            GameError::Rig { .. } => error.into(),
            _ => self.not_finite(error.to_string()),
        }
    }
}

/// The game with the randomization of the settings.
fn game_of(settings: &TrainSettings, game: &GameSettings) -> GameSettings {
    let starts = settings.starts;
    GameSettings {
        episode: EpisodeSettings {
            moving_fraction: starts.moving_fraction,
            ball_speed: starts.ball_speed_m_per_s,
            served_fraction: starts.served_fraction,
            aligned_fraction: starts.aligned_fraction,
            continued_fraction: starts.continued_fraction,
            ..game.episode
        },
        randomization: settings.randomization_ranges(),
        sensors: settings.sensors,
        biscuits: settings.biscuits.then(BiscuitSettings::default),
        ..game.clone()
    }
}

fn plus(a: ActuatorQueries, b: ActuatorQueries) -> ActuatorQueries {
    ActuatorQueries { total: a.total + b.total, extrapolated: a.extrapolated + b.extrapolated }
}

fn point(
    settings: &TrainSettings,
    tally: &Tally,
    (elo, pool): (f64, usize),
    learning: crate::ppo::UpdateReport,
) -> CurvePoint {
    use crate::game::CONTROL_PERIOD;
    let games = tally.results.len() as u64;
    let of = |score: i8| tally.results.iter().filter(|result| result.score == score).count() as u64;
    let mean = |sum: f64| if games == 0 { 0.0 } else { sum / games as f64 };
    let transitions = learning.update * settings.transitions_per_update();
    let minutes = settings.transitions_per_update() as f64 * CONTROL_PERIOD / 60.0;
    CurvePoint {
        update: learning.update,
        transitions,
        games,
        won: of(1),
        lost: of(-1),
        own_goals: tally.own_goals,
        mean_return: mean(tally.returns),
        mean_episode_s: mean(tally.episode_steps as f64 * CONTROL_PERIOD),
        hits_per_minute: tally.hits as f64 / minutes,
        elo,
        pool: pool as u64,
        shaping_left: f64::from(settings.reward.shaping_left(transitions)),
        learning,
    }
}

/// Initialize the observation moments from random play, so that the first update does not use
/// unnormalized observations.
fn look_around(
    learner: &mut Learner,
    settings: &TrainSettings,
    game: &GameSettings,
) -> Result<(), TrainError> {
    let count = settings.environments.min(LOOK_BOARDS);
    let seed = Stream::new(settings.seed, "train.look").below(1 << 62) as u64;
    let mut games = Games::new(count, game, seed)?;
    let mut outcomes = Outcomes::new(count);
    let layout = settings.layout();
    let mut seen = vec![0.0; count * layout.len()];
    let mut commands = vec![[[0.0; 2]; 2]; count];
    let mut previous = vec![[PreviousCommands::default(); 2]; count];
    let (speed, cup_distance) = (game.limits.speed as f32, game.cup.distance as f32);
    for step in 0..LOOK_STEPS {
        for (board, commands) in commands.iter_mut().enumerate() {
            for (player, command) in commands.iter_mut().enumerate() {
                let moment = Moment { seed, board: (2 * board + player) as u64, step };
                *command = Scripted::Random.velocity(&[0.0; 12], moment, speed);
                previous[board][player].push(*command);
            }
        }
        games.step(&commands, &mut outcomes)?;
        if step.is_multiple_of(LOOK_EVERY) {
            for player in Player::BOTH {
                for (board, row) in seen.chunks_exact_mut(layout.len()).enumerate() {
                    let own = &previous[board][player as usize];
                    layout.write(&games.observation(board, player), own, cup_distance, row);
                }
                learner.observe(&seen)?;
            }
        }
    }
    Ok(())
}
