//! `ekf.json`: tuned settings, tuning record and evaluation.
//!
//! | field | content |
//! |---|---|
//! | `schema_version` | 2 |
//! | `provenance` | command line, crate version, commit |
//! | `inputs[]` | `name`, `sha256` of every recording |
//! | `train`, `validation` | `runs`, `frames`, `duration_s` |
//! | `filter` | [`FilterSettings`], all settings of a filter; [`read_settings`] reads them back |
//! | `tuning[]` | [`Tuning`] by object: likelihood before and after, regions with their samples |
//! | `evaluation[]` | [`ObjectEvaluation`] by object, on validation runs |
//! | `bounces[]` | [`RiseTimes`] by the object that the ball hit |
//! | `warnings[]` | sentences |
//!
//! The JSON Schema is `datasets_schema/ekf.schema.json`.

use super::{
    data::{Data, FrameRun},
    error::EkfError,
    evaluate::{Consistency, ConsistencyVerdict, EvaluatedRun, ObjectEvaluation, evaluate, follow},
    rise::{RiseTimes, responses, rises},
    settings::{FilterSettings, Object},
    tune::{TuneObserver, Tuning, tune},
};
use crate::{
    provenance::Provenance,
    recording::{Recording, Split},
};
use serde::Serialize;
use std::{fs, path::Path};

/// Version of the documents that this crate writes and reads.
pub const SCHEMA_VERSION: u32 = 2;

/// Content of `ekf.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Document {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Command line, crate version and commit.
    pub provenance: Provenance,
    /// The recordings.
    pub inputs: Vec<Input>,
    /// Extent of the training runs.
    pub train: Amount,
    /// Extent of the validation runs.
    pub validation: Amount,
    /// The tuned settings.
    pub filter: FilterSettings,
    /// Tuning record by object.
    pub tuning: Vec<Tuning>,
    /// Evaluation on validation runs by object.
    pub evaluation: Vec<ObjectEvaluation>,
    /// Rise times of the velocity estimate after bounces of the ball, on validation runs.
    pub bounces: Vec<RiseTimes>,
    /// Data-quality issues and inconsistent regions, as sentences.
    pub warnings: Vec<String>,
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Input {
    /// File name.
    pub name: String,
    /// SHA-256 in hexadecimal.
    pub sha256: String,
}

/// Number of runs and frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Amount {
    /// Runs.
    pub runs: usize,
    /// Camera frames.
    pub frames: usize,
    /// Total duration of the runs (s).
    pub duration_s: f64,
}

/// A tuned filter with the data of the page and of `ekf.mcap`.
#[derive(Debug, Clone)]
pub struct Tuned {
    /// The result.
    pub document: Document,
    /// Both filters on the validation runs.
    pub runs: Vec<EvaluatedRun>,
}

/// Tune a filter on the training runs of `recordings` and evaluate it on the validation runs.
///
/// # Errors
/// When nothing was detected, there are too few frames, nothing moves, or a message does not
/// decode.
pub fn tune_recordings(
    recordings: &[Recording],
    provenance: Provenance,
) -> Result<Tuned, EkfError> {
    tune_recordings_observed(recordings, provenance, &())
}

/// As [`tune_recordings`], with an observer of the progress.
///
/// # Errors
/// As [`tune_recordings`].
pub fn tune_recordings_observed(
    recordings: &[Recording],
    provenance: Provenance,
    observer: &dyn TuneObserver,
) -> Result<Tuned, EkfError> {
    let data = Data::from_recordings(recordings)?;
    let (mut settings, tuning) = tune(&FilterSettings::default(), &data, observer);
    settings.latency_s = data.latency_s.unwrap_or(0.0);
    let runs = follow(&settings, data.runs_for(Split::Validation));
    let evaluation: Vec<ObjectEvaluation> = Object::ALL
        .into_iter()
        .map(|object| evaluate(&runs, object, &settings))
        .filter(|own| 0 < own.detections)
        .collect();
    let document = Document {
        schema_version: SCHEMA_VERSION,
        provenance,
        inputs: recordings.iter().map(Input::of).collect(),
        train: Amount::of(data.runs_for(Split::Train)),
        validation: Amount::of(data.runs_for(Split::Validation)),
        filter: settings,
        bounces: rises(&responses(&runs, &settings)),
        warnings: warnings(&data, &tuning, &evaluation),
        tuning,
        evaluation,
    };
    Ok(Tuned { document, runs })
}

