//! Difference of two twins: effects that one of them lacks, and parameters that changed.

use super::{Instance, Machine, Twin, Value};
use crate::effects::Axis;
use serde::Serialize;

/// Version of the document.
const SCHEMA_VERSION: u32 = 1;

/// The JSON document of `klasktron diff --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TwinDiff {
    /// Version of this document.
    pub schema_version: u32,
    /// Machines of the two twins, before and after.
    pub machines: [Machine; 2],
    /// Masses and lengths that differ, such as `striker_mass_kg`.
    pub properties: Vec<PropertyDiff>,
    /// Effects of either twin: those of the second in its order, then the removed ones.
    pub effects: Vec<EffectDiff>,
}

/// A property of the machine that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PropertyDiff {
    /// Name in `twin.json`.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Value in the first twin, if it has one.
    pub before: Option<f64>,
    /// Value in the second twin, if it has one.
    pub after: Option<f64>,
}

/// Change of one effect on one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Only the second twin has it.
    Added,
    /// Only the first twin has it.
    Removed,
    /// Both have it, with at least one different value.
    Changed,
    /// Both have it, with equal values.
    Equal,
}

/// One effect on one axis in both twins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectDiff {
    /// Dotted name.
    pub name: &'static str,
    /// Axis on which it acts.
    pub location: Axis,
    /// Kind of the change.
    pub change: Change,
    /// Parameters, in the order of the effect.
    pub parameters: Vec<ParameterDiff>,
}

/// One parameter in both twins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterDiff {
    /// Name with its unit.
    pub name: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// Value in the first twin, if it has the effect.
    pub before: Option<f64>,
    /// 95 % confidence interval in the first twin, if it was fitted.
    pub ci95_before: Option<[f64; 2]>,
    /// Value in the second twin, if it has the effect.
    pub after: Option<f64>,
    /// 95 % confidence interval in the second twin, if it was fitted.
    pub ci95_after: Option<[f64; 2]>,
    /// Overlap of the two intervals; absent without two intervals.
    pub intervals_overlap: Option<bool>,
}

impl TwinDiff {
    /// Difference from `before` to `after`.
    ///
    /// ```
    /// use klasktron::twin::{Change, Machine, Twin, TwinDiff};
    /// let twin = Twin::nominal(Machine::Table);
    /// let diff = TwinDiff::new(&twin, &twin);
    /// assert!(diff.is_empty());
    /// assert!(diff.effects.iter().all(|effect| effect.change == Change::Equal));
    /// ```
    #[must_use]
    pub fn new(before: &Twin, after: &Twin) -> Self {
        let mut used = vec![false; before.instances.len()];
        let mut effects = Vec::new();
        for own in &after.instances {
            // A twin may hold an effect several times on one axis: they are compared in order.
            let found = before.instances.iter().enumerate().position(|(index, other)| {
                !used[index] && other.effect == own.effect && other.axis == own.axis
            });
            if let Some(index) = found {
                used[index] = true;
            }
            let earlier = found.map(|index| &before.instances[index]);
            effects.push(EffectDiff::new(earlier, Some(own), own));
        }
        for (own, used) in before.instances.iter().zip(used) {
            if !used {
                effects.push(EffectDiff::new(Some(own), None, own));
            }
        }
        Self {
            schema_version: SCHEMA_VERSION,
            machines: [before.machine, after.machine],
            properties: properties(before, after),
            effects,
        }
    }

    /// Return whether the twins describe the same machine with the same values.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.machines[0] == self.machines[1]
            && self.properties.is_empty()
            && self.effects.iter().all(|effect| effect.change == Change::Equal)
    }
}

