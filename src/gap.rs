//! Find where the simulation and the measured data disagree, and name what is missing.

pub mod checks;
pub mod find;
pub mod findings;
pub mod fit;
pub mod floor;
pub mod locate;
pub mod page;
pub mod problem;
pub mod rounds;
pub mod screen;
pub mod tape;
pub mod unknown;
pub mod whiten;
