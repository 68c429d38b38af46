//! Commands of a demo.

use crate::train::{Preset, TrainSettings};
use serde_json::{Value, json};
use std::{cmp::Reverse, collections::BTreeMap, path::PathBuf};

/// Size of a demo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// About five minutes on two cores: a check of all commands with rough results.
    Quick,
    /// Twenty million transitions per policy, and matches long enough for narrow intervals.
    Full,
    /// Every command once, with meaningless results: for tests.
    Smallest,
}

/// One command, as typed in the folder of the demo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Name of the step and of its record.
    pub name: String,
    /// Words typed after `klasktron`.
    pub arguments: Vec<String>,
    /// Names of the steps whose results it reads.
    pub needs: Vec<String>,
    /// Replacement of `--overwrite` after an interruption.
    pub resume: Option<&'static str>,
}

/// Purpose of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chapter {
    /// Recordings.
    Collect,
    /// The actuator network.
    FitActuator,
    /// The state estimate.
    TuneFilter,
    /// The twin.
    CloseGap,
    /// The policies.
    Train,
    /// The matches.
    Play,
    /// Their score.
    Score,
}

impl Chapter {
    /// Heading.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Collect => "Collect",
            Self::FitActuator => "Fit the actuator",
            Self::TuneFilter => "Tune the filter",
            Self::CloseGap => "Close the gap",
            Self::Train => "Train",
            Self::Play => "Play",
            Self::Score => "Score",
        }
    }

    /// Purpose as a sentence.
    #[must_use]
    pub fn purpose(self) -> &'static str {
        match self {
            Self::Collect => {
                "Scripted motions on two days, and carriage motion with a rolling ball."
            }
            Self::FitActuator => {
                "A network predicts the carriage's velocity from the last ten commands."
            }
            Self::TuneFilter => {
                "The noise parameters of the Kalman filter are fitted to the camera's detections."
            }
            Self::CloseGap => {
                "Effects missing from the plain simulation are identified and added to the twin."
            }
            Self::Train => "The same learner with the same settings, in six simulations.",
            Self::Play => {
                "Each policy plays on the rig and in its own simulation, unchanged, against the same opponents, \
                 from both seats, with the same serves."
            }
            Self::Score => {
                "Contacts, goals and episode lengths of rig and simulation, computed by one referee from \
                 the recordings alone."
            }
        }
    }
}

/// Steps that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stage {
    /// Chapter of the stage.
    pub chapter: Chapter,
    /// Steps; those that are ready start in this order.
    pub steps: Vec<Step>,
}

/// Plan of a demo.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Size of the demo.
    pub size: Size,
    /// Files written before the first step: name and text.
    pub files: Vec<(PathBuf, String)>,
    /// Stages with their commands.
    pub stages: Vec<Stage>,
}

/// A policy of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PolicyKind {
    /// Name in files and tables.
    pub name: &'static str,
    /// Actuator model and physics of its simulation.
    pub summary: &'static str,
    actuator: ActuatorKind,
    randomized: bool,
    /// Trained through the camera and the estimator of `tune-ekf`.
    sensors: bool,
}

/// Actuator model in a simulation, in the order of its computing time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ActuatorKind {
    /// The velocity equals the command.
    Ideal,
    /// The network of `fit-actuator`.
    Learned,
    /// The twin of `gap`.
    Twin,
}

impl ActuatorKind {
    /// Value of `--actuator` and `--simulation`.
    fn argument(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Learned => "actuator/actuator.mcap",
            Self::Twin => "gap/twin.json",
        }
    }

    /// Name of the step that identifies it.
    fn step(self) -> Option<&'static str> {
        match self {
            Self::Ideal => None,
            Self::Learned => Some("fit-actuator"),
            Self::Twin => Some("gap"),
        }
    }
}

/// The policies: those of the paper's claim, worst first, then those with sensors in training.
pub const POLICIES: [PolicyKind; 6] = [
    PolicyKind {
        name: "ideal",
        summary: "ideal actuators: the velocity equals the command",
        actuator: ActuatorKind::Ideal,
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "randomized",
        summary: "ideal actuators with domain randomization",
        actuator: ActuatorKind::Ideal,
        randomized: true,
        sensors: false,
    },
    PolicyKind {
        name: "twin",
        summary: "the twin with the effects that gap identified",
        actuator: ActuatorKind::Twin,
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "learned",
        summary: "the actuator network fitted to the recordings",
        actuator: ActuatorKind::Learned,
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "ideal-sensors",
        summary: "ideal actuators; camera and state estimator between game and policy",
        actuator: ActuatorKind::Ideal,
        randomized: false,
        sensors: true,
    },
    PolicyKind {
        name: "twin-sensors",
        summary: "the twin; camera and state estimator between game and policy",
        actuator: ActuatorKind::Twin,
        randomized: false,
        sensors: true,
    },
];

