//! Which commands a demo consists of.

use serde_json::{Value, json};
use std::path::PathBuf;

/// How much of everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// Some four minutes on two cores: to see that everything works and what comes of it.
    Quick,
    /// Twenty million transitions for each policy, matches long enough for narrow intervals.
    Full,
    /// Every command once, with results that mean nothing: for tests.
    Smallest,
}

/// One command, as it would be typed in the folder of the demo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Its name: that of its record, too.
    pub name: String,
    /// What is typed after `klasktron`.
    pub arguments: Vec<String>,
    /// What takes the place of `--overwrite` when it was interrupted before.
    pub resume: Option<&'static str>,
}

/// What the steps of a stage do.
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
    /// Its heading.
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

    /// What it is for, as a sentence.
    #[must_use]
    pub fn purpose(self) -> &'static str {
        match self {
            Self::Collect => {
                "Scripted motions on two days, and carriages at work beside a rolling ball."
            }
            Self::FitActuator => "A network learns what the carriage does with ten past commands.",
            Self::TuneFilter => {
                "The noise of the state estimate is fitted to the camera's detections."
            }
            Self::CloseGap => {
                "Where a plain simulation and the table disagree, what is missing gets a name and is added."
            }
            Self::Train => {
                "The same learner with the same settings, in four simulations that know more and more."
            }
            Self::Play => {
                "Each policy on the rig, as it is, against the same opponents, from both seats."
            }
            Self::Score => {
                "Contacts, goals and lengths of episodes, found in the recordings alone."
            }
        }
    }
}

/// Steps that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stage {
    /// What is done.
    pub chapter: Chapter,
    /// In this order.
    pub steps: Vec<Step>,
    /// Whether they may run at the same time; each then uses one core only.
    pub side_by_side: bool,
}

/// All of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// How much.
    pub size: Size,
    /// Files that are there before the first step: name and text.
    pub files: Vec<(PathBuf, String)>,
    /// The commands.
    pub stages: Vec<Stage>,
}

/// What distinguishes the policies that are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PolicyKind {
    /// Name in files and tables.
    pub name: &'static str,
    /// What its simulation knew.
    pub summary: &'static str,
    actuator: &'static str,
    randomized: bool,
}

/// The policies, in the order in which the paper's claim ranks them, worst first.
pub const POLICIES: [PolicyKind; 4] = [
    PolicyKind {
        name: "ideal",
        summary: "ideal actuators: the carriage does as it is told",
        actuator: "ideal",
        randomized: false,
    },
    PolicyKind {
        name: "randomized",
        summary: "ideal actuators, physics drawn anew for every episode",
        actuator: "ideal",
        randomized: true,
    },
    PolicyKind {
        name: "twin",
        summary: "the twin in which the gap was closed",
        actuator: "gap/twin.json",
        randomized: false,
    },
    PolicyKind {
        name: "learned",
        summary: "the network that was fitted to the recordings",
        actuator: "actuator/actuator.mcap",
        randomized: false,
    },
];

/// Scripted players that every policy meets.
pub const OPPONENTS: [&str; 2] = ["stationary", "chaser"];

/// Seats of the policy.
pub const SEATS: [&str; 2] = ["left", "right"];

/// Name of the match of a policy against an opponent.
#[must_use]
pub fn match_name(policy: &str, opponent: &str, seat: &str) -> String {
    format!("{policy}-{opponent}-{seat}")
}

/// Amounts that differ between sizes.
struct Amounts {
    run_seconds: u32,
    ball_seconds: u32,
    fit_seeds: u32,
    fit_epochs: u32,
    steps: &'static str,
    games: u32,
    match_seconds: u32,
}

impl Size {
    fn amounts(self) -> Amounts {
        match self {
            Self::Quick => Amounts {
                run_seconds: 6,
                ball_seconds: 30,
                fit_seeds: 2,
                fit_epochs: 100,
                steps: "4e6",
                games: 200,
                match_seconds: 300,
            },
            Self::Smallest => Amounts {
                run_seconds: 3,
                ball_seconds: 6,
                fit_seeds: 1,
                fit_epochs: 2,
                steps: "1",
                games: 2,
                match_seconds: 5,
            },
            Self::Full => Amounts {
                run_seconds: 10,
                ball_seconds: 60,
                fit_seeds: 8,
                fit_epochs: 1000,
                steps: "20e6",
                games: 1000,
                match_seconds: 1800,
            },
        }
    }

    /// How long it takes on two cores (min): the quick one measured, the full one by proportion.
    #[must_use]
    pub fn expected_minutes(self) -> f64 {
        match self {
            Self::Quick => 4.0,
            Self::Full => 25.0,
            Self::Smallest => 1.0,
        }
    }
}

/// Distance of a serve from the middle line (m), about a third of a half.
const SERVE_DISTANCE_M: f64 = 0.065;

/// Patterns of the recordings from which actuator and gap are learned.
const PATTERNS: [&str; 8] =
    ["circle", "x_line", "y_line", "ramp", "random_walk", "chirp", "step_ladder", "creep"];

/// What is hidden in the rig beyond its own imperfection, and in which words.
pub const HIDDEN: [(&str, &str); 3] = [
    ("drive.command_delay_s = 0.02", "commands take effect 20 ms late (8 ms on an unchanged rig)"),
    ("peg.*.friction_n = 0.6", "strikers rub on the board with 0.6 N (0.25 N on an unchanged rig)"),
    ("drive.slew_turns_per_s2 = 160", "the drives change speed by at most 6.4 m/s^2 (9.6 m/s^2)"),
];

/// The rig, with what is hidden in it.
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
    /// The demo of this size; everything random comes from `seed`.
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

    /// Writes a rig file and gives its name.
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
        let Amounts { fit_seeds, fit_epochs, .. } = amounts;
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
            step("gap", "gap monday.mcap tuesday.mcap --output gap --overwrite --json"),
        );
    }

    fn train(&mut self, amounts: &Amounts, seed: u64) {
        let Amounts { steps, games, .. } = amounts;
        let policy = |kind: &PolicyKind| {
            let randomize = if kind.randomized { "--randomize " } else { "" };
            let line = format!(
                "train --actuator {} {randomize}--steps {steps} --games {games} --seed {seed} --output {} \
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
                // Every policy meets the same table, with the ball served into its own half: a stationary
                // opponent never returns a ball from the other one. A ball at rest is served again, as in the
                // game of the training.
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
                }
            }
        }
        self.stages.push(Stage { chapter: Chapter::Play, steps, side_by_side: true });
        self.stage(
            Chapter::Score,
            vec![Step::new("eval", "eval matches --output eval --overwrite --json")],
        );
    }
}

impl Step {
    fn new(name: &str, line: &str) -> Self {
        Self { name: name.to_owned(), arguments: words(line), resume: None }
    }

    /// The command line.
    #[must_use]
    pub fn line(&self) -> String {
        format!("klasktron {}", self.arguments.join(" "))
    }

    /// What is typed to go on with it after an interruption.
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
