//! Description of a residual that no effect of the catalogue explains: a sparse sum of dimensionless features of the
//! motion.
//!
//! The features replace the catalogue in a second search of the stage, from the twin with which the first one ended.
//! Effects and features pass the same screen, joint fit, validation and elimination. A feature that passes is a
//! description and not an effect, and the twin does not receive it.

mod features;

use super::{
    findings::{Description, DescriptionScale, DescriptionTerm},
    journal::{JournalEntry, MoveComparison, MoveKind},
    options::SearchOptions,
    page::text::digits,
    rounds::{self, Added, Outcome},
};
use crate::twin::{Stage, StageKind, Twin};
use features::{Candidate, Sizes};

/// Significant digits of a coefficient in the equation.
const DIGITS: usize = 3;

/// Features of one stage and what their symbols are.
pub(super) struct Features {
    stage: StageKind,
    sizes: Sizes,
    candidates: Vec<Candidate>,
}

impl Features {
    /// Features on the stage of `outcome`; `None` where no force acts there, and where nothing moved.
    pub(super) fn of(outcome: &Outcome<'_>) -> Option<Self> {
        if !matches!(outcome.kind, StageKind::Axis | StageKind::Drive) {
            return None;
        }
        let stages: Vec<&dyn Stage> = outcome.train.parts.iter().map(|part| part.stage).collect();
        let sizes = Sizes::of(&outcome.last.point.twin, &stages)?;
        let candidates = features::candidates(&sizes);
        Some(Self { stage: outcome.kind, sizes, candidates })
    }

    /// Options of a search over the features.
    pub(super) fn options(&self, of_search: &SearchOptions) -> SearchOptions {
        of_search.over(self.candidates.iter().map(|own| own.effect).collect())
    }

    /// Description from the `outcome` of the search over the features, and `twin`, its final twin with intervals.
    pub(super) fn description(&self, outcome: &Outcome<'_>, twin: &Twin) -> Option<Description> {
        let terms: Vec<DescriptionTerm> =
            outcome.added.iter().filter_map(|step| self.term(step, twin, outcome)).collect();
        let left: Option<f64> =
            terms.iter().map(|term| term.validation_gain.map(|gain| 1.0 - gain)).product();
        (!terms.is_empty()).then(|| Description {
            stage: self.stage,
            equation: equation(self.stage, &terms),
            scales: self.scales_in(&terms),
            validation_gain: left.map(|left| 1.0 - left),
            terms,
        })
    }

    fn term(&self, step: &Added, twin: &Twin, outcome: &Outcome<'_>) -> Option<DescriptionTerm> {
        let is_validated = !outcome.held_out.parts.is_empty();
        let instance = &twin.instances[rounds::instance_of(twin, step)?];
        let value = &instance.values[0];
        Some(DescriptionTerm {
            feature: self.shown(step.effect.name).to_owned(),
            location: step.axis,
            coefficient: value.value,
            ci95: value.ci95?,
            unit: self.sizes.force_unit.clone(),
            expression: step.effect.equation.to_owned(),
            p_value: step.p_value,
            comparisons: step.comparisons,
            validation_gain: is_validated.then_some(step.validation_gain),
            indistinguishable: step
                .indistinguishable
                .iter()
                .map(|name| self.shown(name).to_owned())
                .collect(),
        })
    }

