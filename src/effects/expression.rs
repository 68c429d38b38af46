//! Effects that a user defines by an expression.
//!
//! A definition is data and no code: an expression is parsed once by [exmex](https://docs.rs/exmex) and evaluated with
//! numbers only. It is screened, fitted and simulated like an effect of the catalogue.

use super::{CATALOGUE, Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site, find};
use exmex::{Express, FlatEx};
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};
use strsim::levenshtein;

/// Largest number of parameters of one effect.
const MOST_PARAMETERS: usize = 8;

/// Bounds of a parameter, in its typical sizes.
const LARGEST: f64 = 1e3;
const SMALLEST: f64 = 1e-3;

/// Starts of a parameter that shapes the effect, in its typical sizes.
const SHAPES: [f64; 2] = [0.4, 2.5];

/// Largest absolute value of an expression without effect, in its value at the typical sizes.
const NOTHING: f64 = 1e-12;

/// Place in the measured chain where an expression acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// Force along the coordinate (N, or the unit of the input of a single axis).
    Force,
    /// Level of a friction that opposes the motion and holds at rest; a negative value counts as zero.
    Friction,
    /// Command of a motor (m/s of belt), or input of a single axis, to what the drive takes it for.
    Input,
    /// Position of a motor (m of belt) to what its encoder reports; not on a single axis.
    Output,
}

/// Coordinates in which an expression acts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coordinates {
    /// The guides x and y, or the coordinate of a single axis.
    #[default]
    Guides,
    /// The belts a and b.
    Motors,
}

/// Sign that a parameter may have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sign {
    /// Any.
    #[default]
    Any,
    /// Zero or more.
    Positive,
}

/// Parameter of a definition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterDefinition {
    /// Name in the expression.
    pub name: String,
    /// Unit, `1` for a ratio.
    pub unit: String,
    /// Size at which the effect would be noticeable, above 0, in this unit.
    pub typical: f64,
    /// Sign that it may have.
    #[serde(default)]
    pub sign: Sign,
}

/// Effect as its user wrote it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Dotted name that no effect of the catalogue has.
    pub name: String,
    /// One-line description.
    #[serde(default)]
    pub summary: String,
    /// Place in the measured chain.
    pub place: Place,
    /// Coordinates of a force or friction.
    #[serde(default)]
    pub coordinates: Coordinates,
    /// Expression of [`VARIABLES`] and the parameters.
    pub expression: String,
    /// Motion that excites it.
    #[serde(default)]
    pub excitation: String,
    /// Effects with a similar residual.
    #[serde(default)]
    pub confused_with: Vec<String>,
    /// Parameters. Without effect the first one is zero, or all are.
    #[serde(rename = "parameter")]
    pub parameters: Vec<ParameterDefinition>,
}

/// Reason why a definition cannot be used, and the part of it that is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what}")]
pub struct DefinitionError {
    /// Wrong text of the definition.
    pub text: String,
    /// What is wrong, and the way out.
    pub what: String,
}

impl DefinitionError {
    fn new(text: &str, what: impl Into<String>) -> Self {
        Self { text: text.to_owned(), what: what.into() }
    }
}

/// Quantity that an expression may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Variable {
    Position,
    Velocity,
    Acceleration,
    Input,
    Time,
    RunStartTime,
}

/// Names that an expression may use. `position`, `velocity` and `acceleration` are those of the coordinate; `input` is
/// the drive force along it, or the command where the place is `input`; `time` is in seconds since the session began,
/// and `run_start_time` is when its run began. All are in the units of the recording.
pub const VARIABLES: [&str; 6] =
    ["position", "velocity", "acceleration", "input", "time", "run_start_time"];

const OF_NAMES: [Variable; 6] = [
    Variable::Position,
    Variable::Velocity,
    Variable::Acceleration,
    Variable::Input,
    Variable::Time,
    Variable::RunStartTime,
];

