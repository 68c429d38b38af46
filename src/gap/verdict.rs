//! The verdict and its summary.

use super::{
    findings::{IdentifiedEffect, Indistinguishable, ParameterChange, SignalResidual, Verdict},
    rounds::Outcome,
    unknown::Unknown,
};
use crate::{
    effects::Axis,
    twin::{Source, Twin},
};

/// Relative change of a fitted parameter that indicates another machine.
const JUMP: f64 = 0.25;

/// Fewest parameters that change so much together in another machine.
const LEAST_JUMPS: usize = 4;

/// Ratio of residual and noise floor from which a twin without reference residuals is incomplete. Floors come from the
/// measured signal alone and can be low where the noise is coloured.
const FAR_ABOVE_FLOOR: f64 = 3.0;

/// Everything behind a verdict.
pub(super) struct Findings<'f, 'a> {
    /// The twin at the start.
    pub(super) start: &'f Twin,
    /// Whether the user gave it.
    pub(super) is_given: bool,
    pub(super) effects: &'f [IdentifiedEffect],
    pub(super) indistinguishable: &'f [Indistinguishable],
    pub(super) parameter_changes: &'f [ParameterChange],
    pub(super) residuals: &'f [SignalResidual],
    pub(super) outcomes: &'f [Outcome<'a>],
}

/// A verdict and its summary.
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
    let Findings { start, effects, indistinguishable, parameter_changes, outcomes, .. } = *findings;
    if is_other_machine(start, parameter_changes) {
        Verdict::DifferentMachine
    } else if !effects.is_empty() {
        if indistinguishable.len() == effects.len() { Verdict::Ambiguous } else { Verdict::Named }
    } else if outcomes.iter().any(|outcome| outcome.unexplained.is_some())
        || far_above_floor(findings).is_some()
    {
        Verdict::Unexplained
    } else if parameter_changes.is_empty() {
        Verdict::None
    } else {
        Verdict::RefitOnly
    }
}

/// The signal farthest above its floor and the ratio, where it is far above and the user gave no twin.
fn far_above_floor<'f>(findings: &Findings<'f, '_>) -> Option<(&'f SignalResidual, f64)> {
    let ratio =
        |own: &SignalResidual| Some(own.validation_after.or(own.train_after)? / own.noise_floor?);
    let of_all = findings.residuals.iter().filter_map(|own| Some((own, ratio(own)?)));
    of_all
        .filter(|(_, ratio)| !findings.is_given && FAR_ABOVE_FLOOR < *ratio)
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Return whether at least half of the fitted parameters changed, and several of them far.
fn is_other_machine(start: &Twin, changes: &[ParameterChange]) -> bool {
    let fitted = start
        .instances
        .iter()
        .flat_map(|instance| &instance.values)
        .filter(|value| value.source == Source::Fitted && value.ci95.is_some())
        .count();
    let jumped = changes
        .iter()
        .filter(|change| JUMP * change.before.abs() < (change.after - change.before).abs())
        .count();
    LEAST_JUMPS <= jumped && fitted <= 2 * changes.len()
}

/// Each name once, with its locations where it has several.
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
            text
        }
        Verdict::RefitOnly => {
            let changes = parameter_changes.iter().map(|own| (own.name.as_str(), own.location));
            format!("No effect is missing; known parameters changed: {}.", each_once(changes))
        }
        Verdict::Unexplained => {
            let unknown = outcomes.iter().find_map(|outcome| outcome.unexplained.as_ref());
            unexplained(unknown, far_above_floor(findings))
        }
        Verdict::DifferentMachine => {
            let names: Vec<&str> = parameter_changes.iter().map(|own| own.name.as_str()).collect();
            format!(
                "The recordings are of another machine than the twin, or of a rebuilt one: {} changed together. \
                 Calibrate a twin of its own with `klasktron calibrate`.",
                names.join(", ")
            )
        }
        _ => "No effect is missing: every residual is at its floor.".to_owned(),
    }
}

/// Summary where no effect of the catalogue explains the residual.
fn unexplained(unknown: Option<&Unknown>, far: Option<(&SignalResidual, f64)>) -> String {
    let lead = "No effect of the catalogue explains the residual";
    match (unknown, far) {
        (Some(unknown), _) => format!(
            "{lead}: {} of {} holds {:.0} % of its square on the training sessions (F = {:.0}, p = {:.1e}, corrected \
             for {} comparisons).",
            unknown.name,
            unknown.signal,
            100.0 * unknown.share,
            unknown.statistic,
            unknown.p_value,
            unknown.comparisons
        ),
        (None, Some((own, ratio))) => {
            format!("{lead} of {}, which is {ratio:.1} times its noise floor.", own.signal)
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
    }
}
