//! Catalogue as a document: JSON for programs, and the Markdown page `docs/effects.md`.

use super::{Axis, AxisScales, CATALOGUE, Domain, Effect, Regressor, Signal};
use serde::Serialize;
use std::fmt::Write as _;
use strsim::{jaro_winkler, levenshtein};

/// Version of the JSON document.
const SCHEMA_VERSION: u32 = 1;
/// Largest number of suggestions for an unknown name.
const SUGGESTIONS: usize = 3;
/// Least Jaro-Winkler similarity of a suggestion.
const SIMILAR: f64 = 0.75;

/// Largest difference of a suggestion's similarity from the best one.
const LESS_SIMILAR: f64 = 0.06;

/// The JSON document of `klasktron effects --json`.
#[derive(Debug, Serialize)]
pub struct Document {
    /// Version of this document.
    pub schema_version: u32,
    /// Effects in the order of the catalogue.
    pub effects: Vec<Entry>,
}

/// One effect of the document.
#[derive(Debug, Serialize)]
pub struct Entry {
    /// Dotted name.
    pub name: &'static str,
    /// One-line description.
    pub summary: &'static str,
    /// Part of the measured chain.
    pub domain: Domain,
    /// Axes on which the effect may act.
    pub locations: &'static [Axis],
    /// Equation in plain text.
    pub equation: &'static str,
    /// Parameters, in order.
    pub parameters: Vec<ParameterEntry>,
    /// Recorded signals that show the effect.
    pub signals: Vec<SignalEntry>,
    /// Quantities on which the residual depends.
    pub regressors: &'static [Regressor],
    /// Motion and sensors that excite and show the effect.
    pub excitation: &'static str,
    /// Pattern of `klasktron collect`, if one excites the effect.
    pub collect_pattern: Option<&'static str>,
    /// Effects with a similar residual under poor excitation.
    pub confused_with: &'static [&'static str],
    /// Publication, textbook or principle.
    pub reference: &'static str,
    /// Forms on a single axis, where they differ.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub single_axis: Vec<AxisForm>,
}

/// Form of an effect on a single axis, whose ranges follow from its recordings.
#[derive(Debug, Serialize)]
pub struct AxisForm {
    /// One-line description.
    pub summary: &'static str,
    /// Equation in plain text.
    pub equation: &'static str,
    /// Name, symbol and unit of each parameter, in order. Lengths and forces are in the units of the axis.
    pub parameters: Vec<[&'static str; 3]>,
}

impl AxisForm {
    /// Forms of `effect` that differ from the one on a table.
    #[must_use]
    pub fn all(effect: &'static Effect) -> Vec<Self> {
        let of_form = |form: &'static Effect| Self {
            summary: form.summary,
            equation: form.equation,
            parameters: form
                .parameters
                .iter()
                .map(|own| [own.name, own.symbol, AxisScales::plain_unit(own.unit)])
                .collect(),
        };
        effect.axis_forms().into_iter().map(of_form).collect()
    }
}

/// One parameter of an effect.
#[derive(Debug, Serialize)]
pub struct ParameterEntry {
    /// Name with its unit.
    pub name: &'static str,
    /// Symbol in the equation.
    pub symbol: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// Typical range.
    pub typical: [f64; 2],
    /// Hard bounds of a fit.
    pub bounds: [f64; 2],
    /// Value without effect.
    pub without_effect: f64,
    /// True for a value of a session, false for a value of the machine.
    pub per_session: bool,
}

/// One signal of an effect.
#[derive(Debug, Serialize)]
pub struct SignalEntry {
    /// Name of the signal.
    pub signal: Signal,
    /// Topic of the data contract.
    pub topic: &'static str,
}

impl Document {
    /// Document of `effects`.
    #[must_use]
    pub fn of(effects: &[&'static Effect]) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            effects: effects.iter().copied().map(Entry::of).collect(),
        }
    }
}

impl Entry {
    fn of(effect: &'static Effect) -> Self {
        let parameters =
            effect.parameters.iter().zip(effect.null).map(|(own, null)| ParameterEntry {
                name: own.name,
                symbol: own.symbol,
                unit: own.unit,
                typical: [own.plausible.0, own.plausible.1],
                bounds: [own.bounds.0, own.bounds.1],
                without_effect: *null,
                per_session: own.per_session,
            });
        let signals = effect.signals.iter();
        Self {
            name: effect.name,
            summary: effect.summary,
            domain: effect.domain,
            locations: effect.site.axes(),
            equation: effect.equation,
            parameters: parameters.collect(),
            signals: signals
                .map(|signal| SignalEntry { signal: *signal, topic: signal.topic() })
                .collect(),
            regressors: effect.regressors,
            excitation: effect.excitation,
            collect_pattern: Some(effect.experiment).filter(|pattern| !pattern.is_empty()),
            confused_with: effect.confused_with,
            reference: effect.reference,
            single_axis: AxisForm::all(effect),
        }
    }
}

