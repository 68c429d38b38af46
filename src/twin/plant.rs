//! Free-running simulation of drives and gantry: the joint equations of all instances of a twin.
//!
//! Per motor, in metres of belt: command -> effects on the command -> slew limit -> velocity loop
//! -> effects on the force. The loop sees the velocity that the drive estimates from its encoder
//! ([`estimator`]). Per axis of the carriage: sum of both belts' forces, forces and friction of all
//! instances, moving mass.
//!
//! The step is semi-implicit. The loop's force is taken at the middle of the step, with the
//! velocity that it will have there to first order. Friction is the impulse that would stop the
//! motion, held within its level (Coulomb's law without chatter, as in the simulators of BAM). The
//! part of it that bends before it slides is solved with the step ([`contact`](super::contact)).

mod estimator;
mod fleet;
mod step;

use super::{
    Instance, Twin,
    transmission::{self, Tie},
};
use crate::{
    effects::{
        Axis, Bristles, Expression, Law, LoopGains, Motion, Physics, Place, Regressor, Spring,
        Striker, Wave, both,
    },
    gantry::belts,
    lanes::Lanes,
};
pub(crate) use fleet::MOST_LANES;
pub use fleet::{Course, Fleet, Moved};
use pulp::Scalar;
pub(super) use step::{Aside, PlantLanes, StateLanes};

/// Most parameters that one effect has.
const MOST_PARAMETERS: usize = 8;

/// Least mass on an axis (kg): prevents a division by zero.
const LEAST_MASS: f64 = 1e-6;

/// Longest step of the integration (s). A step ends wherever a command takes effect.
pub(super) const LONGEST_STEP: f64 = 1e-3;

/// One function of one instance, with its parameters and the location of its memory.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<F> {
    pub(super) call: F,
    pub(super) p: [f64; MOST_PARAMETERS],
    pub(super) count: usize,
    pub(super) memory: usize,
    pub(super) length: usize,
}

impl<F> Part<F> {
    /// The function of `instance`; its memory starts at `*memory`, which moves on.
    pub(super) fn new(call: F, instance: &Instance, memory: &mut usize) -> Self {
        let mut p = [0.0; MOST_PARAMETERS];
        let count = instance.values.len().min(MOST_PARAMETERS);
        for (to, from) in p.iter_mut().zip(&instance.values) {
            *to = from.value;
        }
        let part = Self { call, p, count, memory: *memory, length: instance.effect.memory };
        *memory += instance.effect.memory;
        part
    }

    /// The same place and parameters with another function.
    pub(super) fn with<G>(self, call: G) -> Part<G> {
        let Self { p, count, memory, length, .. } = self;
        Part { call, p, count, memory, length }
    }

    pub(super) fn p(&self) -> &[f64] {
        &self.p[..self.count]
    }

    pub(super) fn memory<'a>(&self, memory: &'a mut [f64]) -> &'a mut [f64] {
        &mut memory[self.memory..self.memory + self.length]
    }

    fn memory_in<'a>(&self, memory: &'a [f64]) -> &'a [f64] {
        &memory[self.memory..self.memory + self.length]
    }
}

type CommandPart = Part<Law<fn(&[f64], &mut [f64], f64, f64) -> f64>>;
type MotionPart = Part<Law<fn(&[f64], &mut [f64], &Motion) -> f64>>;
type MassPart = Part<fn(&[f64], &Motion) -> f64>;
type EncoderPart = Part<Law<fn(&[f64], f64, f64) -> f64>>;

/// Distance over which the slope of an encoder's reading is computed (m).
const SLOPE: f64 = 1e-6;

/// Functions that act on one motor (belt coordinate).
#[derive(Debug, Clone, Default)]
struct MotorParts {
    /// Turns of the motor per metre of belt.
    turns_per_metre: f64,
    delay: f64,
    commands: Vec<CommandPart>,
    /// Largest rate of the setpoint (m/s^2 of belt), if there is one.
    slew_limit: Option<f64>,
    gains: LoopGains,
    efforts: Vec<MotionPart>,
    /// Demands (N of belt) above each of which the loop stops integrating.
    windups: Vec<f64>,
    /// Viscous friction (N s/m).
    damping: f64,
    forces: Vec<MotionPart>,
    waves: Vec<Wave>,
    rubs: Rubs,
    encoders: Vec<EncoderPart>,
    spring: Option<Spring>,
}

