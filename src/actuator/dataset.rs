//! Runs of several recordings, split into training and held-out data.

use super::{
    ActuatorError,
    coverage::Coverage,
    layout::AXES,
    run::{self, ResampleConfig, Run, Target},
};
use crate::recording::{Recording, Split, topic::Player};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// One input file, as identified in results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InputFile {
    /// Name without folder.
    pub name: String,
    /// SHA-256 in hexadecimal.
    pub sha256: String,
    /// Metadata `session` of the file.
    pub session: Option<String>,
}

/// Warning from reading the inputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DataWarning {
    /// A file is damaged; its readable part was used.
    Damaged {
        /// The file.
        file: String,
        /// Description of the lost part.
        loss: String,
    },
    /// The same recording was given twice. It was skipped, because a model fitted to data cannot be
    /// validated on the same data.
    GivenTwice {
        /// The file that was skipped.
        file: String,
        /// The file with the same bytes.
        same_as: String,
    },
    /// No run is marked for validation; some were held out.
    HeldOutByRule {
        /// Number of runs held out.
        runs: usize,
        /// Number of runs in total.
        of: usize,
    },
    /// Runs shorter than one window were skipped.
    ShortRuns {
        /// Number of runs skipped.
        runs: usize,
    },
}

impl std::fmt::Display for DataWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Damaged { file, loss } => {
                write!(f, "{file}: {loss}; the readable part was used")
            }
            Self::GivenTwice { file, same_as } => {
                write!(f, "{file} has the same bytes as {same_as} and was skipped")
            }
            Self::HeldOutByRule { runs, of } => write!(
                f,
                "no run is marked split=validation: every fifth run of each pattern is held out \
                 ({runs} of {of})"
            ),
            Self::ShortRuns { runs } => {
                write!(f, "{runs} pieces of runs are shorter than one window and were skipped")
            }
        }
    }
}

/// Resampled runs, split by run or by session, never inside a run.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// Training runs.
    pub train: Vec<Run>,
    /// Held-out runs.
    pub held_out: Vec<Run>,
    /// Settings of the resampling.
    pub config: ResampleConfig,
    /// Player whose gantry is modelled.
    pub player: Player,
    /// Metadata `robot` of the recordings.
    pub robot: String,
    /// Input files.
    pub inputs: Vec<InputFile>,
    /// Warnings from reading the inputs.
    pub warnings: Vec<DataWarning>,
}

impl Dataset {
    /// Return the sampling interval (s).
    #[must_use]
    pub fn dt(&self) -> f64 {
        1.0 / self.config.rate_hz
    }

    /// Return the training runs.
    #[must_use]
    pub fn train(&self) -> Vec<&Run> {
        self.train.iter().collect()
    }

    /// Return the held-out runs.
    #[must_use]
    pub fn held_out(&self) -> Vec<&Run> {
        self.held_out.iter().collect()
    }

    /// Return whether any input file is damaged.
    #[must_use]
    pub fn is_damaged(&self) -> bool {
        self.warnings.iter().any(|warning| matches!(warning, DataWarning::Damaged { .. }))
    }

    /// Return the coverage of the training runs.
    #[must_use]
    pub fn coverage(&self) -> Coverage {
        Coverage::of(&self.train())
    }
}

/// Selection of the gantry in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlayerChoice {
    /// The gantry that has commands and motion; the left one when both have.
    Only,
    /// The gantry of this player.
    Given(Player),
}

/// Metadata keys that must agree between recordings of one robot.
const ROBOT_KEYS: [&str; 2] = ["robot", "belt_metres_per_turn"];

