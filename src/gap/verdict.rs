//! Verdict and its summary.

use super::{
    findings::{IdentifiedEffect, Indistinguishable, ParameterChange, SignalResidual, Verdict},
    page::text::dependence,
    rounds::Outcome,
    thresholds::Thresholds,
    unknown::Unknown,
};
use crate::{
    effects::Axis,
    twin::{Machine, Source, Twin},
};

/// Data behind a verdict.
pub(super) struct Findings<'f, 'a> {
    pub(super) thresholds: &'f Thresholds,
    /// Twin at the start.
    pub(super) start: &'f Twin,
    pub(super) effects: &'f [IdentifiedEffect],
    pub(super) indistinguishable: &'f [Indistinguishable],
    pub(super) parameter_changes: &'f [ParameterChange],
    pub(super) residuals: &'f [SignalResidual],
    /// Number of effects to which the search was restricted.
    pub(super) selected: Option<usize>,
    pub(super) outcomes: &'f [Outcome<'a>],
}

/// Verdict and its summary.
pub(super) struct Answer {
    pub(super) verdict: Verdict,
    pub(super) summary: String,
}

impl Answer {
    pub(super) fn of(findings: &Findings<'_, '_>) -> Self {
        let verdict = verdict(findings);
        Self { verdict, summary: summary(verdict, findings) }
    }
}

fn verdict(findings: &Findings<'_, '_>) -> Verdict {
    let Findings { start, effects, indistinguishable, parameter_changes, residuals, .. } =
        *findings;
    let Findings { outcomes, thresholds, .. } = *findings;
    // An effect of a single axis may change most of its few parameters.
    let may_be_rebuilt = start.machine == Machine::Table || effects.is_empty();
    if may_be_rebuilt && is_other_machine(start, parameter_changes, thresholds) {
        Verdict::DifferentMachine
    } else if !effects.is_empty() {
        if indistinguishable.len() == effects.len() { Verdict::Ambiguous } else { Verdict::Named }
    } else if residuals.is_empty() {
        Verdict::NotTestable
    } else if outcomes.iter().any(|outcome| outcome.unexplained.is_some())
        || above_floor(residuals, thresholds).is_some()
    {
        Verdict::Unexplained
    } else if parameter_changes.is_empty() {
        Verdict::None
    } else {
        Verdict::RefitOnly
    }
}

/// Signal farthest above its floor, and the ratio of residual to floor, which is `None` without a floor. `None` where
/// every residual is at its floor.
fn above_floor<'r>(
    residuals: &'r [SignalResidual],
    thresholds: &Thresholds,
) -> Option<(&'r SignalResidual, Option<f64>)> {
    residuals
        .iter()
        .filter(|own| thresholds.is_above_floor(own))
        .map(|own| (own, floor_ratio(own)))
        .max_by(|a, b| a.1.unwrap_or(0.0).total_cmp(&b.1.unwrap_or(0.0)))
}

impl Thresholds {
    /// Return whether the residual of a signal is above its floor; without residual or floor it counts as above.
    pub(super) fn is_above_floor(&self, residual: &SignalResidual) -> bool {
        floor_ratio(residual).is_none_or(|ratio| self.floor_ratio < ratio)
    }
}

/// Ratio of the residual of a signal to its floor.
fn floor_ratio(own: &SignalResidual) -> Option<f64> {
    let after = [own.train_after, own.validation_after].into_iter().flatten().reduce(f64::max)?;
    let floor = own.noise_floor.filter(|floor| 0.0 < *floor);
    // A signal without noise that is predicted exactly is at its floor.
    if after == 0.0 { Some(0.0) } else { floor.map(|floor| after / floor) }
}

/// Return whether at least half of the fitted parameters changed, several of them by a large ratio.
fn is_other_machine(start: &Twin, changes: &[ParameterChange], thresholds: &Thresholds) -> bool {
    let fitted = start
        .instances
        .iter()
        .flat_map(|instance| &instance.values)
        .filter(|value| value.source == Source::Fitted && value.ci95.is_some())
        .count();
    let jumped = changes
        .iter()
        .filter(|change| {
            thresholds.machine_change * change.before.abs() < (change.after - change.before).abs()
        })
        .count();
    thresholds.machine_changes <= jumped as f64 && fitted <= 2 * changes.len()
}

/// Each name once, with its locations where it has several, and with its number at one location.
fn each_once<'n>(names: impl Iterator<Item = (&'n str, Axis)>) -> String {
    let mut all: Vec<(&str, Vec<String>)> = Vec::new();
    for (name, axis) in names {
        match all.iter_mut().find(|own| own.0 == name) {
            Some((_, locations)) => locations.push(axis.to_string()),
            None => all.push((name, vec![axis.to_string()])),
        }
    }
    let shown = all.into_iter().map(|(name, locations)| match &locations[..] {
        [_] => name.to_owned(),
        [first, others @ ..] if others.iter().all(|own| own == first) => {
            format!("{name} ({} times)", locations.len())
        }
        _ => format!("{name} on {}", locations.join(" and ")),
    });
    shown.collect::<Vec<_>>().join(", ")
}

