//! Drives and gantry in free-running time: the equations that all instances of a twin make together.
//!
//! Per motor, in metres of belt: command -> effects on the command -> ramp -> velocity loop -> effects
//! on the force; the loop sees the velocity that its encoder reports. Per rail: sum of both belts'
//! forces, forces and friction of all instances, moving mass. The step is semi-implicit: the loop's
//! force is taken at the middle of the step, with the velocity that it will have there to first order,
//! and friction is the impulse that would stop the motion, held within its level (Coulomb's law without
//! chatter, as in the simulators of BAM); what of it bends before it slides is solved with the step
//! ([`contact`](super::contact)).
//!
//! A single axis is a plant with one motor and one rail, which are the same coordinate.

use super::{
    Instance, Twin,
    contact::Contact,
    transmission::{self, Answer, Rubbing, Tie, TwoMasses},
};
use crate::{
    effects::{Axis, Bristles, Carriage, CrossMotion, LoopGains, Motion, Physics, Spring, both},
    gantry::{belts, rails},
};

/// Most parameters that one effect has.
const MOST_PARAMETERS: usize = 8;

/// Longest step of the integration (s). A step ends wherever a command takes effect.
pub(super) const LONGEST_STEP: f64 = 1e-3;

/// One function of one instance, with its numbers and the place of its memory.
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

    pub(super) fn p(&self) -> &[f64] {
        &self.p[..self.count]
    }

    pub(super) fn memory<'a>(&self, memory: &'a mut [f64]) -> &'a mut [f64] {
        &mut memory[self.memory..self.memory + self.length]
    }
}

type CommandPart = Part<fn(&[f64], &mut [f64], f64, f64) -> f64>;
type MotionPart = Part<fn(&[f64], &mut [f64], &Motion) -> f64>;
type MassPart = Part<fn(&[f64], &Motion) -> f64>;
type ReactionPart = Part<fn(&[f64], &mut [f64], &Carriage) -> [f64; 2]>;
type BristlesPart = Part<fn(&[f64]) -> Bristles>;
type EncoderPart = Part<fn(&[f64], f64) -> f64>;

/// Way over which the slope of an encoder's reading is taken (m).
const SLOPE: f64 = 1e-6;

/// Functions that act on one motor (belt coordinate).
#[derive(Debug, Clone, Default)]
struct MotorParts {
    delay: f64,
    commands: Vec<CommandPart>,
    ramps: Vec<CommandPart>,
    gains: LoopGains,
    efforts: Vec<MotionPart>,
    /// Demands (N of belt) from each of which the loop stops integrating.
    windups: Vec<f64>,
    forces: Vec<MotionPart>,
    rubs: Rubs,
    encoders: Vec<EncoderPart>,
    spring: Option<Spring>,
}

/// Functions that act on one rail.
#[derive(Debug, Clone, Default)]
struct RailParts {
    masses: Vec<MassPart>,
    forces: Vec<MotionPart>,
    rubs: Rubs,
}

/// What rubs on one motor or rail.
#[derive(Debug, Clone, Default)]
struct Rubs {
    levels: Vec<MotionPart>,
    /// Of several the last.
    bristles: Option<BristlesPart>,
}

impl Rubs {
    /// What rubs at `motion`.
    fn contact(&self, memory: &mut [f64], motion: &Motion) -> Contact {
        let bent = |part: &BristlesPart| ((part.call)(part.p()), part.memory);
        Contact {
            level: sum(&self.levels, memory, motion).max(0.0),
            bristles: self.bristles.as_ref().map(bent),
        }
    }
}

/// The drives and the gantry of a twin, ready to step.
#[derive(Debug, Clone)]
pub struct Plant {
    motors: Vec<MotorParts>,
    rails: Vec<RailParts>,
    /// What lies between motors and load, where it is soft.
    ties: Option<[Tie; 2]>,
    /// What the striker does to the carriage.
    reactions: Vec<ReactionPart>,
    striker_mass: f64,
    /// Scales the gains of the loops: mass on one belt for which they are stated (kg).
    gain_mass: f64,
    memory: usize,
}

