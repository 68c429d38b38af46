//! Free run of a pilot.
//!
//! A free run has no path to compare a carriage with. Instead its encoders are compared with the
//! integral `r` of its own commands `u`, which leaks towards the position `p`: `r' = u + (p -
//! r)/T`. There are two integrals: one of the commands, and one of motor commands that change no
//! faster than the drives can. The position of a carriage that follows lies between both, slightly
//! late. From a jammed carriage both depart by up to `u T`.
//!
//! The safety check of a leg keeps a margin from the edges, which covers the lag of the drive. The
//! path of a pilot is not checked in advance. Its commands are therefore limited before edges for a
//! carriage that is ahead by that lag and that brakes as on a diagonal.

use super::{Session, USUAL_LAG_SECONDS};
use crate::{
    collect::{
        control::Tick,
        guard::Expected,
        pilot::{Carriage, Decision, FreeStretch, Moment},
        reason::StopReason,
        recorder::Entry,
        report::ImageToCommand,
    },
    gantry::{Limits, belts, rails},
    recording::{message::run_marker::Phase, topic::Player},
    units::Nanos,
};

/// Time constant of the leaky integral of commands (s). With a following error of 0.06 m, a jam is
/// detected for commands of 0.06 m/s or faster; half of this time would double that speed. While
/// commands oscillate within that distance, a jam shows only in the temperature of the drives.
const LEAK_SECONDS: f64 = 1.0;

/// Largest lag of a carriage behind its commands (s): twice the usual lag. With a longer one,
/// oscillating commands could hide a jam.
const MOST_LAG_SECONDS: f64 = 2.0 * USUAL_LAG_SECONDS;

/// Fraction of the acceleration along each axis that is available on a diagonal: one motor of a
/// CoreXY gantry turns and the other stands.
const DIAGONAL_FRACTION: f64 = 0.5;

/// Expected position of a carriage from its commands.
#[derive(Debug, Clone, Copy)]
struct Led {
    /// Position with ideal tracking (m).
    at_once: [f64; 2],
    /// Position with the least acceleration that the motors are guaranteed to have (m).
    slowly: [f64; 2],
    /// Velocity of the belts a and b for that acceleration (m/s).
    slow_belts: [f64; 2],
}

impl Led {
    fn at(position: [f64; 2]) -> Self {
        Self { at_once: position, slowly: position, slow_belts: [0.0; 2] }
    }

    /// Advance by `dt` seconds with a command (m/s) to the carriage at `position` (m). Its belts
    /// are guaranteed `acceleration` (m/s^2): along an axis both belts work together, on a diagonal
    /// one stands.
    fn advance(&mut self, (position, commanded): ([f64; 2], [f64; 2]), acceleration: f64, dt: f64) {
        let step = acceleration * dt;
        for (slow, wanted) in self.slow_belts.iter_mut().zip(belts(commanded)) {
            *slow += (wanted - *slow).clamp(-step, step);
        }
        for (axis, slow) in rails(self.slow_belts).into_iter().enumerate() {
            let lead = |from: &mut f64, velocity: f64| {
                *from += dt * (velocity + (position[axis] - *from) / LEAK_SECONDS);
            };
            lead(&mut self.at_once[axis], commanded[axis]);
            lead(&mut self.slowly[axis], slow);
        }
    }

    /// Return the positions between both.
    fn expected(&self) -> Expected {
        Expected::between(self.at_once, self.slowly)
    }
}

/// State of a free run from period to period.
#[derive(Default)]
struct FreeState {
    /// Expected position of each player's carriage.
    led: [Option<Led>; 2],
    /// Capture time of the newest frame.
    newest: Option<Nanos>,
    /// Image-to-command latency of each period (ms).
    waits_ms: Vec<f64>,
}

