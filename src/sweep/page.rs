//! `index.html` of a sweep: the metric over the grid, the selection, failures and provenance.

use super::{Better, Choice, Combination, GridAxis, Merged, Plan, Point, point::quoted};
use crate::{
    provenance::Provenance,
    report::{Axis, Badge, Chart, Colour, Grid, Page, Points, Ranges, Series, Table},
};
use std::collections::{BTreeMap, BTreeSet};

/// Most rows of the table of combinations; `table.csv` has all.
const MOST_ROWS: usize = 200;
/// Most failures in the table.
const MOST_FAILURES: usize = 100;
/// Page of a sweep.
#[must_use]
pub fn page(plan: &Plan, merged: &Merged, provenance: &Provenance) -> String {
    let mut page = Page::new(&format!("Sweep of {}", plan.command.name()));
    badge(&mut page, plan, merged);
    page.lead(&lead(plan, merged));
    key_figures(&mut page, plan, merged);
    for warning in &merged.warnings {
        page.warning(warning);
    }
    over_the_grid(&mut page, plan, merged);
    choice(&mut page, plan, merged);
    combinations(&mut page, plan, merged);
    failures(&mut page, plan, merged);
    remarks(&mut page, plan, merged);
    how(&mut page, plan, provenance);
    page.finish()
}

fn badge(page: &mut Page, plan: &Plan, merged: &Merged) {
    let rest = plan.points.len() - merged.rows.len() - merged.failures.len();
    match (merged.failures.len(), rest) {
        (0, 0) => page.badge("complete", Badge::Good),
        (0, rest) => page.badge(&format!("{rest} points pending"), Badge::Note),
        (failed, _) => page.badge(&format!("{failed} points failed"), Badge::Bad),
    }
}

fn key_figures(page: &mut Page, plan: &Plan, merged: &Merged) {
    let Some(choice) = merged.choice else { return };
    let chosen = &merged.combinations[choice.chosen];
    page.key_figures(&[
        ("selected", title(chosen)),
        (plan.metric.title.as_str(), estimate(chosen)),
        ("combinations", merged.combinations.len().to_string()),
        ("finished points", format!("{} of {}", merged.rows.len(), plan.points.len())),
    ]);
}

fn lead(plan: &Plan, merged: &Merged) -> String {
    let finished = merged.rows.len();
    let failed = merged.failures.len();
    let rest = plan.points.len() - finished - failed;
    let mut text = format!("{finished} of {} points are finished", plan.points.len());
    if 0 < failed {
        text.push_str(&format!(", {failed} failed"));
    }
    if 0 < rest {
        text.push_str(&format!(", {rest} are still to be run"));
    }
    text.push('.');
    if let Some(choice) = merged.choice {
        let chosen = &merged.combinations[choice.chosen];
        text.push_str(&format!(" {}", sentence(plan, chosen, choice)));
    }
    text
}

fn sentence(plan: &Plan, chosen: &Combination, choice: Choice) -> String {
    let figure = format!("{}: {}", plan.metric.title, estimate(chosen));
    let name = title(chosen);
    if choice.best == choice.chosen {
        format!("Best: {name}; {figure}.")
    } else {
        format!("Selected: {name}, the first within one standard error of the best; {figure}.")
    }
}

/// `width 64, history 5`
pub(super) fn title(combination: &Combination) -> String {
    let parts: Vec<String> =
        combination.settings.iter().map(|(name, value)| format!("{name} {value}")).collect();
    if parts.is_empty() { "the only combination".to_owned() } else { parts.join(", ") }
}

/// `0.0123 ± 0.0004 (3 seeds)`
pub(super) fn estimate(combination: &Combination) -> String {
    let mean = combination.mean.map_or_else(|| "-".to_owned(), digits);
    let error = combination.standard_error;
    let error = error.map_or_else(String::new, |error| format!(" ± {}", digits(error)));
    match combination.values.len() {
        1 => mean,
        count => format!("{mean}{error} ({count} seeds)"),
    }
}

/// Four significant digits.
pub(super) fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let above = value.abs().log10().floor() as i32;
    if (-4..6).contains(&above) {
        format!("{value:.*}", (3 - above).max(0) as usize)
    } else {
        format!("{value:.3e}")
    }
}

fn over_the_grid(page: &mut Page, plan: &Plan, merged: &Merged) {
    if merged.combinations.is_empty() {
        return;
    }
    let wide: Vec<&GridAxis> = plan.axes.iter().filter(|axis| 1 < axis.values.len()).collect();
    match wide[..] {
        [axis] => {
            page.section("Metric over the grid");
            page.paragraph("Mean over seeds; the band is the range over seeds.");
            page.chart(&lines(plan, merged, axis));
        }
        [rows, columns] => {
            page.section("Metric over the grid");
            page.paragraph("Mean over seeds; a blank cell has no finished point.");
            page.chart(&map(plan, merged, rows, columns));
        }
        _ => {}
    }
}

