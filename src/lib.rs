//! placeholder
pub mod units;

pub mod nn;
pub mod recording;
