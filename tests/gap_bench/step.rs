//! How the gantry of the bench moves: explicit forces, then friction as bounded impulses.
//!
//! One step of 0.2 ms: forces give a trial velocity; each row of dry friction then takes the impulse
//! that would stop it, bounded by its budget (projected Gauss-Seidel), so that it sticks exactly;
//! positions follow with the new velocity (symplectic Euler). The drives' velocity loops run at
//! the same rate.

use crate::{
    draw::{Coloured, Draw},
    gantry::{
        BELT_PER_TURN, ENDSTOP_START, Friction, Gantry, HALF_STROKE, HOME, MAGNET_LENGTH, PEG_MASS,
        POSITION_LENGTH, ROTOR_MASS, SAG_POWER, STRIBECK_SPEED, THERMAL_TIME, TOOTH_PITCH, WOBBLE,
    },
    plan::{PERIOD, Plan},
};
use std::f64::consts::TAU;

/// Step of integrator and velocity loop (s).
pub(crate) const STEP: f64 = 2e-4;
/// Steps per control period, per sample of the motors.
pub(crate) const STEPS_PER_COMMAND: usize = 100;
pub(crate) const STEPS_PER_SAMPLE: usize = 50;
/// Gain of the host's correction towards its reference (1/s).
const HOST_GAIN: f64 = 1.5;
/// Contact stiffness (N/m) of play, and damping ratio of belts.
const PLAY_STIFFNESS: f64 = 8e5;
const BELT_DAMPING: f64 = 0.05;
const GRAVITY: f64 = 9.81;
/// Where the frame ends, from home (m), its stiffness (N/m) and damping (N s/m).
const HARD_STOP: [f64; 2] = [0.155, 0.095];
const STOP_STIFFNESS: f64 = 2e4;
const STOP_DAMPING: f64 = 150.0;

/// Where the commands come from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Commands<'a> {
    Follow(&'a Plan),
    Replay(&'a [[f64; 2]]),
}

/// What happened, without the noise of the sensors.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trace {
    /// Board velocity commanded every 20 ms (m/s).
    pub(crate) commands: Vec<[f64; 2]>,
    /// Encoder positions (m of belt) and velocities (m/s) every 10 ms.
    pub(crate) belt: Vec<[f64; 2]>,
    pub(crate) speed: Vec<[f64; 2]>,
    /// Torque as newtons of belt: asked for, and delivered.
    pub(crate) target: Vec<[f64; 2]>,
    pub(crate) force: Vec<[f64; 2]>,
    /// Where the peg's top is, every step (m), from the start on.
    pub(crate) seen: Vec<[f64; 2]>,
}

impl Trace {
    /// Seen point at `time`, between two steps.
    pub(crate) fn seen_at(&self, time: f64) -> [f64; 2] {
        let last = self.seen.len() - 1;
        let at = (time / STEP).clamp(0.0, last as f64);
        let (index, part) = (at.floor() as usize, at.fract());
        let (p, q) = (self.seen[index], self.seen[(index + 1).min(last)]);
        [p[0] + part * (q[0] - p[0]), p[1] + part * (q[1] - p[1])]
    }
}

/// Session phases that change from one recording to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Phases {
    pub(crate) tooth: [f64; 2],
    pub(crate) hum: f64,
}

struct World<'a> {
    rig: &'a Gantry,
    phases: Phases,
    soft: bool,
    time: f64,
    /// Positions and velocities of x, y, a, b; a and b are read only when belts are soft.
    q: [f64; 4],
    v: [f64; 4],
    bristle: [f64; 4],
    last_force: [f64; 4],
    peg: [f64; 2],
    peg_v: [f64; 2],
    anchor: [f64; 2],
    wobble: [f64; 2],
    wobble_v: [f64; 2],
    lagged: [f64; 2],
    setpoint: [f64; 2],
    integral: [f64; 2],
    target: [f64; 2],
    force: [f64; 2],
    power: f64,
}

