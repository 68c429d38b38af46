//! What others do, on the same recordings: equation-error regression with one column (or a few) per
//! candidate, and five rules that choose. They see the noisy signals, fit on session 1 and
//! validate on session 2, re-fit the known parameters, and start from what they find in
//! the unchanged rig.

use crate::{
    axis::{AxisTrace, LEAD, RATE},
    draw::Draw,
    gantry::{
        BELT_PER_TORQUE, BELT_PER_TURN, ENDSTOP_START, HALF_STROKE, HOME, POSITION_LENGTH,
        TOOTH_PITCH,
    },
    linear::{Columns, fit, rest},
    observe::{Observation, SAMPLE, carriage_at},
};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, f64::consts::TAU};

/// What each rule says about a case.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Said {
    /// Names by rule; empty when the rivals have no machinery for this kind of rig.
    pub(crate) names: BTreeMap<String, Vec<String>>,
    /// Share of the validation error that a black-box network takes away.
    pub(crate) network_gain: Option<f64>,
    /// What is part of the rival's base after it has seen the unchanged rig.
    pub(crate) base: Vec<String>,
}

/// One equation in both sessions.
struct Problem {
    y: [Vec<f64>; 2],
    base: [Columns; 2],
    candidates: Vec<(&'static str, [Columns; 2])>,
}

impl Problem {
    fn new() -> Self {
        Self { y: Default::default(), base: Default::default(), candidates: Vec::new() }
    }

    fn offer(&mut self, session: usize, name: &'static str, columns: Columns) {
        if let Some(known) = self.candidates.iter_mut().find(|known| known.0 == name) {
            known.1[session] = columns;
        } else {
            let mut both: [Columns; 2] = Default::default();
            both[session] = columns;
            self.candidates.push((name, both));
        }
    }

    fn columns<'a>(&'a self, session: usize, more: &'a [Vec<f64>]) -> Vec<&'a [f64]> {
        self.base[session].iter().chain(more).map(Vec::as_slice).collect()
    }

    /// Residual sums of squares, fitted and validated, of base plus `more`.
    fn judge(&self, more: [&[Vec<f64>]; 2], ridge: f64) -> [f64; 2] {
        let train = self.columns(0, more[0]);
        let k = fit(&train, &self.y[0], ridge);
        let validation = self.columns(1, more[1]);
        [rest(&train, &self.y[0], &k), rest(&validation, &self.y[1], &k)]
    }
}

impl Problem {
    /// Makes a candidate part of the base.
    fn adopt(&mut self, name: &str) {
        if let Some(index) = self.candidates.iter().position(|candidate| candidate.0 == name) {
            let (_, columns) = self.candidates.remove(index);
            for (base, more) in self.base.iter_mut().zip(columns) {
                base.extend(more);
            }
        }
    }

    /// The candidate that lowers the validation error most, when that is more than `share`.
    fn most_useful(&self, share: f64) -> Option<&'static str> {
        let none: &[Vec<f64>] = &[];
        let plain = self.judge([none, none], 0.0)[1];
        let gain = |columns: &[Columns; 2]| {
            1.0 - (self.judge([&columns[0], &columns[1]], 0.0)[1] / plain).sqrt()
        };
        self.candidates
            .iter()
            .map(|(name, columns)| (gain(columns), *name))
            .filter(|(gain, _)| share < *gain)
            .max_by(|p, q| p.0.total_cmp(&q.0))
            .map(|(_, name)| name)
    }
}

const LOWEST: &str = "lowest validation error";
const BIC: &str = "BIC";
const THRESHOLD: &str = "sequentially thresholded least squares";
const GATE: &str = "5 % gate";

/// Standardised coefficient below which a term is dropped, and share of a fixed gate.
const STLSQ_THRESHOLD: f64 = 0.05;
const GATE_SHARE: f64 = 0.05;

