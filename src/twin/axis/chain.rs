//! Functions of all instances that act on a single axis, by their position in the chain.

use super::VOLT;
use crate::{
    effects::{
        Bristles, ElasticLoad, ElasticState, InputKind, Law, Motion, Physics, Place, Resonance,
        VelocityController, Wave, follow, slewed,
    },
    twin::{Instance, Twin},
};

/// Steps into which a free-running axis divides a sample period with an elastic load, whose motor side oscillates faster than
/// the load.
const ELASTIC_STEPS: u32 = 8;

/// Effect of a constant input.
const OFFSET: &str = "drive.offset";

/// Slope of the force over the input below which the input is beyond a limit.
const LEAST_SLOPE: f64 = 1e-6;

/// Values of memory that all effects on the command path may have together.
const MOST_MEMORY: usize = 32;

/// Steps and their length (sample periods) after which no lag remembers its start.
const SETTLING_STEPS: usize = 300;
const SETTLING_STEP: f64 = 20.0;

/// One function of one instance, with its parameters and the location of its memory.
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

/// Setpoint after a step of `dt` seconds with this `command`, whose rate is at most `p[0]`; `memory` is the setpoint.
fn follow_slewed(p: &[f64], memory: &mut [f64], command: f64, dt: f64) -> f64 {
    memory[0] = slewed(memory[0], command, p[0] * dt);
    memory[0]
}

/// Force (N) of the wave with the parameters `p`.
fn repeating(p: &[f64], _memory: &mut [f64], motion: &Motion) -> f64 {
    Wave { sine: p[0], cosine: p[1], per_metre: p[2] }.force(motion)
}

type CommandPart = Part<Law<fn(&[f64], &mut [f64], f64, f64) -> f64>>;
type MotionPart = Part<Law<fn(&[f64], &mut [f64], &Motion) -> f64>>;
type BristlesPart = Part<fn(&[f64]) -> Bristles>;
type MassPart = Part<fn(&[f64], &Motion) -> f64>;

/// Everything between the input of a single axis and its motion.
#[derive(Debug, Clone, Default)]
pub(super) struct Chain {
    /// Dead time of the input (s).
    pub(super) delay: f64,
    /// Input that keeps a velocity without any friction: 1 for a velocity setpoint, 0 for a force.
    pub(super) input_per_velocity: f64,
    /// Integral gain of a velocity controller, divided by its proportional gain (1/s).
    integral_rate: f64,
    /// Position from which the positions in effects count.
    pub(super) origin: f64,
    /// Typical magnitude of the input.
    input_size: f64,
    /// Constant that the drive adds behind all limits of its command. A constant load acts there too.
    offset: f64,
    commands: Vec<CommandPart>,
    efforts: Vec<MotionPart>,
    forces: Vec<MotionPart>,
    frictions: Vec<MotionPart>,
    bristles: Vec<BristlesPart>,
    masses: Vec<MassPart>,
    /// Load behind the motor; `None` for a rigid axis.
    elastic_load: Option<ElasticLoad>,
    /// Resonance before the measured load; its forces are those of the input.
    pub(super) resonance: Option<Resonance>,
    /// True for a voltage, of which the back-EMF, a part of the viscous friction, makes no force.
    has_back_emf: bool,
    /// Constants of every motion: viscous friction (N s/m), friction level (N) and moving mass
    /// (kg), or the time constant of a velocity controller (s).
    damping: f64,
    level: f64,
    mass: f64,
    /// Length of the memory of commands and efforts, then that of forces and frictions.
    way: usize,
    load: usize,
}

/// Memory of a chain while it is stepped.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    way: [f64; MOST_MEMORY],
    load: Vec<f64>,
    /// `None` until the load follows the motor.
    elastic: Option<ElasticState>,
    /// Force of the controller, and the part that its integral action makes.
    controller: [f64; 2],
}

impl Memory {
    /// Continue at `motion`, to which the motor and its load were moved.
    pub(super) fn move_to(&mut self, motion: &Motion) {
        if let Some(elastic) = &mut self.elastic {
            elastic.move_to(motion);
        }
    }

    /// Become equal to `other`, the memory of the same chain.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.way = other.way;
        self.load.copy_from_slice(&other.load);
        self.elastic = other.elastic;
        self.controller = other.controller;
    }
}

