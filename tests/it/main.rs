//! The integration tests: the built program on files, as a person would run it.

mod foreign;
mod import;
