//! Dynamics of one CoreXY gantry: two rotors, two elastic belts, bridge and carriage on guides.
//!
//! Coordinates are metres of belt: rotors at `q_a`, `q_b`, and the carriage displaced by `(x, y)`
//! from its start. `g_x` and `g_y` are 1 plus the scale errors.
//!
//! ```text
//! stretch of belt a   s_a = q_a - (x/g_x + y/g_y)
//! stretch of belt b   s_b = q_b - (x/g_x - y/g_y)
//! tension             T = k s + c s'
//! on the rotors       -T
//! on the carriage     F_x = (T_a + T_b)/g_x,  F_y = (T_a - T_b)/g_y
//! ```
//!
//! The forces follow by virtual work. With stiff belts this is `x = d/2 (a + b)`,
//! `y = d/2 (a - b)`. Integration by semi-implicit Euler; friction as in `friction`.
//!
//! Independent of the kinematics of the rest of the crate on purpose: see [`crate::rig`]. Racking:
//! a yawing bridge pushes the carriage in x with `-c x a_y`. Not modelled: position-dependent mass.

use super::{
    config::{GantryConfig, RigConfig},
    friction::{Friction, Under},
};
use std::f64::consts::TAU;

const GRAVITY: f64 = 9.81;

/// Rotor of one motor, in belt coordinates with the direction of its seat applied.
#[derive(Debug, Clone)]
pub(super) struct Rotor {
    /// Belt travel (m).
    pub(super) position: f64,
    /// Belt velocity (m/s).
    pub(super) velocity: f64,
    /// Force of the motor (N).
    pub(super) force: f64,
    sign: f64,
    mass: f64,
    friction: Friction,
}

impl Rotor {
    /// A rotor of `inertia` (kg m^2) at pitch radius `radius` (m), turning with `sign`.
    pub(super) fn new(inertia: f64, sign: f64, radius: f64, friction: Friction) -> Self {
        let mass = inertia / radius.powi(2);
        Self { position: 0.0, velocity: 0.0, force: 0.0, sign, mass, friction }
    }

    fn advance(&mut self, tension: f64, warmth: f64, dt: f64) {
        let free = self.velocity + (self.force - tension) / self.mass * dt;
        // Friction may depend on the rotor's own direction of rotation.
        let under = Under { load: tension, factor: warmth, mass: self.mass, dt };
        let own = self.friction.slowed(free * self.sign, under);
        self.velocity = own * self.sign;
        self.position += self.velocity * dt;
    }
}

/// State and constants of a gantry.
#[derive(Debug, Clone)]
pub(super) struct Gantry {
    /// Rotors of motors a and b.
    pub(super) rotors: [Rotor; 2],
    /// Displacement of the carriage from its start along its own guides (m).
    travel: [f64; 2],
    velocity: [f64; 2],
    /// Racking of the bridge: force in x per displacement in x (N/m).
    yaw: f64,
    /// True if it is jammed.
    pub(super) stuck: bool,
    scale: [f64; 2],
    stiffness: [f64; 2],
    config: GantryConfig,
    mass: [f64; 2],
    friction: [Friction; 2],
    low: [f64; 2],
    high: [f64; 2],
}

impl Gantry {
    /// Build the gantry on the half of the board with the sign `side` (+1 or -1) of y.
    pub(super) fn new(config: &GantryConfig, rig: &RigConfig, side: f64) -> Self {
        let radius = rig.belt_metres_per_turn / TAU;
        let free = Friction::of_motor(&rig.drive.friction, radius, rig.belt_metres_per_turn);
        let rotor = Rotor::new(rig.drive.rotor_inertia_kg_m2, 1.0, radius, free);
        let ends = [config.y_travel_near_m, config.y_travel_far_m].map(|y| y * side);
        Self {
            rotors: [rotor.clone(), rotor],
            travel: [0.0; 2],
            velocity: [0.0; 2],
            yaw: 0.0,
            stuck: false,
            scale: [1.0 + config.x_scale_error, 1.0 + config.y_scale_error],
            stiffness: [config.belt_a_stiffness_n_per_m, config.belt_b_stiffness_n_per_m],
            mass: [config.carriage_mass_kg, config.carriage_mass_kg + config.bridge_mass_kg],
            friction: [
                Friction::of_guide(&config.x_friction),
                Friction::of_guide(&config.y_friction),
            ],
            low: [-config.x_travel_m, ends[0].min(ends[1])],
            high: [config.x_travel_m, ends[0].max(ends[1])],
            config: config.clone(),
        }
    }