impl Input {
    fn of(recording: &Recording) -> Self {
        let name = recording.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Self { name, sha256: recording.sha256.clone() }
    }
}

impl Amount {
    fn of<'a>(runs: impl Iterator<Item = &'a FrameRun>) -> Self {
        let mut amount = Self { runs: 0, frames: 0, duration_s: 0.0 };
        for run in runs {
            amount.runs += 1;
            amount.frames += run.frames.len();
            amount.duration_s += run.duration();
        }
        amount
    }
}

impl Document {
    /// The text of `ekf.json`.
    #[must_use]
    pub fn to_json(&self) -> String {
        let text = serde_json::to_string_pretty(self);
        text.unwrap_or_else(|_always| unreachable!("all keys are strings")) + "\n"
    }
}

fn warnings(data: &Data, tuning: &[Tuning], evaluation: &[ObjectEvaluation]) -> Vec<String> {
    let mut warnings = Vec::new();
    match data.latency_s {
        None => warnings.push(
            "the camera clock is not the host clock: the latency is unknown, and positions are not \
             predicted over it"
                .to_owned(),
        ),
        Some(0.0) => warnings.push(
            "frames are stamped on arrival: the latency of camera and detection is unknown"
                .to_owned(),
        ),
        Some(_) => {}
    }
    let is_tuned = |own: &Tuning| own.regions.iter().any(|region| region.tuned);
    for own in tuning.iter().filter(|own| !is_tuned(own)) {
        let reason = own.regions.first().map_or("", |region| region.reason.as_str());
        warnings.push(format!("{}: not tuned: {reason}", own.object.name()));
    }
    for own in tuning.iter().filter(|own| is_tuned(own)) {
        for region in own.regions.iter().filter(|region| !region.tuned) {
            let (object, title) = (own.object.name(), region.region.title());
            warnings.push(format!("{object}, {title}: not tuned: {}", region.reason));
        }
    }
    let of = |object: Object| tuning.iter().any(|own| own.object == object && is_tuned(own));
    for own in evaluation.iter().filter(|own| of(own.object)) {
        for region in &own.regions {
            let checks = [("NIS", 2, &region.nis), ("NEES", 4, &region.nees)];
            for (name, expected, consistency) in checks {
                let Some(Consistency { mean, band95: [low, high], verdict: Some(verdict), .. }) =
                    consistency
                else {
                    continue;
                };
                if *verdict == ConsistencyVerdict::Consistent {
                    continue;
                }
                warnings.push(format!(
                    "{}, {}: mean {name} {mean:.2} is outside the 95 % band {low:.2} to {high:.2} \
                     (expected {expected}): the filter is {}",
                    own.object.name(),
                    region.region.title(),
                    verdict.name()
                ));
            }
        }
    }
    warnings
}

/// Read the settings in an `ekf.json`.
///
/// # Errors
/// When the file cannot be read, is not such a document, or holds a value outside its range.
pub fn read_settings(path: &Path) -> Result<FilterSettings, EkfError> {
    let text = fs::read_to_string(path)
        .map_err(|source| EkfError::Read { path: path.to_owned(), source })?;
    let not = |reason: String| EkfError::NotADocument { path: path.to_owned(), reason };
    let document: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| not(error.to_string()))?;
    let version = document.get("schema_version");
    if version.and_then(serde_json::Value::as_u64) != Some(u64::from(SCHEMA_VERSION)) {
        let found = version.map_or_else(|| "missing".to_owned(), serde_json::Value::to_string);
        return Err(not(format!("schema_version is {found}")));
    }
    let filter = document.get("filter").cloned().unwrap_or_default();
    let settings: FilterSettings =
        serde_json::from_value(filter).map_err(|error| not(format!("filter: {error}")))?;
    settings.check()?;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("ekf.json");
        fs::write(&path, text).unwrap();
        read_settings(&path).unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_document_is_refused_with_the_reason() {
        assert!(refused("{}").contains("schema_version is missing"));
        assert!(refused("{\"schema_version\": 3}").contains("schema_version is 3"));
        assert!(refused("{\"schema_version\": \"1\"}").contains("schema_version is \"1\""));
        assert!(refused("{\"schema_version\": 2}").contains("filter:"));
        let settings = FilterSettings { gate_probability: 0.9, ..FilterSettings::default() };
        let document = serde_json::json!({ "schema_version": 2, "filter": settings });
        assert!(refused(&document.to_string()).contains("gate_probability is 0.9"));
    }
}
