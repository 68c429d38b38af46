//! Import of CSV tables of any single axis: time, an input, and position, velocity or both.
//!
//! The first row holds the column names. The separator is the most frequent of comma, semicolon and
//! tab in that row. Times are in seconds and must increase with every row. They are recorded from 0
//! at the first row, and the first row's own time is kept as `time_origin_s`. A row with an empty
//! cell in a wanted column is skipped and counted. NaN and infinities are refused, because their
//! meaning is unknown.

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
    units::Nanos,
};
use std::{fs, path::Path};

/// Allowed units of an input, as recorded.
const INPUT_UNITS: [&str; 6] = ["m/s", "m", "N", "N m", "V", "A"];

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

/// Assignment of columns to quantities.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AxisColumns {
    /// Time (s).
    pub time: String,
    /// Input and its unit, as `column:unit`.
    pub input: String,
    /// Position column, if any.
    pub position: Option<String>,
    /// Velocity column, if any.
    pub velocity: Option<String>,
    /// Unit of position and, per second, velocity.
    pub position_unit: PositionUnit,
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
            input: input.to_owned(),
            position: None,
            velocity: None,
            position_unit: PositionUnit::default(),
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

    /// Check everything that does not need the table, and return the input's column and unit.
    ///
    /// # Errors
    /// See [`ColumnError`].
    pub fn checked_input(&self) -> Result<(&str, &'static str), ColumnError> {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-' || c == '.';
        if self.axis.is_empty() || !self.axis.chars().all(is_word) {
            return Err(ColumnError::AxisName { found: self.axis.clone() });
        }
        if self.position.is_none() && self.velocity.is_none() {
            return Err(ColumnError::NoMotion);
        }
        let wrong = || ColumnError::InputUnit { found: self.input.clone() };
        let (column, unit) = self.input.rsplit_once(':').ok_or_else(wrong)?;
        let unit = if unit == "Nm" { "N m" } else { unit };
        let unit = INPUT_UNITS.into_iter().find(|known| *known == unit).ok_or_else(wrong)?;
        Ok((column, unit))
    }
}

/// Error of a column assignment, which is a usage error.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ColumnError {
    /// Input without a known unit.
    #[error("input '{found}' is not COLUMN:UNIT with a unit of m/s, m, N, N m (or Nm), V, A")]
    InputUnit {
        /// Text given.
        found: String,
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

/// Import the table at `path`.
///
/// # Errors
/// When a column is missing, a cell is not a finite number, times do not increase, or a file cannot
/// be read or written.
pub fn import_csv(
    path: &Path,
    columns: &AxisColumns,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let (input, unit) = columns.checked_input()?;
    let bytes = fs::read(path).map_err(ImportError::io(path, "read"))?;
    let text = String::from_utf8_lossy(&bytes);
    let table = Table::parse(path, &text)?;
    let mut wanted = vec![columns.time.as_str(), input];
    wanted.extend(columns.position.as_deref());
    wanted.extend(columns.velocity.as_deref());
    let mut tape = Tape::default();
    let rows = table.numbers(&wanted, &mut tape)?;
    table.check_times(&columns.time, &rows)?;
    push_rows(&mut tape, columns, unit, &rows);
    let split = config.split_or_train();
    tape.mark_run(0, "unknown", &split.to_string());
    if let Some(first) = rows.first() {
        tape.metadata.insert("time_origin_s".to_owned(), first.values[0].to_string());
    }
    config.write(tape, path, split, &[identity(path)?])
}

fn push_rows(tape: &mut Tape, columns: &AxisColumns, unit: &str, rows: &[Row]) {
    let input_topic = topic::axis_input(&columns.axis);
    let output_topic = topic::axis_output(&columns.axis);
    let origin = rows.first().map_or(0.0, |row| row.values[0]);
    for row in rows {
        let time = Nanos(0).after_seconds(row.values[0] - origin);
        let input = AxisInput { value: row.values[1], unit: unit.to_owned() };
        let mut motion = row.values[2..].iter().copied();
        let output = AxisOutput {
            position: columns.position.as_ref().and_then(|_named| motion.next()),
            velocity: columns.velocity.as_ref().and_then(|_named| motion.next()),
            position_unit: columns.position_unit.name().to_owned(),
        };
        tape.push(&input_topic, time, Outgoing::AxisInput(input));
        tape.push(&output_topic, time, Outgoing::AxisOutput(output));
    }
}

/// Column names of the CSV table at `path`, in order.
///
/// # Errors
/// When the file cannot be read or has no rows.
pub fn column_names(path: &Path) -> Result<Vec<String>, ImportError> {
    let bytes = fs::read(path).map_err(ImportError::io(path, "read"))?;
    Ok(Table::parse(path, &String::from_utf8_lossy(&bytes))?.header)
}

/// Values of `columns` of the CSV table at `path`, row by row; the first column is the time.
///
/// # Errors
/// When a column is missing, a cell is empty or not a finite number, times do not increase, or the file
/// cannot be read.
pub fn read_columns(path: &Path, columns: &[&str]) -> Result<Vec<Vec<f64>>, ImportError> {
    let bytes = fs::read(path).map_err(ImportError::io(path, "read"))?;
    let text = String::from_utf8_lossy(&bytes);
    let table = Table::parse(path, &text)?;
    let mut tape = Tape::default();
    let rows = table.numbers(columns, &mut tape)?;
    if let Some(Notice::EmptyCells { rows, first_row }) = tape.notices.first() {
        let (path, count, row) = (path.to_owned(), *rows, *first_row);
        return Err(ImportError::EmptyCells { path, count, row });
    }
    if let Some(time) = columns.first() {
        table.check_times(time, &rows)?;
    }
    Ok(rows.into_iter().map(|row| row.values).collect())
}

/// Wanted numbers of one row.
struct Row {
    /// Row number from 1; the header is row 1.
    number: usize,
    values: Vec<f64>,
}

struct Table<'a> {
    path: &'a Path,
    header: Vec<String>,
    /// Row number and cells.
    rows: Vec<(usize, Vec<String>)>,
}

