//! The environments: their state in arrays, and the step.

use super::{
    actuation::{Actuators, Leading, Travel, turned},
    biscuit::BiscuitState,
    body::{BallState, StrikerState, length, subtract},
    error::GameError,
    motion::Table,
    observation::{Observation, ObservationKind},
    outcome::{Ending, Outcomes},
    period::Period,
    randomization::BoardPhysics,
    settings::{CONTROL_PERIOD, EpisodeSettings, GameSettings, LimiterPlace},
};
use crate::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    gantry::PerPlayer,
    recording::{
        message::{BoardState, ObjectState},
        topic::Player,
    },
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::{f64::consts::TAU, ops::Range};

/// Number of environments that are stepped together, so that their state stays in the processor's
/// caches.
pub(super) const CHUNK: usize = 64;

/// Maximum number of draws of the ball's start position until it is clear of the strikers.
const MOST_DRAWS: usize = 32;

/// Episode of an environment and progress in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Clock {
    pub(super) episode: u64,
    pub(super) step: u32,
    /// Number of control periods for which the ball has been at rest.
    pub(super) still: u32,
}

/// Speed below which the ball counts as at rest (m/s).
const STILL_SPEED: f64 = 0.005;

/// State of one environment (m, m/s; board frame; players are left, right).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// Episode of this environment, from 0.
    pub episode: u64,
    /// Number of control periods played in it.
    pub step: u32,
    /// Position of the ball.
    pub ball_position: [f64; 2],
    /// Velocity of the ball.
    pub ball_velocity: [f64; 2],
    /// Positions of the strikers.
    pub striker_positions: [[f64; 2]; 2],
    /// Velocities of the strikers.
    pub striker_velocities: [[f64; 2]; 2],
    /// Positions of the biscuits, in a game with biscuits.
    pub biscuits: Option<[[f64; 2]; 3]>,
    /// Number of biscuits on each striker.
    pub biscuits_held: [u8; 2],
    /// Physics of this episode.
    pub physics: BoardPhysics,
}

impl Snapshot {
    /// Message of the state, as on `/board/state`.
    #[must_use]
    pub fn message(&self) -> BoardState {
        let object = |[x, y]: [f64; 2], [vx, vy]: [f64; 2]| Some(ObjectState { x, y, vx, vy });
        let [left, right] = [0, 1]
            .map(|player| object(self.striker_positions[player], self.striker_velocities[player]));
        let ball = object(self.ball_position, self.ball_velocity);
        BoardState { ball, left, right, status: 0 }
    }
}

/// Environments that are stepped together.
#[derive(Debug, Clone)]
pub struct Games {
    table: Table,
    travel: Travel,
    nominal: BoardPhysics,
    most_steps: u32,
    most_still_steps: u32,
    settings: GameSettings,
    seed: u64,
    first: usize,
    pub(super) balls: Vec<BallState>,
    pub(super) strikers: Vec<[StrikerState; 2]>,
    physics: Vec<BoardPhysics>,
    pub(super) clocks: Vec<Clock>,
    /// Empty in a game without biscuits.
    pub(super) biscuits: Vec<[BiscuitState; 3]>,
    pub(super) actuators: Actuators,
    commands: Vec<[[f64; 2]; 2]>,
    ways: Vec<[f64; 2]>,
    clock: Option<ClockFn>,
    spent: StepTimes,
}

/// A clock provided by the caller: seconds since any instant.
pub type ClockFn = fn() -> f64;

/// Time spent in steps, by that clock (s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepTimes {
    /// Commands and actuators.
    pub actuators: f64,
    /// Ball, contacts and rules.
    pub physics: f64,
}

/// Number of queries of a learned actuator model, if its coverage is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ActuatorQueries {
    /// Number of velocities that it predicted.
    pub total: u64,
    /// Number of these with inputs far from all training data (extrapolation).
    pub extrapolated: u64,
}

