//! The fewest known parameters whose changes explain a residual.

use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        problem::{Point, Problem},
        whiten::Filters,
    },
    twin::Slot,
};

/// Iterations of a fit of a few parameters.
const ITERATIONS: usize = 6;

/// Those of `slots` that explain what the refit of all known parameters, from `given` to `refitted`, explains of the training
/// sessions. All start at the given values. One by one, the parameter is freed that explains most in addition to the ones
/// before it, until what is left to explain, or the best further one, is less than the fraction `clear_gain` of the whole.
/// Errors of the given values that are correlated, such as a scale of all forces, leave the residual as it is, so they
/// need no change (forward selection; Miller 2002, Subset Selection in Regression, section 3.2).
pub(super) fn fewest_changes(
    train: &Problem<'_>,
    filters: &Filters,
    [given, refitted]: [&Point; 2],
    slots: &[Slot],
) -> Vec<Slot> {
    let [before, after] =
        [given, refitted].map(|point| fit::squared(&train.whitened(point, filters)));
    let least = train.thresholds().clear_gain * (before - after);
    let how = fit::How::start(filters, ITERATIONS);
    // A parameter that was split has no value of its own in the given twin.
    let is_given = |slot: &&Slot| slot.instance < given.twin.instances.len();
    let slots: Vec<Slot> = slots.iter().filter(is_given).copied().collect();
    let mut chosen: Vec<Slot> = Vec::new();
    let mut reached = Fit { point: given.clone(), slots: vec![], loss: before, rows: train.rows() };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        gap::{
            test_stage::{TestStage, first_parameters},
            whiten,
        },
        twin::{Machine, Stage, Twin},
    };

    const EFFECTS: [&str; 3] =
        ["drive.friction.coulomb", "gantry.inertia", "drive.friction.viscous"];

    fn slots_of(twin: &Twin) -> [Slot; 3] {
        first_parameters(twin, EFFECTS)
    }

    fn twin_at(values: [f64; 3]) -> Twin {
        let mut twin = Twin::nominal(Machine::Table);
        slots_of(&twin).into_iter().zip(values).for_each(|(slot, value)| twin.set(slot, value));
        twin
    }

    /// The first two parameters act almost alike.
    fn three_waves(twin: &Twin, time: f64) -> f64 {
        let waves = [time.sin(), (time + 0.3).sin(), (3.0 * time).sin()];
        let amplitudes = slots_of(twin).into_iter().map(|slot| twin.get(slot));
        amplitudes.zip(waves).map(|(amplitude, wave)| amplitude * wave).sum()
    }

    /// Names of the fewest changes from ones to `truth`, where a refit found `refitted`.
    fn changes(truth: [f64; 3], refitted: [f64; 3]) -> Vec<&'static str> {
        let stage = TestStage::camera(&twin_at(truth), three_waves, 5);
        let given = twin_at([1.0; 3]);
        let train = Problem::new(&[&stage as &dyn Stage], &given);
        let [given, refitted] = [given, twin_at(refitted)].map(|twin| train.start(twin));
        let filters = train.filters(&refitted, whiten::scale_filters);
        let slots = slots_of(&given.twin);
        let changed = fewest_changes(&train, &filters, [&given, &refitted], &slots);
        let name = |slot: Slot| EFFECTS[slots.iter().position(|own| *own == slot).unwrap()];
        changed.into_iter().map(name).collect()
    }

    #[test]
    fn one_changed_parameter_is_found_where_the_refit_moved_all() {
        assert_eq!(changes([1.0, 2.0, 1.0], [1.05, 1.95, 0.99]), ["gantry.inertia"]);
        assert_eq!(changes([1.8, 1.0, 1.0], [1.75, 1.06, 1.01]), ["drive.friction.coulomb"]);
    }

    #[test]
    fn two_changed_parameters_are_found_the_larger_first() {
        let found = changes([3.0, 1.0, 2.0], [2.95, 1.05, 2.0]);
        assert_eq!(found, ["drive.friction.coulomb", "drive.friction.viscous"]);
    }

    #[test]
    fn nothing_is_changed_where_the_refit_explains_nothing() {
        assert!(changes([1.0; 3], [1.0; 3]).is_empty());
    }
}
