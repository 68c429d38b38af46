//! Options of the search: the effects that it may add, parameters that are known, and the error that it may make.

use super::{
    observer::{SILENT, SearchObserver},
    thresholds::{ThresholdValue, Thresholds},
};
use crate::{
    effects::{self, CATALOGUE, Effect, Parameter},
    twin::{Instance, Machine, Source, Twin, Value},
};
use std::{fmt, str::FromStr};
use strsim::levenshtein;

/// Reason why an option cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OptionError {
    /// No effect and no group of effects has this name.
    #[error("'{name}' is no effect and no group of effects{}", hint(nearest))]
    UnknownEffect {
        /// Name as it was given.
        name: String,
        /// Nearest known name.
        nearest: Option<String>,
    },
    /// The text is no assignment to a parameter.
    #[error(
        "'{text}' is no assignment; write EFFECT.PARAMETER=VALUE, such as drive.delay.delay_s=0.012"
    )]
    Syntax {
        /// Text as it was given.
        text: String,
    },
    /// The effect does not have this parameter.
    #[error("{effect} has no parameter '{name}'; its parameters are {}", known.join(", "))]
    UnknownParameter {
        /// Name of the effect.
        effect: &'static str,
        /// Parameter as it was given.
        name: String,
        /// Parameters of the effect.
        known: Vec<&'static str>,
    },
    /// The value is outside of the bounds.
    #[error(
        "{name} is {value}; allowed are {} to {}{}",
        rounded(bounds.0), rounded(bounds.1), after_space(unit)
    )]
    OutOfBounds {
        /// Dotted name of the parameter.
        name: String,
        /// Value as it was given.
        value: f64,
        /// Smallest and largest value.
        bounds: (f64, f64),
        /// Unit of all three.
        unit: &'static str,
    },
    /// The machine cannot have the effect.
    #[error("a {machine} cannot have the effect {effect}")]
    NotOnMachine {
        /// Kind of machine.
        machine: Machine,
        /// Name of the effect.
        effect: &'static str,
    },
    /// No threshold has this name.
    #[error("'{name}' is no threshold; similar: {}", similar.join(", "))]
    UnknownThreshold {
        /// Name as it was given.
        name: String,
        /// The most similar names.
        similar: Vec<&'static str>,
    },
    /// The text is no assignment to a threshold.
    #[error("'{text}' is no assignment; write NAME=VALUE, such as min_gain=0.02")]
    ThresholdSyntax {
        /// Text as it was given.
        text: String,
    },
    /// No effect is left to be tried.
    #[error("every effect is excluded; nothing is left to search for")]
    NothingLeft,
}

fn hint(nearest: &Option<String>) -> String {
    let known = "`klasktron effects` lists them";
    nearest.as_ref().map_or_else(
        || format!("; {known}"),
        |nearest| format!("; did you mean '{nearest}'? {known}"),
    )
}

/// `value` with at most four significant digits: the bounds of an axis follow from its recordings.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// `unit` after a space; empty without a unit.
fn after_space(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

/// Parameter of an effect with a value that is known and never fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedParameter {
    effect: &'static Effect,
    /// Name of the parameter.
    parameter: &'static str,
    value: f64,
}

impl FromStr for FixedParameter {
    type Err = OptionError;

    fn from_str(text: &str) -> Result<Self, OptionError> {
        let syntax = || OptionError::Syntax { text: text.to_owned() };
        let (name, value) = text.split_once('=').ok_or_else(syntax)?;
        let value: f64 =
            value.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(syntax)?;
        let (effect, parameter) = name.trim().rsplit_once('.').ok_or_else(syntax)?;
        let effect = effects::find(effect).ok_or_else(|| unknown(effect))?;
        // The machine is not known yet.
        let found = parameter_of(effect, parameter).or_else(|unknown| {
            parameter_of(effect.form_on_axis([parameter]), parameter).map_err(|_| unknown)
        });
        Ok(Self { effect, parameter: found?.name, value })
    }
}

/// The parameter called `name` of `effect`.
fn parameter_of(effect: &'static Effect, name: &str) -> Result<&'static Parameter, OptionError> {
    effect.parameters.iter().find(|own| own.name == name).ok_or_else(|| {
        OptionError::UnknownParameter {
            effect: effect.name,
            name: name.to_owned(),
            known: effect.parameters.iter().map(|own| own.name).collect(),
        }
    })
}

impl fmt::Display for FixedParameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}={}", self.effect.name, self.parameter, self.value)
    }
}

