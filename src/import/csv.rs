//! Import of CSV tables of any single axis: time, an input, and position, velocity or both.
//!
//! The first row holds the column names. The separator is the most frequent of comma, semicolon and
//! tab in that row, or white space. Lines that begin with `#` are comments. Up to two rows of text below
//! the names, such as units, are left out. A row without a value in a wanted
//! column (an empty cell, NaN and the like) is skipped and counted. Infinities are refused. A comma is
//! the decimal sign where it is not the separator and no number has a point. The time may be a date
//! with a time of day (RFC 3339 and similar forms), or a time of day. The text is UTF-8, UTF-16 with a
//! byte order mark, or else Latin-1.
//!
//! Units are converted here: a recorded value is the value of the table times the factor of its
//! unit. The metadata keep the units of the source as `time_unit_in_source` and the like.
//!
//! A run is a table, or the rows of a table in which the run column does not change. Times must
//! increase within a run and are recorded from its first row on. The first run begins at 0, every
//! other one [`RUN_PAUSE_S`] after the end of the one before. The times of the first rows in the
//! source are kept as `time_origin_s`.

mod table;
mod units;

pub use units::Quantity;

use super::{
    error::ImportError,
    report::{ImportReport, Notice},
    run::{ImportConfig, identity},
    tape::{Outgoing, Tape},
};
use crate::{
    recording::{
        message::{AxisInput, AxisOutput},
        topic,
    },
    stats::median,
    units::Nanos,
};
use std::{fs, path::Path};
use table::{Row, Table};
use units::Unit;

/// Pause between two runs (s).
const RUN_PAUSE_S: f64 = 1.0;
/// Smallest median time step that is implausible for a column without a unit (s). Encoders and drives
/// are sampled faster, and a column in ms with a period of 1 ms has a step of 1.
const IMPLAUSIBLE_STEP_S: f64 = 0.5;
/// Largest magnitude of a duty: 1, with room for rounding.
const LARGEST_DUTY: f64 = 1.0 + 1e-9;

/// Unit of a position, and per second of a velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionUnit {
    /// Metres.
    #[default]
    Metre,
    /// Radians.
    Radian,
}

impl PositionUnit {
    /// Return the unit as recorded: `m` or `rad`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Radian => "rad",
        }
    }
}

/// Assignment of columns to quantities, with their units.
///
/// | column | units | recorded |
/// |---|---|---|
/// | time | s (default), ms, us, ns, steps | ns |
/// | input, velocity | m/s, cm/s, mm/s, um/s, nm/s, m/min, mm/min, in/s, in/min | m/s |
/// | input, velocity | rad/s, mrad/s, deg/s, rpm, turns/s, rev/s, counts/s | rad/s |
/// | input | m, mm | m |
/// | input | N, mN, kN, kgf, lbf | N |
/// | input | N m (or Nm), kN m, N cm, mN m, kgf m, kgf cm, lbf in, lbf ft, ozf in | N m |
/// | input | V, mV, duty (-1 to 1) | V |
/// | input | A, mA, uA | A |
/// | position | m, cm, mm, um, nm, in | m |
/// | position | rad, mrad, deg, turns, rev, counts | rad |
///
/// The text behind the last colon is the unit. If it is no unit of the quantity, it belongs to the
/// column's name.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisColumns {
    /// Time, as `column` (s) or `column:unit`.
    pub time: String,
    /// Time step of a sample number (s), for the unit `steps`; above 0.
    pub step_s: Option<f64>,
    /// Input and its unit, as `column:unit`.
    pub input: String,
    /// Factor of the input before its unit applies; 1 by default, finite, not 0. A negative factor
    /// reverses the sign.
    pub input_scale: f64,
    /// Supply voltage (V), for the unit `duty`; above 0.
    pub supply_v: Option<f64>,
    /// Position, if any, as `column` or `column:unit`.
    pub position: Option<String>,
    /// Velocity, if any, as `column` or `column:unit`.
    pub velocity: Option<String>,
    /// Unit of a position without its own unit and, per second, of such a velocity.
    pub position_unit: PositionUnit,
    /// Encoder counts per turn, for the units `counts` and `counts/s`; above 0.
    pub counts_per_turn: Option<f64>,
    /// Column whose value, any text, changes where a new run begins; one run per table without it.
    pub run: Option<String>,
    /// Name of the axis in the topics; `axis` by default.
    pub axis: String,
}

impl AxisColumns {
    /// Assign the columns of time and input (`column:unit`) of an axis called `axis`, measured in
    /// metres.
    #[must_use]
    pub fn new(time: &str, input: &str) -> Self {
        Self {
            time: time.to_owned(),
            step_s: None,
            input: input.to_owned(),
            input_scale: 1.0,
            supply_v: None,
            position: None,
            velocity: None,
            position_unit: PositionUnit::default(),
            counts_per_turn: None,
            run: None,
            axis: "axis".to_owned(),
        }
    }

    /// Add a column of positions.
    #[must_use]
    pub fn position(self, column: &str) -> Self {
        Self { position: Some(column.to_owned()), ..self }
    }

    /// Add a column of velocities.
    #[must_use]
    pub fn velocity(self, column: &str) -> Self {
        Self { velocity: Some(column.to_owned()), ..self }
    }

    /// Begin a new run wherever the value of `column` changes.
    #[must_use]
    pub fn run(self, column: &str) -> Self {
        Self { run: Some(column.to_owned()), ..self }
    }

    /// Check everything that does not need the table.
    ///
    /// # Errors
    /// See [`ColumnError`].
    pub fn check(&self) -> Result<(), ColumnError> {
        Assigned::of(self).map(drop)
    }

    fn check_axis(&self) -> Result<(), ColumnError> {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-' || c == '.';
        if self.axis.is_empty() || !self.axis.chars().all(is_word) {
            return Err(ColumnError::AxisName { found: self.axis.clone() });
        }
        Ok(())
    }

