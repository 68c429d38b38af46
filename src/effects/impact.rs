//! Impacts of the ball on the walls.

pub(super) mod wall_friction_spin;
pub(super) mod wall_location;
pub(super) mod wall_restitution;
pub(super) mod wall_restitution_speed;
