//! Camera with a detector as one source of detections: predictions, warnings, latency and the datagram.

use super::{
    detector::{
        Detection, Detections, Detector, DetectorError, Exposure, Light, Prediction, Predictions,
    },
    frame::Frame,
    pose_check::{PoseCheck, PoseShift},
    pose_watch::{PoseChecks, PoseWarning},
    source::{FrameSource, Next, SourceError},
};
use crate::{
    link::{CameraFeed, LinkError},
    recording::message::{CameraDetections, CameraFrame, Covariance, Point},
    units::{NANOS_PER_SECOND, Nanos},
};
use std::{
    io::Write as _,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// Standard deviation of a predicted coordinate after one frame (m): a ball that is hit changes its speed by about
/// 2 m/s, which is 17 mm in a frame; four standard deviations reach it.
const SIGMA_PER_FRAME: f64 = 0.004;
/// Frames without a detection after which a piece is searched in the whole field.
const MAX_COASTING: u32 = 3;
/// Gap between frames (s) after which nothing is predicted.
const MAX_GAP_S: f64 = 0.1;
/// Bytes of a datagram; 700 hold every digit.
const DATAGRAM_BYTES: usize = 1024;

/// Motion of one piece, from its last two detections.
#[derive(Debug, Clone, Copy, Default)]
struct Track {
    position: [f64; 2],
    velocity: [f64; 2],
    seen_at: Option<Nanos>,
    missed: u32,
}

impl Track {
    fn predict(&self, at: Nanos) -> Option<Prediction> {
        let dt = at.seconds_since(self.seen_at?);
        if MAX_COASTING < self.missed || !(0.0..MAX_GAP_S).contains(&dt) {
            return None;
        }
        let position = [0, 1].map(|axis| self.position[axis] + self.velocity[axis] * dt);
        Some(Prediction { position, sigma: SIGMA_PER_FRAME * f64::from(1 + self.missed) })
    }

    fn update(&mut self, at: Nanos, found: Option<&Detection>) {
        let Some(found) = found else {
            self.missed += 1;
            return;
        };
        let dt = self.seen_at.map_or(f64::INFINITY, |last| at.seconds_since(last));
        self.velocity = if 0.0 < dt && dt < MAX_GAP_S {
            [0, 1].map(|axis| (found.position[axis] - self.position[axis]) / dt)
        } else {
            [0.0; 2]
        };
        *self = Self {
            position: found.position,
            velocity: self.velocity,
            seen_at: Some(at),
            missed: 0,
        };
    }
}

/// Warning about a frame; each is reported when it begins, not for every frame.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameWarning {
    /// Too dark or overexposed, with the exposure time (s) where the source knows it.
    Light(Light, Option<f64>),
    /// More than one ball.
    TwoBalls(usize),
    /// A frame that could not be read, or a camera that is unplugged.
    Source(String),
    /// A pose that is not that of the calibration, or cannot be checked.
    Pose(PoseWarning),
}

impl std::fmt::Display for FrameWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Light(light, Some(exposure)) => {
                write!(f, "{light} (the exposure is {:.1} ms)", 1e3 * exposure)
            }
            Self::Light(light, None) => write!(f, "{light} (the exposure time is not known)"),
            Self::TwoBalls(count) => write!(
                f,
                "{count} balls are on the field; the detector follows the one that it saw first: remove the others"
            ),
            Self::Source(text) => f.write_str(text),
            Self::Pose(warning) => warning.fmt(f),
        }
    }
}

/// Result of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Detections.
    pub detections: Detections,
    /// Time at which this program got the frame.
    pub received_time: Nanos,
    /// Time at which the detections were complete; the received time of a source that is not live.
    pub detected_time: Nanos,
}

/// Detector that predicts from frame to frame and gathers warnings.
#[derive(Debug)]
pub struct DetectingFrames {
    detector: Detector,
    tracks: [Track; 3],
    exposure: Exposure,
    balls: usize,
    /// Exposure time (s), for messages.
    exposure_s: Option<f64>,
    warnings: Vec<FrameWarning>,
}

impl DetectingFrames {
    /// Start with a detector and no prediction.
    #[must_use]
    pub fn new(detector: Detector) -> Self {
        Self {
            detector,
            tracks: [Track::default(); 3],
            exposure: Exposure::Good,
            balls: 0,
            exposure_s: None,
            warnings: Vec::new(),
        }
    }

