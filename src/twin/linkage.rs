//! Carriage to striker: encoders, play, geometry of the gantry, magnet.

use super::{Instance, Twin, lanes::Lanes, plant::Part, transmission};
use crate::{
    effects::{Carriage, Law, Motion, Physics, Place, Spring, both},
    gantry::{belts, rails},
};
use pulp::Scalar;

type PlayPart = Part<fn(&[f64], &mut [f64], &Motion) -> f64>;
type EncoderPart = Part<Law<fn(&[f64], f64, f64) -> f64>>;
type FramePart = Part<fn(&[f64], &Carriage) -> [f64; 2]>;
type CouplingPart = Part<fn(&[f64], &mut [f64], &Carriage) -> [f64; 2]>;

/// What the places of a carriage are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Places {
    /// Where the encoders say that it is; what they add is taken away.
    Reported,
    /// Where its motors truly are, as a [`super::Plant`] has them.
    True,
}

/// The functions between carriage and striker, in their order.
#[derive(Debug, Clone)]
pub struct Linkage {
    encoders: [Vec<EncoderPart>; 2],
    belt_plays: [Vec<PlayPart>; 2],
    rail_plays: [Vec<PlayPart>; 2],
    frames: Vec<FramePart>,
    couplings: Vec<CouplingPart>,
    mass: [f64; 2],
    turns_per_metre: f64,
    memory: usize,
}

impl Linkage {
    /// The linkage of the instances in `twin` that act between carriage and striker.
    #[must_use]
    pub fn new(twin: &Twin, places: Places) -> Self {
        let mut linkage = Self {
            encoders: [Vec::new(), Vec::new()],
            belt_plays: [Vec::new(), Vec::new()],
            rail_plays: [Vec::new(), Vec::new()],
            frames: Vec::new(),
            couplings: Vec::new(),
            mass: [0.0; 2],
            turns_per_metre: twin.belt_metres_per_turn.recip(),
            memory: 0,
        };
        for instance in &twin.instances {
            for equation in instance.effect.physics.equations() {
                linkage.add(instance, *equation);
            }
        }
        linkage.leave_rotors_out(twin);
        if places == Places::True {
            linkage.encoders = [Vec::new(), Vec::new()];
        }
        linkage
    }

    /// Rotors are on the motors' side of soft belts: no belt transmits the force that moves them.
    fn leave_rotors_out(&mut self, twin: &Twin) {
        let springs = both(|motor| {
            let own =
                twin.instances.iter().filter(|own| own.axis.is_motor() && own.axis.covers(motor));
            own.filter_map(Instance::spring).reduce(Spring::in_series)
        });
        if let Some([a, b]) = transmission::ties(springs) {
            let rotors = a.motor_mass + b.motor_mass;
            let of = |value: f64| Lanes::splat(Scalar, value);
            let share = transmission::rotor_share(Scalar, self.mass.map(of), of(rotors)).get(0);
            self.mass = self.mass.map(|mass| mass - share * rotors);
        }
    }

    fn add(&mut self, instance: &Instance, equation: Physics) {
        let memory = &mut self.memory;
        let axis = instance.axis;
        let covered = (0..2).filter(|index| axis.covers(*index));
        match equation {
            Physics::Encoder(call) => {
                let call = Law::Function(call);
                covered.for_each(|k| self.encoders[k].push(Part::new(call, instance, memory)));
            }
            Physics::Expression(Place::Output, own) => {
                let call = Law::Expression(own);
                covered.for_each(|k| self.encoders[k].push(Part::new(call, instance, memory)));
            }
            Physics::Backlash(call) => {
                let plays =
                    if axis.is_motor() { &mut self.belt_plays } else { &mut self.rail_plays };
                covered.for_each(|k| plays[k].push(Part::new(call, instance, memory)));
            }
            Physics::Frame(call) => self.frames.push(Part::new(call, instance, memory)),
            Physics::Coupling(call) => self.couplings.push(Part::new(call, instance, memory)),
            Physics::Mass(call) => {
                let mass = call(&instance.numbers());
                covered.for_each(|k| self.mass[k] += mass);
            }
            Physics::Inertia(call) => {
                let mass = call(&instance.numbers(), &Motion::default());
                covered.for_each(|k| self.mass[k] += mass);
            }
            _ => {}
        }
    }

    /// Numbers that it remembers for one carriage.
    #[must_use]
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// Whether anything in it remembers or depends on motion.
    #[must_use]
    pub fn is_dynamic(&self) -> bool {
        let plays = self.belt_plays.iter().chain(&self.rail_plays).any(|parts| !parts.is_empty());
        plays || self.couples() || !self.frames.is_empty()
    }

    /// Whether the striker may move beside its magnet.
    #[must_use]
    pub fn couples(&self) -> bool {
        !self.couplings.is_empty()
    }

    /// How far the striker is from its magnet (m), which is where the `carriage` is.
    #[must_use]
    pub fn away(&self, memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        let magnet = carriage.position;
        self.couplings.iter().fold([0.0; 2], |away, part| {
            let moved = (part.call)(part.p(), part.memory(memory), carriage);
            both(|k| away[k] + moved[k] - magnet[k])
        })
    }

    /// Striker (m) of a carriage at one time; `memory` is that of this carriage, [`memory`](Self::memory) numbers,
    /// all zero after a long rest.
    #[must_use]
    pub fn striker(&self, memory: &mut [f64], mut carriage: Carriage) -> [f64; 2] {
        let mut belt = belts(carriage.position);
        for (k, parts) in self.encoders.iter().enumerate() {
            for part in parts {
                // The path holds the reported position: take away what the encoder adds.
                belt[k] -= part.call.at(part.p(), belt[k], self.turns_per_metre) - belt[k];
            }
        }
        let force = both(|k| self.mass[k] * carriage.acceleration[k]);
        let belt_force = belts(force).map(|sum| 0.5 * sum);
        let (belt_velocity, belt_acceleration) =
            (belts(carriage.velocity), belts(carriage.acceleration));
        for (k, parts) in self.belt_plays.iter().enumerate() {
            for part in parts {
                let motion = Motion {
                    dt: carriage.dt,
                    position: belt[k],
                    velocity: belt_velocity[k],
                    acceleration: belt_acceleration[k],
                    force: belt_force[k],
                    ..Motion::default()
                };
                belt[k] = (part.call)(part.p(), part.memory(memory), &motion);
            }
        }
        let mut place = rails(belt);
        for (k, parts) in self.rail_plays.iter().enumerate() {
            for part in parts {
                let motion = Motion {
                    dt: carriage.dt,
                    position: place[k],
                    velocity: carriage.velocity[k],
                    acceleration: carriage.acceleration[k],
                    force: force[k],
                    ..Motion::default()
                };
                place[k] = (part.call)(part.p(), part.memory(memory), &motion);
            }
        }
        carriage.position = place;
        for part in &self.frames {
            carriage.position = (part.call)(part.p(), &carriage);
        }
        let away = self.away(memory, &carriage);
        both(|k| carriage.position[k] + away[k])
    }
}
