//! The stretch that a pilot drives.
//!
//! There is no path that a carriage could be compared with, so its encoders are compared with the integral
//! `r` of its own commands `u`, which leaks towards the position `p`: `r' = u + (p - r)/T`. There are two of
//! them: of the commands as they are, and of commands to the motors that change no faster than the drives can.
//! A carriage that follows is between both, a little late; from one that is jammed both go away by up to `u T`.
//!
//! A leg is proven to keep a margin from the edges, in which the lag of the drive has room. A pilot's way is not
//! proven, so its commands are held back before edges as by a carriage that is ahead by that lag, and that
//! brakes as on a diagonal.

use super::{Session, USUAL_LAG_SECONDS};
use crate::{
    collect::{
        control::Tick,
        pilot::{Carriage, Decision, FreeStretch, Moment},
        reason::StopReason,
        recorder::Entry,
        report::PictureToCommand,
    },
    gantry::{Limits, belts, rails},
    recording::{message::run_marker::Phase, topic::Player},
    units::Nanos,
};

/// Time in which the integral of commands forgets (s). With a following error of 0.06 m, a jammed carriage is
/// noticed that is told to move at 0.06 m/s or faster; half of this time would double that speed. While commands
/// go to and fro within that distance, a jam shows only in the heat of the drives.
const LEAK_SECONDS: f64 = 1.0;

/// A carriage may be as late as this behind its commands (s): twice the usual lag. Longer would let one that
/// is jammed be passed by commands that go to and fro.
const MOST_LAG_SECONDS: f64 = 2.0 * USUAL_LAG_SECONDS;

/// On a diagonal one motor of a CoreXY gantry turns and the other stands, so along each axis half of the
/// acceleration is left that both have together.
const DIAGONAL_SHARE: f64 = 0.5;

/// Where commands have led a carriage.
#[derive(Debug, Clone, Copy)]
struct Led {
    /// If it followed at once (m).
    at_once: [f64; 2],
    /// If its motors accelerated no better than can be relied on (m).
    slowly: [f64; 2],
    /// Velocity of the belts a and b then (m/s).
    slow_belts: [f64; 2],
}

impl Led {
    fn at(position: [f64; 2]) -> Self {
        Self { at_once: position, slowly: position, slow_belts: [0.0; 2] }
    }

    /// After `dt` seconds with a command (m/s) to the carriage at `position` (m), whose belts may take
    /// `acceleration` (m/s^2) for granted: along an axis both work together, on a diagonal one stands.
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

    /// The place between both that is nearest to `position` (m).
    fn nearest(&self, position: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| {
            let [a, b] = [self.at_once[axis], self.slowly[axis]];
            position[axis].clamp(a.min(b), a.max(b))
        })
    }
}

/// What a free stretch keeps from period to period.
#[derive(Default)]
struct Flight {
    /// Where the commands of each player have led.
    led: [Option<Led>; 2],
    /// When the newest picture shows the board.
    newest: Option<Nanos>,
    /// From picture to command (ms), period by period.
    waits_ms: Vec<f64>,
}

impl Session<'_> {
    /// Home, then the stretch.
    pub(super) fn drive_freely(&mut self, mut stretch: FreeStretch<'_>) -> Result<(), StopReason> {
        self.station.note_of("phase", None, "going home");
        let home = |player: &Player| {
            let home = self.station.robot.home.of(*player);
            (*player, [home.x_m, home.y_m])
        };
        let homes: Vec<_> = self.config.players.iter().map(home).collect();
        self.go_to(&homes)?;
        self.station.keep_pictures();
        self.stand(&homes)?;
        self.station.note_of("phase", None, &stretch.label.pattern);
        self.mark(&stretch.label, Phase::Start);
        let mut flight = Flight::default();
        let driven = self.fly(&mut stretch, &mut flight);
        self.mark(&stretch.label, Phase::End);
        self.picture_to_command = PictureToCommand::of(&flight.waits_ms);
        // A match that is ended early is a match all the same.
        self.samples += self.periods_in_leg;
        driven?;
        self.runs_done += 1;
        Ok(())
    }

    fn fly(
        &mut self,
        stretch: &mut FreeStretch<'_>,
        flight: &mut Flight,
    ) -> Result<(), StopReason> {
        self.guard.restart(MOST_LAG_SECONDS);
        let periods = stretch.periods(self.config.rate_hz);
        let mut at = 0;
        while at < periods {
            let tick = self.control.wait(&mut self.station)?;
            // Periods that were left out are not caught up.
            at += tick.advanced as usize - 1;
            for (shown, picture) in self.station.take_pictures() {
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
        }
        Ok(())
    }

    fn diagonal_limits(&self) -> Limits {
        let limits = self.station.robot.limits;
        Limits { braking_m_per_s2: DIAGONAL_SHARE * limits.braking_m_per_s2, ..limits }
    }

    fn driven_carriage(&self, player: Player) -> Option<Carriage> {
        let (position, velocity) = self.station.carriage(player).state()?;
        Some(Carriage { position, velocity })
    }

    /// Sends what the pilot wants, as far as the limits let it.
    fn obey(
        &mut self,
        decision: &Decision,
        tick: Tick,
        flight: &mut Flight,
    ) -> Result<(), StopReason> {
        let config = self.config;
        for player in &config.players {
            let velocity = decision.velocities[*player as usize];
            if !velocity.iter().all(|v| v.is_finite()) {
                return Err(StopReason::NoDecision { player: *player, velocity });
            }
        }
        let now = self.station.now();
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

    /// Tells the guard where the commands so far have led the carriage.
    fn expect_of_commands(&mut self, player: Player, tick: Tick, led: &mut Option<Led>) {
        let Some((position, _)) = self.station.carriage(player).state() else { return };
        let dt = f64::from(tick.advanced) * self.control.period_seconds();
        let commanded = self.control.commanded(player);
        let acceleration = self.station.robot.limits.braking_m_per_s2;
        let led = led.get_or_insert(Led::at(position));
        led.advance((position, commanded), acceleration, dt);
        self.guard.expect(player, self.station.now(), led.nearest(position));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const DT: f64 = 0.02;

    /// Largest distance (m) of a carriage from where `commands` lead it, of belts that change speed by
    /// `ramp` (m/s^2) and begin `late` periods after them.
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
            let nearest = led.nearest(position);
            worst = worst.max((nearest[0] - position[0]).hypot(nearest[1] - position[1]));
        }
        worst
    }

    /// Full speed one way or the other along each axis, as policies command it.
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
