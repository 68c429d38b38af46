//! placeholder
pub mod provenance;
pub mod report;
pub mod seed;
pub mod stats;
pub mod units;

pub mod board;
pub mod nn;
pub mod recording;

pub mod actuator;
pub mod can;
pub mod gantry;

pub mod import;
