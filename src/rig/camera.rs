//! Camera model: capture, detection errors, latency.
//!
//! A frame is captured at each multiple of the period. An object at position `p` is detected at
//! `R (p (1 + k |p|^2) s (1 + parallax)) + offset + noise`, rounded to the quantization, with the
//! rotation `R` and the scales `s`. Detections may be missing or outliers. The datagram is one JSON
//! object in the board frame:
//! `{"capture_time_ns":N,"ball":{"x":m,"y":m},"left":...,"right":...}`, with `null` for an undetected
//! object.
//!
//! With drawn frames ([`super::draw`]) the camera hands over the scene instead, and a detector makes the datagram. Its
//! detection errors are then those of the detector: only rate, latency, exposure, losses and time stamps are modelled.

use super::config::{CameraConfig, StampMode};
use super::draw::Scene;
use crate::{seed::Stream, units::Nanos};
use std::{collections::VecDeque, io::Write as _};

const NANOS: f64 = 1e9;

/// Position (m) and velocity (m/s) of a visible object.
pub(super) type Sight = Option<([f64; 2], [f64; 2])>;

/// The camera with its datagrams in transit.
#[derive(Debug, Clone)]
pub(super) struct Camera {
    config: CameraConfig,
    start: Nanos,
    pictures: u64,
    next_capture_ns: u64,
    /// True if a fault stops it.
    pub(super) stopped: bool,
    /// Motion parallel to the board since the calibration (m).
    pub(super) shift: [f64; 2],
    /// Datagrams by arrival time (ns since the start).
    waiting: VecDeque<(u64, Vec<u8>)>,
    /// True if scenes are handed over instead of datagrams.
    pub(super) draws: bool,
    /// Scenes by arrival time (ns since the start).
    scenes: VecDeque<(u64, Scene)>,
    noise: Stream,
    timing: Stream,
    loss: Stream,
}

impl Camera {
    pub(super) fn new(config: &CameraConfig, start: Nanos, seed: u64) -> Self {
        Self {
            config: config.clone(),
            start,
            pictures: 0,
            next_capture_ns: 0,
            stopped: false,
            shift: [0.0; 2],
            waiting: VecDeque::new(),
            draws: false,
            scenes: VecDeque::new(),
            noise: Stream::new(seed, "rig.camera.noise"),
            timing: Stream::new(seed, "rig.camera.timing"),
            loss: Stream::new(seed, "rig.camera.loss"),
        }
    }

    /// Time of the scene in the next frame (ns since the start): half of the exposure before its
    /// capture.
    pub(super) fn next_ns(&self) -> u64 {
        let half_ns = (self.config.exposure_s / 2.0 * NANOS) as u64;
        self.next_capture_ns.saturating_sub(half_ns)
    }

    /// Capture the frame that is due, from the objects at `now_ns`: ball, left, right.
    pub(super) fn take(&mut self, now_ns: u64, sights: [Sight; 3]) {
        let (capture_ns, shown_ns) = (self.next_capture_ns, self.next_ns());
        self.pictures += 1;
        self.next_capture_ns = (self.pictures as f64 / self.config.rate_hz * NANOS).round() as u64;
        let jitter = self.uniform() * self.config.latency_jitter_s;
        let latency = self.config.latency_s + jitter;
        let lost = f64::from(self.loss.uniform_f32(0.0, 1.0)) < self.config.drop_fraction;
        if lost || self.stopped {
            return;
        }
        let arrival_ns = (capture_ns + (latency * NANOS) as u64).max(now_ns);
        let back = now_ns.saturating_sub(shown_ns) as f64 / NANOS;
        let [ball, left, right] = sights;
        if self.draws {
            let moved = |(position, velocity): ([f64; 2], [f64; 2])| {
                ([0, 1].map(|axis| position[axis] - velocity[axis] * back), velocity)
            };
            let nowhere = ([10.0, 10.0], [0.0; 2]);
            let scene = Scene {
                capture_time: Nanos(self.stamp(capture_ns, arrival_ns)),
                exposure_s: self.config.exposure_s,
                camera_shift: self.shift,
                ball: ball.map(moved),
                strikers: [left, right].map(|own| own.map_or(nowhere, moved)),
            };
            self.scenes.push_back((arrival_ns, scene));
            return;
        }
        let seen = [
            self.see(ball, self.config.ball_parallax, back),
            self.see(left, self.config.peg_parallax, back),
            self.see(right, self.config.peg_parallax, back),
        ];
        let stamp = self.stamp(capture_ns, arrival_ns);
        let datagram = write_datagram(stamp, seen);
        let twice = f64::from(self.loss.uniform_f32(0.0, 1.0)) < self.config.repeat_fraction;
        let at = self.waiting.partition_point(|(arrival, _)| *arrival <= arrival_ns);
        if twice {
            self.waiting.insert(at, (arrival_ns, datagram.clone()));
        }
        self.waiting.insert(at, (arrival_ns, datagram));
    }