/// Everything that changes while a plant steps. Rails are x, y; motors a, b.
#[derive(Debug, Clone, Default)]
pub struct PlantState {
    /// Time since the start (s).
    pub time: f64,
    /// Place of the carriage, by the motors (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Its acceleration over the last step (m/s^2).
    pub acceleration: [f64; 2],
    /// Force of each motor over the last step (N of belt).
    pub force: [f64; 2],
    setpoint: [f64; 2],
    integral: [f64; 2],
    /// Friction over the last step: on each rail (N), and at each motor (N of belt).
    friction: [f64; 2],
    rubbed: [f64; 2],
    /// Where belts are soft: how far the load is ahead of the motors (m), and its velocity less theirs (m/s).
    ahead: [f64; 2],
    gaining: [f64; 2],
    memory: Vec<f64>,
}

impl PlantState {
    /// Puts the carriage down at `position` (m) with `velocity` (m/s), as if it had moved so for long.
    pub fn place(&mut self, position: [f64; 2], velocity: [f64; 2]) {
        self.position = position;
        self.velocity = velocity;
        self.acceleration = [0.0; 2];
        (self.ahead, self.gaining) = ([0.0; 2], [0.0; 2]);
    }

    /// Every number of the state, always in the same order: to keep it and to put it back.
    pub fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Self { position, velocity, acceleration, force, setpoint, integral, friction, .. } =
            self;
        let pairs = [position, velocity, acceleration, force, setpoint, integral, friction];
        let pairs = pairs.into_iter().chain([&mut self.rubbed, &mut self.ahead, &mut self.gaining]);
        pairs.flatten().chain(&mut self.memory).chain([&mut self.time])
    }

    /// Sets what has decayed to nothing to zero, before it becomes denormal numbers, which are a hundred times
    /// slower. Between two steps.
    pub fn flush(&mut self) {
        for value in self.numbers() {
            if value.abs() < f64::from(f32::MIN_POSITIVE) {
                *value = 0.0;
            }
        }
    }

    /// Moves the carriage on by `dt`, at the end of which it has `velocity`.
    fn arrive(&mut self, velocity: [f64; 2], dt: f64) {
        self.acceleration = both(|index| (velocity[index] - self.velocity[index]) / dt);
        for (index, position) in self.position.iter_mut().enumerate() {
            *position += 0.5 * dt * (velocity[index] + self.velocity[index]);
        }
        self.velocity = velocity;
    }
}

impl Plant {
    /// The plant of the instances in `twin` that act on drives and gantry.
    #[must_use]
    pub fn new(twin: &Twin) -> Self {
        let count = twin.machine.motors();
        let mut plant = Self {
            motors: vec![MotorParts::default(); count],
            rails: vec![RailParts::default(); count],
            ties: None,
            reactions: Vec::new(),
            striker_mass: twin.striker_mass,
            gain_mass: 0.0,
            memory: 0,
        };
        for instance in &twin.instances {
            for index in (0..count).filter(|index| instance.axis.covers(*index)) {
                for equation in instance.effect.physics.equations() {
                    plant.add(instance, *equation, index);
                }
            }
        }
        if let [a, b] = &plant.motors[..] {
            plant.ties = transmission::ties([a.spring, b.spring]);
        }
        let on_one_belt = if count == 1 { 1.0 } else { 0.5 };
        plant.gain_mass =
            on_one_belt * twin.controller_reference_mass.unwrap_or_else(|| plant.mean_mass());
        plant
    }

