//! A single axis driven by force, in closed loop along a reference: the kind of machine of which a
//! force and a position are recorded at 1 kHz.

use crate::{
    draw::{Coloured, Draw},
    visibility::{beyond, detrended_rms},
};
use std::f64::consts::TAU;

const STEP: f64 = 1e-4;
/// Samples per second.
pub(crate) const RATE: f64 = 1000.0;
/// Travel per motor turn (m).
pub(crate) const LEAD: f64 = 0.0025;
const STRIBECK_SPEED: f64 = 0.008;

/// Mass, friction, controller and noise.
#[derive(Debug, Clone, Default)]
pub(crate) struct AxisRig {
    pub(crate) mass: f64,
    pub(crate) viscous: f64,
    pub(crate) coulomb: f64,
    pub(crate) offset: f64,
    pub(crate) asymmetry: f64,
    pub(crate) stribeck: f64,
    pub(crate) presliding: f64,
    pub(crate) load: f64,
    pub(crate) ripple: f64,
    /// Time constant from the wanted to the acting force (s).
    pub(crate) current: f64,
    pub(crate) position_gain: f64,
    pub(crate) velocity_gain: f64,
    /// Disturbing force (N, standard deviation) and its correlation per millisecond.
    pub(crate) disturbance: f64,
    pub(crate) disturbance_rho: f64,
    /// Encoder noise (m).
    pub(crate) encoder: f64,
    /// Force at 3.3 Hz that no catalogue lists (N).
    pub(crate) hum: f64,
    /// Force that follows the product of speed and position (N s/m2): in no catalogue.
    pub(crate) twist: f64,
}

impl AxisRig {
    pub(crate) fn new(seed: u64, index: usize) -> Self {
        let mut draw = Draw::new(seed, &format!("axis rig {index}"));
        let mass = draw.uniform(30.0, 120.0);
        Self {
            mass,
            viscous: mass * draw.uniform(1.2, 2.6),
            coulomb: mass * draw.uniform(0.18, 0.35),
            offset: draw.uniform(-4.0, 4.0),
            position_gain: 60.0,
            velocity_gain: 140.0 * mass,
            disturbance: 0.008 * mass,
            disturbance_rho: 0.7,
            encoder: 1e-7,
            ..Self::default()
        }
    }

    /// The same rig with one parameter moved by a hundredth, for each that a plain twin fits.
    pub(crate) fn neighbours(&self) -> [Self; 4] {
        [
            Self { mass: 1.01 * self.mass, ..self.clone() },
            Self { viscous: 1.01 * self.viscous, ..self.clone() },
            Self { coulomb: 1.01 * self.coulomb, ..self.clone() },
            Self { offset: 0.1 + self.offset, ..self.clone() },
        ]
    }

    /// RMS of the force that no model explains (N).
    pub(crate) fn floor(&self) -> f64 {
        self.disturbance
    }
}

/// What a session shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Travel {
    Full,
    /// Only fast strokes.
    Fast,
    /// Only towards +.
    OneWay,
}

/// Reference positions at 1 kHz: strokes with bounded acceleration, several speeds, rests.
pub(crate) fn reference(travel: Travel, seconds: f64, pace: f64, draw: &mut Draw) -> Vec<f64> {
    let count = (seconds * RATE) as usize;
    let mut out = vec![0.0];
    let mut at = 0.0;
    let mut index = 0;
    while out.len() < count {
        let slow = travel == Travel::Full && index % 4 == 3;
        let speed = if slow { draw.uniform(0.004, 0.03) } else { draw.uniform(0.12, 0.32) * pace };
        let length = match travel {
            Travel::OneWay => draw.uniform(0.005, 0.02),
            _ if slow => draw.uniform(0.005, 0.02),
            _ => draw.uniform(0.08, 0.22),
        };
        let up = travel == Travel::OneWay || index % 2 == 0;
        stroke(&mut out, &mut at, if up { length } else { -length }, speed);
        for _ in 0..(draw.uniform(0.05, 0.3) * RATE) as usize {
            out.push(at);
        }
        index += 1;
        if travel != Travel::OneWay && 0.3 < at.abs() {
            let home = -at;
            stroke(&mut out, &mut at, home, 0.2 * pace);
        }
    }
    out.truncate(count);
    out
}

