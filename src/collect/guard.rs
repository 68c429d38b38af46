//! Safety checks of every control period with armed motors. Other events stop a session at once on
//! arrival: an axis that leaves closed loop, commands of another program, bus failures.

use super::{
    reason::{HotPart, StopReason},
    station::Station,
    watch::{Armed, DriveWatch},
};
use crate::{
    gantry::{Limits, Rectangle},
    recording::topic::Player,
    units::Nanos,
};
use std::collections::VecDeque;

/// Largest lag of a carriage behind the path of its leg (s): drive, belt and bus together.
pub(super) const MOST_LAG_SECONDS: f64 = 0.3;
/// Time for which a striker must be far from its magnet before it counts as lost (s), since single
/// detections fail.
const STRIKER_LOST_SECONDS: f64 = 0.1;

/// Role of the camera in a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CameraDuty {
    /// Required: the strikers are compared with their magnets, and camera frames must keep
    /// arriving.
    Watches,
    /// Optional: camera frames are recorded if they arrive.
    Records,
}

/// Positions in which a carriage that follows its commands is (m): a box between two corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expected {
    corners: [[f64; 2]; 2],
}

impl Expected {
    /// One position (m).
    pub(super) fn at(position: [f64; 2]) -> Self {
        Self::between(position, position)
    }

    /// The box between two corners (m), in any order.
    pub(super) fn between(one: [f64; 2], other: [f64; 2]) -> Self {
        Self { corners: [one, other] }
    }

    /// Distance of `position` from the box (m); 0 inside.
    pub(super) fn distance(&self, position: [f64; 2]) -> f64 {
        let [dx, dy] = [0, 1].map(|axis| {
            let [one, other] = self.corners.map(|corner| corner[axis]);
            position[axis] - position[axis].clamp(one.min(other), one.max(other))
        });
        dx.hypot(dy)
    }
}

/// Safety checks; see the module.
#[derive(Debug)]
pub(super) struct Guard {
    camera: CameraDuty,
    /// Past expected positions of each carriage, newest last. They are kept for as long as a carriage may lag and an
    /// encoder may be silent: a position that arrives late is compared with what was expected when it was measured.
    expected: [VecDeque<(Nanos, Expected)>; 2],
    /// Largest allowed lag of a carriage (s).
    most_lag_s: f64,
    /// Longest silence of an encoder (s).
    encoder_s: f64,
    striker_far_since: [Option<Nanos>; 2],
    worst_tracking: f64,
}

impl Guard {
    /// Checks with a `camera` and encoders that may be silent for `encoder_s` seconds.
    pub(super) fn new(camera: CameraDuty, encoder_s: f64) -> Self {
        Self {
            camera,
            expected: [VecDeque::new(), VecDeque::new()],
            most_lag_s: MOST_LAG_SECONDS,
            encoder_s,
            striker_far_since: [None, None],
            worst_tracking: 0.0,
        }
    }

    /// Discard the past expected positions before a new leg or free run, with a new largest lag
    /// `most_lag_s` (s).
    pub(super) fn restart(&mut self, most_lag_s: f64) {
        self.most_lag_s = most_lag_s;
        self.expected.iter_mut().for_each(VecDeque::clear);
    }

    /// Add where a carriage is expected now.
    pub(super) fn expect(&mut self, player: Player, now: Nanos, expected: Expected) {
        let kept = &mut self.expected[player as usize];
        kept.push_back((now, expected));
        let oldest_s = self.most_lag_s + self.encoder_s;
        while kept.front().is_some_and(|(t, _)| oldest_s < now.seconds_since(*t)) {
            kept.pop_front();
        }
    }

    /// Distance of a carriage at `position` (m) from where it was expected when that was measured, or up to the largest
    /// lag before; NaN without an expectation.
    fn tracking_error(&self, player: Player, (measured, position): (Nanos, [f64; 2])) -> f64 {
        let at_its_time = |(time, _): &&(Nanos, Expected)| {
            (0.0..=self.most_lag_s).contains(&measured.seconds_since(*time))
        };
        let expected = self.expected[player as usize].iter().filter(at_its_time);
        expected.map(|(_, own)| own.distance(position)).fold(f64::NAN, f64::min)
    }

