//! Result documents against the JSON Schemas that `klasktron schema` prints, by a small validator of the keywords that
//! these schemas use. `scripts/check_interop` does the same with an independent one.

use crate::support::{klasktron, said};
use serde_json::Value;

/// Keywords that only describe.
const DESCRIBING: [&str; 7] =
    ["$schema", "$id", "$defs", "title", "description", "pattern", "examples"];

/// The schema of `document`, as the program prints it.
pub(crate) fn schema(document: &str) -> Value {
    let (text, errors, status) = said(&klasktron(&["schema", document]));
    assert_eq!(status, 0, "{errors}");
    serde_json::from_str(&text).unwrap()
}

/// Panics where `value` departs from the schema of `document`.
pub(crate) fn assert_valid(document: &str, value: &Value) {
    let root = schema(document);
    let faults = Validator { root: &root }.faults(&root, value, document);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

struct Validator<'a> {
    root: &'a Value,
}

impl Validator<'_> {
    /// Departures of `value` at `place` from `schema`.
    fn faults(&self, schema: &Value, value: &Value, place: &str) -> Vec<String> {
        let keywords = schema.as_object().unwrap();
        let each = keywords.iter().filter(|(keyword, _)| !DESCRIBING.contains(&keyword.as_str()));
        each.flat_map(|(keyword, rule)| self.keyword(schema, (keyword, rule), value, place))
            .collect()
    }

    fn keyword(
        &self,
        schema: &Value,
        (keyword, rule): (&str, &Value),
        value: &Value,
        place: &str,
    ) -> Vec<String> {
        let number = || value.as_f64().zip(rule.as_f64());
        let holds = match keyword {
            "$ref" => {
                let name = rule.as_str().unwrap().strip_prefix("#/$defs/").unwrap();
                return self.faults(&self.root["$defs"][name], value, place);
            }
            "properties" => return self.properties(schema, value, place),
            "items" => {
                let items = value.as_array().map_or(&[][..], Vec::as_slice);
                let each = items.iter().enumerate();
                return each
                    .flat_map(|(k, own)| self.faults(rule, own, &format!("{place}/{k}")))
                    .collect();
            }
            "allOf" => {
                let all = rule.as_array().unwrap().iter();
                return all.flat_map(|own| self.faults(own, value, place)).collect();
            }
            "if" if self.faults(rule, value, place).is_empty() => {
                return self.faults(&schema["then"], value, place);
            }
            "anyOf" => {
                rule.as_array().unwrap().iter().any(|own| self.faults(own, value, place).is_empty())
            }
            "type" => match rule {
                Value::Array(kinds) => kinds.iter().any(|kind| is_of(kind, value)),
                kind => is_of(kind, value),
            },
            "const" => value == rule,
            "enum" => rule.as_array().unwrap().contains(value),
            "required" => value.as_object().is_none_or(|own| {
                rule.as_array().unwrap().iter().all(|key| own.contains_key(key.as_str().unwrap()))
            }),
            "minItems" => {
                value.as_array().is_none_or(|own| rule.as_u64().unwrap() <= own.len() as u64)
            }
            "maxItems" => {
                value.as_array().is_none_or(|own| own.len() as u64 <= rule.as_u64().unwrap())
            }
            "minimum" => number().is_none_or(|(own, least)| least <= own),
            "maximum" => number().is_none_or(|(own, most)| own <= most),
            "exclusiveMinimum" => number().is_none_or(|(own, least)| least < own),
            "if" | "then" | "additionalProperties" => true,
            other => panic!("{place}: the keyword {other} is not known to this validator"),
        };
        if holds {
            Vec::new()
        } else {
            vec![format!("{place}: {value} departs from {keyword} {rule}")]
        }
    }

    fn properties(&self, schema: &Value, value: &Value, place: &str) -> Vec<String> {
        let Some(own) = value.as_object() else { return Vec::new() };
        let others = schema.get("additionalProperties");
        own.iter()
            .flat_map(|(key, value)| {
                let place = format!("{place}/{key}");
                match (schema["properties"].get(key), others) {
                    (Some(schema), _) => self.faults(schema, value, &place),
                    (None, Some(Value::Bool(false))) => vec![format!("{place}: unknown key")],
                    (None, Some(schema @ Value::Object(_))) => self.faults(schema, value, &place),
                    (None, _) => Vec::new(),
                }
            })
            .collect()
    }
}

fn is_of(kind: &Value, value: &Value) -> bool {
    match kind.as_str().unwrap() {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.as_f64().is_some_and(|own| own.fract() == 0.0),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("unknown type {other}"),
    }
}

#[test]
fn every_schema_is_of_the_current_draft_with_a_version_and_no_unknown_keys() {
    for (document, version) in
        [("gap", 2), ("twin", 2), ("ekf", 2), ("score", 2), ("info", 2), ("sweep", 1)]
    {
        let schema = schema(document);
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
        assert_eq!(schema["properties"]["schema_version"]["const"], version, "{document}");
        assert_eq!(schema["additionalProperties"], false, "{document}");
    }
}

#[test]
fn what_departs_from_a_schema_is_found() {
    let schema = schema("twin");
    let validator = Validator { root: &schema };
    let twin = serde_json::json!({
        "schema_version": 2, "machine": "table", "striker_mass_kg": 0.012,
        "belt_metres_per_turn": 0.04, "effects": [],
    });
    assert_eq!(validator.faults(&schema, &twin, "twin"), Vec::<String>::new());
    for (key, value) in [
        ("schema_version", serde_json::json!(1)),
        ("striker_mass_kg", serde_json::json!(0.0)),
        ("tuned_mass_kg", serde_json::json!(2.0)),
        ("effects", serde_json::json!([{"name": "drive.delay"}])),
    ] {
        let mut wrong = twin.clone();
        wrong[key] = value;
        assert!(!validator.faults(&schema, &wrong, "twin").is_empty(), "{key}");
    }
}
