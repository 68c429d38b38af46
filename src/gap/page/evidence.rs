//! Evidence of the search: candidates of each step, parameter estimates, decisions, rejected candidates.

use super::{
    stage_name,
    text::{count, digits, label, number, percent, probability},
    unit,
};
use crate::{
    gap::{
        estimates::ParameterEstimate,
        find::Found,
        findings::RejectedEffect,
        journal::{JournalEntry, Move, MoveKind},
        rounds::{Added, Outcome},
    },
    report::{Page, Table},
};

/// Most candidates that are shown without a click.
const SHOWN_CANDIDATES: usize = 8;

/// Ratio of losses from which the table states a multiple instead of per cent.
const FAR_WORSE: f64 = 2.0;

/// Add the candidates of each step, and the parameter estimates after it.
pub(super) fn section(page: &mut Page, found: &Found<'_>) {
    if !found.outcomes.iter().any(|outcome| !outcome.added.is_empty()) {
        return;
    }
    page.section("Evidence and runners-up");
    page.paragraph(
        "In each step the strongest candidates are simulated and fitted together with all known parameters. The loss is \
         the mean squared whitened residual of a sample on the training sessions; smaller is better.",
    );
    for outcome in &found.outcomes {
        for step in &outcome.added {
            page.subsection(&format!("{}{}", step.effect.name, step.axis.phrase()));
            page.paragraph(&format!(
                "Block test in the screening: F = {}, p = {}, corrected for all comparisons.",
                number(step.statistic),
                probability(step.p_value),
            ));
            page.table_of_words(&candidates(step));
        }
        estimates(page, outcome);
    }
}

fn candidates(step: &Added) -> Table {
    let selected = step.loss().filter(|loss| 0.0 < *loss);
    let rows = step.ranking.iter().map(|one| {
        let worse = selected.map_or_else(String::new, |selected| match one.loss / selected {
            ratio if ratio < FAR_WORSE => format!("{:+.2} %", 100.0 * (ratio - 1.0)),
            ratio => format!("{} times", number(ratio)),
        });
        let remark = if step.is(one) {
            "selected"
        } else if step.indistinguishable.contains(&one.effect.name) {
            "indistinguishable from the selected effect"
        } else if step.is_less_significant_than(one) {
            "more significant, but a much smaller reduction of the residual: tested again later"
        } else {
            ""
        };
        let loss = digits(one.loss, 5);
        vec![one.effect.name.to_owned(), one.axis.to_string(), loss, worse, remark.to_owned()]
    });
    let head = ["candidate", "location", "loss per sample", "relative to the selected", "remark"];
    Table::new(&head, rows.collect())
}

/// Parameter estimates of one stage after each step.
fn estimates(page: &mut Page, outcome: &Outcome<'_>) {
    let steps: Vec<&Added> =
        outcome.added.iter().filter(|step| !step.estimates.is_empty()).collect();
    if steps.is_empty() {
        return;
    }
    let mut columns = vec![("refitted".to_owned(), outcome.refitted_estimates.clone())];
    // The last word of a name keeps the table within the page.
    let short = |name: &str| format!("+ {}", label(name.rsplit('.').next().unwrap_or(name)));
    columns.extend(steps.iter().map(|step| (short(step.effect.name), step.estimates.clone())));
    // An effect that was split is one column.
    columns.dedup_by(|later, earlier| later.1 == earlier.1);
    let mut rows: Vec<&ParameterEstimate> = Vec::new();
    for number in columns.iter().flat_map(|(_, estimates)| estimates) {
        if !rows.iter().any(|row| row.name == number.name && row.location == number.location) {
            rows.push(number);
        }
    }
    let rows = rows.into_iter().map(|row| {
        let at = |estimates: &[ParameterEstimate]| {
            let own =
                estimates.iter().find(|own| own.name == row.name && own.location == row.location);
            own.map_or_else(|| "–".to_owned(), |own| number(own.value))
        };
        let mut cells = vec![row.name.clone(), row.location.to_string(), unit(&row.unit)];
        cells.extend(columns.iter().map(|(_, estimates)| at(estimates)));
        cells
    });
    let mut head = ["parameter", "location", "unit"].map(str::to_owned).to_vec();
    head.extend(columns.iter().map(|(name, _)| name.clone()));
    page.subsection(&format!("Parameter estimates after each step – {}", stage_name(outcome.kind)));
    page.paragraph(
        "All parameters are fitted again after each added effect, by ordinary least squares with each signal scaled by its \
         RMS. A parameter that changes compensated for an effect that was missing before.",
    );
    page.table(&Table { head, rows: rows.collect() });
}

