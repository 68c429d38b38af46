//! Localization of the residual: signal and state of motion.

use super::{
    findings::{IdentifiedEffect, Localization},
    rounds::Outcome,
};
use crate::{effects::find, twin::Channel};

/// Signals that hold the residual of the given twin over all stages, the largest fraction first, each with the state of
/// motion in which it is concentrated. The weight of a signal is its squared residual above its reference residual, or
/// above its final residual where that is smaller, in units of the same.
#[must_use]
pub(super) fn localization(
    outcomes: &[Outcome<'_>],
    effects: &[IdentifiedEffect],
) -> Vec<Localization> {
    let mut localizations: Vec<(f64, Localization)> =
        outcomes.iter().flat_map(|outcome| localizations_of(outcome, effects)).collect();
    let total: f64 = localizations.iter().map(|(excess, _)| excess).sum();
    localizations.sort_by(|a, b| b.0.total_cmp(&a.0));
    localizations
        .into_iter()
        .map(|(excess, place)| Localization { fraction: excess / total, ..place })
        .collect()
}

/// Signals of one stage, each with its excess; the fractions are not computed yet.
fn localizations_of(
    outcome: &Outcome<'_>,
    effects: &[IdentifiedEffect],
) -> Vec<(f64, Localization)> {
    let Some(part) = outcome.train.parts.first() else { return Vec::new() };
    let before = outcome.train.rms(&outcome.start);
    let after = outcome.train.rms(&outcome.last.point);
    let given = &outcome.start.twin;
    let channels = part.stage.channels();
    let excess = |k: usize| {
        let mut references = given.reference_residuals.iter();
        let known = references.find(|own| own.signal == channels[k].signal);
        let least = known.map_or(after[k], |own| own.residual_rms.min(after[k]));
        ((before[k] / least.max(f64::MIN_POSITIVE)).powi(2) - 1.0).max(0.0)
    };
    let residual = part.predict(given, &outcome.start.nuisance[0]);
    let residual = part.residual(&residual);
    let named = effects
        .iter()
        .find(|effect| outcome.added.iter().any(|step| step.effect.name == effect.name));
    let domain = named.and_then(|named| find(&named.name)).map(|effect| effect.domain);
    let place = |k: usize, channel: &Channel| Localization {
        stage: domain.unwrap_or(channel.domain),
        location: named
            .map_or_else(|| channel.axis.to_owned(), |effect| effect.location.to_string()),
        signal: channel.signal.clone(),
        condition: condition(&channel.times, &channel.measured, &residual[k], &channel.runs),
        fraction: 0.0,
    };
    let of_all = channels.iter().enumerate().map(|(k, channel)| (excess(k), k, channel));
    let with_gap = of_all.filter(|(excess, ..)| 0.0 < *excess);
    with_gap.map(|(excess, k, channel)| (excess, place(k, channel))).collect()
}

/// State of motion with the largest mean squared residual.
fn condition(
    times: &[f64],
    measured: &[f64],
    residual: &[f64],
    runs: &[std::ops::Range<usize>],
) -> String {
    let fastest =
        measured.iter().filter(|v| v.is_finite()).fold(0.0_f64, |top, v| top.max(v.abs()));
    let mut bins = [
        ("everywhere", 0.0, 0_usize),
        ("in accelerations", 0.0, 0),
        ("at reversals", 0.0, 0),
        ("at high speed", 0.0, 0),
    ];
    let mut slopes: Vec<f64> = Vec::new();
    for run in runs {
        for k in run.start + 1..run.end {
            slopes.push(((measured[k] - measured[k - 1]) / (times[k] - times[k - 1])).abs());
        }
    }
    let steep = crate::stats::quantile(&slopes, 0.85).unwrap_or(f64::INFINITY);
    for run in runs {
        for k in run.start + 1..run.end {
            if !residual[k].is_finite() {
                continue;
            }
            let slope = ((measured[k] - measured[k - 1]) / (times[k] - times[k - 1])).abs();
            let reverses = measured[run.start.max(k.saturating_sub(8))] * measured[k] < 0.0;
            let mut put = |bin: usize| {
                bins[bin].1 += residual[k] * residual[k];
                bins[bin].2 += 1;
            };
            put(0);
            if steep < slope {
                put(1);
            }
            if reverses {
                put(2);
            }
            if 0.7 * fastest < measured[k].abs() {
                put(3);
            }
        }
    }
    let density = |bin: &(&str, f64, usize)| bin.1 / bin.2.max(1) as f64;
    let all = density(&bins[0]);
    bins[1..]
        .iter()
        .filter(|bin| 20 < bin.2 && 1.5 * all < density(bin))
        .max_by(|a, b| density(a).total_cmp(&density(b)))
        .map_or_else(
            || "everywhere".to_owned(),
            |bin| {
                format!(
                    "{} ({:.0} % of the squared residual)",
                    bin.0,
                    100.0 * bin.1 / bins[0].1.max(f64::MIN_POSITIVE)
                )
            },
        )
}
