//! The fewest known parameters whose changes explain a residual.

use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        rounds::Outcome,
    },
    twin::Slot,
};

/// Iterations of a fit of a few parameters.
const ITERATIONS: usize = 6;

/// Those of `slots` that explain what the refit of all known parameters explains on the training sessions. All start at the
/// given values. One by one, the parameter is freed that explains most beside the ones before it, until what is left to
/// explain, or the best further one, is less than the fraction `clear_gain` of the whole. Errors of the given values
/// that are correlated, such as a scale of all forces, leave the residual as it is, so they need no change (forward
/// selection; Miller 2002, Subset Selection in Regression, section 3.2).
pub(super) fn fewest_changes(outcome: &Outcome<'_>, slots: &[Slot]) -> Vec<Slot> {
    let Outcome { train, filters, start, last, .. } = outcome;
    let squared = |point| fit::squared(&train.whitened(point, filters));
    let (before, after) = (squared(start), squared(&last.point));
    let least = train.thresholds().clear_gain * (before - after);
    let how = fit::How { filters, iterations: ITERATIONS, known: &[] };
    // A parameter that was split has no value of its own in the given twin.
    let is_given = |slot: &&Slot| slot.instance < start.twin.instances.len();
    let slots: Vec<Slot> = slots.iter().filter(is_given).copied().collect();
    let mut chosen: Vec<Slot> = Vec::new();
    let mut reached = Fit { point: start.clone(), slots: vec![], loss: before, rows: train.rows() };
    while least < reached.loss - after {
        let rest: Vec<Slot> = slots.iter().copied().filter(|slot| !chosen.contains(slot)).collect();
        let fits = in_parallel(&rest, |slot| {
            let freed: Vec<Slot> = chosen.iter().copied().chain([*slot]).collect();
            fit::fit_with(train, reached.point.clone(), &freed, &how)
        });
        let best = fits.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss));
        let is_needed = |own: &Fit| chosen.is_empty() || least < reached.loss - own.loss;
        let Some(best) = best.filter(is_needed) else { break };
        chosen.clone_from(&best.slots);
        reached = best;
    }
    chosen
}