fn stroke(out: &mut Vec<f64>, at: &mut f64, length: f64, speed: f64) {
    let acceleration = 3.0;
    let speed = speed.min((acceleration * length.abs()).sqrt());
    let rise = speed / acceleration;
    let whole = length.abs() / speed + rise;
    let from = *at;
    let steps = (whole * RATE).ceil() as usize;
    for step in 1..=steps {
        let t = (step as f64 / RATE).min(whole);
        let left = whole - t;
        let path = if t < rise {
            0.5 * acceleration * t * t
        } else if left < rise {
            length.abs() - 0.5 * acceleration * left * left
        } else {
            speed * (t - 0.5 * rise)
        };
        out.push(from + length.signum() * path);
    }
    *at = from + length;
}

/// Force (N) and position (m) at 1 kHz.
#[derive(Debug, Clone, Default)]
pub(crate) struct AxisTrace {
    pub(crate) force: Vec<f64>,
    pub(crate) position: Vec<f64>,
}

/// Follows `reference`; `phase` is the ripple's in this session.
pub(crate) fn simulate(rig: &AxisRig, reference: &[f64], phase: f64, draw: &mut Draw) -> AxisTrace {
    let mut trace = AxisTrace::default();
    let (mut q, mut v, mut bristle, mut acting) = (0.0, 0.0, 0.0, 0.0);
    let mut push = Coloured::new(rig.disturbance, rig.disturbance_rho);
    let per_sample = (1.0 / RATE / STEP).round() as usize;
    let mut before = 0.0;
    for (index, wanted) in reference.iter().enumerate() {
        let noise = if rig.encoder > 0.0 { rig.encoder * draw.normal() } else { 0.0 };
        let seen = q + noise;
        let ahead = match reference.get(index + 1) {
            Some(next) => (next - wanted) * RATE,
            None => (wanted - reference[index.saturating_sub(1)]) * RATE,
        };
        let speed = if index == 0 { 0.0 } else { (seen - before) * RATE };
        before = seen;
        let force = rig.velocity_gain * (rig.position_gain * (wanted - seen) + ahead - speed);
        trace.force.push(force);
        trace.position.push(if rig.encoder > 0.0 { (seen / 5e-8).round() * 5e-8 } else { seen });
        let disturbing = push.next(draw);
        let now = index as f64 / RATE;
        for _ in 0..per_sample {
            let share = if rig.current > 0.0 { 1.0 - (-STEP / rig.current).exp() } else { 1.0 };
            acting += share * (force - acting);
            let slope = rig.viscous * (1.0 + rig.asymmetry * f64::signum(v));
            let mut sum = acting + rig.offset + disturbing - slope * v;
            sum += rig.ripple * (TAU * q / LEAD + phase).sin();
            sum += rig.hum * (TAU * 3.3 * now + phase).sin() - rig.twist * v * q;
            let budget = rig.coulomb
                + rig.stribeck * (-f64::abs(v) / STRIBECK_SPEED).exp()
                + rig.load * f64::abs(acting);
            if rig.presliding > 0.0 {
                // Implicit in the bristle: its decay is far faster than a step at speed.
                let decay = STEP * rig.presliding * f64::abs(v) / budget;
                let next = (bristle + STEP * v) / (1.0 + decay);
                let rate = (next - bristle) / STEP;
                bristle = next;
                sum -= rig.presliding * bristle
                    + 2.0 * (rig.presliding * rig.mass).sqrt() * 0.3 * rate;
                v += STEP * sum / rig.mass;
            } else {
                let budget = budget * (1.0 + rig.asymmetry * f64::signum(v));
                let trial: f64 = v + STEP * sum / rig.mass;
                v = trial.signum() * (trial.abs() - STEP * budget / rig.mass).max(0.0);
            }
            q += STEP * v;
        }
    }
    trace
}

