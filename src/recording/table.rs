//! Topics as columns for other software: Parquet, CSV or npz.
//!
//! The columns come from the descriptor in the recording, so that any protobuf MCAP file can be
//! converted. They are `log_time_ns` and `publish_time_ns` first, then every field under its name in the
//! schema (`ball.x` for a field of a nested message). The units are in the schema's comments.
//! Absent optional fields are null, enumerations are numbers, bytes are hexadecimal digits. Rows
//! are in order of log time.

mod csv;
mod parquet;
mod plan;
mod wire;
mod write;

use super::{Channel, PROTOBUF, Recording, RecordingError};
use crate::units::Nanos;
use plan::Plan;
pub(in crate::recording) use plan::Selection;
use std::collections::BTreeSet;
use wire::Cell;
pub use write::{ColumnFormat, TableFormat, write_columns, write_table};

/// Values of one column; `None` is null.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Double precision.
    F64(Vec<Option<f64>>),
    /// Single precision.
    F32(Vec<Option<f32>>),
    /// Signed integers and enumerations.
    Int(Vec<Option<i64>>),
    /// Unsigned integers.
    Unsigned(Vec<Option<u64>>),
    /// Booleans.
    Bool(Vec<Option<bool>>),
    /// Text; bytes as hexadecimal digits; repeated fields as a list in brackets.
    Text(Vec<Option<String>>),
}

impl Values {
    /// Return the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::F64(values) => values.len(),
            Self::F32(values) => values.len(),
            Self::Int(values) => values.len(),
            Self::Unsigned(values) => values.len(),
            Self::Bool(values) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    /// Return whether the column has no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One column of a [`Table`].
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name of the field in the schema, with its parents: `ball.x`.
    pub name: String,
    /// Values, one per row.
    pub values: Values,
}

impl Column {
    /// Visit every number that is not null, in order; text has no numbers.
    pub fn for_each_number(&self, visit: &mut dyn FnMut(f64)) {
        match &self.values {
            Values::F64(values) => values.iter().flatten().for_each(|value| visit(*value)),
            Values::F32(values) => values.iter().flatten().for_each(|value| visit((*value).into())),
            Values::Int(values) => values.iter().flatten().for_each(|value| visit(*value as f64)),
            Values::Unsigned(values) => {
                values.iter().flatten().for_each(|value| visit(*value as f64));
            }
            Values::Bool(values) => {
                values.iter().flatten().for_each(|value| visit(f64::from(u8::from(*value))));
            }
            Values::Text(_) => {}
        }
    }

    /// Return the numbers of the column, NaN for null; `None` for text.
    #[must_use]
    pub fn numbers(&self) -> Option<Vec<f64>> {
        fn all<T: Copy>(values: &[Option<T>], number: impl Fn(T) -> f64) -> Vec<f64> {
            values.iter().map(|value| value.map_or(f64::NAN, &number)).collect()
        }
        match &self.values {
            Values::F64(values) => Some(all(values, |value| value)),
            Values::F32(values) => Some(all(values, f64::from)),
            Values::Int(values) => Some(all(values, |value| value as f64)),
            Values::Unsigned(values) => Some(all(values, |value| value as f64)),
            Values::Bool(values) => Some(all(values, |value| f64::from(u8::from(value)))),
            Values::Text(_) => None,
        }
    }
}

/// Messages of one topic as columns, in order of their log time.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Topic.
    pub topic: String,
    /// Time of reception of each message, or of sending for a command (ns).
    pub log_time_ns: Vec<u64>,
    /// Time of each message on the source's clock (ns).
    pub publish_time_ns: Vec<u64>,
    /// Columns, one per field, in the order of the schema.
    pub columns: Vec<Column>,
}

impl Table {
    /// Return the column called `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// Read the messages of `topic` as a table.
///
/// # Errors
/// When the topic is missing, its messages are not protobuf with a descriptor, it has several
/// schemas, or a message cannot be decoded.
pub fn read_table(recording: &Recording, topic: &str) -> Result<Table, RecordingError> {
    let channels: Vec<&Channel> = recording.channels_of(topic).collect();
    let Some(first) = channels.first() else {
        let topics: BTreeSet<_> = recording.channels.iter().map(|c| c.topic.clone()).collect();
        return Err(RecordingError::NoSuchTopic {
            path: recording.path.clone(),
            topic: topic.to_owned(),
            topics: topics.into_iter().collect(),
        });
    };
    if channels.iter().any(|channel| channel.schema != first.schema) {
        return Err(RecordingError::MixedSchemas {
            path: recording.path.clone(),
            topic: topic.to_owned(),
            schemas: channels.iter().map(|channel| channel.schema.clone()).collect(),
        });
    }
    read_channels(recording, &channels, Selection::Everything)
}

/// Read channels of one topic and schema, as [`read_table`] does.
pub(in crate::recording) fn read_channels(
    recording: &Recording,
    channels: &[&Channel],
    select: Selection,
) -> Result<Table, RecordingError> {
    let mut builder: Option<Builder> = None;
    for channel in channels {
        let plan = plan_of(recording, channel, select)?;
        let builder = builder.get_or_insert_with(|| Builder::new(&channel.topic, &plan));
        builder.add(recording, channel, &plan)?;
    }
    Ok(builder.map(Builder::finish).unwrap_or_else(|| Table {
        topic: String::new(),
        log_time_ns: vec![],
        publish_time_ns: vec![],
        columns: vec![],
    }))
}

fn plan_of(
    recording: &Recording,
    channel: &Channel,
    select: Selection,
) -> Result<Plan, RecordingError> {
    let is_protobuf = channel.encoding == PROTOBUF && channel.schema_encoding == PROTOBUF;
    let plan = Plan::new(&channel.schema, &channel.schema_data, select).filter(|_| is_protobuf);
    plan.ok_or_else(|| RecordingError::NotTabular {
        path: recording.path.clone(),
        topic: channel.topic.clone(),
        encoding: channel.encoding.clone(),
        schema: channel.schema.clone(),
    })
}

/// Builder of a table from rows.
struct Builder {
    table: Table,
    row: Vec<Cell>,
}

impl Builder {
    fn new(topic: &str, plan: &Plan) -> Self {
        let columns = plan
            .leaves
            .iter()
            .map(|leaf| Column { name: leaf.name.clone(), values: empty_values(leaf) })
            .collect();
        let table = Table {
            topic: topic.to_owned(),
            log_time_ns: vec![],
            publish_time_ns: vec![],
            columns,
        };
        Self { table, row: vec![Cell::Null; plan.leaves.len()] }
    }