/// Combinations of the grid by their values on all axes.
struct Cells<'a> {
    plan: &'a Plan,
    by_values: BTreeMap<Vec<&'a str>, &'a Combination>,
}

impl<'a> Cells<'a> {
    fn new(plan: &'a Plan, merged: &'a Merged) -> Self {
        let mut by_values = BTreeMap::new();
        for one in &merged.combinations {
            let value = |axis: &GridAxis| one.settings.get(&axis.name).map(String::as_str);
            let values: Option<Vec<&str>> = plan.axes.iter().map(value).collect();
            if let Some(values) = values {
                // A listed point may differ in something else; those of the grid come first.
                by_values.entry(values).or_insert(one);
            }
        }
        Self { plan, by_values }
    }

    /// Combination at which `axes` have these values; every other axis has one value only.
    fn at(&self, axes: &[(&GridAxis, usize)]) -> Option<&'a Combination> {
        let value = |axis: &'a GridAxis| {
            let given = axes.iter().find(|(other, _)| other.name == axis.name);
            axis.values[given.map_or(0, |(_, index)| *index)].as_str()
        };
        let values: Vec<&str> = self.plan.axes.iter().map(value).collect();
        self.by_values.get(&values).copied()
    }
}

/// Positions on an axis: its values where all are numbers, else 0, 1, 2.
fn positions(axis: &GridAxis) -> (Vec<f64>, bool) {
    let numbers: Option<Vec<f64>> = axis
        .values
        .iter()
        .map(|value| value.parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    match numbers {
        Some(numbers) => (numbers, true),
        None => ((0..axis.values.len()).map(|index| index as f64).collect(), false),
    }
}

fn lines(plan: &Plan, merged: &Merged, axis: &GridAxis) -> Chart {
    let grid = Cells::new(plan, merged);
    let (positions, numeric) = positions(axis);
    let mut found: Vec<(f64, &Combination)> = positions
        .iter()
        .enumerate()
        .filter_map(|(index, x)| grid.at(&[(axis, index)]).map(|one| (*x, one)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let low = |one: &Combination| one.values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = |one: &Combination| one.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let band: Ranges = found.iter().map(|(x, one)| (*x, low(one), high(one))).collect();
    let mean = found.iter().filter_map(|(x, one)| Some((*x, one.mean?))).collect();
    let seeds: BTreeSet<Option<u64>> =
        found.iter().flat_map(|(_, one)| one.seeds.iter().copied()).collect();
    let several = 1 < seeds.len();
    let curves: Vec<Points> = seeds
        .iter()
        .map(|seed| {
            let value = |(x, one): &(f64, &Combination)| {
                let place = one.seeds.iter().position(|other| other == seed)?;
                Some((*x, one.values[place]))
            };
            found.iter().filter_map(value).collect()
        })
        .collect();
    let x = if numeric {
        Axis::new(&axis.name, "")
    } else {
        Axis::of_categories(&axis.name, axis.values.clone())
    };
    let every = several.then(|| Series::lines("every seed", Colour::Grey, curves).with_width(1.2));
    Chart::of_lines(&plan.metric.title, x, Axis::new(&plan.metric.title, ""))
        .with_all(every)
        .with(Series::marked("mean", Colour::Blue, mean).with_band(band))
        .with_height(360)
}

fn map(plan: &Plan, merged: &Merged, rows: &GridAxis, columns: &GridAxis) -> Chart {
    let grid = Cells::new(plan, merged);
    let cell = |row: usize, column: usize| grid.at(&[(rows, row), (columns, column)]);
    let (height, width) = (rows.values.len(), columns.values.len());
    let chosen = merged.choice.map(|choice| &merged.combinations[choice.chosen]);
    let text = |row: usize, column: usize| {
        let mean = cell(row, column).and_then(|one| one.mean).map_or_else(String::new, digits);
        let mark = if chosen.is_some() && cell(row, column) == chosen { " *" } else { "" };
        format!("{mean}{mark}")
    };
    let mean =
        |row: usize, column: usize| cell(row, column).and_then(|one| one.mean).unwrap_or(f64::NAN);
    let values = (0..height).map(|row| (0..width).map(|column| mean(row, column)).collect());
    let texts = (0..height).map(|row| (0..width).map(|column| text(row, column)).collect());
    // Categories stand at 0, 1, 2 ..., in the middle of their cells.
    let edges = |count: usize| (-0.5, count as f64 - 0.5);
    let cells =
        Grid::of_numbers(values.collect(), edges(width), edges(height), &*plan.metric.title);
    Chart::of_plane(
        &format!("{}; * marks the selection", plan.metric.title),
        Axis::of_categories(&columns.name, columns.values.clone()),
        Axis::of_categories(&rows.name, rows.values.clone()),
    )
    .with_grid(cells.with_text(texts.collect()))
    .with_height(120 + 48 * height.clamp(3, 12) as u32)
}

fn choice(page: &mut Page, plan: &Plan, merged: &Merged) {
    let Some(choice) = merged.choice else { return };
    page.section("Selection");
    let [best, chosen] = [choice.best, choice.chosen].map(|index| &merged.combinations[index]);
    let direction = match plan.metric.better {
        Better::Smaller => "smallest",
        Better::Larger => "largest",
    };
    page.paragraph(&format!(
        "The {direction} mean of \"{}\" has {}: {}.",
        plan.metric.title,
        title(best),
        estimate(best)
    ));
    if best.standard_error.is_none() {
        page.paragraph(
            "One seed gives no standard error. With several seeds the sweep selects the simplest combination within one \
             standard error of the best.",
        );
    } else {
        page.paragraph(&format!(
            "Selected is the first combination in the order of the sweep file whose mean lies within one standard error \
             of the best: {}, {}. Lists should therefore run from the simplest value to the most complex.",
            title(chosen),
            estimate(chosen)
        ));
    }
}

fn combinations(page: &mut Page, plan: &Plan, merged: &Merged) {
    page.section("Combinations");
    page.link("table.csv", "table.csv");
    page.link("table.parquet", "table.parquet: the same, with a row for each finished point");
    if merged.combinations.is_empty() {
        page.paragraph(&format!("No finished point has a number at {}.", plan.metric.path));
        return;
    }
    let mut order: Vec<&Combination> = merged.combinations.iter().collect();
    let key = |one: &Combination| one.mean.unwrap_or(f64::NAN);
    order.sort_by(|a, b| match plan.metric.better {
        Better::Smaller => key(a).total_cmp(&key(b)),
        Better::Larger => key(b).total_cmp(&key(a)),
    });
    let rows = order.iter().take(MOST_ROWS).map(|one| {
        let [low, high] = [f64::min, f64::max].map(|of| one.values.iter().copied().reduce(of));
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), digits);
        let figures = [one.mean, one.standard_error, low, high].map(number);
        let mut cells = vec![title(one), one.values.len().to_string()];
        cells.extend(figures);
        cells
    });
    let head = ["combination", "seeds", "mean", "standard error", "smallest", "largest"];
    page.paragraph(&format!("Sorted by {}, the best first.", plan.metric.title));
    page.table(&Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() });
    if MOST_ROWS < order.len() {
        page.paragraph(&format!("and {} more in table.csv", order.len() - MOST_ROWS));
    }
}

