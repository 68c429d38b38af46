//! The free ball.

pub(super) mod air_drag;
pub(super) mod board_curvature;
pub(super) mod magnet_drag;
pub(super) mod rolling_resistance;
pub(super) mod sliding_phase;
pub(super) mod stiction_patch;
pub(super) mod tilt;
