//! Writer of table files: to a temporary name, renamed when complete.

use super::{Column, Table, Values, csv::write_csv, parquet::write_parquet};
use crate::recording::{ExistingFile, RecordingError, write_atomically};
use ndarray::{Array1, Array2};
use ndarray_npy::NpzWriter;
use std::{collections::BTreeSet, fs::File, path::Path};

/// Format of a table file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Apache Parquet, zstd pages.
    Parquet,
    /// Comma-separated text with a header line; null is empty.
    Csv,
    /// NumPy arrays by column name. Null is NaN, in integer columns too, which then are floats;
    /// text is an array of bytes, one row each, padded with zeros.
    Npz,
}

impl Table {
    /// Return `log_time_ns`, `publish_time_ns`, then the fields.
    fn all_columns(&self) -> Vec<Column> {
        let times =
            [("log_time_ns", &self.log_time_ns), ("publish_time_ns", &self.publish_time_ns)];
        let times = times.map(|(name, times)| Column {
            name: name.to_owned(),
            values: Values::Unsigned(times.iter().copied().map(Some).collect()),
        });
        times.into_iter().chain(self.columns.iter().cloned()).collect()
    }
}

/// Format of a file with columns of no topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnFormat {
    /// Apache Parquet, zstd pages.
    Parquet,
    /// Comma-separated text with a header line; null is empty.
    Csv,
}

/// Write `columns` of `rows` rows each, which belong to no topic, to `path`.
///
/// # Errors
/// When two columns have one name or another number of rows, the file exists and `existing`
/// refuses, or writing to disk fails; nothing remains then.
pub fn write_columns(
    columns: &[Column],
    rows: usize,
    path: &Path,
    format: ColumnFormat,
    existing: ExistingFile,
) -> Result<(), RecordingError> {
    write_atomically(path, existing, |file| {
        let written = check(columns, rows).and_then(|()| match format {
            ColumnFormat::Parquet => write_parquet(columns, rows, file),
            ColumnFormat::Csv => write_csv(columns, rows, file),
        });
        written.map_err(|reason| RecordingError::Table { path: path.to_owned(), reason })
    })
}

/// Check that every column has its own name and `rows` rows.
fn check(columns: &[Column], rows: usize) -> Result<(), String> {
    let mut names = BTreeSet::new();
    for column in columns {
        let (name, found) = (column.name.as_str(), column.values.len());
        if found != rows {
            return Err(format!("column '{name}' has {found} rows, the table has {rows}"));
        }
        if !names.insert(name) {
            return Err(format!("two columns are called '{name}'"));
        }
    }
    Ok(())
}

/// Write `table` to `path`.
///
/// # Errors
/// When the file exists and `existing` refuses, or writing to disk fails; nothing remains then.
pub fn write_table(
    table: &Table,
    path: &Path,
    format: TableFormat,
    existing: ExistingFile,
) -> Result<(), RecordingError> {
    let format = match format {
        TableFormat::Parquet => ColumnFormat::Parquet,
        TableFormat::Csv => ColumnFormat::Csv,
        TableFormat::Npz => {
            return write_atomically(path, existing, |file| {
                write_npz(table, file)
                    .map_err(|reason| RecordingError::Table { path: path.to_owned(), reason })
            });
        }
    };
    write_columns(&table.all_columns(), table.log_time_ns.len(), path, format, existing)
}

fn write_npz(table: &Table, file: File) -> Result<(), String> {
    let mut npz = NpzWriter::new(file);
    let times = [("log_time_ns", &table.log_time_ns), ("publish_time_ns", &table.publish_time_ns)];
    for (name, values) in times {
        npz.add_array(name, &Array1::from(values.clone())).map_err(|error| error.to_string())?;
    }
    for column in &table.columns {
        add_npy(&mut npz, column).map_err(|error| error.to_string())?;
    }
    npz.finish().map(drop).map_err(|error| error.to_string())
}

fn add_npy(npz: &mut NpzWriter<File>, column: &Column) -> Result<(), ndarray_npy::WriteNpzError> {
    fn whole<T: Copy>(values: &[Option<T>]) -> Option<Array1<T>> {
        values.iter().copied().collect::<Option<Vec<T>>>().map(Array1::from)
    }
    let name = column.name.as_str();
    let with_nan = || Array1::from(column.numbers().unwrap_or_default());
    match &column.values {
        Values::F64(_) => npz.add_array(name, &with_nan()),
        Values::F32(values) => {
            let single = values.iter().map(|value| value.unwrap_or(f32::NAN));
            npz.add_array(name, &single.collect::<Array1<f32>>())
        }
        Values::Int(values) => match whole(values) {
            Some(array) => npz.add_array(name, &array),
            None => npz.add_array(name, &with_nan()),
        },
        Values::Unsigned(values) => match whole(values) {
            Some(array) => npz.add_array(name, &array),
            None => npz.add_array(name, &with_nan()),
        },
        Values::Bool(values) => match whole(values) {
            Some(array) => npz.add_array(name, &array),
            None => npz.add_array(name, &with_nan()),
        },
        Values::Text(values) => npz.add_array(name, &padded(values)),
    }
}

/// Return UTF-8 bytes, one row per text, padded with zeros: `array.view(f"S{array.shape[1]}")` in
/// NumPy.
fn padded(values: &[Option<String>]) -> Array2<u8> {
    let text = |row: usize| values[row].as_deref().unwrap_or_default().as_bytes();
    let width = (0..values.len()).map(|row| text(row).len()).max().unwrap_or(0).max(1);
    Array2::from_shape_fn((values.len(), width), |(row, at)| {
        text(row).get(at).copied().unwrap_or(0)
    })
}