    /// Mean moving mass of the rails in the origin (kg).
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
            Physics::Command(call) => motor.commands.push(Part::new(call, instance, memory)),
            Physics::Ramp(call) => motor.ramps.push(Part::new(call, instance, memory)),
            Physics::VelocityLoop(call) => motor.gains = call(&instance.numbers()),
            Physics::Effort(call) => motor.efforts.push(Part::new(call, instance, memory)),
            Physics::Windup(call) => motor.windups.push(call(&instance.numbers())),
            Physics::Force(call) if at_motor => {
                motor.forces.push(Part::new(call, instance, memory));
            }
            Physics::Force(call) => rail.forces.push(Part::new(call, instance, memory)),
            Physics::Friction(call) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                rubs.levels.push(Part::new(call, instance, memory));
            }
            Physics::Bristles(call) => {
                let rubs = if at_motor { &mut motor.rubs } else { &mut rail.rubs };
                rubs.bristles = Some(Part::new(call, instance, memory));
            }
            // What lies between a rail and its load is behind all that the motors feel.
            Physics::Transmission(call) if at_motor => {
                let springs = [motor.spring, call(&instance.numbers())];
                motor.spring = springs.into_iter().flatten().reduce(Spring::in_series);
            }
            Physics::Encoder(call) => motor.encoders.push(Part::new(call, instance, memory)),
            Physics::Inertia(call) => rail.masses.push(Part::new(call, instance, memory)),
            // On both rails at once.
            Physics::Reaction(call) if index == 0 => {
                self.reactions.push(Part::new(call, instance, memory));
            }
            _ => {}
        }
    }

    /// Dead time of each motor's command (s).
    #[must_use]
    pub fn delays(&self) -> [f64; 2] {
        both(|index| self.motors.get(index).map_or(0.0, |motor| motor.delay))
    }

    /// Age of the torque that each drive reports (s).
    #[must_use]
    pub fn torque_ages(&self) -> [f64; 2] {
        both(|index| self.motors.get(index).map_or(0.0, |motor| motor.gains.torque_report_delay_s))
    }

    /// A state at rest in the origin.
    #[must_use]
    pub fn start(&self) -> PlantState {
        PlantState { memory: vec![0.0; self.memory], ..PlantState::default() }
    }

    /// Puts `state` at rest in `position` (m), as [`start`](Self::start) does, without allocating.
    pub fn restart(&self, state: &mut PlantState, position: [f64; 2]) {
        let mut memory = std::mem::take(&mut state.memory);
        memory.resize(self.memory, 0.0);
        memory.fill(0.0);
        *state = PlantState { position, memory, ..PlantState::default() };
    }

    /// Position of each motor (m of belt) as its encoder reports it.
    #[must_use]
    pub fn reported_position(&self, state: &PlantState) -> [f64; 2] {
        let position = belts(state.position);
        both(|index| {
            let encoders = self.motors.get(index).map_or(&[][..], |motor| &motor.encoders);
            encoders.iter().fold(position[index], |at, part| (part.call)(part.p(), at))
        })
    }

    /// Velocity of each motor (m/s of belt) as its encoder reports it.
    #[must_use]
    pub fn reported(&self, state: &PlantState) -> [f64; 2] {
        let (position, velocity) = (belts(state.position), belts(state.velocity));
        let of = |index: usize| match self.motors.get(index) {
            Some(motor) => motor.reported(position[index], velocity[index]),
            None => velocity[index],
        };
        both(of)
    }

    /// One step of `dt` seconds with each motor's `command` (m/s of belt), at most
    /// 1 ms for the accuracy that the tests state.
    pub fn step(&self, state: &mut PlantState, command: [f64; 2], dt: f64) {
        if self.motors.len() == 1 {
            self.step_single(state, command[0], dt);
        } else {
            self.step_gantry(state, command, dt);
        }
        state.time += dt;
    }

    fn step_gantry(&self, state: &mut PlantState, command: [f64; 2], dt: f64) {
        let step = GantryStep::new(self, state, dt);
        let seen = self.reported(state);
        let memory = &mut state.memory;
        // Loads on the rails, with the motors' forces of the step before where one depends on them.
        let load = self.loads(&step, state.force, memory);
        let setpoint = both(|index| self.motors[index].setpoint(command[index], memory, dt));
        let middle =
            both(|index| self.motors[index].middle(state.setpoint[index], setpoint[index]));
        let resisted = both(|index| load[index] + state.friction[index]);
        let answer = step.answer(resisted).rubbed(state.rubbed);
        let asked = both(|index| {
            let now = state.setpoint[index] - seen[index];
            let motor = &self.motors[index];
            let error = middle[index] - seen[index] - motor.ahead(dt) * answer.drag[index];
            motor.asked([now, error], state.integral[index], self.gain_mass, dt)
        });
        let gives_way = both(|index| self.motors[index].gives_way(self.gain_mass, dt));
        let demand = answer.demand(asked, gives_way);
        let force = self.efforts(&step, demand, memory);
        let forces = [self.driven(&step, force, memory), load];
        let rubs = self.rubs(&step, force, memory);
        let slid = match &step.two_masses {
            Some(two) => {
                let moved = two.step(forces, &rubs, memory);
                let velocity = rails(moved.motor);
                state.gaining = both(|index| moved.load[index] - velocity[index]);
                state.ahead = moved.ahead;
                Slid { velocity, friction: moved.friction, rubbed: moved.rubbed }
            }
            None => step.slide(forces, &rubs, state.friction, memory),
        };
        state.arrive(slid.velocity, dt);
        let seen_after = self.reported(state);
        for (index, motor) in self.motors.iter().enumerate() {
            let middle = middle[index] - 0.5 * (seen[index] + seen_after[index]);
            let travelled = motor.travelled(middle, seen_after[index] - seen[index], dt);
            let gained = self.gain_mass * motor.gains.integral_per_s2 * travelled;
            state.integral[index] += motor.taken(gained, demand[index]);
        }
        (state.friction, state.rubbed) = (slid.friction, slid.rubbed);
        (state.force, state.setpoint) = (force, setpoint);
    }

    /// The motors' `force` with what else pulls at them (N of belt).
    fn driven(&self, step: &GantryStep, force: [f64; 2], memory: &mut [f64]) -> [f64; 2] {
        both(|index| {
            force[index] + sum(&self.motors[index].forces, memory, &step.belt(index, force))
        })
    }

    /// What rubs on motors and rails under the motors' `force`.
    fn rubs(&self, step: &GantryStep, force: [f64; 2], memory: &mut [f64]) -> Rubbing {
        Rubbing {
            motors: both(|index| self.motors[index].rubs.contact(memory, &step.belt(index, force))),
            rails: both(|index| self.rails[index].rubs.contact(memory, &step.rail(index, force))),
        }
    }

    /// Force on each rail that is no motor's and no friction.
    fn loads(&self, step: &GantryStep, force: [f64; 2], memory: &mut [f64]) -> [f64; 2] {
        let load = both(|index| {
            let motion = step.rail(index, force);
            sum(&self.rails[index].forces, memory, &motion)
        });
        self.reactions.iter().fold(load, |load, part| {
            let held =
                (part.call)(part.p(), part.memory(memory), &step.carriage(self.striker_mass));
            both(|index| load[index] + held[index])
        })
    }

    /// Force that each motor makes of what its loop demands.
    fn efforts(&self, step: &GantryStep, demand: [f64; 2], memory: &mut [f64]) -> [f64; 2] {
        both(|index| {
            let mut motion = step.belt(index, demand);
            for part in &self.motors[index].efforts {
                motion.force = (part.call)(part.p(), part.memory(memory), &motion);
            }
            motion.force
        })
    }

    fn step_single(&self, state: &mut PlantState, command: f64, dt: f64) {
        let (motor, rail) = (&self.motors[0], &self.rails[0]);
        let memory = &mut state.memory;
        let mut motion = Motion {
            index: 0,
            time: state.time,
            dt,
            position: state.position[0],
            velocity: state.velocity[0],
            acceleration: state.acceleration[0],
            force: state.force[0],
            mass: 0.0,
            other: CrossMotion::default(),
        };
        let mass = rail.mass(&motion);
        motion.mass = mass;
        let load = sum(&rail.forces, memory, &motion) + sum(&motor.forces, memory, &motion);
        let setpoint = motor.setpoint(command, memory, dt);
        let middle = motor.middle(state.setpoint[0], setpoint);
        let drag = (load + state.friction[0]) / mass;
        let now = state.setpoint[0] - state.velocity[0];
        let error = middle - state.velocity[0] - motor.ahead(dt) * drag;
        let asked = motor.asked([now, error], state.integral[0], self.gain_mass, dt);
        let demand = asked / (1.0 + motor.gives_way(self.gain_mass, dt) / mass);
        motion.force = demand;
        for part in &motor.efforts {
            motion.force = (part.call)(part.p(), part.memory(memory), &motion);
        }
        // Motor and rail are one coordinate; what bends on one of them bends for both.
        let [on_rail, on_motor] =
            [&rail.rubs, &motor.rubs].map(|rubs| rubs.contact(memory, &motion));
        let contact = Contact {
            level: on_rail.level + on_motor.level,
            bristles: on_rail.bristles.or(on_motor.bristles),
        };
        let (velocity, friction) = slide(&motion, motion.force + load, contact, memory);
        let error = middle - 0.5 * (state.velocity[0] + velocity);
        let travelled = motor.travelled(error, velocity - state.velocity[0], dt);
        let gained = self.gain_mass * motor.gains.integral_per_s2 * travelled;
        state.integral[0] += motor.taken(gained, demand);
        state.acceleration[0] = (velocity - state.velocity[0]) / dt;
        state.position[0] += 0.5 * dt * (velocity + state.velocity[0]);
        state.velocity[0] = velocity;
        state.friction[0] = friction;
        state.force[0] = motion.force;
        state.setpoint[0] = setpoint;
    }
}