    /// Options that only some units use, with the way to use them.
    fn unit_options(&self) -> [(&'static str, Option<f64>, &'static str); 3] {
        [
            ("--step-s", self.step_s, "--time COLUMN:steps"),
            ("--supply-v", self.supply_v, "--input COLUMN:duty"),
            (
                "--counts-per-turn",
                self.counts_per_turn,
                "--position COLUMN:counts or --velocity COLUMN:counts/s",
            ),
        ]
    }

    fn check_numbers(&self) -> Result<(), ColumnError> {
        for (option, value, _) in self.unit_options() {
            let is_allowed = |found: f64| 0.0 < found && found.is_finite();
            if let Some(found) = value.filter(|found| !is_allowed(*found)) {
                let allowed = "a finite number above 0";
                return Err(ColumnError::Number { option, found, allowed });
            }
        }
        let found = self.input_scale;
        if found == 0.0 || !found.is_finite() {
            let (option, allowed) = ("--input-scale", "a finite number other than 0");
            return Err(ColumnError::Number { option, found, allowed });
        }
        Ok(())
    }

    /// Column and unit of the input.
    fn split_input(&self) -> Result<(&str, &'static Unit), ColumnError> {
        let (column, unit) = Quantity::Input.split(&self.input);
        unit.map(|unit| (column, unit)).ok_or_else(|| match self.input.rsplit_once(':') {
            Some((column, "counts" | "counts/s")) => {
                ColumnError::InputCounts { column: column.to_owned() }
            }
            _ => {
                let (found, units) = (self.input.clone(), Quantity::Input.unit_list());
                ColumnError::InputUnit { found, units }
            }
        })
    }
}

/// Error of a column assignment, which is a usage error.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ColumnError {
    /// Input without a known unit.
    #[error("input '{found}' is not COLUMN:UNIT with a unit of {units}")]
    InputUnit {
        /// Text given.
        found: String,
        /// Allowed units.
        units: String,
    },
    /// Input in counts of a converter or register, which have no physical unit.
    #[error(
        "input '{column}:counts' has no physical unit; give the value of one count with \
         --input-scale, and its unit, such as `--input {column}:A --input-scale 0.001`"
    )]
    InputCounts {
        /// The column.
        column: String,
    },
    /// Unit that needs an option.
    #[error("the unit {unit} of {option} needs {needs}")]
    Incomplete {
        /// Option that has the unit.
        option: &'static str,
        /// The unit.
        unit: &'static str,
        /// Missing option and its value.
        needs: &'static str,
    },
    /// Option of a unit that no column has.
    #[error("{option} applies to no column; omit it, or give its unit with {way}")]
    Unused {
        /// The option.
        option: &'static str,
        /// Column with the unit that uses the option.
        way: &'static str,
    },
    /// Number outside of its range.
    #[error("{option} is {found}; it must be {allowed}")]
    Number {
        /// The option.
        option: &'static str,
        /// Number given.
        found: f64,
        /// Allowed numbers.
        allowed: &'static str,
    },
    /// Linear position with rotary velocity, or the reverse.
    #[error(
        "the position is in {position} and the velocity in {velocity}; use units of a length for \
         both, or of an angle: --velocity COLUMN:UNIT, or --position-unit for columns without a unit"
    )]
    Kinds {
        /// Unit of the position.
        position: &'static str,
        /// Unit of the velocity.
        velocity: &'static str,
    },
    /// Neither position nor velocity given.
    #[error("an axis needs a measured motion: give a column with --position or --velocity")]
    NoMotion,
    /// Name that is not allowed in a topic.
    #[error("axis name '{found}' must be letters, digits, '_', '-' or '.', and not empty")]
    AxisName {
        /// Name given.
        found: String,
    },
}

/// Column with its conversion.
struct Channel<'a> {
    quantity: Quantity,
    column: &'a str,
    unit: &'static Unit,
    /// Factor before the unit applies.
    scale: f64,
    /// Factor from the unit to the recorded one.
    factor: f64,
}

impl<'a> Channel<'a> {
    fn new(
        quantity: Quantity,
        (column, unit): (&'a str, &'static Unit),
        columns: &AxisColumns,
    ) -> Result<Self, ColumnError> {
        let scale = if quantity == Quantity::Input { columns.input_scale } else { 1.0 };
        let factor = unit.factor(quantity, columns)?;
        Ok(Self { quantity, column, unit, scale, factor })
    }

    /// Return `value` of `row` in the recorded unit.
    fn converted(&self, path: &Path, row: &Row, value: f64) -> Result<f64, ImportError> {
        let found = value * self.scale;
        if self.unit.is_duty() && LARGEST_DUTY < found.abs() {
            let (path, row, column) = (path.to_owned(), row.number, self.column.to_owned());
            return Err(ImportError::Duty { path, row, column, found });
        }
        let converted = found * self.factor;
        if !converted.is_finite() {
            let place = format!("column '{}' in {}", self.column, self.unit.recorded);
            let (path, row) = (path.to_owned(), row.number);
            return Err(ImportError::NotFinite { path, place, count: 1, row });
        }
        Ok(converted)
    }
}

/// Columns with their conversions.
struct Assigned<'a> {
    time: Channel<'a>,
    /// Whether the time column is given without a unit.
    is_time_assumed: bool,
    input: Channel<'a>,
    position: Option<Channel<'a>>,
    velocity: Option<Channel<'a>>,
}