    /// The next datagram that has arrived by `now_ns`, with its arrival time.
    pub(super) fn arrived(&mut self, now_ns: u64) -> Option<(u64, Vec<u8>)> {
        self.waiting.pop_front_if(|(arrival, _)| *arrival <= now_ns)
    }

    /// The next scene whose detections have arrived by `now_ns`, with their arrival time.
    pub(super) fn arrived_scene(&mut self, now_ns: u64) -> Option<(u64, Scene)> {
        self.scenes.pop_front_if(|(arrival, _)| *arrival <= now_ns)
    }

    fn uniform(&mut self) -> f64 {
        f64::from(self.timing.uniform_f32(0.0, 1.0))
    }

    fn stamp(&mut self, capture_ns: u64, arrival_ns: u64) -> u64 {
        let config = &self.config;
        let base = match config.stamp {
            StampMode::Capture => capture_ns,
            StampMode::Arrival => arrival_ns,
        };
        let error = config.stamp_offset_s
            + config.stamp_skew * base as f64 / NANOS
            + config.stamp_jitter_s * normal(&mut self.timing);
        Nanos(self.start.0 + base).after_seconds(error).0
    }

    fn see(&mut self, sight: Sight, parallax: f64, back: f64) -> Option<[f64; 2]> {
        let (position, velocity) = sight?;
        let config = &self.config;
        let mut draw = || f64::from(self.loss.uniform_f32(0.0, 1.0));
        let (missed, outlier) = (draw() < config.miss_fraction, draw() < config.outlier_fraction);
        let stray = [0, 1].map(|_| (2.0 * draw() - 1.0) * config.outlier_m);
        let noise = [0, 1].map(|_| normal(&mut self.noise) * config.noise_m);
        if missed {
            return None;
        }
        let p = [0, 1].map(|axis| position[axis] - velocity[axis] * back - self.shift[axis]);
        let swell =
            (1.0 + parallax) * (1.0 + config.distortion_per_m2 * (p[0] * p[0] + p[1] * p[1]));
        let x = p[0] * (1.0 + config.x_scale_error) * swell;
        let y = p[1] * (1.0 + config.y_scale_error) * swell;
        let (sin, cos) = config.rotation_rad.sin_cos();
        let seen = [cos * x - sin * y + config.x_offset_m, sin * x + cos * y + config.y_offset_m];
        Some([0, 1].map(|axis| {
            let exact = seen[axis] + noise[axis] + if outlier { stray[axis] } else { 0.0 };
            match config.quantisation_m {
                0.0 => exact,
                step => (exact / step).round() * step,
            }
        }))
    }
}

/// Standard normal random number: the sum of twelve uniform ones minus six. It needs no logarithm,
/// so it is the same on every machine; it never exceeds 6.
fn normal(stream: &mut Stream) -> f64 {
    (0..12).map(|_| f64::from(stream.uniform_f32(0.0, 1.0))).sum::<f64>() - 6.0
}

fn write_datagram(stamp: u64, seen: [Option<[f64; 2]>; 3]) -> Vec<u8> {
    let mut text = Vec::with_capacity(160);
    // Writing into a vector cannot fail.
    let _ = write!(text, "{{\"capture_time_ns\":{stamp}");
    for (name, place) in ["ball", "left", "right"].into_iter().zip(seen) {
        let _ = match place {
            Some([x, y]) => write!(text, ",\"{name}\":{{\"x\":{x:.7},\"y\":{y:.7}}}"),
            None => write!(text, ",\"{name}\":null"),
        };
    }
    text.push(b'}');
    text
}
