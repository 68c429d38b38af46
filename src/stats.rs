//! Statistics: summaries of samples, bootstrap intervals over whole runs, permutation tests. All
//! functions are pure.
//!
//! ```
//! use klasktron::stats::{median, quantile};
//! assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
//! assert_eq!(quantile(&[0.0, 10.0], 0.25), Some(2.5));
//! ```

mod bootstrap;
mod distribution;
mod permutation;
mod proportion;
mod summary;

pub use bootstrap::{Interval, bootstrap_ci95, bootstrap_difference_ci95, ratio_ci95};
pub use distribution::{
    chi_square_quantile, f_tail, incomplete_beta, ln_gamma, normal_cdf, normal_density, t_quantile,
};
pub use permutation::{holm, permutation_p};
pub use proportion::wilson_ci95;
pub use summary::{half_central_spread, mean, median, quantile, standard_deviation};
