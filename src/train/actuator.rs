//! Actuator model in training, chosen by name or by file.

use super::{Mismatch, TrainError};
use crate::{
    actuator::read_actuator,
    ekf::read_settings,
    game::{Actuation, CONTROL_PERIOD, GameSettings, SensorSettings},
    recording::{Recording, sha256_of_file},
    twin::read_twin,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Effect of lost frames; its first parameter is their fraction.
const FRAME_DROP: &str = "sensor.frame_drop";
const CAMERA_LATENCY: &str = "sensor.camera_latency";

/// Kind of actuator of a virtual rig.
const VIRTUAL_RIG: &str = "virtual_rig";

/// The name of the ideal actuator.
pub const IDEAL: &str = "ideal";

/// Provenance of the actuator model of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActuatorSource {
    /// `ideal`, `twin`, `learned` or `virtual_rig`.
    pub kind: String,
    /// Name of its file, if any.
    pub file: Option<String>,
    /// SHA-256 of that file.
    pub sha256: Option<String>,
}

impl ActuatorSource {
    /// Return whether training is on a rig instead of a simulation.
    #[must_use]
    pub fn is_rig(&self) -> bool {
        self.kind == VIRTUAL_RIG
    }

    /// Provenance of the virtual rig in `file`.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn of_rig(file: &Path) -> Result<Self, TrainError> {
        Self::of_file(VIRTUAL_RIG, file)
    }

    fn of_file(kind: &str, file: &Path) -> Result<Self, TrainError> {
        Ok(Self {
            kind: kind.to_owned(),
            file: file.file_name().map(|name| name.to_string_lossy().into_owned()),
            sha256: Some(sha256_of_file(file)?),
        })
    }
}

/// Build the game with the actuator `choice`: `ideal`, a `twin.json`, or an `actuator.mcap`.
///
/// # Errors
/// When a file cannot be read, is of another kind, or has another control rate.
pub fn game_with_actuator(choice: &Path) -> Result<(GameSettings, ActuatorSource), TrainError> {
    let game = GameSettings::default();
    if choice.as_os_str() == IDEAL {
        let kind = IDEAL.to_owned();
        return Ok((game, ActuatorSource { kind, file: None, sha256: None }));
    }
    let game = match choice.extension().and_then(|extension| extension.to_str()) {
        Some("json") => game.with_twin(&read_twin(choice)?),
        Some("mcap") => with_network(game, choice)?,
        _ => {
            return Err(TrainError::BadPolicy {
                path: choice.to_owned(),
                reason:
                    "an actuator is 'ideal', a twin.json of `klasktron gap` or an actuator.mcap of \
                         `klasktron fit-actuator`"
                        .to_owned(),
            });
        }
    };
    game.check()?;
    let source = ActuatorSource::of_file(game.actuation.name(), choice)?;
    Ok((game, source))
}

/// Sensors of training: noise, latency and filter of the file `ekf`, and what a twin as `actuator` has
/// identified: the fraction of lost frames, and without `ekf` the latency of the camera. Without `ekf` the
/// filter is the untuned one; without `ekf` and twin there are no sensors.
///
/// # Errors
/// When a file cannot be read, or a value is outside its range.
pub fn sensors_of(
    ekf: Option<&Path>,
    actuator: &Path,
) -> Result<Option<SensorSettings>, TrainError> {
    let is_twin = actuator.extension().is_some_and(|extension| extension == "json");
    if ekf.is_none() && !is_twin {
        return Ok(None);
    }
    let filter = ekf.map(read_settings).transpose()?;
    let mut sensors = SensorSettings::of(filter.unwrap_or_default());
    if is_twin {
        let twin = read_twin(actuator)?;
        let first = |name: &str| {
            let found = twin.instances.iter().find(|own| own.effect.name == name);
            found.map(|own| own.values[0].value)
        };
        sensors.lost_fraction = first(FRAME_DROP).unwrap_or(0.0);
        if filter.is_none() {
            // The estimator predicts by the latency that it knows.
            sensors.latency_s = first(CAMERA_LATENCY).unwrap_or(0.0).max(0.0);
            sensors.filter.latency_s = sensors.latency_s;
        }
    }
    sensors.check()?;
    Ok(Some(sensors))
}

fn with_network(game: GameSettings, path: &Path) -> Result<GameSettings, TrainError> {
    let stored = read_actuator(&Recording::open(path)?)?;
    let rate: f64 =
        stored.metadata.get("rate_hz").and_then(|text| text.parse().ok()).unwrap_or(f64::NAN);
    let expected = CONTROL_PERIOD.recip();
    if 1e-9 < (rate - expected).abs() || rate.is_nan() {
        return Err(Box::new(Mismatch {
            path: path.to_owned(),
            what: "the rate".to_owned(),
            found: format!("{rate} Hz"),
            other: "the game",
            expected: format!("{expected} Hz"),
            remedy: "fit the actuator with --rate-hz 50",
        })
        .into());
    }
    let coverage = Some(stored.coverage);
    Ok(GameSettings { actuation: Actuation::learned(stored.model), coverage, ..game })
}
