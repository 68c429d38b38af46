//! Configuration of the camera.

use super::ranged::ranged;
use serde::{Deserialize, Serialize};

ranged! {
    /// The camera above the board, with its detection. Rate and quantization are those of the
    /// KlaskTron stack; latency and noise are not published and are estimates.
    CameraConfig {
        /// Frame rate (Hz).
        rate_hz: 120.0 in [1.0, 2000.0];
        /// Latency from capture to the arrival of the datagram (s).
        latency_s: 0.025 in [0.0, 1.0];
        /// Maximum additional latency, uniformly distributed (s).
        latency_jitter_s: 0.002 in [0.0, 1.0];
        /// Exposure time (s); it ends at capture, and objects appear at its middle.
        exposure_s: 0.0 in [0.0, 0.1];
        /// Standard deviation of the noise of each coordinate (m).
        noise_m: 0.0003 in [0.0, 0.1];
        /// Quantization step of each coordinate (m); whole pixels of 0.8 mm upstream; 0 for none.
        quantisation_m: 0.0 in [0.0, 0.1];
        /// Fraction of frames that are lost.
        drop_fraction: 0.0 in [0.0, 1.0];
        /// Fraction of frames that arrive twice.
        repeat_fraction: 0.0 in [0.0, 1.0];
        /// Fraction of missed detections.
        miss_fraction: 0.0 in [0.0, 1.0];
        /// Fraction of outliers among detections.
        outlier_fraction: 0.0 in [0.0, 1.0];
        /// Maximum error of an outlier, per coordinate (m).
        outlier_m: 0.05 in [0.0, 1.0];
        /// Scale error in x, relative to 1.
        x_scale_error: 0.0 in [-0.2, 0.2];
        /// Scale error in y, relative to 1.
        y_scale_error: 0.0 in [-0.2, 0.2];
        /// Rotation of the image (rad).
        rotation_rad: 0.0 in [-0.5, 0.5];
        /// Offset of the image, across (m).
        x_offset_m: 0.0 in [-0.1, 0.1];
        /// Offset of the image, from goal to goal (m).
        y_offset_m: 0.0 in [-0.1, 0.1];
        /// Radial distortion `k` in `p (1 + k |p|^2)` (1/m^2).
        distortion_per_m2: 0.0 in [-10.0, 10.0];
        /// Additional scale of the ball, from its height above the plane of calibration.
        ball_parallax: 0.0 in [-0.2, 0.2];
        /// Additional scale of the strikers.
        peg_parallax: 0.0 in [-0.2, 0.2];
        /// Offset of every timestamp (s).
        stamp_offset_s: 0.0 in [-10.0, 10.0];
        /// Rate error of the camera's clock relative to the host's.
        stamp_skew: 0.0 in [-0.01, 0.01];
        /// Standard deviation of the random error of every timestamp (s).
        stamp_jitter_s: 0.0 in [0.0, 0.1];
    }
    other {
        /// Timestamp in the datagram.
        stamp: StampMode = StampMode::Capture;
    }
}

/// Timestamp in a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StampMode {
    /// Capture time.
    Capture,
    /// Arrival time, as upstream.
    Arrival,
}
