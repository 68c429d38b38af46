//! Command latency of each motor on the bus. The setpoint frames of one period leave one after
//! another, so the second motor of a gantry receives its command one frame later than the first.

use super::{
    Recording, RecordingError,
    topic::{Motor, Player},
};

/// Longest plausible time from a command to its arrival (s): a period of 10 Hz.
const LONGEST_SECONDS: f64 = 0.1;

/// Return the metadata key of the time from a recorded command of `player` to the end of `motor`'s
/// setpoint frame on the bus (s).
#[must_use]
pub fn arrival_key(player: Player, motor: Motor) -> String {
    format!("command_arrival_{player}_{}_s", motor.name())
}

impl Recording {
    /// Return the time from a recorded command of `player` to its arrival at each motor (s), from
    /// the metadata; 0 without an entry.
    ///
    /// # Errors
    /// When an entry is not a time from 0 to 0.1 s.
    pub fn command_arrivals(&self, player: Player) -> Result<[f64; 2], RecordingError> {
        let mut seconds = [0.0; 2];
        for (own, motor) in seconds.iter_mut().zip(Motor::BOTH) {
            let key = arrival_key(player, motor);
            let Some(value) = self.info(&key) else { continue };
            let number = value.parse().ok().filter(|s| (0.0..=LONGEST_SECONDS).contains(s));
            *own = number.ok_or_else(|| RecordingError::BadMetadata {
                path: self.path.clone(),
                value: value.to_owned(),
                expected: format!("a time from 0 to {LONGEST_SECONDS} s"),
                key,
            })?;
        }
        Ok(seconds)
    }
}
