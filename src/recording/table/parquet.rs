//! Tables as Apache Parquet: one row group per 2^18 rows, zstd pages, the Arrow schema in the footer.
//!
//! Polars' own Arrow arrays and Parquet writer are used without its data frame, whose build would take longer than
//! that of this crate.

use super::{Column, Values};
use arrow::{
    array::{Array, BooleanArray, PrimitiveArray, Utf8ViewArray},
    datatypes::{ArrowSchema, Field},
    record_batch::RecordBatchT,
};
use polars_parquet::write::{
    CompressionOptions, FileWriter, RowGroupIterator, StatisticsOptions, Version, WriteOptions,
    get_dtype_encoding,
};
use std::{io::Write, ops::Range};

/// Rows of a row group, as Polars writes them. A larger value needs more memory in readers.
const ROW_GROUP_ROWS: usize = 1 << 18;

/// Parquet settings: zstd at its default level, minimum, maximum and null count of each column chunk.
const OPTIONS: WriteOptions = WriteOptions {
    statistics: StatisticsOptions {
        min_value: true,
        max_value: true,
        distinct_count: false,
        null_count: true,
        binary_statistics_truncate_length: None,
    },
    version: Version::V1,
    compression: CompressionOptions::Zstd(None),
    data_page_size: None,
};

/// Write `columns` of `rows` rows each.
///
/// # Errors
/// When `to` cannot be written.
pub(super) fn write_parquet(columns: &[Column], rows: usize, to: impl Write) -> Result<(), String> {
    let mut schema = ArrowSchema::with_capacity(columns.len());
    for column in columns {
        let name = column.name.as_str();
        let dtype = array(&column.values, 0..0).dtype().clone();
        schema.insert(name.into(), Field::new(name.into(), dtype, true));
    }
    let encodings = schema.iter_values().map(|field| get_dtype_encoding(&field.dtype)).collect();
    let batches = (0..rows).step_by(ROW_GROUP_ROWS).map(|first| {
        let range = first..rows.min(first + ROW_GROUP_ROWS);
        let arrays = columns.iter().map(|column| array(&column.values, range.clone())).collect();
        RecordBatchT::try_new(range.len(), schema.clone().into(), arrays)
    });
    let written = || {
        let mut writer = FileWriter::try_new(to, schema.clone(), OPTIONS)?;
        let sizes = (0..rows).step_by(ROW_GROUP_ROWS).map(|first| ROW_GROUP_ROWS.min(rows - first));
        let groups = RowGroupIterator::try_new(batches, &schema, OPTIONS, encodings)?;
        for (group, size) in groups.zip(sizes) {
            writer.write(size as u64, group?)?;
        }
        writer.end(None)
    };
    written().map(drop).map_err(|error: polars_error::PolarsError| error.to_string())
}

/// `rows` of a column as an Arrow array.
fn array(values: &Values, rows: Range<usize>) -> Box<dyn Array> {
    match values {
        Values::F64(values) => PrimitiveArray::from(values[rows].to_vec()).boxed(),
        Values::F32(values) => PrimitiveArray::from(values[rows].to_vec()).boxed(),
        Values::Int(values) => PrimitiveArray::from(values[rows].to_vec()).boxed(),
        Values::Unsigned(values) => PrimitiveArray::from(values[rows].to_vec()).boxed(),
        Values::Bool(values) => BooleanArray::from(values[rows].to_vec()).boxed(),
        Values::Text(values) => Utf8ViewArray::from_slice(&values[rows]).boxed(),
    }
}
