//! What happened once, in one session: a hand on the carriage, a run into the end of a rail, a cable that snags.
//!
//! Such a moment can hold far more of the squared residual than everything that happens again and again. It says
//! nothing that another session could confirm, and hides what does. So the time around it is left out, and the user
//! is told.

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

/// Most incidents of a session.
const MOST: usize = 3;

/// One incident.
#[derive(Debug, Clone, PartialEq)]
pub struct Incident {
    /// The signal that was farthest off.
    pub signal: String,
    /// Its unit.
    pub unit: &'static str,
    /// How far it was off, with its sign, in that unit.
    pub farthest: f64,
    /// When (s since the session began).
    pub span: Range<f64>,
}

/// A part and its residual, `[channel][sample]`.
type Seen<'p, 'a> = (&'p Part<'a>, Vec<Vec<f64>>);

/// Finds the incidents of one link and leaves them out of `train` or of `held_out`, whichever session they are of;
/// each comes with its point. Without a session to judge, what happens once cannot be told from what would again.
/// Gives whether there were any.
pub(super) fn leave_out_of<'a>(
    kind: StageKind,
    train: (&mut Problem<'a>, &Point),
    held_out: (&mut Problem<'a>, &Point),
) -> bool {
    let is_in_pieces = matches!(kind, StageKind::Ball | StageKind::WholeRolls);
    if is_in_pieces || train.0.parts.is_empty() || held_out.0.parts.is_empty() {
        return false;
    }
    let seen: Vec<Seen<'_, '_>> = [(&*train.0, train.1), (&*held_out.0, held_out.1)]
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

/// The session whose few incidents hold `majority` of the squared residual of all and stand out, and these.
fn incidents(seen: &[Seen<'_, '_>], thresholds: &Thresholds) -> Option<(usize, Vec<Incident>)> {
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

/// The usual residual of each channel over all sessions; never zero.
fn usual(seen: &[Seen<'_, '_>]) -> Vec<f64> {
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

/// Channel and sample of everything that counts.
fn samples<'p>(part: &'p Part<'_>) -> impl Iterator<Item = (usize, usize)> + 'p {
    part.layout.rows.iter().map(|row| (row.channel as usize, row.sample as usize))
}

/// Squared residuals by bins of time, each in units of what is usual in its channel.
fn energies((part, residual): &Seen<'_, '_>, usual: &[f64]) -> Vec<f64> {
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

/// The bin that holds most, those beside it that hold more than `usual`, and one more on both sides; and what it
/// holds.
fn around_largest(bins: &[f64], usual: f64) -> (Range<usize>, f64) {
    let largest = (0..bins.len()).max_by(|a, b| bins[*a].total_cmp(&bins[*b])).unwrap_or(0);
    let before = bins[..largest].iter().rev().take_while(|own| usual < **own).count();
    let after = bins[largest..].iter().take_while(|own| usual < **own).count().max(1);
    let span = (largest - before).saturating_sub(1)..(largest + after + 1).min(bins.len());
    (span, bins.get(largest).copied().unwrap_or(0.0))
}

/// What stands out most in `span` (s) of a session.
fn incident((part, residual): &Seen<'_, '_>, usual: &[f64], span: Range<f64>) -> Incident {
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
        effects::{Domain, Effect},
        seed::Stream,
        twin::{Channel, Machine, Stage, Twin},
    };

    /// A link of which nothing is predicted but zero.
    struct Scatter(Vec<Channel>);

    impl Stage for Scatter {
        fn kind(&self) -> StageKind {
            StageKind::Drive
        }

        fn channels(&self) -> &[Channel] {
            &self.0
        }

        fn calls(&self, _effect: &Effect) -> bool {
            false
        }

        fn predict(&self, _twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
            predicted.iter_mut().flatten().for_each(|value| *value = 0.0);
        }
    }

    /// Half a minute at 100 Hz that scatters by 1 mm/s, and is `off` (m/s) too slow during each of `bursts` (s).
    fn session(seed: u64, bursts: &[Range<f64>], off: f64) -> Scatter {
        let mut random = Stream::new(seed, "scatter");
        let times: Vec<f64> = (0..3000).map(|k| 0.01 * f64::from(k)).collect();
        let is_off = |time: &f64| bursts.iter().any(|burst| burst.contains(time));
        let scatter = times.iter().map(|_| f64::from(random.uniform_f32(-1.7e-3, 1.7e-3)));
        let scatter: Vec<f64> = scatter.collect();
        let each = times.iter().zip(scatter);
        let measured = each.map(|(time, own)| if is_off(time) { own - off } else { own }).collect();
        Scatter(vec![Channel {
            signal: "motor_a.velocity".into(),
            unit: "m/s",
            domain: Domain::Drive,
            axis: "a",
            rate_hz: 100.0,
            times,
            measured,
            runs: std::iter::once(0..3000).collect(),
        }])
    }

    /// What is left out of two sessions with bursts that are `off` (m/s), and how many samples count then.
    fn left_out(off: f64, [first, second]: [&[Range<f64>]; 2]) -> [(Vec<Incident>, usize); 2] {
        let twin = Twin::nominal(Machine::Table);
        let stages = [session(1, first, off), session(2, second, off)];
        let mut problems =
            stages.each_ref().map(|stage| Problem::new(&[stage as &dyn Stage], &twin));
        let points = problems.each_ref().map(|problem| problem.start(twin.clone()));
        let [train, held_out] = &mut problems;
        leave_out_of(StageKind::Drive, (train, &points[0]), (held_out, &points[1]));
        problems.map(|problem| (problem.parts[0].incidents.clone(), problem.rows()))
    }

    #[test]
    fn what_happened_once_is_left_out_of_its_session_alone() {
        let [(first, kept), (second, whole)] = left_out(0.2, [&[12.34..12.61], &[]]);
        let [incident] = first.as_slice() else { panic!("{first:?}") };
        assert!(incident.span.start <= 12.34 && 12.61 <= incident.span.end, "{incident:?}");
        assert!(incident.span.end - incident.span.start < 0.7, "{incident:?}");
        assert!((incident.farthest + 0.2).abs() < 2e-3, "{incident:?}");
        assert!(second.is_empty() && kept < whole && whole - 120 < kept, "{kept} of {whole}");
        // As well in the session that judges, and more than once.
        let [(first, _), (second, _)] = left_out(0.2, [&[], &[3.0..3.2, 20.0..20.4]]);
        assert_eq!((first.len(), second.len()), (0, 2));
        // Two thirds of all, and nothing like it elsewhere.
        let [(first, _), (second, _)] = left_out(0.02, [&[12.3..12.6], &[]]);
        assert_eq!((first.len(), second.len()), (1, 0));
    }

    #[test]
    fn what_comes_again_or_lasts_stays() {
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
