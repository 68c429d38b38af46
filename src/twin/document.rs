//! `twin.json`: the effects that are switched on, each parameter with unit, bounds, source and
//! interval.

use super::{
    AxisFrame, Discrepancy, Instance, Machine, MeasurementNoise, ReferenceResidual, Source,
    StageKind, Twin, Value,
    axis::{INPUT_UNITS, POSITION_UNITS},
};
use crate::{
    effects::{self, Axis, AxisScales, Definition, DefinitionError, Parameter},
    recording::{ExistingFile, RecordingError, write_bytes},
};
use serde::{Deserialize, Serialize};
use std::{fs, io, path::Path};

/// Version of the document.
const SCHEMA_VERSION: u32 = 2;

/// Longest belt per motor turn (m), as for recordings and robot files.
const LONGEST_BELT: f64 = 1.0;

/// Reasons why a twin could not be read.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// The file cannot be read.
    #[error("cannot read the twin {path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Cause.
        source: io::Error,
    },
    /// The file is no twin.
    #[error("{path} is no twin.json: {source}")]
    Syntax {
        /// The file.
        path: String,
        /// Error of the parser.
        source: serde_json::Error,
    },
    /// Another version, or none.
    #[error(
        "{path} has schema_version {found}; this program reads {SCHEMA_VERSION}: write a new twin from the recordings \
         with `klasktron calibrate`, or with `klasktron gap`"
    )]
    Version {
        /// The file.
        path: String,
        /// Version in the file.
        found: String,
    },
    /// A constant of the machine is out of range.
    #[error("{path}: {key} is {found}; allowed are numbers above 0{limit}")]
    Constant {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// Its value.
        found: f64,
        /// Upper end of the range, and the unit.
        limit: String,
    },
    /// An effect that is not in the catalogue.
    #[error("{path} switches on '{name}', which is not in the catalogue of effects")]
    UnknownEffect {
        /// The file.
        path: String,
        /// The name.
        name: String,
    },
    /// An effect where it cannot act.
    #[error(
        "{path}: {effect} has the location '{found}'; on a {machine} it has {}",
        if known.is_empty() { "none".to_owned() } else { known.join(", ") }
    )]
    Location {
        /// The file.
        path: String,
        /// Name of the effect.
        effect: &'static str,
        /// The location.
        found: Axis,
        /// Kind of machine that the twin describes.
        machine: Machine,
        /// Locations that are possible.
        known: Vec<String>,
    },
    /// A definition of an effect of the user is wrong.
    #[error("{path}: defined_effects: {source}")]
    Definition {
        /// The file.
        path: String,
        /// Error of the definition.
        source: DefinitionError,
    },
    /// A unit that an axis cannot have.
    #[error("{path}: {key} is '{found}'; known are {known}")]
    Unit {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// Unit in the file.
        found: String,
        /// Allowed units.
        known: String,
    },
    /// A parameter is missing, unknown or out of its bounds.
    #[error("{path}: {effect}.{parameter} {problem}")]
    Parameter {
        /// The file.
        path: String,
        /// The effect.
        effect: String,
        /// The parameter.
        parameter: String,
        /// Description of the error, with the allowed range.
        problem: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Document {
    schema_version: u32,
    machine: Machine,
    striker_mass_kg: f64,
    belt_metres_per_turn: f64,
    #[serde(default)]
    controller_reference_mass_kg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    axis: Option<AxisEntry>,
    /// Definitions of the effects of the user among the effects.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    defined_effects: Vec<Definition>,
    effects: Vec<EffectEntry>,
    #[serde(default)]
    reference_residuals: Vec<ReferenceResidual>,
    #[serde(default)]
    discrepancy: Vec<DiscrepancyEntry>,
    #[serde(default)]
    measurement_noise: Vec<MeasurementNoise>,
    #[serde(default)]
    fitted_to_sha256: Vec<String>,
}

/// Coordinate of a single axis and its typical magnitudes, in the units of its recordings.
#[derive(Serialize, Deserialize)]
struct AxisEntry {
    position_origin: f64,
    input_unit: String,
    position_unit: String,
    input_rms: f64,
    position_half_range: f64,
    velocity_rms: f64,
    acceleration_rms: f64,
    sample_period_s: f64,
    /// Absent in older twins.
    #[serde(default)]
    highest_compared_frequency_hz: Option<f64>,
    duration_s: f64,
}

impl AxisEntry {
    fn of(frame: &AxisFrame) -> Self {
        let AxisFrame { position_origin, scales } = *frame;
        Self {
            position_origin,
            input_unit: scales.input_unit.to_owned(),
            position_unit: scales.position_unit.to_owned(),
            input_rms: scales.input,
            position_half_range: scales.position,
            velocity_rms: scales.velocity,
            acceleration_rms: scales.acceleration,
            sample_period_s: scales.sample_period,
            highest_compared_frequency_hz: Some(scales.band),
            duration_s: scales.duration,
        }
    }

    fn frame(&self, path: &str) -> Result<AxisFrame, TwinError> {
        let unit = |key: &'static str, found: &str, known: &[&'static str]| {
            let unknown = || TwinError::Unit {
                path: path.to_owned(),
                key,
                found: found.to_owned(),
                known: known.join(", "),
            };
            known.iter().copied().find(|unit| *unit == found).ok_or_else(unknown)
        };
        let band = self
            .highest_compared_frequency_hz
            .unwrap_or_else(|| AxisScales::widest_band(self.sample_period_s));
        let sizes = [
            ("axis.input_rms", self.input_rms),
            ("axis.position_half_range", self.position_half_range),
            ("axis.velocity_rms", self.velocity_rms),
            ("axis.acceleration_rms", self.acceleration_rms),
            ("axis.sample_period_s", self.sample_period_s),
            ("axis.highest_compared_frequency_hz", band),
            ("axis.duration_s", self.duration_s),
        ];
        if let Some((key, found)) = sizes.into_iter().find(|(_, size)| *size <= 0.0) {
            return Err(TwinError::Constant {
                path: path.to_owned(),
                key,
                found,
                limit: String::new(),
            });
        }
        Ok(AxisFrame {
            position_origin: self.position_origin,
            scales: AxisScales {
                input: self.input_rms,
                position: self.position_half_range,
                velocity: self.velocity_rms,
                acceleration: self.acceleration_rms,
                sample_period: self.sample_period_s,
                band,
                duration: self.duration_s,
                input_unit: unit("axis.input_unit", &self.input_unit, INPUT_UNITS)?,
                position_unit: unit("axis.position_unit", &self.position_unit, POSITION_UNITS)?,
            },
        })
    }
}

