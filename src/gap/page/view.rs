//! Data of one stage for the charts: measurements, and predictions of the twin before and after.

use crate::{
    gap::{
        problem::{Point, Problem},
        rounds::Outcome,
    },
    twin::{Channel, Stage, StageKind},
};
use std::ops::Range;

/// Longest hole in a signal that is bridged by a straight line for a spectrum (samples).
const LONGEST_BRIDGE: usize = 3;

/// One stage on the validation sessions, or on the training sessions without any.
pub(in crate::gap) struct View<'f> {
    /// Stage.
    pub(in crate::gap) kind: StageKind,
    /// True for validation sessions.
    pub(in crate::gap) held_out: bool,
    /// Data of each session.
    pub(in crate::gap) parts: Vec<PartView<'f>>,
}

/// One session of a stage.
pub(in crate::gap) struct PartView<'f> {
    /// The stage in this session.
    pub(in crate::gap) stage: &'f dyn Stage,
    /// Samples that are used: `[channel][sample]`.
    pub(in crate::gap) usable: Vec<Vec<bool>>,
    /// Prediction of the given twin: `[channel][sample]`.
    pub(in crate::gap) before: Vec<Vec<f64>>,
    /// Prediction of the final twin.
    pub(in crate::gap) after: Vec<Vec<f64>>,
}

impl<'f> View<'f> {
    /// Validation sessions of `outcome`, or the training sessions without any.
    pub(in crate::gap) fn of(outcome: &'f Outcome<'_>) -> Self {
        if outcome.held_out.parts.is_empty() {
            Self::train(outcome)
        } else {
            Self::validated(outcome)
        }
    }

    /// Training sessions.
    pub(in crate::gap) fn train(outcome: &'f Outcome<'_>) -> Self {
        let points = [&outcome.start, &outcome.last.point];
        let parts = parts(&outcome.train, points);
        Self { kind: outcome.kind, held_out: false, parts }
    }

    /// Validation sessions.
    pub(in crate::gap) fn validated(outcome: &'f Outcome<'_>) -> Self {
        let points = [&outcome.start_held_out, &outcome.last_held_out];
        let parts = parts(&outcome.held_out, points);
        Self { kind: outcome.kind, held_out: true, parts }
    }

    /// Index of `signal` in each part that has it.
    pub(super) fn channels_of<'v>(
        &'v self,
        signal: &'v str,
    ) -> impl Iterator<Item = (&'v PartView<'f>, usize)> {
        self.parts.iter().filter_map(move |part| {
            let found = part.stage.channels().iter().position(|own| own.signal == signal);
            found.map(|index| (part, index))
        })
    }
}

fn parts<'f>(problem: &'f Problem<'_>, points: [&Point; 2]) -> Vec<PartView<'f>> {
    problem
        .parts
        .iter()
        .enumerate()
        .map(|(index, part)| {
            let [before, after] = points.map(|point| {
                let nuisance = point.nuisance.get(index).map_or(&[][..], Vec::as_slice);
                part.predict(&point.twin, nuisance)
            });
            let mut usable: Vec<Vec<bool>> =
                part.stage.channels().iter().map(|own| vec![false; own.times.len()]).collect();
            for row in &part.layout.rows {
                usable[row.channel as usize][row.sample as usize] = true;
            }
            PartView { stage: part.stage, usable, before, after }
        })
        .collect()
}

impl PartView<'_> {
    /// The measured signal.
    pub(super) fn channel(&self, channel: usize) -> &Channel {
        &self.stage.channels()[channel]
    }

    /// Measured minus predicted, before and after; not finite for samples that are not used.
    pub(super) fn residual(&self, channel: usize, sample: usize) -> [f64; 2] {
        if self.usable[channel][sample] { self.difference(channel, sample) } else { [f64::NAN; 2] }
    }

    /// Measured minus predicted for any sample, also for one that is not used.
    pub(super) fn difference(&self, channel: usize, sample: usize) -> [f64; 2] {
        let measured = self.channel(channel).measured[sample];
        [&self.before, &self.after].map(|predicted| measured - predicted[channel][sample])
    }

    /// Mean squared residual before, over the used samples of `samples`; `None` without any.
    pub(super) fn mean_square(&self, channel: usize, samples: Range<usize>) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0_usize);
        for sample in samples {
            let [before, _] = self.residual(channel, sample);
            if before.is_finite() {
                sum += before * before;
                count += 1;
            }
        }
        (0 < count).then(|| sum / count as f64)
    }

    /// Residuals before and after in stretches without holes: small ones are bridged.
    pub(super) fn stretches(&self, channel: usize) -> [Vec<Vec<f64>>; 2] {
        let mut both = [Vec::new(), Vec::new()];
        for run in &self.channel(channel).runs {
            for (column, stretches) in both.iter_mut().enumerate() {
                let values = run.clone().map(|sample| self.residual(channel, sample)[column]);
                stretches.extend(bridged(values));
            }
        }
        both
    }
}

/// Stretches of finite values; holes of a few are filled by a straight line.
fn bridged(values: impl Iterator<Item = f64>) -> Vec<Vec<f64>> {
    let mut stretches: Vec<Vec<f64>> = Vec::new();
    let mut hole = usize::MAX;
    for value in values {
        if !value.is_finite() {
            hole = hole.saturating_add(1);
            continue;
        }
        match stretches.last_mut() {
            Some(stretch) if hole <= LONGEST_BRIDGE => {
                let from = stretch.last().copied().unwrap_or(value);
                let step = (value - from) / (hole + 1) as f64;
                stretch.extend((1..=hole).map(|k| from + step * k as f64));
                stretch.push(value);
            }
            _ => stretches.push(vec![value]),
        }
        hole = 0;
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_holes_are_bridged_and_large_ones_part() {
        let nan = f64::NAN;
        let values = [nan, 1.0, 2.0, nan, 4.0, nan, nan, nan, nan, 7.0, nan];
        let found = bridged(values.into_iter());
        assert_eq!(found, vec![vec![1.0, 2.0, 3.0, 4.0], vec![7.0]]);
    }
}