fn failures(page: &mut Page, plan: &Plan, merged: &Merged) {
    if merged.failures.is_empty() {
        return;
    }
    page.section("Failed points");
    page.paragraph("The option --retry runs failed points again.");
    let point = |hash: &str| plan.points.iter().find(|point| point.hash == hash);
    let rows = merged.failures.iter().take(MOST_FAILURES).map(|failed| {
        let title = point(&failed.hash).map_or_else(|| failed.hash.clone(), Point::title);
        let task = failed.task.clone().unwrap_or_else(|| "-".to_owned());
        vec![title, task, failed.log.display().to_string(), failed.reason.clone()]
    });
    let head = ["point", "task", "log", "reason"];
    page.table_of_words(&Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect() });
    if MOST_FAILURES < merged.failures.len() {
        page.paragraph(&format!("and {} more", merged.failures.len() - MOST_FAILURES));
    }
}

fn remarks(page: &mut Page, plan: &Plan, merged: &Merged) {
    let remarked = || merged.rows.iter().filter_map(|row| Some((row, row.remark.as_ref()?)));
    if remarked().next().is_none() {
        return;
    }
    let rows = remarked().take(MOST_FAILURES);
    let rows = rows.map(|(row, remark)| vec![plan.points[row.index].title(), remark.clone()]);
    let head = ["point", "remark"].map(str::to_owned).to_vec();
    let table = Table { head, rows: rows.collect() };
    let count = remarked().count();
    let summary = format!("{count} finished points report data loss or a missed requirement");
    page.folded_table_of_words(&summary, &table);
}

fn how(page: &mut Page, plan: &Plan, provenance: &Provenance) {
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.paragraph(&format!("Metric: {}, read from each result at", plan.metric.title));
    page.code(&plan.metric.path);
    if let Some(point) = plan.points.first() {
        page.paragraph("Command of the first point, for the folder of the sweep file:");
        page.code(&format!("{} --out {}", point.command_line, quoted(&point.hash)));
    }
    page.facts(provenance.facts());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_digits_are_shown() {
        for (value, shown) in [
            (0.012_345, "0.01235"),
            (123.456, "123.5"),
            (99_999.0, "99999"),
            (0.0, "0"),
            (1e-7, "1.000e-7"),
        ] {
            assert_eq!(digits(value), shown);
        }
    }
}
