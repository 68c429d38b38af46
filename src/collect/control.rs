//! The control loop: absolute deadlines, the latest setpoint only, every period recorded.
//!
//! A period that has passed is left out, never caught up in a burst: the reference is indexed by
//! time, and the slew limit holds over the time that has really passed.

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

/// Periods in a row without a setpoint on the bus before the session stops; at 50 Hz they fit into
/// a watchdog of 100 ms.
const MOST_FULL_PERIODS: u32 = 4;
/// A period that is later than this has left the drives alone for too long (s).
const MOST_LATENESS_SECONDS: f64 = 0.1;

/// How late the periods of a loop were.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Lateness {
    /// Periods that were kept.
    pub periods: usize,
    /// Periods that were left out.
    pub skipped: u64,
    /// Median (us).
    pub p50_us: f64,
    /// 99th percentile (us).
    pub p99_us: f64,
    /// Largest (us).
    pub max_us: f64,
}

/// When each motor hears a command of a period (s after it was recorded), as entries of the metadata:
/// the setpoints leave one after another in the order of [`ControlLoop::command_unlimited`], each a
/// frame's time after the one before if nobody else is on the bus.
pub(super) fn arrivals(players: &[Player], can: &BusConfig) -> Vec<(String, String)> {
    let seats = players.iter().flat_map(|player| Motor::BOTH.map(|motor| (*player, motor)));
    let entry = |(place, (player, motor)): (usize, _)| {
        let seconds = (place + 1) as f64 * can.frame_seconds();
        (arrival_key(player, motor), seconds.to_string())
    };
    seats.enumerate().map(entry).collect()
}

/// One period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tick {
    /// Periods that have passed since the one before: 1 when none was left out.
    pub(super) advanced: u32,
    deadline: Nanos,
    lateness_nanos: u64,
}

/// See the module.
#[derive(Debug)]
pub(super) struct ControlLoop {
    period: u64,
    deadline: Nanos,
    latenesses: Vec<u32>,
    skipped: u64,
    full_periods: u32,
    dropped_in_period: u32,
    /// The last command of each player (m/s).
    commanded: [[f64; 2]; 2],
}

impl ControlLoop {
    pub(super) fn new(rate_hz: f64, now: Nanos) -> Self {
        let period = (NANOS_PER_SECOND as f64 / rate_hz).round() as u64;
        Self {
            period,
            deadline: Nanos(now.0 + period),
            latenesses: Vec::new(),
            skipped: 0,
            full_periods: 0,
            dropped_in_period: 0,
            commanded: [[0.0; 2]; 2],
        }
    }

    /// Length of a period (s).
    pub(super) fn period_seconds(&self) -> f64 {
        self.period as f64 / NANOS_PER_SECOND as f64
    }

    /// The last command of a player (m/s).
    pub(super) fn commanded(&self, player: Player) -> [f64; 2] {
        self.commanded[player as usize]
    }

    /// The last command of each player (m/s), left first.
    pub(super) fn all_commanded(&self) -> [[f64; 2]; 2] {
        self.commanded
    }

    /// Begins anew after a pause that was meant; the next deadline is a period away.
    pub(super) fn restart(&mut self, now: Nanos) {
        self.deadline = Nanos(now.0 + self.period);
    }

    /// Makes the next deadline now, since a reaction cannot wait for it. No deadline is given twice.
    pub(super) fn hurry(&mut self, now: Nanos) {
        let last = self.deadline.0.saturating_sub(self.period);
        self.deadline = Nanos(now.0.max(last + 1));
    }

    /// Waits for the next period.
    pub(super) fn wait(&mut self, station: &mut Station<'_>) -> Result<Tick, StopReason> {
        station.wait_until(self.deadline)?;
        let deadline = self.deadline;
        let lateness = station.now().0.saturating_sub(deadline.0);
        let skipped = lateness / self.period;
        self.skipped += skipped;
        self.latenesses.push((lateness / 1000).min(u64::from(u32::MAX)) as u32);
        self.deadline = Nanos(deadline.0 + (skipped + 1) * self.period);
        self.dropped_in_period = 0;
        let lateness_s = lateness as f64 / NANOS_PER_SECOND as f64;
        if MOST_LATENESS_SECONDS < lateness_s {
            return Err(StopReason::LoopStalled { lateness_s, limit_s: MOST_LATENESS_SECONDS });
        }
        Ok(Tick { advanced: skipped as u32 + 1, deadline, lateness_nanos: lateness })
    }

    /// Sends the velocity nearest to `wanted` (m/s) that limits and slew allow.
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

    /// Sends a velocity as it is: for braking.
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

    /// Whether the bus took it within half a period; a setpoint is never kept for later.
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

    /// Ends the period: records it, and stops when the bus has taken nothing for too long.
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

    /// How late the periods were so far.
    pub(super) fn lateness(&self) -> Lateness {
        let late: Vec<f64> = self.latenesses.iter().map(|micros| f64::from(*micros)).collect();
        let at = |share| quantile(&late, share).unwrap_or(0.0);
        Lateness {
            periods: late.len(),
            skipped: self.skipped,
            p50_us: at(0.5),
            p99_us: at(0.99),
            max_us: at(1.0),
        }
    }
}
