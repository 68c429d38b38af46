//! The numbers of a twin as people print them, at any step of the search: an effect that comes later moves those
//! that are there, and a physical constant that moves tells of what was missing.

use super::fit::Fit;
use crate::{
    effects::{Axis, by_direction},
    twin::{Slot, Twin},
};
use serde::{Deserialize, Serialize};

/// One number of a twin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Number {
    /// Dotted name of the effect, then that of the parameter.
    pub name: String,
    /// Where it acts.
    pub axis: Axis,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

/// What a fit found, and friction forwards and backwards where it differs.
#[must_use]
pub(super) fn numbers(fit: &Fit) -> Vec<Number> {
    let twin = &fit.point.twin;
    let of_slot = |slot: &Slot| {
        let instance = &twin.instances[slot.instance];
        let parameter = &instance.effect.parameters[slot.parameter];
        Number {
            name: format!("{}.{}", instance.effect.name, parameter.name),
            axis: instance.axis,
            value: twin.get(*slot),
            unit: parameter.unit.to_owned(),
        }
    };
    let mut numbers: Vec<Number> = fit.slots.iter().map(of_slot).collect();
    let has = |axis: Axis| fit.slots.iter().any(|slot| twin.instances[slot.instance].axis == axis);
    for instance in &twin.instances {
        if instance.effect.name == ASYMMETRIC && has(instance.axis) {
            numbers.extend(directed(twin, instance.axis));
        }
    }
    numbers
}

/// The effect that makes friction differ by direction.
const ASYMMETRIC: &str = "drive.friction.asymmetric";

/// Dry and viscous friction of `axis` in both directions.
fn directed(twin: &Twin, axis: Axis) -> Vec<Number> {
    let value = |name: &str| twin.instance(name, axis).map_or(0.0, |own| own.values[0].value);
    let Some(asymmetry) = twin.instance(ASYMMETRIC, axis) else { return Vec::new() };
    let [forwards, backwards] = by_direction(
        value("drive.friction.coulomb"),
        value("drive.friction.viscous"),
        value("drive.offset"),
        &asymmetry.numbers(),
    );
    let number = |what: &str, value: f64, unit: &str| Number {
        name: format!("{ASYMMETRIC}.{what}"),
        axis,
        value,
        unit: unit.to_owned(),
    };
    vec![
        number("coulomb_forwards_n", forwards.coulomb_n, "N"),
        number("coulomb_backwards_n", backwards.coulomb_n, "N"),
        number("viscous_forwards_n_s_per_m", forwards.viscous_n_s_per_m, "N s/m"),
        number("viscous_backwards_n_s_per_m", backwards.viscous_n_s_per_m, "N s/m"),
    ]
}
