//! CSV tables as text: comments, header, separator, cells, and the wanted numbers of each row.

use crate::import::error::ImportError;
use chrono::{DateTime, NaiveDate, NaiveDateTime, NaiveTime};
use std::path::Path;

/// Texts of a missing number, besides an empty cell, in any case of letters.
const MISSING: [&str; 5] = ["nan", "na", "n/a", "null", "none"];

/// Start of a comment line, which is skipped.
const COMMENT: char = '#';

/// Most rows of text, such as units, between the header and the first number.
const MOST_TEXT_ROWS: usize = 2;

/// Forms of a date with a time of day, besides RFC 3339.
const DATE_TIMES: [&str; 4] = [
    "%Y-%m-%dT%H:%M:%S%.f",
    "%Y-%m-%d %H:%M:%S%.f",
    "%Y/%m/%d %H:%M:%S%.f",
    "%d.%m.%Y %H:%M:%S%.f",
];

/// Form of a time of day.
const TIME_OF_DAY: &str = "%H:%M:%S%.f";

/// Wanted numbers of one row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    /// Line of the file, from 1.
    pub(super) number: usize,
    /// One finite value per wanted column.
    pub(super) values: Vec<f64>,
    /// Text of the run column; empty without one.
    pub(super) run: String,
}

/// Wanted rows of a table.
#[derive(Debug)]
pub(super) struct Rows {
    /// Rows with a value in every wanted column; at least one.
    pub(super) rows: Vec<Row>,
    /// Number of skipped rows and line of the first one, where there are any.
    pub(super) skipped: Option<(usize, usize)>,
    /// Lines of text below the header, such as units, with their cells.
    pub(super) texts: Vec<(usize, Vec<String>)>,
    /// `true` if the first wanted column holds dates or times of day, which are now in seconds.
    pub(super) has_clock: bool,
}

/// Character that separates the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    Character(char),
    /// One or more spaces or tabs.
    Whitespace,
}

impl Separator {
    /// Most frequent of comma, semicolon and tab in the header, or white space without any of them.
    fn of(header: &str) -> Self {
        let occurrences = |separator: &char| header.matches(*separator).count();
        // Of equally frequent separators the last counts, so the comma is last.
        let most = ['\t', ';', ','].into_iter().max_by_key(occurrences).unwrap_or(',');
        match occurrences(&most) {
            0 => Self::Whitespace,
            _ => Self::Character(most),
        }
    }

    fn is(self, character: char) -> bool {
        match self {
            Self::Character(own) => own == character,
            Self::Whitespace => character.is_whitespace(),
        }
    }
}

/// Table with a header; every cell is text.
pub(super) struct Table<'a> {
    path: &'a Path,
    /// Column names in order.
    pub(super) header: Vec<String>,
    is_below_comment: bool,
    separator: Separator,
    /// Line of the file, from 1, and cells.
    rows: Vec<(usize, Vec<String>)>,
}

