//! `gap` and `calibrate`.

use crate::{
    arrays::from_json,
    error::{raised, refused},
    twin::{Twin, opened},
};
use klasktron::{
    gap::{self, Context, FixedParameter, SearchObserver, SearchOptions, SearchStep, Task},
    twin::{self, Mask, SessionOptions, StageKind},
};
use pyo3::{prelude::*, types::PyDict};
use std::{
    panic::{self, AssertUnwindSafe},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

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

/// Interval at which signals of the interpreter are checked during a search.
const PATIENCE: Duration = Duration::from_millis(50);

/// Observer that ends a search after Ctrl-C. It unwinds the thread of the search, without a message.
struct Watch(Arc<AtomicBool>);

impl Watch {
    fn check(&self) {
        if self.0.load(Ordering::Relaxed) {
            panic::resume_unwind(Box::new("interrupted"));
        }
    }
}

impl SearchObserver for Watch {
    fn stage_begun(&self, _kind: StageKind, _done: usize, _count: usize) {
        self.check();
    }

    fn step_begun(&self, _step: SearchStep, _candidates: usize) {
        self.check();
    }

    fn candidate_done(&self) {
        self.check();
    }
}

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
    let found = interruptible(py, move |watch| searched(task, &recordings, start, &options, watch));
    let (document, twin, losses) = found?;
    let parts = PyDict::new(py);
    parts.set_item("document", from_json(py, &document)?)?;
    parts.set_item("twin", twin.map(|inner| Twin { inner }))?;
    parts.set_item("warnings", losses)?;
    Ok(parts)
}

/// Run `work` in a thread of its own, and raise KeyboardInterrupt as soon as Ctrl-C is pressed. The thread then ends at
/// its next step, without a result.
fn interruptible(
    py: Python<'_>,
    work: impl FnOnce(&Watch) -> PyResult<Found> + Send + 'static,
) -> PyResult<Found> {
    let stop = Arc::new(AtomicBool::new(false));
    let watch = Watch(Arc::clone(&stop));
    let (sender, mut results) = mpsc::channel();
    thread::spawn(move || {
        let result = panic::catch_unwind(AssertUnwindSafe(|| work(&watch)));
        // Nobody waits after an interruption.
        sender.send(result).ok();
    });
    loop {
        if let Err(interrupted) = py.check_signals() {
            stop.store(true, Ordering::Relaxed);
            return Err(interrupted);
        }
        let (own, result) = py.detach(move || {
            let result = results.recv_timeout(PATIENCE);
            (results, result)
        });
        results = own;
        match result {
            Ok(Ok(found)) => return found,
            Ok(Err(panic)) => panic::resume_unwind(panic),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(refused("the search ended without a result".to_owned()));
            }
        }
    }
}

type Found = (String, Option<twin::Twin>, Vec<String>);

fn searched(
    task: Task,
    recordings: &[PathBuf],
    start: Option<twin::Twin>,
    options: &Options,
    watch: &Watch,
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
    let machine = twin::Twin::nominal_of(&sessions).framed(&sessions);
    let search = SearchOptions::default()
        .select(&options.only, &options.exclude)
        .and_then(|own| own.fix(&fixed, &machine))
        .map_err(raised)?
        .with_family_error(options.alpha);
    let context = Context { options: &search, observer: watch };
    let found = gap::find(&sessions, start.as_ref(), task, context);
    let document = serde_json::to_string(&found.document).map_err(raised)?;
    let twin = found.has_twin().then_some(found.twin);
    Ok((document, twin, losses))
}
