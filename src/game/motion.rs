//! One piece of a control period in one environment: forces on the ball, and its path through all
//! contacts.
//!
//! A piece of length `h` uses Strang splitting: half a step of the forces, a straight path on which
//! every contact is solved, and another half step of the forces. Position and velocity are exact
//! for a constant deceleration; an impact inside a piece uses the velocity at its middle.

use super::{
    body::{BallState, Mover, ON_THE_BOARD, add, dot, length, scale, subtract},
    contact::{Walls, strike, time_to_leave, time_to_meet},
    cup::{fall_time, leaves_with},
    laws::BallLaws,
    randomization::BoardPhysics,
    recoil::Recoil,
    settings::{BiscuitSettings, CONTROL_PERIOD, CupRule, CupSettings, GameSettings, instances},
};
use crate::{
    effects::{Ball, Wall},
    twin::Instance,
};

/// Maximum number of events in one piece; beyond it the ball is wedged between two bodies, and both
/// yield.
const MOST_EVENTS: usize = 24;

/// Fraction of the slip that sliding removes from the velocity of a solid sphere.
const GRIP: f64 = 2.0 / 7.0;

/// Speed below which a ball is at rest (m/s): it would take a minute for the width of a hair, and
/// still smaller numbers would become denormal.
const STANDSTILL: f64 = 1e-6;

/// Next event on the path of the ball.
#[derive(Clone, Copy)]
enum Event {
    Wall(Wall),
    Mover(usize),
    /// The centre of the ball comes over a cup.
    Edge,
    /// The centre of the ball reaches the rim from inside.
    Rim,
    /// The ball has fallen by its radius.
    Fallen,
}

/// Events of the ball in one piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Happened {
    /// Largest closing speed of an impact on each striker (m/s); 0 without one.
    pub(super) struck: [f64; 2],
    /// Impacts on each striker.
    pub(super) hits: [u8; 2],
    /// Impacts on walls.
    pub(super) wall_hits: u8,
    /// True if a cup has captured the ball.
    pub(super) taken: bool,
}

impl Happened {
    pub(super) const NOTHING: Self =
        Self { struck: [0.0; 2], hits: [0; 2], wall_hits: 0, taken: false };

    /// Add the events of the next piece.
    pub(super) fn add(&mut self, next: &Self) {
        for player in 0..2 {
            self.struck[player] = self.struck[player].max(next.struck[player]);
            self.hits[player] = self.hits[player].saturating_add(next.hits[player]);
        }
        self.wall_hits = self.wall_hits.saturating_add(next.wall_hits);
        self.taken |= next.taken;
    }
}

/// Parameters of the ball that all environments share.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) laws: BallLaws,
    pub(super) cup: CupSettings,
    /// Half of the board's sides (m).
    pub(super) half: [f64; 2],
    /// Motion of a displaced striker over one piece.
    pub(super) recoil: Recoil,
    /// Mass of a striker (kg).
    pub(super) striker_mass: f64,
    pub(super) biscuits: Option<BiscuitSettings>,
    /// Number of pieces of a control period.
    pub(super) pieces: usize,
}

impl Table {
    pub(super) fn new(settings: &GameSettings) -> Self {
        let GameSettings { board, ball, striker, pieces, .. } = settings;
        let complete = |effects: &[Instance]| match settings.randomization {
            // Randomized physics need a law to act through.
            Some(_) => with_laws_of_impact(effects),
            None => effects.to_vec(),
        };
        let piece = CONTROL_PERIOD / *pieces as f64;
        Self {
            laws: BallLaws::new(&complete(&ball.effects), &complete(&ball.striker_effects)),
            cup: settings.cup,
            half: [board.short_side / 2.0, board.long_side / 2.0],
            recoil: Recoil::new(striker, piece),
            striker_mass: striker.mass,
            biscuits: settings.biscuits,
            pieces: *pieces,
        }
    }

    /// Length of a piece (s).
    pub(super) fn piece(&self) -> f64 {
        CONTROL_PERIOD / self.pieces as f64
    }
}