impl Games {
    /// Build `count` environments at the start of their first episode.
    ///
    /// # Errors
    /// When a setting is outside its range.
    pub fn new(count: usize, settings: &GameSettings, seed: u64) -> Result<Self, GameError> {
        Self::range(0..count, settings, seed)
    }

    /// Build the environments `range` of a larger set. They behave exactly as they would among all
    /// the others, so each thread can step a range of its own.
    ///
    /// # Errors
    /// When a setting is outside its range.
    pub fn range(
        range: Range<usize>,
        settings: &GameSettings,
        seed: u64,
    ) -> Result<Self, GameError> {
        settings.check()?;
        let count = range.len();
        let table = Table::new(settings);
        let travel = Travel::new(settings.limits, table.half, STRIKER_RADIUS, settings.pieces);
        let ratio = settings.ball.static_friction_ratio;
        let nominal = BoardPhysics {
            ball_mass: settings.ball.mass,
            walls: table.laws.walls.surface(ratio),
            strikers: table.laws.strikers.surface(ratio),
        };
        let with_biscuits = if settings.biscuits.is_some() { count } else { 0 };
        let mut games = Self {
            nominal,
            most_steps: settings.most_steps(),
            most_still_steps: settings.most_still_steps(),
            settings: settings.clone(),
            seed,
            first: range.start,
            balls: vec![BallState::at([0.0; 2]); count],
            strikers: vec![[StrikerState::default(); 2]; count],
            physics: vec![nominal; count],
            clocks: vec![Clock::default(); count],
            biscuits: vec![[BiscuitState::default(); 3]; with_biscuits],
            actuators: Actuators::new(settings, &travel, count),
            commands: vec![[[0.0; 2]; 2]; CHUNK.min(count)],
            ways: vec![[0.0; 2]; CHUNK.min(count) * 2 * (settings.pieces + 1)],
            clock: None,
            spent: StepTimes::default(),
            table,
            travel,
        };
        (0..count).for_each(|board| games.begin(board));
        Ok(games)
    }

