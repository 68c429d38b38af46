//! Collision detection and impact response.
//!
//! Between two events all bodies move on straight lines. The time of a contact is therefore the
//! root of a linear equation (walls) or of `|d + w t| = R` (round bodies, with distance `d` and
//! relative velocity `w`). No body can pass through another at any speed.
//!
//! An impact changes the normal velocity `u` into `-e u`. The tangential velocity follows Coulomb's
//! law with the ball's spin about the vertical. Both use the functions of the catalogue
//! (`impact.wall_restitution`, `impact.wall_restitution_speed`, `impact.wall_friction_spin`), applied
//! to the velocity of the ball relative to the other body. A striker or a biscuit of mass `M` takes
//! the fraction `m / (M + m)` of that change in the opposite direction, so that momentum is
//! conserved; a wall takes all of it.

use super::{
    body::{BallState, Mover, add, along, dot, length, scale, subtract},
    laws::{BallLaws, Bounces},
    randomization::Surface,
};
use crate::{
    board::BALL_RADIUS,
    effects::{Change, Impact, Wall},
};

/// Baseline for the slope of a shifted wall (m).
const ALONG: f64 = 1e-3;

/// Maximum inward shift of a wall (m); more than the bounds of `impact.wall_location` at a corner.
const FARTHEST_SHIFT: f64 = 0.04;

/// The four walls, for the ball's centre.
pub(super) struct Walls<'a> {
    pub(super) laws: &'a BallLaws,
    /// Half of the board's sides (m).
    pub(super) half: [f64; 2],
}

impl Walls<'_> {
    /// Remaining distance of the ball at `place` to `wall` (m).
    pub(super) fn gap(&self, wall: Wall, place: [f64; 2]) -> f64 {
        let (axis, sign) = wall.outward();
        let gap = self.half[axis] - BALL_RADIUS - sign * place[axis];
        if self.laws.moves_walls() { gap + self.laws.shift(wall, place[1 - axis]) } else { gap }
    }

    /// Outward normal of `wall` at `place`; the slope of a shifted wall turns it.
    pub(super) fn normal(&self, wall: Wall, place: [f64; 2]) -> [f64; 2] {
        let (axis, sign) = wall.outward();
        let mut normal = [0.0; 2];
        if !self.laws.moves_walls() {
            normal[axis] = sign;
            return normal;
        }
        let at = |offset: f64| self.laws.shift(wall, place[1 - axis] + offset);
        let slope = (at(ALONG) - at(-ALONG)) / (2.0 * ALONG);
        let size = (1.0 + slope * slope).sqrt();
        normal[axis] = sign / size;
        normal[1 - axis] = -slope / size;
        normal
    }

    /// Return whether a ball at `place` is clear of every wall for any shift.
    pub(super) fn all_far(&self, place: [f64; 2]) -> bool {
        let reserve = if self.laws.moves_walls() { FARTHEST_SHIFT } else { 0.0 };
        let inside = |axis: usize| place[axis].abs() <= self.half[axis] - BALL_RADIUS - reserve;
        inside(0) && inside(1)
    }

    /// Time and wall of the first impact within `left` seconds.
    pub(super) fn first(&self, ball: &BallState, left: f64) -> Option<(f64, Wall)> {
        let end = along(ball.position, ball.velocity, left);
        if self.all_far(end) {
            return None;
        }
        let mut first: Option<(f64, Wall)> = None;
        for wall in Wall::ALL {
            let after = self.gap(wall, end);
            if 0.0 <= after {
                continue;
            }
            let now = self.gap(wall, ball.position);
            if now <= after {
                continue;
            }
            let time = if now <= 0.0 { 0.0 } else { left * now / (now - after) };
            if first.is_none_or(|(earliest, _)| time < earliest) {
                first = Some((time, wall));
            }
        }
        first
    }

    /// Bounce the ball off `wall`.
    pub(super) fn bounce(&self, wall: Wall, surface: &Surface, ball: &mut BallState) {
        let normal = self.normal(wall, ball.position);
        let meeting = Meeting::new(ball.velocity, normal);
        if meeting.normal_speed <= 0.0 {
            return;
        }
        let change = meeting.change(wall, &self.laws.walls, surface, ball.spin);
        let difference = meeting.difference(&change);
        hit(self.laws, ball, difference, change.spin);
    }
}