fn summary(verdict: Verdict, findings: &Findings<'_, '_>) -> String {
    let Findings { effects, indistinguishable, parameter_changes, outcomes, .. } = *findings;
    match verdict {
        Verdict::Named | Verdict::Ambiguous => {
            let names = each_once(effects.iter().map(|own| (own.name.as_str(), own.location)));
            let mut text = format!("The simulation was missing {names}.");
            for set in indistinguishable {
                text += &format!(" The data cannot distinguish {}.", set.names.join(" from "));
            }
            text + &remaining(findings)
        }
        Verdict::RefitOnly => {
            let changes = parameter_changes.iter().map(|own| (own.name.as_str(), own.location));
            format!("No effect is missing; known parameters changed: {}.", each_once(changes))
        }
        Verdict::Unexplained => {
            let unknown = outcomes.iter().find_map(|outcome| outcome.unexplained.as_ref());
            let above = above_floor(findings.residuals, findings.thresholds);
            unexplained(unknown, above, findings.selected)
        }
        Verdict::DifferentMachine => {
            let names: Vec<&str> = parameter_changes.iter().map(|own| own.name.as_str()).collect();
            format!(
                "The recordings are of another machine than the twin, or of a rebuilt one: {} changed together. \
                 Calibrate a twin of its own with `klasktron calibrate`.",
                names.join(", ")
            )
        }
        Verdict::NotTestable | Verdict::InputNotConnected => {
            "No signal could be compared with the simulation.".to_owned()
        }
        Verdict::None => {
            format!("No effect is missing: every residual is {}.", at_floor(findings.residuals))
        }
    }
}

/// Sentence about the residual with all effects.
fn remaining(findings: &Findings<'_, '_>) -> String {
    match above_floor(findings.residuals, findings.thresholds) {
        None => format!(" Every residual is then {}.", at_floor(findings.residuals)),
        Some((own, Some(ratio))) => format!(
            " The residual of {} is then still {ratio:.1} times its noise floor.",
            own.signal
        ),
        Some((own, None)) => format!(" No noise floor of {} could be measured.", own.signal),
    }
}

/// Ratio below which one decimal shows at most 1.0.
const ROUNDED_TO_ONE: f64 = 1.05;

/// How `residuals`, none of which is above its floor, compare with it.
fn at_floor(residuals: &[SignalResidual]) -> String {
    match residuals.iter().filter_map(floor_ratio).fold(0.0, f64::max) {
        ratio if ratio < ROUNDED_TO_ONE => "at its noise floor".to_owned(),
        ratio => format!("at most {ratio:.1} times its noise floor"),
    }
}

/// Summary where no effect of the catalogue explains the residual.
fn unexplained(
    unknown: Option<&Unknown>,
    above: Option<(&SignalResidual, Option<f64>)>,
    selected: Option<usize>,
) -> String {
    let lead = match selected {
        None => "No effect of the catalogue explains the residual".to_owned(),
        Some(count) => format!("None of the {count} selected effects explains the residual"),
    };
    match (unknown, above) {
        (Some(unknown), _) => format!(
            "{lead} of {}: {:.0} % of its square on the training sessions {} (F = {:.0}, p = {:.1e}, corrected \
             for {} comparisons).",
            unknown.signal,
            100.0 * unknown.fraction,
            dependence(&unknown.name),
            unknown.statistic,
            unknown.p_value,
            unknown.comparisons
        ),
        (None, Some((own, Some(ratio)))) => {
            format!("{lead} of {}, which is {ratio:.1} times its noise floor.", own.signal)
        }
        (None, Some((own, None))) => {
            format!("{lead} of {}, of which no noise floor could be measured.", own.signal)
        }
        (None, None) => format!("{lead}."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_at_several_locations_is_listed_once() {
        let names =
            [("drive.delay", Axis::A), ("drive.gain", Axis::Motors), ("drive.delay", Axis::B)];
        assert_eq!(each_once(names.into_iter()), "drive.delay on a and b, drive.gain");
        let waves = ["drive.ripple.motor"; 2].map(|name| (name, Axis::Single));
        assert_eq!(each_once(waves.into_iter()), "drive.ripple.motor (2 times)");
    }

    fn residual(after: Option<f64>, noise_floor: Option<f64>) -> SignalResidual {
        SignalResidual {
            stage: crate::effects::Domain::Drive,
            signal: "axis.q.force".to_owned(),
            unit: "N".to_owned(),
            band: "all".to_owned(),
            noise_floor,
            noise_floor_source: String::new(),
            train_before: None,
            train_after: after,
            validation_before: None,
            validation_after: after,
        }
    }

    fn answer(residuals: &[SignalResidual], effects: &[IdentifiedEffect]) -> Answer {
        Answer::of(&Findings {
            thresholds: &Thresholds::DEFAULT,
            start: &Twin::nominal(crate::twin::Machine::Axis),
            effects,
            indistinguishable: &[],
            parameter_changes: &[],
            residuals,
            selected: None,
            outcomes: &[],
        })
    }

    #[test]
    fn nothing_compared_is_no_verdict_about_the_machine() {
        let answer = answer(&[], &[]);
        assert_eq!(answer.verdict, Verdict::NotTestable);
        assert!(!answer.verdict.is_about_the_machine() && !answer.summary.is_empty());
    }

    proptest::proptest! {
        /// `none` only where every residual is at its floor and there is one.
        #[test]
        fn none_needs_every_residual_at_its_floor(
            values in proptest::collection::vec(
                (proptest::option::of(0.0..10.0_f64), proptest::option::of(0.0..3.0_f64)),
                0..6,
            )
        ) {
            let residuals: Vec<SignalResidual> =
                values.iter().map(|(after, floor)| residual(*after, *floor)).collect();
            let is_at_floor = |(after, floor): &(Option<f64>, Option<f64>)| match (after, floor) {
                (Some(after), Some(floor)) => *after <= Thresholds::DEFAULT.floor_ratio * floor,
                (Some(after), None) => *after == 0.0,
                (None, _) => false,
            };
            let all = !values.is_empty() && values.iter().all(is_at_floor);
            proptest::prop_assert_eq!(answer(&residuals, &[]).verdict == Verdict::None, all);
        }
    }
}
