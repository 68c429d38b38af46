//! Where a gap sits: which signal, in which state of the machine.

use super::{
    findings::{NamedEffect, Where},
    problem,
    rounds::Outcome,
};

/// Places of the gap of one link with the given twin, the largest first: per signal its share and
/// the state in which it is concentrated.
#[must_use]
pub(super) fn places(outcome: &Outcome<'_>, effects: &[NamedEffect]) -> Vec<Where> {
    let Some(part) = outcome.train.parts.first() else { return Vec::new() };
    let before = outcome.train.rms(&outcome.start);
    let after = outcome.train.rms(&outcome.last.point);
    let excess: Vec<f64> = before
        .iter()
        .zip(&after)
        .map(|(before, after)| ((before * before - after * after) / (after * after)).max(0.0))
        .collect();
    let total: f64 = excess.iter().sum();
    let residual = problem::predict(part.stage, &outcome.start.twin, &outcome.start.nuisance[0]);
    let residual = part.residual(&residual);
    let mut places: Vec<Where> = part
        .stage
        .channels()
        .iter()
        .enumerate()
        .filter(|(k, _)| 0.0 < excess[*k])
        .map(|(k, channel)| {
            let named = effects
                .iter()
                .find(|effect| outcome.added.iter().any(|step| step.effect.name == effect.name));
            Where {
                domain: named
                    .and_then(|effect| crate::effects::find(&effect.name))
                    .map_or(channel.domain, |effect| effect.domain),
                axis: named
                    .map_or_else(|| channel.axis.to_owned(), |effect| effect.axis.to_string()),
                signal: channel.signal.clone(),
                condition: condition(
                    &channel.times,
                    &channel.measured,
                    &residual[k],
                    &channel.runs,
                ),
                share_of_gap: if 0.0 < total { excess[k] / total } else { 0.0 },
            }
        })
        .collect();
    places.sort_by(|a, b| b.share_of_gap.total_cmp(&a.share_of_gap));
    places
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