impl<'a> Assigned<'a> {
    fn of(columns: &'a AxisColumns) -> Result<Self, ColumnError> {
        columns.check_axis()?;
        if columns.position.is_none() && columns.velocity.is_none() {
            return Err(ColumnError::NoMotion);
        }
        columns.check_numbers()?;
        let channel = |quantity: Quantity, text: &'a str| {
            let (column, unit) = quantity.split(text);
            let unit = unit.unwrap_or_else(|| quantity.default_unit(columns.position_unit));
            Channel::new(quantity, (column, unit), columns)
        };
        let optional = |quantity: Quantity, text: &'a Option<String>| {
            text.as_deref().map(|text| channel(quantity, text)).transpose()
        };
        let assigned = Self {
            time: channel(Quantity::Time, &columns.time)?,
            is_time_assumed: Quantity::Time.split(&columns.time).1.is_none(),
            input: Channel::new(Quantity::Input, columns.split_input()?, columns)?,
            position: optional(Quantity::Position, &columns.position)?,
            velocity: optional(Quantity::Velocity, &columns.velocity)?,
        };
        assigned.check_together(columns)?;
        Ok(assigned)
    }

    fn check_together(&self, columns: &AxisColumns) -> Result<(), ColumnError> {
        if let (Some(position), Some(velocity)) = (&self.position, &self.velocity)
            && position.unit.is_rotary() != velocity.unit.is_rotary()
        {
            let (position, velocity) = (position.unit.name, velocity.unit.name);
            return Err(ColumnError::Kinds { position, velocity });
        }
        for (option, value, way) in columns.unit_options() {
            if value.is_some()
                && !self.channels().any(|channel| channel.unit.option_used() == Some(option))
            {
                return Err(ColumnError::Unused { option, way });
            }
        }
        Ok(())
    }

    /// Channels in the order of the values of a [`Row`].
    fn channels(&self) -> impl Iterator<Item = &Channel<'a>> {
        [&self.time, &self.input].into_iter().chain(&self.position).chain(&self.velocity)
    }

    fn position_unit(&self) -> PositionUnit {
        let is_rotary = |channel: &Channel<'_>| channel.unit.is_rotary();
        if self.position.as_ref().or(self.velocity.as_ref()).is_some_and(is_rotary) {
            PositionUnit::Radian
        } else {
            PositionUnit::Metre
        }
    }

    fn messages(&self, path: &Path, row: &Row) -> Result<(AxisInput, AxisOutput), ImportError> {
        let mut motion = row.values[2..].iter().copied();
        let mut converted = |channel: &Option<Channel<'a>>| match channel {
            Some(channel) => {
                motion.next().map(|value| channel.converted(path, row, value)).transpose()
            }
            None => Ok(None),
        };
        let output = AxisOutput {
            position: converted(&self.position)?,
            velocity: converted(&self.velocity)?,
            position_unit: self.position_unit().name().to_owned(),
        };
        let input = AxisInput {
            value: self.input.converted(path, row, row.values[1])?,
            unit: self.input.unit.recorded.to_owned(),
        };
        Ok((input, output))
    }

    /// Add the units of the source to the error of a missing column whose name may end in a wrong
    /// unit.
    fn explain(&self, error: ImportError) -> ImportError {
        match error {
            ImportError::NoColumn { path, column, found, mut hint } if column.contains(':') => {
                if let Some(channel) = self.channels().find(|own| own.column == column) {
                    let (option, units) = (channel.quantity.option(), channel.quantity.unit_list());
                    hint += &format!("; the units of {option} are {units}");
                }
                ImportError::NoColumn { path, column, found, hint }
            }
            other => other,
        }
    }

    /// Metadata of all conversions.
    fn metadata(&self, columns: &AxisColumns) -> Vec<(String, String)> {
        let converted = self.channels().filter(|channel| channel.unit.is_converted());
        let units = converted.map(|channel| {
            let quantity = channel.quantity.option().trim_start_matches('-');
            (format!("{quantity}_unit_in_source"), channel.unit.name.to_owned())
        });
        let scale = (columns.input_scale != 1.0).then_some(columns.input_scale);
        let numbers = [
            ("input_scale", scale),
            ("step_s", columns.step_s),
            ("supply_v", columns.supply_v),
            ("counts_per_turn", columns.counts_per_turn),
        ];
        let given = |(key, value): (&str, Option<f64>)| Some((key.to_owned(), value?.to_string()));
        units.chain(numbers.into_iter().filter_map(given)).collect()
    }
}

/// Import the tables at `paths` as runs of one recording, in this order.
///
/// Without [`AxisColumns::run`], a table is one run, and a run of several tables has the name of its
/// file without extension. With it, a run has the value of the run column as its name.
///
/// # Errors
/// When the assignment is wrong (see [`ColumnError`]), a column is missing, a cell is not a finite
/// number, a duty is outside of -1 to 1, times do not increase within a run, `paths` is empty, or a
/// file cannot be read or written.
pub fn import_csv<P: AsRef<Path>>(
    paths: &[P],
    columns: &AxisColumns,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let assigned = Assigned::of(columns)?;
    let paths: Vec<&Path> = paths.iter().map(AsRef::as_ref).collect();
    let Some(source) = paths.first() else {
        let (path, found) = ("(no path)".into(), "the list of tables is empty".to_owned());
        return Err(ImportError::NothingToImport { path, found });
    };
    let split = config.split_or_train();
    let mut runs = Runs::new(&assigned, columns, split.to_string());
    let mut files = Vec::new();
    for path in &paths {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        runs.push_table(path, if paths.len() == 1 { "unknown" } else { &stem })?;
        files.push(identity(path)?);
    }
    config.write(runs.finish(), source, split, &files)
}

/// Runs on one tape, each behind the one before.
struct Runs<'a> {
    assigned: &'a Assigned<'a>,
    columns: &'a AxisColumns,
    split: String,
    topics: [String; 2],
    tape: Tape,
    /// Time of the last row.
    end: Option<Nanos>,
    /// Time in the source of the first row of every run (s).
    origins: Vec<f64>,
    /// Time steps within the runs (s).
    steps: Vec<f64>,
}

impl<'a> Runs<'a> {
    fn new(assigned: &'a Assigned<'a>, columns: &'a AxisColumns, split: String) -> Self {
        Self {
            assigned,
            columns,
            split,
            topics: [topic::axis_input(&columns.axis), topic::axis_output(&columns.axis)],
            tape: Tape::default(),
            end: None,
            origins: Vec::new(),
            steps: Vec::new(),
        }
    }