#[derive(Serialize, Deserialize)]
struct EffectEntry {
    name: String,
    location: Axis,
    parameters: Vec<ParameterEntry>,
}

#[derive(Serialize, Deserialize)]
struct ParameterEntry {
    name: String,
    value: f64,
    #[serde(default)]
    unit: String,
    #[serde(default)]
    bounds: Option<[f64; 2]>,
    source: Source,
    #[serde(default)]
    ci95: Option<[f64; 2]>,
}

#[derive(Serialize, Deserialize)]
struct DiscrepancyEntry {
    stage: StageKind,
    effect: String,
    explained_fraction: f64,
    #[serde(default)]
    parameter_offsets: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fitted: Option<EffectEntry>,
}

/// Definitions of the effects of the user in `twin`, each once.
fn defined_effects(twin: &Twin) -> Vec<Definition> {
    let mut definitions: Vec<Definition> = Vec::new();
    for own in twin.instances.iter().filter_map(|instance| instance.effect.definition()) {
        if !definitions.contains(own) {
            definitions.push(own.clone());
        }
    }
    definitions
}

impl Document {
    fn of(twin: &Twin) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            machine: twin.machine,
            striker_mass_kg: twin.striker_mass,
            belt_metres_per_turn: twin.belt_metres_per_turn,
            controller_reference_mass_kg: twin.controller_reference_mass,
            axis: twin.axis_frame.as_ref().map(AxisEntry::of),
            defined_effects: defined_effects(twin),
            effects: twin.instances.iter().map(EffectEntry::of).collect(),
            reference_residuals: twin.reference_residuals.clone(),
            discrepancy: twin.discrepancy.iter().map(DiscrepancyEntry::of).collect(),
            measurement_noise: twin.measurement_noise.clone(),
            fitted_to_sha256: twin.fitted_to.clone(),
        }
    }

    /// Check the constants of the machine.
    fn check(&self, path: &str) -> Result<(), TwinError> {
        let in_kg = || " kg".to_owned();
        let belt_limit = format!(" and up to {LONGEST_BELT} m");
        let reference = self.controller_reference_mass_kg.unwrap_or(f64::INFINITY);
        let constants = [
            ("striker_mass_kg", self.striker_mass_kg, f64::INFINITY, in_kg()),
            ("controller_reference_mass_kg", reference, f64::INFINITY, in_kg()),
            ("belt_metres_per_turn", self.belt_metres_per_turn, LONGEST_BELT, belt_limit),
        ];
        let wrong = constants.into_iter().find(|(_, value, most, _)| *value <= 0.0 || most < value);
        let Some((key, found, _, limit)) = wrong else { return Ok(()) };
        Err(TwinError::Constant { path: path.to_owned(), key, found, limit })
    }

    fn into_twin(self, path: &str) -> Result<Twin, TwinError> {
        self.check(path)?;
        let axis_frame = self.axis.as_ref().map(|own| own.frame(path)).transpose()?;
        for definition in &self.defined_effects {
            effects::define(definition)
                .map_err(|source| TwinError::Definition { path: path.to_owned(), source })?;
        }
        let instance =
            |entry: EffectEntry| entry.into_instance(path, self.machine, axis_frame.as_ref());
        let instances = self.effects.into_iter().map(instance).collect::<Result<_, _>>()?;
        let discrepancy = self.discrepancy.into_iter().map(|own| own.read(instance));
        let discrepancy = discrepancy.collect::<Result<_, _>>()?;
        Ok(Twin {
            machine: self.machine,
            striker_mass: self.striker_mass_kg,
            belt_metres_per_turn: self.belt_metres_per_turn,
            controller_reference_mass: self.controller_reference_mass_kg,
            axis_frame,
            instances,
            reference_residuals: self.reference_residuals,
            discrepancy,
            measurement_noise: self.measurement_noise,
            fitted_to: self.fitted_to_sha256,
        })
    }
}