/// Scripted opponents of every policy.
pub const OPPONENTS: [&str; 2] = ["stationary", "chaser"];

/// Seats of the policy.
pub const SEATS: [&str; 2] = ["left", "right"];

/// Name of the match of a policy against an opponent.
#[must_use]
pub fn match_name(policy: &str, opponent: &str, seat: &str) -> String {
    format!("{policy}-{opponent}-{seat}")
}

/// Name of the step that trains a policy.
fn train_name(policy: &PolicyKind) -> String {
    format!("train-{}", policy.name)
}

/// Parameters that depend on the size.
struct Amounts {
    run_seconds: u32,
    ball_seconds: u32,
    fit_seeds: u32,
    fit_epochs: u32,
    /// Transitions of each training.
    transitions: u64,
    games: u32,
    match_seconds: u32,
    /// Options of `gap` that restrict its search.
    gap_options: &'static str,
}

impl Size {
    fn amounts(self) -> Amounts {
        match self {
            Self::Quick => Amounts {
                run_seconds: 6,
                ball_seconds: 30,
                fit_seeds: 2,
                fit_epochs: 100,
                transitions: 8_000_000,
                games: 100,
                match_seconds: 600,
                gap_options: "",
            },
            Self::Smallest => Amounts {
                run_seconds: 3,
                ball_seconds: 6,
                fit_seeds: 1,
                fit_epochs: 2,
                transitions: 1,
                games: 2,
                match_seconds: 5,
                gap_options: "--only drive.delay --only drive.saturation ",
            },
            Self::Full => Amounts {
                run_seconds: 10,
                ball_seconds: 60,
                fit_seeds: 8,
                fit_epochs: 1000,
                transitions: 20_000_000,
                games: 1000,
                match_seconds: 1800,
                gap_options: "",
            },
        }
    }

    /// Expected time on two cores (min): the quick one measured, the full one from its processor time of 1603 s.
    #[must_use]
    pub fn expected_minutes(self) -> f64 {
        match self {
            Self::Quick => 5.0,
            Self::Full => 14.0,
            Self::Smallest => 1.0,
        }
    }
}

/// Commands with the option `--threads`.
const THREADED: [&str; 4] = ["fit-actuator", "gap", "train", "eval"];

/// Distance of a serve from the middle line (m), about a third of a half.
const SERVE_DISTANCE_M: f64 = 0.065;

/// Settings of all trainings.
const TRAINING: &str = "training.json";

/// Decay constant of the reward shaping (transitions). In the twin, policies learn more slowly than with ideal
/// actuators: with the default of the recipe they hardly scored after 8 million transitions
/// (`reports/2026-11-26-demo`).
const SHAPING_DECAY: f64 = 24e6;

/// Patterns of the recordings for actuator and gap.
const PATTERNS: [&str; 8] =
    ["circle", "x_line", "y_line", "ramp", "random_walk", "chirp", "step_ladder", "creep"];

/// Hidden changes of the rig, with their descriptions.
pub const HIDDEN: [(&str, &str); 3] = [
    ("drive.command_delay_s = 0.02", "command delay of 20 ms (8 ms on an unchanged rig)"),
    ("peg.*.friction_n = 0.6", "striker friction of 0.6 N (0.25 N on an unchanged rig)"),
    (
        "drive.slew_turns_per_s2 = 160",
        "slew limit of the drives of 6.4 m/s^2 (9.6 m/s^2 on an unchanged rig)",
    ),
];

/// Period of the torques that the drives report in the recordings for actuator and gap (ms).
const TORQUE_PERIOD_MS: u32 = 10;

/// Configuration of the rig with the hidden changes.
fn rig(seed: u64) -> Value {
    let peg = json!({"friction_n": 0.6});
    json!({
        "seed": seed,
        "drive": {"command_delay_s": 0.02, "slew_turns_per_s2": 160.0},
        "peg": {"left": peg, "right": peg},
    })
}