impl FixedParameter {
    /// The parameter of the effect on the machine of `twin`, in its units.
    fn on(self, twin: &Twin) -> Result<Self, OptionError> {
        if twin.machine.axes(self.effect.site).is_empty() {
            let (machine, effect) = (twin.machine, self.effect.name);
            return Err(OptionError::NotOnMachine { machine, effect });
        }
        let effect = twin.form_of(self.effect, [self.parameter]);
        let own = parameter_of(effect, self.parameter)?;
        let (low, high) = own.bounds;
        if !(low..=high).contains(&self.value) {
            return Err(OptionError::OutOfBounds {
                name: format!("{}.{}", effect.name, own.name),
                value: self.value,
                bounds: own.bounds,
                unit: own.unit,
            });
        }
        Ok(Self { effect, ..self })
    }

    fn is_in(&self, twin: &Twin) -> bool {
        twin.instances.iter().any(|own| own.effect == self.effect)
    }

    /// Set the parameter in `twin` at every location of the effect, which is added where the twin lacks it. Other
    /// parameters of an added effect begin at its first probe.
    fn apply(&self, twin: &mut Twin) {
        if !self.is_in(twin) {
            let location = twin.machine.axes(self.effect.site).first().copied();
            let probe = self.effect.probes.first().copied().unwrap_or(self.effect.null);
            twin.instances.extend(
                location
                    .map(|location| Instance::new(self.effect, location, probe, Source::Nominal)),
            );
        }
        let mut parameters = self.effect.parameters.iter();
        let Some(index) = parameters.position(|own| own.name == self.parameter) else { return };
        for own in twin.instances.iter_mut().filter(|own| own.effect == self.effect) {
            own.values[index] = Value { value: self.value, ci95: None, source: Source::Known };
        }
    }
}

/// Options of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// Effects of the user, which are candidates in addition to those of the catalogue.
    defined: Vec<&'static Effect>,
    /// Selected effects; `None` for all.
    selected: Option<Vec<&'static Effect>>,
    /// Effects that were selected one by one, not as a group.
    named: Vec<&'static Effect>,
    fixed: Vec<FixedParameter>,
    thresholds: Thresholds,
}

/// Options without any choice.
static PLAIN: SearchOptions = SearchOptions {
    defined: Vec::new(),
    selected: None,
    named: Vec::new(),
    fixed: Vec::new(),
    thresholds: Thresholds::DEFAULT,
};

impl Default for SearchOptions {
    fn default() -> Self {
        PLAIN.clone()
    }
}

impl SearchOptions {
    /// Add effects that the user [defined](effects::define) to the candidates; before [`select`](Self::select).
    #[must_use]
    pub fn with_effects(mut self, defined: Vec<&'static Effect>) -> Self {
        self.defined = defined;
        self
    }

    /// Effects of the user.
    #[must_use]
    pub fn defined(&self) -> &[&'static Effect] {
        &self.defined
    }