impl<'a> Table<'a> {
    /// Parse a table. Empty lines and lines that begin with `#` are skipped.
    pub(super) fn parse(path: &'a Path, text: &str) -> Result<Self, ImportError> {
        let is_comment = |line: &str| line.trim_start().starts_with(COMMENT);
        let is_row = |line: &str| !line.trim().is_empty() && !is_comment(line);
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| is_row(line));
        let no_rows = || ImportError::NoRows { path: path.to_owned() };
        let (header_line, first) = lines.next().ok_or_else(no_rows)?;
        let separator = Separator::of(first);
        let header = split_line(first, separator);
        let rows: Vec<_> =
            lines.map(|(number, line)| (number, split_line(line, separator))).collect();
        if rows.is_empty() {
            return Err(no_rows());
        }
        let is_below_comment = text.lines().take(header_line - 1).any(is_comment);
        Ok(Self { path, header, is_below_comment, separator, rows })
    }

    /// Return the values of `columns` and the text of the column `run` by row, without the rows that
    /// lack a value in one of them. The first column may hold dates or times of day instead of numbers.
    pub(super) fn numbers(&self, columns: &[&str], run: Option<&str>) -> Result<Rows, ImportError> {
        let positions: Vec<usize> =
            columns.iter().map(|column| self.position_of(column)).collect::<Result<_, _>>()?;
        let run = run.map(|column| self.position_of(column)).transpose()?;
        let form = self.number_form(&positions);
        let texts: Vec<(usize, Vec<String>)> = self.text_rows(&positions, form).to_vec();
        let mut rows = Vec::with_capacity(self.rows.len());
        let mut skipped: Option<(usize, usize)> = None;
        for (number, cells) in &self.rows[texts.len()..] {
            let cell = |position: usize| cell(cells, position);
            let lacks_run = run.is_some_and(|position| cell(position).is_empty());
            if lacks_run || positions.iter().any(|position| is_missing(cell(*position))) {
                skipped.get_or_insert((0, *number)).0 += 1;
                continue;
            }
            let value = |(index, column): (usize, &&str)| {
                let text = cell(positions[index]);
                let found = match form.clock {
                    true if index == 0 => clock_seconds(text),
                    _ => form.number(text),
                };
                found.ok_or_else(|| self.not_a_number(*number, column, text))
            };
            let values: Vec<f64> =
                columns.iter().enumerate().map(value).collect::<Result<_, _>>()?;
            rows.push(Row { number: *number, values, run: run.map_or("", cell).to_owned() });
        }
        self.check_finite(columns, &rows)?;
        if rows.is_empty() {
            return Err(ImportError::NoRows { path: self.path.to_owned() });
        }
        Ok(Rows { rows, skipped, texts, has_clock: form.clock })
    }

    /// Form of the numbers at `positions`, of which the first may hold dates or times of day.
    fn number_form(&self, positions: &[usize]) -> NumberForm {
        let is_comma = self.separator == Separator::Character(',');
        let mut wanted = self.rows.iter().flat_map(|(_, cells)| {
            positions.iter().skip(1).map(move |position| cell(cells, *position))
        });
        let plain = NumberForm { has_comma: false, clock: false };
        let has_comma =
            !is_comma && !wanted.any(|text| text.contains('.') && plain.number(text).is_some());
        let form = NumberForm { has_comma, clock: false };
        let times = self.rows.iter().map(|(_, cells)| cell(cells, positions[0]));
        let first = times
            .take(1 + MOST_TEXT_ROWS)
            .find(|text| form.number(text).is_some() || clock_seconds(text).is_some());
        NumberForm { clock: first.is_some_and(|text| form.number(text).is_none()), ..form }
    }

    /// First rows without a number at `positions`, such as units below the header; none if nothing follows them.
    fn text_rows(&self, positions: &[usize], form: NumberForm) -> &[(usize, Vec<String>)] {
        let is_value = |text: &str| form.number(text).is_some() || clock_seconds(text).is_some();
        let is_text = |(_, cells): &&(usize, Vec<String>)| {
            let mut wanted = positions.iter().map(|position| cell(cells, *position));
            wanted.clone().any(|text| !text.is_empty()) && !wanted.any(is_value)
        };
        let count = self.rows.iter().take_while(is_text).count();
        if count <= MOST_TEXT_ROWS && count < self.rows.len() { &self.rows[..count] } else { &[] }
    }

    fn position_of(&self, column: &str) -> Result<usize, ImportError> {
        let (path, column) = (self.path.to_owned(), column.to_owned());
        match self.header.iter().filter(|name| **name == column).count() {
            0 => {
                let is_number = |name: &String| name.parse::<f64>().is_ok();
                let hint = if self.is_below_comment {
                    "; the header is the first line without '#'"
                } else if self.header.iter().all(is_number) {
                    "; the first line holds numbers, so add a line with column names above it"
                } else {
                    ""
                };
                let (found, hint) = (self.header.clone(), hint.to_owned());
                Err(ImportError::NoColumn { path, column, found, hint })
            }
            1 => Ok(self.header.iter().position(|name| *name == column).unwrap_or(0)),
            count => Err(ImportError::ColumnTwice { path, column, count }),
        }
    }

    fn not_a_number(&self, row: usize, column: &str, found: &str) -> ImportError {
        let (path, column, found) = (self.path.to_owned(), column.to_owned(), found.to_owned());
        ImportError::NotANumber { path, row, column, found }
    }

    fn check_finite(&self, columns: &[&str], rows: &[Row]) -> Result<(), ImportError> {
        for (index, column) in columns.iter().enumerate() {
            let mut wrong = rows.iter().filter(|row| !row.values[index].is_finite());
            if let Some(first) = wrong.next() {
                return Err(ImportError::NotFinite {
                    path: self.path.to_owned(),
                    place: format!("column '{column}'"),
                    count: 1 + wrong.count(),
                    row: first.number,
                });
            }
        }
        Ok(())
    }
}

