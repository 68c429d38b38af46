//! One table of goals, and the list of misses.

use crate::{
    score::{Evidence, Judged},
    truth::{Case, Class},
    wilson::wilson,
};
use serde::Serialize;

/// One row: a goal, what was reached, with its interval.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Row {
    pub(crate) goal: String,
    pub(crate) wanted: String,
    pub(crate) figure: Option<f64>,
    pub(crate) interval: Option<[f64; 2]>,
    pub(crate) count: usize,
    pub(crate) met: Option<bool>,
}

/// The whole result.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Table {
    pub(crate) schema_version: u32,
    pub(crate) cases: usize,
    pub(crate) judged: usize,
    pub(crate) goals: Vec<Row>,
    pub(crate) rivals: Vec<Row>,
    pub(crate) misses: Vec<Miss>,
}

/// A case that did not go as it should.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Miss {
    pub(crate) case: String,
    pub(crate) class: Class,
    pub(crate) truth: String,
    pub(crate) said: String,
}

/// Which side of a figure is good.
#[derive(Debug, Clone, Copy)]
enum Goal {
    AtLeast(f64),
    AtMost(f64),
    Between(f64, f64),
}

impl Goal {
    fn met(self, value: f64) -> bool {
        match self {
            Self::AtLeast(least) => least <= value,
            Self::AtMost(most) => value <= most,
            Self::Between(low, high) => low <= value && value <= high,
        }
    }

    /// The goal in words, its numbers as `show` writes them.
    fn text(self, show: impl Fn(f64) -> String) -> String {
        match self {
            Self::AtLeast(v) => format!(">= {}", show(v)),
            Self::AtMost(v) => format!("<= {}", show(v)),
            Self::Between(p, q) => format!("{} to {}", show(p), show(q)),
        }
    }
}

fn percent(v: f64) -> String {
    format!("{:.1} %", 100.0 * v)
}

fn rate(goal: &str, wanted: Goal, hits: impl IntoIterator<Item = bool>) -> Row {
    let hits: Vec<bool> = hits.into_iter().collect();
    let yes = hits.iter().filter(|hit| **hit).count();
    let figure = (!hits.is_empty()).then(|| yes as f64 / hits.len() as f64);
    Row {
        goal: goal.to_owned(),
        wanted: wanted.text(percent),
        figure,
        interval: wilson(yes, hits.len()),
        count: hits.len(),
        met: figure.map(|figure| wanted.met(figure)),
    }
}

fn figure(goal: &str, wanted: Goal, quantile: f64, mut values: Vec<f64>) -> Row {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    let figure = values.get((quantile * last as f64).round() as usize).copied();
    Row {
        goal: goal.to_owned(),
        wanted: wanted.text(|v| v.to_string()),
        figure,
        interval: None,
        count: values.len(),
        met: figure.map(|figure| wanted.met(figure)),
    }
}

type Pair<'a> = (&'a str, &'a Case, &'a Judged);

/// Multiples of the noise as reached, in the bins of the goals.
fn bin(case: &Case) -> Option<usize> {
    let multiple = case.effects.first()?.noise_multiple?;
    match multiple {
        m if 2.0 <= m => Some(0),
        m if 0.75 <= m => Some(1),
        m if 0.35 <= m => Some(2),
        _ => None,
    }
}

/// Measures every goal.
pub(crate) fn table(evidence: &Evidence) -> Table {
    let pairs: Vec<Pair<'_>> = evidence
        .judged
        .iter()
        .map(|(name, judged)| (name.as_str(), &evidence.answers.cases[name], judged))
        .collect();
    let mut goals = nulls(&pairs);
    goals.extend(singles(&pairs));
    goals.extend(others(&pairs));
    goals.extend(numbers(&pairs));
    Table {
        schema_version: 1,
        cases: evidence.answers.cases.len(),
        judged: pairs.len(),
        goals,
        rivals: rivals(evidence),
        misses: misses(&pairs),
    }
}

fn of<'a>(pairs: &'a [Pair<'a>], class: Class) -> impl Iterator<Item = &'a Pair<'a>> {
    pairs.iter().filter(move |(_, case, _)| case.class == class)
}