/// How often friction on motors and rails is sought in turn, and the change of it from which on it is found (N).
const MOST_SWEEPS: usize = 6;
const FOUND: f64 = 1e-6;

/// The carriage after a step.
struct Slid {
    /// Velocity of the rails (m/s).
    velocity: [f64; 2],
    /// Friction over the step: on each rail (N), and at each motor (N of belt).
    friction: [f64; 2],
    rubbed: [f64; 2],
}

/// How two coordinates, both rails or both belts, move at the start of a step.
struct Frame {
    time: f64,
    dt: f64,
    position: [f64; 2],
    velocity: [f64; 2],
    acceleration: [f64; 2],
}

impl Frame {
    /// Motion of one coordinate with the `force` along both and the `mass` of its own.
    fn motion(&self, index: usize, force: [f64; 2], mass: f64) -> Motion {
        Motion {
            index,
            time: self.time,
            dt: self.dt,
            position: self.position[index],
            velocity: self.velocity[index],
            acceleration: self.acceleration[index],
            force: force[index],
            mass,
            other: CrossMotion {
                position: self.position[1 - index],
                velocity: self.velocity[1 - index],
                acceleration: self.acceleration[1 - index],
                force: force[1 - index],
            },
        }
    }
}

/// What a gantry is and does at the start of a step.
struct GantryStep {
    rails: Frame,
    belts: Frame,
    /// Mass on each rail (kg); without rotors where belts are soft.
    mass: [f64; 2],
    /// Mass that the force of each belt moves (kg).
    belt_mass: [f64; 2],
    /// Motors and load, where belts are soft.
    two_masses: Option<TwoMasses>,
}

