//! The functions of all instances that act on a single axis, by their place in the chain.

use crate::{
    effects::{Bristles, Law, Motion, Physics, Place},
    twin::{Instance, Twin},
};

/// Numbers of memory that all effects on the way of the command may have together.
const MOST_MEMORY: usize = 32;

/// Steps and their length (sample periods) after which no lag remembers its start.
const SETTLING_STEPS: usize = 300;
const SETTLING_STEP: f64 = 20.0;

/// One function of one instance, with its numbers and the place of its memory.
#[derive(Debug, Clone)]
struct Part<F> {
    call: F,
    p: Vec<f64>,
    memory: usize,
    length: usize,
}

impl<F> Part<F> {
    fn memory<'a>(&self, memory: &'a mut [f64]) -> &'a mut [f64] {
        &mut memory[self.memory..self.memory + self.length]
    }
}

type CommandPart = Part<Law<fn(&[f64], &mut [f64], f64, f64) -> f64>>;
type MotionPart = Part<Law<fn(&[f64], &mut [f64], &Motion) -> f64>>;
type BristlesPart = Part<fn(&[f64]) -> Bristles>;
type MassPart = Part<fn(&[f64], &Motion) -> f64>;

/// Everything between the input of a force-driven axis and its motion.
#[derive(Debug, Clone, Default)]
pub(super) struct Chain {
    /// Dead time of the input (s).
    pub(super) delay: f64,
    /// Position from which the positions in effects count.
    pub(super) origin: f64,
    /// Typical size of the input.
    input_size: f64,
    commands: Vec<CommandPart>,
    efforts: Vec<MotionPart>,
    forces: Vec<MotionPart>,
    frictions: Vec<MotionPart>,
    bristles: Vec<BristlesPart>,
    masses: Vec<MassPart>,
    /// What is the same in every motion: viscous friction (N s/m), friction level (N) and moving mass (kg).
    damping: f64,
    level: f64,
    mass: f64,
    /// Memory of commands and efforts, then that of forces and frictions.
    way: usize,
    load: usize,
}

/// Memory of a chain while it is stepped.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    way: [f64; MOST_MEMORY],
    load: Vec<f64>,
}

impl Memory {
    /// Become equal to `other`, the memory of the same chain.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.way = other.way;
        self.load.copy_from_slice(&other.load);
    }
}

impl Chain {
    /// The functions of the instances in `twin`. Motor and rail of a single axis are one
    /// coordinate.
    pub(super) fn new(twin: &Twin) -> Self {
        let mut chain = Self {
            origin: twin.position_origin(),
            input_size: twin.axis_frame.map_or(1.0, |frame| frame.scales.input),
            ..Self::default()
        };
        for instance in twin.instances.iter().filter(|instance| instance.axis.covers(0)) {
            for equation in instance.effect.physics.equations() {
                chain.add(instance, *equation);
            }
        }
        chain
    }

    /// Whether physics of this kind is called, all of it.
    pub(super) fn calls(physics: &Physics) -> bool {
        let is_called = |equation: &Physics| {
            matches!(
                equation,
                Physics::CommandDelay(_)
                    | Physics::Command(_)
                    | Physics::Effort(_)
                    | Physics::Force(_)
                    | Physics::Friction(_)
                    | Physics::Coulomb(_)
                    | Physics::Damping(_)
                    | Physics::Bristles(_)
                    | Physics::Mass(_)
                    | Physics::Inertia(_)
                    | Physics::Expression(Place::Force | Place::Friction | Place::Input, _)
            )
        };
        physics.equations().iter().all(is_called)
    }

    fn add(&mut self, instance: &Instance, equation: Physics) {
        let (p, length) = (instance.numbers(), instance.effect.memory);
        let (way, load) = (self.way, self.load);
        match equation {
            Physics::CommandDelay(call) => self.delay += call(&p),
            Physics::Command(call) if way + length <= MOST_MEMORY => {
                self.commands.push(Part { call: Law::Function(call), p, memory: way, length });
                self.way += length;
            }
            Physics::Effort(call) if way + length <= MOST_MEMORY => {
                self.efforts.push(Part { call: Law::Function(call), p, memory: way, length });
                self.way += length;
            }
            Physics::Force(call) => {
                self.forces.push(Part { call: Law::Function(call), p, memory: load, length });
                self.load += length;
            }
            Physics::Friction(call) => {
                self.frictions.push(Part { call: Law::Function(call), p, memory: load, length });
                self.load += length;
            }
            Physics::Coulomb(call) => self.level += call(&p),
            Physics::Damping(call) => self.damping += call(&p),
            Physics::Mass(call) => self.mass += call(&p),
            Physics::Bristles(call) => {
                self.bristles.push(Part { call, p, memory: load, length });
                self.load += length;
            }
            Physics::Inertia(call) => {
                self.masses.push(Part { call, p, memory: 0, length: 0 });
            }
            Physics::Expression(Place::Force, own) => {
                self.forces.push(Part { call: Law::Expression(own), p, memory: 0, length: 0 });
            }
            Physics::Expression(Place::Friction, own) => {
                self.frictions.push(Part { call: Law::Level(own), p, memory: 0, length: 0 });
            }
            Physics::Expression(Place::Input, own) => {
                self.commands.push(Part { call: Law::Expression(own), p, memory: 0, length: 0 });
            }
            _ => {}
        }
    }

