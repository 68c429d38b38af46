//! What is told in the end: the verdict, and one sentence.

use super::{
    findings::{Class, NamedEffect, Refit, SignalGap, Verdict},
    rounds::Outcome,
};
use crate::{
    effects::Axis,
    twin::{Source, Twin},
};

/// Share by which a fitted parameter must move to speak for another machine.
const JUMP: f64 = 0.25;

/// Fewest parameters that jump together in another machine.
const LEAST_JUMPS: usize = 4;

/// Residual over its floor from which a twin whose machine is not known otherwise is called incomplete. Floors
/// are read from the measured signal alone and can be low where noise is coloured.
const FAR_ABOVE_FLOOR: f64 = 3.0;

/// Everything that a verdict rests on.
pub(super) struct Findings<'f, 'a> {
    /// The twin at the start.
    pub(super) start: &'f Twin,
    /// Whether the user gave it.
    pub(super) is_given: bool,
    pub(super) effects: &'f [NamedEffect],
    pub(super) class: &'f [Class],
    pub(super) refit: &'f [Refit],
    pub(super) gap: &'f [SignalGap],
    pub(super) outcomes: &'f [Outcome<'a>],
}

/// A verdict and its sentence.
pub(super) struct Told {
    pub(super) verdict: Verdict,
    pub(super) says: String,
}

impl Told {
    pub(super) fn of(findings: &Findings<'_, '_>) -> Self {
        let verdict = verdict(findings);
        Self { verdict, says: says(verdict, findings) }
    }
}

fn verdict(findings: &Findings<'_, '_>) -> Verdict {
    let Findings { start, effects, class, refit, outcomes, .. } = *findings;
    if is_other_machine(start, refit) {
        Verdict::DifferentMachine
    } else if !effects.is_empty() {
        if class.len() == effects.len() { Verdict::Ambiguous } else { Verdict::Named }
    } else if outcomes.iter().any(|outcome| outcome.unexplained.is_some())
        || far_off(findings).is_some()
    {
        Verdict::Unexplained
    } else if refit.is_empty() {
        Verdict::None
    } else {
        Verdict::RefitOnly
    }
}

/// The signal farthest above its floor, far above it, where nothing is known of what a twin of this machine
/// leaves.
fn far_off<'f>(findings: &Findings<'f, '_>) -> Option<(&'f SignalGap, f64)> {
    let ratio = |gap: &SignalGap| Some(gap.held_out_after.or(gap.train_after)? / gap.noise_floor?);
    let of_all = findings.gap.iter().filter_map(|gap| Some((gap, ratio(gap)?)));
    of_all
        .filter(|(_, ratio)| !findings.is_given && FAR_ABOVE_FLOOR < *ratio)
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Whether at least half of the fitted parameters moved, and several jumped.
fn is_other_machine(start: &Twin, refit: &[Refit]) -> bool {
    let fitted = start
        .instances
        .iter()
        .flat_map(|instance| &instance.values)
        .filter(|value| value.source == Source::Fitted && value.ci95.is_some())
        .count();
    let jumped = refit
        .iter()
        .filter(|refit| JUMP * refit.before.abs() < (refit.after - refit.before).abs())
        .count();
    LEAST_JUMPS <= jumped && fitted <= 2 * refit.len()
}

/// Each name once, with its places where it has several.
fn each_once<'n>(names: impl Iterator<Item = (&'n str, Axis)>) -> String {
    let mut places: Vec<(&str, Vec<String>)> = Vec::new();
    for (name, axis) in names {
        match places.iter_mut().find(|own| own.0 == name) {
            Some((_, axes)) => axes.push(axis.to_string()),
            None => places.push((name, vec![axis.to_string()])),
        }
    }
    let told = places.into_iter().map(|(name, axes)| match &axes[..] {
        [_] => name.to_owned(),
        _ => format!("{name} on {}", axes.join(" and ")),
    });
    told.collect::<Vec<_>>().join(", ")
}

fn says(verdict: Verdict, findings: &Findings<'_, '_>) -> String {
    let Findings { effects, class, refit, outcomes, .. } = *findings;
    match verdict {
        Verdict::Named | Verdict::Ambiguous => {
            let names = each_once(effects.iter().map(|own| (own.name.as_str(), own.axis)));
            let mut text = format!("The simulation was missing {names}.");
            for class in class {
                text += &format!(" The data cannot tell {} apart.", class.names.join(" from "));
            }
            text
        }
        Verdict::RefitOnly => {
            let names = each_once(refit.iter().map(|own| (own.name.as_str(), own.axis)));
            format!("Nothing is missing; known parameters moved: {names}.")
        }
        Verdict::Unexplained => {
            let unknown = outcomes.iter().find_map(|outcome| outcome.unexplained.as_ref());
            match (unknown, far_off(findings)) {
                (Some(unknown), _) => format!(
                    "Something is missing that no effect of the catalogue explains: {} of {} holds {:.0} % \
                     of what is left (F = {:.0}, p = {:.1e}).",
                    unknown.name,
                    unknown.signal,
                    100.0 * unknown.share,
                    unknown.statistic,
                    unknown.p_value
                ),
                (None, Some((gap, ratio))) => format!(
                    "The simulation stays {ratio:.1} times the noise away in {}, and no effect of the \
                     catalogue explains that.",
                    gap.signal
                ),
                (None, None) => String::new(),
            }
        }
        Verdict::DifferentMachine => {
            let names: Vec<&str> = refit.iter().map(|refit| refit.name.as_str()).collect();
            format!(
                "This is another machine than the twin's, or a rebuilt one: {} moved together. Calibrate a \
                 twin of its own with `klasktron calibrate`.",
                names.join(", ")
            )
        }
        _ => "Nothing is missing above the noise.".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_at_several_places_is_told_once() {
        let names =
            [("drive.delay", Axis::A), ("drive.gain", Axis::Motors), ("drive.delay", Axis::B)];
        assert_eq!(each_once(names.into_iter()), "drive.delay on a and b, drive.gain");
    }
}