impl GantryStep {
    fn new(plant: &Plant, state: &PlantState, dt: f64) -> Self {
        let PlantState { time, position, velocity, acceleration, ahead, gaining, .. } = *state;
        let mut rails = Frame { time, dt, position, velocity, acceleration };
        let belts = Frame {
            time,
            dt,
            position: belts(position),
            velocity: belts(velocity),
            acceleration: belts(acceleration),
        };
        let mass = both(|index| plant.rails[index].mass(&rails.motion(index, [0.0; 2], 0.0)));
        let Some(ties) = &plant.ties else {
            let belt_mass = [rigid_belt_mass(mass); 2];
            return Self { rails, belts, mass, belt_mass, two_masses: None };
        };
        rails.position = both(|index| position[index] + ahead[index]);
        rails.velocity = both(|index| velocity[index] + gaining[index]);
        let (ties, load_mass) = transmission::parted(ties, mass);
        let two =
            TwoMasses { ties, load_mass, ahead, motor: belts.velocity, load: rails.velocity, dt };
        let belt_mass = ties.map(|tie| match tie.spring {
            Some(_) => tie.motor_mass,
            None => tie.motor_mass + rigid_belt_mass(load_mass),
        });
        Self { rails, belts, mass: load_mass, belt_mass, two_masses: Some(two) }
    }

