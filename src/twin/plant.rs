//! Drives and gantry in free-running time: the equations that all instances of a twin make together.
//!
//! Per motor, in metres of belt: command -> effects on the command -> ramp -> velocity loop -> effects
//! on the force. Per rail: sum of both belts' forces, forces and friction of all instances, moving
//! mass. The step is semi-implicit: the loop's force is taken at the middle of the step, with the
//! velocity that it will have there to first order, and friction is the impulse that would stop the
//! motion, held within its level (Coulomb's law without chatter, as in the simulators of BAM).
//!
//! A single axis is a plant with one motor and one rail, which are the same coordinate.

use super::{Instance, Twin};
use crate::effects::{CrossMotion, LoopGains, Motion, Physics};

/// Most parameters that one effect has.
const MOST_PARAMETERS: usize = 8;

/// Longest step of the integration (s). A step ends wherever a command takes effect.
pub const LONGEST_STEP: f64 = 1e-3;

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

/// Functions that act on one motor (belt coordinate).
#[derive(Debug, Clone, Default)]
struct MotorParts {
    delay: f64,
    commands: Vec<CommandPart>,
    ramps: Vec<CommandPart>,
    gains: LoopGains,
    efforts: Vec<MotionPart>,
    forces: Vec<MotionPart>,
    frictions: Vec<MotionPart>,
}

/// Functions that act on one rail.
#[derive(Debug, Clone, Default)]
struct RailParts {
    masses: Vec<MassPart>,
    forces: Vec<MotionPart>,
    frictions: Vec<MotionPart>,
}

/// The drives and the gantry of a twin, ready to step.
#[derive(Debug, Clone)]
pub struct Plant {
    motors: Vec<MotorParts>,
    rails: Vec<RailParts>,
    memory: usize,
}

/// Everything that changes while a plant steps. Rails are x, y; motors a, b.
#[derive(Debug, Clone, Default)]
pub struct PlantState {
    /// Time since the start (s).
    pub time: f64,
    /// Place of the carriage (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Its acceleration over the last step (m/s^2).
    pub acceleration: [f64; 2],
    /// Force of each motor over the last step (N of belt).
    pub force: [f64; 2],
    setpoint: [f64; 2],
    integral: [f64; 2],
    friction: [f64; 2],
    memory: Vec<f64>,
}

impl PlantState {
    /// Puts the carriage down at `position` (m) with `velocity` (m/s), as if it had moved so for long.
    pub fn place(&mut self, position: [f64; 2], velocity: [f64; 2]) {
        self.position = position;
        self.velocity = velocity;
        self.acceleration = [0.0; 2];
    }
}

/// Belt coordinates of a rail vector: a = x + y, b = x - y.
#[must_use]
pub fn belts(rail: [f64; 2]) -> [f64; 2] {
    [rail[0] + rail[1], rail[0] - rail[1]]
}

/// Rail coordinates of a belt vector.
#[must_use]
pub fn rails(belt: [f64; 2]) -> [f64; 2] {
    [0.5 * (belt[0] + belt[1]), 0.5 * (belt[0] - belt[1])]
}

impl Plant {
    /// The plant of the instances in `twin` that act on drives and gantry.
    #[must_use]
    pub fn new(twin: &Twin) -> Self {
        let count = twin.machine.motors();
        let mut plant = Self {
            motors: vec![MotorParts::default(); count],
            rails: vec![RailParts::default(); count],
            memory: 0,
        };
        for instance in &twin.instances {
            for index in (0..count).filter(|index| instance.axis.covers(*index)) {
                plant.add(instance, index);
            }
        }
        plant
    }

    fn add(&mut self, instance: &Instance, index: usize) {
        let memory = &mut self.memory;
        let motor = &mut self.motors[index];
        let rail = &mut self.rails[index];
        let at_motor = instance.axis.is_motor();
        match instance.effect.physics {
            Physics::CommandDelay(call) => motor.delay += call(&instance.numbers()),
            Physics::Command(call) => motor.commands.push(Part::new(call, instance, memory)),
            Physics::Ramp(call) => motor.ramps.push(Part::new(call, instance, memory)),
            Physics::VelocityLoop(call) => motor.gains = call(&instance.numbers()),
            Physics::Effort(call) => motor.efforts.push(Part::new(call, instance, memory)),
            Physics::Force(call) if at_motor => {
                motor.forces.push(Part::new(call, instance, memory));
            }
            Physics::Force(call) => rail.forces.push(Part::new(call, instance, memory)),
            Physics::Friction(call) if at_motor => {
                motor.frictions.push(Part::new(call, instance, memory));
            }
            Physics::Friction(call) => rail.frictions.push(Part::new(call, instance, memory)),
            Physics::Inertia(call) => rail.masses.push(Part::new(call, instance, memory)),
            _ => {}
        }
    }

