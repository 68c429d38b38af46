//! The goals, measured: one judgement per case, then one row per goal.

use crate::{
    baseline,
    run::{Outcome, baseline_name},
    said::{self, GapRow, Said},
    truth::{Answers, Case, Class, PlantedEffect},
};
use anyhow::{Context as _, Result};
use std::{collections::BTreeMap, fs, path::Path};

/// What is known about one case after the program has spoken.
#[derive(Debug, Clone, Default)]
pub(crate) struct Judged {
    pub(crate) answered: bool,
    /// Names that are neither planted nor tolerated.
    pub(crate) wrong: Vec<String>,
    /// For each planted effect: named (or shown as a moved parameter).
    pub(crate) found: Vec<bool>,
    pub(crate) in_set: Vec<bool>,
    pub(crate) located: bool,
    pub(crate) verdict_right: bool,
    pub(crate) unexplained: bool,
    pub(crate) recognised: bool,
    /// Relative error of the main parameter, and whether the interval covers the truth.
    pub(crate) parameter: Option<(f64, Option<bool>)>,
    pub(crate) closed: Option<f64>,
    pub(crate) worse: bool,
    pub(crate) outcome: Outcome,
    pub(crate) summary: String,
}

/// Everything that `score` needs.
pub(crate) struct Evidence {
    pub(crate) answers: Answers,
    pub(crate) judged: BTreeMap<String, Judged>,
    pub(crate) rivals: BTreeMap<String, baseline::Said>,
}

/// Reads answers, results and the rivals' results.
pub(crate) fn gather(cases: &Path, results: &Path) -> Result<Evidence> {
    let answers = read_answers(cases)?;
    let rivals = serde_json::from_slice(&fs::read(cases.join("baselines.json"))?)?;
    let mut judged = BTreeMap::new();
    for (name, case) in &answers.cases {
        let base = Base::read(&results.join(baseline_name(&case.rig)).join("out"));
        let folder = results.join(name);
        let outcome = fs::read(folder.join("run.json"))
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok());
        if let Some(outcome) = outcome {
            let said = said::read(&folder.join("out/gap.json"));
            judged.insert(name.clone(), judge(case, said.as_ref(), &base, outcome));
        }
    }
    Ok(Evidence { answers, judged, rivals })
}

/// Reads `answers.json` of a folder of cases.
pub(crate) fn read_answers(cases: &Path) -> Result<Answers> {
    let path = cases.join("answers.json");
    let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
    Ok(serde_json::from_slice(&bytes)?)
}

/// What the program made of the rig as it is.
struct Base {
    /// Its twin, as text.
    twin: String,
    /// What that leaves of each signal on data that it was not fitted to.
    left: BTreeMap<String, f64>,
}

impl Base {
    fn read(folder: &Path) -> Self {
        let rows = said::read(&folder.join("gap.json")).map_or_else(Vec::new, |said| said.gap);
        Self {
            twin: fs::read_to_string(folder.join("twin.json")).unwrap_or_default(),
            left: rows.into_iter().map(|row| (row.signal, row.after)).collect(),
        }
    }
}