    /// How the motors answer to forces over the step, with `load` on the rails (N).
    fn answer(&self, load: [f64; 2]) -> Answer {
        if let Some(two) = &self.two_masses {
            return two.answer(load);
        }
        let [along_x, along_y] = self.mass.map(|mass| 1.0 / mass);
        let (own, other) = (along_x + along_y, along_x - along_y);
        let drag = belts(both(|index| load[index] / self.mass[index]));
        Answer { drag, gives: [[own, other], [other, own]] }
    }

    /// Motion of one rail under the motors' `force`.
    fn rail(&self, index: usize, force: [f64; 2]) -> Motion {
        self.rails.motion(index, belts(force), self.mass[index])
    }

    /// The carriage with a striker of `striker_mass` (kg).
    fn carriage(&self, striker_mass: f64) -> Carriage {
        let Frame { dt, position, velocity, acceleration, .. } = self.rails;
        Carriage { dt, position, velocity, acceleration, striker_mass }
    }

    /// Motion of one belt under the motors' `force`.
    fn belt(&self, index: usize, force: [f64; 2]) -> Motion {
        self.belts.motion(index, force, self.belt_mass[index])
    }

    /// Velocity of the rails after the step under the `total` force on them, without friction.
    fn free(&self, total: [f64; 2]) -> [f64; 2] {
        let Frame { velocity, dt, .. } = self.rails;
        both(|index| velocity[index] + dt * total[index] / self.mass[index])
    }

    /// The step of rigid belts under `forces` of the motors (N of belt) and on the rails (N), with what `rubs`, whose
    /// bends are in `memory`. What is held on one coordinate need not be held on another: the frictions are sought in
    /// turn (projected Gauss-Seidel), from the `friction` of the rails a step ago.
    fn slide(
        &self,
        [driven, load]: [[f64; 2]; 2],
        rubs: &Rubbing,
        mut friction: [f64; 2],
        memory: &mut [f64],
    ) -> Slid {
        let (dt, bends) = (self.rails.dt, rubs.bends(memory));
        let mut rubbed = [0.0; 2];
        for sweep in 1.. {
            for (m, contact) in rubs.motors.iter().enumerate().filter(|(_, own)| 0.0 < own.level) {
                let pull =
                    both(|other| driven[other] + if other == m { 0.0 } else { rubbed[other] });
                let free = self.free(total(pull, both(|rail| load[rail] + friction[rail])));
                let velocity = [self.belts.velocity[m], belts(free)[m]];
                rubbed[m] = contact.force(memory, self.belt_mass[m], velocity, dt);
            }
            let free = self.free(total(both(|m| driven[m] + rubbed[m]), load));
            let before = friction;
            friction = both(|rail| {
                let velocity = [self.rails.velocity[rail], free[rail]];
                rubs.rails[rail].force(memory, self.mass[rail], velocity, dt)
            });
            let is_found = (0..2).all(|rail| (friction[rail] - before[rail]).abs() < FOUND);
            if is_found || sweep == MOST_SWEEPS || rubbed == [0.0; 2] {
                let velocity = both(|rail| free[rail] + dt * friction[rail] / self.mass[rail]);
                return Slid { velocity, friction, rubbed };
            }
            rubs.put_back(memory, bends);
        }
        unreachable!("the last sweep returns")
    }
}

/// Mass that the force of one belt moves with this `mass` on the rails (kg).
fn rigid_belt_mass(mass: [f64; 2]) -> f64 {
    1.0 / (1.0 / mass[0] + 1.0 / mass[1])
}

/// Force on the rails of the belts' `pull` and the rails' `load`.
fn total(pull: [f64; 2], load: [f64; 2]) -> [f64; 2] {
    let along = belts(pull);
    [along[0] + load[0], along[1] + load[1]]
}