    /// Return the largest distance of a carriage from its expected position so far (m).
    pub(super) fn worst_tracking(&self) -> f64 {
        self.worst_tracking
    }

    /// Check everything; `commanded` is the last command of each player (m/s).
    pub(super) fn check(
        &mut self,
        station: &Station<'_>,
        commanded: [[f64; 2]; 2],
    ) -> Result<(), StopReason> {
        let now = station.now();
        check_presses(station.presses())?;
        for drive in station.drives.iter().filter(|drive| drive.armed == Armed::Confirmed) {
            check_silence(drive, now, station)?;
            check_temperature(drive, &station.robot.limits)?;
        }
        for player in station.robot.players() {
            self.check_motion(player, station, commanded[player as usize])?;
            if self.camera == CameraDuty::Watches {
                self.check_striker(player, now, station)?;
            }
        }
        if self.camera == CameraDuty::Watches {
            check_camera(now, station)?;
        }
        Ok(())
    }

    fn check_motion(
        &mut self,
        player: Player,
        station: &Station<'_>,
        commanded: [f64; 2],
    ) -> Result<(), StopReason> {
        let carriage = station.carriage(player);
        let Some((position_m, velocity)) = carriage.state() else { return Ok(()) };
        let limits = &station.robot.limits;
        let workspace = station.robot.stop_limits(player);
        if let Some(standstill_m) = leaves(&workspace, limits, (position_m, velocity), commanded) {
            return Err(StopReason::SoftLimit { player, position_m, standstill_m });
        }
        let error_m = carriage
            .measured_at()
            .map_or(f64::NAN, |measured| self.tracking_error(player, (measured, position_m)));
        if error_m.is_finite() {
            self.worst_tracking = self.worst_tracking.max(error_m);
        }
        let limit_m = limits.following_error_m;
        if limit_m < error_m {
            return Err(StopReason::FollowingError { player, error_m, limit_m });
        }
        Ok(())
    }

    fn check_striker(
        &mut self,
        player: Player,
        now: Nanos,
        station: &Station<'_>,
    ) -> Result<(), StopReason> {
        let Some((shown, [x, y])) = station.camera.newest_striker(player) else { return Ok(()) };
        let Some([mx, my]) = station.carriage(player).position_at(shown) else { return Ok(()) };
        let error_m = (x - mx).hypot(y - my);
        let limit_m = station.robot.limits.striker_error_m;
        let since = &mut self.striker_far_since[player as usize];
        if error_m <= limit_m {
            *since = None;
        } else if STRIKER_LOST_SECONDS < now.seconds_since(*since.get_or_insert(now)) {
            return Err(StopReason::StrikerLost { player, error_m, limit_m });
        }
        Ok(())
    }
}

/// Return an error when Ctrl-C was pressed, once or more often.
pub(super) fn check_presses(presses: usize) -> Result<(), StopReason> {
    match presses {
        0 => Ok(()),
        1 => Err(StopReason::Interrupted),
        _ => Err(StopReason::InterruptedTwice),
    }
}

fn check_silence(drive: &DriveWatch, now: Nanos, station: &Station<'_>) -> Result<(), StopReason> {
    let seat = drive.seat;
    let timeouts = &station.robot.timeouts;
    let age = |at: Option<Nanos>| at.map_or(f64::INFINITY, |at| now.seconds_since(at));
    let [age_s, limit_s] = [age(drive.heartbeat.map(|h| h.at)), timeouts.heartbeat_s];
    if limit_s < age_s {
        return Err(StopReason::HeartbeatLost { seat, age_s, limit_s });
    }
    let [age_s, limit_s] = [age(drive.encoder_at), timeouts.encoder_s];
    if limit_s < age_s {
        return Err(StopReason::EncoderLost { seat, age_s, limit_s });
    }
    Ok(())
}

