//! Guides, bridge and frame.

pub(super) mod belt_asymmetry;
pub(super) mod cross_coupling;
pub(super) mod endstop;
pub(super) mod gravity;
pub(super) mod inertia;
pub(super) mod mass_position;
pub(super) mod racking;
pub(super) mod squareness;
pub(super) mod stiffness;
pub(super) mod tilt;
