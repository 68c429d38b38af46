//! Isolability of effects by a recorded motion: the detectable effects, their signals, and the effects that it cannot
//! separate. The method is fault isolability (Krysander and Frisk, IEEE Transactions on Systems, Man, and Cybernetics A
//! 38, 2008), by simulation.
//!
//! Every effect is switched on at the values where the search begins. The whitened change of the simulation, beyond the
//! directions of nuisances and known parameters, is its signature. Its length is the detectability in standard
//! deviations. The cosine of two signatures measures their similarity.

use super::{
    batch::in_parallel,
    find::Found,
    numerics::normal::Normal,
    problem::dot,
    rounds::Outcome,
    screen::{self, beyond_known, magnitude_ratio, pairs},
};
use crate::{
    effects::{Axis, Effect},
    twin::{StageKind, Twin},
};
use serde::Serialize;
use std::collections::BTreeMap;

/// Cosine of two signatures from which the motion does not separate their effects.
const INSEPARABLE: f64 = 0.95;

/// Most effects that are listed as inseparable from another one.
const MOST_LISTED: usize = 5;

/// Version of the document.
const SCHEMA_VERSION: u32 = 1;

/// Isolability of the effects of all stages: the document of `klasktron effects --for --json`.
#[derive(Debug, Clone, Serialize)]
pub struct Isolability {
    /// Version of this document.
    pub schema_version: u32,
    /// Stages of the measured chain that were recorded.
    pub stages: Vec<StageIsolability>,
}

/// Isolability of the effects of one stage.
#[derive(Debug, Clone, Serialize)]
pub struct StageIsolability {
    /// Stage of the measured chain.
    pub stage: StageKind,
    /// Number of recordings with this stage that were used.
    pub recordings: usize,
    /// Effects, the most detectable first.
    pub effects: Vec<Signature>,
}

/// Signature of one effect in a motion.
#[derive(Debug, Clone, Serialize)]
pub struct Signature {
    /// Name of the effect.
    pub effect: &'static str,
    /// Axis on which it acts.
    pub location: Axis,
    /// Length of the signature at the largest plausible magnitude, in whitened standard deviations.
    pub detectability: f64,
    /// `true` where the detectability suffices for a test.
    pub is_detectable: bool,
    /// Fraction of the squared signature in each signal, the largest first.
    pub signals: Vec<SignalShare>,
    /// Effects that this motion does not separate from it, the most alike first.
    pub inseparable: Vec<Confusion>,
    /// Motion and sensors that show it.
    pub excitation: &'static str,
}

/// Fraction of a squared signature in one signal.
#[derive(Debug, Clone, Serialize)]
pub struct SignalShare {
    /// Name of the signal.
    pub signal: String,
    /// Fraction, 0 to 1.
    pub fraction: f64,
}

/// Effect with a like signature.
#[derive(Debug, Clone, Serialize)]
pub struct Confusion {
    /// Name of the effect.
    pub effect: &'static str,
    /// Axis on which it acts.
    pub location: Axis,
    /// Absolute cosine of both signatures, at most 1.
    pub cosine: f64,
}

/// Effect on one axis, and its signature.
struct Column {
    effect: &'static Effect,
    axis: Axis,
    values: Vec<f64>,
    length: f64,
    detectability: f64,
}

/// Isolability of all effects on the recordings of `found`, stage by stage.
#[must_use]
pub fn isolability(found: &Found<'_>) -> Isolability {
    let compared = found.outcomes.iter().filter(|outcome| 0 < outcome.train.rows());
    Isolability { schema_version: SCHEMA_VERSION, stages: compared.map(of_stage).collect() }
}

fn of_stage(outcome: &Outcome<'_>) -> StageIsolability {
    let columns = columns(outcome);
    let mut effects: Vec<Signature> =
        columns.iter().map(|own| signature(own, &columns, outcome)).collect();
    effects.sort_by(|a, b| b.detectability.total_cmp(&a.detectability));
    StageIsolability { stage: outcome.kind, recordings: outcome.train.parts.len(), effects }
}

/// Signature of every effect on every axis, at the start of the search that shows it best.
fn columns(outcome: &Outcome<'_>) -> Vec<Column> {
    let (problem, filters) = (&outcome.train, &outcome.filters);
    let twin = &outcome.last.point.twin;
    let base = problem.evaluated(outcome.last.point.clone());
    let known = problem.columns(&base, &outcome.last.slots, filters);
    let linear = problem.linear_of(&base, known, filters);
    let normal = Normal::new(&linear.columns, &linear.residual);
    in_parallel(&pairs(problem, twin), |(effect, axis)| {
        let variants: Vec<Twin> =
            effect.probes.iter().map(|probe| screen::with(twin, effect, *axis, probe)).collect();
        let of_probes = problem.contrasts(&base, &variants, filters);
        let each = of_probes.into_iter().zip(effect.probes).map(|(mut values, probe)| {
            beyond_known(&linear, &normal, &mut values);
            let length = dot(&values, &values).sqrt();
            let detectability = length * magnitude_ratio(effect, probe);
            Column { effect, axis: *axis, values, length, detectability }
        });
        each.max_by(|a, b| a.detectability.total_cmp(&b.detectability))
    })
    .into_iter()
    .flatten()
    .collect()
}

fn signature(own: &Column, all: &[Column], outcome: &Outcome<'_>) -> Signature {
    let detectable = outcome.train.thresholds().detectability;
    let is_detectable = detectable <= own.detectability;
    let cosine = |other: &Column| {
        dot(&own.values, &other.values).abs() / (own.length * other.length).max(f64::MIN_POSITIVE)
    };
    let others = all.iter().filter(|other| {
        !std::ptr::eq(*other, own) && is_detectable && detectable <= other.detectability
    });
    let mut inseparable: Vec<Confusion> = others
        .map(|other| Confusion {
            effect: other.effect.name,
            location: other.axis,
            cosine: cosine(other).min(1.0),
        })
        .filter(|other| INSEPARABLE <= other.cosine)
        .collect();
    inseparable.sort_by(|a, b| b.cosine.total_cmp(&a.cosine));
    inseparable.truncate(MOST_LISTED);
    Signature {
        effect: own.effect.name,
        location: own.axis,
        detectability: own.detectability,
        is_detectable,
        signals: if is_detectable { fractions(own, outcome) } else { Vec::new() },
        inseparable,
        excitation: own.effect.excitation,
    }
}

/// Fraction of the squared signature in each signal.
fn fractions(own: &Column, outcome: &Outcome<'_>) -> Vec<SignalShare> {
    let mut squares: BTreeMap<&str, f64> = BTreeMap::new();
    let mut values = own.values.iter();
    for part in &outcome.train.parts {
        let channels = part.stage.channels();
        for (row, value) in part.layout.rows.iter().zip(&mut values) {
            *squares.entry(&channels[row.channel as usize].signal).or_default() += value * value;
        }
    }
    let total = own.length.powi(2).max(f64::MIN_POSITIVE);
    let mut fractions: Vec<SignalShare> = squares
        .into_iter()
        .map(|(signal, square)| SignalShare { signal: signal.to_owned(), fraction: square / total })
        .collect();
    fractions.sort_by(|a, b| b.fraction.total_cmp(&a.fraction));
    fractions
}
