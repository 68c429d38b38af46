//! Commands of a demo.

use crate::train::{Preset, TrainSettings};
use serde_json::{Value, json};
use std::path::PathBuf;

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
    /// Steps in this order.
    pub steps: Vec<Step>,
    /// True if the steps may run in parallel; each then uses one core only.
    pub side_by_side: bool,
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
    actuator: &'static str,
    randomized: bool,
    /// Trained through the camera and the estimator of `tune-ekf`.
    sensors: bool,
}

/// The policies: those of the paper's claim, worst first, then those with sensors in training.
pub const POLICIES: [PolicyKind; 6] = [
    PolicyKind {
        name: "ideal",
        summary: "ideal actuators: the velocity equals the command",
        actuator: "ideal",
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "randomized",
        summary: "ideal actuators with domain randomization",
        actuator: "ideal",
        randomized: true,
        sensors: false,
    },
    PolicyKind {
        name: "twin",
        summary: "the twin with the effects that gap identified",
        actuator: "gap/twin.json",
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "learned",
        summary: "the actuator network fitted to the recordings",
        actuator: "actuator/actuator.mcap",
        randomized: false,
        sensors: false,
    },
    PolicyKind {
        name: "ideal-sensors",
        summary: "ideal actuators; camera and state estimator between game and policy",
        actuator: "ideal",
        randomized: false,
        sensors: true,
    },
    PolicyKind {
        name: "twin-sensors",
        summary: "the twin; camera and state estimator between game and policy",
        actuator: "gap/twin.json",
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
                games: 200,
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

    /// Expected time on two cores (min): the quick one measured, the full one extrapolated.
    #[must_use]
    pub fn expected_minutes(self) -> f64 {
        match self {
            Self::Quick => 5.0,
            Self::Full => 25.0,
            Self::Smallest => 1.0,
        }
    }
}

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

/// Configuration of the rig with the hidden changes.
fn rig(seed: u64) -> Value {
    let peg = json!({"friction_n": 0.6});
    json!({
        "seed": seed,
        "drive": {"command_delay_s": 0.02, "slew_turns_per_s2": 160.0},
        "peg": {"left": peg, "right": peg},
    })
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

    fn stage(&mut self, chapter: Chapter, steps: Vec<Step>) {
        self.stages.push(Stage { chapter, steps, side_by_side: false });
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
            let file = self.rig_file(name, &rig(seed + number));
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
        let step = |name, line: &str| vec![Step::new(name, line)];
        self.stage(Chapter::FitActuator, step(
                "fit-actuator",
                &format!(
                    "fit-actuator monday.mcap tuesday.mcap --seeds {fit_seeds} --epochs {fit_epochs} \
                     --output actuator --json"
                ),
            ),
        );
        self.stage(
            Chapter::TuneFilter,
            step("tune-ekf", "tune-ekf ball.mcap --output ekf --overwrite --json"),
        );
        self.stage(
            Chapter::CloseGap,
            step(
                "gap",
                &format!(
                    "gap monday.mcap tuesday.mcap {gap_options}--output gap --overwrite --json"
                ),
            ),
        );
    }

    fn train(&mut self, amounts: &Amounts, seed: u64) {
        let Amounts { transitions, games, .. } = *amounts;
        let mut settings = TrainSettings::preset(Preset::Tuned).for_steps(transitions);
        settings.reward.decay_transitions = SHAPING_DECAY;
        self.files.push((TRAINING.into(), settings.to_json()));
        let policy = |kind: &PolicyKind| {
            let randomize = if kind.randomized { "--randomize " } else { "" };
            let sensors = if kind.sensors { "--ekf ekf/ekf.json " } else { "--no-sensors " };
            let line = format!(
                "train --settings {TRAINING} --actuator {} {randomize}{sensors}--games {games} --seed {seed} --output {} \
                 --overwrite --json",
                kind.actuator, kind.name
            );
            Step { resume: Some("--resume"), ..Step::new(&format!("train-{}", kind.name), &line) }
        };
        self.stage(Chapter::Train, POLICIES.iter().map(policy).collect());
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
                    steps.push(Step::new(&format!("play-{name}"), &line));
                    // The same serves, in the policy's own simulation.
                    let line = format!(
                        "play --simulation {} --speed max --rig {file} --left {left} --right {right} \
                         --seconds {seconds} --seed {seed} --output simulated/{name}.mcap --overwrite --json",
                        kind.actuator
                    );
                    steps.push(Step::new(&format!("simulate-{name}"), &line));
                }
            }
        }
        self.stages.push(Stage { chapter: Chapter::Play, steps, side_by_side: true });
        self.stage(
            Chapter::Score,
            vec![
                Step::new("eval", "eval matches --output eval --overwrite --json"),
                Step::new(
                    "eval-simulated",
                    "eval simulated --output eval-simulated --overwrite --json",
                ),
            ],
        );
    }
}

impl Step {
    fn new(name: &str, line: &str) -> Self {
        Self { name: name.to_owned(), arguments: words(line), resume: None }
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
        let steps = plan.stages.iter().flat_map(|stage| &stage.steps);
        let trained = steps.filter(|step| step.name.starts_with("train-"));
        let settings_of = |step: &Step| {
            let place = step.arguments.iter().position(|word| word == "--settings").unwrap();
            step.arguments[place + 1].clone()
        };
        assert_eq!(trained.map(settings_of).collect::<Vec<_>>(), [TRAINING; POLICIES.len()]);
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