impl DiscrepancyEntry {
    fn of(own: &Discrepancy) -> Self {
        let Discrepancy { stage, effect, explained_fraction, parameter_offsets, fitted } = own;
        // The user may define an effect in another way before the twin is read again.
        let fitted = fitted.as_ref().filter(|own| own.effect.definition().is_none());
        Self {
            stage: *stage,
            effect: effect.clone(),
            explained_fraction: *explained_fraction,
            parameter_offsets: parameter_offsets.clone(),
            fitted: fitted.map(EffectEntry::of),
        }
    }

    /// The model error, where `instance` reads an effect.
    fn read(
        self,
        instance: impl Fn(EffectEntry) -> Result<Instance, TwinError>,
    ) -> Result<Discrepancy, TwinError> {
        let Self { stage, effect, explained_fraction, parameter_offsets, fitted } = self;
        let fitted = fitted.map(instance).transpose()?;
        Ok(Discrepancy { stage, effect, explained_fraction, parameter_offsets, fitted })
    }
}

impl EffectEntry {
    fn of(instance: &Instance) -> Self {
        let parameter = |(parameter, value): (&Parameter, &Value)| ParameterEntry {
            name: parameter.name.to_owned(),
            value: value.value,
            unit: parameter.unit.to_owned(),
            bounds: Some([parameter.bounds.0, parameter.bounds.1]),
            source: value.source,
            ci95: value.ci95,
        };
        Self {
            name: instance.effect.name.to_owned(),
            location: instance.axis,
            parameters: instance
                .effect
                .parameters
                .iter()
                .zip(&instance.values)
                .map(parameter)
                .collect(),
        }
    }

    fn into_instance(
        self,
        path: &str,
        machine: Machine,
        frame: Option<&AxisFrame>,
    ) -> Result<Instance, TwinError> {
        let Some(effect) = effects::find(&self.name) else {
            return Err(TwinError::UnknownEffect { path: path.to_owned(), name: self.name });
        };
        let (axis, known) = (machine.own_name(self.location), machine.axes(effect.site));
        if !known.contains(&axis) {
            return Err(TwinError::Location {
                path: path.to_owned(),
                effect: effect.name,
                found: self.location,
                machine,
                known: known.iter().map(Axis::to_string).collect(),
            });
        }
        let given = self.parameters.iter().map(|own| own.name.as_str());
        let effect =
            frame.map_or(effect, |frame| effect.form_on_axis(given).on_axis(&frame.scales));
        let wrong = |parameter: &str, problem: String| TwinError::Parameter {
            path: path.to_owned(),
            effect: effect.name.to_owned(),
            parameter: parameter.to_owned(),
            problem,
        };
        for given in &self.parameters {
            if !effect.parameters.iter().any(|parameter| parameter.name == given.name) {
                let known: Vec<&str> = effect.parameters.iter().map(|own| own.name).collect();
                return Err(wrong(
                    &given.name,
                    format!("is unknown; known are {}", known.join(", ")),
                ));
            }
        }
        let values = effect
            .parameters
            .iter()
            .zip(effect.null)
            .enumerate()
            .map(|(index, (parameter, null))| {
                let Some(given) = self.parameters.iter().find(|own| own.name == parameter.name)
                else {
                    // An older version had fewer parameters: later ones have no effect at zero.
                    let came_later = index != 0 && *null == 0.0;
                    let nothing = || Value { value: 0.0, ci95: None, source: Source::Nominal };
                    let missing = || wrong(parameter.name, "is missing".to_owned());
                    return came_later.then(nothing).ok_or_else(missing);
                };
                let (low, high) = parameter.bounds;
                if !(low..=high).contains(&given.value) {
                    let problem = format!(
                        "is {}; allowed are {low} to {high} {}",
                        given.value, parameter.unit
                    );
                    return Err(wrong(parameter.name, problem));
                }
                Ok(Value { value: given.value, ci95: given.ci95, source: given.source })
            })
            .collect::<Result<_, _>>()?;
        Ok(Instance { effect, axis, values })
    }
}