/// Functions that act on one axis of the carriage.
#[derive(Debug, Clone, Default)]
struct RailParts {
    /// Mass that is the same everywhere (kg).
    constant_mass: f64,
    masses: Vec<MassPart>,
    /// Viscous friction (N s/m).
    damping: f64,
    forces: Vec<MotionPart>,
    rubs: Rubs,
}

/// Friction on one motor or guide.
#[derive(Debug, Clone, Default)]
struct Rubs {
    /// Level that is the same in every motion (N).
    constant: f64,
    levels: Vec<MotionPart>,
    /// The last bristles of several, and the index of their bend in the memory.
    bristles: Option<(Bristles, usize)>,
}

/// The drives and the gantry of a twin, ready to step.
#[derive(Debug, Clone)]
pub struct Plant {
    motors: Vec<MotorParts>,
    rails: Vec<RailParts>,
    /// Ties between motors and load; `None` if both belts are rigid.
    ties: Option<[Tie; 2]>,
    /// Striker whose force acts on the carriage; the last of several.
    striker: Option<Part<Striker>>,
    striker_mass: f64,
    /// Scales the gains of the loops: mass on one belt for which they are stated (kg).
    gain_mass: f64,
    memory: usize,
    /// True if a ripple follows the position of a rotor.
    follows_phase: bool,
}

/// Everything that changes while a plant steps. Axes are x, y; motors a, b.
#[derive(Debug, Clone, Default)]
pub struct PlantState {
    /// Time since the start (s).
    pub time: f64,
    /// Position of the carriage, by the motors (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Its acceleration over the last step (m/s^2).
    pub acceleration: [f64; 2],
    /// Force of each motor over the last step (N of belt).
    pub force: [f64; 2],
    setpoint: [f64; 2],
    integral: [f64; 2],
    /// Lag of each filter of the drives' estimators (m/s of belt).
    first_lag: [f64; 2],
    second_lag: [f64; 2],
    /// Friction over the last step: on each guide (N), and at each motor (N of belt).
    friction: [f64; 2],
    rubbed: [f64; 2],
    /// Displacement of the load ahead of the motors with soft belts (m), and its velocity less
    /// theirs (m/s).
    ahead: [f64; 2],
    gaining: [f64; 2],
    memory: Vec<f64>,
}

impl PlantState {
    /// Set the carriage to `position` (m) with `velocity` (m/s), as if it had moved so for long.
    pub fn place(&mut self, position: [f64; 2], velocity: [f64; 2]) {
        self.position = position;
        self.velocity = velocity;
        self.acceleration = [0.0; 2];
        (self.ahead, self.gaining) = ([0.0; 2], [0.0; 2]);
        (self.first_lag, self.second_lag) = ([0.0; 2], [0.0; 2]);
    }

    /// Every value of the state, always in the same order: to save and to restore it.
    pub fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Self { position, velocity, acceleration, force, setpoint, integral, friction, .. } =
            self;
        let pairs = [position, velocity, acceleration, force, setpoint, integral, friction];
        let pairs = pairs.into_iter().chain([&mut self.rubbed, &mut self.ahead, &mut self.gaining]);
        let pairs = pairs.chain([&mut self.first_lag, &mut self.second_lag]);
        pairs.flatten().chain(&mut self.memory).chain([&mut self.time])
    }

    /// Set decayed values to zero before they become denormal numbers, which are a hundred times
    /// slower. Call it between two steps.
    pub fn flush(&mut self) {
        for value in self.numbers() {
            if value.abs() < f64::from(f32::MIN_POSITIVE) {
                *value = 0.0;
            }
        }
    }
}

