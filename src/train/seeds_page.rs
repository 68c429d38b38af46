//! `index.html` of several seeds: learning curves together, and the evaluation of each.

use super::{
    CurvePoint, Evaluation, LEARNER_NAME,
    page::{learning, learning_charts},
};
use crate::{
    provenance::Provenance,
    report::{Colour, Page, Points, Ranges, Series, Table},
    stats::{mean, median, standard_deviation},
};
use std::collections::BTreeSet;

/// A finished seed.
#[derive(Debug, Clone)]
pub struct SeedRun {
    /// The seed.
    pub seed: u64,
    /// Evaluation of its policy; `None` without one.
    pub evaluation: Option<Evaluation>,
    /// Learning curve.
    pub curve: Vec<CurvePoint>,
}

impl SeedRun {
    /// Share of decided games won against `opponent`, 0 to 1.
    fn win_rate(&self, opponent: &str) -> Option<f64> {
        let judged = &self.evaluation.as_ref()?.opponents;
        judged.iter().find(|judged| judged.opponent == opponent)?.win_rate
    }

    fn elo(&self) -> Option<f64> {
        let table = &self.evaluation.as_ref()?.elo;
        table.iter().find(|row| row.player == LEARNER_NAME).map(|row| row.rating)
    }
}

/// The page of `runs`.
#[must_use]
pub fn seeds_page(runs: &[SeedRun], provenance: &Provenance) -> String {
    let mut page = Page::new("Training, several seeds");
    page.lead(&lead(runs));
    evaluation(&mut page, runs);
    page.section("Learning curves");
    page.paragraph("Median over all seeds, each seed, and the range over seeds.");
    page.charts(&learning_charts(&|metric| series(runs, metric)));
    page.section("Seeds");
    for run in runs {
        page.link(&format!("seed-{}/index.html", run.seed), &format!("seed {}", run.seed));
    }
    page.link("table.csv", "table.csv: all metrics of all seeds");
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.facts(provenance.facts());
    page.finish()
}

fn opponents(runs: &[SeedRun]) -> Vec<String> {
    let all = runs.iter().filter_map(|run| run.evaluation.as_ref()).flat_map(|one| &one.opponents);
    let mut known = BTreeSet::new();
    all.filter(|judged| known.insert(judged.opponent.clone()))
        .map(|judged| judged.opponent.clone())
        .collect()
}

/// `61.2 ± 3.4`, mean and standard deviation over seeds.
fn over_seeds(values: &[f64], scale: f64, decimals: usize) -> String {
    let Some(mean) = mean(values) else { return "-".to_owned() };
    let spread = standard_deviation(values)
        .map_or_else(String::new, |spread| format!(" ± {:.decimals$}", scale * spread));
    format!("{:.decimals$}{spread}", scale * mean)
}

fn lead(runs: &[SeedRun]) -> String {
    let against = |opponent: &String| {
        let shares: Vec<f64> = runs.iter().filter_map(|run| run.win_rate(opponent)).collect();
        format!("{} % against {opponent}", over_seeds(&shares, 100.0, 1))
    };
    let shares: Vec<String> = opponents(runs).iter().map(against).collect();
    let shares = if shares.is_empty() {
        String::new()
    } else {
        format!(
            " Win rate of decided games (mean ± standard deviation over seeds): {}.",
            shares.join(", ")
        )
    };
    format!("{} seeds are finished.{shares}", runs.len())
}

fn evaluation(page: &mut Page, runs: &[SeedRun]) {
    let opponents = opponents(runs);
    if opponents.is_empty() {
        return;
    }
    page.section("Evaluation");
    page.paragraph("Win rate of decided games (%), and Elo rating in the round robin of each run.");
    let mut head = vec!["seed".to_owned()];
    head.extend(opponents.iter().cloned());
    head.push("Elo".to_owned());
    let row = |run: &SeedRun| {
        let mut cells = vec![run.seed.to_string()];
        let share = |share: Option<f64>| {
            share.map_or_else(|| "-".to_owned(), |share| format!("{:.1}", 100.0 * share))
        };
        cells.extend(opponents.iter().map(|opponent| share(run.win_rate(opponent))));
        cells.push(run.elo().map_or_else(|| "-".to_owned(), |elo| format!("{elo:.0}")));
        cells
    };
    let mut rows: Vec<Vec<String>> = runs.iter().map(row).collect();
    let mut last = vec!["mean ± standard deviation".to_owned()];
    for opponent in &opponents {
        let shares: Vec<f64> = runs.iter().filter_map(|run| run.win_rate(opponent)).collect();
        last.push(over_seeds(&shares, 100.0, 1));
    }
    last.push(over_seeds(&runs.iter().filter_map(SeedRun::elo).collect::<Vec<_>>(), 1.0, 0));
    rows.push(last);
    page.table(&Table { head, rows });
}

/// Median, range and single curves of one metric.
fn series(runs: &[SeedRun], metric: &str) -> Vec<Series> {
    let seeds: Vec<Points> = runs.iter().map(|run| learning(&run.curve, metric)).collect();
    let shortest = seeds.iter().map(Vec::len).min().unwrap_or(0);
    let at = |index: usize| seeds.iter().map(|seed| seed[index].1).collect::<Vec<f64>>();
    let x = |index: usize| seeds[0][index].0;
    let extremes = |index: usize| {
        let values = at(index);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        (x(index), low, values.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let middle = (0..shortest).filter_map(|index| Some((x(index), median(&at(index))?))).collect();
    let range: Ranges = (0..shortest).map(extremes).collect();
    vec![
        Series::lines("every seed", Colour::Grey, seeds.clone()).with_width(1.2),
        Series::line("median and range", Colour::Blue, middle).with_band(range),
    ]
}