/// The same whose drives report their torques, from which the search determines masses and forces.
fn rig_with_torques(seed: u64) -> Value {
    let mut rig = rig(seed);
    rig["drive"]["cyclic_ms"] = json!({"torques": TORQUE_PERIOD_MS});
    rig
}

fn rig_with_ball(seed: u64, ball: Value) -> Value {
    let mut rig = rig(seed);
    rig["ball"] = ball;
    rig
}

fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(ToOwned::to_owned).collect()
}

impl Plan {
    /// Demo of this size; `seed` is the seed of all random streams.
    #[must_use]
    pub fn new(size: Size, seed: u64) -> Self {
        let amounts = size.amounts();
        let mut plan = Self { size, files: Vec::new(), stages: Vec::new() };
        plan.collect(&amounts, seed);
        plan.identify(&amounts);
        plan.train(&amounts, seed);
        plan.play(&amounts, seed);
        plan
    }

    /// All steps, in the order of the stages.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.stages.iter().flat_map(|stage| &stage.steps)
    }

    /// Of each step, the numbers of the steps whose results it reads.
    #[must_use]
    pub fn needs(&self) -> Vec<Vec<usize>> {
        let numbers: BTreeMap<&str, usize> =
            self.steps().map(|step| &*step.name).zip(0..).collect();
        self.steps().map(|step| step.needs.iter().map(|name| numbers[&**name]).collect()).collect()
    }

    fn stage(&mut self, chapter: Chapter, steps: Vec<Step>) {
        self.stages.push(Stage { chapter, steps });
    }

    /// Write a rig file; returns its name.
    fn rig_file(&mut self, name: &str, rig: &Value) -> String {
        let path = format!("rigs/{name}.json");
        self.files.push((path.clone().into(), format!("{rig:#}\n")));
        path
    }

    fn collect(&mut self, amounts: &Amounts, seed: u64) {
        let Amounts { run_seconds, ball_seconds, .. } = amounts;
        let patterns: Vec<String> =
            PATTERNS.iter().map(|name| format!("--pattern {name}")).collect();
        let patterns = patterns.join(" ");
        let mut steps = Vec::new();
        for (number, name) in (1..).zip(["monday", "tuesday"]) {
            let file = self.rig_file(name, &rig_with_torques(seed + number));
            steps.push(Step::new(
                &format!("collect-{name}"),
                &format!(
                    "collect --speed max --rig {file} {patterns} --seconds {run_seconds} \
                     --validation-every 0 --seed {number} --output {name}.mcap --overwrite --json"
                ),
            ));
        }
        let launched = json!({"launch_every_s": 3.0});
        let file = self.rig_file("ball", &rig_with_ball(seed + 3, launched));
        steps.push(Step::new(
            "collect-ball",
            &format!(
                "collect --speed max --rig {file} --pattern circle --seconds {ball_seconds} \
                 --repeat 3 --validation-every 3 --seed 3 --output ball.mcap --overwrite --json"
            ),
        ));
        self.stage(Chapter::Collect, steps);
    }

    fn identify(&mut self, amounts: &Amounts) {
        let Amounts { fit_seeds, fit_epochs, gap_options, .. } = amounts;
        let sessions = ["collect-monday", "collect-tuesday"];
        let fit = format!(
            "fit-actuator monday.mcap tuesday.mcap --seeds {fit_seeds} --epochs {fit_epochs} --output actuator --json"
        );
        self.stage(Chapter::FitActuator, vec![Step::new("fit-actuator", &fit).after(sessions)]);
        let tune = "tune-ekf ball.mcap --output ekf --overwrite --json";
        self.stage(Chapter::TuneFilter, vec![Step::new("tune-ekf", tune).after(["collect-ball"])]);
        let gap =
            format!("gap monday.mcap tuesday.mcap {gap_options}--output gap --overwrite --json");
        self.stage(Chapter::CloseGap, vec![Step::new("gap", &gap).after(sessions)]);
    }

    fn train(&mut self, amounts: &Amounts, seed: u64) {
        let Amounts { transitions, games, .. } = *amounts;
        let mut settings = TrainSettings::preset(Preset::Tuned).for_steps(transitions);
        settings.reward.decay_transitions = SHAPING_DECAY;
        self.files.push((TRAINING.into(), settings.to_json()));
        // The longest first, so that no core waits at the end.
        let mut kinds = POLICIES;
        kinds.sort_by_key(|kind| Reverse((kind.actuator, kind.sensors)));
        let policy = |kind: &PolicyKind| {
            let randomize = if kind.randomized { "--randomize " } else { "" };
            let sensors = if kind.sensors { "--ekf ekf/ekf.json " } else { "--no-sensors " };
            let line = format!(
                "train --settings {TRAINING} --actuator {} {randomize}{sensors}--games {games} --seed {seed} --output {} \
                 --overwrite --json",
                kind.actuator.argument(),
                kind.name
            );
            let step = Step::new(&train_name(kind), &line)
                .after(kind.actuator.step())
                .after(kind.sensors.then_some("tune-ekf"));
            Step { resume: Some("--resume"), ..step }
        };
        self.stage(Chapter::Train, kinds.iter().map(policy).collect());
    }

    fn play(&mut self, amounts: &Amounts, seed: u64) {
        let seconds = amounts.match_seconds;
        let mut steps = Vec::new();
        for (pair, opponent) in (0..).zip(OPPONENTS) {
            for (number, seat) in (0..).zip(SEATS) {
                // Every policy plays on the same table, with the ball served into its own half: a
                // stationary opponent never returns a ball from the other one. A resting ball is served
                // again, as in the game of the training.
                let y_m = if seat == "left" { -SERVE_DISTANCE_M } else { SERVE_DISTANCE_M };
                let ball = json!({
                    "start": {"y_m": y_m},
                    "serve_spread_m": 0.035,
                    "put_back_after_s": 1.0,
                    "put_back_still_after_s": 2.0,
                });
                let number = seed + 10 + 2 * pair + number;
                let file = self
                    .rig_file(&format!("match-{opponent}-{seat}"), &rig_with_ball(number, ball));
                for kind in &POLICIES {
                    let name = match_name(kind.name, opponent, seat);
                    let policy = format!("{}/policy.mcap", kind.name);
                    let (left, right) =
                        if seat == "left" { (&*policy, opponent) } else { (opponent, &*policy) };
                    let line = format!(
                        "play --speed max --rig {file} --ekf ekf/ekf.json --left {left} --right {right} \
                         --seconds {seconds} --seed {seed} --output matches/{name}.mcap --overwrite --json"
                    );
                    let trained = train_name(kind);
                    let step = Step::new(&format!("play-{name}"), &line);
                    steps.push(step.after(["tune-ekf", &trained]));
                    // The same serves, in the policy's own simulation.
                    let line = format!(
                        "play --simulation {} --speed max --rig {file} --left {left} --right {right} \
                         --seconds {seconds} --seed {seed} --output simulated/{name}.mcap --overwrite --json",
                        kind.actuator.argument()
                    );
                    let step = Step::new(&format!("simulate-{name}"), &line);
                    steps.push(step.after([&*trained]).after(kind.actuator.step()));
                }
            }
        }
        let score = |name: &str, folder: &str, played: &str| {
            let matches = steps.iter().map(|step| &*step.name);
            Step::new(name, &format!("eval {folder} --output {name} --overwrite --json"))
                .after(matches.filter(|name| name.starts_with(played)))
        };
        let scores = vec![
            score("eval", "matches", "play-"),
            score("eval-simulated", "simulated", "simulate-"),
        ];
        self.stage(Chapter::Play, steps);
        self.stage(Chapter::Score, scores);
    }
}

