//! Plan of a collection: runs with their pattern, length and split.

use super::error::PlanError;
use crate::{
    gantry::{Heading, Pattern, Slope, Turn},
    recording::Split,
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// One run of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedRun {
    /// Number in the run markers, unique in the plan.
    pub number: u32,
    /// Excitation pattern.
    pub pattern: Pattern,
    /// Training or validation.
    pub split: Split,
    /// Number of control periods.
    pub samples: usize,
}

/// Plan of a collection. It can be saved as JSON, edited and read back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Name in the metadata of the recording.
    pub name: String,
    /// Commands per second (Hz), [10, 1000]; 50 on the KlaskTron table.
    pub rate_hz: f64,
    /// Seed of all random numbers; each run has its own stream.
    pub seed: u64,
    /// Runs in the order of execution.
    pub runs: Vec<PlannedRun>,
}

/// Settings of [`Plan::from_patterns`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Commands per second (Hz), [10, 1000]; 50.
    pub rate_hz: f64,
    /// Seed of all random numbers; 1.
    pub seed: u64,
    /// Length of a run (s); 15, as upstream.
    pub seconds: f64,
    /// Number of runs of each pattern; 6.
    pub repeat: u32,
    /// Interval of validation runs: every n-th run of a pattern; 6, and `None` for no validation
    /// run.
    pub validation_every: Option<u32>,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { rate_hz: 50.0, seed: 1, seconds: 15.0, repeat: 6, validation_every: Some(6) }
    }
}

/// Largest number of samples of a plan; 55 hours at 50 Hz.
const MOST_SAMPLES: usize = 10_000_000;
/// Samples of the paper's data set at 50 Hz (appendix C.1).
const PAPER_SAMPLES: f64 = 69_669.0;
const PAPER_RATE_HZ: f64 = 50.0;
/// Number of runs of each of the paper's four families: the data set of 23.2 min in runs of 14.5 s.
const PAPER_RUNS: usize = 24;
/// Interval of validation runs.
const PAPER_VALIDATION: usize = 6;
/// Number of passes of the plan from slow to fast.
const PAPER_PASSES: usize = 3;

impl Plan {
    /// Read and check a plan.
    ///
    /// # Errors
    /// When the JSON is invalid, or a value is out of range.
    pub fn from_json(text: &str) -> Result<Self, PlanError> {
        let plan: Self = serde_json::from_str(text)?;
        plan.check()?;
        Ok(plan)
    }

    /// Write the plan as JSON for [`from_json`](Self::from_json).
    ///
    /// # Errors
    /// When a number is not finite.
    pub fn to_json(&self) -> Result<String, PlanError> {
        self.check()?;
        Ok(serde_json::to_string_pretty(self)?)
    }

    /// Create the paper's data set: circles, diagonals, ramps and random walks at speeds up to 0.7
    /// m/s along each axis. It has 69,669 samples at 50 Hz (23.2 min), or the same duration at
    /// another rate.
    ///
    /// Each family has 24 runs at 24 speeds. Four of them are validation runs, with speeds between
    /// those of the training runs. The order passes three times from slow to fast, so that the
    /// first runs are gentle and speed is not confounded with temperature.
    ///
    /// # Errors
    /// When the rate is out of range.
    pub fn paper(rate_hz: f64, seed: u64) -> Result<Self, PlanError> {
        check_range("rate_hz", rate_hz, "[10, 1000] Hz", |rate| (10.0..=1000.0).contains(&rate))?;
        let total = (PAPER_SAMPLES / PAPER_RATE_HZ * rate_hz).round() as usize;
        let mut order: Vec<usize> = (0..PAPER_RUNS).collect();
        order.sort_by_key(|index| (index % PAPER_PASSES, index / PAPER_PASSES));
        let families = [paper_circle, paper_diagonal, paper_ramp, paper_walk];
        let count = PAPER_RUNS * families.len();
        let (length, longer) = (total / count, total % count);
        let mut runs = Vec::with_capacity(count);
        for index in order {
            for family in families {
                let position = runs.len();
                runs.push(PlannedRun {
                    number: position as u32 + 1,
                    pattern: family(index),
                    split: paper_split(index),
                    samples: length + usize::from(position < longer),
                });
            }
        }
        let plan = Self { name: "paper".to_owned(), rate_hz, seed, runs };
        plan.check()?;
        Ok(plan)
    }

