//! One control period in one environment.
//!
//! The period is divided into pieces ([`Table::pieces`]), and each piece into force, path and force
//! ([`super::motion`]). A period without any possible contact is one piece: the path of the ball is
//! just as straight, and most periods of most games are of this kind.

use super::{
    actuation::turned,
    biscuit::BiscuitState,
    body::{
        BallState, Mover, ON_THE_BOARD, StrikerState, add, along, dot, length, scale, subtract,
    },
    contact::Walls,
    motion::{Happened, Play, Table},
    outcome::Ending,
    randomization::BoardPhysics,
    settings::{BiscuitSettings, CONTROL_PERIOD, StrikerOverCup},
};
use crate::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    recording::topic::Player,
};

/// One environment for one control period.
pub(super) struct Period<'a> {
    pub(super) table: &'a Table,
    pub(super) physics: &'a BoardPhysics,
    pub(super) ball: &'a mut BallState,
    pub(super) strikers: &'a mut [StrikerState; 2],
    /// The biscuits, in a game with biscuits.
    pub(super) biscuits: Option<&'a mut [BiscuitState; 3]>,
    /// Path of each magnet: positions (m) at the ends of the pieces, the first at the start.
    pub(super) ways: [&'a [[f64; 2]]; 2],
}

impl Period<'_> {
    /// Play the period; `start` is the time since the episode began (s). When the episode ends, the
    /// state at the end of that piece is kept.
    pub(super) fn play(&mut self, start: f64) -> (Happened, Option<Ending>) {
        if self.stays_quiet(start) {
            return (Happened::NOTHING, None);
        }
        let (pieces, h) = (self.table.pieces, self.table.piece());
        let mut places =
            [0, 1].map(|player| add(self.ways[player][0], self.strikers[player].recoil));
        let mut all = Happened::NOTHING;
        for piece in 0..pieces {
            let push = if piece == 0 { 0.5 * h } else { h };
            self.push(places, start + h * piece as f64, push);
            let ended = if self.biscuits.is_some() {
                self.play_piece::<5>(piece, &mut places, &mut all)
            } else {
                self.play_piece::<2>(piece, &mut places, &mut all)
            };
            if ended.is_some() {
                let ends = self.ways.map(|way| way[piece + 1]);
                // The ball stops here, and so do the strikers: not at the end of the period, to
                // which their drives have moved.
                for (striker, end) in self.strikers.iter_mut().zip(ends) {
                    striker.led = end;
                }
                return (all, ended);
            }
        }
        self.push(places, start + CONTROL_PERIOD, 0.5 * h);
        (all, None)
    }

    fn push(&mut self, strikers: [[f64; 2]; 2], time: f64, dt: f64) {
        let play = Play { table: self.table, physics: self.physics };
        play.push(self.ball, strikers, time, dt);
    }

    /// Play the period in one piece if no contact is possible in it; otherwise leave the state
    /// unchanged.
    fn stays_quiet(&mut self, start: f64) -> bool {
        let resting = |striker: &StrikerState| {
            striker.recoil == [0.0; 2] && striker.recoil_velocity == [0.0; 2]
        };
        if self.biscuits.is_some()
            || self.ball.over_cup != ON_THE_BOARD
            || self.ball.slip != [0.0; 2]
            || !self.strikers.iter().all(resting)
        {
            return false;
        }
        let play = Play { table: self.table, physics: self.physics };
        let mut ball = *self.ball;
        play.push(&mut ball, self.ways.map(|way| way[0]), start, 0.5 * CONTROL_PERIOD);
        if !self.clear(&ball) {
            return false;
        }
        ball.advance(CONTROL_PERIOD);
        let ends = self.ways.map(|way| way[self.table.pieces]);
        play.push(&mut ball, ends, start + CONTROL_PERIOD, 0.5 * CONTROL_PERIOD);
        *self.ball = ball;
        true
    }

    /// Return whether a ball on a straight path stays clear of walls, strikers and cups for the
    /// whole period, and the strikers of their cups.
    fn clear(&self, ball: &BallState) -> bool {
        let Table { laws, cup, half, .. } = self.table;
        let end = along(ball.position, ball.velocity, CONTROL_PERIOD);
        if !(Walls { laws, half: *half }).all_far(end) {
            return false;
        }
        let ball_way = CONTROL_PERIOD * (ball.velocity[0].abs() + ball.velocity[1].abs());
        for (player, way) in self.ways.into_iter().enumerate() {
            let farthest = |most: f64, place: &[f64; 2]| {
                most.max((place[0] - way[0][0]).abs() + (place[1] - way[0][1]).abs())
            };
            let own_way = way.iter().fold(0.0, farthest);
            let touch = BALL_RADIUS + STRIKER_RADIUS + ball_way + own_way;
            let over_cup = cup.radius + own_way;
            let centre = turned(player, [0.0, -cup.distance]);
            if !apart(ball.position, way[0], touch) || !apart(way[0], centre, over_cup) {
                return false;
            }
        }
        let [x, y] = ball.position;
        let reach = cup.radius + ball_way;
        apart([x, y.abs()], [0.0, cup.distance], reach)
    }

    /// Play the piece with index `piece`, in which each magnet moves straight. `places` are the
    /// positions of the strikers, before and then after. `N` is the number of bodies that the ball
    /// can hit: two strikers and three biscuits.
    fn play_piece<const N: usize>(
        &mut self,
        piece: usize,
        places: &mut [[f64; 2]; 2],
        all: &mut Happened,
    ) -> Option<Ending> {
        let Table { striker_mass, .. } = *self.table;
        let h = self.table.piece();
        let mut movers = [Mover::striker([0.0; 2], [0.0; 2], striker_mass); N];
        for player in 0..2 {
            let striker = &mut self.strikers[player];
            let [from, to] = [0, 1].map(|later| self.ways[player][piece + later]);
            self.table.recoil.advance(striker, scale(subtract(to, from), 1.0 / h));
            let end = add(to, striker.recoil);
            let velocity = scale(subtract(end, places[player]), 1.0 / h);
            movers[player] = Mover::striker(places[player], velocity, striker_mass);
        }
        let (strikers, others) = movers.split_at_mut(2);
        if let (Some(settings), Some(biscuits)) = (&self.table.biscuits, &self.biscuits) {
            for (mover, biscuit) in others.iter_mut().zip(biscuits.iter()) {
                *mover = biscuit.mover(settings, strikers);
            }
        }
        let play = Play { table: self.table, physics: self.physics };
        let happened = play.drift(self.ball, &mut movers, h);
        all.add(&happened);
        let before = *places;
        let (strikers, others) = movers.split_at_mut(2);
        if let Some(settings) = &self.table.biscuits {
            self.move_biscuits(settings, before, strikers, others);
        }
        for (player, mover) in strikers.iter().enumerate() {
            let striker = &mut self.strikers[player];
            striker.recoil = add(striker.recoil, mover.moved);
            striker.recoil_velocity = add(striker.recoil_velocity, mover.kicked);
            places[player] = mover.position;
        }
        self.ending(&happened, [before, *places])
    }

    /// Advance the biscuits after a piece in which they moved as `others`: they slide or attach to
    /// strikers, and attached ones transfer impacts to their striker.
    fn move_biscuits(
        &mut self,
        settings: &BiscuitSettings,
        before: [[f64; 2]; 2],
        strikers: &mut [Mover],
        others: &[Mover],
    ) {
        let h = self.table.piece();
        let walls = (self.table.half, self.physics.walls.restitution);
        for (biscuit, mover) in self.biscuits.iter_mut().flat_map(|all| all.iter_mut()).zip(others)
        {
            if let Some(holder) = biscuit.holder {
                strikers[usize::from(holder)].kick(mover.kicked);
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

    /// End of the episode in a piece through which the strikers moved from `ways[0]` to `ways[1]`,
    /// if any. Of several ends in one piece, the first in upstream's order counts.
    fn ending(&self, happened: &Happened, ways: [[[f64; 2]; 2]; 2]) -> Option<Ending> {
        if happened.taken {
            let scorer = if self.ball.position[1] < 0.0 { Player::Right } else { Player::Left };
            return Some(Ending::Goal { scorer });
        }
        let cup = &self.table.cup;
        for loser in Player::BOTH {
            let player = loser as usize;
            let centre = turned(player, [0.0, -cup.distance]);
            let [from, to] = ways.map(|places| subtract(places[player], centre));
            if cup.striker == StrikerOverCup::Falls && nearest(from, to) < cup.radius {
                return Some(Ending::OwnGoal { loser });
            }
        }
        let biscuits = self.biscuits.as_ref()?;
        let held =
            |player: Player| biscuits.iter().filter(|own| own.holder == Some(player as u8)).count();
        let loser = Player::BOTH.into_iter().find(|player| 2 <= held(*player))?;
        Some(Ending::Biscuits { loser })
    }
}

/// Return whether two points are more than `distance` (m) apart.
fn apart(a: [f64; 2], b: [f64; 2], distance: f64) -> bool {
    let way = subtract(a, b);
    distance * distance < dot(way, way)
}

/// Minimum distance from the origin of a point that moves straight from `from` to `to`.
fn nearest(from: [f64; 2], to: [f64; 2]) -> f64 {
    let way = subtract(to, from);
    let square = dot(way, way);
    let share = if 0.0 < square { (-dot(from, way) / square).clamp(0.0, 1.0) } else { 0.0 };
    length(along(from, way, share))
}