impl Step {
    fn new(name: &str, line: &str) -> Self {
        Self { name: name.to_owned(), arguments: words(line), needs: Vec::new(), resume: None }
    }

    /// Return whether the command has the option `--threads`; its results do not depend on it.
    #[must_use]
    pub fn is_threaded(&self) -> bool {
        self.arguments.first().is_some_and(|command| THREADED.contains(&&**command))
    }

    /// This step, after those called `names`.
    fn after<'a>(mut self, names: impl IntoIterator<Item = &'a str>) -> Self {
        self.needs.extend(names.into_iter().map(ToOwned::to_owned));
        self
    }

    /// File or folder that the step writes.
    #[must_use]
    pub fn output(&self) -> Option<&str> {
        let mut words = self.arguments.iter();
        words.find(|word| *word == "-o" || *word == "--output")?;
        words.next().map(String::as_str)
    }

    /// Command line of the step.
    #[must_use]
    pub fn line(&self) -> String {
        format!("klasktron {}", self.arguments.join(" "))
    }

    /// Words for resuming after an interruption.
    #[must_use]
    pub fn resumed(&self) -> Vec<String> {
        let Some(resume) = self.resume else { return self.arguments.clone() };
        let anew =
            |word: &String| if word == "--overwrite" { resume.to_owned() } else { word.clone() };
        self.arguments.iter().map(anew).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_policy_is_trained_with_the_same_settings() {
        let plan = Plan::new(Size::Quick, 0);
        let (_, text) = plan.files.iter().find(|(path, _)| path.as_os_str() == TRAINING).unwrap();
        let settings: TrainSettings = serde_json::from_str(text).unwrap();
        settings.check().unwrap();
        assert_eq!((settings.steps, settings.anneal_transitions), (8_000_000, Some(8_000_000)));
        let trained = plan.steps().filter(|step| step.name.starts_with("train-"));
        let settings_of = |step: &Step| {
            let place = step.arguments.iter().position(|word| word == "--settings").unwrap();
            step.arguments[place + 1].clone()
        };
        assert_eq!(trained.map(settings_of).collect::<Vec<_>>(), [TRAINING; POLICIES.len()]);
    }

    #[test]
    fn a_step_needs_those_whose_results_it_reads() {
        let plan = Plan::new(Size::Quick, 0);
        let step = |name: &str| plan.steps().find(|step| step.name == name).unwrap();
        let of = |name: &str| &*step(name).needs;
        let files = |words: &[String]| -> Vec<PathBuf> {
            words.iter().filter(|word| word.contains(['/', '.'])).map(PathBuf::from).collect()
        };
        for step in plan.steps() {
            for file in files(&step.arguments) {
                let writes =
                    |other: &&Step| other.output().is_some_and(|out| file.starts_with(out));
                let writer = plan.steps().find(writes).filter(|writer| *writer != step);
                assert!(
                    writer.is_none_or(|writer| step.needs.contains(&writer.name)),
                    "{} reads {}",
                    step.name,
                    file.display()
                );
            }
        }
        assert_eq!(of("collect-tuesday"), [""; 0]);
        assert_eq!(of("gap"), ["collect-monday", "collect-tuesday"]);
        assert_eq!(of("train-ideal"), [""; 0]);
        assert_eq!(of("train-learned"), ["fit-actuator"]);
        assert_eq!(of("train-twin-sensors"), ["gap", "tune-ekf"]);
        assert_eq!(of("play-ideal-chaser-left"), ["tune-ekf", "train-ideal"]);
        assert_eq!(of("simulate-twin-chaser-left"), ["train-twin", "gap"]);
        let matches = POLICIES.len() * OPPONENTS.len() * SEATS.len();
        assert_eq!(of("eval").len(), matches);
        assert!(of("eval-simulated").iter().all(|name| name.starts_with("simulate-")));
    }

    #[test]
    fn the_key_of_a_step_depends_on_what_it_reads() {
        let plan = Plan::new(Size::Quick, 0);
        let mut changed = plan.clone();
        let gap = changed.stages.iter_mut().flat_map(|stage| &mut stage.steps);
        gap.filter(|step| step.name == "gap").for_each(|gap| gap.arguments.push("-v".to_owned()));
        let names = plan.steps().map(|step| &*step.name);
        let keys = plan.keys().into_iter().zip(changed.keys());
        let other: Vec<&str> =
            names.zip(keys).filter(|(_, (a, b))| a != b).map(|(name, _)| name).collect();
        assert!(
            other
                .iter()
                .all(|name| name.contains("twin") || name.contains("gap") || name.contains("eval"))
        );
        assert_eq!(other.len(), 1 + 2 + 4 * OPPONENTS.len() * SEATS.len() + 2, "{other:?}");
    }

    #[test]
    fn every_match_serves_into_the_half_of_the_policy() {
        let plan = Plan::new(Size::Quick, 0);
        let serve = |seat: &str, file: &str| {
            let rig: Value = serde_json::from_str(file).unwrap();
            let y_m = rig["ball"]["start"]["y_m"].as_f64().unwrap();
            assert_eq!(y_m < 0.0, seat == "left", "{seat}");
            assert!((y_m.abs() - SERVE_DISTANCE_M).abs() < 1e-12);
        };
        let mut rigs = 0;
        for (path, text) in &plan.files {
            let name = path.file_stem().unwrap().to_str().unwrap();
            if let Some((_, seat)) = name.strip_prefix("match-").and_then(|it| it.rsplit_once('-'))
            {
                serve(seat, text);
                rigs += 1;
            }
        }
        assert_eq!(rigs, OPPONENTS.len() * SEATS.len());
    }
}
