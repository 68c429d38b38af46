//! Finished points as a table with one row each.

use super::{Plan, Point, Store, SweepError};
use crate::{
    parallel::in_parallel,
    recording::{
        ExistingFile,
        table::{Column, ColumnFormat, Values, write_columns},
    },
};
use serde::Serialize;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::Better;

/// Metric of a comparison.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Metric {
    /// Path into the result document: names and indices separated by dots. `*` averages over all
    /// elements of a list; `a/b` at the end divides a value by its neighbour.
    pub path: String,
    /// Description with the unit.
    pub title: String,
    /// Direction.
    #[serde(serialize_with = "as_name")]
    pub better: Better,
}

fn as_name<S: serde::Serializer>(better: &Better, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(better.name())
}

impl Metric {
    /// Value of the metric in `result`; `None` if it is missing or not a number.
    #[must_use]
    pub fn of(&self, result: &Value) -> Option<f64> {
        let parts: Vec<&str> = self.path.split('.').collect();
        crate::stats::mean(&figures(result, &parts))
    }
}

fn figures(value: &Value, path: &[&str]) -> Vec<f64> {
    let Some((first, rest)) = path.split_first() else {
        return value.as_f64().into_iter().collect();
    };
    match value {
        Value::Array(list) if *first == "*" => {
            list.iter().flat_map(|one| figures(one, rest)).collect()
        }
        Value::Array(list) => {
            let one = first.parse().ok().and_then(|index: usize| list.get(index));
            one.map_or_else(Vec::new, |one| figures(one, rest))
        }
        Value::Object(fields) => match (fields.get(*first), first.split_once('/')) {
            (Some(one), _) => figures(one, rest),
            (None, Some((above, below))) if rest.is_empty() => {
                let number = |name: &str| fields.get(name).and_then(Value::as_f64);
                let ratio = number(above).zip(number(below)).map(|(above, below)| above / below);
                ratio.filter(|ratio| ratio.is_finite()).into_iter().collect()
            }
            _ => Vec::new(),
        },
        _ => Vec::new(),
    }
}

/// A finished point.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Index among the points of the plan.
    pub index: usize,
    /// Exit status, 0 or 3.
    pub status: i32,
    /// Last message, if the status is 3.
    pub remark: Option<String>,
    /// Commit of the program that made it.
    pub git_hash: String,
    /// Value of the metric.
    pub metric: Option<f64>,
    /// All values of its result by path.
    pub figures: BTreeMap<String, Value>,
}

/// Maximum number of list elements in the table; longer lists are data.
const MOST_ELEMENTS: usize = 8;
/// Maximum length of a text in the table.
const LONGEST_TEXT: usize = 80;
/// Parts of results about provenance, which have columns of their own or none.
const LEFT_OUT: [&str; 6] =
    ["provenance", "settings", "command_line", "git_hash", "schema_version", "crate_version"];

/// Rows of the points of `plan` that are in `finished`, in the order of the plan, and the points
/// whose files cannot be read.
#[must_use]
pub fn rows<'a>(
    plan: &'a Plan,
    store: &Store,
    finished: &BTreeSet<String>,
) -> (Vec<Row>, Vec<&'a Point>) {
    let there: Vec<(usize, &Point)> = plan
        .points
        .iter()
        .enumerate()
        .filter(|(_, point)| finished.contains(&point.hash))
        .collect();
    let read = in_parallel(&there, |(index, point)| {
        let (record, result) = store.read(point)?;
        let mut figures = BTreeMap::new();
        flatten(&result, String::new(), ListKind::Outer, &mut figures);
        let metric = plan.metric.of(&result);
        let (index, status, remark) = (*index, record.status, record.remark);
        Some(Row { index, status, remark, git_hash: record.git_hash, metric, figures })
    });
    let unreadable = there.iter().zip(&read).filter(|(_, row)| row.is_none());
    let unreadable = unreadable.map(|((_, point), _)| *point).collect();
    (read.into_iter().flatten().collect(), unreadable)
}

/// Nesting of a list: lists of lists are data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ListKind {
    Outer,
    Inner,
}

fn flatten(value: &Value, path: String, kind: ListKind, figures: &mut BTreeMap<String, Value>) {
    let below =
        |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
    match value {
        Value::Object(fields) => {
            for (name, one) in fields {
                if !(path.is_empty() && LEFT_OUT.contains(&name.as_str())) {
                    flatten(one, below(name), kind, figures);
                }
            }
        }
        Value::Array(list) if list.len() <= MOST_ELEMENTS && kind == ListKind::Outer => {
            for (index, one) in list.iter().enumerate() {
                flatten(one, below(&index.to_string()), ListKind::Inner, figures);
            }
        }
        Value::Number(_) | Value::Bool(_) => {
            figures.insert(path, value.clone());
        }
        Value::String(text) if text.len() <= LONGEST_TEXT => {
            figures.insert(path, value.clone());
        }
        _ => {}
    }
}

/// Write `table.csv` and `table.parquet` into `folder`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_tables(plan: &Plan, rows: &[Row], folder: &Path) -> Result<(), SweepError> {
    let columns = columns(plan, rows);
    for (name, format) in
        [("table.csv", ColumnFormat::Csv), ("table.parquet", ColumnFormat::Parquet)]
    {
        write_columns(&columns, rows.len(), &folder.join(name), format, ExistingFile::Replace)?;
    }
    Ok(())
}

