//! Numerical core of the search, independent of any machine: least squares with confidence intervals.

pub(super) mod levenberg_marquardt;
pub(super) mod normal;
pub(super) mod sandwich;

#[cfg(test)]
mod nist;
