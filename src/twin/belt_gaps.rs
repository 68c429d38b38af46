//! Load of a gantry behind the backlash of its two belts.

use crate::{
    effects::{Carriage, Gap, both},
    gantry::{belts, rails},
};

/// Number of values that a load remembers: its position and velocity along both axes, and 1 once they are known.
pub(super) const MEMORY: usize = 5;

/// Position (m) and velocity (m/s) along both axes.
type Load = ([f64; 2], [f64; 2]);

/// Distance beyond an end that is rounding (m).
const REACHED_M: f64 = 1e-12;

/// Gaps between the motors and the load, which both belts move. A belt pulls along a diagonal, so a load that
/// one of them holds still moves along the other one.
#[derive(Debug, Clone, Copy)]
pub(super) struct BeltGaps {
    /// Width of the gap of each belt (m of belt), zero without backlash.
    widths: [f64; 2],
    /// Deceleration of the load within the gaps along each axis (m/s^2).
    decelerations: [f64; 2],
}

impl BeltGaps {
    /// Belts without backlash, whose load would have this `deceleration` (m/s^2) along both axes.
    pub(super) fn none(deceleration: f64) -> Self {
        Self { widths: [0.0; 2], decelerations: [deceleration; 2] }
    }

    /// Make the gap of a `belt` wider (m of belt).
    pub(super) fn widen(&mut self, belt: usize, width: f64) {
        self.widths[belt] += width;
    }

    /// Distribute the deceleration over both axes as the `friction` (N) of the guides decelerates the `masses` (kg). Its
    /// mean stays. Without friction of the guides or masses, both axes keep the same deceleration.
    pub(super) fn decelerate_by(&mut self, friction: [f64; 2], masses: [f64; 2]) {
        let shares = both(|k| friction[k] / masses[k]);
        let mean = 0.5 * (shares[0] + shares[1]);
        if mean.is_finite() && 0.0 < mean && shares.iter().all(|share| 0.0 <= *share) {
            self.decelerations = both(|k| self.decelerations[k] * shares[k] / mean);
        }
    }

    /// Position (m) of a load with `masses` (kg) along both axes, after one step of the `motors`.
    pub(super) fn load(&self, memory: &mut [f64], masses: [f64; 2], motors: &Carriage) -> [f64; 2] {
        if memory[4] == 0.0 {
            memory[..2].copy_from_slice(&motors.position);
            memory[2..4].copy_from_slice(&motors.velocity);
            memory[4] = 1.0;
        }
        let [x, y] =
            both(|k| Gap::coasted(memory[k], memory[2 + k], self.decelerations[k], motors.dt));
        let (position, velocity) = self.held(([x.0, y.0], [x.1, y.1]), masses, motors);
        memory[..2].copy_from_slice(&position);
        memory[2..4].copy_from_slice(&velocity);
        position
    }

    /// Position and velocity of a `load` that the ends of the gaps have pushed back: by one belt along its direction,
    /// less along the heavier axis, or by both.
    fn held(&self, load: Load, masses: [f64; 2], motors: &Carriage) -> Load {
        let over = self.beyond(load.0, motors);
        // Forces of both ends, but for a positive factor: each can only push.
        let pushes = rails(both(|k| -masses[k] * rails(over)[k]));
        let is_held = both(|belt| over[belt] != 0.0 && pushes[belt] * over[belt] < 0.0);
        let (position, velocity) = match is_held {
            [true, true] => return self.at_ends(load.0, motors),
            [true, false] => self.pushed(self.pushed(load, 0, masses, motors), 1, masses, motors),
            _ => self.pushed(self.pushed(load, 1, masses, motors), 0, masses, motors),
        };
        let is_beyond = |own: &f64| REACHED_M < own.abs();
        match self.beyond(position, motors).iter().any(is_beyond) {
            true => self.at_ends(load.0, motors),
            false => (position, velocity),
        }
    }

    /// Distance of a load at `position` (m) beyond the end of each gap (m of belt).
    fn beyond(&self, position: [f64; 2], motors: &Carriage) -> [f64; 2] {
        let away = belts(both(|k| position[k] - motors.position[k]));
        both(|belt| away[belt] - self.clamped(belt, away[belt]))
    }

    fn clamped(&self, belt: usize, away: f64) -> f64 {
        let half = 0.5 * self.widths[belt];
        away.clamp(-half, half)
    }

    /// A load at the ends of both gaps that are nearest to `position` (m), where it moves with the motors.
    fn at_ends(&self, position: [f64; 2], motors: &Carriage) -> Load {
        let away = belts(both(|k| position[k] - motors.position[k]));
        let ends = rails(both(|belt| self.clamped(belt, away[belt])));
        (both(|k| motors.position[k] + ends[k]), motors.velocity)
    }

