//! The rig through its protocol bytes, and its parts against conservation laws.

mod ball;
mod configuration;
mod every_number;
mod faults;
mod link;
mod motion;
mod protocol;
mod seen;
mod speed;
mod support;
