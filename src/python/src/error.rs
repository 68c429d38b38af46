//! The one exception of the module.

use pyo3::{PyErr, create_exception, exceptions::PyValueError};
use std::error::Error;

create_exception!(
    klasktron,
    KlasktronError,
    PyValueError,
    "Error of klasktron: one sentence that says what happened, where, the value, the allowed range and the way out."
);

/// Python exception with the sentence of `error` and of its causes, each once.
pub(crate) fn raised(error: impl Error) -> PyErr {
    let mut line = error.to_string();
    let mut cause = error.source();
    while let Some(own) = cause {
        let reason = own.to_string();
        if !line.contains(&reason) {
            line = format!("{line}: {reason}");
        }
        cause = own.source();
    }
    KlasktronError::new_err(line)
}

/// Python exception with `sentence`.
pub(crate) fn refused(sentence: String) -> PyErr {
    KlasktronError::new_err(sentence)
}
