//! Command, motor and belt.

pub(super) mod coulomb;
pub(super) mod delay;
pub(super) mod gain;
pub(super) mod slew;
pub(super) mod velocity_loop;
pub(super) mod viscous;