/// Symbols that the equations share.
pub const SYMBOLS: [(&str, &str); 9] = [
    ("u, r", "input of the drive, setpoint of its velocity loop"),
    ("q, v, a", "position, velocity and acceleration along the axis"),
    ("x, y", "position in the board frame"),
    ("F, F_f, Δ|F_f|", "force of the motor, friction force, change of the friction level"),
    ("M, m_s", "moving mass, mass of the striker"),
    ("p, h", "position seen by the camera, height above the board"),
    ("v_n, v_t, s", "normal and tangential velocity and rim speed of the ball at a wall"),
    ("t", "time since the session began"),
    ("u′, p′, q′, v′", "the quantity after the effect"),
];

/// Shared symbols that occur in `equation`, with their meaning.
pub fn symbols_in(equation: &str) -> impl Iterator<Item = (&'static str, &'static str)> + use<'_> {
    let is_part = |c: char| c.is_alphabetic() || c.is_ascii_digit() || c == '_';
    let occurs = move |symbol: &str| {
        let mut places = equation.match_indices(symbol);
        places.any(|(at, _)| {
            let before = equation[..at].chars().next_back();
            let after = equation[at + symbol.len()..].chars().next();
            !before.is_some_and(is_part) && !after.is_some_and(is_part)
        })
    };
    SYMBOLS.into_iter().filter(move |(symbols, _)| symbols.split(", ").any(&occurs))
}

/// Effects with the name `pattern`, or in the group `pattern` such as `drive.friction`.
#[must_use]
pub fn select(pattern: &str) -> Vec<&'static Effect> {
    let group = format!("{pattern}.");
    let named = CATALOGUE.iter().copied();
    named.filter(|own| own.name == pattern || own.name.starts_with(&group)).collect()
}

/// Names similar to the unknown name `typed`, the most similar first; empty where none is similar.
///
/// ```
/// use klasktron::effects::document::similar;
/// assert_eq!(similar("drive.backlsh")[0], "drive.backlash");
/// assert_eq!(similar("backlash")[0], "drive.backlash");
/// ```
#[must_use]
pub fn similar(typed: &str) -> Vec<&'static str> {
    let score = |name: &str| {
        let parts = name.match_indices('.').map(|(dot, _)| &name[dot + 1..]);
        std::iter::once(name).chain(parts).map(|part| jaro_winkler(part, typed)).fold(0.0, f64::max)
    };
    let mut names: Vec<(f64, usize, &'static str)> = CATALOGUE
        .iter()
        .map(|effect| (score(effect.name), levenshtein(effect.name, typed), effect.name))
        .filter(|(score, ..)| SIMILAR <= *score)
        .collect();
    names.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let best = names.first().map_or(1.0, |first| first.0);
    names.retain(|(score, ..)| best - LESS_SIMILAR <= *score);
    names.into_iter().take(SUGGESTIONS).map(|(_, _, name)| name).collect()
}

/// Title of a domain: its name and what it covers.
#[must_use]
pub fn title(domain: Domain) -> &'static str {
    match domain {
        Domain::Drive => "drive: command, motor and belt",
        Domain::Gantry => "gantry: guides, bridge and frame",
        Domain::Coupling => "coupling: carriage to striker through the board",
        Domain::Ball => "ball: motion of the free ball",
        Domain::Impact => "impact: ball and walls",
        Domain::Sensor => "sensor: camera and encoders",
        Domain::Estimator => "estimator: state estimate",
    }
}

/// Domains in the order of the catalogue.
pub const DOMAINS: [Domain; 7] = [
    Domain::Drive,
    Domain::Gantry,
    Domain::Coupling,
    Domain::Ball,
    Domain::Impact,
    Domain::Sensor,
    Domain::Estimator,
];

/// The page `docs/effects.md`.
#[must_use]
pub fn markdown() -> String {
    let mut page = BEGIN.replace("{count}", &CATALOGUE.len().to_string());
    page.push_str("| symbol | meaning |\n|---|---|\n");
    for (symbol, meaning) in SYMBOLS {
        writeln!(page, "| {} | {meaning} |", cell(symbol)).ok();
    }
    for domain in DOMAINS {
        writeln!(page, "\n## {}", heading(title(domain))).ok();
        for effect in CATALOGUE.iter().copied().filter(|effect| effect.domain == domain) {
            push_entry(&mut page, effect);
        }
    }
    page.push_str(END);
    page
}