    fn add(
        &mut self,
        recording: &Recording,
        channel: &Channel,
        plan: &Plan,
    ) -> Result<(), RecordingError> {
        // Two channels of one schema name may still have different descriptors.
        let is_same = plan.leaves.len() == self.table.columns.len()
            && plan.leaves.iter().zip(&self.table.columns).all(|(leaf, column)| {
                leaf.name == column.name
                    && std::mem::discriminant(&empty_values(leaf))
                        == std::mem::discriminant(&column.values)
            });
        if !is_same {
            return Err(RecordingError::MixedSchemas {
                path: recording.path.clone(),
                topic: channel.topic.clone(),
                schemas: vec![channel.schema.clone(), format!("another {}", channel.schema)],
            });
        }
        for (index, (message, bytes)) in channel.raw().enumerate() {
            wire::decode_row(plan, bytes, &mut self.row).map_err(|error| {
                RecordingError::BadMessage {
                    path: recording.path.clone(),
                    topic: channel.topic.clone(),
                    index,
                    schema: channel.schema.clone(),
                    reason: error.to_string(),
                }
            })?;
            self.push(message.log_time, message.publish_time);
        }
        Ok(())
    }

    fn push(&mut self, log_time: Nanos, publish_time: Nanos) {
        self.table.log_time_ns.push(log_time.0);
        self.table.publish_time_ns.push(publish_time.0);
        for (column, cell) in self.table.columns.iter_mut().zip(&mut self.row) {
            push_cell(&mut column.values, std::mem::replace(cell, Cell::Null));
        }
    }

    /// Return the table with its rows by log time; file order among equals.
    fn finish(self) -> Table {
        let mut table = self.table;
        if table.log_time_ns.is_sorted() {
            return table;
        }
        let mut order: Vec<usize> = (0..table.log_time_ns.len()).collect();
        order.sort_by_key(|row| table.log_time_ns[*row]);
        reorder(&mut table.log_time_ns, &order);
        reorder(&mut table.publish_time_ns, &order);
        for column in &mut table.columns {
            match &mut column.values {
                Values::F64(values) => reorder(values, &order),
                Values::F32(values) => reorder(values, &order),
                Values::Int(values) => reorder(values, &order),
                Values::Unsigned(values) => reorder(values, &order),
                Values::Bool(values) => reorder(values, &order),
                Values::Text(values) => reorder(values, &order),
            }
        }
        table
    }
}

fn empty_values(leaf: &plan::Leaf) -> Values {
    use plan::{Repeated, Scalar};
    match (leaf.repeated, leaf.scalar) {
        (Repeated::Often, _) | (_, Scalar::Text | Scalar::Bytes) => Values::Text(vec![]),
        (_, Scalar::F64) => Values::F64(vec![]),
        (_, Scalar::F32) => Values::F32(vec![]),
        (_, Scalar::Bool) => Values::Bool(vec![]),
        (_, Scalar::Unsigned | Scalar::Fixed32 | Scalar::Fixed64) => Values::Unsigned(vec![]),
        (_, Scalar::Int | Scalar::Int32 | Scalar::ZigZag) => Values::Int(vec![]),
        (_, Scalar::SignedFixed32 | Scalar::SignedFixed64) => Values::Int(vec![]),
    }
}

fn push_cell(values: &mut Values, cell: Cell) {
    match (values, cell) {
        (Values::F64(values), Cell::F64(value)) => values.push(Some(value)),
        (Values::F32(values), Cell::F32(value)) => values.push(Some(value)),
        (Values::Int(values), Cell::Int(value)) => values.push(Some(value)),
        (Values::Unsigned(values), Cell::Unsigned(value)) => values.push(Some(value)),
        (Values::Bool(values), Cell::Bool(value)) => values.push(Some(value)),
        (Values::Text(values), Cell::Text(value)) => values.push(Some(value)),
        (Values::F64(values), _) => values.push(None),
        (Values::F32(values), _) => values.push(None),
        (Values::Int(values), _) => values.push(None),
        (Values::Unsigned(values), _) => values.push(None),
        (Values::Bool(values), _) => values.push(None),
        (Values::Text(values), _) => values.push(None),
    }
}

fn reorder<T: Clone>(values: &mut Vec<T>, order: &[usize]) {
    *values = order.iter().map(|row| values[*row].clone()).collect();
}

#[cfg(test)]
mod tests;