/// Add the decisions in order.
pub(super) fn journal(page: &mut Page, journal: &[JournalEntry]) {
    if journal.is_empty() {
        return;
    }
    page.section("Journal of decisions");
    let rows = journal.iter().enumerate().map(|(index, entry)| {
        let comparison = entry.comparison.as_ref();
        let gain = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), percent);
        vec![
            (index + 1).to_string(),
            move_words(&entry.made),
            gain(comparison.and_then(|own| own.training_gain)),
            gain(comparison.and_then(|own| own.validation_gain)),
            comparison.and_then(|own| own.p_value).map_or_else(|| "–".to_owned(), probability),
            entry.reason.clone(),
        ]
    });
    let head = ["", "move", "training gain", "validation gain", "p", "reason"];
    page.table_of_words(&Table::new(&head, rows.collect()));
}

/// Move as a phrase: `add drive.delay on motors`.
fn move_words(made: &Move) -> String {
    let kind = match made.kind {
        MoveKind::Refuse => "refuse the data",
        MoveKind::Refit => "refit known parameters",
        MoveKind::Keep => "keep the given twin",
        MoveKind::Mask => "mask disturbances",
        MoveKind::Add => "add",
        MoveKind::Split => "split",
        MoveKind::Remove => "remove",
        MoveKind::Stop => "stop",
        MoveKind::Describe => "describe",
    };
    let effect = made.effect.as_ref().map_or_else(String::new, |effect| format!(" {effect}"));
    let location = made.location.map_or_else(String::new, crate::effects::Axis::phrase);
    format!("{kind}{effect}{location}")
}

/// Add the candidates that were not added.
pub(super) fn rejected(page: &mut Page, rejected: &[RejectedEffect]) {
    if rejected.is_empty() {
        return;
    }
    page.section("Rejected candidates");
    page.paragraph(
        "All other effects of the catalogue at each location. F and p are those of the screening, not corrected for the \
         number of comparisons. The validation gain is the removed fraction of the squared residual on validation data, \
         for candidates that were simulated.",
    );
    let table = |rows: &[RejectedEffect]| {
        let head = ["candidate", "location", "F", "p", "validation gain", "reason"];
        Table::new(&head, rows.iter().map(rejected_row).collect())
    };
    if rejected.len() <= SHOWN_CANDIDATES {
        page.table_of_words(&table(rejected));
        return;
    }
    let (simulated, screened): (Vec<RejectedEffect>, Vec<RejectedEffect>) =
        rejected.iter().cloned().partition(|candidate| candidate.validation_gain.is_some());
    if !simulated.is_empty() {
        page.table_of_words(&table(&simulated));
    }
    if !screened.is_empty() {
        let summary = format!("{} rejected by the screening", count(screened.len(), "candidate"));
        page.folded_table_of_words(&summary, &table(&screened));
    }
}

fn rejected_row(candidate: &RejectedEffect) -> Vec<String> {
    vec![
        candidate.name.clone(),
        candidate.location.to_string(),
        candidate.statistic.map_or_else(|| "–".to_owned(), number),
        candidate.p_value.map_or_else(|| "–".to_owned(), probability),
        candidate.validation_gain.map_or_else(|| "–".to_owned(), percent),
        candidate.reason.clone(),
    ]
}