impl Plant {
    /// The plant of the instances in `twin` that act on drives and gantry.
    #[must_use]
    pub fn new(twin: &Twin) -> Self {
        let count = twin.machine.motors();
        let mut plant = Self {
            motors: vec![
                MotorParts {
                    turns_per_metre: twin.belt_metres_per_turn.recip(),
                    ..MotorParts::default()
                };
                count
            ],
            rails: vec![RailParts::default(); count],
            ties: None,
            striker: None,
            striker_mass: twin.striker_mass,
            gain_mass: 0.0,
            memory: 0,
            follows_phase: twin
                .instances
                .iter()
                .any(|own| own.effect.regressors.contains(&Regressor::Phase)),
        };
        for instance in &twin.instances {
            for index in (0..count).filter(|index| instance.axis.covers(*index)) {
                for equation in instance.effect.physics.equations() {
                    plant.add(instance, *equation, index);
                }
            }
        }
        if let ([a, b], [x, y]) = (&plant.motors[..], &plant.rails[..]) {
            let mass = [x, y].map(|rail| rail.mass(&Motion::default()));
            plant.ties = transmission::ties([a.spring, b.spring], mass);
        }
        let mass = twin.controller_reference_mass.unwrap_or_else(|| plant.mean_mass());
        plant.gain_mass = 0.5 * mass;
        plant
    }

    /// Return whether an effect depends on the position of a rotor to a fraction of its turn.
    #[must_use]
    pub fn follows_phase(&self) -> bool {
        self.follows_phase
    }

    /// Mean moving mass of the axes at the origin (kg).
    #[must_use]
    pub fn mean_mass(&self) -> f64 {
        let masses = self.rails.iter().map(|rail| rail.mass(&Motion::default()));
        masses.sum::<f64>() / self.rails.len().max(1) as f64
    }

