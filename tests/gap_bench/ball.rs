//! The ball rig of the bench: free rolls with wall bounces.
//!
//! Event-driven: flights of at most 0.25 ms, cut at the walls. Zero means off for every effect.

use crate::{
    draw::{Coloured, Draw},
    linear::{fit, left},
    observe::CAMERA_RATE,
};

/// Half the board (m), radius of the ball (m).
pub(crate) const HALF_BOARD: [f64; 2] = [0.16, 0.21];
pub(crate) const RADIUS: f64 = 0.007;
/// Rolls per session, their length and pause (s).
pub(crate) const ROLLS: usize = 16;
pub(crate) const ROLL: f64 = 2.5;
pub(crate) const PAUSE: f64 = 0.5;
const GRAVITY: f64 = 9.81;
const STEP: f64 = 2.5e-4;

/// Ball, board, walls and camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct BallRig {
    pub(crate) rolling: f64,
    pub(crate) drag: f64,
    pub(crate) tilt: [f64; 2],
    /// Depth of the sag at the middle (m).
    pub(crate) sag: f64,
    /// Additional rolling resistance within the patch.
    pub(crate) patch: f64,
    pub(crate) patch_at: [f64; 2],
    pub(crate) sliding: f64,
    pub(crate) restitution: f64,
    /// Fall of the restitution with speed (s/m).
    pub(crate) restitution_slope: f64,
    pub(crate) wall_friction: f64,
    /// Shift of the +x wall (m), outwards.
    pub(crate) wall_shift: f64,
    pub(crate) distortion: f64,
    pub(crate) camera_noise: f64,
    pub(crate) camera_rho: f64,
    pub(crate) outliers: f64,
    pub(crate) drop: f64,
    /// Deceleration per speed (1/s): none of the rigs has it, but the plain twin may take it for something else.
    pub(crate) viscous: f64,
    /// Sideways acceleration that comes and goes with time (m/s2), known to no catalogue.
    pub(crate) gust: f64,
    /// Swirl about the middle (1/s2), known to no catalogue.
    pub(crate) swirl: f64,
}

/// Radius of the patch (m).
pub(crate) const PATCH_RADIUS: f64 = 0.035;

impl BallRig {
    pub(crate) fn new(seed: u64, index: usize) -> Self {
        let mut draw = Draw::new(seed, &format!("ball rig {index}"));
        Self {
            rolling: draw.uniform(0.006, 0.014),
            restitution: draw.uniform(0.72, 0.86),
            patch_at: [draw.uniform(-0.06, 0.06), draw.uniform(-0.09, 0.09)],
            camera_noise: 2.5e-4,
            ..Self::default()
        }
    }
}

/// Where a roll begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub(crate) at: [f64; 2],
    pub(crate) velocity: [f64; 2],
    /// Spin about the vertical (rad/s).
    pub(crate) spin: f64,
}

/// What the rolls can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rolls {
    /// All speeds and directions.
    Full,
    /// All at one speed, straight at the end walls.
    OneSpeed,
    /// Too slow to reach a wall.
    NoWalls,
}

/// The rolls of one session.
pub(crate) fn starts(rolls: Rolls, pace: f64, draw: &mut Draw) -> Vec<Start> {
    (0..ROLLS)
        .map(|index| {
            let along = std::f64::consts::TAU * (index as f64 + draw.unit()) / ROLLS as f64;
            let mut at = [draw.uniform(-0.12, 0.12), draw.uniform(-0.17, 0.17)];
            let mut speed = draw.uniform(0.35, 1.7) * pace;
            let mut direction = [along.cos(), along.sin()];
            let spin = draw.uniform(-25.0, 25.0);
            match rolls {
                Rolls::Full => {}
                Rolls::OneSpeed => {
                    speed = 0.62;
                    let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
                    direction = [0.05 * sign, sign];
                    at[1] = 0.02 * sign;
                }
                Rolls::NoWalls => {
                    speed = 0.10 * pace;
                    at = [0.3 * at[0], 0.3 * at[1]];
                }
            }
            Start { at, velocity: [speed * direction[0], speed * direction[1]], spin }
        })
        .collect()
}

