//! Statistical comparison of two groups of matches: simulated and real ones, or those of two
//! policies.

use super::{
    analysis::Episode,
    matches::ScoredMatch,
    metric::{Figure, Metric, summarise},
};
use crate::stats::{Interval, bootstrap_difference_ci95, holm, permutation_p};
use serde::Serialize;

/// Significance level of the corrected p-values.
const SIGNIFICANT: f64 = 0.05;

/// A group of matches.
pub struct Group<'a> {
    /// Name of the group.
    pub name: String,
    /// Number of matches.
    pub matches: usize,
    /// Episodes of all matches.
    pub episodes: Vec<&'a Episode>,
}

impl<'a> Group<'a> {
    /// Group of `matches` with the name `name`.
    #[must_use]
    pub fn new(name: &str, matches: &'a [ScoredMatch]) -> Self {
        let episodes = matches.iter().flat_map(|scored| &scored.analysis.episodes).collect();
        Self { name: name.to_owned(), matches: matches.len(), episodes }
    }
}

/// Comparison of two groups.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Names of both groups.
    pub groups: [String; 2],
    /// Numbers of matches.
    pub matches: [usize; 2],
    /// Numbers of episodes.
    pub episodes: [usize; 2],
    /// Differences by metric.
    pub metrics: Vec<Difference>,
    /// Result as a sentence.
    pub summary: String,
}

/// Difference of one metric.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Name of the metric.
    pub metric: &'static str,
    /// Value in the first group.
    pub a: Figure,
    /// Value in the second group.
    pub b: Figure,
    /// Second minus first; null if a group has no value.
    pub difference: Option<f64>,
    /// 95 % interval of the difference (bootstrap over the episodes of both groups).
    pub ci95: Option<[f64; 2]>,
    /// p-value of a permutation test over episodes.
    pub p_value: Option<f64>,
    /// p-value with the Holm correction for the number of metrics.
    pub p_value_corrected: Option<f64>,
}

/// Compare `b` with `a`.
#[must_use]
pub fn compare(a: &Group<'_>, b: &Group<'_>, seed: u64) -> Comparison {
    let of_a = summarise(a.episodes.iter().copied(), seed);
    let of_b = summarise(b.episodes.iter().copied(), seed);
    let mut metrics: Vec<Difference> = Metric::ALL
        .into_iter()
        .map(|metric| {
            let (x, y) =
                (metric.of(a.episodes.iter().copied()), metric.of(b.episodes.iter().copied()));
            let statistic = |drawn: &[&&Episode]| {
                metric.value(&drawn.iter().map(|episode| **episode).collect::<Vec<_>>())
            };
            let (a, b) = (of_a[metric.name()], of_b[metric.name()]);
            Difference {
                metric: metric.name(),
                a,
                b,
                difference: a.mean.zip(b.mean).map(|(a, b)| b - a),
                ci95: bootstrap_difference_ci95(&x, &y, seed, statistic)
                    .map(|Interval { low, high }| [low, high]),
                p_value: permutation_p(&x, &y, seed, statistic),
                p_value_corrected: None,
            }
        })
        .collect();
    let tested: Vec<f64> = metrics.iter().filter_map(|metric| metric.p_value).collect();
    let mut corrected = holm(&tested).into_iter();
    for metric in metrics.iter_mut().filter(|metric| metric.p_value.is_some()) {
        metric.p_value_corrected = corrected.next();
    }
    let summary = summary([a, b].map(|group| group.name.as_str()), &metrics);
    Comparison {
        groups: [a.name.clone(), b.name.clone()],
        matches: [a.matches, b.matches],
        episodes: [a.episodes.len(), b.episodes.len()],
        metrics,
        summary,
    }
}

fn title(name: &str) -> &'static str {
    Metric::ALL.into_iter().find(|metric| metric.name() == name).map_or("", Metric::title)
}

fn summary([a, b]: [&str; 2], metrics: &[Difference]) -> String {
    let tested = metrics.iter().filter(|metric| metric.p_value_corrected.is_some()).count();
    if tested == 0 {
        return format!(
            "{a} and {b} cannot be compared: each group needs at least two finished episodes"
        );
    }
    let differ: Vec<String> = metrics
        .iter()
        .filter(|metric| metric.p_value_corrected.is_some_and(|p| p < SIGNIFICANT))
        .filter_map(|metric| {
            let ([low, high], difference) = (metric.ci95?, metric.difference?);
            Some(format!(
                "{} by {difference:+.3} (95 %: {low:+.3} to {high:+.3})",
                title(metric.metric)
            ))
        })
        .collect();
    if differ.is_empty() {
        format!(
            "no significant difference between {a} and {b} in any of {tested} metrics (permutation \
             tests, Holm-corrected p >= {SIGNIFICANT})"
        )
    } else {
        format!(
            "{b} differs from {a} in {} (permutation tests over {tested} metrics, Holm-corrected p < \
             {SIGNIFICANT})",
            differ.join(", ")
        )
    }
}