impl<'a> World<'a> {
    fn new(rig: &'a Gantry, phases: Phases) -> Self {
        let q = [HOME[0], HOME[1], HOME[0] + HOME[1], HOME[0] - HOME[1]];
        Self {
            rig,
            phases,
            soft: rig.soft_belts(),
            time: 0.0,
            q,
            v: [0.0; 4],
            bristle: [0.0; 4],
            last_force: [0.0; 4],
            peg: HOME,
            peg_v: [0.0; 2],
            anchor: [0.0; 2],
            wobble: [0.0; 2],
            wobble_v: [0.0; 2],
            lagged: [0.0; 2],
            setpoint: [0.0; 2],
            integral: [0.0; 2],
            target: [0.0; 2],
            force: [0.0; 2],
            power: 0.0,
        }
    }

    /// Belt position and speed at motor `m` (m, m/s).
    fn motor(&self, m: usize) -> [f64; 2] {
        if self.soft {
            [self.q[2 + m], self.v[2 + m]]
        } else {
            let s = if m == 0 { 1.0 } else { -1.0 };
            [self.q[0] + s * self.q[1], self.v[0] + s * self.v[1]]
        }
    }

    /// What the encoder of motor `m` reads, from where it was switched on (m, m/s).
    fn encoder(&self, m: usize) -> [f64; 2] {
        let [q, v] = self.motor(m);
        let zero = if m == 0 { HOME[0] + HOME[1] } else { HOME[0] - HOME[1] };
        let turn = TAU / BELT_PER_TURN;
        let e = self.rig.drive.eccentricity[m];
        let (sin, cos) = (turn * (q - zero)).sin_cos();
        [q - zero + e * sin, v * (1.0 + e * turn * cos)]
    }

    /// Command path and velocity loop of motor `m`; `command` is belt speed (m/s), delayed.
    fn control(&mut self, m: usize, command: f64, noise: f64) {
        let d = &self.rig.drive;
        let mut u = if command.abs() < d.deadband[m] { 0.0 } else { command };
        u = u * (1.0 + d.gain_error[m] - self.dead_spot()) + d.offset[m];
        let share = if d.lag[m] > 0.0 { 1.0 - (-STEP / d.lag[m]).exp() } else { 1.0 };
        self.lagged[m] += share * (u - self.lagged[m]);
        let most = d.ramp[m] * STEP;
        let before = self.setpoint[m];
        self.setpoint[m] += (self.lagged[m] - before).clamp(-most, most);
        // The ramp in the middle of the step: at its end the drive would be ahead of its command.
        let setpoint = 0.5 * (before + self.setpoint[m]);
        let speed = self.encoder(m)[1];
        let error = setpoint - speed - noise;
        let raw = d.kp[m] * error + self.integral[m];
        let limit = d.force_limit[m];
        self.target[m] = raw.clamp(-limit, limit);
        if raw.abs() < limit || raw * error < 0.0 {
            self.integral[m] += d.ki[m] * error * STEP;
        }
        self.force[m] = self.delivered(m, speed);
    }

    /// What supply and motor make of the target (N).
    fn delivered(&self, m: usize, speed: f64) -> f64 {
        let d = &self.rig.drive;
        let mut force = self.target[m] * (1.0 - d.sag * (self.power / SAG_POWER).min(1.5));
        if d.fall[m] > 0.0 && 0.0 < force * speed {
            let most = d.force_limit[m] * (1.0 - d.fall[m] * speed.abs()).max(0.0);
            force = force.clamp(-most, most);
        }
        force
    }

    fn dead_spot(&self) -> f64 {
        let inside = HOME[0] + 0.01 < self.q[0] && HOME[1] + 0.005 < self.q[1];
        if inside { self.rig.outside.dead_spot } else { 0.0 }
    }