    /// Dead time of each motor's command (s).
    #[must_use]
    pub fn delays(&self) -> [f64; 2] {
        [self.motors[0].delay, self.motors.get(1).map_or(0.0, |motor| motor.delay)]
    }

    /// A state at rest in the origin.
    #[must_use]
    pub fn start(&self) -> PlantState {
        PlantState { memory: vec![0.0; self.memory], ..PlantState::default() }
    }

    /// One step of `dt` seconds with each motor's `command` (m/s of belt), at most
    /// [`LONGEST_STEP`] for the accuracy that the tests state.
    pub fn step(&self, state: &mut PlantState, command: [f64; 2], dt: f64) {
        if self.motors.len() == 1 {
            self.step_single(state, command[0], dt);
        } else {
            self.step_gantry(state, command, dt);
        }
        state.time += dt;
    }

    fn step_gantry(&self, state: &mut PlantState, command: [f64; 2], dt: f64) {
        let belt_position = belts(state.position);
        let belt_velocity = belts(state.velocity);
        let belt_acceleration = belts(state.acceleration);
        let memory = &mut state.memory;
        let rail_motion = |index: usize, force: [f64; 2], mass: f64| Motion {
            time: state.time,
            dt,
            position: state.position[index],
            velocity: state.velocity[index],
            acceleration: state.acceleration[index],
            force: if index == 0 { force[0] + force[1] } else { force[0] - force[1] },
            mass,
            other: CrossMotion {
                position: state.position[1 - index],
                velocity: state.velocity[1 - index],
                acceleration: state.acceleration[1 - index],
                force: if index == 0 { force[0] - force[1] } else { force[0] + force[1] },
            },
        };
        let mass = [0, 1].map(|index| self.rails[index].mass(&rail_motion(index, [0.0; 2], 0.0)));
        let belt_mass = 1.0 / (1.0 / mass[0] + 1.0 / mass[1]);
        let mean_mass = 0.5 * (mass[0] + mass[1]);
        // Loads on the rails, with the motors' forces of the step before where a load depends on them.
        let load = [0, 1].map(|index| {
            let motion = rail_motion(index, state.force, mass[index]);
            sum(&self.rails[index].forces, memory, &motion)
        });
        let drag = belts([0, 1].map(|index| (load[index] + state.friction[index]) / mass[index]));
        let mut demand = [0.0; 2];
        let mut setpoint = [0.0; 2];
        for index in 0..2 {
            let motor = &self.motors[index];
            setpoint[index] = motor.setpoint(command[index], memory, dt);
            let middle = motor.middle(state.setpoint[index], setpoint[index]);
            demand[index] = motor.demand(
                0.5 * mean_mass,
                belt_mass,
                middle - belt_velocity[index] - 0.5 * dt * drag[index],
                state.integral[index],
                dt,
            );
        }
        let belt_motion = |index: usize, force: [f64; 2]| Motion {
            time: state.time,
            dt,
            position: belt_position[index],
            velocity: belt_velocity[index],
            acceleration: belt_acceleration[index],
            force: force[index],
            mass: belt_mass,
            other: CrossMotion {
                position: belt_position[1 - index],
                velocity: belt_velocity[1 - index],
                acceleration: belt_acceleration[1 - index],
                force: force[1 - index],
            },
        };
        let mut force = demand;
        for index in 0..2 {
            for part in &self.motors[index].efforts {
                let mut motion = belt_motion(index, demand);
                motion.force = force[index];
                force[index] = (part.call)(part.p(), part.memory(memory), &motion);
            }
        }
        let mut pull = [0, 1].map(|index| {
            let motion = belt_motion(index, force);
            force[index] + sum(&self.motors[index].forces, memory, &motion)
        });
        for index in 0..2 {
            let motor = &self.motors[index];
            if motor.frictions.is_empty() {
                continue;
            }
            let level = sum(&motor.frictions, memory, &belt_motion(index, force)).max(0.0);
            let free = belts([
                state.velocity[0] + dt * (pull[0] + pull[1] + load[0]) / mass[0],
                state.velocity[1] + dt * (pull[0] - pull[1] + load[1]) / mass[1],
            ])[index];
            pull[index] -= (belt_mass * free / dt).clamp(-level, level);
        }
        let total = [pull[0] + pull[1] + load[0], pull[0] - pull[1] + load[1]];
        let mut velocity = [0.0; 2];
        let mut friction = [0.0; 2];
        for index in 0..2 {
            let motion = rail_motion(index, force, mass[index]);
            let level = sum(&self.rails[index].frictions, memory, &motion).max(0.0);
            (velocity[index], friction[index]) =
                slide(state.velocity[index], total[index], level, mass[index], dt);
        }
        let belt_after = belts(velocity);
        for index in 0..2 {
            let motor = &self.motors[index];
            let middle = motor.middle(state.setpoint[index], setpoint[index]);
            let error = middle - 0.5 * (belt_velocity[index] + belt_after[index]);
            state.integral[index] += 0.5 * mean_mass * motor.gains.integral_per_s2 * error * dt;
        }
        for index in 0..2 {
            state.acceleration[index] = (velocity[index] - state.velocity[index]) / dt;
            state.position[index] += 0.5 * dt * (velocity[index] + state.velocity[index]);
        }
        state.velocity = velocity;
        state.friction = friction;
        state.force = force;
        state.setpoint = setpoint;
    }

