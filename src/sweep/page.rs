//! `index.html` of a sweep: the metric over the grid, the choice, what failed, how it was made.

use super::{Better, Choice, Combination, GridAxis, Merged, Plan, Point, point::quoted};
use crate::{
    provenance::Provenance,
    report::{
        Axis, Band, Curve, HeatMap, LinePlot, Page, Scale, Stroke, Table, heat_map, line_plot,
    },
};
use std::collections::{BTreeMap, BTreeSet};

const BLUE: [u8; 3] = [31, 105, 180];
const GREY: [u8; 3] = [160, 168, 178];
const PLOT: (u32, u32) = (860, 360);
/// Rows of the table of combinations that are shown at once; `table.csv` has all.
const MOST_ROWS: usize = 200;
/// Points that are listed with their failure.
const MOST_FAILURES: usize = 100;
/// Rows and columns of a heat map whose cells can hold words.
const MOST_LABELLED: (usize, usize) = (16, 8);

/// The page.
#[must_use]
pub fn page(plan: &Plan, merged: &Merged, provenance: &Provenance) -> String {
    let mut page = Page::new(&format!("Sweep of {}", plan.command.name()));
    page.lead(&lead(plan, merged));
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
        format!("Chosen: {name}, the first within one standard error of the best; {figure}.")
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

/// Four digits that matter.
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
            page.section("Over the grid");
            page.paragraph("Mean over seeds; the band goes from the smallest to the largest seed.");
            page.legend(&[("mean", BLUE), ("every seed", GREY)]);
            page.picture(&lines(plan, merged, axis));
        }
        [rows, columns] => {
            page.section("Over the grid");
            page.paragraph("Mean over seeds; a cell without a number has no finished point.");
            page.picture(&map(plan, merged, rows, columns));
        }
        _ => {}
    }
}

/// Combinations of the grid by their values on all axes.
struct Grid<'a> {
    plan: &'a Plan,
    by_values: BTreeMap<Vec<&'a str>, &'a Combination>,
}

impl<'a> Grid<'a> {
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

    /// Where `axes` have these values; every other axis has one only.
    fn at(&self, axes: &[(&GridAxis, usize)]) -> Option<&'a Combination> {
        let value = |axis: &'a GridAxis| {
            let given = axes.iter().find(|(other, _)| other.name == axis.name);
            axis.values[given.map_or(0, |(_, index)| *index)].as_str()
        };
        let values: Vec<&str> = self.plan.axes.iter().map(value).collect();
        self.by_values.get(&values).copied()
    }
}