/// Velocity after a step from `motion` under `force` and the friction of `contact`, and the friction force.
fn slide(motion: &Motion, force: f64, contact: Contact, memory: &mut [f64]) -> (f64, f64) {
    let Motion { velocity, mass, dt, .. } = *motion;
    let free = velocity + dt * force / mass;
    let friction = contact.force(memory, mass, [velocity, free], dt);
    (free + dt * friction / mass, friction)
}

fn sum(parts: &[MotionPart], memory: &mut [f64], motion: &Motion) -> f64 {
    parts.iter().map(|part| (part.call)(part.p(), part.memory(memory), motion)).sum()
}

impl RailParts {
    fn mass(&self, motion: &Motion) -> f64 {
        self.masses.iter().map(|part| (part.call)(part.p(), motion)).sum::<f64>().max(1e-6)
    }
}

impl MotorParts {
    fn setpoint(&self, command: f64, memory: &mut [f64], dt: f64) -> f64 {
        let taken_in = self
            .commands
            .iter()
            .fold(command, |value, part| (part.call)(part.p(), part.memory(memory), value, dt));
        self.ramps
            .iter()
            .fold(taken_in, |value, part| (part.call)(part.p(), part.memory(memory), value, dt))
    }

    /// What the encoder makes of a `velocity` (m/s of belt) at `position` (m of belt).
    fn reported(&self, mut position: f64, mut velocity: f64) -> f64 {
        for part in &self.encoders {
            let read = |at: f64| (part.call)(part.p(), at);
            velocity *= (read(position + SLOPE) - read(position - SLOPE)) / (2.0 * SLOPE);
            position = read(position);
        }
        velocity
    }

    /// Setpoint in the middle of a step: a ramp is half-way, a jump has happened at its start.
    fn middle(&self, before: f64, after: f64) -> f64 {
        if self.ramps.is_empty() { after } else { 0.5 * (before + after) }
    }

    /// From the start of a step to when the velocity was measured that the loop acts on in its middle (s).
    fn ahead(&self, dt: f64) -> f64 {
        0.5 * dt - self.gains.feedback_delay_s
    }

    /// Travelled error (m) of a step with this `error` in its middle, in which the velocity `changed` (m/s).
    fn travelled(&self, error: f64, changed: f64, dt: f64) -> f64 {
        error * dt + self.gains.feedback_delay_s * changed
    }

    /// What the loop adds to its integral of the `gained` force while it makes this `demand` (N of belt).
    fn taken(&self, gained: f64, demand: f64) -> f64 {
        let is_full = |most: &f64| *most < demand.abs() && 0.0 < demand * gained;
        if self.windups.iter().any(is_full) { 0.0 } else { gained }
    }

    /// Force at the middle of the step (N of belt), as if the loops' own forces moved nothing until then: of the
    /// velocity errors at its start, and then. Its gains are for `mass` (kg).
    fn asked(&self, error: [f64; 2], integral: f64, mass: f64, dt: f64) -> f64 {
        let halfway = integral + 0.5 * dt * mass * self.gains.integral_per_s2 * error[0];
        mass * self.gains.proportional_per_s * error[1] + halfway
    }

    /// What that force falls by where the belt accelerates (N s^2/m).
    fn gives_way(&self, mass: f64, dt: f64) -> f64 {
        self.ahead(dt) * mass * self.gains.proportional_per_s
    }
}

/// Whether a plant calls the physics of an effect, whatever it is on.
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
                | Physics::Friction(_)
                | Physics::Bristles(_)
                | Physics::Inertia(_)
                | Physics::Encoder(_)
                | Physics::Transmission(_)
        )
    };
    physics.equations().iter().any(is_called)
}

/// Whether a plant feels physics of this kind on `axis`: what a rail's load has for itself it does not.
pub(super) fn feels(physics: &Physics, axis: Axis) -> bool {
    let is_between = |equation: &Physics| matches!(equation, Physics::Transmission(_));
    calls(physics) && (axis.is_motor() || !physics.equations().iter().any(is_between))
}
