//! Tables as comma-separated text (RFC 4180 but for line ends, which are a single newline).

use super::{Column, Values};
use std::io::Write;

/// Write a header line and `rows` rows. Null is an empty field; numbers are the shortest text that reads back equal.
///
/// # Errors
/// When `to` cannot be written.
pub(super) fn write_csv(columns: &[Column], rows: usize, to: impl Write) -> Result<(), String> {
    let mut writer = csv::Writer::from_writer(to);
    let mut written = || {
        writer.write_record(columns.iter().map(|column| &column.name))?;
        for row in 0..rows {
            writer.write_record(columns.iter().map(|column| text(&column.values, row)))?;
        }
        writer.flush()?;
        Ok(())
    };
    written().map_err(|error: csv::Error| error.to_string())
}

fn text(values: &Values, row: usize) -> String {
    fn some<T>(value: Option<&T>, show: impl Fn(&T) -> String) -> String {
        value.map_or_else(String::new, show)
    }
    match values {
        Values::F64(values) => some(values[row].as_ref(), |value| format!("{value:?}")),
        Values::F32(values) => some(values[row].as_ref(), |value| format!("{value:?}")),
        Values::Int(values) => some(values[row].as_ref(), i64::to_string),
        Values::Unsigned(values) => some(values[row].as_ref(), u64::to_string),
        Values::Bool(values) => some(values[row].as_ref(), bool::to_string),
        Values::Text(values) => some(values[row].as_ref(), String::clone),
    }
}
