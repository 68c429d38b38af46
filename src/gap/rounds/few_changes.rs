//! Start of a refit where a machine has changed since its reference recordings.
//!
//! Few of its effects have changed then, and each as a whole. A fit of everything from the given values can end in another
//! minimum: parameters that have not changed compensate for one that changed a lot. So effects are first fitted one at a time,
//! the one that explains most first (forward selection: Miller 2002, Subset Selection in Regression).

use super::refit::at_probe;
use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        known::excess,
        problem::{Point, Problem},
        whiten::{self, Filters},
    },
    twin::{Slot, Twin},
};

/// Most effects that are fitted one at a time.
const MOST_CHANGES: usize = 3;

/// Fits of each effect from other values than its present ones.
const OTHER_STARTS: usize = 2;

/// Iterations of each of these fits.
const ITERATIONS: usize = 6;

/// The `given` twin with the few changes of its parameters `slots` that explain most of the residual.
pub(super) fn start(train: &Problem<'_>, given: &Point, slots: &[Slot]) -> Point {
    let thresholds = train.thresholds();
    let mut point = given.clone();
    let mut open = by_effect(&given.twin, slots);
    for _ in 0..MOST_CHANGES {
        if thresholds.is_at_reference(excess(&given.twin, [(train, &point)])) {
            break;
        }
        let scales = train.filters(&point, whiten::scale_filters);
        let before = fit::squared(&train.whitened(&point, &scales));
        let fits = in_parallel(&open, |own| alone(train, &point, own, &scales));
        let best = fits.into_iter().enumerate().min_by(|a, b| a.1.loss.total_cmp(&b.1.loss));
        let Some((index, best)) = best else { break };
        if (1.0 - thresholds.clear_gain) * before < best.loss {
            break;
        }
        point = best.point;
        let changed = point.twin.instances[open.remove(index)[0].instance].effect.name;
        log::debug!("a change of {changed} leaves {} of {before}", best.loss);
    }
    point
}

/// Parameters of the same effect, on all axes.
fn by_effect(twin: &Twin, slots: &[Slot]) -> Vec<Vec<Slot>> {
    let name = |slot: &Slot| twin.instances[slot.instance].effect.name;
    let mut groups: Vec<Vec<Slot>> = Vec::new();
    for slot in slots {
        match groups.iter_mut().find(|group| name(&group[0]) == name(slot)) {
            Some(group) => group.push(*slot),
            None => groups.push(vec![*slot]),
        }
    }
    groups
}

/// Fit of the parameters `own` of one effect: the best of those from `point` and from its nearest other starts. These are
/// the probes of the effect, and their magnitudes with the shape that it has.
fn alone(train: &Problem<'_>, point: &Point, own: &[Slot], scales: &Filters) -> Fit {
    let effect = point.twin.instances[own[0].instance].effect;
    let magnitudes = || own.iter().filter(|slot| slot.parameter == 0);
    let probes = effect.probes.iter();
    let starts = probes
        .flat_map(|probe| [at_probe(point, own, probe), at_probe(point, magnitudes(), probe)]);
    let mut starts: Vec<(f64, Point)> =
        starts.map(|start| (fit::squared(&train.whitened(&start, scales)), start)).collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let others = starts.into_iter().take(OTHER_STARTS).map(|(_, start)| start);
    let how = fit::How::start(scales, ITERATIONS);
    let fits = std::iter::once(point.clone())
        .chain(others)
        .map(|start| fit::fit_with(train, start, own, &how));
    fits.min_by(|a, b| a.loss.total_cmp(&b.loss)).expect("there is the first one")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::{
            screen,
            test_stage::{TestStage, first_parameters, pulses_behind_a_gap},
        },
        twin::Machine,
    };

    const BACKLASH: &str = "drive.backlash";
    const COULOMB: &str = "drive.friction.coulomb";

    /// Pulses behind a backlash of this width (m), and a slow sine with the Coulomb friction as amplitude.
    fn pulses_and_sine(twin: &Twin, time: f64) -> f64 {
        let [friction] = first_parameters(twin, [COULOMB]);
        10.0 * pulses_behind_a_gap(twin, time) + twin.get(friction) * time.sin()
    }

    fn twin_at(width: f64, friction: f64) -> Twin {
        let mut twin = Twin::nominal(Machine::Axis);
        let [slot] = first_parameters(&twin, [COULOMB]);
        twin.set(slot, friction);
        screen::with(&twin, find(BACKLASH).unwrap(), Axis::Single, &[width, 50.0])
    }

    /// Width (m) and friction at the start of a refit from 0.1 mm and 1 N.
    fn found(truth: &Twin) -> [f64; 2] {
        let stage = TestStage::camera(truth, pulses_and_sine, 3);
        let train = Problem::new(&[&stage as _], truth);
        let given = train.start(twin_at(1e-4, 1.0));
        let slots = first_parameters(&given.twin, [BACKLASH, COULOMB]);
        slots.map(|slot| start(&train, &given, &slots).twin.get(slot))
    }

    #[test]
    fn a_large_change_is_found_from_a_probe_and_the_rest_stays_as_given() {
        let [width, friction] = found(&twin_at(1.45e-3, 1.0));
        assert!((width / 1.45e-3 - 1.0).abs() < 0.02, "{width}");
        assert_eq!(friction, 1.0);
    }

    #[test]
    fn two_changes_are_found_one_after_the_other() {
        let [width, friction] = found(&twin_at(1.45e-3, 3.0));
        assert!((width / 1.45e-3 - 1.0).abs() < 0.02, "{width}");
        assert!((friction - 3.0).abs() < 0.2, "{friction}");
    }

    #[test]
    fn parameters_of_an_effect_change_together_on_all_axes() {
        let twin = Twin::nominal(Machine::Table);
        let slots = twin.free(&TestStage::drive(Vec::new(), |_, _| 0.0));
        let groups = by_effect(&twin, &slots);
        let name = |slot: &Slot| twin.instances[slot.instance].effect.name;
        assert!(groups.iter().all(|own| own.iter().all(|slot| name(slot) == name(&own[0]))));
        let names: std::collections::HashSet<&str> = slots.iter().map(name).collect();
        assert_eq!(groups.len(), names.len());
        assert_eq!(groups.concat().len(), slots.len());
    }
}
