//! Nuisance parameters of one run or session (start of a roll, offset of a camera), eliminated from a linearized
//! problem. Their directions are projected out of residual and columns. Their change with a step of the shared
//! parameters follows from a triangular system.

use super::{
    problem::{Evaluated, Point, Problem, dot},
    whiten::Filters,
};

/// Fractions of a nuisance step that are tried where the full step increases the squared error.
const SHORTER_STEPS: [f64; 2] = [0.25, 0.0];

/// Nuisance columns of one group as Q R.
pub(super) struct Elimination {
    rows: std::ops::Range<usize>,
    q: Vec<Vec<f64>>,
    r: Vec<Vec<f64>>,
    /// Components of the residual along q before the projection.
    along_residual: Vec<f64>,
    /// The same for each shared column.
    along_columns: Vec<Vec<f64>>,
}

/// Orthonormalize `local` (modified Gram-Schmidt) and project its directions out of the rows.
pub(super) fn eliminate(
    rows: std::ops::Range<usize>,
    mut local: Vec<Vec<f64>>,
    residual: &mut [f64],
    columns: &mut [Vec<f64>],
) -> Elimination {
    let count = local.len();
    let mut r = vec![vec![0.0; count]; count];
    for k in 0..count {
        let (done, rest) = local.split_at_mut(k);
        for (row, value) in r.iter_mut().zip(orthonormalise(&mut rest[0], done)) {
            row[k] = value;
        }
    }
    let take = |values: &mut [f64]| -> Vec<f64> {
        local
            .iter()
            .map(|q| {
                let along = dot(q, values);
                values.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
                along
            })
            .collect()
    };
    let along_residual = take(&mut residual[rows.clone()]);
    let along_columns = columns.iter_mut().map(|column| take(&mut column[rows.clone()])).collect();
    Elimination { rows, q: local, r, along_residual, along_columns }
}

/// Make `own` a unit vector orthogonal to all of `done`, or zero if it depends on them. Return its components along
/// `done`, and the remaining length.
fn orthonormalise(own: &mut [f64], done: &[Vec<f64>]) -> Vec<f64> {
    let before = norm(own);
    let mut components = Vec::with_capacity(done.len() + 1);
    for q in done {
        let along = dot(q, own);
        own.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
        components.push(along);
    }
    let length = norm(own);
    if before == 0.0 || length <= 1e-9 * before {
        own.fill(0.0);
        components.push(0.0);
    } else {
        own.iter_mut().for_each(|value| *value /= length);
        components.push(length);
    }
    components
}

impl Elimination {
    /// Change of the group's parameters when the shared parameters change by `step` (scaled).
    #[must_use]
    pub(super) fn change(&self, step: &[f64]) -> Vec<f64> {
        let count = self.q.len();
        let mut right: Vec<f64> = (0..count)
            .map(|k| {
                let shared = step.iter().zip(&self.along_columns);
                let moved: f64 = shared.map(|(change, along)| change * along[k]).sum();
                self.along_residual[k] - moved
            })
            .collect();
        for k in (0..count).rev() {
            for j in k + 1..count {
                right[k] -= self.r[k][j] * right[j];
            }
            let pivot = self.r[k][k];
            right[k] = if pivot.abs() < 1e-12 { 0.0 } else { right[k] / pivot };
        }
        right
    }

    /// Project this group's nuisance directions out of one more column.
    pub(super) fn take_from(&self, column: &mut [f64]) {
        let values = &mut column[self.rows.clone()];
        for q in &self.q {
            let along = dot(q, values);
            values.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
        }
    }
}