    /// Mass matrix of x, y with and without the rotors, and the forces of its change with place.
    fn mass(&self) -> ([f64; 3], [f64; 2]) {
        let frame = &self.rig.frame;
        let rotors = if self.soft { 0.0 } else { 2.0 * ROTOR_MASS };
        let carried = Gantry::carried();
        let place =
            [(self.q[0] - HOME[0]) / HALF_STROKE[0], (self.q[1] - HOME[1]) / HALF_STROKE[1]];
        let mut diagonal = [0.0; 2];
        let mut bias = [0.0; 2];
        for axis in 0..2 {
            let whole = carried[axis] + 2.0 * ROTOR_MASS;
            let change = frame.mass_position[axis] * whole;
            diagonal[axis] = carried[axis] + rotors + change * place[axis];
            bias[axis] -= 0.5 * change / HALF_STROKE[axis] * self.v[axis] * self.v[axis];
        }
        let off = frame.cross_mass + frame.racking_mass * place[0];
        bias[1] -= frame.racking_mass / HALF_STROKE[0] * self.v[0] * self.v[0];
        ([diagonal[0], off, diagonal[1]], bias)
    }

    /// Budgets of dry friction against motion in - and + direction (N), and the smooth part.
    fn friction(&mut self, row: usize, f: &Friction) -> ([f64; 2], f64) {
        let (q, v) = self.row(row);
        let warm = 1.0 - f.thermal * (1.0 - (-self.time / THERMAL_TIME).exp());
        let place = 1.0 + f.position * (TAU * q / POSITION_LENGTH).sin();
        let mut budget = f.coulomb * warm * place;
        budget += f.stribeck * (-v.abs() / STRIBECK_SPEED).exp();
        budget += f.load * self.last_force[row].abs();
        let slope = warm * f.viscous * (1.0 + f.asymmetry * v.signum());
        let mut smooth = -slope * v - f.quadratic * v * v.abs();
        if f.presliding > 0.0 {
            let z = &mut self.bristle[row];
            let before = *z;
            // Implicit in the bristle: its decay is far faster than a step at speed.
            *z = (before + STEP * v) / (1.0 + STEP * f.presliding * v.abs() / budget.max(0.05));
            let rate = (*z - before) / STEP;
            smooth -= f.presliding * *z + 2.0 * f.presliding.sqrt() * rate;
            return ([0.0; 2], smooth);
        }
        ([budget * (1.0 - f.asymmetry), budget * (1.0 + f.asymmetry)], smooth)
    }

    fn row(&self, row: usize) -> (f64, f64) {
        if row < 2 {
            (self.q[row] - HOME[row], self.v[row])
        } else {
            let [q, v] = self.motor(row - 2);
            (q, v)
        }
    }

    /// Forces on the rails that come from the frame and from outside every catalogue (N).
    fn board_forces(&self, noise: [f64; 2]) -> [f64; 2] {
        let (frame, odd) = (&self.rig.frame, &self.rig.outside);
        let carried = Gantry::carried();
        let mut out = noise;
        let place = [self.q[0] - HOME[0], self.q[1] - HOME[1]];
        for axis in 0..2 {
            out[axis] += carried[axis] * GRAVITY * frame.tilt[axis].sin();
            let beyond = place[axis].abs() - ENDSTOP_START[axis];
            if 0.0 < beyond {
                out[axis] -= frame.endstop * beyond * place[axis].signum();
            }
            let past = place[axis].abs() - HARD_STOP[axis];
            if 0.0 < past {
                out[axis] -= STOP_STIFFNESS * past * place[axis].signum();
                out[axis] -= STOP_DAMPING * self.v[axis];
            }
            out[axis] += odd.hum * (TAU * 3.3 * self.time + self.phases.hum).sin();
        }
        let sweep = self.phases.hum + TAU * (1.1 + 0.07 * self.time) * self.time;
        out[0] += odd.chirp * sweep.sin();
        let product = (place[0] * place[1] / (HALF_STROKE[0] * HALF_STROKE[1])).abs().min(1.5);
        out[0] -= odd.product_friction * product * (self.v[0] / 0.02).tanh();
        out[1] -= odd.product_friction * product * (self.v[1] / 0.02).tanh();
        out[0] -= odd.square_coupling * self.v[1] * self.v[1];
        out[0] += odd.spiral * self.v[1] * place[0].signum() * place[0].abs().sqrt();
        out[1] -= odd.spiral * self.v[0] * place[0].signum() * place[0].abs().sqrt();
        out
    }

