//! The extension module `klasktron._klasktron`: functions of the crate for Python and NumPy.
//!
//! The documentation for users is in `klasktron/__init__.py` and in the stub file `_klasktron.pyi`. As in the crate,
//! quantities are in SI units, with the unit in the name at every boundary. Calls that take long release the global
//! interpreter lock.

mod actuator;
mod arrays;
mod ekf;
mod error;
mod game;
mod gap;
mod recording;
mod referee;
mod twin;

/// Rust part of the Python package `klasktron`.
#[pyo3::pymodule]
mod _klasktron {
    #[pymodule_export]
    use crate::actuator::ActuatorNet;
    #[pymodule_export]
    use crate::ekf::Ekf;
    #[pymodule_export]
    use crate::error::KlasktronError;
    #[pymodule_export]
    use crate::game::{GameBatch, Policy};
    #[pymodule_export]
    use crate::gap::search;
    #[pymodule_export]
    use crate::recording::read_columns;
    #[pymodule_export]
    use crate::referee::score_matches;
    #[pymodule_export]
    use crate::twin::Twin;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", klasktron::provenance::CRATE_VERSION)?;
        module.add("GIT_HASH", klasktron::provenance::GIT_HASH)
    }
}
