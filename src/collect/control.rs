//! Control loop: absolute deadlines, the latest setpoint only, every period recorded.
//!
//! A missed period is skipped, never caught up in a burst. The reference is indexed by time, and
//! the slew limit applies over the elapsed time.

use super::{reason::StopReason, recorder::Entry, station::Station, watch::Armed};
use crate::{
    can::Message,
    gantry::BusConfig,
    link::LinkError,
    recording::{
        arrival_key,
        message::{ControlTick, VelocityCommand},
        topic::{Motor, Player},
    },
    stats::quantile,
    units::{NANOS_PER_SECOND, Nanos},
};
use serde::Serialize;

/// Consecutive periods without a setpoint on the bus before the session stops. At 50 Hz they fit
/// into a watchdog of 100 ms.
const MOST_FULL_PERIODS: u32 = 4;
/// Largest lateness of a period (s); the drives were without commands for too long.
const MOST_LATENESS_SECONDS: f64 = 0.1;

/// Timing of the control loop: missed deadlines and lateness of the periods.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct LoopTiming {
    /// Number of executed periods.
    pub periods: usize,
    /// Number of missed deadlines.
    pub missed_deadlines: u64,
    /// Median lateness (us).
    pub lateness_p50_us: f64,
    /// 99th percentile of the lateness (us).
    pub lateness_p99_us: f64,
    /// Largest lateness (us).
    pub lateness_max_us: f64,
}

/// Return the command latency of each motor (s after the command was recorded), as entries of the
/// metadata. The setpoints leave one after another in the order of
/// [`ControlLoop::command_unlimited`], each one frame time after the previous, if no other node
/// uses the bus.
pub(super) fn arrivals(players: &[Player], can: &BusConfig) -> Vec<(String, String)> {
    let seats = players.iter().flat_map(|player| Motor::BOTH.map(|motor| (*player, motor)));
    let entry = |(place, (player, motor)): (usize, _)| {
        let seconds = (place + 1) as f64 * can.frame_seconds();
        (arrival_key(player, motor), seconds.to_string())
    };
    seats.enumerate().map(entry).collect()
}

/// Timing of one period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tick {
    /// Number of periods since the previous one: 1 when no deadline was missed.
    pub(super) advanced: u32,
    deadline: Nanos,
    lateness_nanos: u64,
}

/// Control loop; see the module.
#[derive(Debug)]
pub(super) struct ControlLoop {
    period: u64,
    deadline: Nanos,
    latenesses: Vec<u32>,
    missed_deadlines: u64,
    full_periods: u32,
    dropped_in_period: u32,
    /// Last command of each player (m/s).
    commanded: [[f64; 2]; 2],
}

impl ControlLoop {
    pub(super) fn new(rate_hz: f64, now: Nanos) -> Self {
        let period = (NANOS_PER_SECOND as f64 / rate_hz).round() as u64;
        Self {
            period,
            deadline: Nanos(now.0 + period),
            latenesses: Vec::new(),
            missed_deadlines: 0,
            full_periods: 0,
            dropped_in_period: 0,
            commanded: [[0.0; 2]; 2],
        }
    }

    /// Return the length of a period (s).
    pub(super) fn period_seconds(&self) -> f64 {
        self.period as f64 / NANOS_PER_SECOND as f64
    }

    /// Return the last command of a player (m/s).
    pub(super) fn commanded(&self, player: Player) -> [f64; 2] {
        self.commanded[player as usize]
    }

    /// Return the last command of each player (m/s), left first.
    pub(super) fn all_commanded(&self) -> [[f64; 2]; 2] {
        self.commanded
    }

    /// Restart after an intended pause; the next deadline is one period away.
    pub(super) fn restart(&mut self, now: Nanos) {
        self.deadline = Nanos(now.0 + self.period);
    }

    /// Set the next deadline to now, for a reaction that cannot wait. No deadline is used twice.
    pub(super) fn hurry(&mut self, now: Nanos) {
        let last = self.deadline.0.saturating_sub(self.period);
        self.deadline = Nanos(now.0.max(last + 1));
    }

