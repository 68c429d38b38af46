//! Combinations of options over their seeds, and the choice among them.

use super::{Better, Plan, Row};
use crate::stats::{mean, standard_deviation};
use serde::Serialize;
use std::collections::BTreeMap;

/// A combination of options with the results of its seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Combination {
    /// Options that differ between combinations, with their values.
    pub settings: BTreeMap<String, String>,
    /// Finished seeds; `None` for a command without random numbers or with its own default.
    pub seeds: Vec<Option<u64>>,
    /// Metric of each seed.
    pub values: Vec<f64>,
    /// Mean over seeds.
    pub mean: Option<f64>,
    /// Standard error of the mean; `None` below two seeds.
    pub standard_error: Option<f64>,
}

/// Choice among combinations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// Index of the best mean.
    pub best: usize,
    /// Index of the first combination, in the order of the file, whose mean is within one standard
    /// error of the best. This is the one-standard-error rule (Breiman et al., "Classification and
    /// Regression Trees", 1984, section 3.4.3) for lists from the simplest to the most complex.
    /// Equal to `best` with a single seed.
    pub chosen: usize,
}

/// Combinations of `plan` that have a finished point with a metric, in the order of the file.
#[must_use]
pub fn combinations(plan: &Plan, rows: &[Row]) -> Vec<Combination> {
    let mut order: BTreeMap<&BTreeMap<String, String>, usize> = BTreeMap::new();
    let mut combinations: Vec<Combination> = Vec::new();
    for row in rows {
        let Some(metric) = row.metric else { continue };
        let settings = &plan.points[row.index].settings;
        let place = *order.entry(settings).or_insert_with(|| {
            combinations.push(Combination {
                settings: settings.clone(),
                seeds: Vec::new(),
                values: Vec::new(),
                mean: None,
                standard_error: None,
            });
            combinations.len() - 1
        });
        combinations[place].seeds.push(plan.points[row.index].seed);
        combinations[place].values.push(metric);
    }
    for one in &mut combinations {
        one.mean = mean(&one.values);
        let spread = standard_deviation(&one.values);
        one.standard_error = spread.map(|spread| spread / (one.values.len() as f64).sqrt());
    }
    combinations
}

/// Best of `combinations`, and the choice by the one-standard-error rule.
#[must_use]
pub fn choose(combinations: &[Combination], better: Better) -> Option<Choice> {
    // As costs: smaller is better.
    let cost = |one: &Combination| match better {
        Better::Smaller => one.mean,
        Better::Larger => one.mean.map(|mean| -mean),
    };
    let costs: Vec<(usize, f64)> = combinations
        .iter()
        .enumerate()
        .filter_map(|(index, one)| cost(one).map(|cost| (index, cost)))
        .collect();
    let (best, least) = *costs.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let within = least + combinations[best].standard_error.unwrap_or(0.0);
    let (chosen, _) = *costs.iter().find(|(_, cost)| *cost <= within)?;
    Some(Choice { best, chosen })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> Combination {
        let spread = standard_deviation(values);
        Combination {
            settings: BTreeMap::new(),
            seeds: (0..values.len() as u64).map(Some).collect(),
            values: values.to_vec(),
            mean: mean(values),
            standard_error: spread.map(|spread| spread / (values.len() as f64).sqrt()),
        }
    }

    #[test]
    fn the_first_within_one_standard_error_of_the_best_is_chosen() {
        // The best has mean 1 and standard error 0.2 / sqrt(4) = 0.1.
        let spread = 0.2 * (3.0_f64 / 4.0).sqrt();
        let best = of(&[1.0 - spread, 1.0 + spread, 1.0 - spread, 1.0 + spread]);
        assert!((best.standard_error.unwrap() - 0.1).abs() < 1e-12);
        let all = [of(&[1.3, 1.3]), of(&[1.09, 1.09]), best.clone(), of(&[1.05, 1.05])];
        assert_eq!(choose(&all, Better::Smaller), Some(Choice { best: 2, chosen: 1 }));
        let far = [of(&[1.11, 1.11]), best];
        assert_eq!(choose(&far, Better::Smaller), Some(Choice { best: 1, chosen: 1 }));
    }

    #[test]
    fn a_rate_is_better_the_larger_it_is() {
        let all = [of(&[0.1]), of(&[0.9]), of(&[0.5])];
        assert_eq!(choose(&all, Better::Larger), Some(Choice { best: 1, chosen: 1 }));
        assert_eq!(choose(&[], Better::Larger), None);
    }
}