    fn step_single(&self, state: &mut PlantState, command: f64, dt: f64) {
        let (motor, rail) = (&self.motors[0], &self.rails[0]);
        let memory = &mut state.memory;
        let mut motion = Motion {
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
        let error = middle - state.velocity[0] - 0.5 * dt * drag;
        motion.force = motor.demand(mass, mass, error, state.integral[0], dt);
        for part in &motor.efforts {
            motion.force = (part.call)(part.p(), part.memory(memory), &motion);
        }
        let level = (sum(&rail.frictions, memory, &motion)
            + sum(&motor.frictions, memory, &motion))
        .max(0.0);
        let (velocity, friction) = slide(state.velocity[0], motion.force + load, level, mass, dt);
        let error = middle - 0.5 * (state.velocity[0] + velocity);
        state.integral[0] += mass * motor.gains.integral_per_s2 * error * dt;
        state.acceleration[0] = (velocity - state.velocity[0]) / dt;
        state.position[0] += 0.5 * dt * (velocity + state.velocity[0]);
        state.velocity[0] = velocity;
        state.friction[0] = friction;
        state.force[0] = motion.force;
        state.setpoint[0] = setpoint;
    }
}

/// Velocity after `dt` under `force` and at most `level` of friction, and the friction force.
fn slide(velocity: f64, force: f64, level: f64, mass: f64, dt: f64) -> (f64, f64) {
    let free = velocity + dt * force / mass;
    let friction = -(mass * free / dt).clamp(-level, level);
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

    /// Setpoint in the middle of a step: a ramp is half-way, a jump has happened at its start.
    fn middle(&self, before: f64, after: f64) -> f64 {
        if self.ramps.is_empty() { after } else { 0.5 * (before + after) }
    }

    /// Force at the middle of the step: `mass` scales the gains, `moved` is what the force moves.
    fn demand(&self, mass: f64, moved: f64, error: f64, integral: f64, dt: f64) -> f64 {
        let gain = mass * self.gains.proportional_per_s;
        (gain * error + integral) / (1.0 + 0.5 * dt * gain / moved)
    }
}

/// Whether a plant calls the physics of an effect.
pub(super) fn calls(physics: &Physics) -> bool {
    matches!(
        physics,
        Physics::CommandDelay(_)
            | Physics::Command(_)
            | Physics::Ramp(_)
            | Physics::VelocityLoop(_)
            | Physics::Effort(_)
            | Physics::Force(_)
            | Physics::Friction(_)
            | Physics::Inertia(_)
    )
}