/// Add neutral laws of restitution and friction to `effects` where they are missing.
fn with_laws_of_impact(effects: &[Instance]) -> Vec<Instance> {
    let neutral: [(&str, &[f64]); 2] =
        [("impact.wall_restitution", &[1.0]), ("impact.wall_friction_spin", &[0.0, 0.0])];
    let missing = |entry: &Instance| effects.iter().all(|own| own.effect.name != entry.effect.name);
    let added = instances(&neutral).into_iter().filter(missing);
    effects.iter().cloned().chain(added).collect()
}

/// The ball of one environment with the physics of its episode.
pub(super) struct Play<'a> {
    pub(super) table: &'a Table,
    pub(super) physics: &'a BoardPhysics,
}

impl Play<'_> {
    fn walls(&self) -> Walls<'_> {
        Walls { laws: &self.table.laws, half: self.table.half }
    }

    /// Apply the forces on the ball for `dt` seconds. `time` is the time since the episode began;
    /// `strikers` are the positions of the attracting magnets.
    pub(super) fn push(&self, ball: &mut BallState, strikers: [[f64; 2]; 2], time: f64, dt: f64) {
        let laws = &self.table.laws;
        if ball.over_cup != ON_THE_BOARD || (laws.rests() && ball.velocity == [0.0; 2]) {
            return;
        }
        let mut seen = Ball {
            time,
            position: ball.position,
            velocity: ball.velocity,
            since_impact: ball.since_impact,
            strikers: strikers.map(Some),
        };
        let push = laws.push(&seen);
        let mut velocity = add(ball.velocity, scale(push, dt));
        if laws.slides() {
            let slip = length(ball.slip);
            if 0.0 < slip {
                let part = (laws.sliding(&seen) * dt).min(GRIP * slip) / slip;
                velocity = subtract(velocity, scale(ball.slip, part));
                ball.slip = scale(ball.slip, (1.0 - part / GRIP).max(0.0));
            }
        }
        let speed = length(velocity);
        seen.velocity = velocity;
        // The resistance at the midpoint makes a linear one exact to second order.
        let half = 0.5 * dt * laws.resistance(&seen);
        seen.velocity = if half < speed { scale(velocity, 1.0 - half / speed) } else { [0.0; 2] };
        let left = speed - dt * laws.resistance(&seen);
        // Written so that a non-finite number stays non-finite.
        ball.velocity = if left <= STANDSTILL { [0.0; 2] } else { scale(velocity, left / speed) };
    }

    /// Advance the ball and `movers` by `dt` seconds; the first two movers are the strikers.
    pub(super) fn drift(&self, ball: &mut BallState, movers: &mut [Mover], dt: f64) -> Happened {
        let mut happened = Happened::NOTHING;
        let mut left = dt;
        for _ in 0..MOST_EVENTS {
            let Some((time, event)) = self.first_event(ball, movers, left) else {
                advance(ball, movers, left);
                happened.taken |= self.rolls_into_a_cup(ball);
                return happened;
            };
            advance(ball, movers, time);
            left -= time;
            self.meet(event, ball, movers, &mut happened);
            if happened.taken {
                break;
            }
        }
        for mover in movers.iter_mut() {
            mover.advance(left);
        }
        if !happened.taken {
            self.give_way(ball, movers);
        }
        happened
    }

    fn first_event(&self, ball: &BallState, movers: &[Mover], left: f64) -> Option<(f64, Event)> {
        let mut first: Option<(f64, Event)> = None;
        let mut offer = |time: f64, event: Event| {
            if time <= left && first.is_none_or(|(earliest, _)| time < earliest) {
                first = Some((time, event));
            }
        };
        if let Some((time, wall)) = self.walls().first(ball, left) {
            offer(time, Event::Wall(wall));
        }
        for (index, mover) in movers.iter().enumerate() {
            let d = subtract(ball.position, mover.position);
            let w = subtract(ball.velocity, mover.velocity);
            if let Some(time) = time_to_meet(d, w, mover.touch) {
                offer(time, Event::Mover(index));
            }
        }
        if self.table.cup.rule == CupRule::Fall {
            self.cup_event(ball, &mut offer);
        }
        first
    }

    fn cup_event(&self, ball: &BallState, offer: &mut impl FnMut(f64, Event)) {
        let d = self.cup_to_ball(ball);
        let radius = self.table.cup.radius;
        if ball.over_cup == ON_THE_BOARD {
            if let Some(time) = time_to_meet(d, ball.velocity, radius) {
                offer(time, Event::Edge);
            } else if dot(d, d) < radius * radius && ball.velocity == [0.0; 2] {
                offer(0.0, Event::Edge);
            }
        } else {
            offer((fall_time() - ball.over_cup).max(0.0), Event::Fallen);
            offer(time_to_leave(d, ball.velocity, radius), Event::Rim);
        }
    }

    /// Vector from the centre of the cup on the ball's half to the ball (m).
    fn cup_to_ball(&self, ball: &BallState) -> [f64; 2] {
        let [x, y] = ball.position;
        [x, y - self.table.cup.distance.copysign(y)]
    }

    fn meet(
        &self,
        event: Event,
        ball: &mut BallState,
        movers: &mut [Mover],
        happened: &mut Happened,
    ) {
        match event {
            Event::Wall(wall) => {
                self.walls().bounce(wall, &self.physics.walls, ball);
                happened.wall_hits = happened.wall_hits.saturating_add(1);
            }
            Event::Mover(index) => {
                let Self { table, physics } = self;
                let mover = &mut movers[index];
                let speed = strike(&table.laws, &physics.strikers, physics.ball_mass, ball, mover);
                if let (Some(speed), Some(most)) = (speed, happened.struck.get_mut(index)) {
                    *most = most.max(speed);
                    happened.hits[index] = happened.hits[index].saturating_add(1);
                }
            }
            Event::Edge => ball.over_cup = 0.0,
            Event::Fallen => happened.taken = true,
            Event::Rim => happened.taken = !self.cross_rim(ball),
        }
    }

    /// Collide the ball with the far rim of a cup; returns whether it leaves the cup.
    fn cross_rim(&self, ball: &mut BallState) -> bool {
        let d = self.cup_to_ball(ball);
        let outwards = scale(d, 1.0 / length(d));
        let radial = dot(ball.velocity, outwards);
        let Some(after) = leaves_with(radial, ball.over_cup) else { return false };
        ball.velocity = add(ball.velocity, scale(outwards, after - radial));
        ball.over_cup = ON_THE_BOARD;
        true
    }

    /// Return whether upstream's capture rule applies and captures the ball.
    fn rolls_into_a_cup(&self, ball: &BallState) -> bool {
        let CupRule::SlowerThan(limit) = self.table.cup.rule else { return false };
        length(self.cup_to_ball(ball)) < self.table.cup.radius && ball.speed() <= limit
    }

    /// Free a wedged ball: it is moved away from the movers as far as the walls permit; otherwise
    /// the movers yield.
    fn give_way(&self, ball: &mut BallState, movers: &mut [Mover]) {
        for mover in movers.iter() {
            let way = subtract(ball.position, mover.position);
            let distance = length(way);
            if 0.0 < distance && distance < mover.touch {
                ball.position = add(mover.position, scale(way, mover.touch / distance));
            }
        }
        let walls = self.walls();
        for wall in Wall::ALL {
            let beyond = walls.gap(wall, ball.position).min(0.0);
            let normal = walls.normal(wall, ball.position);
            ball.position = add(ball.position, scale(normal, beyond));
            let outwards = dot(ball.velocity, normal).max(0.0);
            if beyond < 0.0 {
                ball.velocity = subtract(ball.velocity, scale(normal, outwards));
            }
        }
        for mover in movers.iter_mut() {
            let way = subtract(mover.position, ball.position);
            let distance = length(way);
            if 0.0 < distance && distance < mover.touch {
                let normal = scale(way, 1.0 / distance);
                let shift = scale(normal, mover.touch - distance);
                mover.position = add(mover.position, shift);
                mover.moved = add(mover.moved, shift);
                let closing = dot(subtract(ball.velocity, mover.velocity), normal).max(0.0);
                mover.kick(scale(normal, closing));
            }
        }
    }
}

fn advance(ball: &mut BallState, movers: &mut [Mover], time: f64) {
    ball.advance(time);
    for mover in movers {
        mover.advance(time);
    }
}