fn decide(problems: &[Problem]) -> Said {
    let mut best: [Option<(f64, &str)>; 3] = [None; 3];
    let mut offer = |rule: usize, merit: f64, name: &'static str| {
        if 0.0 < merit && best[rule].is_none_or(|(held, _)| held < merit) {
            best[rule] = Some((merit, name));
        }
    };
    let mut surviving = Vec::new();
    let mut network: f64 = 0.0;
    for problem in problems.iter().filter(|p| !p.y[0].is_empty() && !p.y[1].is_empty()) {
        let none: &[Vec<f64>] = &[];
        let plain = problem.judge([none, none], 0.0);
        let n = problem.y[0].len() as f64;
        for (name, columns) in &problem.candidates {
            let with = problem.judge([&columns[0], &columns[1]], 0.0);
            let gain = 1.0 - (with[1] / plain[1]).sqrt();
            offer(0, gain, name);
            let bic = n * (plain[0] / with[0]).ln() - columns[0].len() as f64 * n.ln();
            offer(1, bic, name);
            offer(2, gain - GATE_SHARE, name);
        }
        surviving.extend(threshold(problem));
        network = network.max(random_features(problem, plain[1]));
    }
    let one = |rule: usize| best[rule].map(|(_, name)| name.to_owned()).into_iter().collect();
    surviving.sort();
    surviving.dedup();
    let names = [
        (LOWEST.to_owned(), one(0)),
        (BIC.to_owned(), one(1)),
        (GATE.to_owned(), one(2)),
        (THRESHOLD.to_owned(), surviving),
    ];
    Said { names: names.into(), network_gain: Some(network), base: Vec::new() }
}

/// Smallest gain on the unchanged rig that puts a term into the rival's base.
const OWN_SHARE: f64 = 0.02;
/// Most terms that go there per equation.
const OWN_MOST: usize = 6;

/// The rival's turn at a case: what it knows of the rig goes into its base, then it decides. On
/// the unchanged rig (`known` is `None`) it learns what belongs there, term by term.
fn answer(mut problems: Vec<Problem>, known: Option<&[String]>) -> Said {
    let mut base: Vec<String> = known.unwrap_or_default().to_vec();
    for problem in &mut problems {
        for name in &base {
            problem.adopt(name);
        }
    }
    if known.is_none() {
        for problem in &mut problems {
            for _ in 0..OWN_MOST {
                let Some(name) = problem.most_useful(OWN_SHARE) else { break };
                problem.adopt(name);
                base.push(name.to_owned());
            }
        }
        base.sort();
        base.dedup();
    }
    Said { base, ..decide(&problems) }
}

/// Terms that are left when small ones are dropped again and again.
fn threshold(problem: &Problem) -> Vec<String> {
    let y = &problem.y[0];
    let spread = |c: &[f64]| (c.iter().map(|v| v * v).sum::<f64>() / c.len() as f64).sqrt();
    let scale = spread(y).max(1e-12);
    let mut alive: Vec<(usize, usize)> = Vec::new();
    for (index, (_, columns)) in problem.candidates.iter().enumerate() {
        alive.extend((0..columns[0].len()).map(|column| (index, column)));
    }
    for _ in 0..10 {
        let mut all = problem.columns(0, &[]);
        all.extend(alive.iter().map(|(i, c)| problem.candidates[*i].1[0][*c].as_slice()));
        let k = fit(&all, y, 1e-6);
        let before = alive.len();
        let first = problem.base[0].len();
        let mut position = first;
        alive.retain(|_| {
            let size = k[position].abs() * spread(all[position]) / scale;
            position += 1;
            STLSQ_THRESHOLD < size
        });
        if alive.len() == before {
            break;
        }
    }
    alive.iter().map(|(index, _)| problem.candidates[*index].0.to_owned()).collect()
}

/// Share of the validation error that 40 random features of the base columns take away.
fn random_features(problem: &Problem, plain: f64) -> f64 {
    let mut draw = Draw::new(0, "random features");
    let spread: Vec<f64> = problem.base[0]
        .iter()
        .map(|c| (c.iter().map(|v| v * v).sum::<f64>() / c.len() as f64).sqrt().max(1e-9))
        .collect();
    let weights: Vec<(Vec<f64>, f64)> = (0..40)
        .map(|_| (spread.iter().map(|s| draw.normal() / s).collect(), draw.normal()))
        .collect();
    let hidden = |session: usize| -> Columns {
        let base = &problem.base[session];
        let neuron = |(w, b): &(Vec<f64>, f64)| {
            (0..problem.y[session].len())
                .map(|row| (b + base.iter().zip(w).map(|(c, w)| c[row] * w).sum::<f64>()).tanh())
                .collect()
        };
        weights.iter().map(neuron).collect()
    };
    let (train, validation) = (hidden(0), hidden(1));
    let with = problem.judge([&train, &validation], 1e-3);
    1.0 - (with[1] / plain).sqrt()
}

