//! `ekf.json`: the tuned settings, how they were found, and how good they are.
//!
//! | field | what |
//! |---|---|
//! | `schema_version` | `"1"` |
//! | `provenance` | command line, crate version, commit |
//! | `inputs[]` | `name`, `sha256` of every recording |
//! | `train`, `held_out` | `runs`, `frames`, `duration_s` |
//! | `filter` | [`FilterSettings`], all that a filter needs; [`read_settings`] reads it back |
//! | `tuning[]` | [`Tuning`] by object: likelihood before and after, regions with their samples |
//! | `judgement[]` | [`ObjectJudgement`] by object, on held-out runs |
//! | `bounces[]` | [`RiseJudgement`] by what the ball hit |
//! | `warnings[]` | sentences |

use super::{
    data::{Data, FrameRun},
    error::EkfError,
    judge::{Consistency, JudgedRun, ObjectJudgement, follow, judge},
    rise::{RiseJudgement, responses, rises},
    settings::{FilterSettings, Object},
    tune::{Tuning, tune},
};
use crate::{
    provenance::Provenance,
    recording::{Recording, Split},
};
use serde::Serialize;
use std::{fs, path::Path};

/// Of documents that this crate writes and reads.
pub const SCHEMA_VERSION: &str = "1";

/// Everything in `ekf.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Document {
    /// [`SCHEMA_VERSION`].
    pub schema_version: &'static str,
    /// How it was made.
    pub provenance: Provenance,
    /// The recordings.
    pub inputs: Vec<Input>,
    /// What was fitted.
    pub train: Amount,
    /// What judges.
    pub held_out: Amount,
    /// The tuned settings.
    pub filter: FilterSettings,
    /// How they were found, by object.
    pub tuning: Vec<Tuning>,
    /// How good they are on held-out runs, by object.
    pub judgement: Vec<ObjectJudgement>,
    /// How fast the filter follows impacts of the ball there.
    pub bounces: Vec<RiseJudgement>,
    /// What a reader must know.
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

/// How much of something.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Amount {
    /// Runs.
    pub runs: usize,
    /// Pictures.
    pub frames: usize,
    /// Sum of the lengths of the runs (s).
    pub duration_s: f64,
}

/// A tuned filter with all that the page and the tape show.
#[derive(Debug, Clone)]
pub struct Tuned {
    /// The result.
    pub document: Document,
    /// Both filters on the held-out runs.
    pub runs: Vec<JudgedRun>,
}

/// Tunes a filter on the train runs of `recordings` and judges it on the others.
///
/// # Errors
/// When nothing was seen, too little, or nothing moves; when a message does not decode.
pub fn tune_recordings(
    recordings: &[Recording],
    provenance: Provenance,
) -> Result<Tuned, EkfError> {
    let data = Data::from_recordings(recordings)?;
    let (mut settings, tuning) = tune(&FilterSettings::default(), &data);
    settings.latency_s = data.latency_s.unwrap_or(0.0);
    let runs = follow(&settings, data.runs_for(Split::Validation));
    let judgement: Vec<ObjectJudgement> = Object::ALL
        .into_iter()
        .map(|object| judge(&runs, object, &settings))
        .filter(|own| 0 < own.detections)
        .collect();
    let document = Document {
        schema_version: SCHEMA_VERSION,
        provenance,
        inputs: recordings.iter().map(Input::of).collect(),
        train: Amount::of(data.runs_for(Split::Train)),
        held_out: Amount::of(data.runs_for(Split::Validation)),
        filter: settings,
        bounces: rises(&responses(&runs, &settings)),
        warnings: warnings(&data, &tuning, &judgement),
        tuning,
        judgement,
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

fn warnings(data: &Data, tuning: &[Tuning], judgement: &[ObjectJudgement]) -> Vec<String> {
    let mut warnings = Vec::new();
    match data.latency_s {
        None => warnings.push(
            "the camera's clock is not the host's, so the latency is not known and nothing is \
             predicted ahead"
                .to_owned(),
        ),
        Some(0.0) => warnings.push(
            "pictures are stamped on arrival, so the latency of camera and detection is not known"
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
    for own in judgement.iter().filter(|own| of(own.object)) {
        for region in &own.regions {
            let checks = [("NIS", 2, &region.nis), ("NEES", 4, &region.nees)];
            for (name, expected, consistency) in checks {
                let Some(Consistency { mean, band95: [low, high], within: Some(false), .. }) =
                    consistency
                else {
                    continue;
                };
                warnings.push(format!(
                    "{}, {}: mean {name} {mean:.2} lies outside {low:.2} to {high:.2} (consistent: \
                     {expected}): the filter is too {}",
                    own.object.name(),
                    region.region.title(),
                    if *high < *mean { "sure of itself" } else { "careful" }
                ));
            }
        }
    }
    warnings
}

/// The settings in an `ekf.json`.
///
/// # Errors
/// When the file cannot be read, is no such document, or holds numbers with which no filter works.
pub fn read_settings(path: &Path) -> Result<FilterSettings, EkfError> {
    let text = fs::read_to_string(path)
        .map_err(|source| EkfError::Read { path: path.to_owned(), source })?;
    let not = |reason: String| EkfError::NotADocument { path: path.to_owned(), reason };
    let document: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| not(error.to_string()))?;
    let version = document.get("schema_version").and_then(serde_json::Value::as_str);
    if version != Some(SCHEMA_VERSION) {
        return Err(not(format!("schema_version is {}", version.unwrap_or("missing"))));
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
        assert!(refused("{\"schema_version\": \"2\"}").contains("schema_version is 2"));
        assert!(refused("{\"schema_version\": \"1\"}").contains("filter:"));
        let settings = FilterSettings { gate_probability: 0.9, ..FilterSettings::default() };
        let document = serde_json::json!({ "schema_version": "1", "filter": settings });
        assert!(refused(&document.to_string()).contains("gate_probability is 0.9"));
    }
}
