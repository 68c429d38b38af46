//! The state estimator.

use crate::{
    arrays::{Length, floats, from_json, vector},
    error::{raised, refused},
};
use klasktron::{
    ekf::{BoardFilter, Detections, FilterSettings, Object, Observed, Step, read_settings},
    units::Nanos,
};
use numpy::{PyArray, PyArray1, ndarray::Array};
use pyo3::{prelude::*, types::PyDict};
use std::path::PathBuf;

/// Extended Kalman filter of ball and strikers behind a camera.
#[pyclass(module = "klasktron")]
pub(crate) struct Ekf {
    settings: FilterSettings,
    filter: BoardFilter,
}

/// Estimates after each of `n` frames; NaN without one.
struct Estimates {
    means: Vec<f64>,
    covariances: Vec<f64>,
    nis: Vec<f64>,
    accepted: Vec<bool>,
}

#[pymethods]
impl Ekf {
    /// Filter with the settings of an `ekf.json`, or with the built-in ones.
    #[new]
    #[pyo3(signature = (settings=None))]
    fn new(settings: Option<PathBuf>) -> PyResult<Self> {
        let settings = match settings {
            Some(path) => read_settings(&path).map_err(raised)?,
            None => FilterSettings::default(),
        };
        Ok(Self { filter: BoardFilter::new(&settings), settings })
    }

    /// Settings as plain Python objects, the object `filter` of `ekf.json`.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &serde_json::to_string(&self.settings).map_err(raised)?)
    }

    /// Forget all tracks.
    fn reset(&mut self) {
        self.filter = BoardFilter::new(&self.settings);
    }

    /// Process one frame; see the stub file.
    #[pyo3(signature = (time_s, detections))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        time_s: f64,
        detections: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let array = floats(detections, "detections", &[Length::Exactly(3), Length::Exactly(2)])?;
        let mut found = Estimates::new(1);
        self.observe(time_of(time_s, 0)?, array.as_slice()?, &mut found);
        found.into_dict(py, 0)
    }

    /// Process many frames; see the stub file.
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        times_s: &Bound<'py, PyAny>,
        detections: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let times = floats(times_s, "times_s", &[Length::Any("n")])?;
        let times = times.as_slice()?;
        let shape = [Length::Exactly(times.len()), Length::Exactly(3), Length::Exactly(2)];
        let array = floats(detections, "detections", &shape)?;
        let positions = array.as_slice()?;
        let stamps: Vec<Nanos> = times
            .iter()
            .enumerate()
            .map(|(index, time)| time_of(*time, index))
            .collect::<PyResult<_>>()?;
        let mut found = Estimates::new(times.len());
        py.detach(|| {
            for (time, own) in stamps.iter().zip(positions.chunks_exact(6)) {
                self.observe(*time, own, &mut found);
            }
        });
        found.into_dict(py, times.len())
    }

    /// State of `object` at `time_s`, predicted from the last frame before it; `None` without a track.
    fn estimate_at<'py>(
        &self,
        py: Python<'py>,
        object: &str,
        time_s: f64,
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let known = || Object::ALL.map(Object::name).join(", ");
        let object = Object::ALL
            .into_iter()
            .find(|own| own.name() == object)
            .ok_or_else(|| refused(format!("object is '{object}'; known are {}", known())))?;
        let estimate = self.filter.estimate_at(object, time_of(time_s, 0)?);
        Ok(estimate.map(|own| vector(py, own.mean.to_vec())))
    }
}

impl Ekf {
    fn observe(&mut self, time: Nanos, positions: &[f64], found: &mut Estimates) {
        let (pairs, _) = positions.as_chunks::<2>();
        let of = |index: usize| {
            pairs.get(index).copied().filter(|own: &[f64; 2]| own.iter().all(|x| x.is_finite()))
        };
        let observed = self.filter.observe(&Detections::new(time, [of(0), of(1), of(2)]));
        let steps: Option<[Step; 3]> = match observed {
            Observed::Taken(steps) => Some(steps),
            Observed::Repeated | Observed::TooLate => None,
        };
        for object in Object::ALL {
            let innovation = steps.as_ref().and_then(|steps| steps[object.index()].innovation);
            found.nis.push(innovation.map_or(f64::NAN, |own| own.nis));
            let is_accepted = innovation
                .is_some_and(|own| own.gate == klasktron::ekf::Gate::Accepted)
                || steps.as_ref().is_some_and(|steps| steps[object.index()].started);
            found.accepted.push(is_accepted);
            match self.filter.estimate_at(object, time) {
                Some(own) => {
                    found.means.extend(own.mean);
                    found.covariances.extend(own.covariance.as_flattened());
                }
                None => {
                    found.means.extend([f64::NAN; 4]);
                    found.covariances.extend([f64::NAN; 16]);
                }
            }
        }
    }
}

impl Estimates {
    fn new(count: usize) -> Self {
        Self {
            means: Vec::with_capacity(12 * count),
            covariances: Vec::with_capacity(48 * count),
            nis: Vec::with_capacity(3 * count),
            accepted: Vec::with_capacity(3 * count),
        }
    }

    /// Arrays with the frames as first dimension; without it for a single frame (`count` 0).
    fn into_dict(self, py: Python<'_>, count: usize) -> PyResult<Bound<'_, PyDict>> {
        let shaped = |values: Vec<f64>, inner: &[usize]| {
            let mut shape = inner.to_vec();
            if 0 < count || values.is_empty() {
                shape.insert(0, count);
            }
            Array::from_shape_vec(shape, values).map_err(raised)
        };
        let result = PyDict::new(py);
        result.set_item("mean", PyArray::from_owned_array(py, shaped(self.means, &[3, 4])?))?;
        let covariance = shaped(self.covariances, &[3, 4, 4])?;
        result.set_item("covariance", PyArray::from_owned_array(py, covariance))?;
        result.set_item("nis", PyArray::from_owned_array(py, shaped(self.nis, &[3])?))?;
        let mut shape = vec![3];
        if 0 < count || self.accepted.is_empty() {
            shape.insert(0, count);
        }
        let accepted = Array::from_shape_vec(shape, self.accepted).map_err(raised)?;
        result.set_item("accepted", PyArray::from_owned_array(py, accepted))?;
        Ok(result)
    }
}

/// The stamp of a time (s); `index` is its place in messages.
fn time_of(seconds: f64, index: usize) -> PyResult<Nanos> {
    if (0.0..1e10).contains(&seconds) {
        return Ok(Nanos(0).after_seconds(seconds));
    }
    Err(refused(format!("time {index} is {seconds} s; allowed are 0 to 1e10 s")))
}