impl Session<'_> {
    /// Drive home, then execute the free run.
    pub(super) fn drive_freely(&mut self, mut stretch: FreeStretch<'_>) -> Result<(), StopReason> {
        self.station.note_of("phase", None, "going home");
        let home = |player: &Player| {
            let home = self.station.robot.home.of(*player);
            (*player, [home.x_m, home.y_m])
        };
        let homes: Vec<_> = self.config.players.iter().map(home).collect();
        self.go_to(&homes)?;
        self.station.keep_camera_frames();
        self.stand(&homes)?;
        self.station.note_of("phase", None, &stretch.label.pattern);
        self.mark(&stretch.label, Phase::Start);
        let mut flight = FreeState::default();
        let driven = self.execute_free(&mut stretch, &mut flight);
        self.mark(&stretch.label, Phase::End);
        self.image_to_command = ImageToCommand::of(&flight.waits_ms);
        // A match that ends early counts as a match.
        self.samples += self.periods_in_leg;
        driven?;
        self.runs_done += 1;
        Ok(())
    }

    fn execute_free(
        &mut self,
        stretch: &mut FreeStretch<'_>,
        flight: &mut FreeState,
    ) -> Result<(), StopReason> {
        self.guard.restart(MOST_LAG_SECONDS);
        let periods = stretch.periods(self.config.rate_hz);
        let mut at = 0;
        while at < periods {
            let tick = self.control.wait(&mut self.station)?;
            // Missed periods are not caught up.
            at += tick.advanced as usize - 1;
            for (shown, picture) in self.station.take_camera_frames() {
                flight.newest = flight.newest.max(Some(shown));
                stretch.pilot.see(shown, &picture);
            }
            let now = self.station.now();
            let carriages = Player::BOTH.map(|player| self.driven_carriage(player));
            let decision = stretch.pilot.decide(&Moment { now, step: at as u64, carriages });
            self.obey(&decision, tick, flight)?;
            at += 1;
            self.periods_in_leg = at;
            self.end_period(tick, Some(&stretch.label))?;
            if decision.complete {
                return Ok(());
            }
        }
        Ok(())
    }

    fn diagonal_limits(&self) -> Limits {
        let limits = self.station.robot.limits;
        Limits { braking_m_per_s2: DIAGONAL_FRACTION * limits.braking_m_per_s2, ..limits }
    }

    fn driven_carriage(&self, player: Player) -> Option<Carriage> {
        let (position, velocity) = self.station.carriage(player).state()?;
        Some(Carriage { position, velocity })
    }

    /// Send the pilot's command within the limits.
    fn obey(
        &mut self,
        decision: &Decision,
        tick: Tick,
        flight: &mut FreeState,
    ) -> Result<(), StopReason> {
        if let Some(reason) = &decision.stop {
            return Err(reason.clone());
        }
        let config = self.config;
        for player in &config.players {
            let velocity = decision.velocities[*player as usize];
            if !velocity.iter().all(|v| v.is_finite()) {
                return Err(StopReason::NoDecision { player: *player, velocity });
            }
        }
        let now = self.station.now();
        if let Some(note) = &decision.note {
            self.station.note_of("match", None, note);
        }
        if let Some(belief) = decision.belief {
            self.station.record(now, Entry::Board(belief));
        }
        self.station.record_truth();
        let limits = self.diagonal_limits();
        let ahead_s = limits.reaction_s + USUAL_LAG_SECONDS;
        for player in &config.players {
            self.expect_of_commands(*player, tick, &mut flight.led[*player as usize]);
            let wanted = decision.velocities[*player as usize];
            let wanted = self.before_edges(*player, wanted, (&limits, ahead_s));
            self.control.command(&mut self.station, *player, wanted, tick);
        }
        if let Some(newest) = flight.newest {
            flight.waits_ms.push(1e3 * self.station.now().seconds_since(newest));
        }
        Ok(())
    }

    /// Pass the expected position of the carriage to the guard.
    fn expect_of_commands(&mut self, player: Player, tick: Tick, led: &mut Option<Led>) {
        let Some((position, _)) = self.station.carriage(player).state() else { return };
        let dt = f64::from(tick.advanced) * self.control.period_seconds();
        let commanded = self.control.commanded(player);
        let acceleration = self.station.robot.limits.braking_m_per_s2;
        let led = led.get_or_insert(Led::at(position));
        led.advance((position, commanded), acceleration, dt);
        self.guard.expect(player, self.station.now(), led.expected());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const DT: f64 = 0.02;

    /// Return the largest distance (m) of a carriage from the integral of `commands`, for belts
    /// that change speed by `ramp` (m/s^2) and react `late` periods later.
    fn worst(commands: impl Fn(f64) -> [f64; 2], ramp: f64, late: usize) -> f64 {
        let (mut led, mut position) = (Led::at([0.0; 2]), [0.0; 2]);
        let (mut belts, mut sent, mut worst) = ([0.0_f64; 2], vec![[0.0; 2]; late], 0.0_f64);
        for period in 0..3000 {
            let commanded = commands(DT * f64::from(period));
            sent.push(commanded);
            let [x, y] = sent.remove(0);
            for (belt, wanted) in belts.iter_mut().zip([x + y, x - y]) {
                *belt += (wanted - *belt).clamp(-ramp * DT, ramp * DT);
            }
            let velocity = [0.5 * (belts[0] + belts[1]), 0.5 * (belts[0] - belts[1])];
            position = [0, 1].map(|axis| position[axis] + DT * velocity[axis]);
            led.advance((position, commanded), 5.0, DT);
            worst = worst.max(led.expected().distance(position));
        }
        worst
    }

    /// Oscillation at full speed along each axis, as policies command it.
    fn to_and_fro(t: f64) -> [f64; 2] {
        [1.13, 1.71].map(|hertz| 0.4 * (TAU * hertz * t).sin().signum())
    }

    #[test]
    fn a_ramping_gantry_stays_near_commands_that_go_to_and_fro_and_a_jammed_one_does_not() {
        assert!(worst(to_and_fro, 6.4, 1) < 0.035, "{}", worst(to_and_fro, 6.4, 1));
        assert!(worst(to_and_fro, 40.0, 2) < 0.035, "{}", worst(to_and_fro, 40.0, 2));
        assert!(0.06 < worst(|_| [0.1, 0.0], 0.0, 0));
    }
}