impl EffectDiff {
    /// Difference of `before` and `after`; `own` is either.
    fn new(before: Option<&Instance>, after: Option<&Instance>, own: &Instance) -> Self {
        let value = |twin: Option<&Instance>, index: usize| {
            twin.and_then(|instance| instance.values.get(index).copied())
        };
        let parameters = own.effect.parameters.iter().enumerate().map(|(index, parameter)| {
            let (before, after) = (value(before, index), value(after, index));
            let interval = |value: Option<Value>| value.and_then(|value| value.ci95);
            let [ci95_before, ci95_after] = [interval(before), interval(after)];
            let overlap =
                |(one, other): ([f64; 2], [f64; 2])| one[0] <= other[1] && other[0] <= one[1];
            ParameterDiff {
                name: parameter.name,
                unit: parameter.unit,
                before: before.map(|value| value.value),
                ci95_before,
                after: after.map(|value| value.value),
                ci95_after,
                intervals_overlap: ci95_before.zip(ci95_after).map(overlap),
            }
        });
        let parameters: Vec<ParameterDiff> = parameters.collect();
        let change = match (before, after) {
            (None, _) => Change::Added,
            (_, None) => Change::Removed,
            _ if parameters.iter().any(|own| own.before != own.after) => Change::Changed,
            _ => Change::Equal,
        };
        Self { name: own.effect.name, location: own.axis, change, parameters }
    }
}

/// Properties of the machine that differ.
fn properties(before: &Twin, after: &Twin) -> Vec<PropertyDiff> {
    let of = |twin: &Twin| {
        [
            ("striker_mass_kg", "kg", Some(twin.striker_mass)),
            ("belt_metres_per_turn", "m", Some(twin.belt_metres_per_turn)),
            ("controller_reference_mass_kg", "kg", twin.controller_reference_mass),
        ]
    };
    let pairs = of(before).into_iter().zip(of(after));
    pairs
        .filter(|(one, other)| one.2 != other.2)
        .map(|((name, unit, before), (_, _, after))| PropertyDiff { name, unit, before, after })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{effects, twin::Source};

    fn add(twin: &mut Twin, name: &str, axis: Axis, values: &[f64]) {
        let effect = effects::find(name).unwrap();
        twin.instances.push(Instance::new(effect, axis, values, Source::Fitted));
    }

    #[test]
    fn added_removed_and_changed_effects_are_reported() {
        let before = {
            let mut twin = Twin::nominal(Machine::Table);
            add(&mut twin, "drive.delay", Axis::Motors, &[0.004]);
            add(&mut twin, "drive.gain", Axis::Motors, &[1.02]);
            twin
        };
        let mut after = Twin::nominal(Machine::Table);
        add(&mut after, "drive.delay", Axis::Motors, &[0.008]);
        add(&mut after, "drive.delay", Axis::A, &[0.001]);
        after.striker_mass = 0.02;
        let diff = TwinDiff::new(&before, &after);
        let found = |name: &str, axis: Axis| {
            let own = diff.effects.iter().find(|own| own.name == name && own.location == axis);
            own.unwrap().change
        };
        assert_eq!(found("drive.delay", Axis::Motors), Change::Changed);
        assert_eq!(found("drive.delay", Axis::A), Change::Added);
        assert_eq!(found("drive.gain", Axis::Motors), Change::Removed);
        assert_eq!(found("drive.saturation.slew", Axis::Motors), Change::Equal);
        assert_eq!(diff.properties.len(), 1);
        assert_eq!(diff.properties[0].after, Some(0.02));
        assert!(!diff.is_empty());
    }

    #[test]
    fn intervals_overlap_or_not_where_both_are_known() {
        let twin = |value: f64, ci95: Option<[f64; 2]>| {
            let mut twin = Twin::nominal(Machine::Table);
            add(&mut twin, "drive.delay", Axis::Motors, &[value]);
            twin.instances.last_mut().unwrap().values[0].ci95 = ci95;
            twin
        };
        let overlap = |one: &Twin, other: &Twin| {
            let diff = TwinDiff::new(one, other);
            let own = diff.effects.into_iter().find(|own| own.name == "drive.delay");
            own.unwrap().parameters[0].intervals_overlap
        };
        let first = twin(0.004, Some([0.003, 0.005]));
        assert_eq!(overlap(&first, &twin(0.005, Some([0.0045, 0.006]))), Some(true));
        assert_eq!(overlap(&first, &twin(0.008, Some([0.007, 0.009]))), Some(false));
        assert_eq!(overlap(&first, &twin(0.008, None)), None);
    }
}
