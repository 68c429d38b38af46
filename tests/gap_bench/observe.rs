//! What the sensors of the gantry make of a trace.

use crate::{
    draw::{Coloured, Draw},
    gantry::{BELT_PER_TORQUE, BELT_PER_TURN, COUNTS, Gantry, HOME},
    step::{STEP, STEPS_PER_SAMPLE, Trace, duration},
};

/// Frames per second.
pub(crate) const CAMERA_RATE: f64 = 120.0;
/// Sampling time of the motors (s).
pub(crate) const SAMPLE: f64 = STEP * STEPS_PER_SAMPLE as f64;
/// Distance at which the distortion is given (m).
const EDGE: f64 = 0.21;

/// One camera frame as it arrives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    /// Index of the exposure.
    pub(crate) index: usize,
    /// Stamp (s).
    pub(crate) time: f64,
    pub(crate) at: [f64; 2],
}

/// Everything that a recording of the gantry holds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Observation {
    pub(crate) commands: Vec<[f64; 2]>,
    pub(crate) turns: Vec<[f64; 2]>,
    pub(crate) turns_per_s: Vec<[f64; 2]>,
    pub(crate) target_nm: Vec<[f64; 2]>,
    pub(crate) torque_nm: Vec<[f64; 2]>,
    /// Carriage from the motors: x, y, vx, vy.
    pub(crate) carriage: Vec<[f64; 4]>,
    pub(crate) frames: Vec<Frame>,
    /// Peg as the estimator has it, every 20 ms: x, y, vx, vy.
    pub(crate) state: Vec<[f64; 4]>,
}

/// Reads the sensors. With a silent rig nothing but deliberate effects is in the result.
pub(crate) fn observe(rig: &Gantry, trace: &Trace, draw: &mut Draw) -> Observation {
    let mut out = Observation { commands: trace.commands.clone(), ..Observation::default() };
    read_motors(rig, trace, draw, &mut out);
    if rig.camera {
        out.frames = read_camera(rig, trace, draw);
    }
    if rig.board_state {
        out.state = estimate(rig, trace, draw);
    }
    out
}

fn read_motors(rig: &Gantry, trace: &Trace, draw: &mut Draw, out: &mut Observation) {
    let s = &rig.sensors;
    let silent = s.velocity_noise <= 0.0;
    for sample in 0..trace.belt.len() {
        let mut turns = [0.0; 2];
        let mut rate = [0.0; 2];
        let mut torque = [0.0; 2];
        for m in 0..2 {
            let exact = trace.belt[sample][m] / BELT_PER_TURN;
            turns[m] = if silent { exact } else { (exact * COUNTS).round() / COUNTS };
            let noise = if silent { 0.0 } else { s.velocity_noise * draw.normal() };
            rate[m] = (trace.speed[sample][m] + noise) / BELT_PER_TURN;
            let noise = if silent { 0.0 } else { s.torque_noise * draw.normal() };
            torque[m] = trace.force[sample][m] / BELT_PER_TORQUE + noise;
        }
        out.turns.push(turns);
        out.turns_per_s.push(rate);
        out.torque_nm.push(torque);
        out.target_nm.push(trace.target[sample].map(|force| force / BELT_PER_TORQUE));
        let half = 0.5 * BELT_PER_TURN;
        out.carriage.push([
            HOME[0] + half * (turns[0] + turns[1]),
            HOME[1] + half * (turns[0] - turns[1]),
            half * (rate[0] + rate[1]),
            half * (rate[0] - rate[1]),
        ]);
    }
}

/// What the lens makes of a point of the board.
fn lens(rig: &Gantry, p: [f64; 2]) -> [f64; 2] {
    let s = &rig.sensors;
    let sheared = [p[0] + rig.frame.squareness * p[1], p[1]];
    let r2 = (sheared[0] * sheared[0] + sheared[1] * sheared[1]) / (EDGE * EDGE);
    let scale = (1.0 + s.scale_error) * (1.0 + s.distortion * r2);
    let (sin, cos) = s.rotation.sin_cos();
    [scale * (cos * sheared[0] - sin * sheared[1]), scale * (sin * sheared[0] + cos * sheared[1])]
}

fn read_camera(rig: &Gantry, trace: &Trace, draw: &mut Draw) -> Vec<Frame> {
    let s = &rig.sensors;
    let count = (duration(trace) * CAMERA_RATE).floor() as usize;
    let mut noise = [0, 1].map(|_| Coloured::new(s.camera_noise, s.camera_rho));
    let mut frames: Vec<Frame> = Vec::new();
    for index in 0..count {
        let nominal = index as f64 / CAMERA_RATE;
        let jitter = if s.jitter > 0.0 { s.jitter * draw.normal() } else { 0.0 };
        let mut at = lens(rig, trace.seen_at((nominal - s.latency + jitter).max(0.0)));
        for (axis, noise) in noise.iter_mut().enumerate() {
            at[axis] += noise.next(draw);
        }
        if s.outliers > 0.0 && draw.chance(s.outliers) {
            let to = |draw: &mut Draw| draw.sign() * draw.uniform(0.01, 0.06);
            at = [at[0] + to(draw), at[1] + to(draw)];
        }
        if s.drop > 0.0 && draw.chance(s.drop) {
            if draw.chance(0.5) {
                continue;
            }
            at = frames.last().map_or(at, |frame| frame.at);
        }
        frames.push(Frame { index, time: nominal * (1.0 + s.skew), at });
    }
    frames
}

/// Steps of the board's filter within one of its periods: those of the simulation.
const INNER: u32 = 100;

/// The board's filter: position with little noise, velocity of first order, a dead zone.
fn estimate(rig: &Gantry, trace: &Trace, draw: &mut Draw) -> Vec<[f64; 4]> {
    let s = &rig.sensors;
    let silent = s.camera_noise <= 0.0;
    let period = crate::plan::PERIOD;
    let mut slow = [0.0; 2];
    let mut out = Vec::new();
    let step = period / f64::from(INNER);
    for index in 0..trace.commands.len() {
        let now = index as f64 * period;
        let at = lens(rig, trace.seen_at(now));
        let mut state = [at[0], at[1], 0.0, 0.0];
        for part in 1..=INNER {
            let time = now - period + step * f64::from(part);
            let (p, q) = (trace.seen_at(time - step), trace.seen_at(time));
            for axis in 0..2 {
                let speed = if time < step { 0.0 } else { (q[axis] - p[axis]) / step };
                let share =
                    if s.estimator_lag > 0.0 { 1.0 - (-step / s.estimator_lag).exp() } else { 1.0 };
                slow[axis] += share * (speed - slow[axis]);
            }
        }
        for axis in 0..2 {
            let noise =
                if silent { [0.0; 2] } else { [1e-4 * draw.normal(), 2e-3 * draw.normal()] };
            state[axis] += noise[0];
            state[2 + axis] = slow[axis] + noise[1];
        }
        if s.deadzone > 0.0 && state[2].hypot(state[3]) < s.deadzone {
            state[2] = 0.0;
            state[3] = 0.0;
        }
        out.push(state);
    }
    out
}

/// Carriage by the motors at `time`, between samples (m).
pub(crate) fn carriage_at(o: &Observation, time: f64, axis: usize) -> f64 {
    let last = o.carriage.len() - 1;
    let at = (time / SAMPLE).clamp(0.0, last as f64);
    let (index, part) = (at.floor() as usize, at.fract());
    let (p, q) = (o.carriage[index][axis], o.carriage[(index + 1).min(last)][axis]);
    p + part * (q - p)
}