/// Forces at one motion, in the unit of the input.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Loads {
    /// Mass that follows the motor rigidly (kg, or the input's unit per m/s^2).
    pub(super) mass: f64,
    /// Sum of the forces without dry friction.
    pub(super) forces: f64,
    /// Dry friction that changes its sign with the velocity; at rest it has any value up to this level.
    pub(super) rigid: f64,
    /// Dry friction of elastic contacts, against a positive velocity: it follows from their deflection.
    pub(super) contacts: f64,
    /// Level of the friction of elastic contacts.
    pub(super) elastic: f64,
}

impl Loads {
    /// Level of the dry friction against `velocity`; at rest, the largest that is in balance.
    pub(super) fn level(&self, velocity: f64) -> f64 {
        let contacts = match velocity {
            0.0 => self.contacts.abs(),
            moving => moving.signum() * self.contacts,
        };
        self.rigid + contacts
    }
}

impl Chain {
    /// Chain of the functions of the instances in `twin`. Motor and guide of a single axis are one
    /// coordinate.
    pub(super) fn new(twin: &Twin) -> Self {
        let scales = twin.axis_frame.map(|frame| frame.scales);
        let kind = scales.map_or(InputKind::Force, |own| own.input_kind());
        let mut chain = Self {
            input_per_velocity: if kind == InputKind::Velocity { 1.0 } else { 0.0 },
            origin: twin.position_origin(),
            input_size: scales.map_or(1.0, |own| own.input),
            has_back_emf: scales.is_some_and(|own| own.input_unit == VOLT),
            ..Self::default()
        };
        for instance in twin.instances.iter().filter(|instance| instance.axis.covers(0)) {
            for equation in instance.effect.physics.equations() {
                chain.add(instance, *equation);
            }
        }
        chain
    }

    /// Return whether all equations of `physics` are called. Behind a velocity setpoint, neither
    /// the force of the motor nor the mass is known. The integration of a velocity loop, which a
    /// limit stops, is not part of an axis with a force. A slew limit smooths the input: it removes
    /// the noise of a measured force and resembles a gain.
    pub(super) fn calls(physics: &Physics, kind: InputKind) -> bool {
        let is_called = |equation: &Physics| match equation {
            Physics::Effort(_)
            | Physics::Mass(_)
            | Physics::Inertia(_)
            | Physics::ElasticLoad(_)
            | Physics::Resonance(_)
            | Physics::Windup(_) => kind == InputKind::Force,
            Physics::VelocityController(_) | Physics::Ramp(_) => kind == InputKind::Velocity,
            Physics::CommandDelay(_)
            | Physics::Command(_)
            | Physics::Force(_)
            | Physics::Wave(_)
            | Physics::Friction(_)
            | Physics::Coulomb(_)
            | Physics::Damping(_)
            | Physics::Bristles(_)
            | Physics::Expression(Place::Force | Place::Friction | Place::Input, _) => true,
            _ => false,
        };
        physics.equations().iter().all(is_called)
    }