impl Variable {
    fn of(self, motion: &Motion) -> f64 {
        match self {
            Self::Position => motion.position + motion.position_origin,
            Self::Velocity => motion.velocity,
            Self::Acceleration => motion.acceleration,
            Self::Input => motion.force,
            Self::Time => motion.time,
            Self::RunStartTime => motion.run_start_time,
        }
    }

    fn regressors(self) -> &'static [Regressor] {
        match self {
            Self::Position => &[Regressor::Position],
            Self::Velocity => &[Regressor::Velocity, Regressor::Direction],
            Self::Acceleration => &[Regressor::Acceleration],
            Self::Input => &[Regressor::Command],
            Self::Time | Self::RunStartTime => &[Regressor::Time],
        }
    }
}

impl Place {
    /// Variables of an expression at this place.
    fn variables(self) -> &'static [Variable] {
        match self {
            Self::Force | Self::Friction => &OF_NAMES,
            Self::Input => &[Variable::Input],
            Self::Output => &[Variable::Position],
        }
    }

    /// Value of an expression that does nothing.
    fn unchanged(self, motion: &Motion) -> f64 {
        match self {
            Self::Force | Self::Friction => 0.0,
            Self::Input => motion.force,
            Self::Output => motion.position,
        }
    }
}

/// Argument of a parsed expression.
#[derive(Debug, Clone, Copy)]
enum Argument {
    Variable(Variable),
    Parameter(usize),
}

/// Parsed expression of a definition.
#[derive(Debug)]
pub struct Expression {
    definition: Definition,
    parsed: FlatEx<f64>,
    /// In the order in which the parsed expression takes them.
    arguments: Vec<Argument>,
}

impl Expression {
    fn parse(definition: &Definition) -> Result<Self, DefinitionError> {
        let text = &definition.expression;
        let wrong = |what: String| DefinitionError::new(text, what);
        let parsed = exmex::parse::<f64>(text)
            .map_err(|error| wrong(format!("the expression '{text}' cannot be read: {error}")))?;
        let arguments = parsed
            .var_names()
            .iter()
            .map(|name| argument(definition, name).map_err(wrong))
            .collect::<Result<Vec<_>, _>>()?;
        for (index, parameter) in definition.parameters.iter().enumerate() {
            let is_used =
                |own: &Argument| matches!(own, Argument::Parameter(used) if *used == index);
            if !arguments.iter().any(is_used) {
                return Err(DefinitionError::new(
                    &parameter.name,
                    format!(
                        "the parameter '{}' is not in the expression '{text}'; use it or leave it out",
                        parameter.name
                    ),
                ));
            }
        }
        Ok(Self { definition: definition.clone(), parsed, arguments })
    }

    /// Definition from which it was parsed.
    #[must_use]
    pub fn definition(&self) -> &Definition {
        &self.definition
    }

    /// Value with the parameters `p` at `motion`; NaN where the expression has none.
    #[must_use]
    pub fn value(&self, p: &[f64], motion: &Motion) -> f64 {
        let mut values = [0.0; VARIABLES.len() + MOST_PARAMETERS];
        for (value, argument) in values.iter_mut().zip(&self.arguments) {
            *value = match argument {
                Argument::Variable(variable) => variable.of(motion),
                Argument::Parameter(index) => p.get(*index).copied().unwrap_or(f64::NAN),
            };
        }
        self.parsed.eval(&values[..self.arguments.len()]).unwrap_or(f64::NAN)
    }

    /// Level of friction (not negative) with the parameters `p` at `motion`.
    #[must_use]
    pub fn level(&self, p: &[f64], motion: &Motion) -> f64 {
        let value = self.value(p, motion);
        // Not `max`, which would hide a NaN.
        if value < 0.0 { 0.0 } else { value }
    }

    /// Value where the expression depends on `value` alone, as an input or a reported position does.
    #[must_use]
    pub fn of_value(&self, p: &[f64], value: f64) -> f64 {
        self.value(p, &Motion { position: value, force: value, ..Motion::default() })
    }