    /// Number of environments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.balls.len()
    }

    /// Return whether there are no environments.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.balls.is_empty()
    }

    /// Settings of the game.
    #[must_use]
    pub fn settings(&self) -> &GameSettings {
        &self.settings
    }

    /// Step all environments by one control period; environments whose episode has ended begin the
    /// next one.
    ///
    /// `commands` are velocities (m/s), one entry per environment: left and right player, each in
    /// the player's own frame. Allocates nothing.
    ///
    /// # Errors
    /// When an array has the wrong length, or a command or the resulting state is not finite. After
    /// a non-finite state the environments are unusable.
    pub fn step(
        &mut self,
        commands: &[[[f32; 2]; 2]],
        outcomes: &mut Outcomes,
    ) -> Result<(), GameError> {
        self.advance(commands, outcomes)?;
        self.restart_ended(outcomes)
    }

    /// [`step`](Self::step) without the restart: environments whose episode has ended keep their
    /// final state, and [`restart_ended`](Self::restart_ended) must follow.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn advance(
        &mut self,
        commands: &[[[f32; 2]; 2]],
        outcomes: &mut Outcomes,
    ) -> Result<(), GameError> {
        self.check_length("commands", commands.len())?;
        self.check_length("outcomes", outcomes.len())?;
        self.check_commands(commands)?;
        for first in (0..self.len()).step_by(CHUNK) {
            let chunk = first..(first + CHUNK).min(self.len());
            let begun = self.now();
            self.take_in(chunk.clone(), commands);
            let mut leading = Leading {
                first,
                commands: &self.commands[..chunk.len()],
                strikers: &mut self.strikers[chunk.clone()],
                ways: &mut self.ways[..chunk.len() * 2 * (self.travel.pieces + 1)],
                travel: &self.travel,
            };
            self.actuators.lead(&mut leading);
            let led = self.now();
            for board in chunk {
                self.play(board, board - first, outcomes)?;
            }
            self.spent.actuators += led - begun;
            self.spent.physics += self.now() - led;
        }
        Ok(())
    }

    /// Measure the time of steps with `clock` from now on; without a clock all times are 0.
    pub fn set_clock(&mut self, clock: ClockFn) {
        self.clock = Some(clock);
    }

    /// Time spent in steps since a clock was set.
    #[must_use]
    pub fn spent(&self) -> StepTimes {
        self.spent
    }

    fn now(&self) -> f64 {
        self.clock.map_or(0.0, |clock| clock())
    }

    /// Queries of the learned actuator since the games began; zero without
    /// [`GameSettings::coverage`].
    #[must_use]
    pub fn queries(&self) -> ActuatorQueries {
        self.actuators.queries()
    }

    /// Begin the next episode in every environment whose episode has ended according to `outcomes`.
    ///
    /// # Errors
    /// When `outcomes` has the wrong length.
    pub fn restart_ended(&mut self, outcomes: &Outcomes) -> Result<(), GameError> {
        self.check_length("outcomes", outcomes.len())?;
        for (board, ended) in outcomes.ended.iter().enumerate() {
            let Some(ending) = *ended else { continue };
            let clock = &mut self.clocks[board];
            *clock = Clock { episode: clock.episode + 1, ..Clock::default() };
            if self.is_continued(board, ending) {
                self.put_ball_back(board);
            } else {
                self.begin(board);
            }
        }
        Ok(())
    }

    /// Write the observations of `player` in all environments, `[count][kind.len()]`.
    ///
    /// # Errors
    /// When `rows` has the wrong length.
    pub fn observe(
        &self,
        player: Player,
        kind: ObservationKind,
        rows: &mut [f32],
    ) -> Result<(), GameError> {
        let expected = self.len() * kind.len();
        if rows.len() != expected {
            return Err(GameError::Shape { what: "the observation", found: rows.len(), expected });
        }
        let cup_distance = self.table.cup.distance as f32;
        let boards = self.strikers.iter().zip(&self.balls);
        for ((strikers, ball), row) in boards.zip(rows.chunks_exact_mut(kind.len())) {
            Observation::of(player, strikers, ball).write(kind, cup_distance, row);
        }
        Ok(())
    }

    /// Exact, current observation of `player` in the environment `board`.
    ///
    /// # Panics
    /// When there is no such environment.
    #[must_use]
    pub fn observation(&self, board: usize, player: Player) -> Observation {
        Observation::of(player, &self.strikers[board], &self.balls[board])
    }

    /// Number of the first environment in the whole set, and seed.
    pub(super) fn origin(&self) -> (usize, u64) {
        (self.first, self.seed)
    }

    /// State of the environment `board`.
    ///
    /// # Panics
    /// When there is no such environment.
    #[must_use]
    pub fn snapshot(&self, board: usize) -> Snapshot {
        let strikers = &self.strikers[board];
        let striker_positions = strikers.map(|striker| striker.position());
        let biscuits = self.biscuits.get(board);
        let held = |holder: u8| {
            let count = |found: &[BiscuitState; 3]| {
                found.iter().filter(|biscuit| biscuit.holder == Some(holder)).count() as u8
            };
            biscuits.map_or(0, count)
        };
        Snapshot {
            episode: self.clocks[board].episode,
            step: self.clocks[board].step,
            ball_position: self.balls[board].position,
            ball_velocity: self.balls[board].velocity,
            striker_positions,
            striker_velocities: strikers.map(|striker| striker.velocity()),
            biscuits: biscuits.map(|all| all.map(|biscuit| biscuit.place(striker_positions))),
            biscuits_held: [held(0), held(1)],
            physics: self.physics[board],
        }
    }

    /// Set the positions (m) of ball and strikers of `board`. All are at rest except the ball,
    /// which has `ball_velocity` (m/s). For exercises and tests; the episode continues.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn set_positions(
        &mut self,
        board: usize,
        ball_position: [f64; 2],
        ball_velocity: [f64; 2],
        striker_positions: [[f64; 2]; 2],
    ) {
        self.balls[board] = BallState { velocity: ball_velocity, ..BallState::at(ball_position) };
        self.stand(board, striker_positions);
    }

    /// Begin the next episode of `board` with the ball at `ball_position` (m), moving at
    /// `ball_velocity` (m/s); the strikers go on. As when a person serves at a table.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn serve(&mut self, board: usize, ball_position: [f64; 2], ball_velocity: [f64; 2]) {
        let episode = self.clocks[board].episode + 1;
        self.clocks[board] = Clock { episode, ..Clock::default() };
        self.draw_physics(board);
        self.balls[board] = BallState { velocity: ball_velocity, ..BallState::at(ball_position) };
    }

    /// Both strikers of `board`.
    #[cfg(test)]
    pub(super) fn strikers_of(&self, board: usize) -> &[StrikerState; 2] {
        &self.strikers[board]
    }

    fn check_length(&self, what: &'static str, found: usize) -> Result<(), GameError> {
        let expected = self.len();
        if found == expected { Ok(()) } else { Err(GameError::Shape { what, found, expected }) }
    }

    fn check_commands(&self, commands: &[[[f32; 2]; 2]]) -> Result<(), GameError> {
        let sound = |command: &[[f32; 2]; 2]| command.iter().flatten().all(|v| v.is_finite());
        let Some(board) = commands.iter().position(|command| !sound(command)) else {
            return Ok(());
        };
        let bad = |player: &Player| {
            commands[board][*player as usize].iter().any(|value| !value.is_finite())
        };
        let player = Player::BOTH.into_iter().find(bad).unwrap_or(Player::Left);
        let [x, y] = commands[board][player as usize];
        Err(GameError::Command { environment: self.first + board, player, x, y })
    }

    /// Apply clamp, slew limit and wall limiter to the commands of one chunk.
    fn take_in(&mut self, chunk: Range<usize>, commands: &[[[f32; 2]; 2]]) {
        let limits = &self.travel.limits;
        let PerPlayer { left, right } = &limits.field;
        let on_command = limits.limiter == LimiterPlace::Command;
        let boards = self.strikers[chunk.clone()].iter_mut().zip(&commands[chunk]);
        for (taken, (strikers, commands)) in self.commands.iter_mut().zip(boards) {
            for (player, field) in [left, right].into_iter().enumerate() {
                let wanted = turned(player, commands[player].map(f64::from));
                let striker = &mut strikers[player];
                striker.command = limits.slewed(striker.command, wanted);
                taken[player] = if on_command {
                    limits.before_walls(field, striker.carriage, striker.command)
                } else {
                    striker.command
                };
            }
        }
    }

    /// Step one environment, the `row`-th of its chunk, by one control period.
    fn play(&mut self, board: usize, row: usize, outcomes: &mut Outcomes) -> Result<(), GameError> {
        let stride = self.travel.pieces + 1;
        let (left, right) = self.ways[2 * row * stride..][..2 * stride].split_at(stride);
        let mut period = Period {
            table: &self.table,
            physics: &self.physics[board],
            ball: &mut self.balls[board],
            strikers: &mut self.strikers[board],
            biscuits: self.biscuits.get_mut(board),
            ways: [left, right],
        };
        let clock = &mut self.clocks[board];
        let (all, mut ended) = period.play(CONTROL_PERIOD * f64::from(clock.step));
        clock.step += 1;
        let moves = STILL_SPEED <= length(self.balls[board].velocity);
        clock.still = if moves { 0 } else { clock.still + 1 };
        let [_, y] = self.balls[board].position;
        let at_rest = (self.most_still_steps <= clock.still).then(|| Ending::at_rest(y));
        let late = (self.most_steps <= clock.step).then_some(Ending::TimeLimit);
        ended = ended.or(at_rest).or(late);
        outcomes.ended[board] = ended;
        outcomes.hits[board] = all.hits;
        outcomes.hit_speeds[board] = all.struck.map(|speed| speed as f32);
        outcomes.wall_hits[board] = all.wall_hits;
        self.check_finite(board)
    }

    fn check_finite(&self, board: usize) -> Result<(), GameError> {
        let ball = &self.balls[board];
        let [left, right] = &self.strikers[board];
        let sum = [ball.position, ball.velocity, left.position(), right.position()]
            .iter()
            .fold(0.0, |sum, [x, y]| sum + x + y);
        if sum.is_finite() {
            return Ok(());
        }
        let Clock { episode, step, .. } = self.clocks[board];
        let (board, step) = (self.first + board, step - 1);
        Err(GameError::NotFinite { environment: board, episode, step, seed: self.seed })
    }

    /// Begin an episode, drawn from seed, environment and episode alone.
    fn begin(&mut self, board: usize) {
        let mut stream = self.stream("game.start", board);
        let (mut strikers, ball) = self.draw_start(board, &mut stream);
        align(&self.settings, &mut strikers, ball, &mut stream);
        self.draw_physics(board);
        let velocity = draw_velocity(&self.settings.episode, &mut stream);
        self.balls[board] = BallState { velocity, ..BallState::at(ball) };
        self.stand(board, strikers);
    }

    /// Return whether the players go on from where they are in the current episode of `board`,
    /// after the `ending` of the last one.
    pub(super) fn is_continued(&self, board: usize, ending: Ending) -> bool {
        let fraction = self.settings.episode.continued_fraction;
        if fraction == 0.0 || matches!(ending, Ending::OwnGoal { .. } | Ending::Biscuits { .. }) {
            return false;
        }
        f64::from(self.stream("game.continued", board).uniform_f32(0.0, 1.0)) < fraction
    }

    /// Put the ball to its next start, clear of the strikers where they are; if no draw is clear,
    /// to the last one.
    fn put_ball_back(&mut self, board: usize) {
        let mut stream = self.stream("game.start", board);
        let strikers = self.strikers[board].map(|striker| striker.position());
        let (_strikers, mut ball) = self.draw_start(board, &mut stream);
        for _ in 1..MOST_DRAWS {
            if is_clear(ball, &strikers) {
                break;
            }
            (_, ball) = self.draw_start(board, &mut stream);
        }
        let velocity = draw_velocity(&self.settings.episode, &mut stream);
        self.balls[board] = BallState { velocity, ..BallState::at(ball) };
        self.draw_physics(board);
    }

    /// Start positions of the strikers and of the ball, in the half that the serve favours.
    fn draw_start(&self, board: usize, stream: &mut Stream) -> ([[f64; 2]; 2], [f64; 2]) {
        let episode = &self.settings.episode;
        let (strikers, ball) = draw_start(episode, stream);
        if episode.served_fraction == 0.0 {
            return (strikers, ball);
        }
        let share = f64::from(stream.uniform_f32(0.0, 1.0));
        let is_left = (self.first + board).is_multiple_of(2) == (0.0 < episode.served_fraction);
        let is_own = is_left == (ball[1] < 0.0);
        if is_own || episode.served_fraction.abs() <= share {
            return (strikers, ball);
        }
        // The same start seen from the other seat.
        let turn = |[x, y]: [f64; 2]| [-x, -y];
        ([turn(strikers[1]), turn(strikers[0])], turn(ball))
    }

    /// Draw the physics of the current episode of `board`.
    pub(super) fn draw_physics(&mut self, board: usize) {
        self.physics[board] = match &self.settings.randomization {
            Some(ranges) => ranges.draw(&mut self.stream("game.physics", board)),
            None => self.nominal,
        };
    }

    /// Random stream called `name` of the current episode of `board`.
    fn stream(&self, name: &str, board: usize) -> Stream {
        let numbers = [(self.first + board) as u64, self.clocks[board].episode];
        Stream::numbered(self.seed, name, &numbers)
    }

    /// Put both strikers at rest at `positions`, and the biscuits at their start positions.
    fn stand(&mut self, board: usize, positions: [[f64; 2]; 2]) {
        let strikers = &mut self.strikers[board];
        *strikers =
            [0, 1].map(|player| StrikerState::at(self.travel.clamp(player, positions[player])));
        self.actuators.restart(board, strikers);
        if let (Some(settings), Some(all)) = (&self.settings.biscuits, self.biscuits.get_mut(board))
        {
            *all = BiscuitState::start(settings);
        }
    }
}