    /// Detect in the next frame; pieces that were seen shortly before are searched near their predicted places.
    ///
    /// # Errors
    /// When the frame has another size than the calibration.
    pub fn detect(&mut self, frame: &Frame) -> Result<Detections, DetectorError> {
        let at = frame.capture_time;
        let [ball, left, right] = self.tracks.each_ref().map(|track| track.predict(at));
        let found = self.detector.detect(frame, &Predictions { ball, left, right })?;
        for (track, found) in self.tracks.iter_mut().zip([&found.ball, &found.left, &found.right]) {
            track.update(at, found.as_ref());
        }
        if found.light.exposure != self.exposure && found.light.exposure != Exposure::Good {
            self.warnings.push(FrameWarning::Light(found.light, self.exposure_s));
        }
        if self.balls < 2 && 2 <= found.balls {
            self.warnings.push(FrameWarning::TwoBalls(found.balls));
        }
        (self.exposure, self.balls) = (found.light.exposure, found.balls);
        Ok(found)
    }

    /// Return the warnings that have begun since the last call.
    pub fn take_warnings(&mut self) -> Vec<FrameWarning> {
        std::mem::take(&mut self.warnings)
    }
}

/// Source of frames with a detector.
pub struct DetectingCamera {
    source: Box<dyn FrameSource>,
    frame: Frame,
    frames: DetectingFrames,
    pose: Option<PoseChecks>,
    detection: Duration,
    report: Box<dyn FnMut(&FrameWarning) + Send>,
}

impl DetectingCamera {
    /// Combine a source with a detector and, if given, a check of the camera's pose.
    #[must_use]
    pub fn new(source: Box<dyn FrameSource>, detector: Detector, pose: Option<PoseCheck>) -> Self {
        let mut frames = DetectingFrames::new(detector);
        frames.exposure_s = source.exposure_s();
        let checks = if source.is_live() { PoseChecks::on_thread } else { PoseChecks::here };
        let pose = pose.map(checks);
        Self {
            source,
            frame: Frame::default(),
            frames,
            pose,
            detection: Duration::ZERO,
            report: Box::new(|warning| log::warn!("{warning}")),
        }
    }

    /// Pass the warnings of [`CameraFeed::receive`] to `report` instead of the log.
    #[must_use]
    pub fn with_report(mut self, report: impl FnMut(&FrameWarning) + Send + 'static) -> Self {
        self.report = Box::new(report);
        self
    }

    /// Return the last frame.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Return the time that the last detection took (s).
    #[must_use]
    pub fn detection_seconds(&self) -> f64 {
        self.detection.as_secs_f64()
    }

    /// Return the displacement of the table in the image since the calibration, as last measured.
    #[must_use]
    pub fn pose_shift(&self) -> Option<PoseShift> {
        self.pose.as_ref().and_then(PoseChecks::shift)
    }

    /// Return the name of the source.
    #[must_use]
    pub fn name(&self) -> String {
        self.source.name()
    }

    /// Return the warnings that have begun since the last call.
    pub fn take_warnings(&mut self) -> Vec<FrameWarning> {
        self.frames.take_warnings()
    }

    /// Wait for the next frame and detect. A damaged frame is a warning and no result.
    ///
    /// # Errors
    /// When the source is not usable, or its frames have another size than the calibration.
    pub fn next_seen(&mut self) -> Result<(Next, Option<Seen>), FeedError> {
        match self.source.next_frame(&mut self.frame) {
            Ok(Next::Frame) => {}
            Ok(other) => {
                let ends = if other == Next::End { self.pose.as_mut() } else { None };
                let warning = ends.and_then(PoseChecks::end);
                self.frames.warnings.extend(warning.map(FrameWarning::Pose));
                return Ok((other, None));
            }
            Err(error) if error.is_single_frame() || self.source.is_live() => {
                self.frames.warnings.push(FrameWarning::Source(error.to_string()));
                return Ok((Next::Nothing, None));
            }
            Err(error) => return Err(error.into()),
        }
        let begun = Instant::now();
        let detections = self.frames.detect(&self.frame)?;
        self.detection = begun.elapsed();
        let received_time = self.frame.received_time;
        let detected_time = if self.source.is_live() { now() } else { received_time };
        if let Some(pose) = &mut self.pose
            && detections.light.exposure == Exposure::Good
        {
            self.frames.warnings.extend(pose.take(&self.frame).map(FrameWarning::Pose));
        }
        Ok((Next::Frame, Some(Seen { detections, received_time, detected_time })))
    }
}