    fn uses(&self, variable: Variable) -> bool {
        self.arguments
            .iter()
            .any(|own| matches!(own, Argument::Variable(used) if *used == variable))
    }

    /// First of the `motions` at which the expression has no finite value at its typical sizes, in words.
    #[must_use]
    pub fn undefined_at(&self, motions: impl IntoIterator<Item = Motion>) -> Option<String> {
        let typical: Vec<f64> = self.definition.parameters.iter().map(|own| own.typical).collect();
        let is_undefined = |motion: &Motion| !self.value(&typical, motion).is_finite();
        let motion = motions.into_iter().find(is_undefined)?;
        let used = VARIABLES.iter().zip(OF_NAMES).filter(|(_, variable)| self.uses(*variable));
        let at: Vec<String> =
            used.map(|(name, variable)| format!("{name} = {}", variable.of(&motion))).collect();
        Some(format!(
            "'{}' is {} at {}",
            self.definition.expression,
            self.value(&typical, &motion),
            at.join(", ")
        ))
    }

    /// Parameters without effect: the first zero, or all.
    fn null(&self) -> Result<Vec<f64>, DefinitionError> {
        let definition = &self.definition;
        let typical: Vec<f64> = definition.parameters.iter().map(|own| own.typical).collect();
        let mut first = typical.clone();
        first[0] = 0.0;
        for null in [first, vec![0.0; typical.len()]] {
            if samples().all(|motion| self.does_nothing(&null, &typical, &motion)) {
                return Ok(null);
            }
        }
        let name = &definition.parameters[0].name;
        let without = match definition.place {
            Place::Force | Place::Friction => "0",
            Place::Input => "input",
            Place::Output => "position",
        };
        Err(DefinitionError::new(
            &definition.expression,
            format!(
                "the expression '{}' must be {without} where its first parameter, '{name}', is 0; reorder the \
                 parameters or change the expression",
                definition.expression
            ),
        ))
    }

    fn does_nothing(&self, null: &[f64], typical: &[f64], motion: &Motion) -> bool {
        let size = self.value(typical, motion).abs().max(motion.force.abs());
        let size = if size.is_finite() { size } else { 1.0 };
        let change = self.value(null, motion) - self.definition.place.unchanged(motion);
        // Where the expression is undefined it says nothing about its parameters.
        change.is_nan() || change.abs() <= NOTHING * size
    }
}

/// Motions at which an expression is checked before there is any recording.
fn samples() -> impl Iterator<Item = Motion> {
    let of = |[position, velocity, acceleration, force]: [f64; 4]| Motion {
        position,
        velocity,
        acceleration,
        force,
        time: 3.7,
        run_start_time: 1.3,
        ..Motion::default()
    };
    [[0.31, 0.47, -0.9, 1.7], [-0.23, -0.61, 1.1, -0.8], [0.12, -0.05, 0.3, 2.9]]
        .into_iter()
        .map(of)
}

fn argument(definition: &Definition, name: &str) -> Result<Argument, String> {
    let of_parameter = definition.parameters.iter().position(|own| own.name == name);
    if let Some(index) = of_parameter {
        return Ok(Argument::Parameter(index));
    }
    let known = definition.place.variables();
    let names = || {
        let of = |variable: &Variable| {
            OF_NAMES.iter().position(|own| own == variable).map(|index| VARIABLES[index])
        };
        let own = definition.parameters.iter().map(|own| own.name.as_str());
        known.iter().filter_map(of).chain(own)
    };
    let of_variable = VARIABLES.iter().position(|own| *own == name).map(|index| OF_NAMES[index]);
    match of_variable.filter(|variable| known.contains(variable)) {
        Some(variable) => Ok(Argument::Variable(variable)),
        None => {
            let nearest = names()
                .map(|own| (levenshtein(own, name), own))
                .min()
                .filter(|(distance, own)| distance * 2 < own.len());
            let hint =
                nearest.map_or_else(String::new, |(_, own)| format!("; did you mean '{own}'?"));
            Err(format!(
                "the expression '{}' uses '{name}', which is unknown at the place '{}'{hint}; known are {}",
                definition.expression,
                word(definition.place),
                names().collect::<Vec<_>>().join(", ")
            ))
        }
    }
}