    /// Memory at rest.
    pub(super) fn memory(&self) -> Memory {
        Memory { way: [0.0; MOST_MEMORY], load: vec![0.0; self.load] }
    }

    /// Moving mass at `motion` (kg, or the input's unit per m/s^2).
    pub(super) fn mass(&self, motion: &Motion) -> f64 {
        let others = self.masses.iter().map(|part| (part.call)(&part.p, motion));
        self.mass + others.sum::<f64>()
    }

    /// Sum of the forces at `motion`, and the level of friction.
    pub(super) fn loads(&self, memory: &mut Memory, motion: &Motion) -> (f64, f64) {
        let mut sum = |parts: &[MotionPart]| -> f64 {
            parts
                .iter()
                .map(|part| part.call.at(&part.p, part.memory(&mut memory.load), motion))
                .sum()
        };
        let forces = sum(&self.forces) - self.damping * motion.velocity;
        let rigid = self.level + sum(&self.frictions);
        let lacking = self.bristles.iter().map(|part| {
            let bristles = (part.call)(&part.p);
            let bend = &mut part.memory(&mut memory.load)[0];
            if motion.velocity == 0.0 {
                // What has stopped is held by the bent contacts.
                return bristles.force * (1.0 - bend.abs());
            }
            let before = *bend;
            *bend = bristles.bent(before, motion.velocity, motion.dt);
            let pull = bristles.pull(*bend, (*bend - before) / motion.dt);
            bristles.force - motion.velocity.signum() * pull
        });
        (forces, rigid - lacking.sum::<f64>())
    }

    /// Force of the motor for the input `input`.
    pub(super) fn force(&self, memory: &mut Memory, input: f64, motion: &Motion) -> f64 {
        self.through(&mut memory.way, input, motion)
    }

    fn through(&self, memory: &mut [f64; MOST_MEMORY], input: f64, motion: &Motion) -> f64 {
        let taken_in = self.commands.iter().fold(input, |value, part| {
            part.call.at(&part.p, part.memory(memory), value, motion.dt)
        });
        self.efforts.iter().fold(taken_in, |force, part| {
            let motion = Motion { force, ..*motion };
            part.call.at(&part.p, part.memory(memory), &motion)
        })
    }

    /// The input from which the motor gives `force`: of several, the one beside `near`; where none
    /// does (a limit), `near` plus what is lacking.
    pub(super) fn input(&self, memory: &mut Memory, force: f64, near: f64, motion: &Motion) -> f64 {
        if self.commands.is_empty() && self.efforts.is_empty() {
            return force;
        }
        let tolerance = 1e-13 * (self.input_size + force.abs() + near.abs());
        let step = 1e-3 * (self.input_size + near.abs());
        let given = |input: f64| self.through(&mut memory.way.clone(), input, motion);
        let at_near = given(near);
        let (mut from, mut lacking) = (near, force - at_near);
        let mut slope = (given(near + step) - at_near) / step;
        for _ in 0..4 {
            if lacking.abs() <= tolerance || slope.abs() < 1e-6 {
                break;
            }
            let to = from + lacking / slope;
            let left = force - given(to);
            slope = if to == from { 0.0 } else { (lacking - left) / (to - from) };
            (from, lacking) = (to, left);
        }
        let solved = lacking.abs() <= 1e4 * tolerance;
        let found = if solved { from } else { near + force - at_near };
        self.through(&mut memory.way, found, motion);
        found
    }

    /// Brings the memory of the way to where the motor has given `force` for long.
    pub(super) fn settle(&self, memory: &mut Memory, force: f64, motion: &Motion) {
        let motion = Motion { dt: SETTLING_STEP * motion.dt, ..*motion };
        let mut input = force;
        for _ in 0..SETTLING_STEPS {
            input += 0.5 * (force - self.through(&mut memory.way, input, &motion));
        }
    }

    /// Brings the memory of the way to where `input` has stood for long.
    pub(super) fn settle_input(&self, memory: &mut Memory, input: f64, motion: &Motion) {
        let motion = Motion { dt: SETTLING_STEP * motion.dt, ..*motion };
        for _ in 0..SETTLING_STEPS {
            self.through(&mut memory.way, input, &motion);
        }
    }
}