impl Twin {
    /// The document `twin.json`.
    ///
    /// # Errors
    /// Never for finite numbers.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(&Document::of(self)).map(|text| text + "\n")
    }
}

/// When it cannot be read, is no twin of this version, contains an unknown effect, or has a
/// parameter out of its bounds.
pub fn read_twin(path: &Path) -> Result<Twin, TwinError> {
    let shown = path.display().to_string();
    let text =
        fs::read_to_string(path).map_err(|source| TwinError::Io { path: shown.clone(), source })?;
    parse_twin(&text, &shown)
}

/// As [`read_twin`], except for reading the file.
pub fn parse_twin(text: &str, path: &str) -> Result<Twin, TwinError> {
    let syntax = |source| TwinError::Syntax { path: path.to_owned(), source };
    // The version first: the keys of another version are no errors of syntax.
    let value: serde_json::Value = serde_json::from_str(text).map_err(syntax)?;
    let version = value.get("schema_version");
    if value.is_object()
        && version.and_then(serde_json::Value::as_u64) != Some(SCHEMA_VERSION.into())
    {
        let found = version.map_or_else(|| "missing".to_owned(), ToString::to_string);
        return Err(TwinError::Version { path: path.to_owned(), found });
    }
    let document: Document = serde_json::from_str(text).map_err(syntax)?;
    document.into_twin(path)
}