    /// The catalogue and the effects of the user, without what is not selected.
    pub(super) fn candidates(&self) -> impl Iterator<Item = &'static Effect> {
        let all = CATALOGUE.iter().chain(&self.defined).copied();
        all.filter(|effect| self.selects(effect))
    }

    /// Select the effects in `only` (all, if it is empty) that are not in `exclude`. A name is that of an effect, or of
    /// a group such as `drive.friction`. Only selected effects are added by [`Task::CloseGap`](super::Task::CloseGap),
    /// and only their parameters are fitted by [`Task::Calibrate`](super::Task::Calibrate).
    ///
    /// # Errors
    /// A name is unknown, or no effect is left.
    pub fn select(mut self, only: &[String], exclude: &[String]) -> Result<Self, OptionError> {
        let of = |names: &[String]| -> Result<Vec<Vec<&'static Effect>>, OptionError> {
            names.iter().map(|name| group(name)).collect()
        };
        let (names, only, exclude) = (only, of(only)?.concat(), of(exclude)?.concat());
        let is_named = |own: &&'static Effect| names.iter().any(|name| name == own.name);
        self.named = only.iter().copied().filter(is_named).collect();
        if only.is_empty() && exclude.is_empty() {
            return Ok(self);
        }
        let is_selected = |effect: &&'static Effect| {
            (only.is_empty() || only.contains(effect)) && !exclude.contains(effect)
        };
        let selected: Vec<&'static Effect> =
            CATALOGUE.iter().chain(&self.defined).copied().filter(is_selected).collect();
        if selected.is_empty() {
            return Err(OptionError::NothingLeft);
        }
        self.selected = Some(selected);
        Ok(self)
    }

    /// The same search over `effects` instead of the catalogue.
    #[must_use]
    pub(super) fn over(&self, effects: Vec<&'static Effect>) -> Self {
        Self { defined: effects.clone(), selected: Some(effects), ..self.clone() }
    }

    /// Check that an effect or a group of effects is called `name`.
    ///
    /// # Errors
    /// None is.
    pub fn check_name(name: &str) -> Result<(), OptionError> {
        group(name).map(|_| ())
    }

    /// Set parameters that are known, in the units of the machine of `twin`.
    ///
    /// # Errors
    /// The machine cannot have one of the effects, parameters or values.
    pub fn fix(mut self, fixed: &[FixedParameter], twin: &Twin) -> Result<Self, OptionError> {
        self.fixed = fixed.iter().map(|own| own.on(twin)).collect::<Result<_, _>>()?;
        Ok(self)
    }

    /// Set the family-wise error, 0 to 1. A larger one finds weaker effects and more false ones.
    #[must_use]
    pub fn with_family_error(mut self, family_error: f64) -> Self {
        self.thresholds.family_error = family_error;
        self
    }

    /// Set thresholds.
    #[must_use]
    pub fn with_thresholds(mut self, values: &[ThresholdValue]) -> Self {
        self.thresholds = self.thresholds.with(values);
        self
    }

    /// Thresholds of all decisions.
    #[must_use]
    pub fn thresholds(&self) -> &Thresholds {
        &self.thresholds
    }

    /// Effects to which [`select`](Self::select) restricts the search; `None` where it does not.
    #[must_use]
    pub fn selected(&self) -> Option<&[&'static Effect]> {
        self.selected.as_deref()
    }

    /// Effects that [`select`](Self::select) names one by one.
    pub(super) fn named(&self) -> &[&'static Effect] {
        &self.named
    }

    /// Return whether `effect` is selected.
    #[must_use]
    pub fn selects(&self, effect: &Effect) -> bool {
        self.selected
            .as_ref()
            .is_none_or(|selected| selected.iter().any(|own| own.name == effect.name))
    }

    /// Parameters that are known of effects that `twin` does not have.
    pub(super) fn added_to(&self, twin: &Twin) -> impl Iterator<Item = &FixedParameter> {
        self.fixed.iter().filter(|own| !own.is_in(twin))
    }

    /// `twin` with the known parameters.
    #[must_use]
    pub(super) fn applied_to(&self, mut twin: Twin) -> Twin {
        self.fixed.iter().for_each(|own| own.apply(&mut twin));
        twin
    }
}

/// Options of a search and the observer of its progress.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// Options.
    pub options: &'a SearchOptions,
    /// Observer, which does not change the result.
    pub observer: &'a dyn SearchObserver,
}

impl Default for Context<'_> {
    fn default() -> Self {
        Self { options: &PLAIN, observer: &SILENT }
    }
}

/// Effects called `name`, or of the group of that name.
///
/// # Errors
/// No effect has this name.
fn group(name: &str) -> Result<Vec<&'static Effect>, OptionError> {
    let name = name.trim_end_matches(".*");
    let is_in = |effect: &&'static Effect| {
        effect.name == name
            || effect.name.strip_prefix(name).is_some_and(|rest| rest.starts_with('.'))
    };
    let found: Vec<&'static Effect> = CATALOGUE.iter().copied().filter(is_in).collect();
    if !found.is_empty() {
        return Ok(found);
    }
    effects::find(name).map(|own| vec![own]).ok_or_else(|| unknown(name))
}