/// Columns: point, options, seed, status, metric, then every value by its path.
fn columns(plan: &Plan, rows: &[Row]) -> Vec<Column> {
    let points: Vec<&Point> = rows.iter().map(|row| &plan.points[row.index]).collect();
    let text = |of: &dyn Fn(&Point) -> Option<String>| {
        Values::Text(points.iter().map(|point| of(point)).collect())
    };
    let mut columns =
        vec![Column { name: "point".to_owned(), values: text(&|point| Some(point.hash.clone())) }];
    let options: BTreeSet<&String> =
        points.iter().flat_map(|point| point.settings.keys()).collect();
    for option in options {
        let words = points.iter().map(|point| point.settings.get(option).map(String::as_str));
        columns.push(Column { name: option.clone(), values: of_words(&words.collect::<Vec<_>>()) });
    }
    let seeds = Values::Unsigned(points.iter().map(|point| point.seed).collect());
    columns.push(Column { name: "seed".to_owned(), values: seeds });
    let status = Values::Int(rows.iter().map(|row| Some(i64::from(row.status))).collect());
    columns.push(Column { name: "status".to_owned(), values: status });
    let metric = Values::F64(rows.iter().map(|row| row.metric).collect());
    columns.push(Column { name: "metric".to_owned(), values: metric });
    let paths: BTreeSet<&String> = rows.iter().flat_map(|row| row.figures.keys()).collect();
    for path in paths {
        let values: Vec<Option<&Value>> = rows.iter().map(|row| row.figures.get(path)).collect();
        columns.push(Column { name: format!("result.{path}"), values: of_values(&values) });
    }
    columns
}

/// Numbers if every word is one, otherwise text.
fn of_words(words: &[Option<&str>]) -> Values {
    let numbers: Option<Vec<Option<f64>>> = words
        .iter()
        .map(|word| word.map_or(Some(None), |word| word.parse::<f64>().ok().map(Some)))
        .collect();
    let whole: Option<Vec<Option<i64>>> = words
        .iter()
        .map(|word| word.map_or(Some(None), |word| word.parse::<i64>().ok().map(Some)))
        .collect();
    match (whole, numbers) {
        (Some(whole), _) => Values::Int(whole),
        (None, Some(numbers)) => Values::F64(numbers),
        (None, None) => Values::Text(words.iter().map(|word| word.map(str::to_owned)).collect()),
    }
}

/// The narrowest column that holds all `values`.
fn of_values(values: &[Option<&Value>]) -> Values {
    let all = |is: fn(&Value) -> bool| values.iter().flatten().all(|value| is(value));
    if all(Value::is_boolean) {
        Values::Bool(values.iter().map(|value| value.and_then(Value::as_bool)).collect())
    } else if all(Value::is_i64) {
        Values::Int(values.iter().map(|value| value.and_then(Value::as_i64)).collect())
    } else if all(Value::is_number) {
        Values::F64(values.iter().map(|value| value.and_then(Value::as_f64)).collect())
    } else {
        let text = |value: &Value| match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        Values::Text(values.iter().map(|value| value.map(text)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn metric(path: &str) -> Metric {
        Metric { path: path.to_owned(), title: String::new(), better: Better::Larger }
    }

    #[test]
    fn a_path_finds_its_figure() {
        let result = json!({"a": [{"b": 1.0}, {"b": null}, {"b": 4}], "c": {"d": [7]}, "e": "x"});
        assert_eq!(metric("a.0.b").of(&result), Some(1.0));
        assert_eq!(metric("a.*.b").of(&result), Some(2.5));
        assert_eq!(metric("c.d.0").of(&result), Some(7.0));
        let gap = json!({"gap": [{"x": 3.0, "n": 2.0}, {"x": 1.0, "n": null}, {"x": 1.0, "n": 0}]});
        assert_eq!(metric("gap.*.x/n").of(&gap), Some(1.5));
        for absent in ["a.1.b", "a.9.b", "c", "e", "x.y", ""] {
            assert_eq!(metric(absent).of(&result), None, "{absent}");
        }
    }

    #[test]
    fn single_figures_are_flattened_and_long_lists_left_out() {
        let long: Vec<u8> = (0..9).collect();
        let result = json!({
            "x": {"y": [1, 2.5]}, "deep": [{"list": [1]}], "long": long, "yes": true, "none": null, "word": "ok",
            "provenance": {"git_hash": "abc"},
        });
        let mut found = BTreeMap::new();
        flatten(&result, String::new(), ListKind::Outer, &mut found);
        let names: Vec<&str> = found.keys().map(String::as_str).collect();
        assert_eq!(names, ["word", "x.y.0", "x.y.1", "yes"]);
    }

    #[test]
    fn columns_are_as_narrow_as_their_values() {
        assert_eq!(of_words(&[Some("1"), None]), Values::Int(vec![Some(1), None]));
        assert_eq!(of_words(&[Some("1"), Some("0.5")]), Values::F64(vec![Some(1.0), Some(0.5)]));
        let text = Values::Text(vec![Some("8,8".to_owned()), Some("16".to_owned())]);
        assert_eq!(of_words(&[Some("8,8"), Some("16")]), text);
        let (one, half) = (json!(1), json!(0.5));
        assert_eq!(of_values(&[Some(&one), Some(&half)]), Values::F64(vec![Some(1.0), Some(0.5)]));
        assert_eq!(of_values(&[Some(&one), None]), Values::Int(vec![Some(1), None]));
    }
}