    /// Wait for the next period.
    pub(super) fn wait(&mut self, station: &mut Station<'_>) -> Result<Tick, StopReason> {
        station.wait_until(self.deadline)?;
        let deadline = self.deadline;
        let lateness = station.now().0.saturating_sub(deadline.0);
        let skipped = lateness / self.period;
        self.missed_deadlines += skipped;
        self.latenesses.push((lateness / 1000).min(u64::from(u32::MAX)) as u32);
        self.deadline = Nanos(deadline.0 + (skipped + 1) * self.period);
        self.dropped_in_period = 0;
        let lateness_s = lateness as f64 / NANOS_PER_SECOND as f64;
        if MOST_LATENESS_SECONDS < lateness_s {
            return Err(StopReason::LoopStalled { lateness_s, limit_s: MOST_LATENESS_SECONDS });
        }
        Ok(Tick { advanced: skipped as u32 + 1, deadline, lateness_nanos: lateness })
    }

    /// Send the velocity nearest to `wanted` (m/s) that limits and slew allow.
    pub(super) fn command(
        &mut self,
        station: &mut Station<'_>,
        player: Player,
        wanted: [f64; 2],
        tick: Tick,
    ) {
        let dt = f64::from(tick.advanced) * self.period_seconds();
        let limits = &station.robot.limits;
        let next = limits.next_velocity(self.commanded(player), wanted, dt);
        self.command_unlimited(station, player, next);
    }

    /// Send a velocity without limits, for braking.
    pub(super) fn command_unlimited(
        &mut self,
        station: &mut Station<'_>,
        player: Player,
        velocity: [f64; 2],
    ) {
        self.commanded[player as usize] = velocity;
        let motors = station.gantry.motors_from_board(velocity);
        let mut sent = true;
        for (motor, turns_per_s) in Motor::BOTH.into_iter().zip([motors.a, motors.b]) {
            let of_motor = |drive: &&super::watch::DriveWatch| {
                drive.seat.player == player && drive.seat.motor == motor && drive.armed != Armed::No
            };
            let Some(seat) = station.drives.iter().find(of_motor).map(|drive| drive.seat) else {
                sent = false;
                continue;
            };
            let velocity_turns_per_s = seat.directed(turns_per_s) as f32;
            let message = Message::SetInputVel { velocity_turns_per_s, torque_newton_metres: 0.0 };
            sent &= self.send_within_period(station, seat.node, &message);
        }
        if sent {
            let [vx, vy] = velocity;
            let command = VelocityCommand { vx, vy };
            station.record(station.now(), Entry::Command(player, command));
        }
    }

    /// Send a setpoint; return whether the bus took it within half a period. A setpoint is never
    /// queued.
    fn send_within_period(
        &mut self,
        station: &mut Station<'_>,
        node: u8,
        message: &Message,
    ) -> bool {
        let give_up = station.now().after_seconds(self.period_seconds() / 2.0);
        match station.send_by(give_up, node, message) {
            Ok(()) => return true,
            Err(LinkError::Full { .. }) => {
                self.dropped_in_period += 1;
                station.counts.setpoints_dropped += 1;
            }
            Err(error) => station.raise(StopReason::LinkBroken { reason: error.to_string() }),
        }
        false
    }

    /// End the period: record it, and stop when the bus has taken nothing for too long.
    pub(super) fn finish(
        &mut self,
        station: &mut Station<'_>,
        tick: Tick,
    ) -> Result<(), StopReason> {
        let entry = ControlTick {
            deadline_ns: tick.deadline.0,
            lateness_ns: tick.lateness_nanos as i64,
            skipped: tick.advanced - 1,
            setpoints_dropped: self.dropped_in_period,
        };
        station.record(station.now(), Entry::Tick(entry));
        self.full_periods = if self.dropped_in_period == 0 { 0 } else { self.full_periods + 1 };
        if MOST_FULL_PERIODS <= self.full_periods {
            return Err(StopReason::BusFull { periods: self.full_periods });
        }
        Ok(())
    }

    /// Return the timing of the periods so far.
    pub(super) fn timing(&self) -> LoopTiming {
        let late: Vec<f64> = self.latenesses.iter().map(|micros| f64::from(*micros)).collect();
        let at = |probability| quantile(&late, probability).unwrap_or(0.0);
        LoopTiming {
            periods: late.len(),
            missed_deadlines: self.missed_deadlines,
            lateness_p50_us: at(0.5),
            lateness_p99_us: at(0.99),
            lateness_max_us: at(1.0),
        }
    }
}
