//! Rails, beam and frame.

pub(super) mod inertia;