    /// Append the runs of the table at `path`; without a run column, it is one run called `name`.
    fn push_table(&mut self, path: &Path, name: &str) -> Result<(), ImportError> {
        let text = read(path)?;
        let table = Table::parse(path, &text)?;
        let wanted: Vec<&str> = self.assigned.channels().map(|channel| channel.column).collect();
        let run = self.columns.run.as_deref();
        let found = table.numbers(&wanted, run).map_err(|error| self.assigned.explain(error))?;
        let file = path.display().to_string();
        if found.has_clock && self.assigned.time.unit.name != "s" {
            let (column, unit) =
                (self.assigned.time.column.to_owned(), self.assigned.time.unit.name);
            return Err(ImportError::ClockWithUnit { path: path.to_owned(), column, unit });
        }
        for (row, cells) in &found.texts {
            let cells = cells.join(", ");
            self.tape.notices.push(Notice::TextRow { file: file.clone(), row: *row, cells });
        }
        if let Some((rows, first_row)) = found.skipped {
            self.tape.notices.push(Notice::EmptyCells { file, rows, first_row });
        }
        for rows in found.rows.chunk_by(|row, next| row.run == next.run) {
            self.check_times(path, rows)?;
            self.push_run(path, rows, run.map_or(name, |_column| rows[0].run.as_str()))?;
        }
        Ok(())
    }

    fn check_times(&self, path: &Path, rows: &[Row]) -> Result<(), ImportError> {
        let (column, unit) = (self.assigned.time.column, self.assigned.time.unit.name);
        check_times(path, rows, column, unit).map_err(|error| match error {
            ImportError::TimeNotAdvancing { path, row, column, found, previous, unit, .. }
                if found < previous && self.columns.run.is_none() =>
            {
                let hint = ", or name the column of the runs with --run";
                ImportError::TimeNotAdvancing { path, row, column, found, previous, unit, hint }
            }
            other => other,
        })
    }

    fn push_run(&mut self, path: &Path, rows: &[Row], name: &str) -> Result<(), ImportError> {
        let factor = self.assigned.time.factor;
        let origin = rows[0].values[0];
        let start = self.end.map_or(Nanos(0), |end| end.after_seconds(RUN_PAUSE_S));
        let mut run = Tape::default();
        for row in rows {
            let time = start.after_seconds((row.values[0] - origin) * factor);
            let (input, output) = self.assigned.messages(path, row)?;
            run.push(&self.topics[0], time, Outgoing::AxisInput(input));
            run.push(&self.topics[1], time, Outgoing::AxisOutput(output));
            self.end = Some(time);
        }
        run.mark_run(self.origins.len() as u32, name, &self.split);
        self.tape.append(run);
        self.origins.push(origin * factor);
        let step = |pair: &[Row]| (pair[1].values[0] - pair[0].values[0]) * factor;
        self.steps.extend(rows.windows(2).map(step));
        Ok(())
    }

    /// Return the tape with the metadata and notices of the whole import.
    fn finish(mut self) -> Tape {
        self.tape.metadata.extend(self.assigned.metadata(self.columns));
        if let Some(origins) = listed(&self.origins) {
            self.tape.metadata.insert("time_origin_s".to_owned(), origins);
        }
        if let Some(step_s) = median(&self.steps)
            && self.assigned.is_time_assumed
            && IMPLAUSIBLE_STEP_S <= step_s
        {
            let column = self.assigned.time.column.to_owned();
            self.tape.notices.push(Notice::LongStep { column, step_s });
        }
        self.tape
    }
}