fn word(place: Place) -> &'static str {
    match place {
        Place::Force => "force",
        Place::Friction => "friction",
        Place::Input => "input",
        Place::Output => "output",
    }
}

impl Definition {
    fn check(&self) -> Result<(), DefinitionError> {
        let is_letter = |byte: u8| byte.is_ascii_lowercase();
        let is_word = |word: &str| {
            !word.is_empty()
                && word.bytes().all(|byte| is_letter(byte) || byte.is_ascii_digit() || byte == b'_')
        };
        let is_name = self.name.split_once('.').is_some_and(|(domain, rest)| {
            !domain.is_empty() && domain.bytes().all(is_letter) && rest.split('.').all(is_word)
        });
        if !is_name {
            return Err(DefinitionError::new(
                &self.name,
                format!(
                    "'{}' is no name of an effect; write lower-case words joined by dots, such as user.cable_drag",
                    self.name
                ),
            ));
        }
        if CATALOGUE.iter().any(|effect| effect.name == self.name) {
            let what =
                format!("'{}' is an effect of the catalogue; choose another name", self.name);
            return Err(DefinitionError::new(&self.name, what));
        }
        if self.parameters.is_empty() || MOST_PARAMETERS < self.parameters.len() {
            let what = format!(
                "'{}' has {} parameters; allowed are 1 to {MOST_PARAMETERS}",
                self.name,
                self.parameters.len()
            );
            return Err(DefinitionError::new(&self.name, what));
        }
        for (index, parameter) in self.parameters.iter().enumerate() {
            self.check_parameter(index, parameter)?;
        }
        Ok(())
    }

    fn check_parameter(
        &self,
        index: usize,
        parameter: &ParameterDefinition,
    ) -> Result<(), DefinitionError> {
        let ParameterDefinition { name, unit, typical, .. } = parameter;
        let wrong = |what: String| Err(DefinitionError::new(name, what));
        let is_letter = |byte: u8| byte.is_ascii_alphabetic() || byte == b'_';
        let is_word = name.bytes().next().is_some_and(is_letter)
            && name.bytes().all(|byte| is_letter(byte) || byte.is_ascii_digit());
        if !is_word {
            return wrong(format!(
                "'{name}' is no name of a parameter; write letters, digits and _"
            ));
        }
        if VARIABLES.contains(&name.as_str()) {
            return wrong(format!("'{name}' is a variable; choose another name for the parameter"));
        }
        if self.parameters[..index].iter().any(|own| own.name == *name) {
            return wrong(format!("the parameter '{name}' of '{}' is defined twice", self.name));
        }
        if !(typical.is_finite() && 0.0 < *typical) {
            return wrong(format!(
                "typical of '{name}' is {typical}; allowed are numbers above 0, in {unit}"
            ));
        }
        Ok(())
    }