    fn add(&mut self, instance: &Instance, equation: Physics) {
        let (p, length) = (instance.numbers(), instance.effect.memory);
        let (way, load) = (self.way, self.load);
        match equation {
            Physics::CommandDelay(call) => self.delay += call(&p),
            Physics::Command(_) if instance.effect.name == OFFSET => self.offset += p[0],
            Physics::Command(call) if way + length <= MOST_MEMORY => {
                self.commands.push(Part { call: Law::Function(call), p, memory: way, length });
                self.way += length;
            }
            Physics::Ramp(limit) if way + length <= MOST_MEMORY => {
                let (call, p) = (Law::Function(follow_slewed as _), vec![limit(&p)]);
                self.commands.push(Part { call, p, memory: way, length });
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
            Physics::Wave(call) => {
                let Wave { sine, cosine, per_metre } = call(&p, 0.0);
                let (call, p) = (Law::Function(repeating as _), vec![sine, cosine, per_metre]);
                self.forces.push(Part { call, p, memory: load, length });
                self.load += length;
            }
            Physics::Friction(call) => {
                self.frictions.push(Part { call: Law::Function(call), p, memory: load, length });
                self.load += length;
            }
            Physics::VelocityController(call) => {
                let VelocityController { time_constant_s, integral_rate_per_s } = call(&p);
                self.mass += time_constant_s;
                self.integral_rate += integral_rate_per_s;
            }
            Physics::Coulomb(call) => self.level += call(&p),
            Physics::Damping(call) => self.damping += call(&p),
            Physics::Mass(call) => self.mass += call(&p),
            Physics::Bristles(call) => {
                self.bristles.push(Part { call, p, memory: load, length });
                self.load += length;
            }
            Physics::ElasticLoad(call) => self.elastic_load = Some(call(&p)),
            Physics::Resonance(call) => self.resonance = Some(call(&p)),
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

    /// Steps of a free-running axis in one sample period.
    pub(super) fn steps(&self) -> u32 {
        if self.elastic_load.is_some() { ELASTIC_STEPS } else { 1 }
    }

    /// Memory at rest.
    pub(super) fn memory(&self) -> Memory {
        Memory {
            way: [0.0; MOST_MEMORY],
            load: vec![0.0; self.load],
            elastic: None,
            controller: [0.0; 2],
        }
    }

    /// Elastic load with a mass.
    pub(super) fn moving_load(&self) -> Option<ElasticLoad> {
        self.elastic_load.filter(|own| 0.0 < own.fraction)
    }

    /// Let the load follow the motor in `motion`, but for these differences of its position and velocity.
    pub(super) fn start_load(&self, memory: &mut Memory, difference: [f64; 2], motion: &Motion) {
        memory.elastic =
            self.moving_load().map(|own| own.following(motion).with_load_moved(difference));
    }

    /// Moving mass at `motion` (kg, or the input's unit per m/s^2).
    pub(super) fn mass(&self, motion: &Motion) -> f64 {
        let others = self.masses.iter().map(|part| (part.call)(&part.p, motion));
        self.mass + others.sum::<f64>()
    }

    /// Forces at `motion`. Elastic contacts carry the same fraction of the dry friction at every level.
    pub(super) fn loads(&self, memory: &mut Memory, motion: &Motion) -> Loads {
        let back_emf = if self.has_back_emf { self.damping * motion.velocity } else { 0.0 };
        let motion = &Motion { force: motion.force - back_emf, ..*motion };
        let mut loads = Loads {
            mass: motion.mass,
            forces: -self.damping * motion.velocity,
            rigid: self.level,
            ..Loads::default()
        };
        for part in &self.forces {
            loads.forces += part.call.at(&part.p, part.memory(&mut memory.load), motion);
        }
        // Half of the difference between the directions resists the positive one and drives the negative one: it is a force.
        let speed = motion.velocity.abs().max(f64::MIN_POSITIVE);
        for part in &self.frictions {
            let [forwards, backwards] = [speed, -speed].map(|velocity| {
                let motion = Motion { velocity, ..*motion };
                part.call.at(&part.p, part.memory(&mut memory.load), &motion)
            });
            loads.rigid += 0.5 * (forwards + backwards);
            loads.forces -= 0.5 * (forwards - backwards);
        }
        if let Some(load) = self.moving_load() {
            let mass = load.fraction * motion.mass;
            let state = memory.elastic.get_or_insert_with(|| load.following(motion));
            loads.forces -= mass * load.follow(state, motion);
            loads.mass -= mass;
        }
        let level = loads.rigid.max(0.0);
        let ratio = if 0.0 < self.level { level / self.level } else { 1.0 };
        for part in &self.bristles {
            let bristles = (part.call)(&part.p).scaled(ratio);
            if bristles.force == 0.0 {
                continue;
            }
            let deflection = &mut part.memory(&mut memory.load)[0];
            let before = *deflection / bristles.distance;
            // The deflected contacts hold an axis that has stopped.
            let bend = match motion.velocity {
                0.0 => before,
                velocity => bristles.bent(before, velocity, motion.dt),
            };
            *deflection = bend * bristles.distance;
            loads.contacts += bristles.pull(bend, (bend - before) / motion.dt);
            loads.elastic += bristles.force;
            loads.rigid -= bristles.force;
        }
        loads
    }

    /// Force that `input` makes behind the command path: the input itself, or the force of a
    /// velocity controller.
    pub(super) fn force_of(&self, memory: &Memory, input: f64, motion: &Motion) -> f64 {
        input - self.input_per_velocity * motion.velocity + memory.controller[1]
    }

    /// Value behind the command path that gives `force`: the force itself, or the setpoint of a
    /// velocity controller. The integral action follows the force as a first-order lag, so the
    /// velocity error is the difference of both.
    pub(super) fn demand(&self, memory: &mut Memory, force: f64, motion: &Motion) -> f64 {
        if 0.0 < self.integral_rate {
            follow(1.0 / self.integral_rate, &mut memory.controller, force, motion.dt);
        }
        force + self.input_per_velocity * motion.velocity - memory.controller[1]
    }

    /// Let the integral action of a velocity controller act for one step on the `error` of the velocity.
    pub(super) fn integrate(&self, memory: &mut Memory, error: f64, dt: f64) {
        memory.controller[1] += self.integral_rate * error * dt;
    }

    /// Force of the motor for the input `input`.
    pub(super) fn force(&self, memory: &mut Memory, input: f64, motion: &Motion) -> f64 {
        self.through(&mut memory.way, input, motion)
    }

    /// Value behind the command path for `input`, without advancing the memory.
    pub(super) fn given(&self, memory: &Memory, input: f64, motion: &Motion) -> f64 {
        self.through(&mut memory.way.clone(), input, motion)
    }

    fn through(&self, memory: &mut [f64; MOST_MEMORY], input: f64, motion: &Motion) -> f64 {
        self.through_each(memory, input, motion, |_, _, _| ())
    }

    /// As [`Self::through`]; `seen` gets the length of the memory of each function, its argument and its value.
    fn through_each(
        &self,
        memory: &mut [f64; MOST_MEMORY],
        input: f64,
        motion: &Motion,
        mut seen: impl FnMut(usize, f64, f64),
    ) -> f64 {
        let taken_in = self.commands.iter().fold(input, |value, part| {
            let next = part.call.at(&part.p, part.memory(memory), value, motion.dt);
            seen(part.length, value, next);
            next
        });
        let given = self.efforts.iter().fold(taken_in, |force, part| {
            let motion = Motion { force, ..*motion };
            let next = part.call.at(&part.p, part.memory(memory), &motion);
            seen(part.length, force, next);
            next
        });
        given + self.offset
    }

    /// Factor by which limits without memory reduce `input`, at most 1.
    fn reduction(&self, memory: &Memory, input: f64, motion: &Motion) -> f64 {
        let mut reduction = 1.0;
        self.through_each(&mut memory.way.clone(), input, motion, |length, value, next| {
            let ratio = next / value;
            if length == 0 && 0.0 < ratio {
                reduction *= ratio.min(1.0);
            }
        });
        reduction
    }

    /// Input for which the motor gives `force`; of several, the one nearest to `near`. At a limit,
    /// where no input gives it, `near` plus the missing force, in terms of the input: a lower limit and smaller forces
    /// would else explain any input.
    pub(super) fn input(&self, memory: &mut Memory, force: f64, near: f64, motion: &Motion) -> f64 {
        if self.commands.is_empty() && self.efforts.is_empty() {
            return force - self.offset;
        }
        let tolerance = 1e-13 * (self.input_size + force.abs() + near.abs());
        let step = 1e-3 * (self.input_size + near.abs());
        let given = |input: f64| self.given(memory, input, motion);
        let at_near = given(near);
        let (mut from, mut lacking) = (near, force - at_near);
        let mut slope = (given(near + step) - at_near) / step;
        let is_at_limit = slope.abs() < LEAST_SLOPE;
        for _ in 0..4 {
            if lacking.abs() <= tolerance || slope.abs() < LEAST_SLOPE {
                break;
            }
            let to = from + lacking / slope;
            let left = force - given(to);
            slope = if to == from { 0.0 } else { (lacking - left) / (to - from) };
            (from, lacking) = (to, left);
        }
        let is_solved = lacking.abs() <= 1e4 * tolerance;
        let found = match (is_solved, is_at_limit) {
            (true, _) => from,
            (false, false) => near + force - at_near,
            (false, true) => near + (force - at_near) / self.reduction(memory, near, motion),
        };
        self.through(&mut memory.way, found, motion);
        found
    }

    /// Set the memory of the command path to the state after a long time at this `force` of the
    /// motor. A velocity controller has integrated nothing yet, as after it was enabled, so that a
    /// slow integral action has nearly no effect.
    pub(super) fn settle(&self, memory: &mut Memory, force: f64, motion: &Motion) {
        memory.controller = [force, 0.0];
        let force = self.demand(memory, force, motion);
        let motion = Motion { dt: SETTLING_STEP * motion.dt, ..*motion };
        let mut input = force;
        for _ in 0..SETTLING_STEPS {
            input += 0.5 * (force - self.through(&mut memory.way, input, &motion));
        }
    }

    /// Set the memory of the command path to the state after a long time at a constant `input`.
    pub(super) fn settle_input(&self, memory: &mut Memory, input: f64, motion: &Motion) {
        let motion = Motion { dt: SETTLING_STEP * motion.dt, ..*motion };
        for _ in 0..SETTLING_STEPS {
            self.through(&mut memory.way, input, &motion);
        }
    }
}