fn unknown(name: &str) -> OptionError {
    let groups = CATALOGUE.iter().flat_map(|effect| {
        effect.name.match_indices('.').map(|(end, _)| &effect.name[..end]).chain([effect.name])
    });
    let near = |other: &&str| levenshtein(name, other) <= 1 + name.chars().count() / 4;
    let nearest = groups.filter(near).min_by_key(|other| levenshtein(name, other));
    OptionError::UnknownEffect { name: name.to_owned(), nearest: nearest.map(str::to_owned) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{effects::AxisScales, twin::AxisFrame};

    fn select(only: &[&str], exclude: &[&str]) -> Result<SearchOptions, OptionError> {
        let own = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        SearchOptions::default().select(&own(only), &own(exclude))
    }

    fn selects(options: &SearchOptions, name: &str) -> bool {
        options.selects(effects::find(name).unwrap())
    }

    #[test]
    fn a_name_selects_an_effect_or_a_group() {
        let friction = select(&["drive.friction"], &["drive.friction.asymmetric"]).unwrap();
        assert!(selects(&friction, "drive.friction.viscous"));
        assert!(!selects(&friction, "drive.friction.asymmetric"));
        assert!(!selects(&friction, "drive.delay"));
        let all_but = select(&[], &["drive.delay"]).unwrap();
        assert!(selects(&all_but, "drive.gain") && !selects(&all_but, "drive.delay"));
        assert_eq!(select(&["drive.delay"], &["drive"]), Err(OptionError::NothingLeft));
        assert_eq!(select(&[], &[]).unwrap(), SearchOptions::default());
    }

    #[test]
    fn an_unknown_name_has_the_nearest_one() {
        let said = |name: &str| select(&[name], &[]).unwrap_err().to_string();
        assert!(said("drive.dealy").contains("did you mean 'drive.delay'?"));
        assert!(said("drive.frction").contains("did you mean 'drive.friction'?"));
        // A part of a word is no group.
        assert!(said("drive.fric").starts_with("'drive.fric' is no effect"));
    }

    #[test]
    fn a_fixed_parameter_is_known_in_the_twin() {
        let fixed: FixedParameter = "drive.delay.delay_s=0.012".parse().unwrap();
        assert_eq!(fixed.to_string(), "drive.delay.delay_s=0.012");
        let options =
            SearchOptions::default().fix(&[fixed], &Twin::nominal(Machine::Table)).unwrap();
        let nominal = Twin::nominal(Machine::Table);
        assert_eq!(options.added_to(&nominal).collect::<Vec<_>>(), [&options.fixed[0]]);
        let twin = options.applied_to(nominal);
        assert_eq!(options.added_to(&twin).count(), 0);
        let own = twin.instances.iter().find(|own| own.effect.name == "drive.delay").unwrap();
        assert_eq!((own.values[0].value, own.values[0].source), (0.012, Source::Known));
        let again = options.applied_to(twin.clone());
        assert_eq!(again.instances.len(), twin.instances.len());
    }

    #[test]
    fn a_wrong_assignment_is_refused_with_the_way_out() {
        let said = |text: &str| text.parse::<FixedParameter>().unwrap_err().to_string();
        assert!(said("drive.delay").contains("write EFFECT.PARAMETER=VALUE"));
        assert!(said("drive.delay.delay_s=fast").contains("write EFFECT.PARAMETER=VALUE"));
        assert!(said("drive.dealy.delay_s=0.01").contains("did you mean 'drive.delay'?"));
        assert!(said("drive.delay.delay=0.01").contains("its parameters are delay_s"));
        let fixed = |text: &str, twin: &Twin| {
            SearchOptions::default().fix(&[text.parse().unwrap()], twin).map_err(|e| e.to_string())
        };
        let table = Twin::nominal(Machine::Table);
        let said = fixed("drive.delay.delay_s=7", &table).unwrap_err();
        assert!(said.contains("is 7; allowed are -0.02 to 0.2 s"), "{said}");
        let said = fixed("drive.compliance.belt.frequency_hz=0.5", &table).unwrap_err();
        assert!(said.contains("compliance_m_per_n, load_fraction, damping_ratio"), "{said}");
    }

    #[test]
    fn a_parameter_of_a_single_axis_has_the_bounds_of_its_recordings() {
        let scales = AxisScales {
            input: 5000.0,
            position: 0.3,
            velocity: 0.6,
            acceleration: 3.0,
            sample_period: 0.01,
            band: 4.0,
            duration: 60.0,
            input_unit: "N",
            position_unit: "m",
        };
        let axis_frame = Some(AxisFrame { position_origin: 0.0, scales });
        let press = Twin { axis_frame, ..Twin::nominal(Machine::Axis) };
        let fixed = |text: &str| {
            SearchOptions::default()
                .fix(&[text.parse().unwrap()], &press)
                .map_err(|e| e.to_string())
        };
        for text in [
            "gantry.inertia.mass_kg=7000",
            "drive.delay.delay_s=0.7",
            "drive.compliance.belt.load_fraction=0.5",
            "drive.compliance.belt.resonance_period_s=1.5",
        ] {
            assert!(fixed(text).is_ok(), "{text}: {:?}", fixed(text));
        }
        let said = fixed("drive.delay.delay_s=7").unwrap_err();
        assert!(said.contains("is 7; allowed are -0.2 to 2 s"), "{said}");
    }
}
