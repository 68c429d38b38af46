//! Recordings as columns.

use crate::error::raised;
use klasktron::{
    import::{ImportConfig, ImportError, Table as ImportTable, import_bags},
    parallel::in_parallel,
    recording::{
        ExistingFile, MarkedRun, Recording, RecordingError, Split,
        table::{Table, Values, read_table},
    },
};
use numpy::PyArray1;
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict, PyList},
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// Columns of one topic with the names and encodings that describe them.
struct Topic {
    name: String,
    schema: String,
    table: Table,
}

/// Everything that was read.
struct Content {
    recording: Recording,
    runs: Vec<MarkedRun>,
    topics: Vec<Topic>,
    /// Topics that are no tables, as sentences.
    skipped: Vec<String>,
    /// What an import lost, as sentences.
    notices: Vec<String>,
}

/// Error of a recording or of the import of a bag.
enum ReadError {
    Recording(RecordingError),
    Import(ImportError),
    Io(std::io::Error),
}

impl From<RecordingError> for ReadError {
    fn from(error: RecordingError) -> Self {
        Self::Recording(error)
    }
}

impl From<ImportError> for ReadError {
    fn from(error: ImportError) -> Self {
        Self::Import(error)
    }
}

impl From<ReadError> for PyErr {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Recording(error) => raised(error),
            ReadError::Import(error) => raised(error),
            ReadError::Io(error) => error.into(),
        }
    }
}

/// Read a recording or a ROS 2 bag: a dictionary of its parts, for `klasktron.Recording`.
#[pyfunction]
#[pyo3(signature = (path, topics=None))]
pub(crate) fn read_columns<'py>(
    py: Python<'py>,
    path: PathBuf,
    topics: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyDict>> {
    let content = py.detach(|| content_of(&path, topics.as_deref()))?;
    let parts = PyDict::new(py);
    let tables = PyDict::new(py);
    let schemas = PyDict::new(py);
    for topic in content.topics {
        schemas.set_item(&topic.name, &topic.schema)?;
        let columns = PyDict::new(py);
        columns.set_item("log_time_ns", PyArray1::from_vec(py, topic.table.log_time_ns))?;
        columns.set_item("publish_time_ns", PyArray1::from_vec(py, topic.table.publish_time_ns))?;
        for column in topic.table.columns {
            columns.set_item(&column.name, array(py, column.values)?)?;
        }
        tables.set_item(&topic.name, columns)?;
    }
    parts.set_item("topics", tables)?;
    parts.set_item("schemas", schemas)?;
    parts.set_item("runs", runs(py, &content.runs)?)?;
    let own = &content.recording;
    parts.set_item("metadata", own.metadata.clone())?;
    parts.set_item("sha256", &own.sha256)?;
    parts.set_item("profile", &own.profile)?;
    let attachments = PyDict::new(py);
    for attachment in &own.attachments {
        attachments.set_item(&attachment.name, PyBytes::new(py, &attachment.data))?;
    }
    parts.set_item("attachments", attachments)?;
    let mut warnings = content.notices;
    if !own.loss.is_none() {
        warnings.push(own.loss.sentence(&own.path));
    }
    parts.set_item("warnings", warnings)?;
    parts.set_item("skipped", content.skipped)?;
    Ok(parts)
}

fn runs<'py>(py: Python<'py>, runs: &[MarkedRun]) -> PyResult<Bound<'py, PyList>> {
    let list = PyList::empty(py);
    for run in runs {
        let own = PyDict::new(py);
        own.set_item("number", run.number)?;
        own.set_item("pattern", &run.pattern)?;
        own.set_item("split", run.split.map(split_name))?;
        own.set_item("start_ns", run.span.start.0)?;
        own.set_item("end_ns", run.span.end.0)?;
        list.append(own)?;
    }
    Ok(list)
}

pub(crate) fn split_name(split: Split) -> &'static str {
    match split {
        Split::Train => "train",
        Split::Validation => "validation",
    }
}