/// Write `twin.json` to a temporary file and rename it.
///
/// # Errors
/// When it cannot be written.
pub fn write_twin(twin: &Twin, path: &Path) -> Result<(), RecordingError> {
    let text = twin.to_json().unwrap_or_default();
    write_bytes(path, ExistingFile::Replace, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::Estimate;

    /// The built-in twin of a table as its file, without the `parameter` of the effect `name`.
    fn without(name: &str, parameter: &str) -> Result<Twin, TwinError> {
        let text = Twin::nominal(Machine::Table).to_json().unwrap();
        let mut document: Document = serde_json::from_str(&text).unwrap();
        for own in document.effects.iter_mut().filter(|own| own.name == name) {
            own.parameters.retain(|given| given.name != parameter);
        }
        document.into_twin("twin.json")
    }

    #[test]
    fn a_twin_of_an_older_version_has_nothing_of_numbers_that_came_later() {
        let twin = without("drive.velocity_loop", "feedback_delay_s").unwrap();
        let own = twin.instances.iter().find(|own| own.effect.name == "drive.velocity_loop");
        assert_eq!(own.unwrap().values[2].value, 0.0);
        for needed in ["natural_frequency_hz", "damping_ratio"] {
            let error = without("drive.velocity_loop", needed).unwrap_err().to_string();
            assert!(error.contains(needed) && error.contains("is missing"), "{error}");
        }
    }

    /// The built-in twin of a table as its file, with `value` under `key`.
    fn with(key: &str, value: serde_json::Value) -> Result<Twin, TwinError> {
        let text = Twin::nominal(Machine::Table).to_json().unwrap();
        let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
        document[key] = value;
        parse_twin(&document.to_string(), "twin.json")
    }

    #[test]
    fn constants_at_or_below_zero_are_refused_with_their_range() {
        assert!(with("striker_mass_kg", 0.02.into()).is_ok());
        for (key, value, range) in [
            ("striker_mass_kg", 0.0, "above 0 kg"),
            ("controller_reference_mass_kg", -2.0, "above 0 kg"),
            ("belt_metres_per_turn", 0.0, "above 0 and up to 1 m"),
            ("belt_metres_per_turn", 1.5, "above 0 and up to 1 m"),
        ] {
            let error = with(key, value.into()).unwrap_err().to_string();
            let said = format!("twin.json: {key} is {value}; allowed are numbers {range}");
            assert_eq!(error, said);
        }
    }

    #[test]
    fn an_effect_is_where_it_can_act() {
        let at = |machine: Machine, location: &str| {
            let text = Twin::nominal(machine).to_json().unwrap();
            let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
            document["effects"][0]["location"] = location.into();
            parse_twin(&document.to_string(), "twin.json")
        };
        let twin = at(Machine::Axis, "axis").unwrap();
        assert_eq!(twin, Twin::nominal(Machine::Axis));
        // Twins of a single axis once had the locations of a table.
        assert_eq!(at(Machine::Axis, "x+y").unwrap(), twin);
        for wrong in ["axis", "x"] {
            let error = at(Machine::Table, wrong).unwrap_err().to_string();
            let expected = format!("drive.velocity_loop has the location '{wrong}'; on a table it");
            assert!(error.contains(&expected) && error.ends_with("a+b, a, b"), "{error}");
        }
    }

    #[test]
    fn another_version_is_refused_with_the_way_out() {
        for (version, shown) in [
            (serde_json::json!(1), "1"),
            (serde_json::json!(3), "3"),
            (serde_json::json!("2"), "\"2\""),
            (serde_json::Value::Null, "null"),
        ] {
            let error = with("schema_version", version).unwrap_err().to_string();
            let said = format!("twin.json has schema_version {shown}; this program reads 2");
            assert!(error.starts_with(&said) && error.contains("klasktron calibrate"), "{error}");
        }
        let error = parse_twin("{}", "twin.json").unwrap_err().to_string();
        assert!(error.contains("schema_version missing"), "{error}");
    }

    #[test]
    fn the_fit_of_a_model_error_is_complete() {
        let with_fitted = |parameters: serde_json::Value| {
            let fitted = serde_json::json!({
                "name": "drive.lag1", "location": "a+b", "parameters": parameters,
            });
            let own = serde_json::json!({
                "stage": "drive", "effect": "drive.lag1", "explained_fraction": 0.01, "fitted": fitted,
            });
            with("discrepancy", serde_json::json!([own]))
        };
        let parameter = |value: f64| serde_json::json!([{ "name": "time_constant_s", "value": value, "source": "fitted" }]);
        let fitted = with_fitted(parameter(2e-4)).unwrap().discrepancy.remove(0).fitted.unwrap();
        assert_eq!((fitted.axis, fitted.numbers()), (Axis::Motors, vec![2e-4]));
        let error = with_fitted(serde_json::json!([])).unwrap_err().to_string();
        assert_eq!(error, "twin.json: drive.lag1.time_constant_s is missing");
        let error = with_fitted(parameter(1e3)).unwrap_err().to_string();
        assert!(error.starts_with("twin.json: drive.lag1.time_constant_s is 1000;"), "{error}");
    }

    #[test]
    fn a_twin_survives_its_file() {
        let mut twin = Twin::nominal(Machine::Table);
        twin.belt_metres_per_turn = 0.05;
        twin.controller_reference_mass = Some(2.5);
        twin.reference_residuals.push(ReferenceResidual {
            signal: "motor_a.velocity".to_owned(),
            residual_rms: 2e-3,
            searched: true,
        });
        twin.discrepancy.push(Discrepancy {
            stage: StageKind::Drive,
            effect: "drive.lag1".to_owned(),
            explained_fraction: 0.03,
            parameter_offsets: vec![2e-5],
            fitted: Some(Instance::new(
                effects::find("drive.lag1").unwrap(),
                Axis::Motors,
                &[2e-5],
                Source::Fitted,
            )),
        });
        let estimate = |value| Estimate { value, standard_error: 0.1 * value };
        twin.measurement_noise.push(MeasurementNoise {
            stage: StageKind::Camera,
            timestamp_variance_s2: estimate(1e-6),
            frame_to_frame_variance_m2: estimate(6e-8),
            total_variance_m2: estimate(7e-8),
            lost_frame_fraction: None,
        });
        assert_eq!(parse_twin(&twin.to_json().unwrap(), "twin.json").unwrap(), twin);
    }
}
