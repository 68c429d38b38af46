//! CSV tables as text: comments, header, separator, cells, and the wanted numbers of each row.

use crate::import::error::ImportError;
use std::path::Path;

/// Start of a comment line, which is skipped.
const COMMENT: char = '#';

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
    /// Rows without an empty cell in a wanted column; at least one.
    pub(super) rows: Vec<Row>,
    /// Number of skipped rows and line of the first one, where there are any.
    pub(super) skipped: Option<(usize, usize)>,
}

/// Table with a header; every cell is text.
pub(super) struct Table<'a> {
    path: &'a Path,
    /// Column names in order.
    pub(super) header: Vec<String>,
    is_below_comment: bool,
    /// Line of the file, from 1, and cells.
    rows: Vec<(usize, Vec<String>)>,
}

impl<'a> Table<'a> {
    /// Parse a table. Empty lines and lines that begin with `#` are skipped.
    pub(super) fn parse(path: &'a Path, text: &str) -> Result<Self, ImportError> {
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        let is_comment = |line: &str| line.trim_start().starts_with(COMMENT);
        let is_row = |line: &str| !line.trim().is_empty() && !is_comment(line);
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| is_row(line));
        let no_rows = || ImportError::NoRows { path: path.to_owned() };
        let (header_line, first) = lines.next().ok_or_else(no_rows)?;
        let occurrences = |separator: &char| first.matches(*separator).count();
        // Of equally frequent separators the last counts, so the comma is last.
        let separator = ['\t', ';', ','].into_iter().max_by_key(occurrences).unwrap_or(',');
        let header = split_line(first, separator);
        let rows: Vec<_> =
            lines.map(|(number, line)| (number, split_line(line, separator))).collect();
        if rows.is_empty() {
            return Err(no_rows());
        }
        let is_below_comment = text.lines().take(header_line - 1).any(is_comment);
        Ok(Self { path, header, is_below_comment, rows })
    }

    /// Return the values of `columns` and the text of the column `run` by row, without the rows that
    /// have an empty cell in one of them.
    pub(super) fn numbers(&self, columns: &[&str], run: Option<&str>) -> Result<Rows, ImportError> {
        let positions: Vec<usize> =
            columns.iter().map(|column| self.position_of(column)).collect::<Result<_, _>>()?;
        let run = run.map(|column| self.position_of(column)).transpose()?;
        let mut rows = Vec::with_capacity(self.rows.len());
        let mut skipped: Option<(usize, usize)> = None;
        for (number, cells) in &self.rows {
            let cell = |position: usize| cells.get(position).map_or("", String::as_str);
            if positions.iter().copied().chain(run).any(|position| cell(position).is_empty()) {
                skipped.get_or_insert((0, *number)).0 += 1;
                continue;
            }
            let values: Vec<f64> = columns
                .iter()
                .zip(&positions)
                .map(|(column, position)| self.number(*number, column, cell(*position)))
                .collect::<Result<_, _>>()?;
            rows.push(Row { number: *number, values, run: run.map_or("", cell).to_owned() });
        }
        self.check_finite(columns, &rows)?;
        if rows.is_empty() {
            return Err(ImportError::NoRows { path: self.path.to_owned() });
        }
        Ok(Rows { rows, skipped })
    }

    fn position_of(&self, column: &str) -> Result<usize, ImportError> {
        let (path, column) = (self.path.to_owned(), column.to_owned());
        match self.header.iter().filter(|name| **name == column).count() {
            0 => {
                let hint = if self.is_below_comment {
                    "; the header is the first line without '#'"
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

    fn number(&self, row: usize, column: &str, text: &str) -> Result<f64, ImportError> {
        text.parse().map_err(|_no_number| ImportError::NotANumber {
            path: self.path.to_owned(),
            row,
            column: column.to_owned(),
            found: text.to_owned(),
        })
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
        assert_eq!(error("0,1\n# t,u\n1,2\n"), "in.csv: no column 't'; the columns are 0, 1");
    }

    #[test]
    fn the_run_is_any_text_but_empty() {
        let rows = parsed("run,u\n\"a, b\",1\n,2\n7,3\n").numbers(&["u"], Some("run")).unwrap();
        let runs: Vec<&str> = rows.rows.iter().map(|row| row.run.as_str()).collect();
        assert_eq!((runs, rows.skipped), (vec!["a, b", "7"], Some((1, 3))));
        let error = parsed("u\n1\n").numbers(&["u"], Some("run")).unwrap_err();
        assert!(error.to_string().contains("no column 'run'"), "{error}");
    }
}
