//! State estimator: velocities from positions.

pub(super) mod lag;
pub(super) mod velocity_deadzone;
