//! Where a gap sits: which signal, in which state of the machine.

use super::{
    findings::{NamedEffect, Where},
    problem,
    rounds::Outcome,
};
use crate::{effects::find, twin::Channel};

/// Places of the gap with the given twin over all links, the largest first: per signal its share and the state in
/// which it is concentrated. A gap is what the squared residual is above what the twin is known to leave of the
/// signal, or above what is left in the end, in units of that.
#[must_use]
pub(super) fn places(outcomes: &[Outcome<'_>], effects: &[NamedEffect]) -> Vec<Where> {
    let mut places: Vec<(f64, Where)> =
        outcomes.iter().flat_map(|outcome| places_of(outcome, effects)).collect();
    let total: f64 = places.iter().map(|(excess, _)| excess).sum();
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    places
        .into_iter()
        .map(|(excess, place)| Where { share_of_gap: excess / total, ..place })
        .collect()
}

/// Places of one link, each with its excess; their shares are not known yet.
fn places_of(outcome: &Outcome<'_>, effects: &[NamedEffect]) -> Vec<(f64, Where)> {
    let Some(part) = outcome.train.parts.first() else { return Vec::new() };
    let before = outcome.train.rms(&outcome.start);
    let after = outcome.train.rms(&outcome.last.point);
    let given = &outcome.start.twin;
    let channels = part.stage.channels();
    let excess = |k: usize| {
        let known = given.left.iter().find(|left| left.signal == channels[k].signal);
        let least = known.map_or(after[k], |left| left.residual_rms.min(after[k]));
        ((before[k] / least.max(f64::MIN_POSITIVE)).powi(2) - 1.0).max(0.0)
    };
    let residual = problem::predict(part.stage, given, &outcome.start.nuisance[0]);
    let residual = part.residual(&residual);
    let named = effects
        .iter()
        .find(|effect| outcome.added.iter().any(|step| step.effect.name == effect.name));
    let domain = named.and_then(|named| find(&named.name)).map(|effect| effect.domain);
    let place = |k: usize, channel: &Channel| Where {
        domain: domain.unwrap_or(channel.domain),
        axis: named.map_or_else(|| channel.axis.to_owned(), |effect| effect.axis.to_string()),
        signal: channel.signal.clone(),
        condition: condition(&channel.times, &channel.measured, &residual[k], &channel.runs),
        share_of_gap: 0.0,
    };
    let of_all = channels.iter().enumerate().map(|(k, channel)| (excess(k), k, channel));
    let with_gap = of_all.filter(|(excess, ..)| 0.0 < *excess);
    with_gap.map(|(excess, k, channel)| (excess, place(k, channel))).collect()
}

/// The state of motion that holds most of the squared residual for its share of time.
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
                    "{} ({:.0} % of the squared gap)",
                    bin.0,
                    100.0 * bin.1 / bins[0].1.max(f64::MIN_POSITIVE)
                )
            },
        )
}