fn content_of(path: &Path, only: Option<&[String]>) -> Result<Content, ReadError> {
    let mut notices = Vec::new();
    let recording = match is_bag(path) {
        true => imported(path, &mut notices)?,
        false => {
            let recording = Recording::open(path)?;
            match recording.channels.iter().any(|channel| channel.encoding == "cdr") {
                true => imported(path, &mut notices)?,
                false => recording,
            }
        }
    };
    let present: BTreeSet<&str> = recording.channels.iter().map(|own| own.topic.as_str()).collect();
    let names: Vec<&str> = match only {
        Some(only) => only.iter().map(String::as_str).collect(),
        None => present.into_iter().collect(),
    };
    let mut topics = Vec::new();
    let mut skipped = Vec::new();
    for (name, table) in names.iter().zip(in_parallel(&names, |name| table_of(&recording, name))) {
        match table {
            Ok(topic) => topics.push(topic),
            Err(
                error @ (RecordingError::NotTabular { .. } | RecordingError::MixedSchemas { .. }),
            ) if only.is_none() => {
                skipped.push(format!("{name}: {error}"));
            }
            Err(error) => return Err(error.into()),
        }
    }
    let runs = recording.marked_runs()?;
    Ok(Content { runs, topics, skipped, notices, recording })
}

fn table_of(recording: &Recording, name: &str) -> Result<Topic, RecordingError> {
    let table = read_table(recording, name)?;
    let schema = recording.channels_of(name).next().map_or(String::new(), |own| own.schema.clone());
    Ok(Topic { name: name.to_owned(), schema, table })
}

/// Whether `path` is a bag that MCAP cannot be read from directly.
fn is_bag(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    path.is_dir() || name.ends_with(".db3") || name.ends_with(".zstd")
}

/// The recording into which a ROS 2 bag of the KlaskTron stack is converted.
fn imported(path: &Path, notices: &mut Vec<String>) -> Result<Recording, ReadError> {
    let folder = tempfile::tempdir().map_err(ReadError::Io)?;
    let output = folder.path().join("bag.mcap");
    let config = ImportConfig::new(&output, ExistingFile::Refuse);
    let report = import_bags(&[path.to_owned()], &ImportTable::default(), &config)?;
    let lost = report.notices.iter().filter(|notice| notice.is_loss());
    notices.extend(lost.map(|notice| format!("{}: {notice}", path.display())));
    let mut recording = Recording::open(&output)?;
    recording.path = path.to_owned();
    Ok(recording)
}

/// A column as an array. Null is NaN, in columns of integers and booleans too, which are floats then; text is an array
/// of objects.
fn array(py: Python<'_>, values: Values) -> PyResult<Bound<'_, PyAny>> {
    Ok(match values {
        Values::F64(values) => floats(py, &values, |value| value),
        Values::F32(values) => {
            let plain: Vec<f32> = values.iter().map(|own| own.unwrap_or(f32::NAN)).collect();
            PyArray1::from_vec(py, plain).into_any()
        }
        Values::Int(values) => match whole(&values) {
            Some(values) => PyArray1::from_vec(py, values).into_any(),
            None => floats(py, &values, |value| value as f64),
        },
        Values::Unsigned(values) => match whole(&values) {
            Some(values) => PyArray1::from_vec(py, values).into_any(),
            None => floats(py, &values, |value| value as f64),
        },
        Values::Bool(values) => match whole(&values) {
            Some(values) => PyArray1::from_vec(py, values).into_any(),
            None => floats(py, &values, |value| f64::from(u8::from(value))),
        },
        Values::Text(values) => {
            let list = PyList::new(py, values)?;
            py.import("numpy")?.call_method1("array", (list, "O"))?
        }
    })
}

fn whole<T: Copy>(values: &[Option<T>]) -> Option<Vec<T>> {
    values.iter().copied().collect()
}

fn floats<'py, T: Copy>(
    py: Python<'py>,
    values: &[Option<T>],
    number: impl Fn(T) -> f64,
) -> Bound<'py, PyAny> {
    let plain: Vec<f64> = values.iter().map(|own| own.map_or(f64::NAN, &number)).collect();
    PyArray1::from_vec(py, plain).into_any()
}