/// Relative velocity of two colliding bodies along and across the line of centres.
struct Meeting {
    normal: [f64; 2],
    tangent: [f64; 2],
    normal_speed: f64,
    tangential_velocity: f64,
}

impl Meeting {
    /// From the relative `velocity` (m/s) of the ball, with `normal` pointing from it to the other
    /// body.
    fn new(velocity: [f64; 2], normal: [f64; 2]) -> Self {
        let tangent = [normal[1], -normal[0]];
        Self {
            normal,
            tangent,
            normal_speed: dot(velocity, normal),
            tangential_velocity: dot(velocity, tangent),
        }
    }

    fn change(&self, wall: Wall, bounces: &Bounces, surface: &Surface, spin: f64) -> Change {
        let Self { normal_speed, tangential_velocity, .. } = *self;
        bounces.act(surface, &Impact { wall, normal_speed, tangential_velocity, spin })
    }

    /// Change of the relative velocity (m/s).
    fn difference(&self, change: &Change) -> [f64; 2] {
        let normal = -(1.0 + change.restitution) * self.normal_speed;
        let across = change.tangential_velocity - self.tangential_velocity;
        add(scale(self.normal, normal), scale(self.tangent, across))
    }
}

/// Change the ball's velocity by `difference` (m/s) and its spin.
fn hit(laws: &BallLaws, ball: &mut BallState, difference: [f64; 2], spin: f64) {
    ball.velocity = add(ball.velocity, difference);
    ball.spin = spin;
    ball.since_impact = 0.0;
    if laws.slides() {
        ball.slip = add(ball.slip, difference);
    }
}

/// First time `t` (s) at which two points that are `d` apart (m) and move with relative velocity
/// `w` (m/s) are `distance` (m) apart and approaching; 0 if they are already closer.
pub(super) fn time_to_meet(d: [f64; 2], w: [f64; 2], distance: f64) -> Option<f64> {
    let closing = dot(d, w);
    if 0.0 <= closing {
        return None;
    }
    let gap = dot(d, d) - distance * distance;
    if gap <= 0.0 {
        return Some(0.0);
    }
    let root = closing * closing - dot(w, w) * gap;
    // The smaller root in the form without cancellation.
    (0.0 <= root).then(|| gap / (root.sqrt() - closing))
}

/// Time (s) until a point at `d` (m) inside a circle of `radius` (m) leaves it with `velocity` (m/s);
/// infinite at rest.
pub(super) fn time_to_leave(d: [f64; 2], velocity: [f64; 2], radius: f64) -> f64 {
    let square = dot(velocity, velocity);
    if square == 0.0 {
        return f64::INFINITY;
    }
    let outwards = dot(d, velocity);
    let inside = (radius * radius - dot(d, d)).max(0.0);
    ((outwards * outwards + square * inside).sqrt() - outwards) / square
}

/// Collide the ball of mass `ball_mass` (kg) with `mover`. Returns the closing speed (m/s); has no
/// effect if the two are not approaching.
pub(super) fn strike(
    laws: &BallLaws,
    surface: &Surface,
    ball_mass: f64,
    ball: &mut BallState,
    mover: &mut Mover,
) -> Option<f64> {
    let way = subtract(mover.position, ball.position);
    let distance = length(way);
    if distance == 0.0 {
        return None;
    }
    let relative = subtract(ball.velocity, mover.velocity);
    let meeting = Meeting::new(relative, scale(way, 1.0 / distance));
    if meeting.normal_speed <= 0.0 {
        return None;
    }
    let change = meeting.change(Wall::Left, &laws.strikers, surface, ball.spin);
    let difference = meeting.difference(&change);
    let share = mover.mass / (mover.mass + ball_mass);
    let spin = ball.spin + share * (change.spin - ball.spin);
    hit(laws, ball, scale(difference, share), spin);
    mover.kick(scale(difference, share - 1.0));
    Some(meeting.normal_speed)
}
