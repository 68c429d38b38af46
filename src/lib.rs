//! placeholder
pub mod units;

pub mod board;
pub mod nn;
pub mod recording;

pub mod can;
pub mod gantry;