    /// Effect of the definition, for the life of the program; [`find`] does not know it.
    pub(crate) fn effect(&self) -> Result<&'static Effect, DefinitionError> {
        self.check()?;
        let confused_with = self
            .confused_with
            .iter()
            .map(|name| {
                let unknown = || {
                    let what = format!(
                        "confused_with names '{name}', which is no effect of the catalogue; `klasktron effects` lists them"
                    );
                    DefinitionError::new(name, what)
                };
                find(name).map(|effect| effect.name).ok_or_else(unknown)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let expression = Expression::parse(self)?;
        let null = expression.null()?;
        let regressors: Vec<Regressor> = OF_NAMES
            .into_iter()
            .filter(|variable| expression.uses(*variable))
            .flat_map(|variable| variable.regressors().iter().copied())
            .collect();
        let of_output = self.place == Place::Output;
        let expression: &'static Expression = Box::leak(Box::new(expression));
        let kept = |text: &str| -> &'static str { text.to_owned().leak() };
        let on_guides = self.coordinates == Coordinates::Guides
            && matches!(self.place, Place::Force | Place::Friction);
        Ok(Box::leak(Box::new(Effect {
            name: kept(&self.name),
            summary: kept(if self.summary.is_empty() { &self.expression } else { &self.summary }),
            domain: if on_guides { Domain::Gantry } else { Domain::Drive },
            site: if on_guides { Site::Guides } else { Site::Motors },
            equation: kept(&self.expression),
            parameters: self.parameters.iter().zip(&null).map(scaled).collect::<Vec<_>>().leak(),
            probes: self.probes(&null).leak(),
            null: null.leak(),
            memory: 0,
            physics: Physics::Expression(self.place, expression),
            regressors: regressors.leak(),
            signals: if of_output {
                &[Signal::MotorPosition, Signal::MotorVelocity]
            } else {
                Signal::DRIVE
            },
            excitation: kept(&self.excitation),
            experiment: "",
            confused_with: confused_with.leak(),
            reference: "definition by the user (--effects)",
        })))
    }

    /// All parameters at their typical sizes, then each that shapes the effect at others.
    fn probes(&self, null: &[f64]) -> Vec<&'static [f64]> {
        let typical: Vec<f64> = self.parameters.iter().map(|own| own.typical).collect();
        let mut probes = vec![typical.clone()];
        for index in (0..typical.len()).filter(|index| null[*index] != 0.0) {
            for factor in SHAPES {
                let mut probe = typical.clone();
                probe[index] *= factor;
                probes.push(probe);
            }
        }
        probes.into_iter().map(|probe| -> &'static [f64] { probe.leak() }).collect()
    }
}

fn scaled((parameter, null): (&ParameterDefinition, &f64)) -> Parameter {
    let largest = LARGEST * parameter.typical;
    let smallest = if *null == 0.0 { 0.0 } else { SMALLEST * parameter.typical };
    let low = if parameter.sign == Sign::Positive { smallest } else { -largest };
    let name: &'static str = parameter.name.clone().leak();
    Parameter {
        name,
        symbol: name,
        unit: parameter.unit.clone().leak(),
        scale: parameter.typical,
        bounds: (low, largest),
        plausible: (low, largest),
        per_session: false,
    }
}

/// Effects of users that this program has read. They are kept for its life.
static KNOWN: Mutex<Vec<&'static Effect>> = Mutex::new(Vec::new());

/// The effect of a user with this name.
pub(super) fn known(name: &str) -> Option<&'static Effect> {
    let known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.iter().copied().find(|effect| effect.name == name)
}

/// Make the effect of `definition` known to [`find`].
///
/// # Errors
/// The definition is wrong, or another one with this name is known.
pub fn define(definition: &Definition) -> Result<&'static Effect, DefinitionError> {
    if let Some(effect) = known(&definition.name) {
        if effect.definition() == Some(definition) {
            return Ok(effect);
        }
        let what = format!(
            "'{}' is defined twice, in different ways; use one definition, or another name",
            definition.name
        );
        return Err(DefinitionError::new(&definition.name, what));
    }
    let effect = definition.effect()?;
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner).push(effect);
    Ok(effect)
}

