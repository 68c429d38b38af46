//! Many carriages under one plant, each with its own state and commands, marched side by side.

use super::{Aside, Plant, PlantLanes, PlantState, StateLanes};
use crate::{effects::Motion, lanes::Lanes};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Maximum number of carriages that one vector holds.
pub(crate) const MOST_LANES: usize = 8;

/// A carriage after a step: position (m), velocity (m/s) and acceleration (m/s^2), by its motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// Position (m).
    pub position: [f64; 2],
    /// Velocity (m/s).
    pub velocity: [f64; 2],
    /// Mean acceleration over the step (m/s^2).
    pub acceleration: [f64; 2],
}

/// Commands of the carriages, and obstacles on their paths.
pub trait Course {
    /// Command of each motor of `carriage` during `step` (m/s of belt).
    fn command(&self, carriage: usize, step: usize) -> [f64; 2];

    /// Follow `carriage` to the end of `step`, where it has `moved`; position and velocity may be
    /// changed, as at the end of its travel.
    fn follow(&mut self, carriage: usize, step: usize, moved: &mut Moved);
}

/// Carriages under one plant.
#[derive(Debug, Clone)]
pub struct Fleet {
    plant: Plant,
    states: Vec<PlantState>,
    /// Memories of the effects of the carriages in a vector, during a march.
    memories: Vec<Vec<f64>>,
}

impl Fleet {
    /// `count` carriages at rest at the origin.
    #[must_use]
    pub fn new(plant: Plant, count: usize) -> Self {
        Self { states: vec![plant.start(); count], memories: vec![Vec::new(); MOST_LANES], plant }
    }

    /// Put `carriage` at rest at `position` (m).
    pub fn restart(&mut self, carriage: usize, position: [f64; 2]) {
        self.plant.restart(&mut self.states[carriage], position);
    }

    /// State of `carriage`.
    #[must_use]
    pub fn state(&self, carriage: usize) -> &PlantState {
        &self.states[carriage]
    }

    /// Every value of all states, always in the same order.
    pub fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        self.states.iter_mut().flat_map(PlantState::numbers)
    }

    /// Move the `carriages` through steps of these lengths (s), with the results of
    /// [`Plant::step`]. Allocates nothing.
    pub fn march(
        &mut self,
        carriages: Range<usize>,
        lengths: impl Iterator<Item = f64> + Clone,
        course: &mut impl Course,
    ) {
        for first in carriages.clone().step_by(MOST_LANES) {
            let group = first..(first + MOST_LANES).min(carriages.end);
            let lengths = lengths.clone();
            Arch::new().dispatch(March { fleet: self, carriages: group, lengths, course });
        }
    }
}

/// The march of at most [`MOST_LANES`] carriages.
struct March<'a, C, L> {
    fleet: &'a mut Fleet,
    carriages: Range<usize>,
    lengths: L,
    course: &'a mut C,
}

impl<C: Course, L: Iterator<Item = f64> + Clone> WithSimd for March<'_, C, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { fleet, carriages, lengths, course } = self;
        let Fleet { plant, states, memories } = fleet;
        let mut rails = [[Motion::default(); 2]; MOST_LANES];
        let mut belts = [plant.belts(); MOST_LANES];
        for first in carriages.clone().step_by(S::F64_LANES) {
            let count = S::F64_LANES.min(carriages.end - first);
            let plants = [&*plant; MOST_LANES];
            let lanes = PlantLanes::new(simd, &plants[..count]);
            let mut all = StateLanes::new(simd);
            for (lane, state) in states[first..first + count].iter_mut().enumerate() {
                std::mem::swap(&mut state.memory, &mut memories[lane]);
                all.put(lane, state);
                all.put_remembered(lane, plant, &memories[lane]);
            }
            let mut aside = Aside {
                memories: &mut memories[..count],
                rails: &mut rails[..count],
                belts: &mut belts[..count],
            };
            for (step, dt) in lengths.clone().enumerate() {
                let mut command = [Lanes::splat(simd, 0.0); 2];
                for lane in 0..count {
                    let [a, b] = course.command(first + lane, step);
                    command[0].set(lane, a);
                    command[1].set(lane, b);
                }
                lanes.step(&mut all, &mut aside, command, Lanes::splat(simd, dt));
                for lane in 0..count {
                    let [position, velocity, acceleration, _force] = all.motion(lane);
                    let moved = Moved { position, velocity, acceleration };
                    let mut left = moved;
                    course.follow(first + lane, step, &mut left);
                    if left != moved {
                        all.stop_at(lane, left.position, left.velocity);
                    }
                }
            }
            for (lane, state) in states[first..first + count].iter_mut().enumerate() {
                all.get(lane, state);
                all.get_remembered(lane, plant, &mut memories[lane]);
                std::mem::swap(&mut state.memory, &mut memories[lane]);
                state.flush();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{effects::Axis, twin::Twin};

    const STEPS: [f64; 5] = [2e-3, 1e-3, 5e-4, 2e-3, 1.5e-3];

    /// Different commands for every carriage and step, and a wall at x = 2 mm.
    struct Swing {
        round: usize,
        met: usize,
    }

    impl Course for Swing {
        fn command(&self, carriage: usize, step: usize) -> [f64; 2] {
            let phase = (carriage * 7 + self.round * 3 + step) as f64;
            [0.1 + 0.5 * phase.sin(), 0.1 + 0.4 * (1.3 * phase).cos()]
        }

        fn follow(&mut self, _carriage: usize, _step: usize, moved: &mut Moved) {
            if 2e-3 < moved.position[0] {
                (moved.position[0], moved.velocity[0]) = (2e-3, 0.0);
                self.met += 1;
            }
        }
    }

    #[test]
    fn every_carriage_moves_as_it_does_alone() {
        let rubs = ("drive.friction.presliding", Axis::Guides, &[1.5, 1e-4, 1e-3, 20.0][..]);
        let held = ("drive.friction.coulomb", Axis::Motors, &[0.7][..]);
        let play = ("drive.backlash", Axis::Motors, &[4e-4, 50.0][..]);
        let wave = ("drive.ripple.motor", Axis::Motors, &[0.4, -0.3, 1.7e-3][..]);
        for effects in [&[][..], &[held], &[rubs, held], &[play, held], &[wave, held]] {
            let plant = Plant::new(&Twin::table_with(effects));
            let count = 2 * MOST_LANES + 3;
            let mut fleet = Fleet::new(plant.clone(), count);
            let mut alone = vec![plant.start(); count];
            let mut course = Swing { round: 0, met: 0 };
            for round in 0..40 {
                course.round = round;
                fleet.march(0..count, STEPS.into_iter(), &mut course);
                for (carriage, state) in alone.iter_mut().enumerate() {
                    for (step, dt) in STEPS.iter().enumerate() {
                        plant.step(state, course.command(carriage, step), *dt);
                        if 2e-3 < state.position[0] {
                            // The estimates of both motors stay.
                            let lost = state.velocity[0];
                            state.first_lag = state.first_lag.map(|lag| lag - lost);
                            (state.position[0], state.velocity[0]) = (2e-3, 0.0);
                        }
                    }
                    state.flush();
                }
            }
            assert!(0 < course.met, "no carriage met the wall");
            let bits = |state: &mut PlantState| -> Vec<u64> {
                state.numbers().map(|value| value.to_bits()).collect()
            };
            for (carriage, state) in alone.iter_mut().enumerate() {
                assert_eq!(bits(&mut fleet.states[carriage]), bits(state), "{carriage}");
            }
        }
    }
}