    /// Ripple of motor `m` (N).
    fn ripple(&self, m: usize) -> f64 {
        let d = &self.rig.drive;
        let q = self.motor(m)[0];
        let mut out = 0.0;
        if d.tooth[m] > 0.0 {
            out += d.tooth[m] * (TAU * q / TOOTH_PITCH + self.phases.tooth[m]).sin();
        }
        if d.pulley[m] > 0.0 {
            out += d.pulley[m] * (TAU * q / BELT_PER_TURN + self.phases.tooth[m]).sin();
        }
        out
    }

    /// Force of the soft belt of motor `m` on the carriage (N).
    fn belt_force(&self, m: usize) -> f64 {
        let s = if m == 0 { 1.0 } else { -1.0 };
        let stretch = self.q[2 + m] - self.q[0] - s * self.q[1];
        let rate = self.v[2 + m] - self.v[0] - s * self.v[1];
        let half = 0.5 * self.rig.drive.backlash[m];
        let compliance = self.rig.drive.belt[m].max(1.0 / PLAY_STIFFNESS);
        let stiffness = 1.0 / compliance;
        let damping = 2.0 * BELT_DAMPING * (stiffness * 0.3).sqrt();
        let over = stretch - stretch.clamp(-half, half);
        if over == 0.0 { 0.0 } else { stiffness * over + damping * rate }
    }

    fn step(&mut self, noise: [f64; 2]) {
        let before = [self.v[0], self.v[1]];
        let (mass, bias) = self.mass();
        let mut board = self.board_forces(noise);
        let mut motors = [self.force[0] + self.ripple(0), self.force[1] + self.ripple(1)];
        let belts = if self.soft { [self.belt_force(0), self.belt_force(1)] } else { motors };
        let pull = [belts[0] + belts[1], belts[0] - belts[1]];
        let hand = self.couple();
        self.last_force[..2].copy_from_slice(&pull);
        self.last_force[2..].copy_from_slice(&motors);
        for axis in 0..2 {
            board[axis] += pull[axis] + bias[axis] + hand[axis];
            motors[axis] -= belts[axis];
        }
        let friction = self.rig.friction;
        let mut budgets = [[0.0; 2]; 4];
        for (row, law) in friction.iter().enumerate() {
            let (budget, smooth) = self.friction(row, law);
            budgets[row] = budget;
            match row {
                0 | 1 => board[row] += smooth,
                _ if self.soft => motors[row - 2] += smooth,
                _ => {
                    board[0] += smooth;
                    board[1] += if row == 2 { smooth } else { -smooth };
                }
            }
        }
        let determinant = mass[0] * mass[2] - mass[1] * mass[1];
        let inverse = [mass[2] / determinant, -mass[1] / determinant, mass[0] / determinant];
        self.v[0] += STEP * (inverse[0] * board[0] + inverse[1] * board[1]);
        self.v[1] += STEP * (inverse[1] * board[0] + inverse[2] * board[1]);
        self.v[2] += STEP * motors[0] / ROTOR_MASS;
        self.v[3] += STEP * motors[1] / ROTOR_MASS;
        self.stick(&budgets, inverse);
        for dof in 0..4 {
            self.q[dof] += STEP * self.v[dof];
        }
        if self.rig.coupling.magnet <= 0.0 {
            self.peg = [self.q[0], self.q[1]];
        }
        let carriage = [(self.v[0] - before[0]) / STEP, (self.v[1] - before[1]) / STEP];
        self.tip(carriage);
        let power = (0..2).map(|m| (self.force[m] * self.motor(m)[1]).abs()).sum::<f64>();
        self.power += STEP / 0.01 * (power - self.power);
        self.time += STEP;
    }

