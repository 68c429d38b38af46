//! `gap` and `calibrate`.

use crate::{
    arrays::from_json,
    error::{raised, refused},
    twin::{Twin, opened},
};
use klasktron::{
    gap::{self, Context, FixedParameter, SearchObserver, SearchOptions, Task},
    twin::{self, Mask, SessionOptions},
};
use pyo3::{prelude::*, types::PyDict};
use std::path::PathBuf;

/// Options of a search, as on the command line.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    only: Vec<String>,
    exclude: Vec<String>,
    fix: Vec<String>,
    alpha: f64,
    mask: Vec<String>,
    validation: Vec<String>,
}

/// Observer that shows nothing.
struct Silent;

impl SearchObserver for Silent {}

/// Task, recordings, initial twin and options: the document, the twin, and warnings.
#[pyfunction]
pub(crate) fn search<'py>(
    py: Python<'py>,
    task: &str,
    recordings: Vec<PathBuf>,
    start: Option<PyRef<'py, Twin>>,
    options: Options,
) -> PyResult<Bound<'py, PyDict>> {
    let task = if task == "gap" { Task::CloseGap } else { Task::Calibrate };
    let start = start.map(|own| own.inner.clone());
    let (document, twin, losses) = py.detach(|| searched(task, &recordings, start, &options))?;
    let parts = PyDict::new(py);
    parts.set_item("document", from_json(py, &document)?)?;
    parts.set_item("twin", twin.map(|inner| Twin { inner }))?;
    parts.set_item("warnings", losses)?;
    Ok(parts)
}

type Found = (String, Option<twin::Twin>, Vec<String>);

fn searched(
    task: Task,
    recordings: &[PathBuf],
    start: Option<twin::Twin>,
    options: &Options,
) -> PyResult<Found> {
    let recordings = opened(recordings)?;
    let is_lossy = recordings.iter().filter(|own| !own.loss.is_none());
    let losses = is_lossy.map(|own| own.loss.sentence(&own.path)).collect();
    let parsed: Result<Vec<Mask>, _> = options.mask.iter().map(|text| text.parse()).collect();
    let masks = parsed.map_err(refused)?;
    let of_sessions = SessionOptions { validation: options.validation.clone(), masks };
    let sessions = twin::sessions_with(&recordings, &of_sessions).map_err(raised)?;
    twin::check_machine(&sessions, start.as_ref()).map_err(raised)?;
    let parsed: Result<Vec<FixedParameter>, _> =
        options.fix.iter().map(|text| text.parse()).collect();
    let fixed = parsed.map_err(raised)?;
    let search = SearchOptions::default()
        .select(&options.only, &options.exclude)
        .and_then(|own| own.fix(&fixed, twin::machine_of(&sessions)))
        .map_err(raised)?
        .with_family_error(options.alpha);
    let context = Context { options: &search, observer: &Silent };
    let found = gap::find(&sessions, start.as_ref(), task, context);
    let document = serde_json::to_string(&found.document).map_err(raised)?;
    let twin = found.has_twin().then_some(found.twin);
    Ok((document, twin, losses))
}
