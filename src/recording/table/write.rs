//! Tables as files: written beside the final name and renamed when complete.

use super::{Column, Table, Values};
use crate::recording::{ExistingFile, RecordingError, write_beside};
use ndarray::{Array1, Array2};
use ndarray_npy::NpzWriter;
use polars::prelude::{
    Column as FrameColumn, CsvWriter, DataFrame, NamedFrom, ParquetWriter, SerWriter, Series,
};
use std::{fs::File, path::Path};

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Apache Parquet, zstd pages.
    Parquet,
    /// Comma-separated text with a header line; null is empty.
    Csv,
    /// numpy arrays by column name. Null is NaN, in integer columns too, which then are floats;
    /// text is an array of bytes, one row each, padded with zeros.
    Npz,
}

/// The table as a data frame: `log_time_ns`, `publish_time_ns`, then its columns.
///
/// # Errors
/// When two columns have one name.
pub fn data_frame(table: &Table) -> Result<DataFrame, polars::error::PolarsError> {
    let mut columns = vec![
        FrameColumn::from(Series::new("log_time_ns".into(), &table.log_time_ns)),
        FrameColumn::from(Series::new("publish_time_ns".into(), &table.publish_time_ns)),
    ];
    columns.extend(table.columns.iter().map(|column| FrameColumn::from(series(column))));
    DataFrame::new(table.log_time_ns.len(), columns)
}

/// How columns that belong to no topic are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnFormat {
    /// Apache Parquet, zstd pages.
    Parquet,
    /// Comma-separated text with a header line; null is empty.
    Csv,
}

/// Writes `columns` of `rows` rows each, which belong to no topic, to `path`.
///
/// # Errors
/// When two columns have one name or another number of rows, the name is taken and `existing`
/// refuses, or the disk does; nothing is left behind then.
pub fn write_columns(
    columns: &[Column],
    rows: usize,
    path: &Path,
    format: ColumnFormat,
    existing: ExistingFile,
) -> Result<(), RecordingError> {
    write_beside(path, existing, |file| {
        let columns = columns.iter().map(|column| FrameColumn::from(series(column))).collect();
        DataFrame::new(rows, columns)
            .and_then(|mut frame| match format {
                ColumnFormat::Parquet => ParquetWriter::new(file).finish(&mut frame).map(drop),
                ColumnFormat::Csv => CsvWriter::new(file).finish(&mut frame),
            })
            .map_err(|error| RecordingError::Table {
                path: path.to_owned(),
                reason: error.to_string(),
            })
    })
}

fn series(column: &Column) -> Series {
    let name = column.name.as_str().into();
    match &column.values {
        Values::F64(values) => Series::new(name, values),
        Values::F32(values) => Series::new(name, values),
        Values::Int(values) => Series::new(name, values),
        Values::Unsigned(values) => Series::new(name, values),
        Values::Bool(values) => Series::new(name, values),
        Values::Text(values) => Series::new(name, values),
    }
}

/// Writes `table` to `path`.
///
/// # Errors
/// When the name is taken and `existing` refuses, or the disk does; nothing is left behind then.
pub fn write_table(
    table: &Table,
    path: &Path,
    format: TableFormat,
    existing: ExistingFile,
) -> Result<(), RecordingError> {
    write_beside(path, existing, |file| {
        let written = match format {
            TableFormat::Parquet => write_parquet(table, file),
            TableFormat::Csv => write_csv(table, file),
            TableFormat::Npz => write_npz(table, file),
        };
        written.map_err(|reason| RecordingError::Table { path: path.to_owned(), reason })
    })
}

fn write_parquet(table: &Table, file: File) -> Result<(), String> {
    let mut frame = data_frame(table).map_err(|error| error.to_string())?;
    let written = ParquetWriter::new(file).finish(&mut frame);
    written.map(drop).map_err(|error| error.to_string())
}

fn write_csv(table: &Table, file: File) -> Result<(), String> {
    let mut frame = data_frame(table).map_err(|error| error.to_string())?;
    CsvWriter::new(file).finish(&mut frame).map_err(|error| error.to_string())
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

/// UTF-8 bytes, one row per text, padded with zeros: `array.view(f"S{array.shape[1]}")` in numpy.
fn padded(values: &[Option<String>]) -> Array2<u8> {
    let text = |row: usize| values[row].as_deref().unwrap_or_default().as_bytes();
    let width = (0..values.len()).map(|row| text(row).len()).max().unwrap_or(0).max(1);
    Array2::from_shape_fn((values.len(), width), |(row, at)| {
        text(row).get(at).copied().unwrap_or(0)
    })
}