impl Effect {
    /// Definition of an effect of a user; `None` for one of the catalogue.
    #[must_use]
    pub fn definition(&self) -> Option<&'static Definition> {
        match self.physics {
            Physics::Expression(_, expression) => Some(expression.definition()),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn definition(place: &str, expression: &str, parameters: &[(&str, f64)]) -> Definition {
        let list: Vec<_> = parameters
            .iter()
            .map(|(name, typical)| serde_json::json!({"name": name, "unit": "1", "typical": typical}))
            .collect();
        let value = serde_json::json!({
            "name": "user.test", "place": place, "expression": expression, "parameter": list,
        });
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn an_expression_has_the_value_of_its_formula() {
        let effect = definition("force", "-k * tanh(velocity / w)", &[("k", 3.0), ("w", 0.1)])
            .effect()
            .unwrap();
        let Physics::Expression(Place::Force, expression) = effect.physics else {
            panic!("a force")
        };
        let motion = Motion { velocity: 0.05, ..Motion::default() };
        let expected = -2.0 * (0.05_f64 / 0.2).tanh();
        assert!((expression.value(&[2.0, 0.2], &motion) - expected).abs() < 1e-15);
        assert_eq!(effect.null, [0.0, 0.1]);
        assert_eq!(effect.probes.len(), 3);
        assert!(effect.has_shape_parameters());
    }

    #[test]
    fn all_parameters_may_be_zero_without_effect() {
        let own = definition("friction", "a + b * abs(velocity)", &[("a", 1.0), ("b", 1.0)]);
        let effect = own.effect().unwrap();
        assert_eq!(effect.null, [0.0, 0.0]);
        let Physics::Expression(_, expression) = effect.physics else { panic!("an expression") };
        assert_eq!(expression.level(&[-1.0, 0.0], &Motion::default()), 0.0);
        assert!(expression.level(&[f64::NAN, 0.0], &Motion::default()).is_nan());
        let input = definition("input", "input + a * input^2", &[("a", 0.1)]).effect().unwrap();
        assert_eq!(input.null, [0.0]);
    }

    #[test]
    fn a_wrong_definition_says_what_is_known() {
        let of = |place: &str, expression: &str, parameters: &[(&str, f64)]| {
            definition(place, expression, parameters).effect().unwrap_err().what
        };
        let one: &[(&str, f64)] = &[("k", 1.0)];
        for (error, part) in [
            (of("force", "k * velocty", one), "did you mean 'velocity'?"),
            (of("input", "k * velocity", one), "known are input, k"),
            (of("force", "k * (velocity", one), "cannot be read"),
            (of("force", "velocity", one), "is not in the expression"),
            (of("force", "k + velocity", one), "must be 0 where its first parameter, 'k', is 0"),
            (of("input", "k * input", one), "must be input where"),
            (of("force", "k * velocity", &[("k", -1.0)]), "allowed are numbers above 0"),
            (of("force", "velocity", &[("velocity", 1.0)]), "is a variable"),
            (of("force", "k", &[]), "0 parameters; allowed are 1 to 8"),
        ] {
            assert!(error.contains(part), "{error}");
        }
        let mut own = definition("force", "k * velocity", one);
        own.name = "drive.backlash".to_owned();
        assert!(own.effect().unwrap_err().what.contains("is an effect of the catalogue"));
        own.name = "Cable".to_owned();
        assert!(own.effect().unwrap_err().what.contains("such as user.cable_drag"));
    }

    #[test]
    fn two_definitions_of_one_name_are_refused_and_equal_ones_are_one() {
        let mut own = definition("force", "k * position", &[("k", 1.0)]);
        own.name = "user.twice".to_owned();
        let first = define(&own).unwrap();
        assert!(std::ptr::eq(first, define(&own).unwrap()));
        assert!(std::ptr::eq(first, find("user.twice").unwrap()));
        own.expression = "-k * position".to_owned();
        assert!(define(&own).unwrap_err().what.contains("defined twice"));
    }

    #[test]
    fn an_expression_without_a_value_is_named_with_the_motion() {
        let own = definition("force", "k * ln(position)", &[("k", 1.0)]);
        let effect = own.effect().unwrap();
        let Physics::Expression(_, expression) = effect.physics else { panic!("an expression") };
        let at = |position: f64| Motion { position, ..Motion::default() };
        assert_eq!(expression.undefined_at([at(0.5), at(2.0)]), None);
        let found = expression.undefined_at([at(0.5), at(-0.25)]).unwrap();
        assert!(found.contains("is NaN at position = -0.25"), "{found}");
    }
}