    fn add(&mut self, instance: &Instance, equation: Physics, index: usize) {
        let memory = &mut self.memory;
        let motor = &mut self.motors[index];
        let rail = &mut self.rails[index];
        let at_motor = instance.axis.is_motor();
        match equation {
            Physics::CommandDelay(call) => motor.delay += call(&instance.numbers()),
            Physics::Command(call) => {
                motor.commands.push(Part::new(Law::Function(call), instance, memory))
            }
            Physics::Ramp(call) => {
                let limit = call(&instance.numbers());
                motor.slew_limit = Some(motor.slew_limit.map_or(limit, |own| own.min(limit)));
            }
            Physics::VelocityLoop(call) => motor.gains = call(&instance.numbers()),
            Physics::Effort(call) => {
                motor.efforts.push(Part::new(Law::Function(call), instance, memory))
            }
            Physics::Windup(call) => motor.windups.push(call(&instance.numbers())),
            Physics::Force(call) if at_motor => {
                motor.forces.push(Part::new(Law::Function(call), instance, memory));
            }
            Physics::Force(call) => {
                rail.forces.push(Part::new(Law::Function(call), instance, memory))
            }
            Physics::Wave(call) => {
                motor.waves.push(call(&instance.numbers(), motor.turns_per_metre));
            }
            Physics::Damping(call) => {
                let damping = if at_motor { &mut motor.damping } else { &mut rail.damping };
                *damping += call(&instance.numbers());
            }
            Physics::Coulomb(call) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                rubs.constant += call(&instance.numbers());
            }
            Physics::Friction(call) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                rubs.levels.push(Part::new(Law::Function(call), instance, memory));
            }
            Physics::Bristles(call) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                let part = Part::new(call, instance, memory);
                rubs.bristles = Some((call(part.p()), part.memory));
            }
            // A transmission between a guide and its load does not act on the motors.
            Physics::Transmission(call) if at_motor => {
                let springs = [motor.spring, call(&instance.numbers())];
                motor.spring = springs.into_iter().flatten().reduce(Spring::in_series);
            }
            Physics::Encoder(call) => {
                motor.encoders.push(Part::new(Law::Function(call), instance, memory))
            }
            Physics::Mass(call) => rail.constant_mass += call(&instance.numbers()),
            Physics::Inertia(call) => rail.masses.push(Part::new(call, instance, memory)),
            // On both axes at once.
            Physics::Reaction(call) if index == 0 => {
                self.striker = Some(Part::new(call(&instance.numbers()), instance, memory));
            }
            Physics::Expression(place, own) => self.add_expression(instance, (place, own), index),
            _ => {}
        }
    }

    /// Add the expression of a user at its point of action.
    fn add_expression(
        &mut self,
        instance: &Instance,
        (place, own): (Place, &'static Expression),
        index: usize,
    ) {
        let memory = &mut self.memory;
        let motor = &mut self.motors[index];
        let rail = &mut self.rails[index];
        let at_motor = instance.axis.is_motor();
        match (place, at_motor) {
            (Place::Force, true) => {
                motor.forces.push(Part::new(Law::Expression(own), instance, memory));
            }
            (Place::Force, false) => {
                rail.forces.push(Part::new(Law::Expression(own), instance, memory));
            }
            (Place::Friction, _) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                rubs.levels.push(Part::new(Law::Level(own), instance, memory));
            }
            (Place::Input, _) => {
                motor.commands.push(Part::new(Law::Expression(own), instance, memory));
            }
            (Place::Output, _) => {
                motor.encoders.push(Part::new(Law::Expression(own), instance, memory));
            }
        }
    }

    /// Dead time of each motor's command (s).
    #[must_use]
    pub fn delays(&self) -> [f64; 2] {
        both(|index| self.motors.get(index).map_or(0.0, |motor| motor.delay))
    }

    /// Delay of the torque that each drive reports (s).
    #[must_use]
    pub fn torque_ages(&self) -> [f64; 2] {
        both(|index| self.motors.get(index).map_or(0.0, |motor| motor.gains.torque_report_delay_s))
    }

    /// A state at rest at the origin.
    #[must_use]
    pub fn start(&self) -> PlantState {
        PlantState { memory: self.memory(), ..PlantState::default() }
    }

    /// The memory of all effects after a long rest.
    #[must_use]
    pub(super) fn memory(&self) -> Vec<f64> {
        vec![0.0; self.memory]
    }

    /// Set `state` to rest at `position` (m), as [`start`](Self::start) does, without allocating.
    pub fn restart(&self, state: &mut PlantState, position: [f64; 2]) {
        let mut memory = std::mem::take(&mut state.memory);
        memory.resize(self.memory, 0.0);
        memory.fill(0.0);
        *state = PlantState { position, memory, ..PlantState::default() };
    }

    /// Position of a `motor` (m of belt) as its encoder reports it, with the carriage at `position` (m).
    #[must_use]
    pub fn reported_position(&self, motor: usize, position: [f64; 2]) -> f64 {
        let own = belts(position)[motor];
        self.motors
            .get(motor)
            .map_or(own, |motor| motor.encoders.iter().fold(own, |at, part| motor.read(part, at)))
    }

    /// Velocity of a `motor` (m/s of belt) as its drive estimates and reports it, with the carriage at a position (m) and
    /// with a velocity (m/s); `lag[filter][motor]` are those of the estimators (m/s of belt).
    #[must_use]
    pub(super) fn reported_velocity(
        &self,
        motor: usize,
        [position, velocity]: [[f64; 2]; 2],
        lag: [[f64; 2]; 2],
    ) -> f64 {
        let (position, velocity) = (belts(position)[motor], belts(velocity)[motor]);
        let seen = self.motors.get(motor).map_or(velocity, |own| own.reported(position, velocity));
        seen - lag[0][motor] - lag[1][motor]
    }

    /// Rate of that velocity (m/s^2 of belt).
    #[must_use]
    pub(super) fn reported_rate(&self, motor: usize, lag: [[f64; 2]; 2]) -> f64 {
        let time = self.motors.get(motor).map_or(0.0, |own| own.gains.estimator_time_constant_s);
        estimator::rate(time, lag[1][motor])
    }

    /// Belts before they move.
    pub(super) fn belts(&self) -> [Motion; 2] {
        both(|index| {
            let turns_per_metre = self.motors.get(index).map_or(0.0, |own| own.turns_per_metre);
            Motion { turns_per_metre, ..Motion::default() }
        })
    }

    /// Return whether a belt is soft. Plants with soft belts and plants without do not step side by
    /// side.
    #[must_use]
    pub(super) fn is_soft(&self) -> bool {
        self.ties.is_some()
    }

    /// One step of a table of `dt` seconds with each motor's `command` (m/s of belt), at most 1 ms for
    /// the accuracy that the tests state.
    pub fn step(&self, state: &mut PlantState, command: [f64; 2], dt: f64) {
        let plants = [self];
        let lanes = PlantLanes::new(Scalar, &plants);
        let mut all = StateLanes::new(Scalar);
        let mut memory = std::mem::take(&mut state.memory);
        all.put(0, state);
        all.put_remembered(0, self, &memory);
        let command = command.map(|own| Lanes::splat(Scalar, own));
        let mut aside = Aside {
            memories: std::slice::from_mut(&mut memory),
            rails: &mut [[Motion::default(); 2]],
            belts: &mut [self.belts()],
        };
        lanes.step(&mut all, &mut aside, command, Lanes::splat(Scalar, dt));
        all.get(0, state);
        all.get_remembered(0, self, &mut memory);
        state.memory = memory;
    }
}

