//! The boards: their state in arrays, and the step.

use super::{
    actuation::{Actuators, Leading, Rails, turned},
    biscuit::BiscuitState,
    body::{BallState, Mover, StrikerState, add, along, dot, length, scale, subtract},
    error::GameError,
    laws::BallLaws,
    motion::{Happened, Play, Table},
    observation::{ObservationKind, Sight},
    outcome::{Ending, Outcomes},
    randomization::BoardPhysics,
    settings::{BiscuitSettings, CONTROL_PERIOD, EpisodeSettings, GameSettings, instances},
};
use crate::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    effects::Oscillator,
    gantry::PerPlayer,
    recording::topic::Player,
    seed::Stream,
    twin::Instance,
};
use std::ops::Range;

/// Boards that go through a step together: their state stays in the processor's caches meanwhile.
pub(super) const CHUNK: usize = 64;

/// A striker displaced by less than this (m, and m/s) is back on its magnet.
const BACK_HOME: f64 = 1e-9;

/// Draws of the ball's start until it is clear of the strikers.
const MOST_DRAWS: usize = 32;

/// Which episode a board plays, and how far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Clock {
    episode: u64,
    step: u32,
}

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
    /// What one piece does to a striker that was hit.
    recoil: Oscillator,
    striker_mass: f64,
    nominal: BoardPhysics,
    settings: GameSettings,
    seed: u64,
    first: usize,
    balls: Vec<BallState>,
    strikers: Vec<[StrikerState; 2]>,
    physics: Vec<BoardPhysics>,
    clocks: Vec<Clock>,
    /// Empty in a game without.
    biscuits: Vec<[BiscuitState; 3]>,
    actuators: Actuators,
    commands: Vec<[[f64; 2]; 2]>,
    ways: Vec<[f64; 2]>,
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
        let table = table(settings);
        let half = table.half;
        let rails = Rails::new(settings.limits, half, STRIKER_RADIUS, settings.pieces);
        let striker = settings.striker;
        let ratio = settings.ball.static_friction_ratio;
        let nominal = BoardPhysics {
            ball_mass: settings.ball.mass,
            walls: table.laws.walls.surface(ratio),
            strikers: table.laws.strikers.surface(ratio),
        };
        let with_biscuits = if settings.biscuits.is_some() { count } else { 0 };
        let mut games = Self {
            recoil: Oscillator::new(
                striker.magnet_frequency,
                striker.magnet_damping,
                rails.piece(),
            ),
            striker_mass: striker.mass,
            nominal,
            settings: settings.clone(),
            seed,
            first: range.start,
            balls: vec![BallState::at([0.0; 2]); count],
            strikers: vec![[StrikerState::default(); 2]; count],
            physics: vec![nominal; count],
            clocks: vec![Clock::default(); count],
            biscuits: vec![[BiscuitState::default(); 3]; with_biscuits],
            actuators: Actuators::new(&settings.actuation, &rails, count),
            commands: vec![[[0.0; 2]; 2]; CHUNK.min(count)],
            ways: vec![[0.0; 2]; CHUNK.min(count) * 2 * (settings.pieces + 1)],
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
            self.take_in(chunk.clone(), commands);
            let mut leading = Leading {
                first,
                commands: &self.commands[..chunk.len()],
                strikers: &mut self.strikers[chunk.clone()],
                ways: &mut self.ways[..chunk.len() * 2 * (self.rails.pieces + 1)],
                rails: &self.rails,
            };
            self.actuators.lead(&mut leading);
            for board in chunk {
                self.play(board, board - first, outcomes)?;
            }
        }
        Ok(())
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
                *clock = Clock { episode: clock.episode + 1, step: 0 };
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
        let on_command = limits.limiter == super::settings::LimiterPlace::Command;
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
        let pieces = self.rails.pieces;
        let h = self.rails.piece();
        let stride = pieces + 1;
        let start = CONTROL_PERIOD * f64::from(self.clocks[board].step);
        let mut all = Happened::NOTHING;
        let mut ended = None;
        let mut places = self.strikers_before(board, row);
        for piece in 0..pieces {
            let push = if piece == 0 { 0.5 * h } else { h };
            self.push(board, places, start + h * piece as f64, push);
            let way = |player: usize| {
                let at = (2 * row + player) * stride + piece;
                [self.ways[at], self.ways[at + 1]]
            };
            let ways = [way(0), way(1)];
            ended = self.play_piece(board, ways, &mut places, &mut all);
            if ended.is_some() {
                break;
            }
        }
        if ended.is_none() {
            self.push(board, places, start + CONTROL_PERIOD, 0.5 * h);
        }
        let clock = &mut self.clocks[board];
        clock.step += 1;
        if ended.is_none() && self.settings.most_steps() <= clock.step {
            ended = Some(Ending::TimeLimit);
        }
        outcomes.ended[board] = ended;
        outcomes.hits[board] = all.hits;
        outcomes.hit_speeds[board] = all.struck.map(|speed| speed as f32);
        outcomes.wall_hits[board] = all.wall_hits;
        self.check_finite(board)
    }

    /// Places of the strikers before the period (m): the ways begin where the magnets were.
    fn strikers_before(&self, board: usize, row: usize) -> [[f64; 2]; 2] {
        let stride = self.rails.pieces + 1;
        [0, 1].map(|player| {
            add(self.ways[(2 * row + player) * stride], self.strikers[board][player].recoil)
        })
    }

    fn push(&mut self, board: usize, strikers: [[f64; 2]; 2], time: f64, dt: f64) {
        let play = Play { table: &self.table, physics: &self.physics[board] };
        play.push(&mut self.balls[board], strikers, time, dt);
    }

    /// One piece of a period: the magnets go straight from the first to the second place of `ways`.
    /// `places` are those of the strikers, before and then after.
    fn play_piece(
        &mut self,
        board: usize,
        ways: [[[f64; 2]; 2]; 2],
        places: &mut [[f64; 2]; 2],
        all: &mut Happened,
    ) -> Option<Ending> {
        let h = self.rails.piece();
        let mut movers = [Mover::striker([0.0; 2], [0.0; 2], self.striker_mass); 5];
        for player in 0..2 {
            let striker = &mut self.strikers[board][player];
            swing(&self.recoil, striker);
            let end = add(ways[player][1], striker.recoil);
            let velocity = scale(subtract(end, places[player]), 1.0 / h);
            movers[player] = Mover::striker(places[player], velocity, self.striker_mass);
        }
        let mut count = 2;
        if let (Some(settings), Some(biscuits)) =
            (&self.settings.biscuits, self.biscuits.get(board))
        {
            for biscuit in biscuits {
                movers[count] = biscuit.mover(settings, &movers[..2]);
                count += 1;
            }
        }
        let play = Play { table: &self.table, physics: &self.physics[board] };
        let happened = play.drift(&mut self.balls[board], &mut movers[..count], h);
        all.add(&happened);
        let before = *places;
        if let Some(settings) = self.settings.biscuits {
            self.move_biscuits(&settings, board, before, &mut movers);
        }
        for player in 0..2 {
            let striker = &mut self.strikers[board][player];
            striker.recoil = add(striker.recoil, movers[player].moved);
            striker.recoil_velocity = add(striker.recoil_velocity, movers[player].kicked);
            places[player] = movers[player].position;
        }
        self.ending(board, &happened, [before, *places])
    }

    /// Biscuits after a piece: they slide, stick to strikers, and those that stick hand on what hit them.
    fn move_biscuits(
        &mut self,
        settings: &BiscuitSettings,
        board: usize,
        before: [[f64; 2]; 2],
        movers: &mut [Mover; 5],
    ) {
        let h = self.rails.piece();
        let walls = (self.table.half, self.physics[board].walls.restitution);
        let (strikers, others) = movers.split_at_mut(2);
        for (biscuit, mover) in self.biscuits[board].iter_mut().zip(others) {
            if let Some(holder) = biscuit.holder {
                let striker = &mut strikers[usize::from(holder)];
                striker.kick(mover.kicked);
                continue;
            }
            let start = biscuit.position;
            biscuit.slide(settings, mover, walls, h);
            for (holder, striker) in strikers.iter().enumerate() {
                let from = subtract(start, before[holder]);
                let to = subtract(biscuit.position, striker.position);
                if biscuit.holder.is_none() && nearest(from, to) < settings.capture_distance {
                    biscuit.stick(holder as u8, striker.position);
                }
            }
        }
    }

    /// How the episode ended in a piece through which the strikers went from `ways[0]` to `ways[1]`, if it
    /// did. When several things happen in one piece, the first of them in upstream's order counts.
    fn ending(
        &self,
        board: usize,
        happened: &Happened,
        ways: [[[f64; 2]; 2]; 2],
    ) -> Option<Ending> {
        if happened.taken {
            let scorer =
                if self.balls[board].position[1] < 0.0 { Player::Right } else { Player::Left };
            return Some(Ending::Goal { scorer });
        }
        let cup = &self.table.cup;
        for loser in Player::BOTH {
            let player = loser as usize;
            let centre = turned(player, [0.0, -cup.distance]);
            let [from, to] = ways.map(|places| subtract(places[player], centre));
            if nearest(from, to) < cup.radius {
                return Some(Ending::OwnGoal { loser });
            }
        }
        let biscuits = self.biscuits.get(board)?;
        let held =
            |player: Player| biscuits.iter().filter(|own| own.holder == Some(player as u8)).count();
        let loser = Player::BOTH.into_iter().find(|player| 2 <= held(*player))?;
        Some(Ending::Biscuits { loser })
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
        let Clock { episode, step } = self.clocks[board];
        let (board, step) = (self.first + board, step - 1);
        Err(GameError::NotFinite { board, episode, step, seed: self.seed })
    }

    /// The start of an episode, drawn from seed, board and episode alone.
    fn begin(&mut self, board: usize) {
        let numbers = [(self.first + board) as u64, self.clocks[board].episode];
        let mut stream = Stream::numbered(self.seed, "game.start", &numbers);
        let (strikers, ball) = draw_start(&self.settings.episode, &mut stream);
        self.physics[board] = self.settings.randomization.map_or(self.nominal, |ranges| {
            ranges.draw(&mut Stream::numbered(self.seed, "game.physics", &numbers))
        });
        self.balls[board] = BallState::at(ball);
        self.stand(board, strikers);
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

/// A striker that was hit swings on its magnet for one piece.
fn swing(magnet: &Oscillator, striker: &mut StrikerState) {
    let StrikerState { recoil, recoil_velocity, .. } = striker;
    if *recoil == [0.0; 2] && *recoil_velocity == [0.0; 2] {
        return;
    }
    let mut size = 0.0;
    for axis in 0..2 {
        let (place, velocity) = magnet.step(recoil[axis], recoil_velocity[axis]);
        (recoil[axis], recoil_velocity[axis]) = (place, velocity);
        size += place.abs() + velocity.abs();
    }
    if size < BACK_HOME {
        (*recoil, *recoil_velocity) = ([0.0; 2], [0.0; 2]);
    }
}

fn table(settings: &GameSettings) -> Table {
    let complete = |effects: &[Instance]| {
        let mut effects = effects.to_vec();
        if settings.randomization.is_some() {
            // What is drawn needs a law to act through.
            let missing =
                |entry: &Instance| effects.iter().all(|own| own.effect.name != entry.effect.name);
            let neutral: [(&str, &[f64]); 2] =
                [("impact.wall_restitution", &[1.0]), ("impact.wall_friction_spin", &[0.0])];
            let added: Vec<Instance> = instances(&neutral).into_iter().filter(missing).collect();
            effects.extend(added);
        }
        effects
    };
    let ball = &settings.ball;
    Table {
        laws: BallLaws::new(&complete(&ball.effects), &complete(&ball.striker_effects)),
        cup: settings.cup,
        half: [settings.board.short_side / 2.0, settings.board.long_side / 2.0],
    }
}

/// Places of the strikers and of the ball at the start of an episode.
fn draw_start(settings: &EpisodeSettings, stream: &mut Stream) -> ([[f64; 2]; 2], [f64; 2]) {
    let mut draw =
        |low: f64, high: f64| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
    let EpisodeSettings { striker_x, striker_y: [near, far], ball_x, ball_y, .. } = *settings;
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
        let ball = [draw(-ball_x, ball_x), draw(-ball_y, ball_y)];
        if clear(ball) {
            return (strikers, ball);
        }
    }
    (strikers, [0.0; 2])
}

/// Least distance from the origin of a point that goes straight from `from` to `to`.
fn nearest(from: [f64; 2], to: [f64; 2]) -> f64 {
    let way = subtract(to, from);
    let square = dot(way, way);
    let share = if 0.0 < square { (-dot(from, way) / square).clamp(0.0, 1.0) } else { 0.0 };
    length(along(from, way, share))
}
