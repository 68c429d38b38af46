//! Belt per motor turn of the machine behind a recording.

use super::{Recording, RecordingError};

/// Belt per motor turn of the KlaskTron gantry (m): 20 teeth of 2 mm.
pub const BELT_METRES_PER_TURN: f64 = 0.04;

/// Key of the metadata that holds the belt per motor turn (m).
pub const BELT_KEY: &str = "belt_metres_per_turn";

/// Longest belt per motor turn (m).
const LONGEST: f64 = 1.0;

impl Recording {
    /// Belt per motor turn (m) from the metadata; `None` where they do not hold it.
    ///
    /// # Errors
    /// When the value is no number above 0 and up to 1 m.
    pub fn belt_metres_per_turn(&self) -> Result<Option<f64>, RecordingError> {
        let Some(value) = self.info(BELT_KEY) else { return Ok(None) };
        let metres = value.parse().ok().filter(|metres| 0.0 < *metres && *metres <= LONGEST);
        let refused = || RecordingError::BadMetadata {
            path: self.path.clone(),
            key: BELT_KEY.to_owned(),
            value: value.to_owned(),
            expected: format!("a number above 0 and up to {LONGEST} m"),
        };
        metres.ok_or_else(refused).map(Some)
    }
}