/// Positions on an axis: its values where all are numbers, else 1, 2, 3.
fn positions(axis: &GridAxis) -> (Vec<f64>, bool) {
    let numbers: Option<Vec<f64>> = axis
        .values
        .iter()
        .map(|value| value.parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    match numbers {
        Some(numbers) => (numbers, true),
        None => ((1..=axis.values.len()).map(|index| index as f64).collect(), false),
    }
}

fn lines(plan: &Plan, merged: &Merged, axis: &GridAxis) -> String {
    let grid = Grid::new(plan, merged);
    let (positions, numeric) = positions(axis);
    let mut found: Vec<(f64, &Combination)> = positions
        .iter()
        .enumerate()
        .filter_map(|(index, x)| grid.at(&[(axis, index)]).map(|one| (*x, one)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let low = |one: &Combination| one.values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = |one: &Combination| one.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let band = found.iter().map(|(x, one)| (*x, low(one), high(one))).collect();
    let mean = found.iter().filter_map(|(x, one)| Some((*x, one.mean?))).collect();
    let seeds: BTreeSet<Option<u64>> =
        found.iter().flat_map(|(_, one)| one.seeds.iter().copied()).collect();
    let mut curves: Vec<Curve> = seeds
        .iter()
        .map(|seed| {
            let value = |(x, one): &(f64, &Combination)| {
                let place = one.seeds.iter().position(|other| other == seed)?;
                Some((*x, one.values[place]))
            };
            let points = found.iter().filter_map(value).collect();
            Curve { colour: GREY, stroke: Stroke::Solid, points }
        })
        .collect();
    curves.push(Curve { colour: BLUE, stroke: Stroke::Solid, points: mean });
    let x = if numeric {
        axis.name.clone()
    } else {
        let names = axis.values.iter().enumerate();
        let names: Vec<String> =
            names.map(|(index, name)| format!("{}: {name}", index + 1)).collect();
        format!("{} ({})", axis.name, names.join(", "))
    };
    line_plot(&LinePlot {
        title: plan.metric.title.clone(),
        x,
        y: Axis { label: plan.metric.title.clone(), scale: Scale::Linear },
        bands: vec![Band { colour: BLUE, points: band }],
        curves,
        size: PLOT,
    })
}

fn map(plan: &Plan, merged: &Merged, rows: &GridAxis, columns: &GridAxis) -> String {
    let grid = Grid::new(plan, merged);
    let cell = |row: usize, column: usize| grid.at(&[(rows, row), (columns, column)]);
    let table = |of: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
        (0..rows.values.len())
            .map(|row| (0..columns.values.len()).map(|column| of(row, column)).collect())
            .collect()
    };
    let mark = |row: usize, column: usize| {
        let chosen = merged.choice.map(|choice| &merged.combinations[choice.chosen]);
        if cell(row, column).is_some_and(|one| Some(one) == chosen) { " *" } else { "" }
    };
    let text = |row: usize, column: usize| {
        let mean = cell(row, column).and_then(|one| one.mean).map_or_else(String::new, digits);
        let (above, across) = (&rows.values[row], &columns.values[column]);
        format!("{above} × {across}: {mean}{}", mark(row, column))
    };
    let (height, width) = (rows.values.len(), columns.values.len());
    let few = height <= MOST_LABELLED.0 && width <= MOST_LABELLED.1;
    let cells = (0..if few { height } else { 0 })
        .map(|row| (0..width).map(|column| text(row, column)).collect())
        .collect();
    heat_map(&HeatMap {
        title: format!("{}; * is the choice", plan.metric.title),
        x: columns.name.clone(),
        y: rows.name.clone(),
        x_range: (0.0, columns.values.len() as f64),
        y_range: (0.0, rows.values.len() as f64),
        values: table(&|row, column| {
            cell(row, column).and_then(|one| one.mean).unwrap_or(f64::NAN)
        }),
        cells,
        size: (900, 120 + 48 * rows.values.len().clamp(3, 12) as u32),
    })
}

fn choice(page: &mut Page, plan: &Plan, merged: &Merged) {
    let Some(choice) = merged.choice else { return };
    page.section("The choice");
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
            "It has one seed, so nothing says how far chance carries it; with several seeds the simplest \
             combination within one standard error would be chosen.",
        );
    } else {
        page.paragraph(&format!(
            "Chosen is the first combination in the order of the sweep file whose mean is within one standard \
             error of it (lists should run from the simplest to the most complex): {}, {}.",
            title(chosen),
            estimate(chosen)
        ));
    }
}

fn combinations(page: &mut Page, plan: &Plan, merged: &Merged) {
    page.section("Every combination");
    page.link("table.csv", "table.csv");
    page.link("table.parquet", "table.parquet has the same, a row for each finished point");
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
    page.paragraph(&format!("By {}, the best first.", plan.metric.title));
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
    page.paragraph("They are tried again with --retry.");
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
    let summary = format!("{count} finished points have lost something or did not meet a gate");
    page.folded_table_of_words(&summary, &table);
}

fn how(page: &mut Page, plan: &Plan, provenance: &Provenance) {
    page.section("How it was made");
    page.code(&provenance.command_line);
    page.paragraph(&format!("Compared is {} of each result:", plan.metric.title));
    page.code(&plan.metric.path);
    if let Some(point) = plan.points.first() {
        page.paragraph("The first point, as it can be typed in the folder of the sweep file:");
        page.code(&format!("{} --output {}", point.command_line, quoted(&point.hash)));
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
