//! Reference filter: the unmodified filter of the KlaskTron stack. It assumes constant velocity in
//! pixels, uses noise that does not depend on the time step, fixed boosts, no gate, and a dead
//! zone.
//!
//! Source: `klask_state_estimator_pkg/kalman_filter.py` and `state_estimator_node.py` of
//! klask_software (commits 0928556 and 8e37c99). In image coordinates, where x runs along the board's
//! y, with 530 x 370 pixels for 0.42 x 0.32 m:
//!
//! | | Q position (px2) | Q velocity ((px/s)2) | R (px2) | |
//! |---|---|---|---|---|
//! | ball | 2 | 30 | 1 | boosted axes: 6 and 10030 |
//! | peg | 2 | 800 | 12 | moved less than 0.3 px since the last frame: velocity 0 |
//!
//! The ball's noise is boosted across a long side when nearer than 35 px to it, and in both axes
//! when nearer than 35 px to a short side or to a peg. An undetected object is neither predicted
//! nor updated, and the next step covers one frame only. Velocities below 1 px/s are reported as 0.
//! Not modelled: rounding of detections to whole pixels (recordings hold the detections before
//! rounding) and the 50 Hz timer of its output.

use super::{settings::BoardSettings, track::Detections};

/// Pixels along and across the image.
const PIXELS: [f64; 2] = [530.0, 370.0];
/// Distance that counts as near (px).
const NEAR: f64 = 35.0;
/// Process noise Q of positions (px2), added in every step.
const Q_PLACE: f64 = 2.0;
/// Boost of Q for positions (px2) and velocities ((px/s)2).
const BOOST: [f64; 2] = [4.0, 10_000.0];
/// Speed below which 0 is reported (px/s).
const DEAD_ZONE: f64 = 1.0;
/// Displacement between frames below which a peg counts as stationary (px).
const STANDING: f64 = 0.3;

/// Filters of the three objects with their states.
#[derive(Debug, Clone)]
pub struct UpstreamFilter {
    board: BoardSettings,
    /// By object and axis (along the image, across it).
    axes: [[AxisFilter; 2]; 3],
    last_places: [Option<[f64; 2]>; 3],
    last_time: Option<crate::units::Nanos>,
}

/// Position and velocity in one axis (px, px/s).
#[derive(Debug, Clone, Copy)]
struct AxisFilter {
    position: f64,
    velocity: f64,
    /// Covariance: position, cross term, velocity.
    covariance: [f64; 3],
}

impl AxisFilter {
    const START: Self = Self { position: 0.0, velocity: 0.0, covariance: [1.0, 0.0, 1.0] };

    fn step(&mut self, seen: f64, dt: f64, noise: [f64; 2], r: f64) {
        let [pp, pv, vv] = self.covariance;
        let position = self.position + dt * self.velocity;
        let (pp, pv, vv) =
            (pp + 2.0 * dt * pv + dt * dt * vv + noise[0], pv + dt * vv, vv + noise[1]);
        let gain = [pp / (pp + r), pv / (pp + r)];
        self.position = position + gain[0] * (seen - position);
        self.velocity += gain[1] * (seen - position);
        self.covariance = [(1.0 - gain[0]) * pp, (1.0 - gain[0]) * pv, vv - gain[1] * pv];
    }
}

impl UpstreamFilter {
    /// Initial state of the upstream node: all objects at the corner of the image, P = 1.
    #[must_use]
    pub fn new(board: &BoardSettings) -> Self {
        Self {
            board: *board,
            axes: [[AxisFilter::START; 2]; 3],
            last_places: [None; 3],
            last_time: None,
        }
    }

    /// Metres per pixel along and across the picture.
    fn scale(&self) -> [f64; 2] {
        [self.board.long_side_m / PIXELS[0], self.board.short_side_m / PIXELS[1]]
    }

    /// Process a frame. Returns the reported state (x, y, vx, vy) in the board frame (m, m/s) by
    /// object; `None` for an object that was never detected.
    pub fn observe(&mut self, seen: &Detections) -> [Option<[f64; 4]>; 3] {
        let [along, across] = self.scale();
        let pixels = seen.positions.map(|position| {
            position.map(|[x, y]| {
                [
                    (y + self.board.long_side_m / 2.0) / along,
                    (x + self.board.short_side_m / 2.0) / across,
                ]
            })
        });
        // The first step assumes a rate of 100 Hz.
        let dt = self.last_time.map_or(0.01, |last| seen.time.seconds_since(last));
        self.last_time = Some(seen.time);
        for object in 0..3 {
            let Some(position) = pixels[object] else { continue };
            let boosted =
                if object == 0 { boosted(position, [pixels[1], pixels[2]]) } else { [false; 2] };
            self.step(object, position, dt, boosted);
        }
        std::array::from_fn(|object| self.last_places[object].map(|_seen| self.report(object)))
    }