#[derive(Debug, Clone, Copy)]
struct Ball {
    at: [f64; 2],
    v: [f64; 2],
    /// Speed of the surface by rolling (m/s); equals `v` when it rolls.
    surface: [f64; 2],
    spin: f64,
    time: f64,
}

/// Positions at the camera's rate, without noise.
pub(crate) fn roll(rig: &BallRig, start: Start, session_time: f64) -> Vec<[f64; 2]> {
    let mut ball = Ball {
        at: start.at,
        v: start.velocity,
        surface: start.velocity,
        spin: start.spin,
        time: 0.0,
    };
    if rig.sliding > 0.0 {
        ball.surface = [0.0; 2];
    }
    let frames = (ROLL * CAMERA_RATE).round() as usize;
    let mut out = Vec::with_capacity(frames);
    for frame in 0..frames {
        let until = frame as f64 / CAMERA_RATE;
        while ball.time + 1e-9 < until {
            let step = STEP.min(until - ball.time);
            advance(rig, &mut ball, step, session_time);
        }
        out.push(ball.at);
    }
    out
}

fn acceleration(rig: &BallRig, ball: &Ball, session_time: f64) -> [f64; 2] {
    let speed = ball.v[0].hypot(ball.v[1]);
    let mut out = [0.0; 2];
    let off = [ball.at[0] - rig.patch_at[0], ball.at[1] - rig.patch_at[1]];
    let distance = off[0].hypot(off[1]) / PATCH_RADIUS;
    let patch = rig.patch * if distance < 1.0 { (1.0 - distance * distance).powi(2) } else { 0.0 };
    let resistance = GRAVITY * (rig.rolling + patch);
    for axis in 0..2 {
        out[axis] += GRAVITY * rig.tilt[axis];
        out[axis] -= 2.0 * GRAVITY * rig.sag * ball.at[axis] / HALF_BOARD[axis].powi(2);
    }
    let now = session_time + ball.time;
    out[0] += rig.gust * (2.1 * now).sin();
    out[1] += rig.gust * (3.7 * now).cos();
    out[0] -= rig.swirl * ball.at[1];
    out[1] += rig.swirl * ball.at[0];
    if 1e-6 < speed {
        for (axis, out) in out.iter_mut().enumerate() {
            *out -= (resistance / speed + rig.viscous + rig.drag * speed) * ball.v[axis];
        }
    }
    out
}

fn advance(rig: &BallRig, ball: &mut Ball, step: f64, session_time: f64) {
    let mut a = acceleration(rig, ball, session_time);
    let mut gripped = [0.0; 2];
    if rig.sliding > 0.0 {
        let slip = [ball.v[0] - ball.surface[0], ball.v[1] - ball.surface[1]];
        let size = slip[0].hypot(slip[1]);
        // Slip falls by 7/2 mu g; it ends within this step when it is smaller than that.
        let grip = (rig.sliding * GRAVITY).min(size / (3.5 * step));
        for axis in 0..2 {
            let share = if size > 0.0 { slip[axis] / size } else { 0.0 };
            a[axis] -= grip * share;
            gripped[axis] = step * grip * share;
        }
    }
    let mut next = [ball.v[0] + step * a[0], ball.v[1] + step * a[1]];
    let push = GRAVITY * rig.rolling;
    let pulled = (a[0] + push * unit(ball.v)[0]).hypot(a[1] + push * unit(ball.v)[1]);
    if next[0] * ball.v[0] + next[1] * ball.v[1] < 0.0 && pulled < push {
        next = [0.0; 2];
    }
    for axis in 0..2 {
        if rig.sliding <= 0.0 {
            ball.surface[axis] = next[axis];
        } else {
            // What does not come from the grip changes roll and travel alike.
            ball.surface[axis] += next[axis] - ball.v[axis] + gripped[axis] + 2.5 * gripped[axis];
        }
        ball.at[axis] += 0.5 * step * (ball.v[axis] + next[axis]);
    }
    ball.v = next;
    ball.spin *= 1.0 - 0.4 * step;
    ball.time += step;
    for axis in 0..2 {
        bounce(rig, ball, axis);
    }
}