/// Form of the numbers of a table.
#[derive(Debug, Clone, Copy)]
struct NumberForm {
    /// `true` if a comma may be the decimal sign: the separator is another one, and no number has a point.
    has_comma: bool,
    /// `true` if the first wanted column holds dates or times of day.
    clock: bool,
}

impl NumberForm {
    fn number(self, text: &str) -> Option<f64> {
        let with_point = || text.replacen(',', ".", 1).parse().ok();
        text.parse().ok().or_else(|| if self.has_comma { with_point() } else { None })
    }
}

/// Cell at `position`; empty beyond the end of its line.
fn cell(cells: &[String], position: usize) -> &str {
    cells.get(position).map_or("", String::as_str)
}

/// Return whether a cell says that there is no number: empty, or one of [`MISSING`].
fn is_missing(text: &str) -> bool {
    text.is_empty() || MISSING.iter().any(|own| text.eq_ignore_ascii_case(own))
}

/// Seconds of a date with a time of day since 1970, or of a time of day since midnight.
fn clock_seconds(text: &str) -> Option<f64> {
    if !text.contains(':') {
        return None;
    }
    let text = text.replacen(',', ".", 1);
    let of_date = |time: NaiveDateTime| time.and_utc();
    let zoned = DateTime::parse_from_rfc3339(&text).map(|time| time.to_utc()).ok();
    let dated = || {
        let parsed = |form: &&str| NaiveDateTime::parse_from_str(&text, form).ok();
        DATE_TIMES.iter().find_map(parsed).map(of_date)
    };
    let of_day = || {
        let time = NaiveTime::parse_from_str(&text, TIME_OF_DAY).ok()?;
        Some(of_date(NaiveDate::default().and_time(time)))
    };
    let time = zoned.or_else(dated).or_else(of_day)?;
    Some(time.timestamp() as f64 + 1e-9 * f64::from(time.timestamp_subsec_nanos()))
}

