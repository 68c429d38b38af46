//! What the program said about a case, read from `gap.json` without trusting its shape.

use serde_json::Value;
use std::{collections::BTreeSet, fs, path::Path};

/// A parameter as stated, with its interval.
#[derive(Debug, Clone)]
pub(crate) struct StatedParameter {
    pub(crate) name: String,
    pub(crate) value: f64,
    pub(crate) interval: Option<[f64; 2]>,
}

/// A named effect.
#[derive(Debug, Clone)]
pub(crate) struct StatedEffect {
    pub(crate) name: String,
    pub(crate) axis: String,
    pub(crate) parameters: Vec<StatedParameter>,
}

/// A parameter that moved.
#[derive(Debug, Clone)]
pub(crate) struct Moved {
    pub(crate) name: String,
    pub(crate) before: Option<f64>,
    pub(crate) after: Option<f64>,
    pub(crate) interval: Option<[f64; 2]>,
}

/// A row of the gap.
#[derive(Debug, Clone)]
pub(crate) struct GapRow {
    pub(crate) signal: String,
    pub(crate) unit: String,
    pub(crate) floor: Option<f64>,
    pub(crate) before: f64,
    pub(crate) after: f64,
}

/// The document.
#[derive(Debug, Clone, Default)]
pub(crate) struct Said {
    pub(crate) verdict: String,
    pub(crate) effects: Vec<StatedEffect>,
    pub(crate) class: BTreeSet<String>,
    /// Name and reason of what was rejected.
    pub(crate) rejected: Vec<(String, String)>,
    pub(crate) gap: Vec<GapRow>,
    pub(crate) moved: Vec<Moved>,
    /// Domain and axis of the first places.
    pub(crate) places: Vec<(String, String)>,
    pub(crate) next_experiment: bool,
}

fn list<'a>(document: &'a Value, key: &str) -> &'a [Value] {
    document.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn text(value: &Value, key: &str) -> String {
    match value.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(parts)) => {
            parts.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(",")
        }
        _ => String::new(),
    }
}

fn number(value: &Value, key: &str) -> Option<f64> {
    value.get(key).and_then(Value::as_f64)
}

fn interval(value: &Value) -> Option<[f64; 2]> {
    let pair = value.get("ci95")?.as_array()?;
    Some([pair.first()?.as_f64()?, pair.get(1)?.as_f64()?])
}

/// Catalogue names anywhere within `value`: texts with a dot and without spaces.
fn names(value: &Value, out: &mut BTreeSet<String>) {
    match value {
        Value::String(text) if text.contains('.') && !text.contains(' ') => {
            out.insert(text.clone());
        }
        Value::Array(parts) => parts.iter().for_each(|part| names(part, out)),
        Value::Object(map) => map.values().for_each(|part| names(part, out)),
        _ => {}
    }
}

/// Reads `gap.json`; `None` when there is none or it is no JSON.
pub(crate) fn read(path: &Path) -> Option<Said> {
    let document: Value = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
    let mut class = BTreeSet::new();
    list(&document, "indistinguishable").iter().for_each(|set| names(set, &mut class));
    Some(Said {
        verdict: text(&document, "verdict"),
        effects: list(&document, "effects").iter().map(effect).collect(),
        class,
        rejected: list(&document, "rejected")
            .iter()
            .map(|entry| (text(entry, "name"), text(entry, "reason")))
            .collect(),
        gap: list(&document, "residuals").iter().filter_map(gap_row).collect(),
        moved: list(&document, "parameter_changes").iter().map(moved).collect(),
        places: list(&document, "localization")
            .iter()
            .map(|place| (text(place, "stage"), text(place, "location")))
            .collect(),
        next_experiment: document.get("next_experiment").is_some_and(|next| !next.is_null()),
    })
}

fn effect(value: &Value) -> StatedEffect {
    let parameter = |value: &Value| {
        Some(StatedParameter {
            name: text(value, "name"),
            value: number(value, "value")?,
            interval: interval(value),
        })
    };
    StatedEffect {
        name: text(value, "name"),
        axis: text(value, "location"),
        parameters: list(value, "parameters").iter().filter_map(parameter).collect(),
    }
}

fn moved(value: &Value) -> Moved {
    Moved {
        name: text(value, "name"),
        before: number(value, "before"),
        after: number(value, "after"),
        interval: interval(value),
    }
}

fn gap_row(value: &Value) -> Option<GapRow> {
    Some(GapRow {
        signal: format!("{} {}", text(value, "signal"), text(value, "band")),
        unit: text(value, "unit"),
        floor: number(value, "noise_floor"),
        before: number(value, "validation_before")?,
        after: number(value, "validation_after")?,
    })
}