fn unit(v: [f64; 2]) -> [f64; 2] {
    let size = v[0].hypot(v[1]);
    if size > 1e-9 { [v[0] / size, v[1] / size] } else { [0.0; 2] }
}

/// Reflection at the walls of `axis`, with what it has overshot mirrored at the rebound speed.
fn bounce(rig: &BallRig, ball: &mut Ball, axis: usize) {
    for side in [-1.0, 1.0] {
        let shift = if axis == 0 && side > 0.0 { rig.wall_shift } else { 0.0 };
        let wall = HALF_BOARD[axis] - RADIUS + shift;
        let beyond = side * ball.at[axis] - wall;
        let into = side * ball.v[axis];
        if beyond <= 0.0 || into <= 0.0 {
            continue;
        }
        let e = (rig.restitution - rig.restitution_slope * into).clamp(0.2, 0.98);
        ball.at[axis] = side * (wall - e * beyond);
        ball.v[axis] = -side * e * into;
        let along = 1 - axis;
        // Tangent of the wall, turned so that a positive spin adds to the contact's speed.
        let turn = if axis == 0 { side } else { -side };
        let contact = ball.v[along] + turn * RADIUS * ball.spin;
        let most = rig.wall_friction * (1.0 + e) * into;
        let change = -(2.0 / 7.0 * contact.abs()).min(most) * contact.signum();
        ball.v[along] += change;
        ball.spin += 2.5 * turn * change / RADIUS;
        if rig.sliding <= 0.0 {
            ball.surface = ball.v;
        }
    }
}

/// One frame of the overhead camera: time within the session (s) and the ball.
pub(crate) type BallFrame = (f64, [f64; 2]);

/// All rolls of a session as the camera has them.
pub(crate) fn session(rig: &BallRig, starts: &[Start], draw: &mut Draw) -> Vec<Vec<BallFrame>> {
    let mut noise = [0, 1].map(|_| Coloured::new(rig.camera_noise, rig.camera_rho));
    let mut out = Vec::new();
    for (index, start) in starts.iter().enumerate() {
        let from = index as f64 * (ROLL + PAUSE);
        let mut frames: Vec<BallFrame> = Vec::new();
        for (frame, at) in roll(rig, *start, from).into_iter().enumerate() {
            let r2 = (at[0] * at[0] + at[1] * at[1]) / (0.21 * 0.21);
            let scale = 1.0 + rig.distortion * r2;
            let mut seen = [scale * at[0], scale * at[1]];
            for (axis, noise) in noise.iter_mut().enumerate() {
                seen[axis] += noise.next(draw);
            }
            if rig.outliers > 0.0 && draw.chance(rig.outliers) {
                seen = [
                    seen[0] + draw.sign() * draw.uniform(0.01, 0.06),
                    seen[1] + draw.sign() * draw.uniform(0.01, 0.06),
                ];
            }
            if rig.drop > 0.0 && draw.chance(rig.drop) {
                if draw.chance(0.5) {
                    continue;
                }
                seen = frames.last().map_or(seen, |last| last.1);
            }
            frames.push((from + frame as f64 / CAMERA_RATE, seen));
        }
        out.push(frames);
    }
    out
}

/// A number of the rig that the plain twin has: what a refit of it imitates is no evidence for an effect.
pub(crate) type Knob = fn(&mut BallRig, f64);

/// Resistance and restitution, but for those that the effect `spec` itself changes.
pub(crate) fn imitators(spec: &BallSpec) -> Vec<Knob> {
    let knobs: [(&str, Knob); 3] = [
        ("ball.rolling_resistance", |rig, by| rig.rolling += by),
        ("", |rig, by| rig.viscous += by),
        ("impact.wall_restitution", |rig, by| rig.restitution += by),
    ];
    knobs.into_iter().filter(|(name, _)| *name != spec.name).map(|(_, knob)| knob).collect()
}

