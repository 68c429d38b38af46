//! `index.html` of several seeds: their learning curves together, and how good each is.

use super::{
    CurvePoint, Evaluation, LEARNER_NAME,
    page::{BLUE, PICTURES, SIZE},
};
use crate::{
    provenance::Provenance,
    report::{Axis, Band, Curve, LinePlot, Page, Scale, Stroke, Table, line_plot},
    stats::{mean, median, standard_deviation},
};
use std::collections::BTreeSet;

const GREY: [u8; 3] = [160, 168, 178];

/// A finished seed.
#[derive(Debug, Clone)]
pub struct SeedRun {
    /// The seed.
    pub seed: u64,
    /// How good its policy is; `None` where it was not judged.
    pub evaluation: Option<Evaluation>,
    /// How it learned.
    pub curve: Vec<CurvePoint>,
}

impl SeedRun {
    /// Share of decided games won against `opponent`, 0 to 1.
    fn won_share(&self, opponent: &str) -> Option<f64> {
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
    strength(&mut page, runs);
    page.section("Learning");
    page.paragraph("The median of all seeds, every seed, and the band between the extremes.");
    page.legend(&[("median", BLUE), ("every seed", GREY)]);
    page.pictures_in_row(&PICTURES.map(|picture| plot(runs, picture)));
    page.section("Every seed");
    for run in runs {
        page.link(&format!("seed-{}/index.html", run.seed), &format!("seed {}", run.seed));
    }
    page.link("table.csv", "table.csv: every figure of every seed");
    page.section("How it was made");
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
        let shares: Vec<f64> = runs.iter().filter_map(|run| run.won_share(opponent)).collect();
        format!("{} % against {opponent}", over_seeds(&shares, 100.0, 1))
    };
    let shares: Vec<String> = opponents(runs).iter().map(against).collect();
    let shares = if shares.is_empty() {
        String::new()
    } else {
        format!(
            " Of decided games they win (mean ± standard deviation over seeds) {}.",
            shares.join(", ")
        )
    };
    format!("{} seeds are finished.{shares}", runs.len())
}

fn strength(page: &mut Page, runs: &[SeedRun]) {
    let opponents = opponents(runs);
    if opponents.is_empty() {
        return;
    }
    page.section("Strength");
    page.paragraph("Share of decided games that the policy wins (%), and its Elo in the round robin of its run.");
    let mut head = vec!["seed".to_owned()];
    head.extend(opponents.iter().cloned());
    head.push("Elo".to_owned());
    let row = |run: &SeedRun| {
        let mut cells = vec![run.seed.to_string()];
        let share = |share: Option<f64>| {
            share.map_or_else(|| "-".to_owned(), |share| format!("{:.1}", 100.0 * share))
        };
        cells.extend(opponents.iter().map(|opponent| share(run.won_share(opponent))));
        cells.push(run.elo().map_or_else(|| "-".to_owned(), |elo| format!("{elo:.0}")));
        cells
    };
    let mut rows: Vec<Vec<String>> = runs.iter().map(row).collect();
    let mut last = vec!["mean ± standard deviation".to_owned()];
    for opponent in &opponents {
        let shares: Vec<f64> = runs.iter().filter_map(|run| run.won_share(opponent)).collect();
        last.push(over_seeds(&shares, 100.0, 1));
    }
    last.push(over_seeds(&runs.iter().filter_map(SeedRun::elo).collect::<Vec<_>>(), 1.0, 0));
    rows.push(last);
    page.table(&Table { head, rows });
}

fn plot(runs: &[SeedRun], (title, figure, unit): (&str, &str, &str)) -> String {
    let value = |point: &CurvePoint| {
        point.figures().iter().find(|(name, _)| *name == figure).map(|(_, value)| *value)
    };
    let curve = |run: &SeedRun| -> Vec<(f64, f64)> {
        let points = run.curve.iter();
        points.filter_map(|point| Some((point.transitions as f64 / 1e6, value(point)?))).collect()
    };
    let seeds: Vec<Vec<(f64, f64)>> = runs.iter().map(curve).collect();
    let shortest = seeds.iter().map(Vec::len).min().unwrap_or(0);
    let at = |index: usize| seeds.iter().map(|seed| seed[index].1).collect::<Vec<f64>>();
    let x = |index: usize| seeds[0][index].0;
    let extremes = |index: usize| {
        let values = at(index);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        (x(index), low, values.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let middle = (0..shortest).filter_map(|index| Some((x(index), median(&at(index))?)));
    let middle = Curve { colour: BLUE, stroke: Stroke::Solid, points: middle.collect() };
    let band = Band { colour: BLUE, points: (0..shortest).map(extremes).collect() };
    let every = seeds.iter();
    let every =
        every.map(|points| Curve { colour: GREY, stroke: Stroke::Solid, points: points.clone() });
    line_plot(&LinePlot {
        title: title.to_owned(),
        x: "transitions (million)".to_owned(),
        y: Axis { label: unit.to_owned(), scale: Scale::Linear },
        bands: vec![band],
        curves: every.chain([middle]).collect(),
        size: SIZE,
    })
}
