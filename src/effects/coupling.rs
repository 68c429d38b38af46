//! Magnetic coupling of carriage and striker through the board.

pub(super) mod magnet_slip;
pub(super) mod magnet_spring;
pub(super) mod striker;
pub(super) mod striker_friction;
pub(super) mod striker_wobble;