fn judge(case: &Case, said: Option<&Said>, base: &Base, outcome: Outcome) -> Judged {
    let Some(said) = said else {
        let mut none = Judged { outcome, summary: "no gap.json".to_owned(), ..Judged::default() };
        none.found = vec![false; case.effects.len()];
        none.in_set = none.found.clone();
        return none;
    };
    let fine = |name: &str| {
        case.tolerated.iter().any(|tolerated| tolerated == name)
            || case.effects.iter().any(|planted| {
                planted.name == name || planted.alike.iter().any(|alike| alike == name)
            })
    };
    let wrong = |name: &str| match case.class {
        Class::Outside => !name.starts_with("unknown."),
        _ => !fine(name),
    };
    let names: Vec<&str> = said.effects.iter().map(|effect| effect.name.as_str()).collect();
    let found: Vec<bool> =
        case.effects.iter().map(|planted| is_found(planted, said, &base.twin)).collect();
    let mut set = said.class.clone();
    set.extend(names.iter().map(|name| (*name).to_owned()));
    let small = set.len() <= 3.max(case.effects.len() + 1);
    let in_set = case
        .effects
        .iter()
        .zip(&found)
        .map(|(planted, found)| *found || (small && set.contains(&planted.name)))
        .collect();
    let unknown = names.iter().any(|name| name.starts_with("unknown."));
    let main = case.effects.first();
    Judged {
        answered: true,
        wrong: names.iter().filter(|name| wrong(name)).map(|name| (*name).to_owned()).collect(),
        located: main.is_some_and(|planted| is_located(planted, said)),
        verdict_right: case.verdicts.contains(&said.verdict),
        unexplained: said.verdict == "unexplained" || unknown,
        recognised: main.is_some_and(|planted| is_recognised(planted, said)),
        parameter: main.and_then(|planted| parameter(planted, said)),
        closed: closed(case, said, base),
        worse: said.gap.iter().any(|row| is_worse(case, row, base)),
        summary: summary(said),
        outcome,
        found,
        in_set,
    }
}

/// Named; or, where the rig's own twin has it already, a parameter of it left its old value.
fn is_found(planted: &PlantedEffect, said: &Said, base_twin: &str) -> bool {
    let named = said.effects.iter().any(|effect| effect.name == planted.name);
    let had = planted.known || base_twin.contains(&planted.name);
    named
        || (had
            && said.moved.iter().any(|moved| {
                moved.name.starts_with(&planted.name)
                    && match (moved.before, moved.interval) {
                        (Some(before), Some([low, high])) => before < low || high < before,
                        _ => false,
                    }
            }))
}

/// Axes that a text speaks of: letters a, b, x, y that stand alone.
fn axes(text: &str) -> Vec<char> {
    text.to_lowercase()
        .split(|c: char| !c.is_alphanumeric())
        .filter_map(|word| match word {
            "a" | "b" | "x" | "y" => word.chars().next(),
            _ => None,
        })
        .collect()
}

/// Whether `said` fits the planted axes: any of them when both have the effect, exactly the one
/// when only one has it. A text without axis fits what sits on the whole machine or on both.
fn axis_fits(planted: &PlantedEffect, said: &str) -> bool {
    let said = axes(said);
    match planted.axis.as_slice() {
        [only] => !said.is_empty() && said.iter().all(|axis| only.starts_with(*axis)),
        [] => true,
        both => said.iter().all(|axis| both.iter().any(|planted| planted.starts_with(*axis))),
    }
}

fn is_located(planted: &PlantedEffect, said: &Said) -> bool {
    let domain = |name: &str| name.split('.').next() == Some(planted.domain.as_str());
    let named = said
        .effects
        .iter()
        .find(|effect| domain(&effect.name))
        .is_some_and(|effect| axis_fits(planted, &effect.axis));
    let moved =
        planted.known && said.moved.iter().any(|moved| moved.name.starts_with(&planted.name));
    let place = said
        .places
        .first()
        .is_some_and(|(domain, axis)| *domain == planted.domain && axis_fits(planted, axis));
    named || moved || place
}

fn is_recognised(planted: &PlantedEffect, said: &Said) -> bool {
    let named = said.effects.iter().any(|effect| effect.name == planted.name);
    let listed = said
        .rejected
        .iter()
        .any(|(name, reason)| *name == planted.name && reason.contains("not testable"));
    !named && (listed || said.verdict == "not_testable") && said.next_experiment
}

/// A unit without the ways of writing it: `m/s^2`, `m/s2` and `m s-2` stay apart only where they
/// must.
fn unit_key(unit: &str) -> String {
    unit.chars().filter(|c| c.is_alphanumeric() || *c == '/').collect::<String>().to_lowercase()
}

