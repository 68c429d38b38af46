//! Free rolls of the ball: from their start over walls to their end, as the camera sees them.

mod impacts;
mod roller;
mod rolls;
#[cfg(test)]
mod tests;

pub use impacts::WallImpact;

use super::{Channel, Stage, StageKind, Twin};
use crate::{
    board::BALL_RADIUS,
    effects::{Domain, Effect, Physics},
    recording::{Recording, RecordingError},
};
use roller::{Roller, Rules};
use rolls::{Extent, Roll, Tracks};
use std::ops::Range;

/// Half of the board's sides (m).
const HALF_BOARD: [f64; 2] = [0.16, 0.21];

/// Typical magnitudes of a roll's start: position (m) and velocity (m/s).
const START_SCALE: [f64; 4] = [1e-3, 1e-3, 0.01, 0.01];

/// Rolls of one session. A roll is a piece of the ball's track on which only board, air and walls
/// act. Its start (position and velocity) is unknown and is a nuisance group of its own.
///
/// Two channels, `camera.ball_x` and `camera.ball_y` (`camera.ball_roll_x` and `camera.ball_roll_y`
/// of whole rolls); run `k` of both is roll `k`. A constant latency of the camera moves the starts
/// and nothing else, so it is not identifiable here.
pub struct BallStage {
    extent: Extent,
    channels: Vec<Channel>,
    tracks: Tracks,
    rolls: Vec<Roll>,
}

impl BallStage {
    /// Measured signals, to exclude samples.
    pub(super) fn channels_mut(&mut self) -> &mut [Channel] {
        &mut self.channels
    }

    /// Free rolls of `recording` in pieces, and whole ones as well if any was cut; empty without
    /// rolls. Only samples in one of `spans` (seconds since the recording began) count, and no roll
    /// continues beyond the end of its span.
    ///
    /// # Errors
    /// When detections do not decode.
    pub fn from_recording(
        recording: &Recording,
        spans: &[Range<f64>],
    ) -> Result<Vec<Self>, RecordingError> {
        let Some(tracks) = Tracks::from_recording(recording)? else { return Ok(Vec::new()) };
        let whole = Self::from_tracks(tracks.clone(), spans, Extent::Whole);
        let pieces = Self::from_tracks(tracks, spans, Extent::Pieces);
        let count = pieces.as_ref().map_or(0, Self::roll_count);
        let whole = whole.filter(|whole| whole.roll_count() < count);
        Ok(pieces.into_iter().chain(whole).collect())
    }

    /// The free rolls in `tracks` within `spans`.
    fn from_tracks(tracks: Tracks, spans: &[Range<f64>], extent: Extent) -> Option<Self> {
        let rolls = rolls::cut(&tracks, spans, extent);
        if rolls.is_empty() {
            return None;
        }
        let runs: Vec<Range<usize>> = rolls.iter().map(|roll| roll.samples.clone()).collect();
        let channel = |axis: usize, name: &'static str| Channel {
            signal: match extent {
                Extent::Pieces => format!("camera.ball_{name}"),
                Extent::Whole => format!("camera.ball_roll_{name}"),
            },
            unit: "m",
            domain: Domain::Ball,
            axis: name,
            rate_hz: tracks.rate_hz,
            times: tracks.times.clone(),
            measured: tracks.ball.iter().map(|place| place[axis]).collect(),
            runs: runs.clone(),
        };
        let channels = vec![channel(0, "x"), channel(1, "y")];
        Some(Self { extent, channels, tracks, rolls })
    }

    /// Number of rolls.
    #[must_use]
    pub fn roll_count(&self) -> usize {
        self.rolls.len()
    }

    /// Every impact on a wall that the camera's samples show, measured from the samples around it,
    /// in order of time; no twin is involved.
    #[must_use]
    pub fn impacts(&self) -> Vec<WallImpact> {
        impacts::measure(&self.tracks, &self.rolls)
    }

    fn predict_roll(&self, rules: &Rules, roll: &Roll, start: &[f64], predicted: &mut [Vec<f64>]) {
        let mut roller = Roller::new(rules, start);
        let origin = self.tracks.times[roll.samples.start];
        let age = rules.age(origin);
        if roll.goes_on {
            roller.rolls_without_slip();
        }
        for sample in roll.samples.clone() {
            let time = self.tracks.times[sample];
            roller.strikers(self.tracks.strikers[sample]);
            roller.advance_to(time - origin - (rules.age(time) - age));
            let seen = rules.seen(roller.place());
            for (channel, place) in predicted.iter_mut().zip(seen) {
                channel[sample] = place;
            }
        }
    }
}

impl Stage for BallStage {
    fn kind(&self) -> StageKind {
        match self.extent {
            Extent::Pieces => StageKind::Ball,
            Extent::Whole => StageKind::WholeRolls,
        }
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, effect: &Effect) -> bool {
        let is_seen =
            |equation: &Physics| matches!(equation, Physics::Camera(_) | Physics::CameraDelay(_));
        let physics = &effect.physics;
        physics.acts_on_ball() || physics.equations().iter().any(is_seen)
    }

    fn nuisance_groups(&self) -> Vec<Range<usize>> {
        (0..self.rolls.len()).map(|roll| roll..roll + 1).collect()
    }

    fn nuisance_start(&self, group: usize) -> Vec<f64> {
        self.rolls.get(group).map(|roll| roll.start.to_vec()).unwrap_or_default()
    }

    fn nuisance_scale(&self) -> Vec<f64> {
        START_SCALE.to_vec()
    }

    fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        for channel in predicted.iter_mut() {
            channel.fill(f64::NAN);
        }
        let rules = Rules::new(&twin.instances);
        for (roll, start) in self.rolls.iter().zip(nuisance) {
            self.predict_roll(&rules, roll, start, predicted);
        }
    }
}
