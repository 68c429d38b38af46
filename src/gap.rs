//! Find where the simulation and the measured data disagree, and name what is missing.

pub mod fit;
pub mod problem;
pub mod rounds;
pub mod screen;
pub mod whiten;