/// Error of a camera with a detector.
#[derive(Debug, thiserror::Error)]
pub enum FeedError {
    /// Error of the source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Error of the detector.
    #[error(transparent)]
    Detector(#[from] DetectorError),
}

impl CameraFeed for DetectingCamera {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Vec<u8>>, LinkError> {
        let broken = |what: String, remedy| LinkError::Unusable {
            bus: "the camera".to_owned(),
            what,
            remedy,
        };
        let (next, seen) =
            self.next_seen().map_err(|error| broken(error.to_string(), "start anew"))?;
        for warning in self.take_warnings() {
            (self.report)(&warning);
        }
        match (next, seen) {
            (Next::End, _) => {
                Err(broken(format!("{} has ended", self.name()), "give a live camera"))
            }
            (_, None) => {
                if !self.source.is_live() {
                    std::thread::sleep(timeout);
                }
                Ok(None)
            }
            (_, Some(seen)) => Ok(Some(write_datagram(&seen.detections))),
        }
    }
}

fn now() -> Nanos {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Nanos(since.as_secs() * NANOS_PER_SECOND + u64::from(since.subsec_nanos()))
}

/// Return the datagram of detections, as [`crate::link::camera`] defines it.
#[must_use]
pub fn write_datagram(found: &Detections) -> Vec<u8> {
    let mut text = Vec::with_capacity(DATAGRAM_BYTES);
    // Writing into a vector cannot fail.
    write!(text, "{{\"capture_time_ns\":{}", found.capture_time.0).ok();
    for (name, piece) in [("ball", &found.ball), ("left", &found.left), ("right", &found.right)] {
        match piece {
            Some(Detection { position: [x, y], covariance: [[xx, xy], [_, yy]], .. }) => {
                write!(
                    text,
                    ",\"{name}\":{{\"x\":{x:.7},\"y\":{y:.7},\"xx\":{xx:.4e},\"xy\":{xy:.4e},\"yy\":{yy:.4e}}}"
                )
                .ok();
            }
            None => {
                write!(text, ",\"{name}\":null").ok();
            }
        }
    }
    text.push(b'}');
    text
}

fn point(piece: &Detection) -> Point {
    Point { x: piece.position[0], y: piece.position[1] }
}

impl Detections {
    /// Return the message of the data contract.
    #[must_use]
    pub fn message(&self) -> CameraDetections {
        let covariance = |piece: &Detection| {
            let [[xx, xy], [_, yy]] = piece.covariance;
            Covariance { xx, xy, yy }
        };
        CameraDetections {
            capture_time_ns: self.capture_time.0,
            ball: self.ball.as_ref().map(point),
            left: self.left.as_ref().map(point),
            right: self.right.as_ref().map(point),
            ball_covariance: self.ball.as_ref().map(covariance),
            left_covariance: self.left.as_ref().map(covariance),
            right_covariance: self.right.as_ref().map(covariance),
        }
    }
}

impl Seen {
    /// Return the message about the processing of the frame.
    #[must_use]
    pub fn frame_message(&self) -> CameraFrame {
        let found = &self.detections;
        CameraFrame {
            capture_time_ns: found.capture_time.0,
            received_time_ns: self.received_time.0,
            detected_time_ns: self.detected_time.0,
            biscuits: found.biscuits.iter().flatten().map(point).collect(),
            balls: found.balls as u32,
            median_level: found.light.median_level,
            saturated_fraction: found.light.saturated_fraction,
            searched_everything: found.searched_everything,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::parse_detections;

    fn piece(position: [f64; 2]) -> Detection {
        Detection {
            position,
            covariance: [[4e-8, 1e-8], [1e-8, 9e-8]],
            pixel: [0.0; 2],
            support: 1.0,
        }
    }

    #[test]
    fn the_datagram_is_the_message() {
        let found = Detections {
            capture_time: Nanos(1_700_000_000_123_456_789),
            ball: Some(piece([0.0123456, -0.2])),
            left: None,
            right: Some(piece([-0.1, 0.15])),
            biscuits: [None; 3],
            light: Light { exposure: Exposure::Good, median_level: 70.0, saturated_fraction: 0.0 },
            balls: 1,
            searched_everything: true,
        };
        assert_eq!(parse_detections(&write_datagram(&found)).unwrap(), found.message());
    }

    #[test]
    fn a_piece_is_predicted_by_its_velocity_until_it_is_missed_for_long() {
        let mut track = Track::default();
        assert_eq!(track.predict(Nanos(0)), None);
        let frame = |k: u64| Nanos(k * 8_000_000);
        track.update(frame(1), Some(&piece([0.0, 0.0])));
        track.update(frame(2), Some(&piece([0.008, 0.0])));
        let predicted = track.predict(frame(3)).unwrap();
        assert!((predicted.position[0] - 0.016).abs() < 1e-9);
        for k in 3..7 {
            assert!(track.predict(frame(k)).is_some(), "{k}");
            track.update(frame(k), None);
        }
        assert_eq!(track.predict(frame(7)), None);
    }

    #[test]
    fn dark_frames_are_reported_with_the_exposure() {
        let light = Light { exposure: Exposure::Dark, median_level: 4.0, saturated_fraction: 0.0 };
        let text = FrameWarning::Light(light, Some(0.004)).to_string();
        assert!(text.starts_with("the image is too dark: median brightness 4 of 255"), "{text}");
        assert!(text.ends_with("(the exposure is 4.0 ms)"), "{text}");
    }
}
