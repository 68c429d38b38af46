//! Command, motor and belt.

pub(super) mod asymmetric;
pub(super) mod backlash;
pub(super) mod compliance_belt;
pub(super) mod coulomb;
pub(super) mod current_loop;
pub(super) mod delay;
pub(super) mod gain;
pub(super) mod input_deadband;
pub(super) mod lag1;
pub(super) mod load;
pub(super) mod offset;
pub(super) mod position;
pub(super) mod presliding;
pub(super) mod quadratic;
pub(super) mod ripple_belt_tooth;
pub(super) mod ripple_motor;
pub(super) mod ripple_pulley;
pub(super) mod scan;
pub(super) mod slew;
pub(super) mod speed;
pub(super) mod stribeck;
pub(super) mod supply_sag;
pub(super) mod thermal_drift;
pub(super) mod torque_speed;
pub(super) mod velocity_loop;
pub(super) mod viscous;
