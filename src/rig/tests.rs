//! The rig through its protocol bytes.

mod motion;
mod protocol;
mod speed;
mod support;