impl Problem<'_> {
    /// `next` with shorter steps, from `before`, of the nuisance groups whose squared error is larger after the full
    /// step. Groups are independent, and the damping of the shared parameters does not shorten their steps. One roll
    /// whose step diverges must not stop the steps of all others.
    #[must_use]
    pub(super) fn with_shorter_nuisance_steps(
        &self,
        before: &Evaluated,
        next: Evaluated,
        filters: &Filters,
    ) -> Evaluated {
        // Offsets act linearly: their full step is optimal.
        let mut parts = self.parts.iter().zip(&next.point.nuisance);
        if parts.all(|(part, own)| own.len() < 2 || part.stage.offsets(own).is_some()) {
            return next;
        }
        let old = self.group_squares(before, filters);
        let squares = self.group_squares(&next, filters);
        let is_worse = |(new, old): (&f64, &f64)| new.is_nan() || old < new;
        let worse: Vec<bool> = squares.iter().zip(&old).map(is_worse).collect();
        if !worse.contains(&true) {
            return next;
        }
        let whole = next.point.nuisance.clone();
        let mut best = (next.point, squares);
        for fraction in SHORTER_STEPS {
            let mut point = best.0.clone();
            let groups = point.nuisance.iter_mut().flatten().zip(&worse);
            let ends = before.point.nuisance.iter().flatten().zip(whole.iter().flatten());
            for ((group, _), (from, to)) in groups.zip(ends).filter(|((_, worse), _)| **worse) {
                for (number, (from, to)) in group.iter_mut().zip(from.iter().zip(to)) {
                    *number = from + fraction * (to - from);
                }
            }
            best = self.better_of_each_group(best, self.evaluated(point), filters);
        }
        self.evaluated(best.0)
    }

    /// `best`, whose groups have the given squared errors, with the nuisances of the groups that are better at `tried`.
    fn better_of_each_group(
        &self,
        (mut best, mut squares): (Point, Vec<f64>),
        tried: Evaluated,
        filters: &Filters,
    ) -> (Point, Vec<f64>) {
        let new = self.group_squares(&tried, filters);
        let groups = best.nuisance.iter_mut().flatten();
        let others = tried.point.nuisance.into_iter().flatten();
        for ((group, other), (own, new)) in groups.zip(others).zip(squares.iter_mut().zip(new)) {
            if new < *own || own.is_nan() {
                (*group, *own) = (other, new);
            }
        }
        (best, squares)
    }

    /// Squared whitened residual of each nuisance group, part after part.
    fn group_squares(&self, at: &Evaluated, filters: &Filters) -> Vec<f64> {
        let residual = self.whitened_at(&at.prediction, filters);
        let mut first_row = 0;
        let mut squares = Vec::new();
        for part in &self.parts {
            let own = &residual[first_row..first_row + part.layout.rows.len()];
            squares
                .extend(part.groups.iter().map(|rows| dot(&own[rows.clone()], &own[rows.clone()])));
            first_row += part.layout.rows.len();
        }
        squares
    }
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use crate::{
        effects::{Domain, Effect},
        gap::{fit, problem::Problem, whiten},
        twin::{Channel, Machine, Stage, StageKind, Twin},
    };
    use std::ops::Range;

    const SAMPLES: usize = 40;

    /// Two runs with one unknown parameter each. The first is linear in it; the second is atan, on which Newton's
    /// method diverges.
    struct Curves {
        channels: Vec<Channel>,
    }

    impl Curves {
        /// Measurement at the parameters 2 and 0, with small noise.
        fn new() -> Self {
            let noise = |sample: usize| 1e-4 * ((7 * sample % 5) as f64 - 2.0);
            let measured = (0..2 * SAMPLES)
                .map(|sample| if sample < SAMPLES { 2.0 } else { 0.0 } + noise(sample));
            let channel = Channel {
                signal: "curve".to_owned(),
                unit: "m",
                domain: Domain::Ball,
                axis: "x",
                rate_hz: 100.0,
                times: (0..2 * SAMPLES).map(|sample| 0.01 * sample as f64).collect(),
                measured: measured.collect(),
                runs: vec![0..SAMPLES, SAMPLES..2 * SAMPLES],
            };
            Self { channels: vec![channel] }
        }
    }

    impl Stage for Curves {
        fn kind(&self) -> StageKind {
            StageKind::Ball
        }

        fn channels(&self) -> &[Channel] {
            &self.channels
        }

        fn calls(&self, _effect: &Effect) -> bool {
            false
        }

        fn nuisance_groups(&self) -> Vec<Range<usize>> {
            vec![0..1, 1..2]
        }

        fn nuisance_start(&self, group: usize) -> Vec<f64> {
            // Newton's method on atan diverges from more than 1.39.
            vec![[0.0, 1.5][group]]
        }

        fn nuisance_scale(&self) -> Vec<f64> {
            vec![1.0]
        }

        fn predict(&self, _twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
            let (linear, steep) = predicted[0].split_at_mut(SAMPLES);
            linear.fill(nuisance[0][0]);
            steep.fill(nuisance[1][0].atan());
        }
    }

    #[test]
    fn a_run_that_a_step_leads_astray_does_not_hold_back_the_others() {
        let stage = Curves::new();
        let twin = Twin::nominal(Machine::Table);
        let problem = Problem::new(&[&stage as &dyn Stage], &twin);
        let start = problem.start(twin);
        let filters = problem.filters(&start, whiten::scale_filters);
        let found = fit::adapt(&problem, start, &filters).nuisance;
        assert!((found[0][0][0] - 2.0).abs() < 1e-3, "{found:?}");
        assert!(found[0][1][0].abs() < 1e-2, "{found:?}");
    }
}
