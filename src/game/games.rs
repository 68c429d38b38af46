//! The boards: their state in arrays, and the step.

use super::{
    actuation::{Actuators, Leading, Rails, turned},
    biscuit::BiscuitState,
    body::{BallState, StrikerState, length, subtract},
    error::GameError,
    motion::Table,
    observation::{ObservationKind, Sight},
    outcome::{Ending, Outcomes},
    period::Period,
    randomization::BoardPhysics,
    settings::{CONTROL_PERIOD, EpisodeSettings, GameSettings, LimiterPlace},
};
use crate::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    gantry::PerPlayer,
    recording::topic::Player,
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Boards that go through a step together: their state stays in the processor's caches meanwhile.
pub(super) const CHUNK: usize = 64;

/// Draws of the ball's start until it is clear of the strikers.
const MOST_DRAWS: usize = 32;

/// Which episode a board plays, and how far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Clock {
    pub(super) episode: u64,
    pub(super) step: u32,
    /// Control periods for which the ball has lain still.
    pub(super) still: u32,
}

/// A slower ball lies still (m/s).
const STILL_SPEED: f64 = 0.005;

/// What stands where on one board (m, m/s; board frame; players are left, right).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// Episode of this board, from 0.
    pub episode: u64,
    /// Control periods played in it.
    pub step: u32,
    /// Place of the ball.
    pub ball_position: [f64; 2],
    /// Its velocity.
    pub ball_velocity: [f64; 2],
    /// Places of the strikers.
    pub striker_positions: [[f64; 2]; 2],
    /// Their velocities.
    pub striker_velocities: [[f64; 2]; 2],
    /// Places of the biscuits, in a game with them.
    pub biscuits: Option<[[f64; 2]; 3]>,
    /// How many of them stick to each striker.
    pub biscuits_held: [u8; 2],
    /// Physics of this episode.
    pub physics: BoardPhysics,
}

/// Many boards that are played at once.
#[derive(Debug, Clone)]
pub struct Games {
    table: Table,
    rails: Rails,
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
    /// Empty in a game without.
    pub(super) biscuits: Vec<[BiscuitState; 3]>,
    pub(super) actuators: Actuators,
    commands: Vec<[[f64; 2]; 2]>,
    ways: Vec<[f64; 2]>,
    clock: Option<Clockwork>,
    spent: Spent,
}

/// A clock that the caller lends: seconds since any instant.
pub type Clockwork = fn() -> f64;

/// Time that steps took, by a lent clock (s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spent {
    /// Commands and actuators.
    pub actuators: f64,
    /// Ball, contacts and rules.
    pub physics: f64,
}

/// What a learned actuator was asked, when the games know its coverage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Asked {
    /// Velocities that it was asked for.
    pub all: u64,
    /// Of these, those far from everything in its training data.
    pub outside: u64,
}

impl Games {
    /// `count` boards at the start of their first episode.
    ///
    /// # Errors
    /// When a setting cannot be.
    pub fn new(count: usize, settings: &GameSettings, seed: u64) -> Result<Self, GameError> {
        Self::range(0..count, settings, seed)
    }

