//! `twin.json`: the effects that are switched on, each number with unit, bounds, source and interval.

use super::{Instance, Left, Machine, Mimicry, Scatter, Source, Twin, Value};
use crate::{
    effects::{self, Axis},
    recording::{ExistingFile, RecordingError, write_bytes},
};
use serde::{Deserialize, Serialize};
use std::{fs, io, path::Path};

/// Version of the document.
const SCHEMA_VERSION: u32 = 1;

/// Why a twin could not be read.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// The file cannot be read.
    #[error("cannot read the twin {path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// It is no twin.
    #[error("{path} is no twin.json: {source}")]
    Syntax {
        /// The file.
        path: String,
        /// Where it departs from one.
        source: serde_json::Error,
    },
    /// Another version.
    #[error("{path} has schema_version {found}; this program reads {SCHEMA_VERSION}")]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
    /// An effect that is not in the catalogue.
    #[error("{path} switches on '{name}', which is not in the catalogue of effects")]
    UnknownEffect {
        /// The file.
        path: String,
        /// The name.
        name: String,
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
        /// What is wrong, with the allowed range.
        problem: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Document {
    schema_version: u32,
    machine: Machine,
    striker_mass_kg: f64,
    belt_per_turn_m: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tuned_mass_kg: Option<f64>,
    effects: Vec<EffectEntry>,
    #[serde(default)]
    left: Vec<Left>,
    #[serde(default)]
    mimicry: Vec<Mimicry>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    scatter: Vec<Scatter>,
    #[serde(default)]
    fitted_to_sha256: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct EffectEntry {
    name: String,
    axis: Axis,
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

impl Document {
    fn of(twin: &Twin) -> Self {
        let effects = twin
            .instances
            .iter()
            .map(|instance| EffectEntry {
                name: instance.effect.name.to_owned(),
                axis: instance.axis,
                parameters: instance
                    .effect
                    .parameters
                    .iter()
                    .zip(&instance.values)
                    .map(|(parameter, value)| ParameterEntry {
                        name: parameter.name.to_owned(),
                        value: value.value,
                        unit: parameter.unit.to_owned(),
                        bounds: Some([parameter.bounds.0, parameter.bounds.1]),
                        source: value.source,
                        ci95: value.ci95,
                    })
                    .collect(),
            })
            .collect();
        Self {
            schema_version: SCHEMA_VERSION,
            machine: twin.machine,
            striker_mass_kg: twin.striker_mass,
            belt_per_turn_m: twin.belt_per_turn,
            tuned_mass_kg: twin.tuned_mass,
            effects,
            left: twin.left.clone(),
            mimicry: twin.mimicry.clone(),
            scatter: twin.scatter.clone(),
            fitted_to_sha256: twin.fitted_to.clone(),
        }
    }

    fn into_twin(self, path: &str) -> Result<Twin, TwinError> {
        if self.schema_version != SCHEMA_VERSION {
            return Err(TwinError::Version { path: path.to_owned(), found: self.schema_version });
        }
        let instances = self
            .effects
            .into_iter()
            .map(|entry| entry.into_instance(path))
            .collect::<Result<_, _>>()?;
        Ok(Twin {
            machine: self.machine,
            striker_mass: self.striker_mass_kg,
            belt_per_turn: self.belt_per_turn_m,
            tuned_mass: self.tuned_mass_kg,
            instances,
            left: self.left,
            mimicry: self.mimicry,
            scatter: self.scatter,
            fitted_to: self.fitted_to_sha256,
        })
    }
}

impl EffectEntry {
    fn into_instance(self, path: &str) -> Result<Instance, TwinError> {
        let Some(effect) = effects::find(&self.name) else {
            return Err(TwinError::UnknownEffect { path: path.to_owned(), name: self.name });
        };
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
                    // An older version had fewer numbers: those that came later do nothing at zero.
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
        Ok(Instance { effect, axis: self.axis, values })
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

/// Reads `twin.json`.
///
/// # Errors
/// When it cannot be read, is no twin, names an unknown effect, or has a number out of its bounds.
pub fn read_twin(path: &Path) -> Result<Twin, TwinError> {
    let shown = path.display().to_string();
    let text =
        fs::read_to_string(path).map_err(|source| TwinError::Io { path: shown.clone(), source })?;
    let document: Document = serde_json::from_str(&text)
        .map_err(|source| TwinError::Syntax { path: shown.clone(), source })?;
    document.into_twin(&shown)
}

/// Writes `twin.json` beside and renames it.
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

    /// The built-in twin of a table as its file, without the number `parameter` of the effect `name`.
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
}