impl<'a> Table<'a> {
    fn parse(path: &'a Path, text: &str) -> Result<Self, ImportError> {
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
        let no_rows = || ImportError::NoRows { path: path.to_owned() };
        let (_, first) = lines.next().ok_or_else(no_rows)?;
        let occurrences = |separator: &char| first.matches(*separator).count();
        // Of equally frequent separators the last counts, so the comma is last.
        let separator = ['\t', ';', ','].into_iter().max_by_key(occurrences).unwrap_or(',');
        let header = split_line(first, separator);
        let rows: Vec<_> =
            lines.map(|(number, line)| (number, split_line(line, separator))).collect();
        if rows.is_empty() { Err(no_rows()) } else { Ok(Self { path, header, rows }) }
    }

    fn position_of(&self, column: &str) -> Result<usize, ImportError> {
        match self.header.iter().filter(|name| *name == column).count() {
            1 => {}
            0 => {
                return Err(ImportError::NoColumn {
                    path: self.path.to_owned(),
                    column: column.to_owned(),
                    found: self.header.clone(),
                });
            }
            count => {
                return Err(ImportError::ColumnTwice {
                    path: self.path.to_owned(),
                    column: column.to_owned(),
                    count,
                });
            }
        }
        Ok(self.header.iter().position(|name| name == column).unwrap_or(0))
    }

    /// Return the values of `columns` by row, without the rows that have an empty cell.
    fn numbers(&self, columns: &[&str], tape: &mut Tape) -> Result<Vec<Row>, ImportError> {
        let positions: Vec<usize> =
            columns.iter().map(|column| self.position_of(column)).collect::<Result<_, _>>()?;
        let mut rows = Vec::with_capacity(self.rows.len());
        let mut empty: Option<(usize, usize)> = None;
        let mut not_finite: Vec<Option<(usize, usize)>> = vec![None; columns.len()];
        for (number, cells) in &self.rows {
            let cell = |position: &usize| cells.get(*position).map_or("", String::as_str);
            if positions.iter().any(|position| cell(position).is_empty()) {
                empty.get_or_insert((0, *number)).0 += 1;
                continue;
            }
            let mut values = Vec::with_capacity(columns.len());
            for (index, position) in positions.iter().enumerate() {
                let value = self.number(*number, columns[index], cell(position))?;
                if !value.is_finite() {
                    not_finite[index].get_or_insert((0, *number)).0 += 1;
                }
                values.push(value);
            }
            rows.push(Row { number: *number, values });
        }
        for (column, found) in columns.iter().zip(not_finite) {
            if let Some((count, row)) = found {
                let place = format!("column '{column}'");
                return Err(ImportError::NotFinite {
                    path: self.path.to_owned(),
                    place,
                    count,
                    row,
                });
            }
        }
        if let Some((rows, first_row)) = empty {
            tape.notices.push(Notice::EmptyCells { rows, first_row });
        }
        if rows.is_empty() {
            return Err(ImportError::NoRows { path: self.path.to_owned() });
        }
        Ok(rows)
    }

    fn number(&self, row: usize, column: &str, text: &str) -> Result<f64, ImportError> {
        text.parse().map_err(|_no_number| ImportError::NotANumber {
            path: self.path.to_owned(),
            row,
            column: column.to_owned(),
            found: text.to_owned(),
        })
    }

