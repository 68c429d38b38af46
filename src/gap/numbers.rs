//! The numbers of a twin as people print them, at any step of the search: an effect that comes later moves those
//! that are there, and a physical constant that moves tells of what was missing.

use super::fit::Fit;
use crate::{
    effects::{Axis, by_direction},
    twin::{Instance, Slot, Twin},
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
    for (index, instance) in twin.instances.iter().enumerate() {
        let is_fitted = fit.slots.iter().any(|slot| slot.instance == index);
        if is_fitted && instance.effect.name == ASYMMETRIC {
            numbers.extend(directed(twin, instance));
        }
    }
    numbers
}

/// The effect that makes friction differ by direction.
const ASYMMETRIC: &str = "drive.friction.asymmetric";

/// Dry and viscous friction in both directions where `asymmetry` acts.
fn directed(twin: &Twin, asymmetry: &Instance) -> [Number; 4] {
    let axis = asymmetry.axis;
    let value = |name: &str| twin.instance(name, axis).map_or(0.0, |own| own.values[0].value);
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
    [
        number("coulomb_forwards_n", forwards.coulomb_n, "N"),
        number("coulomb_backwards_n", backwards.coulomb_n, "N"),
        number("viscous_forwards_n_s_per_m", forwards.viscous_n_s_per_m, "N s/m"),
        number("viscous_backwards_n_s_per_m", backwards.viscous_n_s_per_m, "N s/m"),
    ]
}