    /// The boards `range` out of a larger number: they play exactly as they would among all the others, so
    /// work is divided over threads by giving each a range of its own.
    ///
    /// # Errors
    /// When a setting cannot be.
    pub fn range(
        range: Range<usize>,
        settings: &GameSettings,
        seed: u64,
    ) -> Result<Self, GameError> {
        settings.check()?;
        let count = range.len();
        let table = Table::new(settings);
        let rails = Rails::new(settings.limits, table.half, STRIKER_RADIUS, settings.pieces);
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
            actuators: Actuators::new(settings, &rails, count),
            commands: vec![[[0.0; 2]; 2]; CHUNK.min(count)],
            ways: vec![[0.0; 2]; CHUNK.min(count) * 2 * (settings.pieces + 1)],
            clock: None,
            spent: Spent::default(),
            table,
            rails,
        };
        (0..count).for_each(|board| games.begin(board));
        Ok(games)
    }

    /// Number of boards.
    #[must_use]
    pub fn len(&self) -> usize {
        self.balls.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.balls.is_empty()
    }

    /// The settings that are played.
    #[must_use]
    pub fn settings(&self) -> &GameSettings {
        &self.settings
    }

    /// One control period, after which boards whose episode has ended begin the next one.
    ///
    /// `commands` are velocities (m/s), one entry per board: left and right player, each in the player's own
    /// frame. Nothing is allocated.
    ///
    /// # Errors
    /// When an array has the wrong length, a command is no number, or a board comes out of the step with a
    /// number that is none; then the boards are no longer of use.
    pub fn step(
        &mut self,
        commands: &[[[f32; 2]; 2]],
        outcomes: &mut Outcomes,
    ) -> Result<(), GameError> {
        self.advance(commands, outcomes)?;
        self.restart_ended(outcomes)
    }

    /// [`step`](Self::step) without the restart: boards whose episode has ended can still be looked at as
    /// they ended, and [`restart_ended`](Self::restart_ended) must follow.
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
                ways: &mut self.ways[..chunk.len() * 2 * (self.rails.pieces + 1)],
                rails: &self.rails,
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

    /// Measures with `clock` from now on what steps take; without a clock they take nothing.
    pub fn lend_clock(&mut self, clock: Clockwork) {
        self.clock = Some(clock);
    }

    /// Time that steps took since a clock was lent.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.spent
    }

    fn now(&self) -> f64 {
        self.clock.map_or(0.0, |clock| clock())
    }

    /// What the learned actuator was asked since the games began; nothing without
    /// [`GameSettings::coverage`].
    #[must_use]
    pub fn asked(&self) -> Asked {
        self.actuators.asked()
    }

    /// Begins the next episode on every board whose episode has ended according to `outcomes`.
    ///
    /// # Errors
    /// When `outcomes` has the wrong length.
    pub fn restart_ended(&mut self, outcomes: &Outcomes) -> Result<(), GameError> {
        self.check_length("outcomes", outcomes.len())?;
        for (board, ended) in outcomes.ended.iter().enumerate() {
            if ended.is_some() {
                let clock = &mut self.clocks[board];
                *clock = Clock { episode: clock.episode + 1, ..Clock::default() };
                self.begin(board);
            }
        }
        Ok(())
    }

    /// Writes what `player` sees of every board, `[count][kind.len()]`.
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
            Sight::of(player, strikers, ball).write(kind, cup_distance, row);
        }
        Ok(())
    }

    /// Writes what `player` sees of one board, `[kind.len()]`.
    ///
    /// # Panics
    /// When there is no such board, or `row` has the wrong length.
    pub fn observe_board(
        &self,
        board: usize,
        player: Player,
        kind: ObservationKind,
        row: &mut [f32],
    ) {
        let sight = Sight::of(player, &self.strikers[board], &self.balls[board]);
        sight.write(kind, self.table.cup.distance as f32, row);
    }

    /// What stands where on `board`.
    ///
    /// # Panics
    /// When there is no such board.
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

    /// Puts ball and strikers of `board` where one wants them, all at rest but for the ball, which rolls with
    /// `ball_velocity` (m/s); for exercises and tests. The episode goes on.
    ///
    /// # Panics
    /// When there is no such board.
    pub fn place(
        &mut self,
        board: usize,
        ball_position: [f64; 2],
        ball_velocity: [f64; 2],
        striker_positions: [[f64; 2]; 2],
    ) {
        self.balls[board] = BallState { velocity: ball_velocity, ..BallState::at(ball_position) };
        self.stand(board, striker_positions);
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
        Err(GameError::Command { board: self.first + board, player, x, y })
    }

    /// Clamp, slew limit and wall limiter for the boards of one chunk.
    fn take_in(&mut self, chunk: Range<usize>, commands: &[[[f32; 2]; 2]]) {
        let limits = &self.rails.limits;
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

    /// One control period of one board, the `row`-th of its chunk.
    fn play(&mut self, board: usize, row: usize, outcomes: &mut Outcomes) -> Result<(), GameError> {
        let stride = self.rails.pieces + 1;
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
        let over = self.most_steps <= clock.step || self.most_still_steps <= clock.still;
        if ended.is_none() && over {
            ended = Some(Ending::TimeLimit);
        }
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
        Err(GameError::NotFinite { board, episode, step, seed: self.seed })
    }

    /// The start of an episode, drawn from seed, board and episode alone.
    fn begin(&mut self, board: usize) {
        let mut stream = self.stream("game.start", board);
        let (strikers, ball) = draw_start(&self.settings.episode, &mut stream);
        self.draw_physics(board);
        self.balls[board] = BallState::at(ball);
        self.stand(board, strikers);
    }

    /// The physics of the episode that `board` plays.
    pub(super) fn draw_physics(&mut self, board: usize) {
        self.physics[board] = match &self.settings.randomization {
            Some(ranges) => ranges.draw(&mut self.stream("game.physics", board)),
            None => self.nominal,
        };
    }

    /// The stream called `name` of the episode that `board` plays.
    fn stream(&self, name: &str, board: usize) -> Stream {
        let numbers = [(self.first + board) as u64, self.clocks[board].episode];
        Stream::numbered(self.seed, name, &numbers)
    }

    /// Both strikers stand at rest at `positions`, and the biscuits where they belong.
    fn stand(&mut self, board: usize, positions: [[f64; 2]; 2]) {
        let strikers = &mut self.strikers[board];
        *strikers =
            [0, 1].map(|player| StrikerState::at(self.rails.clamp(player, positions[player])));
        self.actuators.restart(board, strikers);
        if let (Some(settings), Some(all)) = (&self.settings.biscuits, self.biscuits.get_mut(board))
        {
            *all = BiscuitState::start(settings);
        }
    }
}

/// Places of the strikers and of the ball at the start of an episode.
fn draw_start(settings: &EpisodeSettings, stream: &mut Stream) -> ([[f64; 2]; 2], [f64; 2]) {
    let mut draw =
        |low: f64, high: f64| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
    let EpisodeSettings { striker_x, striker_y: [near, far], ball_x, ball_y, .. } = *settings;
    let [ball_near, ball_far] = ball_y;
    let strikers = [0, 1].map(|player| {
        let own = [draw(-striker_x, striker_x), -draw(near, far)];
        turned(player, own)
    });
    let clear = |ball: [f64; 2]| {
        strikers
            .iter()
            .all(|striker| BALL_RADIUS + STRIKER_RADIUS < length(subtract(ball, *striker)))
    };
    for _ in 0..MOST_DRAWS {
        let (x, side) = (draw(-ball_x, ball_x), draw(-1.0, 1.0));
        let ball = [x, draw(ball_near, ball_far).copysign(side)];
        if clear(ball) {
            return (strikers, ball);
        }
    }
    (strikers, [0.0, ball_near])
}