/// Split a line into trimmed cells. A cell in double quotes may hold the separator, and `""` a
/// quote. Several characters of white space separate two cells, not more.
fn split_line(line: &str, separator: Separator) -> Vec<String> {
    let line = if separator == Separator::Whitespace { line.trim() } else { line };
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
            _ if separator.is(character) && !quoted => {
                let is_next = characters.peek().is_some_and(|next| separator.is(*next));
                if separator != Separator::Whitespace || !is_next {
                    cells.push(String::new());
                }
            }
            _ => cells[last].push(character),
        }
    }
    cells.into_iter().map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Table<'_> {
        Table::parse(Path::new("in.csv"), text).unwrap()
    }

    #[test]
    fn comments_and_empty_lines_are_no_rows() {
        let table = parsed("# bench 3\n\nt;u\n0;1\n  # pause\n1;2\n\"#3\";4\n");
        assert_eq!(table.header, ["t", "u"]);
        let rows: Vec<usize> = table.rows.iter().map(|(number, _)| *number).collect();
        assert_eq!(rows, [4, 6, 7], "lines of the file; a quoted # is a cell");
        let rows = parsed("t;u\n# a\n0;1\n").numbers(&["u"], None).unwrap();
        assert_eq!(rows.rows, [Row { number: 3, values: vec![1.0], run: String::new() }]);
        assert_eq!(rows.skipped, None, "a comment is no loss");
        assert!(Table::parse(Path::new("in.csv"), "# t,u\n# 0,1\n").is_err());
    }

    #[test]
    fn a_header_in_a_comment_is_explained() {
        let error = |text: &str| parsed(text).numbers(&["t"], None).unwrap_err().to_string();
        assert_eq!(
            error("# t,u\n0,1\n1,2\n"),
            "in.csv: no column 't'; the columns are 0, 1; the header is the first line without '#'"
        );
        assert_eq!(
            error("0,1\n# t,u\n1,2\n"),
            "in.csv: no column 't'; the columns are 0, 1; the first line holds numbers, so add a line with column \
             names above it"
        );
    }

    #[test]
    fn the_run_is_any_text_but_empty() {
        let rows = parsed("run,u\n\"a, b\",1\n,2\n7,3\n").numbers(&["u"], Some("run")).unwrap();
        let runs: Vec<&str> = rows.rows.iter().map(|row| row.run.as_str()).collect();
        assert_eq!((runs, rows.skipped), (vec!["a, b", "7"], Some((1, 3))));
        let error = parsed("u\n1\n").numbers(&["u"], Some("run")).unwrap_err();
        assert!(error.to_string().contains("no column 'run'"), "{error}");
    }

    /// Values of the columns t and u, and the number of text rows.
    fn values(text: &str) -> (Vec<[f64; 2]>, usize) {
        let rows = parsed(text).numbers(&["t", "u"], None).unwrap();
        (rows.rows.iter().map(|row| [row.values[0], row.values[1]]).collect(), rows.texts.len())
    }

    #[test]
    fn separators_and_decimal_signs_do_not_change_the_numbers() {
        let expected = (vec![[0.0, -1.5], [0.25, 2e3]], 0);
        for text in [
            "t,u\n0,-1.5\n0.25,2e3\n",
            "t;u\n0;-1.5\n0.25;2e3\n",
            "t;u\n0,0;-1,5\n0,25;2e3\n",
            "t\tu\n0,0\t-1,5\n0,25\t2,0e3\n",
            "t u\n0 -1.5\n0.25 2e3\n",
            "  t    u\n  0   -1.5\n  0.25  2e3  \n",
            "t  u\n0 -1,5\n0,25\t2e3\n",
        ] {
            assert_eq!(values(text), expected, "{text}");
        }
        // In a table with decimal points, a comma separates thousands.
        let error = parsed("t;u\n0;1,500\n1;2.5\n").numbers(&["t", "u"], None).unwrap_err();
        assert!(
            error.to_string().ends_with("row 2, column 'u': '1,500' is not a number"),
            "{error}"
        );
    }

    #[test]
    fn rows_without_a_value_are_skipped_and_counted() {
        let rows = parsed("t,u\n0,1\n1,NaN\n2,\n3,N/A\n4,2\n").numbers(&["t", "u"], None).unwrap();
        let values: Vec<&[f64]> = rows.rows.iter().map(|row| &row.values[..]).collect();
        assert_eq!(values, [[0.0, 1.0], [4.0, 2.0]]);
        assert_eq!(rows.skipped, Some((3, 3)));
        // A run may be called none.
        let rows = parsed("run,u\nnone,1\nNA,2\n,3\n").numbers(&["u"], Some("run")).unwrap();
        let runs: Vec<&str> = rows.rows.iter().map(|row| row.run.as_str()).collect();
        assert_eq!((runs, rows.skipped), (vec!["none", "NA"], Some((1, 4))));
    }

    #[test]
    fn a_row_of_units_is_no_row_of_numbers() {
        assert_eq!(values("t,u\ns,N\n0,1\n1,2\n"), (vec![[0.0, 1.0], [1.0, 2.0]], 1));
        assert_eq!(values("t,u\ntime,force\n[s],\n0,1\n"), (vec![[0.0, 1.0]], 2));
        for wrong in
            ["t,u\na,b\nc,d\ne,f\n0,1\n", "t,u\na,b\n", "t,u\n0,1\ns,N\n", "t,u\n0,N\n1,2\n"]
        {
            let error = parsed(wrong).numbers(&["t", "u"], None).unwrap_err().to_string();
            assert!(error.contains("is not a number"), "{wrong}: {error}");
        }
    }

    #[test]
    fn dates_and_times_of_day_are_seconds() {
        for (text, seconds) in [
            ("1970-01-02T00:00:01.25", 86_401.25),
            ("1970-01-02 00:00:01,25", 86_401.25),
            ("1970-01-02T01:00:01.25+01:00", 86_401.25),
            ("1970-01-02T00:00:01.25Z", 86_401.25),
            ("1970/01/02 00:00:01.25", 86_401.25),
            ("02.01.1970 00:00:01.25", 86_401.25),
            ("00:10:00.5", 600.5),
        ] {
            assert_eq!(clock_seconds(text), Some(seconds), "{text}");
        }
        for text in ["12", "1:2", "25:00:00", "1970-13-01 00:00:00", "1970-01-01"] {
            assert_eq!(clock_seconds(text), None, "{text}");
        }
        let table = parsed("t,u\n12:00:00.000,1\n12:00:00.010,2\n");
        let rows = table.numbers(&["t", "u"], None).unwrap();
        assert!(rows.has_clock && (rows.rows[1].values[0] - 43_200.01).abs() < 1e-9);
        // Only the first wanted column is a time.
        assert!(table.numbers(&["u", "t"], None).is_err());
    }
}