    /// Text of the feature whose effect is called `name`.
    fn shown(&self, name: &str) -> &'static str {
        let own = self.candidates.iter().find(|own| own.effect.name == name);
        own.map_or("", |own| own.shown)
    }

    /// Scales of the symbols in `terms`.
    fn scales_in(&self, terms: &[DescriptionTerm]) -> Vec<DescriptionScale> {
        let texts =
            || terms.iter().flat_map(|term| term.indistinguishable.iter().chain([&term.feature]));
        let is_used = |own: &DescriptionScale| texts().any(|text| has_symbol(text, &own.symbol));
        self.sizes.scales().into_iter().filter(is_used).collect()
    }

    /// Entries of the journal about a `description`, or about none.
    pub(super) fn entries(&self, description: Option<&Description>) -> Vec<JournalEntry> {
        let Some(description) = description else {
            let reason = format!("{}; the residual has no description", self.none_passed());
            return vec![JournalEntry::new(MoveKind::Describe, Some(self.stage), reason)];
        };
        let entry = |term: &DescriptionTerm| {
            let comparison = MoveComparison {
                validation_gain: term.validation_gain,
                p_value: Some(term.p_value),
                comparisons: Some(term.comparisons),
                ..MoveComparison::default()
            };
            let reason = format!(
                "The feature {}{} passed every check of an effect; it describes the residual and names no cause",
                term.feature,
                term.location.phrase()
            );
            JournalEntry::new(MoveKind::Describe, Some(self.stage), reason).compared(comparison)
        };
        description.terms.iter().map(entry).collect()
    }

    /// Sentence where no feature passed, without a full stop.
    pub(super) fn none_passed(&self) -> String {
        format!(
            "None of {} features of position, velocity, acceleration{} and time passed the tests of an effect",
            self.candidates.len(),
            if self.stage == StageKind::Drive { ", input" } else { "" }
        )
    }
}

/// Sentence about a `description`.
pub(super) fn sentence(description: &Description) -> String {
    format!("Description, not a cause: {}.", description.equation)
}

/// Return whether `symbol` is a word of `text`.
fn has_symbol(text: &str, symbol: &str) -> bool {
    text.split(|letter: char| !letter.is_alphabetic()).any(|word| word == symbol)
}

/// The sum of `terms` as text, location by location; a single axis has one.
fn equation(stage: StageKind, terms: &[DescriptionTerm]) -> String {
    let mut locations: Vec<_> = terms.iter().map(|term| term.location).collect();
    locations.sort_unstable();
    locations.dedup();
    let sum = |location| {
        let own = terms.iter().filter(|term| term.location == location);
        let mut text = String::new();
        for term in own {
            let sign = match (text.is_empty(), term.coefficient < 0.0) {
                (true, true) => "-",
                (true, false) => "",
                (false, true) => " - ",
                (false, false) => " + ",
            };
            text += &format!(
                "{sign}{} {}",
                digits(term.coefficient.abs(), DIGITS),
                if term.feature == "1" { "" } else { &term.feature }
            );
        }
        text.trim_end().to_owned()
    };
    let unit = terms.first().map_or("", |term| term.unit.as_str());
    let all = locations.into_iter().map(|location| match stage {
        StageKind::Axis => format!("F = {}", sum(location)),
        _ => format!("F({location}) = {}", sum(location)),
    });
    format!("{} (in {unit})", all.collect::<Vec<_>>().join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Axis;

    fn term(feature: &str, location: Axis, coefficient: f64) -> DescriptionTerm {
        DescriptionTerm {
            feature: feature.to_owned(),
            location,
            coefficient,
            ci95: [coefficient - 1.0, coefficient + 1.0],
            unit: "N".to_owned(),
            expression: String::new(),
            p_value: 1e-9,
            comparisons: 30,
            validation_gain: Some(0.5),
            indistinguishable: Vec::new(),
        }
    }

    #[test]
    fn an_equation_has_a_sum_per_location() {
        let terms = [
            term("[v > 0] v^3", Axis::X, -2.5),
            term("1", Axis::Y, 4.0),
            term("x^2 sign(v)", Axis::X, 0.125),
        ];
        assert_eq!(
            equation(StageKind::Drive, &terms),
            "F(x) = -2.50 [v > 0] v^3 + 0.125 x^2 sign(v); F(y) = 4.00 (in N)"
        );
        assert_eq!(equation(StageKind::Axis, &terms[1..2]), "F = 4.00 (in N)");
    }

    #[test]
    fn symbols_are_whole_words() {
        assert!(has_symbol("sin(2 theta)", "theta") && has_symbol("[v > 0] v^3", "v"));
        assert!(!has_symbol("sin(2 theta)", "t") && !has_symbol("x^2 sign(v)", "a"));
    }
}
