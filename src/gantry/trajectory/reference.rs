//! Commanded motion of one run on the control grid.
//!
//! Velocities are held over each period (zero-order hold), so the position is exactly `p[k+1] =
//! p[k] + v[k] dt`. It is always computed here, never an input.

use super::TrajectoryError;
use crate::gantry::Limits;

/// Allowed rates of commands (Hz).
const RATES_HZ: std::ops::RangeInclusive<f64> = 10.0..=1000.0;
/// Speed (m/s) and acceleration (m/s^2) of transfers; upstream approaches at 0.05 m/s.
const TRANSFER_SPEED: f64 = 0.1;
const TRANSFER_ACCELERATION: f64 = 0.5;
/// Largest overshoot of a transfer's standstill point beyond its target (m).
pub const TRANSFER_SLACK_M: f64 = 1e-5;

/// Command of one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Position at the start of the period (m), board frame.
    pub position: [f64; 2],
    /// Velocity throughout the period (m/s), board frame.
    pub velocity: [f64; 2],
}

/// Commanded motion of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    rate: f64,
    setpoints: Vec<Setpoint>,
}

/// Return `rate_hz` if it is within the allowed range (Hz).
pub(super) fn checked_rate(rate_hz: f64) -> Result<f64, TrajectoryError> {
    if RATES_HZ.contains(&rate_hz) { Ok(rate_hz) } else { Err(TrajectoryError::Rate { rate_hz }) }
}

impl Reference {
    /// Create the motion that starts at `start` (m) and has these velocities (m/s), one for each
    /// period of `rate_hz` ([10, 1000] Hz). Limits are not checked.
    ///
    /// # Errors
    /// When the rate is out of range.
    pub fn from_velocities(
        start: [f64; 2],
        velocities: &[[f64; 2]],
        rate_hz: f64,
    ) -> Result<Self, TrajectoryError> {
        let rate = checked_rate(rate_hz)?;
        let mut position = start;
        let setpoints = velocities
            .iter()
            .map(|&velocity| {
                let setpoint = Setpoint { position, velocity };
                position = [0, 1].map(|axis| position[axis] + velocity[axis] / rate);
                setpoint
            })
            .collect();
        Ok(Self { rate, setpoints })
    }

    /// Create a straight move from rest at `from` to rest at `to` (m). It accelerates at 0.5 m/s^2
    /// to 0.1 m/s, or to the limits, and decelerates so that it can always stop before `to`, within
    /// [`TRANSFER_SLACK_M`].
    ///
    /// # Errors
    /// When a point is not finite, or the rate is out of range.
    pub fn transfer(
        from: [f64; 2],
        to: [f64; 2],
        limits: &Limits,
        rate_hz: f64,
    ) -> Result<Self, TrajectoryError> {
        let rate = checked_rate(rate_hz)?;
        let offset = [to[0] - from[0], to[1] - from[1]];
        let distance = offset[0].hypot(offset[1]);
        if !distance.is_finite() {
            return Err(TrajectoryError::Point { from, to });
        }
        let along = transfer_speeds(distance, limits, 1.0 / rate);
        let unit = offset.map(|part| if 0.0 < distance { part / distance } else { 0.0 });
        let velocities: Vec<[f64; 2]> =
            along.into_iter().map(|speed| unit.map(|part| part * speed)).collect();
        Self::from_velocities(from, &velocities, rate)
    }

    /// Return the commands, one for each period; the first and the last of a run are at rest.
    #[must_use]
    pub fn setpoints(&self) -> &[Setpoint] {
        &self.setpoints
    }

    /// Return the commands per second (Hz).
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.rate
    }

    /// Return the control period (s).
    #[must_use]
    pub fn dt(&self) -> f64 {
        1.0 / self.rate
    }

    /// Return the duration (s).
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.setpoints.len() as f64 / self.rate
    }

    /// Return the start point (m); `None` without setpoints.
    #[must_use]
    pub fn start(&self) -> Option<[f64; 2]> {
        self.setpoints.first().map(|setpoint| setpoint.position)
    }

    /// Return the end point (m); `None` without setpoints.
    #[must_use]
    pub fn end(&self) -> Option<[f64; 2]> {
        let last = self.setpoints.last()?;
        Some([0, 1].map(|axis| last.position[axis] + last.velocity[axis] / self.rate))
    }

    /// Return the motion rotated by half a turn about `centre` (m): the right player's counterpart
    /// of the left player's motion.
    #[must_use]
    pub fn turned_about(&self, centre: [f64; 2]) -> Self {
        let start = self.start().unwrap_or(centre);
        let start = [0, 1].map(|axis| 2.0 * centre[axis] - start[axis]);
        let turned = |setpoint: &Setpoint| setpoint.velocity.map(|part| 0.0 - part);
        let velocities: Vec<[f64; 2]> = self.setpoints.iter().map(turned).collect();
        Self::from_velocities(start, &velocities, self.rate).unwrap_or_else(|_| self.clone())
    }

    /// Extend the motion with rest at its end to `samples` setpoints.
    #[must_use]
    pub fn resting_until(mut self, samples: usize) -> Self {
        if let Some(position) = self.end() {
            let rest = Setpoint { position, velocity: [0.0; 2] };
            self.setpoints.resize(self.setpoints.len().max(samples), rest);
        }
        self
    }
}

/// Return the speeds (m/s), each held for `dt` (s), that cover `distance` (m) from rest to rest.
fn transfer_speeds(distance: f64, limits: &Limits, dt: f64) -> Vec<f64> {
    let top = TRANSFER_SPEED.min(limits.speed_m_per_s).min(limits.total_speed_m_per_s);
    let slow = TRANSFER_ACCELERATION.min(limits.slew_m_per_s2).min(limits.braking_m_per_s2);
    // Gentle braking leaves a reserve, so the motion never needs more than the allowed braking.
    let gentle =
        Limits { braking_m_per_s2: slow, reaction_s: limits.reaction_s.max(2.0 * dt), ..*limits };
    let arrived = TRANSFER_SLACK_M * dt / gentle.reaction_s;
    let (mut room, mut speed) = (distance, 0.0_f64);
    let mut speeds = vec![0.0];
    while arrived < room {
        speed = (speed + slow * dt).min(top).min(gentle.speed_within(room));
        speeds.push(speed);
        room -= speed * dt;
    }
    speeds.extend([room / dt, 0.0]);
    speeds
}
