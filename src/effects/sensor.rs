//! Camera and encoders.

pub(super) mod camera_latency;
pub(super) mod camera_scale_rotation;