fn column(n: usize, value: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..n).map(value).collect()
}

fn sign(v: f64) -> f64 {
    (v / 2e-3).tanh()
}

/// Central difference over `2 k` samples.
fn slope(values: &[f64], k: usize, dt: f64) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    column(values.len(), |i| {
        let (p, q) = (i.saturating_sub(k), (i + k).min(last));
        if p == q { 0.0 } else { (values[q] - values[p]) / ((q - p) as f64 * dt) }
    })
}

/// Gantry: forces on x and y, laws of the drives, camera minus carriage.
pub(crate) fn gantry(sessions: &[Observation], known: Option<&[String]>) -> Said {
    if sessions.iter().any(|o| o.turns.len() < 400 || o.commands.is_empty()) {
        return Said::default();
    }
    let mut problems = Vec::new();
    for axis in 0..2 {
        let mut force = Problem::new();
        let mut camera = Problem::new();
        let mut drive = Problem::new();
        for (session, o) in sessions.iter().enumerate() {
            force_equation(&mut force, session, o, axis);
            camera_equation(&mut camera, session, o, axis);
        }
        drive_equation(&mut drive, sessions, axis);
        problems.extend([force, camera, drive]);
    }
    answer(problems, known)
}

fn force_equation(problem: &mut Problem, s: usize, o: &Observation, axis: usize) {
    let n = o.turns.len();
    let side = if axis == 0 { 1.0 } else { -1.0 };
    let f = column(n, |i| (o.torque_nm[i][0] + side * o.torque_nm[i][1]) * BELT_PER_TORQUE);
    let speed = |axis: usize| column(n, |i| o.carriage[i][2 + axis]);
    let v = speed(axis);
    let a = slope(&v, 1, SAMPLE);
    let other = slope(&speed(1 - axis), 1, SAMPLE);
    let jerk = slope(&a, 1, SAMPLE);
    let q = column(n, |i| o.carriage[i][axis] - HOME[axis]);
    let x = column(n, |i| o.carriage[i][0] - HOME[0]);
    let wave = |m: usize, length: f64| -> Columns {
        let at = |i: usize| TAU * o.turns[i][m] * BELT_PER_TURN / length;
        vec![column(n, |i| at(i).sin()), column(n, |i| at(i).cos())]
    };
    let both = |length: f64| [wave(0, length), wave(1, length)].concat();
    let place = |i: usize| TAU * q[i] / POSITION_LENGTH;
    let mut offer = |name, columns| problem.offer(s, name, columns);
    offer("drive.friction.quadratic", vec![column(n, |i| v[i] * v[i].abs())]);
    offer("drive.friction.asymmetric", vec![column(n, |i| v[i].abs())]);
    offer("drive.friction.stribeck", vec![column(n, |i| (-v[i].abs() / 0.012).exp() * sign(v[i]))]);
    offer("drive.friction.presliding", vec![column(n, |i| (v[i] / 0.02).tanh())]);
    offer("drive.friction.load", vec![column(n, |i| a[i].abs() * sign(v[i]))]);
    offer(
        "drive.friction.position",
        vec![
            column(n, |i| place(i).sin() * sign(v[i])),
            column(n, |i| place(i).cos() * sign(v[i])),
        ],
    );
    offer("drive.friction.thermal_drift", vec![column(n, |i| i as f64 / n as f64 * sign(v[i]))]);
    offer("drive.current_loop", vec![jerk]);
    offer("drive.ripple.pulley", both(BELT_PER_TURN));
    offer("drive.ripple.belt_tooth", both(TOOTH_PITCH));
    offer("gantry.cross_coupling", vec![other.clone()]);
    offer("gantry.racking", vec![column(n, |i| x[i] * other[i])]);
    offer("gantry.mass_position", vec![column(n, |i| q[i] / HALF_STROKE[axis] * a[i])]);
    let beyond = |i: usize| (q[i].abs() - ENDSTOP_START[axis]).max(0.0) * q[i].signum();
    offer("gantry.endstop", vec![column(n, beyond)]);
    problem.base[s] = vec![a, column(n, |i| sign(v[i])), vec![1.0; n], v];
    problem.y[s] = f;
    problem.smoothed(s, 1);
}