    /// Dry friction of all rows as bounded impulses.
    fn stick(&mut self, budgets: &[[f64; 2]; 4], inverse: [f64; 3]) {
        let belts = budgets[2][1] + budgets[3][1] > 0.0;
        let sweeps = if belts || inverse[1] != 0.0 { 6 } else { 1 };
        let mut given = [0.0; 4];
        for _ in 0..sweeps {
            for row in 0..4 {
                let [minus, plus] = budgets[row];
                if plus <= 0.0 && minus <= 0.0 {
                    continue;
                }
                let direction = match row {
                    0 => [1.0, 0.0],
                    1 => [0.0, 1.0],
                    2 => [1.0, 1.0],
                    _ => [1.0, -1.0],
                };
                let own = 2 <= row && self.soft;
                let answer = [
                    inverse[0] * direction[0] + inverse[1] * direction[1],
                    inverse[1] * direction[0] + inverse[2] * direction[1],
                ];
                let (speed, mobility) = if own {
                    (self.v[row], 1.0 / ROTOR_MASS)
                } else {
                    (
                        direction[0] * self.v[0] + direction[1] * self.v[1],
                        direction[0] * answer[0] + direction[1] * answer[1],
                    )
                };
                let wanted: f64 = given[row] - speed / mobility;
                let next = wanted.clamp(-plus * STEP, minus * STEP);
                let change = next - given[row];
                given[row] = next;
                if own {
                    self.v[row] += change * mobility;
                } else {
                    self.v[0] += change * answer[0];
                    self.v[1] += change * answer[1];
                }
            }
        }
    }

    /// Magnet between carriage and peg; gives the force on the carriage (N). Without one the peg is rigid on it.
    fn couple(&mut self) -> [f64; 2] {
        let c = &self.rig.coupling;
        if c.magnet <= 0.0 {
            return [0.0; 2];
        }
        let stiffness = 1.0 / c.magnet;
        let damping = 2.0 * 0.1 * (stiffness * PEG_MASS).sqrt();
        let mut gap = [0.0; 2];
        for axis in 0..2 {
            gap[axis] = self.peg[axis] - self.q[axis] - self.anchor[axis];
        }
        let stretch = gap[0].hypot(gap[1]);
        let mut pull = stiffness / (1.0 + (stretch / MAGNET_LENGTH).powi(2)) * stretch;
        if 0.0 < c.slip_force && c.slip_force < pull {
            let keep = c.slip_force / pull;
            for axis in 0..2 {
                self.anchor[axis] += gap[axis] * (1.0 - keep);
                gap[axis] *= keep;
            }
            pull = c.slip_force;
        }
        let length = gap[0].hypot(gap[1]).max(1e-12);
        let mut hand = [0.0; 2];
        for axis in 0..2 {
            let rate = self.peg_v[axis] - self.v[axis];
            let force = -pull * gap[axis] / length - damping * rate;
            hand[axis] = -force;
            self.peg_v[axis] += STEP * force / PEG_MASS;
        }
        let speed = self.peg_v[0].hypot(self.peg_v[1]);
        let stop = STEP * c.striker_friction / PEG_MASS;
        let keep = if speed <= stop { 0.0 } else { 1.0 - stop / speed };
        for axis in 0..2 {
            self.peg_v[axis] *= keep;
            self.peg[axis] += STEP * self.peg_v[axis];
        }
        hand
    }

