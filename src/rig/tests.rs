//! The rig through its protocol bytes.

mod motion;
mod support;
