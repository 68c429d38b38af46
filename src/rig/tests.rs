//! Tests of the rig through its protocol bytes, and of its parts against conservation laws.

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