    /// The load after a push of one `belt`, if it is beyond the end of its gap.
    fn pushed(
        &self,
        (position, velocity): Load,
        belt: usize,
        masses: [f64; 2],
        motors: &Carriage,
    ) -> Load {
        let over = self.beyond(position, motors)[belt];
        if over == 0.0 {
            return (position, velocity);
        }
        let approach = belts(both(|k| velocity[k] - motors.velocity[k]))[belt];
        let stopped = if 0.0 < approach * over { approach } else { 0.0 };
        // Belt a moves with x + y, belt b with x - y.
        let [x, y] = yields(masses);
        let along = [x, if belt == 0 { y } else { -y }];
        (both(|k| position[k] - over * along[k]), both(|k| velocity[k] - stopped * along[k]))
    }
}

/// Displacement along each axis by a push along one belt, as fractions of that along the belt.
fn yields(masses: [f64; 2]) -> [f64; 2] {
    let sum = masses[0] + masses[1];
    if masses.iter().all(|mass| 0.0 < *mass) {
        [masses[1] / sum, masses[0] / sum]
    } else {
        [0.5; 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f64 = 1e-3;

    fn gaps(widths: [f64; 2], deceleration: f64) -> BeltGaps {
        BeltGaps { widths, decelerations: [deceleration; 2] }
    }

    fn motors(position: [f64; 2], velocity: [f64; 2]) -> Carriage {
        Carriage { dt: 1e-3, position, velocity, ..Carriage::default() }
    }

    #[test]
    fn a_load_with_friction_lags_by_half_a_gap_along_an_axis() {
        for axis in 0..2 {
            let own = gaps([WIDTH; 2], 1000.0);
            let mut memory = [0.0; MEMORY];
            let unit = both(|k| if k == axis { 1.0 } else { 0.0 });
            let mut place = [0.0; 2];
            for step in 0..200 {
                let along = 1e-4 * f64::from(step);
                place = own.load(
                    &mut memory,
                    [0.3, 0.7],
                    &motors(unit.map(|own| own * along), unit.map(|own| 0.1 * own)),
                );
            }
            let lag = 1e-4 * 199.0 - place[axis];
            assert!((lag - 0.5 * WIDTH).abs() < 1e-9 && place[1 - axis].abs() < 1e-9, "{place:?}");
        }
    }

    #[test]
    fn one_belt_moves_the_lighter_axis_further() {
        let own = gaps([WIDTH; 2], 1000.0);
        let mut memory = [0.0; MEMORY];
        own.load(&mut memory, [0.2, 0.6], &motors([0.0; 2], [0.0; 2]));
        // Motor a alone goes on by 1 mm beyond the gap.
        let by_a = rails([0.5 * WIDTH + 1e-3, 0.0]);
        let place = own.load(&mut memory, [0.2, 0.6], &motors(by_a, [0.0; 2]));
        assert!(
            (place[0] - 0.75e-3).abs() < 1e-12 && (place[1] - 0.25e-3).abs() < 1e-12,
            "{place:?}"
        );
    }

    #[test]
    fn without_gaps_the_load_is_where_the_motors_are() {
        let own = gaps([0.0; 2], 50.0);
        let mut memory = [0.0; MEMORY];
        for step in 0..50 {
            let t = 1e-3 * f64::from(step);
            let position = [(9.0 * t).sin(), (7.0 * t).cos()];
            let place = own.load(
                &mut memory,
                [0.2, 0.6],
                &motors(position, [9.0 * (9.0 * t).cos(), -7.0 * (7.0 * t).sin()]),
            );
            assert!((0..2).all(|k| (place[k] - position[k]).abs() < 1e-12), "{place:?}");
        }
    }

    #[test]
    fn friction_of_each_guide_decelerates_the_mass_that_it_guides() {
        let mut own = gaps([WIDTH; 2], 3.0);
        own.decelerate_by([2.0, 1.0], [0.4, 0.2]);
        assert_eq!(own.decelerations, [3.0; 2]);
        own.decelerate_by([2.0, 0.5], [0.4, 0.2]);
        assert!((own.decelerations[0] - 4.0).abs() < 1e-12);
        assert!((own.decelerations[1] - 2.0).abs() < 1e-12);
        // Neither a gantry without friction or mass, nor a mass that a fit made negative, changes anything.
        for (friction, masses) in [([0.0; 2], [0.0; 2]), ([2.0, 0.5], [0.4, -0.2])] {
            own.decelerate_by(friction, masses);
            assert!((own.decelerations[0] - 4.0).abs() < 1e-12);
        }
    }

    #[test]
    fn no_end_of_a_gap_is_passed_and_a_load_without_friction_coasts() {
        let own = gaps([WIDTH, 0.5 * WIDTH], 0.0);
        let mut memory = [0.0; MEMORY];
        own.load(&mut memory, [0.2, 0.6], &motors([0.0; 2], [0.1, 0.0]));
        for _ in 0..100 {
            let place = belts(own.load(&mut memory, [0.2, 0.6], &motors([0.0; 2], [0.0; 2])));
            assert!(
                place[0] <= 0.5 * WIDTH + 1e-12 && place[1] <= 0.25 * WIDTH + 1e-12,
                "{place:?}"
            );
        }
        // Belt b holds it first, coasts on along belt a, and stops at that end.
        let place = belts([memory[0], memory[1]]);
        assert!(0.4 * WIDTH < place[0], "{place:?}");
    }
}