    fn check_times(&self, column: &str, rows: &[Row]) -> Result<(), ImportError> {
        for pair in rows.windows(2) {
            let [previous, found] = [pair[0].values[0], pair[1].values[0]];
            if found <= previous {
                return Err(ImportError::TimeNotAdvancing {
                    path: self.path.to_owned(),
                    row: pair[1].number,
                    column: column.to_owned(),
                    found,
                    previous,
                });
            }
        }
        Ok(())
    }
}

/// Split a line into trimmed cells. A cell in double quotes may hold the separator, and `""` a
/// quote.
fn split_line(line: &str, separator: char) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        let last = cells.len() - 1;
        match character {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cells[last].push('"');
            }
            '"' => quoted = !quoted,
            _ if character == separator && !quoted => cells.push(String::new()),
            _ => cells[last].push(character),
        }
    }
    cells.into_iter().map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{ExistingFile, Recording};
    use proptest::prelude::*;

    fn import(text: &str, columns: &AxisColumns) -> Result<(ImportReport, Recording), ImportError> {
        let folder = tempfile::tempdir().unwrap();
        let [source, output] = ["in.csv", "out.mcap"].map(|name| folder.path().join(name));
        fs::write(&source, text).unwrap();
        let config = ImportConfig::new(&output, ExistingFile::Refuse);
        let report = import_csv(&source, columns, &config).inspect_err(|_| {
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
        })?;
        Ok((report, Recording::open(&output).unwrap()))
    }

    fn columns() -> AxisColumns {
        AxisColumns::new("t", "u:Nm").position("x").velocity("v")
    }

    #[test]
    fn a_table_becomes_an_axis() {
        let text = "\u{FEFF}\"t\";u;v;x\r\n5.0;1;0.5;2\r\n\r\n5.001;-1e-3;0.6;2.5\r\n";
        let (report, recording) = import(text, &columns()).unwrap();
        assert!(!report.is_lossy(), "{report:?}");
        let input = recording.series::<AxisInput>("/axis/axis/input").unwrap();
        assert_eq!(input.times, [Nanos(0), Nanos(1_000_000)]);
        assert_eq!(input.values[1], AxisInput { value: -1e-3, unit: "N m".into() });
        let output = recording.series::<AxisOutput>("/axis/axis/output").unwrap();
        assert_eq!((output.values[1].position, output.values[1].velocity), (Some(2.5), Some(0.6)));
        assert_eq!(recording.info("time_origin_s"), Some("5"));
        assert_eq!(recording.markers().unwrap().values.len(), 2);
    }

    #[test]
    fn faults_name_file_row_and_column() {
        let fault = |text: &str| {
            let error = import(text, &columns()).unwrap_err().to_string();
            error.split_once("in.csv: ").unwrap().1.to_owned()
        };
        assert_eq!(fault("t,u,x\n0,1,2\n"), "no column 'v'; the columns are t, u, x");
        assert_eq!(fault("t,u,x,v\n0,1,2,3\n1,a,2,3\n"), "row 3, column 'u': 'a' is not a number");
        assert_eq!(
            fault("t,u,x,v\n0,1,2,3\n0,1,2,3\n"),
            "row 3, column 't': time 0 s does not come after 0 s; sort the rows and remove duplicates"
        );
        assert_eq!(
            fault("t,u,x,v\n0,1,nan,3\n1,1,inf,3\n"),
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
    fn rows_with_empty_cells_are_skipped_and_counted() {
        let (report, _) = import("t,u,x,v\n0,1,2,3\n1,,2,3\n2,1,2\n3,1,2,3\n", &columns()).unwrap();
        assert_eq!(report.notices, [Notice::EmptyCells { rows: 2, first_row: 3 }]);
        assert!(report.is_lossy());
    }

    #[test]
    fn column_maps_are_checked_first() {
        let wrong = |columns: AxisColumns| columns.checked_input().unwrap_err().to_string();
        assert_eq!(
            wrong(AxisColumns::new("t", "u:kN").position("x")),
            "input 'u:kN' is not COLUMN:UNIT with a unit of m/s, m, N, N m (or Nm), V, A"
        );
        assert!(wrong(AxisColumns::new("t", "u").position("x")).contains("COLUMN:UNIT"));
        assert!(wrong(AxisColumns::new("t", "u:V")).contains("--position"));
        assert!(wrong(AxisColumns { axis: "a/b".into(), ..columns() }).contains("'a/b'"));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn any_text_is_imported_or_refused(text in "(t,u,x,v\n)?([0-9a-z,;\"\t \n.-]|nan|1e9,){0,80}") {
            import(&text, &columns()).ok();
        }
    }
}