fn nulls(pairs: &[Pair<'_>]) -> Vec<Row> {
    let bad = |pair: &Pair<'_>| !pair.2.wrong.is_empty();
    let all = pairs.iter().filter(|(_, case, _)| case.class.is_null()).map(bad);
    let mut rows = vec![rate("false names on nulls, all", Goal::AtMost(0.01), all)];
    for class in Class::NULLS {
        let goal = format!("false names, {}", class_text(class));
        rows.push(rate(&goal, Goal::AtMost(0.025), of(pairs, class).map(bad)));
    }
    rows
}

fn singles(pairs: &[Pair<'_>]) -> Vec<Row> {
    let mut rows = Vec::new();
    for (index, (label, exact, set)) in
        [("3x", 0.95, 0.99), ("1x", 0.90, 0.97), ("0.5x", 0.75, 0.88)].into_iter().enumerate()
    {
        let at = || of(pairs, Class::Single).filter(move |(_, case, _)| bin(case) == Some(index));
        let right = at().map(|(_, _, j)| j.found[0] && j.wrong.is_empty());
        rows.push(rate(&format!("exact name at {label} noise"), Goal::AtLeast(exact), right));
        let within = at().map(|(_, _, j)| j.in_set[0]);
        rows.push(rate(&format!("truth in the answer at {label}"), Goal::AtLeast(set), within));
    }
    let visible = of(pairs, Class::Single).filter(|(_, c, _)| matches!(bin(c), Some(0 | 1)));
    rows.push(rate("location at >= 1x", Goal::AtLeast(0.98), visible.map(|(_, _, j)| j.located)));
    rows
}

fn others(pairs: &[Pair<'_>]) -> Vec<Row> {
    let all_found = |pair: &&Pair<'_>| pair.2.found.iter().all(|found| *found);
    let clean = |pair: &Pair<'_>| pair.2.wrong.is_empty();
    let two: Vec<&Pair<'_>> = of(pairs, Class::Two).collect();
    let three: Vec<&Pair<'_>> = of(pairs, Class::Three).collect();
    let several = || two.iter().chain(&three);
    vec![
        rate("two effects, both named", Goal::AtLeast(0.85), two.iter().map(all_found)),
        rate("three effects, all named", Goal::AtLeast(0.0), three.iter().map(all_found)),
        rate("several effects, no wrong name", Goal::AtLeast(0.97), several().map(|p| clean(p))),
        rate(
            "outside the catalogue, wrong name",
            Goal::AtMost(0.05),
            of(pairs, Class::Outside).map(|p| !clean(p)),
        ),
        rate(
            "outside the catalogue, said so",
            Goal::AtLeast(0.85),
            of(pairs, Class::Outside).map(|(_, _, j)| j.unexplained),
        ),
        rate(
            "hardly shown: recognised, or named all the same",
            Goal::AtLeast(0.90),
            of(pairs, Class::CannotShow).map(|p| p.2.recognised || all_found(&p) && clean(p)),
        ),
        rate(
            "bad input, zero names",
            Goal::AtLeast(1.0),
            of(pairs, Class::BadInput).map(|p| p.2.answered && clean(p)),
        ),
        rate(
            "bad input, right verdict",
            Goal::AtLeast(0.9),
            of(pairs, Class::BadInput).map(|(_, _, j)| j.verdict_right),
        ),
    ]
}

fn numbers(pairs: &[Pair<'_>]) -> Vec<Row> {
    let visible = || of(pairs, Class::Single).filter(|(_, c, _)| matches!(bin(c), Some(0 | 1)));
    let stated = || visible().filter_map(|(_, _, j)| j.parameter);
    let errors: Vec<f64> = stated().map(|(error, _)| error).collect();
    let closed: Vec<f64> = visible().filter_map(|(_, _, j)| j.closed).collect();
    let walls: Vec<f64> = pairs.iter().map(|(_, _, j)| j.outcome.wall_s).collect();
    let memory: Vec<f64> = pairs.iter().map(|(_, _, j)| j.outcome.peak_mib).collect();
    let same = pairs.iter().filter_map(|(_, _, j)| j.outcome.same_bytes);
    vec![
        figure("parameter error at >= 1x, median", Goal::AtMost(0.03), 0.5, errors.clone()),
        figure("parameter error at >= 1x, p90", Goal::AtMost(0.10), 0.9, errors),
        rate(
            "interval covers the truth",
            Goal::Between(0.92, 0.98),
            stated().filter_map(|(_, covers)| covers),
        ),
        figure("removable gap closed, median", Goal::AtLeast(0.95), 0.5, closed.clone()),
        figure("removable gap closed, p10", Goal::AtLeast(0.85), 0.1, closed),
        rate("a signal worse by 2 %", Goal::AtMost(0.0), visible().map(|(_, _, j)| j.worse)),
        figure("seconds per case, largest", Goal::AtMost(60.0), 1.0, walls),
        figure("memory in MiB, largest", Goal::AtMost(1024.0), 1.0, memory),
        rate("same bytes when run again", Goal::AtLeast(1.0), same),
        rate("answered at all", Goal::AtLeast(1.0), pairs.iter().map(|(_, _, j)| j.answered)),
    ]
}

fn rivals(evidence: &Evidence) -> Vec<Row> {
    let mut rows = Vec::new();
    let rules: std::collections::BTreeSet<&String> =
        evidence.rivals.values().flat_map(|said| said.names.keys()).collect();
    let of = |wanted: &dyn Fn(&Case) -> bool| -> Vec<(&Case, &crate::baseline::Said)> {
        evidence
            .rivals
            .iter()
            .map(|(name, said)| (&evidence.answers.cases[name], said))
            .filter(|(case, said)| wanted(case) && !said.names.is_empty())
            .collect()
    };
    let nulls = of(&|case| case.class.is_null());
    let singles = of(&|case| {
        case.class == Class::Single && !case.effects[0].known && matches!(bin(case), Some(0 | 1))
    });
    for rule in rules {
        let named = nulls
            .iter()
            .map(|(case, said)| said.names[rule].iter().any(|name| !case.tolerated.contains(name)));
        rows.push(rate(&format!("{rule}: false names on nulls"), Goal::AtMost(0.01), named));
        let exact = singles
            .iter()
            .filter(|(case, said)| !said.base.contains(&case.effects[0].name))
            .map(|(case, said)| said.names[rule] == [case.effects[0].name.clone()]);
        rows.push(rate(&format!("{rule}: exact name at >= 1x"), Goal::AtLeast(0.90), exact));
    }
    let closed = singles.iter().filter_map(|(_, said)| said.network_gain).collect();
    rows.push(figure(
        "black-box network: share of error closed, median; names nothing",
        Goal::AtLeast(0.95),
        0.5,
        closed,
    ));
    rows
}

fn misses(pairs: &[Pair<'_>]) -> Vec<Miss> {
    let missed = |(_, case, j): &&Pair<'_>| match case.class {
        _ if !j.answered || !j.wrong.is_empty() => true,
        Class::Single | Class::Two | Class::Three => j.found.iter().any(|found| !found),
        Class::Outside => !j.unexplained,
        Class::CannotShow => !(j.recognised || j.found.iter().all(|found| *found)),
        Class::BadInput => !j.verdict_right,
        _ => false,
    };
    pairs
        .iter()
        .filter(missed)
        .map(|(name, case, judged)| Miss {
            case: (*name).to_owned(),
            class: case.class,
            truth: truth_text(case),
            said: judged.summary.clone(),
        })
        .collect()
}

fn truth_text(case: &Case) -> String {
    let effects: Vec<String> = case
        .effects
        .iter()
        .map(|e| {
            let multiple = e.noise_multiple.map_or("-".to_owned(), |m| format!("{m:.2}x"));
            let value = e.parameters.first().map_or(f64::NAN, |p| p.value);
            let unit = e.parameters.first().map_or("", |p| p.unit.as_str());
            format!("{}[{}] {value:.4} {unit} {multiple}", e.name, e.axis.join(","))
        })
        .collect();
    if effects.is_empty() { case.what.clone() } else { effects.join(" + ") }
}

fn class_text(class: Class) -> &'static str {
    match class {
        Class::NullClean => "nothing changed",
        Class::NullRefit => "only known parameters wrong",
        Class::NullColoured => "coloured noise",
        Class::NullOutliers => "outliers",
        Class::NullFrames => "frames dropped and doubled",
        _ => "other",
    }
}

/// The table as text.
pub(crate) fn render(table: &Table) -> String {
    let mut out = format!("{} of {} cases judged\n\n", table.judged, table.cases);
    let head =
        format!("{:<64} {:>18} {:>9} {:>19} {:>5}  met\n", "goal", "wanted", "figure", "95 %", "n");
    for (title, rows) in [("", &table.goals), ("\nwhat others do\n", &table.rivals)] {
        out.push_str(title);
        out.push_str(&head);
        for row in rows {
            out.push_str(&line(row));
        }
    }
    out.push_str(&format!("\n{} misses\n", table.misses.len()));
    for miss in &table.misses {
        out.push_str(&format!(
            "  {} {:?}: {}\n      said: {}\n",
            miss.case, miss.class, miss.truth, miss.said
        ));
    }
    out
}

fn line(row: &Row) -> String {
    let percent = row.wanted.contains('%');
    let show = |v: f64| if percent { format!("{:.1} %", 100.0 * v) } else { format!("{v:.3}") };
    let interval =
        row.interval.map_or(String::new(), |[p, q]| format!("{} to {}", show(p), show(q)));
    let met = match row.met {
        Some(true) => "yes",
        Some(false) => "NO",
        None => "-",
    };
    let figure = row.figure.map_or("-".to_owned(), show);
    format!(
        "{:<64} {:>18} {figure:>9} {interval:>19} {:>5}  {met}\n",
        row.goal, row.wanted, row.count
    )
}
