//! NumPy arrays in and out: one exception that reports both shape and dtype.

use crate::error::refused;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, ndarray::Array2};
use pyo3::{prelude::*, types::PyDict};

/// Length of one dimension of an expected shape.
#[derive(Clone, Copy)]
pub(crate) enum Length {
    /// Exactly this.
    Exactly(usize),
    /// Any; the letter is shown in messages.
    Any(&'static str),
}

/// `value` as a C-contiguous array of doubles with `shape`; integers and single precision are converted.
pub(crate) fn floats<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    shape: &[Length],
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = checked(value, name, shape, "float64")?;
    Ok(array.cast_into::<PyArrayDyn<f64>>()?.readonly())
}

/// The same in single precision.
pub(crate) fn singles<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    shape: &[Length],
) -> PyResult<PyReadonlyArrayDyn<'py, f32>> {
    let array = checked(value, name, shape, "float32")?;
    Ok(array.cast_into::<PyArrayDyn<f32>>()?.readonly())
}

fn checked<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    expected: &[Length],
    dtype: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let py = value.py();
    let array = py.import("numpy")?.call_method1("asarray", (value,))?;
    let found: Vec<usize> = array.getattr("shape")?.extract()?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let fits = found.len() == expected.len()
        && found.iter().zip(expected).all(|(found, expected)| match expected {
            Length::Exactly(length) => found == length,
            Length::Any(_) => true,
        });
    if !fits || !["f", "i", "u"].contains(&kind.as_str()) {
        let found: Vec<String> = found.iter().map(ToString::to_string).collect();
        let wanted: Vec<String> = expected
            .iter()
            .map(|length| match length {
                Length::Exactly(length) => length.to_string(),
                Length::Any(letter) => (*letter).to_owned(),
            })
            .collect();
        return Err(refused(format!(
            "{name} has shape {} and dtype {}; expected are shape {} and dtype {dtype} (other real numbers are converted)",
            tuple(&found),
            array.getattr("dtype")?,
            tuple(&wanted),
        )));
    }
    let options = PyDict::new(py);
    options.set_item("order", "C")?;
    options.set_item("copy", false)?;
    array.call_method("astype", (dtype,), Some(&options))
}

fn tuple(parts: &[String]) -> String {
    match parts {
        [one] => format!("({one},)"),
        _ => format!("({})", parts.join(", ")),
    }
}

/// One-dimensional array that takes over `values`.
pub(crate) fn vector<T: numpy::Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    PyArray1::from_vec(py, values)
}

/// Array `[values][N]`.
pub(crate) fn rows<'py, const N: usize, T: numpy::Element + Copy>(
    py: Python<'py>,
    values: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let array = Array2::from_shape_vec((values.len(), N), values.as_flattened().to_vec());
    Ok(PyArray2::from_owned_array(py, array.map_err(crate::error::raised)?))
}

/// A contiguous array as `[[f64; N]]`.
pub(crate) fn pairs<const N: usize>(
    array: &PyReadonlyArrayDyn<'_, f64>,
) -> PyResult<Vec<[f64; N]>> {
    let (rows, _) = array.as_slice()?.as_chunks::<N>();
    Ok(rows.to_vec())
}

/// The Python object in the JSON text `text`.
pub(crate) fn from_json<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}