/// Distances of an aligned striker behind the ball (m), from just clear of it on.
const ALIGNED_DISTANCE: [f64; 2] = [BALL_RADIUS + STRIKER_RADIUS + 0.005, 0.08];
/// Largest lateral error of an aligned striker (m).
const ALIGNED_ERROR: f64 = 0.01;

/// Put the striker of the half of the ball behind it, in the drawn fraction of the episodes.
fn align(
    settings: &GameSettings,
    strikers: &mut [[f64; 2]; 2],
    ball: [f64; 2],
    stream: &mut Stream,
) {
    let (fraction, cup) = (settings.episode.aligned_fraction, &settings.cup);
    if fraction == 0.0 {
        return;
    }
    let mut draw =
        |low: f64, high: f64| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
    let [near, far] = ALIGNED_DISTANCE;
    let (share, behind) = (draw(0.0, 1.0), draw(near, far));
    let beside = draw(-ALIGNED_ERROR, ALIGNED_ERROR);
    let player = usize::from(0.0 < ball[1]);
    let other_cup = [0.0, -cup.distance.copysign(ball[1])];
    let way = subtract(other_cup, ball);
    let unit = [way[0] / length(way), way[1] / length(way)];
    let striker = [
        ball[0] - behind * unit[0] + beside * unit[1],
        ball[1] - behind * unit[1] - beside * unit[0],
    ];
    let own_cup = [0.0, cup.distance.copysign(ball[1])];
    if share < fraction && cup.radius + STRIKER_RADIUS < length(subtract(striker, own_cup)) {
        strikers[player] = striker;
    }
}