/// How large the change of the force is beside the force that nobody explains, when mass, friction and
/// offset may be fitted again; `imitators` are the rigs with these moved, empty where they may not.
pub(crate) fn visibility(
    plain: &AxisRig,
    with: &AxisRig,
    reference: &[f64],
    imitators: &[AxisRig],
) -> f64 {
    let force = |rig: &AxisRig| {
        let silent = AxisRig { disturbance: 0.0, encoder: 0.0, ..rig.clone() };
        simulate(&silent, reference, 0.4, &mut Draw::new(0, "unused")).force
    };
    let base = force(plain);
    let change = |rig: &AxisRig| -> Vec<f64> {
        force(rig).iter().zip(&base).map(|(own, base)| own - base).collect()
    };
    let known: Vec<Vec<f64>> = imitators.iter().map(change).collect();
    detrended_rms(&beyond(&known, &change(with)), 1.0 / RATE) / plain.floor()
}

/// An effect on the axis.
pub(crate) struct AxisSpec {
    pub(crate) name: &'static str,
    pub(crate) parameter: &'static str,
    pub(crate) unit: &'static str,
    /// As a share of what the rig has.
    pub(crate) range: [f64; 2],
    pub(crate) known: bool,
    pub(crate) alike: &'static [&'static str],
    pub(crate) apply: fn(&mut AxisRig, f64),
    pub(crate) value: fn(&AxisRig) -> f64,
}

/// All effects of the axis.
pub(crate) static EFFECTS: &[AxisSpec] = &[
    AxisSpec {
        name: "drive.friction.asymmetric",
        parameter: "asymmetry",
        unit: "1",
        range: [0.005, 0.33],
        known: false,
        alike: &[],
        apply: |rig, m| rig.asymmetry += m,
        value: |rig| rig.asymmetry,
    },
    AxisSpec {
        name: "drive.friction.stribeck",
        parameter: "excess_n",
        unit: "N",
        range: [0.02, 1.0],
        known: false,
        alike: &[],
        apply: |rig, m| rig.stribeck += m * rig.coulomb,
        value: |rig| rig.stribeck,
    },
    AxisSpec {
        name: "drive.ripple.motor",
        parameter: "amplitude_n",
        unit: "N",
        range: [0.005, 0.2],
        known: false,
        alike: &[],
        apply: |rig, m| rig.ripple += m * rig.coulomb,
        value: |rig| rig.ripple,
    },
    AxisSpec {
        name: "drive.current_loop",
        parameter: "time_constant_s",
        unit: "s",
        range: [1e-4, 3e-3],
        known: false,
        alike: &["drive.delay", "drive.lag1"],
        apply: |rig, m| rig.current += m,
        value: |rig| rig.current,
    },
    AxisSpec {
        name: "drive.friction.presliding",
        parameter: "stiffness_n_per_m",
        unit: "N/m",
        range: [1e-7, 1e-4],
        known: false,
        alike: &[],
        apply: |rig, m| rig.presliding = 1.0 / m,
        value: |rig| rig.presliding,
    },
    AxisSpec {
        name: "drive.friction.load",
        parameter: "coefficient",
        unit: "1",
        range: [0.003, 0.3],
        known: false,
        alike: &[],
        apply: |rig, m| rig.load += m,
        value: |rig| rig.load,
    },
    AxisSpec {
        name: "drive.friction.coulomb",
        parameter: "force_n",
        unit: "N",
        range: [0.02, 1.0],
        known: true,
        alike: &[],
        apply: |rig, m| rig.coulomb *= 1.0 + m,
        value: |rig| rig.coulomb,
    },
    AxisSpec {
        name: "drive.friction.viscous",
        parameter: "slope_n_s_per_m",
        unit: "N s/m",
        range: [0.02, 1.0],
        known: true,
        alike: &[],
        apply: |rig, m| rig.viscous *= 1.0 + m,
        value: |rig| rig.viscous,
    },
];

/// Finds an effect by name.
pub(crate) fn spec(name: &str) -> &'static AxisSpec {
    EFFECTS
        .iter()
        .find(|spec| spec.name == name)
        .unwrap_or_else(|| unreachable!("{name} is not an effect of the axis"))
}