impl Rubs {
    /// The bend in the `memory` of a plant; 0 without bristles.
    fn bend(&self, memory: &[f64]) -> f64 {
        self.bristles.map_or(0.0, |(_, place)| memory[place])
    }
}

impl RailParts {
    /// Return whether any function depends on the motion along the axis.
    fn has_functions(&self) -> bool {
        !(self.masses.is_empty() && self.forces.is_empty() && self.rubs.levels.is_empty())
    }

    fn mass(&self, motion: &Motion) -> f64 {
        let others = self.masses.iter().map(|part| (part.call)(part.p(), motion));
        (self.constant_mass + others.sum::<f64>()).max(LEAST_MASS)
    }
}

impl MotorParts {
    /// Return whether any function depends on the motion of the belt.
    fn has_functions(&self) -> bool {
        !(self.efforts.is_empty() && self.forces.is_empty() && self.rubs.levels.is_empty())
    }

    /// Command after all effects on it but the slew limit.
    fn taken_in(&self, command: f64, memory: &mut [f64], dt: f64) -> f64 {
        self.commands
            .iter()
            .fold(command, |value, part| part.call.at(part.p(), part.memory(memory), value, dt))
    }

    /// Reading of the `encoder` at a `position` (m of belt).
    fn read(&self, encoder: &EncoderPart, position: f64) -> f64 {
        encoder.call.at(encoder.p(), position, self.turns_per_metre)
    }

    /// Velocity that the encoder reports for a `velocity` (m/s of belt) at `position` (m of belt).
    fn reported(&self, mut position: f64, mut velocity: f64) -> f64 {
        for part in &self.encoders {
            let read = |at: f64| self.read(part, at);
            velocity *= (read(position + SLOPE) - read(position - SLOPE)) / (2.0 * SLOPE);
            position = read(position);
        }
        velocity
    }

    /// Increment of the loop's integral for the `gained` force at this `demand` (N of belt); zero
    /// if it would raise a demand beyond a limit.
    fn taken(&self, gained: f64, demand: f64) -> f64 {
        let is_full = |most: &f64| *most < demand.abs() && 0.0 < demand * gained;
        if self.windups.iter().any(is_full) { 0.0 } else { gained }
    }
}

/// Return whether a plant calls the physics of an effect, on any axis.
pub(super) fn calls(physics: &Physics) -> bool {
    let is_called = |equation: &Physics| {
        matches!(
            equation,
            Physics::CommandDelay(_)
                | Physics::Command(_)
                | Physics::Ramp(_)
                | Physics::VelocityLoop(_)
                | Physics::Effort(_)
                | Physics::Windup(_)
                | Physics::Force(_)
                | Physics::Wave(_)
                | Physics::Friction(_)
                | Physics::Coulomb(_)
                | Physics::Damping(_)
                | Physics::Bristles(_)
                | Physics::Mass(_)
                | Physics::Inertia(_)
                | Physics::Encoder(_)
                | Physics::Transmission(_)
                | Physics::Expression(..)
        )
    };
    physics.equations().iter().any(is_called)
}

/// Return whether a plant responds to physics of this kind on `axis`. It does not respond to a
/// transmission between a guide and its load.
pub(super) fn feels(physics: &Physics, axis: Axis) -> bool {
    let is_between = |equation: &Physics| matches!(equation, Physics::Transmission(_));
    calls(physics) && (axis.is_motor() || !physics.equations().iter().any(is_between))
}
