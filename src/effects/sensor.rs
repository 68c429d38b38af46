//! Camera and encoders.

pub(super) mod camera_distortion;
pub(super) mod camera_latency;
pub(super) mod camera_parallax;
pub(super) mod camera_scale_rotation;
pub(super) mod clock_skew;
pub(super) mod encoder_eccentricity;
pub(super) mod encoder_quantisation;
pub(super) mod frame_drop;
pub(super) mod frame_jitter;
pub(super) mod noise_model;