fn camera_equation(problem: &mut Problem, s: usize, o: &Observation, axis: usize) {
    let n = o.frames.len();
    let last = o.turns.len() - 1;
    let index = |i: usize| ((o.frames[i].time / SAMPLE) as usize).min(last);
    let speeds = column(o.turns.len(), |i| o.carriage[i][2 + axis]);
    let acceleration = slope(&speeds, 1, SAMPLE);
    let v = column(n, |i| speeds[index(i)]);
    let at = |i: usize, axis: usize| carriage_at(o, o.frames[i].time, axis);
    let turn = |i: usize, m: usize| TAU * o.turns[index(i)][m];
    let mut offer = |name, columns| problem.offer(s, name, columns);
    offer("sensor.camera_latency", vec![v.clone()]);
    offer("sensor.camera_scale_rotation", vec![column(n, |i| at(i, 0)), column(n, |i| at(i, 1))]);
    if axis == 0 {
        offer("gantry.squareness", vec![column(n, |i| at(i, 1))]);
    }
    let r2 = |i: usize| at(i, 0).powi(2) + at(i, 1).powi(2);
    offer("sensor.camera_distortion", vec![column(n, |i| at(i, axis) * r2(i))]);
    offer("coupling.magnet_spring", vec![column(n, |i| acceleration[index(i)])]);
    offer("drive.backlash", vec![column(n, |i| sign(v[i]))]);
    offer("sensor.clock_skew", vec![column(n, |i| o.frames[i].time * v[i])]);
    offer(
        "sensor.encoder_eccentricity",
        (0..2)
            .flat_map(|m| [column(n, |i| turn(i, m).sin()), column(n, |i| turn(i, m).cos())])
            .collect(),
    );
    problem.base[s] = vec![vec![1.0; n]];
    problem.y[s] = column(n, |i| o.frames[i].at[axis] - at(i, axis));
}

/// Ramps that are tried for the drive's setpoint (m/s2): first, step, count.
const RAMPS: (f64, f64, usize) = (3.0, 0.25, 70);
/// Milliseconds per sample of the motors.
const FINE: usize = 10;

/// Setpoint of motor `m` at every sample: the command through a ramp, counted in milliseconds.
fn setpoint(o: &Observation, m: usize, ramp: f64) -> Vec<f64> {
    let side = if m == 0 { 1.0 } else { -1.0 };
    let mut now = 0.0;
    let mut out = Vec::with_capacity(o.turns.len());
    for sample in 0..o.turns.len() {
        out.push(now);
        let [x, y] = o.commands[(sample / 2).min(o.commands.len() - 1)];
        for _ in 0..FINE {
            let most = ramp * SAMPLE / FINE as f64;
            now += (x + side * y - now).clamp(-most, most);
        }
    }
    out
}

fn integral(values: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut last = 0.0;
    let mut out = Vec::with_capacity(values.len());
    for value in values {
        sum += 0.5 * (value + last) * SAMPLE;
        last = *value;
        out.push(sum);
    }
    out
}