    /// Position of the magnet on the carriage in the board frame (m).
    pub(super) fn position(&self) -> [f64; 2] {
        let [x, y] = self.travel;
        let lean = self.config.squareness_rad * y;
        [self.config.x_start_m + x + lean, self.config.y_start_m + y]
    }

    /// Its velocity (m/s).
    pub(super) fn velocity(&self) -> [f64; 2] {
        let [vx, vy] = self.velocity;
        [vx + self.config.squareness_rad * vy, vy]
    }

    /// Advance by `dt` (s) under the forces of the rotors and `load` (N) on the carriage; dry
    /// friction is multiplied by `warmth`.
    pub(super) fn step(&mut self, load: [f64; 2], warmth: f64, dt: f64) {
        let [along_x, along_y] = [0, 1].map(|axis| self.travel[axis] / self.scale[axis]);
        let [speed_x, speed_y] = [0, 1].map(|axis| self.velocity[axis] / self.scale[axis]);
        let tension_a = self.tension(0, along_x + along_y, speed_x + speed_y);
        let tension_b = self.tension(1, along_x - along_y, speed_x - speed_y);
        self.rotors[0].advance(tension_a, warmth, dt);
        self.rotors[1].advance(tension_b, warmth, dt);
        if self.stuck {
            self.velocity = [0.0; 2];
            return;
        }
        let pull = [tension_a + tension_b, tension_a - tension_b];
        let cross = self.config.cross_damping_n_s_per_m;
        let before = self.velocity;
        let racking = [-self.yaw * self.position()[0], 0.0];
        let tilt = [self.config.x_tilt_rad, self.config.y_tilt_rad];
        for axis in 0..2 {
            let mass = self.mass[axis];
            let force =
                pull[axis] / self.scale[axis] + load[axis] + racking[axis] + self.endstop(axis)
                    - cross * before[1 - axis]
                    - mass * GRAVITY * tilt[axis];
            let free = before[axis] + force / mass * dt;
            let factor = warmth * self.rail_factor(axis);
            let under = Under { load: 0.0, factor, mass, dt };
            self.velocity[axis] = self.friction[axis].slowed(free, under);
            self.travel[axis] += self.velocity[axis] * dt;
        }
        self.yaw = self.config.racking_kg_per_m * (self.velocity[1] - before[1]) / dt;
    }

    fn tension(&self, belt: usize, carriage: f64, carriage_speed: f64) -> f64 {
        let rotor = &self.rotors[belt];
        let play = self.config.backlash_m / 2.0;
        let stretch = rotor.position - carriage;
        if stretch.abs() <= play && 0.0 < play {
            return 0.0;
        }
        let taut = stretch - play.copysign(stretch);
        self.stiffness[belt] * taut
            + self.config.belt_damping_n_s_per_m * (rotor.velocity - carriage_speed)
    }

    fn endstop(&self, axis: usize) -> f64 {
        let place = self.position()[axis];
        let depth = place - place.clamp(self.low[axis], self.high[axis]);
        if depth == 0.0 {
            return 0.0;
        }
        let stiffness = self.config.endstop_stiffness_n_per_m;
        let damping = (stiffness * self.mass[axis]).sqrt();
        let push = -stiffness * depth - damping * self.velocity[axis];
        // A stop only pushes back.
        if push * depth < 0.0 { push } else { 0.0 }
    }

    fn rail_factor(&self, axis: usize) -> f64 {
        let config = if axis == 0 { &self.config.x_friction } else { &self.config.y_friction };
        if config.position_fraction == 0.0 {
            return 1.0;
        }
        let phase = TAU * self.travel[axis] / config.position_wavelength_m;
        1.0 + config.position_fraction * phase.sin()
    }
}