    /// Create a plan that repeats each pattern as `schedule` demands; the patterns alternate.
    ///
    /// # Errors
    /// When the list of patterns is empty, or a value is out of range.
    pub fn from_patterns(patterns: &[Pattern], schedule: &Schedule) -> Result<Self, PlanError> {
        let Schedule { rate_hz, seed, seconds, repeat, validation_every } = *schedule;
        check_range("repeat", f64::from(repeat), "[1, 1000]", |v| (1.0..=1000.0).contains(&v))?;
        check_range("seconds", seconds, "[0.2, 20000] s", |v| (0.2..=20_000.0).contains(&v))?;
        if let Some(every) = validation_every {
            check_range("validation_every", f64::from(every), "1 or more", |v| 1.0 <= v)?;
        }
        let samples = (seconds * rate_hz).round() as usize;
        let mut runs = Vec::new();
        for turn in 1..=repeat {
            let judges = validation_every.is_some_and(|every| turn % every == 0);
            let split = if judges { Split::Validation } else { Split::Train };
            for &pattern in patterns {
                runs.push(PlannedRun { number: runs.len() as u32 + 1, pattern, split, samples });
            }
        }
        let plan = Self { name: "patterns".to_owned(), rate_hz, seed, runs };
        plan.check()?;
        Ok(plan)
    }

    /// Check every value that does not depend on the robot.
    ///
    /// # Errors
    /// At the first value out of range.
    pub fn check(&self) -> Result<(), PlanError> {
        check_range("rate_hz", self.rate_hz, "[10, 1000] Hz", |v| (10.0..=1000.0).contains(&v))?;
        if self.runs.is_empty() {
            return Err(PlanError::NoRun);
        }
        let mut numbers = BTreeSet::new();
        for run in &self.runs {
            if !numbers.insert(run.number) {
                return Err(PlanError::NumberTwice { number: run.number });
            }
            let in_range = |v: f64| (10.0..=1e6).contains(&v);
            let name = format!("runs[{}].samples", run.number);
            check_range(&name, run.samples as f64, "[10, 1000000]", in_range)?;
        }
        let most = MOST_SAMPLES as f64;
        check_range("samples of all runs", self.samples() as f64, "[10, 10000000]", |v| v <= most)?;
        Ok(())
    }

    /// Return the number of samples of all runs.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.runs.iter().fold(0, |sum: usize, run| sum.saturating_add(run.samples))
    }

    /// Return the seed of one run.
    pub(super) fn seed_of(&self, number: u32) -> u64 {
        Stream::new(self.seed, &format!("collect: run {number}")).below(usize::MAX) as u64
    }
}

pub(super) fn check_range(
    name: &str,
    value: f64,
    range: &'static str,
    holds: impl Fn(f64) -> bool,
) -> Result<(), PlanError> {
    if holds(value) {
        return Ok(());
    }
    Err(PlanError::OutOfRange { name: name.to_owned(), value, range })
}

// The validation run advances by one from six to six, so that it covers every direction.
fn paper_split(index: usize) -> Split {
    let judge = (2 + index / PAPER_VALIDATION) % PAPER_VALIDATION;
    if index % PAPER_VALIDATION == judge { Split::Validation } else { Split::Train }
}

/// Return the `index`-th of evenly spaced values, one per run, rounded to a thousandth.
fn spaced(index: usize, low: f64, high: f64) -> f64 {
    let share = index as f64 / (PAPER_RUNS - 1) as f64;
    thousandths(low + (high - low) * share)
}

