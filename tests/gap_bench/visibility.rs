//! How large an effect is beside the noise: what it changes that fitting the known parameters again cannot
//! imitate.

use crate::{
    catalogue::Sizing,
    gantry::BELT_PER_TURN,
    linear::{fit, left},
    observe::{CAMERA_RATE, Frame, Observation, SAMPLE, carriage_at},
};

/// Window over which a straight line is taken out before an effect is compared with noise (s).
const WINDOW: f64 = 2.0;

/// How an effect shows, as multiples of each signal's noise; the largest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Visibility {
    pub(crate) multiple: f64,
    pub(crate) signal: &'static str,
}

/// Names of the signals in which effects are looked for.
const SIGNALS: [&str; 4] =
    ["motor velocity", "motor torque", "camera minus motors", "estimated velocity"];

/// Noise of each of the signals, a and b or x and y.
pub(crate) type Floors = [[f64; 2]; 4];

/// What differs between two observations of the same commands, signal by signal, with the time
/// between samples.
fn differences(plain: &Observation, with: &Observation, m: usize) -> [(Vec<f64>, f64); 4] {
    let n = plain.turns.len();
    let speed = (0..n)
        .map(|i| (with.turns_per_s[i][m] - plain.turns_per_s[i][m]) * BELT_PER_TURN)
        .collect();
    let torque = (0..n).map(|i| with.torque_nm[i][m] - plain.torque_nm[i][m]).collect();
    let state = plain.state.iter().zip(&with.state).map(|(p, w)| w[2 + m] - p[2 + m]).collect();
    [
        (speed, SAMPLE),
        (torque, SAMPLE),
        (camera_difference(plain, with, m), 1.0 / CAMERA_RATE),
        (state, crate::plan::PERIOD),
    ]
}

/// Noise of every signal: a noisy observation against the silent one of the same commands.
pub(crate) fn floors(silent: &Observation, noisy: &Observation) -> Floors {
    let mut out = [[0.0; 2]; 4];
    for m in 0..2 {
        for (signal, (values, dt)) in differences(silent, noisy, m).iter().enumerate() {
            out[signal][m] = detrended_rms(values, *dt);
        }
    }
    out
}

/// How large the change from `plain` to `with` is beside the noise, when what the twin knows is fitted
/// again: `known` are observations with one known parameter moved a little. All are silent, of the same
/// commands.
pub(crate) fn visibility(
    floors: &Floors,
    plain: &Observation,
    with: &Observation,
    known: &[Observation],
    sizing: Sizing,
) -> Visibility {
    let changes = scaled(floors, plain, with);
    let imitations: Vec<_> = known.iter().map(|other| scaled(floors, plain, other)).collect();
    let imitations: Vec<Vec<f64>> = imitations
        .iter()
        .map(|imitation| {
            let same = |(own, other): (&Change, &Change)| {
                if own.values.len() == other.values.len() {
                    other.values.clone()
                } else {
                    vec![0.0; own.values.len()]
                }
            };
            changes.iter().zip(imitation).flat_map(same).collect()
        })
        .collect();
    let all: Vec<f64> = changes.iter().flat_map(|change| change.values.clone()).collect();
    let rest = beyond(&imitations, &all);
    let mut best = Visibility { multiple: 0.0, signal: "none" };
    let mut from = 0;
    for change in &changes {
        let own = &rest[from..from + change.values.len()];
        from += own.len();
        let multiple =
            if sizing == Sizing::Constant { plain_rms(own) } else { detrended_rms(own, change.dt) };
        if best.multiple < multiple {
            best = Visibility { multiple, signal: change.signal };
        }
    }
    best
}

/// What is left of `change` when multiples of `columns` may imitate it.
pub(crate) fn beyond(columns: &[Vec<f64>], change: &[f64]) -> Vec<f64> {
    let columns: Vec<&[f64]> = columns
        .iter()
        .map(Vec::as_slice)
        .filter(|column| column.iter().any(|value| *value != 0.0))
        .collect();
    left(&columns, change, &fit(&columns, change, 1e-9))
}

/// How one signal changes, in units of its noise.
struct Change {
    signal: &'static str,
    values: Vec<f64>,
    /// Time between samples (s).
    dt: f64,
}

fn scaled(floors: &Floors, plain: &Observation, with: &Observation) -> Vec<Change> {
    let of_one = |m: usize| {
        let all = differences(plain, with, m).into_iter().enumerate();
        all.map(move |(signal, (values, dt))| {
            let floor = floors[signal][m].max(1e-12);
            let values = values.iter().map(|value| value / floor).collect();
            Change { signal: SIGNALS[signal], values, dt }
        })
    };
    (0..2).flat_map(of_one).collect()
}

/// Camera minus carriage, with the effect minus without, frame by frame (m).
fn camera_difference(plain: &Observation, with: &Observation, axis: usize) -> Vec<f64> {
    let gap = |o: &Observation, frame: &Frame| frame.at[axis] - carriage_at(o, frame.time, axis);
    let mut plain_frames = plain.frames.iter().peekable();
    let mut out = Vec::new();
    for frame in &with.frames {
        while plain_frames.next_if(|p| p.index < frame.index).is_some() {}
        if let Some(p) = plain_frames.peek().filter(|p| p.index == frame.index) {
            out.push(gap(with, frame) - gap(plain, p));
        }
    }
    out
}

fn plain_rms(values: &[f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// RMS after a straight line has been taken out of every window.
pub(crate) fn detrended_rms(values: &[f64], dt: f64) -> f64 {
    let window = ((WINDOW / dt).round() as usize).max(4);
    let mut sum = 0.0;
    let mut count = 0usize;
    for part in values.chunks(window).filter(|part| 3 < part.len()) {
        let n = part.len() as f64;
        let middle = 0.5 * (n - 1.0);
        let mean = part.iter().sum::<f64>() / n;
        let (mut up, mut across) = (0.0, 0.0);
        for (i, value) in part.iter().enumerate() {
            let t = i as f64 - middle;
            up += t * (value - mean);
            across += t * t;
        }
        let slope = up / across;
        for (i, value) in part.iter().enumerate() {
            let rest = value - mean - slope * (i as f64 - middle);
            sum += rest * rest;
        }
        count += part.len();
    }
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}