/// How large the difference of two rigs is beside the camera's noise, over the same rolls, when what the
/// twin knows is fitted with it: the place and the velocity at which each roll began, and the numbers of
/// `known`.
pub(crate) fn visibility(plain: &BallRig, with: &BallRig, starts: &[Start], known: &[Knob]) -> f64 {
    let mut rig = with.clone();
    let mut own = starts.to_vec();
    let mut least = f64::INFINITY;
    let mut rows = 0;
    for _ in 0..START_ITERATIONS {
        let rolls: Vec<Rolled> = (0..starts.len())
            .map(|index| Rolled::new((plain, starts[index]), (&rig, own[index]), index, known))
            .collect();
        rows = rolls.iter().map(|roll| roll.gap.len()).sum();
        let sum: f64 = rolls.iter().flat_map(|roll| &roll.gap).map(|gap| gap * gap).sum();
        least = least.min(sum);
        let by = shared_step(&rolls, known.len());
        for (knob, by) in known.iter().zip(&by) {
            knob(&mut rig, *by);
        }
        for (own, roll) in own.iter_mut().zip(&rolls) {
            for (number, by) in roll.local_step(&by).into_iter().enumerate() {
                *own = moved(*own, number, by);
            }
        }
    }
    (least / rows.max(1) as f64).sqrt() / plain.camera_noise.max(1e-6)
}

/// One roll, linearised: what is wanted less what is there, and how that changes with its start and with the
/// numbers of the rig.
struct Rolled {
    gap: Vec<f64>,
    local: Vec<Vec<f64>>,
    shared: Vec<Vec<f64>>,
}

impl Rolled {
    fn new(
        (plain, start): (&BallRig, Start),
        (rig, own): (&BallRig, Start),
        index: usize,
        known: &[Knob],
    ) -> Self {
        let from = index as f64 * (ROLL + PAUSE);
        let now = seen(rig, own, from);
        let local = (0..4)
            .map(|number| per(&seen(rig, moved(own, number, START_STEP), from), &now, START_STEP));
        let shared = known.iter().map(|knob| {
            let mut other = rig.clone();
            knob(&mut other, START_STEP);
            per(&seen(&other, own, from), &now, START_STEP)
        });
        Self {
            gap: per(&seen(plain, start, from), &now, 1.0),
            local: local.collect(),
            shared: shared.collect(),
        }
    }

    /// `column` without what a change of the start makes.
    fn beyond_start(&self, column: &[f64]) -> Vec<f64> {
        let local: Vec<&[f64]> = self.local.iter().map(Vec::as_slice).collect();
        left(&local, column, &fit(&local, column, 0.0))
    }

    /// The start's change when the numbers of the rig change by `by`.
    fn local_step(&self, by: &[f64]) -> Vec<f64> {
        let shared: Vec<&[f64]> = self.shared.iter().map(Vec::as_slice).collect();
        let local: Vec<&[f64]> = self.local.iter().map(Vec::as_slice).collect();
        fit(&local, &left(&shared, &self.gap, by), 0.0)
    }
}

/// The change of the rig's `count` numbers that all rolls together want.
fn shared_step(rolls: &[Rolled], count: usize) -> Vec<f64> {
    let all = |column: fn(&Rolled, usize) -> &[f64], index: usize| -> Vec<f64> {
        rolls.iter().flat_map(|roll| roll.beyond_start(column(roll, index))).collect()
    };
    let columns: Vec<Vec<f64>> =
        (0..count).map(|index| all(|roll, index| &roll.shared[index], index)).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    fit(&columns, &all(|roll, _| &roll.gap, 0), 0.0)
}

/// Step of a start or a number of the rig for its finite differences, and how often the fit is linearised.
const START_STEP: f64 = 1e-5;
const START_ITERATIONS: usize = 6;

/// All x, then all y, of a roll as the camera would have them without noise.
fn seen(rig: &BallRig, start: Start, from: f64) -> Vec<f64> {
    let image = |axis: usize, at: [f64; 2]| {
        at[axis] * (1.0 + rig.distortion * (at[0] * at[0] + at[1] * at[1]) / (0.21 * 0.21))
    };
    let path = roll(rig, start, from);
    (0..2).flat_map(|axis| path.iter().map(move |at| image(axis, *at))).collect()
}

