//! One-off disturbances in one session: a hand on the carriage, an impact at the end of an axis, a cable that snags.
//!
//! A one-off disturbance can hold far more of the squared residual than all recurring effects. No other session can
//! confirm it, and it hides effects that another session could confirm. So the time around it is excluded, and the user
//! gets a warning.

use super::{
    problem::{Part, Point, Problem},
    thresholds::Thresholds,
};
use crate::{
    stats::{half_central_spread, median},
    twin::StageKind,
};
use std::ops::Range;

/// Width of the bins of time in which squared residuals are summed (s).
const BIN: f64 = 0.1;

/// Most one-off disturbances of a session.
const MOST: usize = 3;

/// One-off disturbance.
#[derive(Debug, Clone, PartialEq)]
pub struct Incident {
    /// Signal with the largest residual, relative to its usual residual.
    pub signal: String,
    /// Unit of the signal.
    pub unit: &'static str,
    /// Largest residual of that signal, signed, in that unit.
    pub farthest: f64,
    /// Time (s since the session began).
    pub span: Range<f64>,
}

/// A part and its residual, `[channel][sample]`.
type PartResidual<'p, 'a> = (&'p Part<'a>, Vec<Vec<f64>>);

/// Exclude the one-off disturbances of one stage from the session of `train` or `held_out` in which they are; return
/// whether there were any. Each problem comes with its point. Without a validation session, one-off and recurring
/// disturbances are indistinguishable, and nothing is excluded.
pub(super) fn exclude_from<'a>(
    kind: StageKind,
    train: (&mut Problem<'a>, &Point),
    held_out: (&mut Problem<'a>, &Point),
) -> bool {
    let is_in_pieces = matches!(kind, StageKind::Ball | StageKind::WholeRolls);
    if is_in_pieces || train.0.parts.is_empty() || held_out.0.parts.is_empty() {
        return false;
    }
    let seen: Vec<PartResidual<'_, '_>> = [(&*train.0, train.1), (&*held_out.0, held_out.1)]
        .into_iter()
        .flat_map(|(problem, point)| problem.parts.iter().zip(problem.residuals(point)))
        .collect();
    let Some((session, incidents)) = incidents(&seen, train.0.thresholds()) else { return false };
    log::info!("{kind:?}: left out of session {session}: {incidents:?}");
    let fitted = train.0.parts.len();
    let ((problem, point), index) = match session.checked_sub(fitted) {
        None => (train, session),
        Some(judging) => (held_out, judging),
    };
    problem.parts[index].incidents.extend(incidents);
    problem.drop_outliers(point);
    true
}

/// Session and its few one-off disturbances that hold the fraction `majority` of the squared residual of all sessions
/// and are outliers.
fn incidents(
    seen: &[PartResidual<'_, '_>],
    thresholds: &Thresholds,
) -> Option<(usize, Vec<Incident>)> {
    let held = thresholds.majority;
    let longest = (thresholds.disturbed_time / BIN).round() as usize;
    let usual = usual(seen);
    let energies: Vec<Vec<f64>> = seen.iter().map(|own| energies(own, &usual)).collect();
    let all = energies.concat();
    let (in_a_bin, most_left) = (median(&all)?, (1.0 - held) * all.iter().sum::<f64>());
    let (session, spans) = (0..energies.len()).find_map(|session| {
        let mut left = energies.clone();
        let mut spans = Vec::new();
        let mut least_peak = f64::INFINITY;
        while spans.len() < MOST {
            let (span, peak) = around_largest(&left[session], thresholds.outlier_ratio * in_a_bin);
            left[session].get_mut(span.clone())?.fill(0.0);
            least_peak = least_peak.min(peak);
            spans.push(span);
            let rest = left.concat();
            let largest = rest.iter().copied().fold(0.0, f64::max);
            let stands_out = thresholds.outlier_ratio * largest <= least_peak;
            if stands_out && rest.iter().sum::<f64>() <= most_left {
                return spans.iter().all(|span| span.len() <= longest).then_some((session, spans));
            }
        }
        None
    })?;
    let span = |bins: Range<usize>| bins.start as f64 * BIN..bins.end as f64 * BIN;
    let spans = spans.into_iter().map(span);
    Some((session, spans.map(|span| incident(&seen[session], &usual, span)).collect()))
}

/// Usual residual of each channel over all sessions; never zero.
fn usual(seen: &[PartResidual<'_, '_>]) -> Vec<f64> {
    let channels = seen[0].0.stage.channels().len();
    let of = |channel: usize| {
        let values: Vec<f64> = seen
            .iter()
            .flat_map(|(part, residual)| samples(part).map(move |at| (at, residual)))
            .filter(|((own, _), _)| *own == channel)
            .map(|((_, sample), residual)| residual[channel][sample])
            .collect();
        half_central_spread(&values).unwrap_or(0.0).max(f64::MIN_POSITIVE)
    };
    (0..channels).map(of).collect()
}

/// Channel and sample of every row.
fn samples<'p>(part: &'p Part<'_>) -> impl Iterator<Item = (usize, usize)> + 'p {
    part.layout.rows.iter().map(|row| (row.channel as usize, row.sample as usize))
}

/// Squared residuals summed by bins of time, each in units of the usual residual of its channel.
fn energies((part, residual): &PartResidual<'_, '_>, usual: &[f64]) -> Vec<f64> {
    let mut bins = Vec::new();
    for (channel, sample) in samples(part) {
        let bin = (part.stage.channels()[channel].times[sample].max(0.0) / BIN) as usize;
        if bins.len() <= bin {
            bins.resize(bin + 1, 0.0);
        }
        bins[bin] += (residual[channel][sample] / usual[channel]).powi(2);
    }
    bins
}

/// Bin with the largest sum, its neighbours above `usual`, and one more bin on both sides; and the largest sum.
fn around_largest(bins: &[f64], usual: f64) -> (Range<usize>, f64) {
    let largest = (0..bins.len()).max_by(|a, b| bins[*a].total_cmp(&bins[*b])).unwrap_or(0);
    let before = bins[..largest].iter().rev().take_while(|own| usual < **own).count();
    let after = bins[largest..].iter().take_while(|own| usual < **own).count().max(1);
    let span = (largest - before).saturating_sub(1)..(largest + after + 1).min(bins.len());
    (span, bins.get(largest).copied().unwrap_or(0.0))
}

/// Largest relative residual in `span` (s) of a session.
fn incident((part, residual): &PartResidual<'_, '_>, usual: &[f64], span: Range<f64>) -> Incident {
    let channels = part.stage.channels();
    let (channel, farthest) = channels
        .iter()
        .enumerate()
        .flat_map(|(channel, own)| (0..own.times.len()).map(move |sample| (channel, sample)))
        .filter(|(channel, sample)| span.contains(&channels[*channel].times[*sample]))
        .map(|(channel, sample)| (channel, residual[channel][sample]))
        .filter(|(_, off)| off.is_finite())
        .max_by(|(a, one), (b, other)| {
            (one / usual[*a]).abs().total_cmp(&(other / usual[*b]).abs())
        })
        .unwrap_or_default();
    let (signal, unit) = (channels[channel].signal.clone(), channels[channel].unit);
    Incident { signal, unit, farthest, span }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        gap::test_stage::TestStage,
        seed::Stream,
        twin::{Machine, Stage, Twin},
    };

    /// 30 s at 100 Hz with noise of 1 mm/s, and `off` (m/s) too slow during each of `bursts` (s).
    fn session(seed: u64, bursts: &[Range<f64>], off: f64) -> impl Stage {
        let mut random = Stream::new(seed, "scatter");
        let times: Vec<f64> = (0..3000).map(|k| 0.01 * f64::from(k)).collect();
        let is_off = |time: &f64| bursts.iter().any(|burst| burst.contains(time));
        let noise = times.iter().map(|_| f64::from(random.uniform_f32(-1.7e-3, 1.7e-3)));
        let noise: Vec<f64> = noise.collect();
        let each = times.iter().zip(noise);
        let measured = each.map(|(time, own)| if is_off(time) { own - off } else { own }).collect();
        TestStage::drive(measured, |_, _| 0.0)
    }

    /// Exclusions in two sessions with bursts that are `off` (m/s), and the number of rows that remain.
    fn left_out(off: f64, [first, second]: [&[Range<f64>]; 2]) -> [(Vec<Incident>, usize); 2] {
        let twin = Twin::nominal(Machine::Table);
        let stages = [session(1, first, off), session(2, second, off)];
        let mut problems =
            stages.each_ref().map(|stage| Problem::new(&[stage as &dyn Stage], &twin));
        let points = problems.each_ref().map(|problem| problem.start(twin.clone()));
        let [train, held_out] = &mut problems;
        exclude_from(StageKind::Drive, (train, &points[0]), (held_out, &points[1]));
        problems.map(|problem| (problem.parts[0].incidents.clone(), problem.rows()))
    }

    #[test]
    fn a_one_off_disturbance_is_excluded_from_its_session_only() {
        let [(first, kept), (second, whole)] = left_out(0.2, [&[12.34..12.61], &[]]);
        let [incident] = first.as_slice() else { panic!("{first:?}") };
        assert!(incident.span.start <= 12.34 && 12.61 <= incident.span.end, "{incident:?}");
        assert!(incident.span.end - incident.span.start < 0.7, "{incident:?}");
        assert!((incident.farthest + 0.2).abs() < 2e-3, "{incident:?}");
        assert!(second.is_empty() && kept < whole && whole - 120 < kept, "{kept} of {whole}");
        // The same in the validation session, and with two disturbances.
        let [(first, _), (second, _)] = left_out(0.2, [&[], &[3.0..3.2, 20.0..20.4]]);
        assert_eq!((first.len(), second.len()), (0, 2));
        // Two thirds of the squared residual, and none similar elsewhere.
        let [(first, _), (second, _)] = left_out(0.02, [&[12.3..12.6], &[]]);
        assert_eq!((first.len(), second.len()), (1, 0));
    }

    #[test]
    fn recurring_and_long_disturbances_stay() {
        for (first, second) in [
            (vec![], vec![]),
            (vec![12.3..12.6], vec![5.0..5.3]),
            (vec![12.0..15.0], vec![]),
            ((0..8).map(|k| 3.0 * f64::from(k)..3.0 * f64::from(k) + 0.2).collect(), vec![]),
        ] {
            let found = left_out(0.2, [&first, &second]);
            assert!(found.iter().all(|(incidents, _)| incidents.is_empty()), "{first:?} {found:?}");
        }
    }
}
