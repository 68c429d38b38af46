//! Comparison of the policies in simulation and on the rig.

use super::plan::{OPPONENTS, POLICIES, SEATS, match_name};
use crate::stats::{Interval, bootstrap_difference_ci95, ratio_ci95, wilson_ci95};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// An estimate with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// Point estimate.
    pub value: f64,
    /// 95 % interval; null if it cannot be computed.
    pub ci95: Option<Interval>,
}

/// One episode on the rig, from the policy's seat.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Episode {
    minutes: f64,
    scored: f64,
    conceded: f64,
    contacts: f64,
}

/// Results of one policy against one opponent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contest {
    /// Name of the policy.
    pub policy: &'static str,
    /// Name of the opponent.
    pub opponent: &'static str,
    /// Goals of the policy per minute in its own simulation, under the conditions of the rig.
    pub simulated_goals_per_min: Estimate,
    /// Win rate of decided games in its own simulation, 0 to 1.
    pub simulated_win_rate: Option<f64>,
    /// Goals of the policy per minute of play on the rig.
    pub goals_per_min: Estimate,
    /// Goals of the opponent per minute of play on the rig.
    pub conceded_goals_per_min: Estimate,
    /// Fraction of the goals on the rig that the policy scored (Wilson interval).
    pub win_rate: Option<Estimate>,
    /// Mean episode length on the rig (s).
    pub episode_length_s: Estimate,
    /// Contacts of both strikers with the ball per episode on the rig.
    pub contacts_per_episode: Estimate,
    /// Transfer ratio: scoring rate on the rig over that in simulation (bootstrap over the episodes
    /// of both).
    pub transfer_ratio: Option<Estimate>,
    /// Number of episodes on the rig.
    pub episodes: usize,
}

/// Difference between two policies on the rig.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Policy that the paper expects to be better.
    pub better: &'static str,
    /// Policy that the paper expects to be worse.
    pub worse: &'static str,
    /// Net goals per minute of the first minus those of the second.
    pub net_goals_per_min: Estimate,
}

impl Difference {
    /// Result of the comparison by the interval.
    #[must_use]
    pub fn summary(&self) -> &'static str {
        match self.net_goals_per_min.ci95 {
            Some(Interval { low, .. }) if 0.0 < low => "better, as expected",
            Some(Interval { high, .. }) if high < 0.0 => "worse, against the expectation",
            _ => "no significant difference (95 % interval contains 0)",
        }
    }
}