    fn step(&mut self, object: usize, position: [f64; 2], dt: f64, boosted: [bool; 2]) {
        let (q_velocity, r) = if object == 0 { (30.0, 1.0) } else { (800.0, 12.0) };
        let before = self.last_places[object].replace(position);
        for axis in 0..2 {
            let [more_place, more_velocity] = if boosted[axis] { BOOST } else { [0.0; 2] };
            let noise = [Q_PLACE + more_place, q_velocity + more_velocity];
            self.axes[object][axis].step(position[axis], dt, noise, r);
        }
        let stands = before
            .is_some_and(|from| (position[0] - from[0]).hypot(position[1] - from[1]) < STANDING);
        if object != 0 && stands {
            self.axes[object].iter_mut().for_each(|axis| axis.velocity = 0.0);
        }
    }

    fn report(&self, object: usize) -> [f64; 4] {
        let scale = self.scale();
        let [along, across] = &self.axes[object];
        let velocity = |axis: &AxisFilter, scale: f64| {
            if axis.velocity.abs() < DEAD_ZONE { 0.0 } else { axis.velocity * scale }
        };
        [
            across.position * scale[1] - self.board.short_side_m / 2.0,
            along.position * scale[0] - self.board.long_side_m / 2.0,
            velocity(across, scale[1]),
            velocity(along, scale[0]),
        ]
    }
}

/// Axes in which the ball at `position` (px) is boosted.
fn boosted(position: [f64; 2], pegs: [Option<[f64; 2]>; 2]) -> [bool; 2] {
    let near_edge = |axis: usize| position[axis] < NEAR || PIXELS[axis] - NEAR < position[axis];
    let near_peg =
        pegs.iter().flatten().any(|peg| (position[0] - peg[0]).hypot(position[1] - peg[1]) < NEAR);
    let both = near_peg || near_edge(0);
    [both, both || near_edge(1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ekf::FilterSettings, units::Nanos};

    /// Rise time to 63 % of a velocity step at 120 Hz (s), in the middle of the board's x axis.
    fn rise(object: usize, position: f64) -> f64 {
        let mut filter = UpstreamFilter::new(&FilterSettings::default().board);
        let speed = 0.2;
        let mut x = position;
        for frame in 0..600_u64 {
            if 300 <= frame {
                x += speed / 120.0;
            }
            let mut positions = [None; 3];
            positions[object] = Some([x, 0.0]);
            let time = Nanos(frame * 1_000_000_000 / 120);
            let reported = filter.observe(&Detections::new(time, positions))[object].unwrap();
            if 300 <= frame && 0.63 * speed < reported[2] {
                return (frame - 299) as f64 / 120.0;
            }
        }
        f64::INFINITY
    }

    /// Expected rise times from the Riccati recursion: 267 ms for the free ball, 75 ms for a peg,
    /// 33 ms for the boosted ball.
    #[test]
    fn velocities_lag_as_the_platform_says() {
        assert!((rise(0, 0.0) - 0.267).abs() < 0.017, "{}", rise(0, 0.0));
        assert!((rise(1, 0.0) - 0.075).abs() < 0.017, "{}", rise(1, 0.0));
        assert!((rise(0, 0.15) - 0.033).abs() < 0.009, "{}", rise(0, 0.15));
    }

    #[test]
    fn slow_pegs_stand_and_slow_balls_are_zero() {
        let mut filter = UpstreamFilter::new(&FilterSettings::default().board);
        let mut last = [None; 3];
        for frame in 0..240_u64 {
            // 20 mm/s: less than 0.3 px in a frame.
            let x = 0.02 * frame as f64 / 120.0;
            let time = Nanos(frame * 1_000_000_000 / 120);
            let seen = Detections::new(time, [None, Some([x, -0.1]), None]);
            last = filter.observe(&seen);
        }
        assert_eq!(last[1].unwrap()[2..], [0.0, 0.0]);
        assert_eq!(last[0], None);
    }
}