/// The drive's law: its torque by the error of the ramped setpoint and the error's integral. The
/// ramp is the one that fits session 1 best, as a refit would have it.
fn drive_equation(problem: &mut Problem, sessions: &[Observation], m: usize) {
    let target = |o: &Observation| column(o.turns.len(), |i| o.target_nm[i][m] * BELT_PER_TORQUE);
    let error = |o: &Observation, ramp: f64| {
        let wanted = setpoint(o, m, ramp);
        column(wanted.len(), |i| wanted[i] - o.turns_per_s[i][m] * BELT_PER_TURN)
    };
    let law = |o: &Observation, ramp: f64| {
        let e = error(o, ramp);
        vec![integral(&e), e, vec![1.0; o.turns.len()]]
    };
    let y = target(&sessions[0]);
    let misfit = |ramp: f64| {
        let columns = law(&sessions[0], ramp);
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        rest(&columns, &y, &fit(&columns, &y, 0.0))
    };
    let ramp = (0..RAMPS.2)
        .map(|step| RAMPS.0 + RAMPS.1 * step as f64)
        .min_by(|p, q| misfit(*p).total_cmp(&misfit(*q)))
        .unwrap_or(RAMPS.0);
    for (s, o) in sessions.iter().enumerate() {
        let wanted = setpoint(o, m, ramp);
        let n = wanted.len();
        let time = column(n, |i| i as f64 * SAMPLE);
        let with = |values: Vec<f64>| vec![integral(&values), values];
        let small = column(n, |i| if wanted[i].abs() < 0.02 { wanted[i] } else { 0.0 });
        let fast = column(n, |i| {
            let v = o.turns_per_s[i][m] * BELT_PER_TURN;
            (o.target_nm[i][m] * v).max(0.0) * v.signum()
        });
        let mut offer = |name, columns| problem.offer(s, name, columns);
        offer("drive.gain", with(wanted.clone()));
        offer("drive.offset", vec![time]);
        offer("drive.delay", with(slope(&wanted, 1, SAMPLE)));
        offer("drive.input_deadband", with(small));
        offer("drive.saturation.torque_speed", vec![fast]);
        problem.base[s] = law(o, ramp);
        problem.y[s] = target(o);
    }
}

/// Weights 1, 2, 1 over neighbours: what a central difference does to an acceleration is done to
/// everything beside it.
fn smooth(values: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    column(values.len(), |i| {
        0.25 * (values[i.saturating_sub(1)] + 2.0 * values[i] + values[(i + 1).min(last)])
    })
}

impl Problem {
    /// Smooths session `s`, except for the first base columns, which are central differences.
    fn smoothed(&mut self, s: usize, differences: usize) {
        self.y[s] = smooth(&self.y[s]);
        for column in self.base[s].iter_mut().skip(differences) {
            *column = smooth(column);
        }
        for (_, both) in &mut self.candidates {
            for column in &mut both[s] {
                *column = smooth(column);
            }
        }
    }
}

/// Axis: the force balance at 100 Hz.
pub(crate) fn axis(sessions: &[AxisTrace], known: Option<&[String]>) -> Said {
    let mut problem = Problem::new();
    for (s, trace) in sessions.iter().enumerate() {
        let every = 10;
        let dt = every as f64 / RATE;
        let mean = |values: &[f64]| -> Vec<f64> {
            values.chunks_exact(every).map(|c| c.iter().sum::<f64>() / every as f64).collect()
        };
        let (f, q) = (mean(&trace.force), mean(&trace.position));
        let n = f.len();
        let v = slope(&q, 1, dt);
        let a = slope(&v, 1, dt);
        let jerk = slope(&a, 1, dt);
        let mut offer = |name, columns| problem.offer(s, name, columns);
        offer("drive.friction.asymmetric", vec![column(n, |i| v[i].abs())]);
        offer(
            "drive.friction.stribeck",
            vec![column(n, |i| (-v[i].abs() / 0.008).exp() * sign(v[i]))],
        );
        offer("drive.friction.presliding", vec![column(n, |i| (v[i] / 0.02).tanh())]);
        offer("drive.friction.load", vec![column(n, |i| f[i].abs() * sign(v[i]))]);
        offer("drive.friction.quadratic", vec![column(n, |i| v[i] * v[i].abs())]);
        offer("drive.current_loop", vec![jerk]);
        let turn = |i: usize| TAU * q[i] / LEAD;
        offer(
            "drive.ripple.motor",
            vec![column(n, |i| turn(i).sin()), column(n, |i| turn(i).cos())],
        );
        problem.base[s] = vec![a, column(n, |i| sign(v[i])), vec![1.0; n], v];
        problem.y[s] = f;
        problem.smoothed(s, 1);
    }
    answer(vec![problem], known)
}