/// One text for all `values`: the value if all are equal, else the list in order.
fn listed(values: &[f64]) -> Option<String> {
    let first = values.first()?;
    let shown = if values.iter().all(|value| value == first) { &values[..1] } else { values };
    Some(shown.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
}

/// Column names of the CSV table at `path`, in order.
///
/// # Errors
/// When the file cannot be read or has no rows.
pub fn column_names(path: &Path) -> Result<Vec<String>, ImportError> {
    Ok(Table::parse(path, &read(path)?)?.header)
}

/// Values of `columns` of the CSV table at `path`, row by row; the first column is the time (s).
///
/// # Errors
/// When a column is missing, a cell is empty or not a finite number, times do not increase, or the file
/// cannot be read.
pub fn read_columns(path: &Path, columns: &[&str]) -> Result<Vec<Vec<f64>>, ImportError> {
    let text = read(path)?;
    let found = Table::parse(path, &text)?.numbers(columns, None)?;
    if let Some((count, row)) = found.skipped {
        return Err(ImportError::EmptyCells { path: path.to_owned(), count, row });
    }
    if let Some(time) = columns.first() {
        check_times(path, &found.rows, time, "s")?;
    }
    Ok(found.rows.into_iter().map(|row| row.values).collect())
}

fn read(path: &Path) -> Result<String, ImportError> {
    Ok(decoded(fs::read(path).map_err(ImportError::io(path, "read"))?))
}

/// Text of a file in UTF-8, in UTF-16 with a byte order mark, or else in Latin-1, without the mark.
fn decoded(bytes: Vec<u8>) -> String {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    match bytes.as_slice() {
        [0xFF, 0xFE, text @ ..] => wide(text, u16::from_le_bytes),
        [0xFE, 0xFF, text @ ..] => wide(text, u16::from_be_bytes),
        _ => match String::from_utf8(bytes) {
            Ok(text) => text.strip_prefix('\u{FEFF}').map(str::to_owned).unwrap_or(text),
            Err(error) => error.as_bytes().iter().copied().map(char::from).collect(),
        },
    }
}

/// Check that the first value increases from row to row; `unit` is that of the source.
fn check_times(
    path: &Path,
    rows: &[Row],
    column: &str,
    unit: &'static str,
) -> Result<(), ImportError> {
    for pair in rows.windows(2) {
        let [previous, found] = [pair[0].values[0], pair[1].values[0]];
        if found <= previous {
            let (path, row, column) = (path.to_owned(), pair[1].number, column.to_owned());
            let hint = "";
            return Err(ImportError::TimeNotAdvancing {
                path,
                row,
                column,
                found,
                previous,
                unit,
                hint,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{ExistingFile, Recording};
    use proptest::prelude::*;
    use std::{f64::consts::TAU, path::PathBuf};

    /// Tables by name, imported together.
    fn import_tables(
        tables: &[(&str, &str)],
        columns: &AxisColumns,
    ) -> Result<(ImportReport, Recording), ImportError> {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> = tables.iter().map(|(name, _)| folder.path().join(name)).collect();
        for (path, (_, text)) in paths.iter().zip(tables) {
            fs::write(path, text).unwrap();
        }
        let output = folder.path().join("out.mcap");
        let config = ImportConfig::new(&output, ExistingFile::Refuse);
        let report = import_csv(&paths, columns, &config).inspect_err(|_| {
            let left = fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(left, tables.len(), "nothing is left behind");
        })?;
        Ok((report, Recording::open(&output).unwrap()))
    }

    fn import(text: &str, columns: &AxisColumns) -> Result<(ImportReport, Recording), ImportError> {
        import_tables(&[("in.csv", text)], columns)
    }

    fn fault(text: &str, columns: &AxisColumns) -> String {
        let error = import(text, columns).unwrap_err().to_string();
        error.split_once("in.csv: ").unwrap().1.to_owned()
    }

    fn columns() -> AxisColumns {
        AxisColumns::new("t", "u:Nm").position("x").velocity("v")
    }

    /// Times, inputs and outputs of the axis.
    fn series(recording: &Recording) -> (Vec<Nanos>, Vec<AxisInput>, Vec<AxisOutput>) {
        let input = recording.series::<AxisInput>("/axis/axis/input").unwrap();
        let output = recording.series::<AxisOutput>("/axis/axis/output").unwrap();
        assert_eq!(input.times, output.times);
        (input.times, input.values, output.values)
    }

    /// Names of the runs, and their first and last times (s).
    fn runs(recording: &Recording) -> Vec<(String, f64, f64)> {
        let runs = recording.marked_runs().unwrap();
        let numbers: Vec<u32> = runs.iter().map(|run| run.number).collect();
        assert_eq!(numbers, (0..runs.len() as u32).collect::<Vec<_>>());
        let named = runs.into_iter().map(|run| {
            let seconds = run.seconds_since(Nanos(0));
            (run.pattern, seconds.start, seconds.end)
        });
        named.collect()
    }

    #[test]
    fn a_table_becomes_an_axis() {
        let text = "\u{FEFF}\"t\";u;v;x\r\n5.0;1;0.5;2\r\n\r\n5.001;-1e-3;0.6;2.5\r\n";
        let (report, recording) = import(text, &columns()).unwrap();
        assert!(!report.is_lossy(), "{report:?}");
        let (times, inputs, outputs) = series(&recording);
        assert_eq!(times, [Nanos(0), Nanos(1_000_000)]);
        assert_eq!(inputs[1], AxisInput { value: -1e-3, unit: "N m".into() });
        assert_eq!((outputs[1].position, outputs[1].velocity), (Some(2.5), Some(0.6)));
        assert_eq!(outputs[1].position_unit, "m");
        assert_eq!(recording.info("time_origin_s"), Some("5"));
        assert_eq!(recording.info("input_unit_in_source"), None, "nothing is converted");
        assert_eq!(recording.markers().unwrap().values.len(), 2);
        assert_eq!(runs(&recording), [("unknown".to_owned(), 0.0, 0.001)]);
    }

    #[test]
    fn units_are_converted_and_kept_in_the_metadata() {
        let columns = AxisColumns {
            supply_v: Some(12.0),
            counts_per_turn: Some(4096.0),
            input_scale: -0.01,
            ..AxisColumns::new("t:ms", "pwm:duty").position("x:counts").velocity("v:rpm")
        };
        let text = "t,pwm,x,v\n1000,50,4096,60\n1010,-100,1024,-30\n";
        let (report, recording) = import(text, &columns).unwrap();
        assert!(report.notices.is_empty(), "{report:?}");
        let (times, inputs, outputs) = series(&recording);
        assert_eq!(times, [Nanos(0), Nanos(10_000_000)]);
        assert_eq!(inputs[0], AxisInput { value: -6.0, unit: "V".into() });
        assert_eq!(inputs[1].value, 12.0);
        assert_eq!(outputs[0].position_unit, "rad");
        assert_eq!((outputs[0].position, outputs[0].velocity), (Some(TAU), Some(TAU)));
        assert_eq!(outputs[1].position, Some(TAU / 4.0));
        for (key, value) in [
            ("time_origin_s", "1"),
            ("time_unit_in_source", "ms"),
            ("input_unit_in_source", "duty"),
            ("position_unit_in_source", "counts"),
            ("velocity_unit_in_source", "rpm"),
            ("input_scale", "-0.01"),
            ("supply_v", "12"),
            ("counts_per_turn", "4096"),
        ] {
            assert_eq!(recording.info(key), Some(value), "{key}");
        }
        assert_eq!(recording.info("step_s"), None);
    }

    /// A motion of 50 samples as text, each quantity in a unit of the given size.
    fn motion(time: f64, input: f64, position: f64, velocity: f64) -> String {
        let row = |k: i32| {
            let phase = 0.3 * f64::from(k);
            let (seconds, amps) = (0.01 * f64::from(k), 0.4 + 1.7 * phase.sin());
            let (angle, speed) = (2.0 + 0.9 * phase.cos(), 0.1 - 2.6 * phase.sin());
            format!(
                "{},{},{},{}\n",
                seconds / time,
                amps / input,
                angle / position,
                speed / velocity
            )
        };
        "t,u,x,v\n".to_owned() + &(0..50).map(row).collect::<String>()
    }

    /// Metamorphic: the same motion in other units is the same recording.
    #[test]
    fn the_same_motion_in_any_units_is_the_same_recording() {
        let close = |found: f64, expected: f64| (found - expected).abs() <= 1e-12 * expected.abs();
        let degree = TAU / 360.0;
        let times = [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("steps", 0.01), ("s", 1.0)];
        let inputs = [("mA", 1e-3, "A"), ("mNm", 1e-3, "Nm"), ("rpm", TAU / 60.0, "rad/s")];
        let angles = [("deg", degree), ("rev", TAU), ("counts", TAU / 2000.0), ("rad", 1.0)];
        let speeds = [
            ("deg/s", degree),
            ("rev/s", TAU),
            ("counts/s", TAU / 2000.0),
            ("rpm", TAU / 60.0),
            ("rad/s", 1.0),
        ];
        for (unit, size, recorded) in inputs {
            let plain = AxisColumns::new("t", &format!("u:{recorded}"));
            let plain = plain.position("x:rad").velocity("v:rad/s");
            let expected = series(&import(&motion(1.0, 1.0, 1.0, 1.0), &plain).unwrap().1);
            for (k, (time_unit, second)) in times.into_iter().enumerate() {
                let (angle_unit, angle) = angles[k % angles.len()];
                let (speed_unit, speed) = speeds[k];
                let columns = AxisColumns::new(&format!("t:{time_unit}"), &format!("u:{unit}"))
                    .position(&format!("x:{angle_unit}"))
                    .velocity(&format!("v:{speed_unit}"));
                let is_counted = angle_unit == "counts" || speed_unit == "counts/s";
                let columns = AxisColumns {
                    step_s: (time_unit == "steps").then_some(0.01),
                    counts_per_turn: is_counted.then_some(2000.0),
                    ..columns
                };
                let text = motion(second, size, angle, speed);
                let (_, recording) = import(&text, &columns).unwrap();
                let (times, inputs, outputs) = series(&recording);
                assert_eq!(times, expected.0, "{time_unit}");
                for (found, expected) in inputs.iter().zip(&expected.1) {
                    assert!(close(found.value, expected.value), "{unit}: {found:?} {expected:?}");
                    assert_eq!(found.unit, expected.unit);
                }
                for (found, expected) in outputs.iter().zip(&expected.2) {
                    let pairs =
                        [(found.position, expected.position), (found.velocity, expected.velocity)];
                    for (found, expected) in pairs {
                        assert!(
                            close(found.unwrap(), expected.unwrap()),
                            "{angle_unit} {speed_unit}"
                        );
                    }
                    assert_eq!(found.position_unit, "rad");
                }
            }
        }
    }

    #[test]
    fn linear_units_are_metres() {
        let columns = AxisColumns::new("t:us", "u:kN").position("x:mm").velocity("v:mm/s");
        let (_, recording) = import("t,u,x,v\n0,0.002,12,-5\n9,0,0,0\n", &columns).unwrap();
        let (times, inputs, outputs) = series(&recording);
        assert_eq!(times[1], Nanos(9000));
        assert_eq!(inputs[0], AxisInput { value: 2.0, unit: "N".into() });
        assert_eq!((outputs[0].position, outputs[0].velocity), (Some(0.012), Some(-0.005)));
        assert_eq!(outputs[0].position_unit, "m");
        // The old option still gives the unit of columns without one.
        let columns = AxisColumns {
            position_unit: PositionUnit::Radian,
            ..AxisColumns::new("t", "u:V").position("x:deg").velocity("v")
        };
        let (_, recording) = import("t,u,x,v\n0,1,0,3\n0.1,1,90,3\n", &columns).unwrap();
        let output = &series(&recording).2[1];
        assert_eq!((output.position, output.velocity), (Some(TAU / 4.0), Some(3.0)));
    }

    #[test]
    fn runs_of_a_column_may_restart_the_time() {
        let text = "# bench\ntest,t,u,x\nslow,5,1,2\nslow,5.5,1,2\n# next\nfast,0,1,2\nfast,0.25,1,3\n\
                    slow,0,1,4\nslow,0.5,1,5\n";
        let columns = AxisColumns::new("t:s", "u:V").position("x").run("test");
        let (report, recording) = import(text, &columns).unwrap();
        assert!(report.notices.is_empty(), "comments are no loss: {report:?}");
        let found = runs(&recording);
        let named = |name: &str, start, end| (name.to_owned(), start, end);
        let expected =
            [named("slow", 0.0, 0.5), named("fast", 1.5, 1.75), named("slow", 2.75, 3.25)];
        assert_eq!(found, expected);
        let times: Vec<f64> =
            series(&recording).0.iter().map(|t| t.seconds_since(Nanos(0))).collect();
        assert_eq!(times, [0.0, 0.5, 1.5, 1.75, 2.75, 3.25]);
        assert_eq!(recording.info("time_origin_s"), Some("5; 0; 0"));
    }

    #[test]
    fn files_are_runs_in_the_given_order() {
        let table = |start: f64| format!("t,u,x,v\n{start},1,2,3\n{},4,5,6\n", start + 0.5);
        let (early, late) = (table(1.0), table(7.0));
        let tables = [("late.csv", late.as_str()), ("early.csv", early.as_str())];
        let (_, recording) = import_tables(&tables, &columns()).unwrap();
        let named = |name: &str, start, end| (name.to_owned(), start, end);
        assert_eq!(runs(&recording), [named("late", 0.0, 0.5), named("early", 1.5, 2.0)]);
        assert_eq!(recording.info("time_origin_s"), Some("7; 1"));
        assert_eq!(recording.info("original_file"), Some("late.csv, early.csv"));
        assert_eq!(recording.info("session"), Some("late"));
        // Runs of a column continue over files.
        let with_run = ["a", "b"].map(|run| format!("r,t,u,x\n{run},0,1,2\n{run},0.5,1,2\n"));
        let tables = [("1.csv", with_run[0].as_str()), ("2.csv", with_run[1].as_str())];
        let by_column = AxisColumns::new("t:s", "u:V").position("x").run("r");
        let (_, recording) = import_tables(&tables, &by_column).unwrap();
        assert_eq!(runs(&recording), [named("a", 0.0, 0.5), named("b", 1.5, 2.0)]);
        // Every file needs the columns, and the error names the file without them.
        let tables = [("1.csv", early.as_str()), ("2.csv", "t,u,x\n0,1,2\n")];
        let error = import_tables(&tables, &columns()).unwrap_err().to_string();
        assert!(error.contains("2.csv: no column 'v'"), "{error}");
        let error = import_tables(&[], &columns()).unwrap_err().to_string();
        assert!(error.contains("the list of tables is empty"), "{error}");
    }

    #[test]
    fn faults_name_file_row_and_column() {
        let fault = |text: &str| fault(text, &columns());
        assert_eq!(fault("t,u,x\n0,1,2\n"), "no column 'v'; the columns are t, u, x");
        assert_eq!(fault("t,u,x,v\n0,1,2,3\n1,a,2,3\n"), "row 3, column 'u': 'a' is not a number");
        assert_eq!(
            fault("t,u,x,v\n0,1,2,3\n0,1,2,3\n"),
            "row 3, column 't': time 0 s does not come after 0 s; sort the rows and remove duplicates"
        );
        assert_eq!(
            fault("t,u,x,v\n0,1,-inf,3\n1,1,inf,3\n"),
            "column 'x' holds 2 values that are not finite, the first in row 2; repair or remove \
             those rows first"
        );
        assert_eq!(fault("t,u,x,v\n"), "no rows below the header");
        assert_eq!(fault(""), "no rows below the header");
        assert_eq!(
            fault("t,t,u,x,v\n0,0,1,2,3\n"),
            "column 't' occurs 2 times in the header; rename all but one"
        );
    }

    #[test]
    fn faults_of_units_name_values_of_the_source() {
        let columns = |time: &str| AxisColumns::new(time, "u:V").position("x");
        assert_eq!(
            fault("t,u,x\n20,1,2\n10,1,2\n", &columns("t:ms")),
            "row 3, column 't': time 10 ms does not come after 20 ms; sort the rows and remove \
             duplicates, or name the column of the runs with --run"
        );
        assert_eq!(
            fault("r,t,u,x\n1,20,1,2\n1,10,1,2\n", &columns("t:ms").run("r")),
            "row 3, column 't': time 10 ms does not come after 20 ms; sort the rows and remove \
             duplicates"
        );
        let duty =
            AxisColumns { supply_v: Some(6.0), ..AxisColumns::new("t", "u:duty").position("x") };
        assert_eq!(
            fault("t,u,x\n0,50,1\n", &duty),
            "row 2, column 'u': duty 50 is outside of -1 to 1; scale the column with --input-scale, \
             such as 0.01 for percent"
        );
        let huge = AxisColumns { input_scale: 1e300, ..columns("t") };
        assert_eq!(
            fault("t,u,x\n0,1e300,1\n", &huge),
            "column 'u' in V holds 1 values that are not finite, the first in row 2; repair or \
             remove those rows first"
        );
        assert_eq!(
            fault("t,u,pos\n0,1,2\n", &AxisColumns::new("t", "u:V").position("pos:xyz")),
            "no column 'pos:xyz'; the columns are t, u, pos; the units of --position are m, cm, mm, \
             um, nm, in, rad, mrad, deg, turns, rev, counts"
        );
        assert_eq!(
            fault("t,u,x\n0,1,2\n", &columns("t:min")),
            "no column 't:min'; the columns are t, u, x; the units of --time are s, ms, us, ns, steps"
        );
    }

    #[test]
    fn a_column_name_may_hold_a_colon() {
        let text = "log:t,drive:u,arm:x,v:mm\n0,1,2,3\n0.01,1,2,3\n";
        let columns =
            AxisColumns::new("log:t", "drive:u:mV").position("arm:x").velocity("v:mm:mm/s");
        let (_, recording) = import(text, &columns).unwrap();
        let (_, inputs, outputs) = series(&recording);
        assert_eq!(inputs[0].value, 0.001);
        assert_eq!((outputs[0].position, outputs[0].velocity), (Some(2.0), Some(0.003)));
    }

    #[test]
    fn encodings_do_not_change_the_text() {
        let text = "t,Kraft \u{b5}N\n0,1\n";
        let wide = |mark: [u8; 2], bytes: fn(u16) -> [u8; 2]| {
            mark.into_iter().chain(text.encode_utf16().flat_map(bytes)).collect::<Vec<u8>>()
        };
        let with_mark = [&[0xEF, 0xBB, 0xBF], text.as_bytes()].concat();
        let latin = text.chars().map(|own| own as u8).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            with_mark,
            wide([0xFF, 0xFE], u16::to_le_bytes),
            wide([0xFE, 0xFF], u16::to_be_bytes),
            latin,
        ] {
            assert_eq!(decoded(bytes), text);
        }
    }

    #[test]
    fn a_log_with_dates_and_units_below_the_names_is_imported() {
        let text =
            "t;u;x;v\n;V;m;m/s\n2026-03-01 12:00:00,000;1,5;2;3\n2026-03-01 12:00:00,010;1;2;3\n";
        let (report, recording) = import(text, &columns()).unwrap();
        let (times, inputs, _) = series(&recording);
        assert_eq!(inputs[0].value, 1.5);
        assert!((times[1].0.abs_diff(times[0].0 + 10_000_000)) < 1_000, "{times:?}");
        let notices: Vec<String> = report.notices.iter().map(ToString::to_string).collect();
        assert!(
            notices[0].contains("row 2 holds text below the column names (, V, m, m/s)"),
            "{notices:?}"
        );
        assert!(!report.is_lossy());
        let in_ms = AxisColumns { time: "t:ms".into(), ..columns() };
        assert!(fault(text, &in_ms).contains("write --time 't' instead of 't:ms'"));
    }

    #[test]
    fn rows_with_empty_cells_are_skipped_and_counted() {
        let text = "t,u,x,v\n0,1,2,3\n1,,2,3\n2,1,2\n3,1,2,3\n";
        let columns = AxisColumns { time: "t:ms".into(), ..columns() };
        let (report, _) = import(text, &columns).unwrap();
        let [Notice::EmptyCells { file, rows: 2, first_row: 3 }] = report.notices.as_slice() else {
            panic!("{report:?}");
        };
        assert!(file.ends_with("in.csv"), "{file}");
        assert!(report.is_lossy());
    }

    #[test]
    fn a_long_step_without_a_unit_is_noticed() {
        let notices = |step: f64, time: &str| {
            let text = format!("t,u,x\n0,1,2\n{step},1,2\n{},1,2\n", 2.0 * step);
            let columns = AxisColumns::new(time, "u:V").position("x");
            let (report, _) = import(&text, &columns).unwrap();
            assert!(!report.is_lossy());
            report.notices.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(
            notices(2.0, "t"),
            [
                "note: the median time step of column 't' is 2 s; if the column is in ms, add ':ms' to \
              --time"
            ]
        );
        assert_eq!(notices(0.5, "t").len(), 1);
        assert_eq!(notices(0.49, "t").len(), 0);
        assert_eq!(notices(2.0, "t:s").len(), 0, "the unit is given");
        assert_eq!(notices(2.0, "t:ms").len(), 0);
    }

    #[test]
    fn assignments_are_checked_first() {
        let wrong = |columns: AxisColumns| columns.check().unwrap_err().to_string();
        let moved = |input: &str| AxisColumns::new("t", input).position("x");
        assert_eq!(
            wrong(moved("u:stone")),
            "input 'u:stone' is not COLUMN:UNIT with a unit of m/s, cm/s, mm/s, um/s, nm/s, m/min, mm/min, in/s, in/min, \
             rad/s, mrad/s, deg/s, rpm, turns/s, rev/s, counts/s, m, mm, N, mN, kN, kgf, lbf, Nm, kNm, Ncm, mNm, kgfm, \
             kgfcm, lbfin, lbfft, ozfin, V, mV, A, mA, uA, duty"
        );
        assert!(wrong(moved("u")).contains("COLUMN:UNIT"));
        assert_eq!(
            wrong(moved("u:counts")),
            "input 'u:counts' has no physical unit; give the value of one count with --input-scale, \
             and its unit, such as `--input u:A --input-scale 0.001`"
        );
        assert!(wrong(AxisColumns::new("t", "u:V")).contains("--position"));
        assert!(wrong(AxisColumns { axis: "a/b".into(), ..columns() }).contains("'a/b'"));
        assert_eq!(
            wrong(AxisColumns::new("t", "u:V").position("x:deg").velocity("v")),
            "the position is in deg and the velocity in m/s; use units of a length for both, or of an \
             angle: --velocity COLUMN:UNIT, or --position-unit for columns without a unit"
        );
        assert!(wrong(moved("u:V").velocity("v:rpm")).contains("in m and the velocity in rpm"));
    }

    #[test]
    fn options_of_units_are_needed_there_and_nowhere_else() {
        let wrong = |columns: AxisColumns| columns.check().unwrap_err().to_string();
        let new = |time: &str, input: &str, position: &str| {
            AxisColumns::new(time, input).position(position)
        };
        let plain = || new("t", "u:V", "x");
        assert_eq!(
            wrong(new("t:steps", "u:V", "x")),
            "the unit steps of --time needs --step-s SECONDS"
        );
        assert_eq!(
            wrong(new("t", "u:duty", "x")),
            "the unit duty of --input needs --supply-v VOLTS"
        );
        let needs = "needs --counts-per-turn COUNT";
        assert!(wrong(new("t", "u:V", "x:counts")).ends_with(needs));
        assert!(wrong(AxisColumns::new("t", "u:V").velocity("v:counts/s")).ends_with(needs));
        assert_eq!(
            wrong(AxisColumns { step_s: Some(0.1), ..plain() }),
            "--step-s applies to no column; omit it, or give its unit with --time COLUMN:steps"
        );
        assert!(wrong(AxisColumns { supply_v: Some(1.0), ..plain() }).starts_with("--supply-v"));
        let counted = AxisColumns { counts_per_turn: Some(1.0), ..plain() };
        assert!(wrong(counted).starts_with("--counts-per-turn applies to no column"));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let steps = AxisColumns { step_s: Some(bad), ..new("t:steps", "u:V", "x") };
            assert!(wrong(steps).contains("must be a finite number above 0"));
            let counts = AxisColumns { counts_per_turn: Some(bad), ..new("t", "u:V", "x:counts") };
            assert!(wrong(counts).starts_with(&format!("--counts-per-turn is {bad}")));
        }
        for bad in [0.0, f64::NAN, f64::NEG_INFINITY] {
            let scaled = wrong(AxisColumns { input_scale: bad, ..plain() });
            assert!(scaled.ends_with("must be a finite number other than 0"), "{scaled}");
        }
        assert_eq!(AxisColumns { input_scale: -2.0, ..plain() }.check(), Ok(()));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn any_text_is_imported_or_refused(
            text in "(t,u,x,v\n)?([0-9a-z,;\"\t \n.#-]|nan|1e9,|1e308,){0,80}",
        ) {
            let other = AxisColumns::new("t:ms", "u:kN").position("x:turns").run("v");
            for columns in [columns(), other] {
                import(&text, &columns).ok();
            }
        }

        #[test]
        fn any_column_is_assigned_or_refused(
            time in ".{0,8}(:steps|:ms|:)?",
            input in ".{0,8}(:Nm|:duty|:counts|:)?",
            position in ".{0,8}(:deg|:counts|:µm|:)?",
        ) {
            let columns = AxisColumns::new(&time, &input).position(&position);
            columns.check().ok();
            AxisColumns { step_s: Some(0.1), supply_v: Some(5.0), ..columns }.check().ok();
        }
    }
}
