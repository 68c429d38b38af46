//! placeholder
pub mod stats;
pub mod units;

pub mod nn;
pub mod recording;
