//! Configuration of the camera.

use super::ranged::ranged;
use serde::{Deserialize, Serialize};

ranged! {
    /// The camera above the board, with its detection. Rate, quantisation: the KlaskTron stack;
    /// latency and noise are not published: estimates.
    CameraConfig {
        /// Pictures per second (1/s).
        rate_hz: 120.0 in [1.0, 2000.0];
        /// From capture to the arrival of the datagram (s).
        latency_s: 0.025 in [0.0, 1.0];
        /// Largest extra latency, uniform (s).
        latency_jitter_s: 0.002 in [0.0, 1.0];
        /// Exposure: what is seen is the middle between its start and its end (s); it ends at capture.
        exposure_s: 0.0 in [0.0, 0.1];
        /// Noise of each coordinate, standard deviation (m).
        noise_m: 0.0003 in [0.0, 0.1];
        /// Step of each coordinate (m); whole pixels of 0.8 mm upstream. 0 is none.
        quantisation_m: 0.0 in [0.0, 0.1];
        /// Share of pictures that never arrive.
        drop_fraction: 0.0 in [0.0, 1.0];
        /// Share of pictures that arrive twice.
        repeat_fraction: 0.0 in [0.0, 1.0];
        /// Share of objects that are not found in a picture.
        miss_fraction: 0.0 in [0.0, 1.0];
        /// Share of objects that are found in a wrong place.
        outlier_fraction: 0.0 in [0.0, 1.0];
        /// Largest error of these, per coordinate (m).
        outlier_m: 0.05 in [0.0, 1.0];
        /// Seen per true distance in x, beyond 1.
        x_scale_error: 0.0 in [-0.2, 0.2];
        /// Seen per true distance in y, beyond 1.
        y_scale_error: 0.0 in [-0.2, 0.2];
        /// Turn of the picture (rad).
        rotation_rad: 0.0 in [-0.5, 0.5];
        /// Shift of the picture, across (m).
        x_offset_m: 0.0 in [-0.1, 0.1];
        /// Shift of the picture, from goal to goal (m).
        y_offset_m: 0.0 in [-0.1, 0.1];
        /// Radial distortion `k` in `p (1 + k |p|^2)` (1/m^2).
        distortion_per_m2: 0.0 in [-10.0, 10.0];
        /// Extra scale of the ball, from its height above the plane of calibration.
        ball_parallax: 0.0 in [-0.2, 0.2];
        /// Extra scale of the strikers.
        peg_parallax: 0.0 in [-0.2, 0.2];
        /// Added to every stamp (s).
        stamp_offset_s: 0.0 in [-10.0, 10.0];
        /// Rate of the camera's clock beyond the host's.
        stamp_skew: 0.0 in [-0.01, 0.01];
        /// Random error of every stamp, standard deviation (s).
        stamp_jitter_s: 0.0 in [0.0, 0.1];
    }
    other {
        /// Which time the datagram carries.
        stamp: StampMode = StampMode::Capture;
    }
}

/// Which time a datagram carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StampMode {
    /// When the picture was taken.
    Capture,
    /// When the datagram arrived, as upstream.
    Arrival,
}