/// Start velocity of the ball.
fn draw_velocity(settings: &EpisodeSettings, stream: &mut Stream) -> [f64; 2] {
    if settings.moving_fraction == 0.0 {
        return [0.0; 2];
    }
    let mut draw = |high: f64| high * f64::from(stream.uniform_f32(0.0, 1.0));
    let (share, speed, angle) = (draw(1.0), draw(settings.ball_speed), draw(TAU));
    if settings.moving_fraction <= share {
        return [0.0; 2];
    }
    [speed * angle.cos(), speed * angle.sin()]
}

/// Return whether a ball at `ball` touches none of the `strikers` (m).
fn is_clear(ball: [f64; 2], strikers: &[[f64; 2]; 2]) -> bool {
    let distance = |striker: &[f64; 2]| length(subtract(ball, *striker));
    strikers.iter().all(|striker| BALL_RADIUS + STRIKER_RADIUS < distance(striker))
}

/// Start positions of the strikers and of the ball.
fn draw_start(settings: &EpisodeSettings, stream: &mut Stream) -> ([[f64; 2]; 2], [f64; 2]) {
    let mut draw =
        |low: f64, high: f64| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
    let EpisodeSettings { striker_x, striker_y: [near, far], ball_x, ball_y, .. } = *settings;
    let [ball_near, ball_far] = ball_y;
    let strikers = [0, 1].map(|player| {
        let own = [draw(-striker_x, striker_x), -draw(near, far)];
        turned(player, own)
    });
    for _ in 0..MOST_DRAWS {
        let (x, side) = (draw(-ball_x, ball_x), draw(-1.0, 1.0));
        let ball = [x, draw(ball_near, ball_far).copysign(side)];
        if is_clear(ball, &strikers) {
            return (strikers, ball);
        }
    }
    (strikers, [0.0, ball_near])
}