fn thousandths(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// Circles of several radii. A fast circle must be large enough for an acceleration of 10 m/s^2,
/// and small enough to leave room to stop.
fn paper_circle(index: usize) -> Pattern {
    const RADII_M: [f64; 3] = [0.02, 0.035, 0.05];
    /// Centripetal acceleration of a circle at most (m/s^2), below the slew limit.
    const INWARD: f64 = 8.5;
    let speed = spaced(index, 0.05, 0.6);
    let least = thousandths(speed * speed / INWARD + 5e-4);
    let turn = if index.is_multiple_of(2) { Turn::Counterclockwise } else { Turn::Clockwise };
    Pattern::Circle { radius_m: RADII_M[index % 3].max(least), speed_m_per_s: speed, turn }
}

/// Diagonals, up to 0.7 m/s along each axis; shorter at high speed, to leave room to stop.
fn paper_diagonal(index: usize) -> Pattern {
    let speed = spaced(index, 0.05, 0.985);
    let slope = if index.is_multiple_of(2) { Slope::Up } else { Slope::Down };
    let length_m = thousandths(0.19 - 0.085 * speed);
    Pattern::Diagonal { slope, length_m, speed_m_per_s: speed }
}

/// Ramps along both axes and both diagonals, as slow as the workspace allows.
fn paper_ramp(index: usize) -> Pattern {
    /// Length reserved for holding the top speed (m): more than a control period at 0.7 m/s.
    const ROOM_M: f64 = 0.025;
    let heading = Heading::ALL[index % 4];
    let (top, length_m) = match heading {
        Heading::X => (0.7, 0.18),
        Heading::Y => (0.55, 0.11),
        Heading::Up | Heading::Down => (0.8, 0.15),
    };
    let speed = spaced(index, 0.1, top);
    let rate = thousandths(speed * speed / (length_m - ROOM_M) + 0.1);
    Pattern::Ramp { heading, length_m, speed_m_per_s: speed, rate_m_per_s2: rate }
}

fn paper_walk(index: usize) -> Pattern {
    let speed_m_per_s = spaced(index, 0.1, 0.7);
    Pattern::RandomWalk { speed_m_per_s, hold_min_s: 0.06, hold_max_s: 0.6 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_plan_has_its_size_and_holds_runs_out() {
        let plan = Plan::paper(50.0, 1).unwrap();
        assert_eq!(plan.samples(), 69_669);
        assert_eq!(plan.runs.len(), 96);
        for name in ["circle", "diagonal", "ramp", "random_walk"] {
            let of = |split| {
                let runs = plan.runs.iter().filter(move |run| run.split == split);
                runs.filter(|run| run.pattern.name() == name).map(|run| run.pattern.speed())
            };
            let (train, judge): (Vec<f64>, Vec<f64>) =
                (of(Split::Train).collect(), of(Split::Validation).collect());
            assert_eq!((train.len(), judge.len()), (20, 4), "{name}");
            assert!(judge.iter().all(|speed| !train.contains(speed)), "{name}: {judge:?}");
        }
        assert_eq!(Plan::paper(50.0, 1).unwrap(), plan);
        assert_eq!(Plan::paper(100.0, 1).unwrap().samples(), 139_338);
    }

    #[test]
    fn a_plan_survives_json_and_wrong_ones_are_refused() {
        let plan = Plan::paper(50.0, 7).unwrap();
        assert_eq!(Plan::from_json(&plan.to_json().unwrap()).unwrap(), plan);
        let with =
            |runs: &str| format!("{{\"name\":\"n\",\"rate_hz\":50,\"seed\":1,\"runs\":[{runs}]}}");
        let run = "{\"number\":1,\"pattern\":\"creep\",\"split\":\"train\",\"samples\":50}";
        assert!(Plan::from_json(&with(run)).is_ok());
        let said = |text: &str| Plan::from_json(text).unwrap_err().to_string();
        assert!(said(&with("")).contains("no run"));
        assert!(said(&with(&format!("{run},{run}"))).contains("number 1"));
        assert!(said(&with(&run.replace("creep", "creap"))).contains("choose one of circle"));
        assert!(said(&with(&run.replace("50", "5"))).contains("[10, 1000000]"));
        assert!(said(&with(run).replace("seed", "sead")).contains("sead"));
        assert!(said(&with(run).replace(":50,\"seed", ":5,\"seed")).contains("rate_hz is 5"));
    }

    #[test]
    fn every_nth_repeat_is_for_validation() {
        let patterns = [Pattern::ALL[0], Pattern::ALL[5]];
        let schedule = Schedule { repeat: 4, validation_every: Some(2), ..Schedule::default() };
        let plan = Plan::from_patterns(&patterns, &schedule).unwrap();
        let judges: Vec<u32> = plan
            .runs
            .iter()
            .filter(|run| run.split == Split::Validation)
            .map(|run| run.number)
            .collect();
        assert_eq!((plan.runs.len(), judges), (8, vec![3, 4, 7, 8]));
        assert!(Plan::from_patterns(&[], &schedule).is_err());
        let never = Schedule { validation_every: Some(0), ..schedule };
        assert!(Plan::from_patterns(&patterns, &never).is_err());
        assert_ne!(plan.seed_of(1), plan.seed_of(2));
    }
}