/// Names of the same quantity: effect, here, in the program.
const SAME_QUANTITY: [(&str, &str, &str); 8] = [
    ("drive.lag1", "tau_s", "time_constant_s"),
    ("drive.offset", "offset_m_per_s", "offset"),
    ("drive.friction.viscous", "slope_n_s_per_m", "coefficient_n_s_per_m"),
    ("drive.friction.stribeck", "excess_n", "force_n"),
    ("ball.tilt", "slope_rad", "tilt_x_rad"),
    ("ball.stiction_patch", "additional_resistance", "coefficient"),
    ("impact.wall_location", "shift_m", "right_m"),
    ("estimator.lag", "tau_s", "lag_s"),
];

/// Error and cover of the planted parameter, where the program states the same quantity.
fn parameter(planted: &PlantedEffect, said: &Said) -> Option<(f64, Option<bool>)> {
    let truth = planted.parameters.first()?;
    let same =
        SAME_QUANTITY.iter().find(|(effect, own, _)| *effect == planted.name && *own == truth.name);
    let name = same.map_or(truth.name.as_str(), |(_, _, name)| *name);
    let judge = |value: f64, interval: Option<[f64; 2]>| {
        let error = (value - truth.value).abs() / truth.value.abs().max(1e-12);
        (error, interval.map(|[low, high]| low <= truth.value && truth.value <= high))
    };
    let effect = said.effects.iter().find(|effect| effect.name == planted.name);
    if let Some(effect) = effect {
        let chosen = effect.parameters.iter().find(|p| p.name == name)?;
        return Some(judge(chosen.value, chosen.interval));
    }
    let moved = said.moved.iter().find(|moved| moved.name == format!("{}.{name}", planted.name))?;
    Some(judge(moved.after?, moved.interval))
}

/// What no added effect can take away: what the rig's own twin leaves of the signal where nothing is hidden, and at
/// least the noise by the generator's own knowledge.
fn floor(case: &Case, row: &GapRow, base: &Base) -> f64 {
    let key = unit_key(&row.unit);
    let made = case.floors.iter().find(|(unit, _)| unit_key(unit) == key).map(|(_, value)| *value);
    let made = made.filter(|made| *made < row.before).or(row.floor).unwrap_or(0.0);
    base.left.get(&row.signal).map_or(made, |left| left.max(made))
}

/// Frames whose times scatter leave a gap that is noise: naming it takes none of it away.
const NOTHING_TO_REMOVE: &str = "sensor.frame_jitter";

/// Share of the removable gap that is gone, in the signal that shows the effect best.
fn closed(case: &Case, said: &Said, base: &Base) -> Option<f64> {
    if case.effects.iter().any(|planted| planted.name == NOTHING_TO_REMOVE) {
        return None;
    }
    let over = |row: &GapRow| row.before / floor(case, row, base).max(1e-12);
    let row = said.gap.iter().max_by(|p, q| over(p).total_cmp(&over(q)))?;
    let floor = floor(case, row, base);
    (1.2 * floor < row.before).then(|| (row.before - row.after) / (row.before - floor))
}

fn is_worse(case: &Case, row: &GapRow, base: &Base) -> bool {
    1.02 * row.before < row.after && 1.02 * floor(case, row, base) < row.after
}

fn summary(said: &Said) -> String {
    let names: Vec<String> = said
        .effects
        .iter()
        .map(|effect| {
            if effect.axis.is_empty() {
                effect.name.clone()
            } else {
                format!("{}[{}]", effect.name, effect.axis)
            }
        })
        .collect();
    let moved = said.moved.len();
    let class: Vec<&str> = said.class.iter().map(String::as_str).collect();
    let rows: Vec<&str> = said.gap.iter().map(|row| row.signal.trim()).collect();
    format!(
        "{} {{{}}} class {{{}}} refit {moved} signals {}",
        said.verdict,
        names.join(", "),
        class.join(", "),
        rows.len()
    )
}