    /// The peg tips on its foot when the carriage accelerates.
    fn tip(&mut self, acceleration: [f64; 2]) {
        if self.rig.coupling.wobble <= 0.0 {
            return;
        }
        let omega = TAU * WOBBLE[0];
        for axis in 0..2 {
            let pull = -omega * omega * self.wobble[axis]
                - 2.0 * WOBBLE[1] * omega * self.wobble_v[axis]
                - self.rig.coupling.wobble * acceleration[axis];
            self.wobble_v[axis] += STEP * pull;
            self.wobble[axis] += STEP * self.wobble_v[axis];
        }
    }
}

/// Lets `rig` run for the length of its commands.
pub(crate) fn simulate(
    rig: &Gantry,
    commands: Commands<'_>,
    phases: Phases,
    draw: &mut Draw,
) -> Trace {
    let periods = match commands {
        Commands::Follow(plan) => plan.velocity.len(),
        Commands::Replay(list) => list.len(),
    };
    let mut world = World::new(rig, phases);
    let mut trace = Trace::default();
    let s = &rig.sensors;
    let disturbance = || Coloured::new(s.disturbance, s.disturbance_rho);
    let (mut push, mut pushed) = ([disturbance(), disturbance()], [0.0; 2]);
    let delay = rig.drive.delay.map(|delay| delay / STEP);
    for step in 0..periods * STEPS_PER_COMMAND {
        if step % STEPS_PER_COMMAND == 0 {
            let next = match commands {
                Commands::Replay(list) => list[step / STEPS_PER_COMMAND],
                Commands::Follow(plan) => host(&world, plan, step / STEPS_PER_COMMAND),
            };
            trace.commands.push(next);
        }
        if step % STEPS_PER_SAMPLE == 0 {
            pushed = [push[0].next(draw), push[1].next(draw)];
            sample(&world, &mut trace);
        }
        for m in 0..2 {
            let command = belt_command(&trace.commands, step, delay[m], m);
            let noise = if s.velocity_noise > 0.0 { s.velocity_noise * draw.normal() } else { 0.0 };
            if rig.disarmed {
                continue;
            }
            world.control(m, command, noise);
        }
        trace.seen.push([world.peg[0] + world.wobble[0], world.peg[1] + world.wobble[1]]);
        world.step(pushed);
    }
    trace
}

/// The host's next command: the reference, corrected by what the motors say, in steps of 0.1 mm/s.
fn host(world: &World<'_>, plan: &Plan, index: usize) -> [f64; 2] {
    let [a, b] = [world.encoder(0)[0], world.encoder(1)[0]];
    let at = [HOME[0] + 0.5 * (a + b), HOME[1] + 0.5 * (a - b)];
    let resting = plan.velocity[index] == [0.0; 2];
    let mut out = [0.0; 2];
    for axis in 0..2 {
        let error = plan.position[index][axis] - at[axis];
        let correction = if resting { 0.0 } else { (HOST_GAIN * error).clamp(-0.12, 0.12) };
        out[axis] = ((plan.velocity[index][axis] + correction) * 1e4).round() / 1e4;
    }
    out
}

/// Belt speed asked of motor `m`, `delay` steps ago; a part of a step blends two of them.
fn belt_command(commands: &[[f64; 2]], step: usize, delay: f64, m: usize) -> f64 {
    let at = |back: usize| {
        step.checked_sub(back).map_or(0.0, |step| {
            let [x, y] = commands[step / STEPS_PER_COMMAND];
            if m == 0 { x + y } else { x - y }
        })
    };
    let (whole, part) = (delay.floor() as usize, delay.fract());
    (1.0 - part) * at(whole) + part * at(whole + 1)
}

fn sample(world: &World<'_>, trace: &mut Trace) {
    let read = [world.encoder(0), world.encoder(1)];
    trace.belt.push([read[0][0], read[1][0]]);
    trace.speed.push([read[0][1], read[1][1]]);
    trace.target.push(world.target);
    trace.force.push(world.force);
}

/// Seconds that `trace` lasts.
pub(crate) fn duration(trace: &Trace) -> f64 {
    trace.commands.len() as f64 * PERIOD
}
