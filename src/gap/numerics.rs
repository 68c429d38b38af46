//! Numerical core of the search, without a word of machines: least squares, and its intervals.

pub(super) mod levenberg_marquardt;
pub(super) mod normal;
pub(super) mod sandwich;

#[cfg(test)]
mod nist;