/// `start` with one of its numbers (x, y, vx, vy) changed.
fn moved(mut start: Start, number: usize, by: f64) -> Start {
    let part = if number < 2 { &mut start.at } else { &mut start.velocity };
    part[number % 2] += by;
    start
}

fn per(one: &[f64], other: &[f64], step: f64) -> Vec<f64> {
    one.iter().zip(other).map(|(one, other)| (one - other) / step).collect()
}

/// An effect on the ball rig.
pub(crate) struct BallSpec {
    pub(crate) name: &'static str,
    pub(crate) parameter: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) range: [f64; 2],
    pub(crate) signed: bool,
    pub(crate) known: bool,
    pub(crate) alike: &'static [&'static str],
    pub(crate) apply: fn(&mut BallRig, f64),
    pub(crate) value: fn(&BallRig) -> f64,
}

/// All effects of the ball rig.
pub(crate) static EFFECTS: &[BallSpec] = &[
    BallSpec {
        name: "ball.rolling_resistance",
        parameter: "coefficient",
        unit: "1",
        range: [1e-4, 0.016],
        signed: false,
        known: true,
        alike: &[],
        apply: |rig, m| rig.rolling += m,
        value: |rig| rig.rolling,
    },
    BallSpec {
        name: "ball.air_drag",
        parameter: "coefficient_per_m",
        unit: "1/m",
        range: [0.001, 0.05],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.drag += m,
        value: |rig| rig.drag,
    },
    BallSpec {
        name: "ball.tilt",
        parameter: "slope_rad",
        unit: "rad",
        range: [5e-5, 0.017],
        signed: true,
        known: false,
        alike: &[],
        apply: |rig, m| rig.tilt[0] += m,
        value: |rig| rig.tilt[0],
    },
    BallSpec {
        name: "ball.board_curvature",
        parameter: "sag_m",
        unit: "m",
        range: [2e-5, 2e-3],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.sag += m,
        value: |rig| rig.sag,
    },
    BallSpec {
        name: "ball.stiction_patch",
        parameter: "additional_resistance",
        unit: "1",
        range: [0.002, 0.4],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.patch += m,
        value: |rig| rig.patch,
    },
    BallSpec {
        name: "ball.sliding_phase",
        parameter: "coefficient",
        unit: "1",
        range: [0.05, 0.25],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.sliding += m,
        value: |rig| rig.sliding,
    },
    BallSpec {
        name: "impact.wall_restitution",
        parameter: "restitution",
        unit: "1",
        range: [3e-4, 0.2],
        signed: true,
        known: true,
        alike: &[],
        apply: |rig, m| rig.restitution = (rig.restitution + m).min(0.95),
        value: |rig| rig.restitution,
    },
    BallSpec {
        name: "impact.wall_restitution_speed",
        parameter: "slope_s_per_m",
        unit: "s/m",
        range: [5e-4, 0.3],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.restitution_slope += m,
        value: |rig| rig.restitution_slope,
    },
    BallSpec {
        name: "impact.wall_friction_spin",
        parameter: "coefficient",
        unit: "1",
        range: [0.002, 0.4],
        signed: false,
        known: false,
        alike: &[],
        apply: |rig, m| rig.wall_friction += m,
        value: |rig| rig.wall_friction,
    },
    BallSpec {
        name: "impact.wall_location",
        parameter: "shift_m",
        unit: "m",
        range: [1e-4, 3e-3],
        signed: true,
        known: false,
        alike: &[],
        apply: |rig, m| rig.wall_shift += m,
        value: |rig| rig.wall_shift,
    },
    BallSpec {
        name: "sensor.camera_distortion",
        parameter: "relative_at_edge",
        unit: "1",
        range: [5e-4, 0.1],
        signed: true,
        known: false,
        alike: &["sensor.camera_scale_rotation"],
        apply: |rig, m| rig.distortion += m,
        value: |rig| rig.distortion,
    },
];

/// Finds an effect by name.
pub(crate) fn spec(name: &str) -> &'static BallSpec {
    EFFECTS
        .iter()
        .find(|spec| spec.name == name)
        .unwrap_or_else(|| unreachable!("{name} is not an effect of the ball rig"))
}