/// Results of the experiment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Experiment {
    /// Results of every policy against every opponent.
    pub contests: Vec<Contest>,
    /// Transfer ratio of each policy, of the scoring rates against all opponents together.
    pub transfer_ratios: Vec<(&'static str, Estimate)>,
    /// Net goals per minute of each policy on the rig, against all opponents together.
    pub net_goals_per_min: Vec<(&'static str, Estimate)>,
    /// Differences between the pairs that the paper's claim orders.
    pub differences: Vec<Difference>,
}

/// Seed of the bootstrap.
const SEED: u64 = 0;

/// Pairs ordered by the claims: a policy whose simulation models the actuator should beat one
/// without (the paper), and one whose simulation models the sensors too.
const CLAIMS: [(&str, &str); 7] = [
    ("twin", "ideal"),
    ("learned", "ideal"),
    ("twin", "randomized"),
    ("learned", "randomized"),
    ("ideal-sensors", "ideal"),
    ("twin-sensors", "twin"),
    ("twin-sensors", "ideal"),
];

impl Experiment {
    /// Compute the experiment from the result documents of `eval` (rig) and `eval-simulated`, which
    /// the same referee has scored; `None` if values are missing.
    #[must_use]
    pub fn new(results: &BTreeMap<String, Value>) -> Option<Self> {
        let (score, simulated) = (results.get("eval")?, results.get("eval-simulated")?);
        let mut contests = Vec::new();
        let mut of_policy: BTreeMap<&str, Arms> = BTreeMap::new();
        for policy in POLICIES.map(|kind| kind.name) {
            for opponent in OPPONENTS {
                let of = |score: &Value| -> Vec<Episode> {
                    let names = SEATS.map(|seat| (match_name(policy, opponent, seat), seat));
                    names.iter().flat_map(|(name, seat)| episodes(score, name, seat)).collect()
                };
                let arms = Arms { rig: of(score), simulated: of(simulated) };
                if arms.simulated.is_empty() {
                    return None;
                }
                contests.push(contest((policy, opponent), &arms));
                let all = of_policy.entry(policy).or_default();
                all.rig.extend(arms.rig);
                all.simulated.extend(arms.simulated);
            }
        }
        let ratio = |policy| Some((policy, of_policy[policy].transfer_ratio()?));
        let net = |policy: &'static str| (policy, rate(&of_policy[policy].rig, net_goals, minutes));
        let difference = |(better, worse): (&'static str, &'static str)| {
            let [a, b] = [&of_policy[worse].rig, &of_policy[better].rig];
            let ci95 = bootstrap_difference_ci95(a, b, SEED, net_rate);
            let [value_a, value_b] = [a, b].map(|all| net_rate(&all.iter().collect::<Vec<_>>()));
            let value = value_b - value_a;
            Difference { better, worse, net_goals_per_min: Estimate { value, ci95 } }
        };
        Some(Self {
            contests,
            transfer_ratios: POLICIES.iter().filter_map(|kind| ratio(kind.name)).collect(),
            net_goals_per_min: POLICIES.map(|kind| net(kind.name)).into(),
            differences: CLAIMS.map(difference).into(),
        })
    }
}

/// Episodes of a policy on the rig and in its simulation.
#[derive(Debug, Clone, Default)]
struct Arms {
    rig: Vec<Episode>,
    simulated: Vec<Episode>,
}

impl Arms {
    /// Transfer ratio of the scoring rates; `None` without a goal in simulation. The interval is
    /// that of the difference of the logarithms.
    fn transfer_ratio(&self) -> Option<Estimate> {
        let logarithm = |drawn: &[&Episode]| {
            let sum = |part: fn(&Episode) -> f64| drawn.iter().map(|one| part(one)).sum::<f64>();
            (sum(scored) / sum(minutes)).ln()
        };
        let [rig, simulated] =
            [&self.rig, &self.simulated].map(|arm| logarithm(&arm.iter().collect::<Vec<_>>()));
        if !simulated.is_finite() {
            return None;
        }
        let ci95 = bootstrap_difference_ci95(&self.simulated, &self.rig, SEED, logarithm)
            .map(|ci| Interval { low: ci.low.exp(), high: ci.high.exp() })
            .filter(|ci| ci.low.is_finite() && ci.high.is_finite());
        Some(Estimate { value: (rig - simulated).exp(), ci95 })
    }
}

fn scored(episode: &Episode) -> f64 {
    episode.scored
}

fn minutes(episode: &Episode) -> f64 {
    episode.minutes
}

fn net_goals(episode: &Episode) -> f64 {
    episode.scored - episode.conceded
}

fn net_rate(drawn: &[&Episode]) -> f64 {
    let sum = |part: fn(&Episode) -> f64| drawn.iter().map(|episode| part(episode)).sum::<f64>();
    sum(net_goals) / sum(minutes)
}

/// Ratio of the sums of `above` and `below`, with a bootstrap interval over episodes.
fn rate(episodes: &[Episode], above: fn(&Episode) -> f64, below: fn(&Episode) -> f64) -> Estimate {
    let (value, ci95) = ratio_ci95(episodes, SEED, above, below);
    Estimate { value, ci95 }
}

/// Episodes of the match called `name`, from `seat`.
fn episodes(score: &Value, name: &str, seat: &str) -> Vec<Episode> {
    let matches = score["matches"].as_array().map_or(&[][..], Vec::as_slice);
    let own = |one: &&Value| {
        let file = one["file"].as_str().unwrap_or_default();
        std::path::Path::new(file).file_stem().is_some_and(|stem| stem == name)
    };
    let found = matches.iter().find(own).and_then(|one| one["episodes"].as_array());
    let episode = |one: &Value| {
        let number = |key: &str| one[key].as_f64().unwrap_or(0.0);
        let scorer = one["scorer"].as_str();
        Episode {
            minutes: (number("end_s") - number("start_s")) / 60.0,
            scored: f64::from(u8::from(scorer == Some(seat))),
            conceded: f64::from(u8::from(scorer.is_some_and(|scorer| scorer != seat))),
            contacts: number("contacts"),
        }
    };
    found.map_or(&[][..], Vec::as_slice).iter().map(episode).collect()
}

fn contest((policy, opponent): (&'static str, &'static str), arms: &Arms) -> Contest {
    let one = |_: &Episode| 1.0;
    let goals = |episodes: &[Episode], part: fn(&Episode) -> f64| {
        episodes.iter().map(part).sum::<f64>() as u64
    };
    let decided = |episodes: &[Episode]| {
        (goals(episodes, scored), goals(episodes, |episode| episode.conceded))
    };
    let share = |(won, lost): (u64, u64)| won as f64 / (won + lost) as f64;
    let (won, lost) = decided(&arms.rig);
    let win_rate = (0 < won + lost)
        .then(|| Estimate { value: share((won, lost)), ci95: wilson_ci95(won, won + lost) });
    let simulated = decided(&arms.simulated);
    Contest {
        policy,
        opponent,
        simulated_goals_per_min: rate(&arms.simulated, scored, minutes),
        simulated_win_rate: (0 < simulated.0 + simulated.1).then(|| share(simulated)),
        goals_per_min: rate(&arms.rig, scored, minutes),
        conceded_goals_per_min: rate(&arms.rig, |episode| episode.conceded, minutes),
        win_rate,
        episode_length_s: rate(&arms.rig, |episode| 60.0 * episode.minutes, one),
        contacts_per_episode: rate(&arms.rig, |episode| episode.contacts, one),
        transfer_ratio: arms.transfer_ratio(),
        episodes: arms.rig.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Ten episodes of half a minute: `won` goals for `seat`, `lost` for the other one.
    fn played(name: &str, seat: &str, (won, lost): (usize, usize)) -> Value {
        let other = if seat == "left" { "right" } else { "left" };
        let scorer = |number: usize| match number {
            n if n < won => json!(seat),
            n if n < won + lost => json!(other),
            _ => json!(null),
        };
        let episode = |number: usize| {
            let start = 30.0 * number as f64;
            json!({"start_s": start, "end_s": start + 30.0, "scorer": scorer(number), "contacts": 4})
        };
        json!({"file": format!("matches/{name}.mcap"), "episodes": (0..10).map(episode).collect::<Vec<_>>()})
    }

    fn results(points: impl Fn(&str) -> (usize, usize)) -> BTreeMap<String, Value> {
        let mut results = BTreeMap::new();
        let (mut matches, mut simulated) = (Vec::new(), Vec::new());
        for kind in POLICIES {
            for opponent in OPPONENTS {
                for seat in SEATS {
                    let name = match_name(kind.name, opponent, seat);
                    matches.push(played(&name, seat, points(kind.name)));
                    simulated.push(played(&name, seat, (5, 0)));
                }
            }
        }
        results.insert("eval".to_owned(), json!({"matches": matches}));
        results.insert("eval-simulated".to_owned(), json!({"matches": simulated}));
        results
    }

    #[test]
    fn rates_are_points_per_minute_of_the_policys_own_seat() {
        let experiment = Experiment::new(&results(|_| (4, 1))).unwrap();
        assert_eq!(experiment.contests.len(), 12);
        for contest in &experiment.contests {
            // 8 goals and 2 of the other one in 20 episodes, 10 minutes.
            assert!((contest.goals_per_min.value - 0.8).abs() < 1e-12, "{contest:?}");
            assert!((contest.conceded_goals_per_min.value - 0.2).abs() < 1e-12);
            assert!((contest.win_rate.unwrap().value - 0.8).abs() < 1e-12);
            assert!((contest.episode_length_s.value - 30.0).abs() < 1e-9);
            let kept = contest.transfer_ratio.unwrap();
            assert!((kept.value - 0.8).abs() < 1e-12);
            let kept = kept.ci95.unwrap();
            assert!(0.3 < kept.low && kept.low < 0.8 && 0.8 < kept.high, "{kept:?}");
            assert!((contest.simulated_goals_per_min.value - 1.0).abs() < 1e-12);
        }
        assert!(
            experiment
                .differences
                .iter()
                .all(|one| one.summary() == "no significant difference (95 % interval contains 0)")
        );
    }

    #[test]
    fn an_order_is_only_claimed_where_the_interval_shows_it() {
        let points = |name: &str| if name == "ideal" { (1, 7) } else { (8, 1) };
        let experiment = Experiment::new(&results(points)).unwrap();
        let said: Vec<&str> = experiment.differences.iter().map(Difference::summary).collect();
        let [better, same] =
            ["better, as expected", "no significant difference (95 % interval contains 0)"];
        assert_eq!(said, [better, better, same, same, better, same, better]);
        let points = |name: &str| if name == "twin" { (0, 9) } else { (8, 1) };
        let experiment = Experiment::new(&results(points)).unwrap();
        assert_eq!(experiment.differences[0].summary(), "worse, against the expectation");
    }

    #[test]
    fn without_a_score_there_is_no_experiment() {
        let mut results = results(|_| (4, 1));
        results.remove("eval-simulated");
        assert_eq!(Experiment::new(&results), None);
    }
}
