//! Parameter estimates of a stage at any step of the search. An effect that is added later changes the estimates
//! before it: a physical constant that changes had compensated for the missing effect.

use super::fit::Fit;
use crate::{
    effects::{Axis, by_direction},
    twin::{Instance, Slot, Twin},
};
use serde::{Deserialize, Serialize};

/// Estimate of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Dotted name of the effect, then that of the parameter.
    pub name: String,
    /// Axis on which the effect acts.
    pub location: Axis,
    /// Estimate.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// Estimates of all parameters that `fit` has fitted; friction per direction where it is asymmetric.
#[must_use]
pub(super) fn estimates(fit: &Fit) -> Vec<ParameterEstimate> {
    let twin = &fit.point.twin;
    let of_slot = |slot: &Slot| {
        let instance = &twin.instances[slot.instance];
        let parameter = &instance.effect.parameters[slot.parameter];
        ParameterEstimate {
            name: format!("{}.{}", instance.effect.name, parameter.name),
            location: instance.axis,
            value: twin.get(*slot),
            unit: parameter.unit.to_owned(),
        }
    };
    let mut estimates: Vec<ParameterEstimate> = fit.slots.iter().map(of_slot).collect();
    for (index, instance) in twin.instances.iter().enumerate() {
        let is_fitted = fit.slots.iter().any(|slot| slot.instance == index);
        if is_fitted && instance.effect.name == ASYMMETRIC {
            estimates.extend(directed(twin, instance));
        }
    }
    estimates
}

/// Effect that makes friction depend on the direction.
const ASYMMETRIC: &str = "drive.friction.asymmetric";

/// Coulomb and viscous friction per direction at the location of `asymmetry`.
fn directed(twin: &Twin, asymmetry: &Instance) -> [ParameterEstimate; 4] {
    let axis = asymmetry.axis;
    let value = |name: &str| twin.instance(name, axis).map_or(0.0, |own| own.values[0].value);
    let [forwards, backwards] = by_direction(
        value("drive.friction.coulomb"),
        value("drive.friction.viscous"),
        value("drive.offset"),
        &asymmetry.numbers(),
    );
    let estimate = |what: &str, value: f64, unit: &str| ParameterEstimate {
        name: format!("{ASYMMETRIC}.{what}"),
        location: axis,
        value,
        unit: twin.axis_frame.map_or(unit.to_owned(), |frame| frame.scales.unit(unit)),
    };
    [
        estimate("coulomb_forwards_n", forwards.coulomb_n, "N"),
        estimate("coulomb_backwards_n", backwards.coulomb_n, "N"),
        estimate("viscous_forwards_n_s_per_m", forwards.viscous_n_s_per_m, "N s/m"),
        estimate("viscous_backwards_n_s_per_m", backwards.viscous_n_s_per_m, "N s/m"),
    ]
}
