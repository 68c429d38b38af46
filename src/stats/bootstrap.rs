//! Bootstrap intervals over groups.
//!
//! Samples inside one run are strongly correlated. Therefore whole runs are drawn with replacement,
//! and the interval is the percentile interval (Efron and Tibshirani, "An Introduction to the
//! Bootstrap", 1993, chapter 13).

use crate::seed::Stream;
use serde::{Deserialize, Serialize};

/// Number of bootstrap draws for one interval; 25 draws lie beyond each end of a 95 % interval.
const DRAWS: usize = 1000;

/// 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// 2.5th percentile.
    pub low: f64,
    /// 97.5th percentile.
    pub high: f64,
}

/// Return the 95 % interval of `statistic` over `groups`, drawn with replacement from the stream of
/// `seed`. `None` for fewer than two groups.
///
/// ```
/// use klasktron::stats::bootstrap_ci95;
/// let groups = [1.0, 2.0, 3.0, 4.0, 5.0];
/// let mean = |drawn: &[&f64]| drawn.iter().copied().sum::<f64>() / drawn.len() as f64;
/// let interval = bootstrap_ci95(&groups, 0, mean).unwrap();
/// assert!(1.0 < interval.low && interval.low < 3.0 && 3.0 < interval.high);
/// ```
pub fn bootstrap_ci95<T>(
    groups: &[T],
    seed: u64,
    statistic: impl Fn(&[&T]) -> f64,
) -> Option<Interval> {
    if groups.len() < 2 {
        return None;
    }
    let mut stream = Stream::new(seed, "bootstrap");
    let mut drawn: Vec<&T> = Vec::with_capacity(groups.len());
    Some(percentiles(|| {
        draw(groups, &mut stream, &mut drawn);
        statistic(&drawn)
    }))
}

/// Return the sum of `above` over the sum of `below`, over all `groups`, with its 95 % interval as
/// [`bootstrap_ci95`].
///
/// ```
/// use klasktron::stats::ratio_ci95;
/// let goals_and_minutes = [(1.0, 2.0), (0.0, 1.0), (2.0, 3.0)];
/// let (rate, interval) = ratio_ci95(&goals_and_minutes, 0, |one| one.0, |one| one.1);
/// assert_eq!(rate, 0.5);
/// assert!(interval.unwrap().low < rate);
/// ```
pub fn ratio_ci95<T>(
    groups: &[T],
    seed: u64,
    above: impl Fn(&T) -> f64,
    below: impl Fn(&T) -> f64,
) -> (f64, Option<Interval>) {
    let of = |drawn: &[&T]| {
        let sum = |part: &dyn Fn(&T) -> f64| drawn.iter().map(|group| part(group)).sum::<f64>();
        sum(&above) / sum(&below)
    };
    let all: Vec<&T> = groups.iter().collect();
    (of(&all), bootstrap_ci95(groups, seed, of))
}

/// Return the 95 % interval of the difference of `statistic` between `b` and `a` (b minus a), both
/// drawn with replacement. `None` when one of them has fewer than two groups.
pub fn bootstrap_difference_ci95<T>(
    a: &[T],
    b: &[T],
    seed: u64,
    statistic: impl Fn(&[&T]) -> f64,
) -> Option<Interval> {
    if a.len().min(b.len()) < 2 {
        return None;
    }
    let mut stream = Stream::new(seed, "bootstrap difference");
    let (mut drawn_a, mut drawn_b) = (Vec::with_capacity(a.len()), Vec::with_capacity(b.len()));
    Some(percentiles(|| {
        draw(a, &mut stream, &mut drawn_a);
        draw(b, &mut stream, &mut drawn_b);
        statistic(&drawn_b) - statistic(&drawn_a)
    }))
}

fn draw<'a, T>(groups: &'a [T], stream: &mut Stream, drawn: &mut Vec<&'a T>) {
    drawn.clear();
    drawn.extend((0..groups.len()).map(|_| &groups[stream.below(groups.len())]));
}

fn percentiles(value: impl FnMut() -> f64) -> Interval {
    let mut values: Vec<f64> = std::iter::repeat_with(value).take(DRAWS).collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[(share * (DRAWS - 1) as f64).round() as usize];
    Interval { low: at(0.025), high: at(0.975) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_of_the_mean_contain_the_truth_about_as_often_as_they_say() {
        // 200 experiments of 30 uniform numbers; percentile intervals cover slightly less than 95 %.
        let contained = (0..200)
            .filter(|seed| {
                let mut stream = Stream::new(*seed, "experiment");
                let sample: Vec<f32> = (0..30).map(|_| stream.uniform_f32(0.0, 1.0)).collect();
                let mean = |drawn: &[&f32]| {
                    f64::from(drawn.iter().copied().sum::<f32>()) / drawn.len() as f64
                };
                let interval = bootstrap_ci95(&sample, *seed, mean).unwrap();
                interval.low <= 0.5 && 0.5 <= interval.high
            })
            .count();
        assert!((178..=198).contains(&contained), "{contained} of 200");
    }

    #[test]
    fn one_group_has_no_interval() {
        assert_eq!(bootstrap_ci95(&[1.0], 0, |_| 1.0), None);
    }
}