/// Read `paths` and split their runs. Runs shorter than `needed` samples are skipped.
///
/// # Errors
/// When a file cannot be used, files are of different robots, or no run is left to fit or to
/// evaluate.
pub fn load(
    paths: &[PathBuf],
    choice: PlayerChoice,
    config: ResampleConfig,
    needed: usize,
) -> Result<Dataset, ActuatorError> {
    let mut dataset = Dataset {
        train: Vec::new(),
        held_out: Vec::new(),
        config,
        player: Player::Left,
        robot: String::new(),
        inputs: Vec::new(),
        warnings: Vec::new(),
    };
    let mut robots: Vec<(PathBuf, [String; 2])> = Vec::new();
    let mut speeds = Vec::new();
    let mut runs = Vec::new();
    for (file, path) in paths.iter().enumerate() {
        let recording = Recording::open(path)?;
        if let Some(first) = dataset.inputs.iter().find(|i| i.sha256 == recording.sha256) {
            let (file, same_as) = (file_name(path), first.name.clone());
            dataset.warnings.push(DataWarning::GivenTwice { file, same_as });
            continue;
        }
        check_robot(&mut robots, &recording)?;
        let player = player_of(&recording, choice, config.target);
        if file == 0 {
            dataset.player = player;
            dataset.robot = recording.info("robot").unwrap_or("unknown").to_owned();
        }
        if !recording.loss.is_none() {
            let (file, loss) = (file_name(path), recording.loss.to_string());
            dataset.warnings.push(DataWarning::Damaged { file, loss });
        }
        dataset.inputs.push(InputFile {
            name: file_name(path),
            sha256: recording.sha256.clone(),
            session: recording.info("session").map(str::to_owned),
        });
        let warnings = &mut dataset.warnings;
        let resampled = run::resample(&recording, file, player, config)?;
        let kept = long_enough(resampled, &recording, (needed, config.rate_hz), warnings)?;
        speeds.extend(speed_over_command(&kept).map(|speed| (path.clone(), speed)));
        runs.extend(kept);
    }
    check_speeds(&speeds)?;
    divide(&mut dataset, runs)?;
    Ok(dataset)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn player_of(recording: &Recording, choice: PlayerChoice, target: Target) -> Player {
    match choice {
        PlayerChoice::Given(player) => player,
        PlayerChoice::Only => {
            run::players_of(recording, target).first().copied().unwrap_or(Player::Left)
        }
    }
}

fn check_robot(
    robots: &mut Vec<(PathBuf, [String; 2])>,
    recording: &Recording,
) -> Result<(), ActuatorError> {
    let values = ROBOT_KEYS.map(|key| recording.info(key).unwrap_or("unknown").to_owned());
    if let Some((first_path, first)) = robots.first() {
        for (index, key) in ROBOT_KEYS.into_iter().enumerate() {
            let unknown = [&first[index], &values[index]].iter().any(|value| *value == "unknown");
            if first[index] != values[index] && !unknown {
                return Err(ActuatorError::MixedRobots {
                    key,
                    first_path: first_path.clone(),
                    first: first[index].clone(),
                    second_path: recording.path.clone(),
                    second: values[index].clone(),
                });
            }
        }
    }
    robots.push((recording.path.clone(), values));
    Ok(())
}

/// Largest allowed ratio between recordings of their steady velocity over command. A doubled scale
/// gives 2; friction and load change a velocity loop's gain by a few percent.
const LARGEST_SPEED_RATIO: f64 = 1.5;

/// Constant samples after which a command counts as steady (0.16 s at 50 Hz).
const STEADY_SAMPLES: usize = 8;
/// Changes below this fraction of the largest command do not count.
const STEADY_FRACTION: f64 = 0.01;
/// Least number of steady samples for a comparison.
const FEWEST_STEADY: usize = 20;

/// Return the steady velocity over command; `None` when no command is held long enough.
fn speed_over_command(runs: &[Run]) -> Option<f64> {
    let largest = runs
        .iter()
        .flat_map(|run| &run.commands)
        .flatten()
        .fold(0.0, |most: f64, u| most.max(u.abs()));
    let (mut products, mut squares, mut count) = (0.0, 0.0, 0);
    for run in runs {
        for end in STEADY_SAMPLES..=run.len() {
            let held = &run.commands[end - STEADY_SAMPLES..end];
            for axis in 0..AXES {
                let u = held[0][axis];
                let steady =
                    held.iter().all(|pair| (pair[axis] - u).abs() < STEADY_FRACTION * largest);
                if steady && STEADY_FRACTION * largest < u.abs() {
                    products += run.velocities[end - 1][axis] * u;
                    squares += u * u;
                    count += 1;
                }
            }
        }
    }
    (FEWEST_STEADY <= count).then(|| products / squares)
}

fn check_speeds(speeds: &[(PathBuf, f64)]) -> Result<(), ActuatorError> {
    let by_speed = |a: &&(PathBuf, f64), b: &&(PathBuf, f64)| a.1.total_cmp(&b.1);
    let (slowest, fastest) = (speeds.iter().min_by(by_speed), speeds.iter().max_by(by_speed));
    match (slowest, fastest) {
        (Some((first_path, first)), Some((second_path, second)))
            if LARGEST_SPEED_RATIO * first < *second =>
        {
            Err(ActuatorError::MixedSpeeds {
                first_path: first_path.clone(),
                first: *first,
                second_path: second_path.clone(),
                second: *second,
            })
        }
        _ => Ok(()),
    }
}

fn long_enough(
    runs: Vec<Run>,
    recording: &Recording,
    (needed, rate_hz): (usize, f64),
    warnings: &mut Vec<DataWarning>,
) -> Result<Vec<Run>, ActuatorError> {
    let count = runs.len();
    let longest = runs.iter().map(Run::len).max().unwrap_or(0);
    let kept: Vec<Run> = runs.into_iter().filter(|run| needed <= run.len()).collect();
    if kept.is_empty() {
        let path = recording.path.clone();
        return Err(ActuatorError::TooShort { path, runs: count, longest, needed, rate_hz });
    }
    if kept.len() < count {
        warnings.push(DataWarning::ShortRuns { runs: count - kept.len() });
    }
    Ok(kept)
}

/// Number of runs of each pattern that are fitted for each one held out.
const TRAIN_PER_HELD_OUT: usize = 4;

fn divide(dataset: &mut Dataset, runs: Vec<Run>) -> Result<(), ActuatorError> {
    let count = runs.len();
    let (held_out, train): (Vec<Run>, Vec<Run>) =
        runs.into_iter().partition(|run| run.split == Some(Split::Validation));
    if train.is_empty() {
        return Err(ActuatorError::NothingToTrain { runs: count });
    }
    (dataset.train, dataset.held_out) = (train, held_out);
    if dataset.held_out.is_empty() {
        hold_out_by_rule(dataset)?;
    }
    Ok(())
}

/// Hold out every fifth run of each pattern, and at least one. Pieces of one run stay together.
fn hold_out_by_rule(dataset: &mut Dataset) -> Result<(), ActuatorError> {
    let key = |run: &Run| (run.pattern.clone(), run.file, run.number);
    let mut groups: Vec<_> = dataset.train.iter().map(key).collect();
    groups.sort();
    groups.dedup();
    if groups.len() < 2 {
        return Err(ActuatorError::OneRun);
    }
    let every = TRAIN_PER_HELD_OUT + 1;
    let chosen: Vec<_> = if groups.len() < every {
        groups[groups.len() - 1..].to_vec()
    } else {
        groups.iter().skip(every / 2).step_by(every).cloned().collect()
    };
    let runs = std::mem::take(&mut dataset.train);
    (dataset.held_out, dataset.train) =
        runs.into_iter().partition(|run| chosen.contains(&key(run)));
    let (runs, of) = (chosen.len(), groups.len());
    dataset.warnings.push(DataWarning::HeldOutByRule { runs, of });
    Ok(())
}