fn check_temperature(drive: &DriveWatch, limits: &Limits) -> Result<(), StopReason> {
    let Some([fet, motor]) = drive.temperatures else { return Ok(()) };
    let seat = drive.seat;
    for (part, celsius, limit_celsius) in [
        (HotPart::PowerStage, fet, limits.fet_temperature_c),
        (HotPart::Motor, motor, limits.motor_temperature_c),
    ] {
        // A motor without a thermistor reports NaN, which exceeds no limit.
        if limit_celsius < celsius {
            return Err(StopReason::TooHot { seat, part, celsius, limit_celsius });
        }
    }
    Ok(())
}

/// Return the standstill point of the carriage (m) when it is outside the workspace and further out
/// than the carriage. The reaction time counts only while the command still points in the direction
/// of motion, because a carriage with a braking command already brakes.
fn leaves(
    workspace: &Rectangle,
    limits: &Limits,
    (position, velocity): ([f64; 2], [f64; 2]),
    commanded: [f64; 2],
) -> Option<[f64; 2]> {
    let standstill = [0, 1].map(|axis| {
        let (speed, way) = (velocity[axis].abs(), velocity[axis].signum());
        let onward = (way * commanded[axis]).clamp(0.0, speed);
        let braking = speed * speed / (2.0 * limits.braking_m_per_s2);
        position[axis] + way * (onward * limits.reaction_s + braking)
    });
    let inside = workspace.depth(standstill);
    (inside < 0.0 && inside < workspace.depth(position)).then_some(standstill)
}

fn check_camera(now: Nanos, station: &Station<'_>) -> Result<(), StopReason> {
    let limit_s = station.robot.timeouts.camera_s;
    let age_s = station.camera.last_at.map_or(f64::INFINITY, |at| now.seconds_since(at));
    if limit_s < age_s { Err(StopReason::CameraSilent { age_s, limit_s }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_motion_that_leads_out_stops() {
        let workspace = Rectangle { x_min_m: -0.1, x_max_m: 0.1, y_min_m: -0.1, y_max_m: 0.1 };
        let limits = Limits { braking_m_per_s2: 5.0, reaction_s: 0.04, ..Limits::default() };
        let told = |x, v, u| leaves(&workspace, &limits, ([x, 0.0], [v, 0.0]), [u, 0.0]).is_some();
        let out = |x, v| told(x, v, v);
        // From 0.5 m/s the carriage needs 45 mm.
        assert!(!out(0.054, 0.5) && out(0.056, 0.5));
        assert!(!out(0.056, -0.5));
        // Outside already: motion back is allowed, motion further out is not.
        assert!(!out(0.12, -0.1) && out(0.12, 0.1) && !out(0.12, 0.0));
        // With a braking command it needs 25 mm.
        assert!(!told(0.074, 0.5, -0.2) && told(0.076, 0.5, -0.2));
    }

    /// A carriage at 0.4 m/s whose encoders report 60 ms late is where it was expected then; compared with the present
    /// it would be 24 mm away. A jammed one is noticed all the same.
    #[test]
    fn a_late_position_is_compared_with_what_was_expected_when_it_was_measured() {
        const SPEED: f64 = 0.4;
        let at = |step: u64| Nanos(20_000_000 * step);
        let mut guard = Guard::new(CameraDuty::Records, 0.1);
        guard.restart(0.02);
        for step in 0..10 {
            let x = SPEED * at(step).seconds_since(Nanos(0));
            guard.expect(Player::Left, at(step), Expected::at([x, 0.0]));
        }
        let error = |step, x| guard.tracking_error(Player::Left, (at(step), [x, 0.0]));
        let then = SPEED * at(6).seconds_since(Nanos(0));
        assert!(error(6, then) < 1e-12);
        assert!((error(9, then) - 0.016).abs() < 1e-9, "{}", error(9, then));
        assert!((error(9, 0.0) - SPEED * 0.16).abs() < 1e-9, "{}", error(9, 0.0));
        // Before the restart nothing was expected.
        guard.restart(0.02);
        assert!(guard.tracking_error(Player::Left, (at(9), [0.0; 2])).is_nan());
    }

    #[test]
    fn between_two_corners_nothing_is_far() {
        let expected = Expected::between([0.1, -0.1], [0.0, 0.1]);
        assert_eq!(expected.distance([0.05, 0.0]), 0.0);
        assert!((expected.distance([0.13, 0.14]) - 0.05).abs() < 1e-12);
    }
}