fn push_entry(page: &mut String, effect: &'static Effect) {
    let Effect { name, equation, excitation, reference, .. } = *effect;
    writeln!(page, "\n### `{name}`\n\n{}.\n", capitalized(effect.summary)).ok();
    writeln!(page, "```text\n{equation}\n```\n").ok();
    page.push_str("| symbol | parameter | unit | typical range | without effect |\n");
    page.push_str("|---|---|---|---|---|\n");
    for (own, null) in effect.parameters.iter().zip(effect.null) {
        let (low, high) = own.plausible;
        let note = if own.per_session { ", per session" } else { "" };
        writeln!(
            page,
            "| {} | `{}`{note} | {} | {low} to {high} | {null} |",
            own.symbol, own.name, own.unit
        )
        .ok();
    }
    let list = |names: Vec<String>| names.join(", ");
    let axes = list(effect.site.axes().iter().map(|axis| format!("`{axis}`")).collect());
    let signals = list(effect.signals.iter().map(ToString::to_string).collect());
    let confused = list(effect.confused_with.iter().map(|name| format!("`{name}`")).collect());
    let pattern = match effect.experiment {
        "" => String::new(),
        pattern => format!(" (`klasktron collect --pattern {pattern}`)"),
    };
    writeln!(page, "\n| | |\n|---|---|\n| locations | {axes} |\n| signals | {signals} |").ok();
    writeln!(page, "| excitation | {excitation}{pattern} |").ok();
    writeln!(page, "| confused with | {confused} |\n| reference | {reference} |").ok();
    for form in AxisForm::all(effect) {
        writeln!(page, "\nOn a single axis: {}.\n", form.summary).ok();
        writeln!(page, "```text\n{}\n```\n", form.equation).ok();
        page.push_str("| symbol | parameter | unit |\n|---|---|---|\n");
        for [name, symbol, unit] in form.parameters {
            writeln!(page, "| {symbol} | `{name}` | {unit} |").ok();
        }
    }
}

/// Text with the separators of a Markdown table escaped.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// Title with its name in code font.
fn heading(title: &str) -> String {
    match title.split_once(": ") {
        Some((name, rest)) => format!("`{name}`: {rest}"),
        None => title.to_owned(),
    }
}

/// Text with a capital first letter.
#[must_use]
pub fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

const BEGIN: &str = "# `klasktron effects`: the catalogue of physical effects

<!-- Generated by `scripts/make_effects_page`; a test compares this file with the program. -->

```sh
klasktron effects                  # all effects, by domain
klasktron effects drive.friction   # the effects of one group
klasktron effects drive.backlash   # the full entry of one effect
klasktron effects --json           # the catalogue for programs
```

A twin is a list of effects of this catalogue, and `gap` identifies the effects that a twin lacks. The catalogue has
{count} effects. The diagram places them in the measured chain, from the command to the state estimate.

![Measured chain with the effects of the catalogue](pictures/effects.svg)

Each entry has the equation, the parameters and the recorded signals that show the effect. It also has the motion that
excites the effect, the effects that it is confused with under poor excitation, and a reference. A fitted value outside
of the typical range is flagged in `gap.json`. The locations are those of the table: `a` and `b` are the motors, `x` and
`y` the axes of the gantry. `a+b` and `x+y` are shared parameters, and `all` means the whole machine. On a machine with a
single axis every location is `axis`.

## Symbols

";

const END: &str = "
## Limits

- The typical ranges are estimates for small belt drives and for this table, not measurements of many machines.
- Equations are lumped models. Flexible guides, thermal fields and aerodynamics beyond drag are not in the catalogue.
- Some effects are confounded for certain signals. [`gap`](gap.md) then reports them as indistinguishable, with the
  experiment that separates them.
- A single axis is compared by its input, a force or a velocity setpoint. Effects on camera, ball and state estimate need a table.
";

#[cfg(test)]
mod tests {
    use super::*;

    /// The page and its diagram in the documentation are those of the program.
    #[test]
    fn the_documentation_is_current() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
        for (file, text) in
            [("effects.md", markdown()), ("pictures/effects.svg", crate::effects::diagram())]
        {
            let written = std::fs::read_to_string(root.join(file)).unwrap_or_default();
            assert!(written == text, "docs/{file} is old: run scripts/make_effects_page");
        }
    }

    #[test]
    fn groups_and_names_select_their_effects() {
        assert_eq!(select("drive.backlash").len(), 1);
        assert_eq!(select("drive.friction").len(), 9);
        assert!(select("drive.fric").is_empty());
        assert!(similar("qqqq").is_empty());
        assert_eq!(similar("drive.friction.colomb")[0], "drive.friction.coulomb");
    }

    #[test]
    fn the_document_holds_the_whole_catalogue() {
        let document = serde_json::to_value(Document::of(CATALOGUE)).unwrap();
        let effects = document["effects"].as_array().unwrap();
        assert_eq!(effects.len(), CATALOGUE.len());
        assert_eq!(document["schema_version"], 1);
        assert_eq!(effects[0]["parameters"][0]["symbol"], "K");
        assert_eq!(effects[0]["signals"][0]["topic"], "/motor/PLAYER/MOTOR");
        let in_domains = |effect: &&&Effect| DOMAINS.contains(&effect.domain);
        assert_eq!(CATALOGUE.iter().filter(in_domains).count(), CATALOGUE.len());
    }
}
