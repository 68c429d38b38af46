//! `klasktron play`: let two players play a match on a table and record it for `eval`.

use super::{
    Outcome, note, print,
    results::refuse_existing_file,
    session::{self, Motion, SessionArgs},
    table::{TableArgs, TableFiles, parse_within},
    tell,
};
use anyhow::bail;
use klasktron::{
    collect::{FreeStretch, SessionReport, Work, run_session},
    ekf::read_settings,
    link::BusSpec,
    play::{
        HOLD_GAIN_PER_S, Match, MatchFormat, MatchScore, Seat, SimulatedGoals, SimulatedMatch, Who,
        label,
    },
    rig::{RigConfig, Truth, config::BallConfig},
    train::{ActuatorSource, TrainSettings, game_with_actuator},
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `klasktron play`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron play --speed max --left goalkeeper --right chaser --seconds 60 -o match.mcap
  klasktron play --bus socketcan:can0 --camera udp:0.0.0.0:9870 --ekf ekf/ekf.json \\
      --left none --right policy/policy.mcap -o against-me.mcap
  klasktron eval match.mcap -o eval")]
pub(crate) struct Args {
    /// Player at y < 0: stationary, random, goalkeeper, chaser, shooter, none, or a policy.mcap
    #[arg(long, value_name = "WHO")]
    left: Who,
    /// Player at y > 0, with the same choice
    #[arg(long, value_name = "WHO")]
    right: Who,
    /// Duration of the match (s)
    #[arg(long, default_value = "120", value_parser = parse_seconds)]
    seconds: f64,
    /// Points that win a game; the match ends when it is won, at the latest after --seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=99), conflicts_with = "simulation")]
    points: Option<u32>,
    /// Largest number of games, odd; the match is won with more than half of them
    #[arg(long, value_name = "N", default_value = "1", requires = "points", value_parser = parse_games)]
    best_of: u32,
    /// Settings of the Kalman filter from `klasktron tune-ekf` [default: untuned]
    #[arg(long, value_name = "FILE")]
    ekf: Option<PathBuf>,
    /// Play in this simulation, not on a table: ideal, a twin.json or an actuator.mcap. Serves and
    /// waiting times are those of --rig
    #[arg(long, value_name = "ideal|FILE", conflicts_with = "ekf")]
    simulation: Option<PathBuf>,
    /// Seed of the random player, and of the virtual rig without --rig
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Recording to write
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "match.mcap")]
    output: PathBuf,
    #[command(flatten)]
    table: TableArgs,
    #[command(flatten)]
    session: SessionArgs,
}

/// Result document: the document of the session, with the match.
#[derive(Serialize)]
struct MatchReport<'a> {
    #[serde(flatten)]
    session: &'a SessionReport,
    left: String,
    right: String,
    /// Score by the referee, as it saw the match.
    score: MatchScore,
    /// True goals of the virtual rig by the scorer; absent on a real table.
    #[serde(skip_serializing_if = "Option::is_none")]
    truth_goals: Option<Goals>,
}

/// Result document of a simulated match.
#[derive(Serialize)]
struct SimulatedReport {
    left: String,
    right: String,
    actuator: ActuatorSource,
    seconds: f64,
    truth_goals: SimulatedGoals,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Goals {
    left: u32,
    right: u32,
}

impl Goals {
    /// Goals by the scorer: a ball in the cup of one player is a goal of the other.
    fn of(truth: &Truth) -> Self {
        let [in_left_cup, in_right_cup] = truth.goals;
        Self { left: in_right_cup, right: in_left_cup }
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    parse_within(text, 1.0, 7200.0, "s")
}

fn parse_games(text: &str) -> Result<u32, String> {
    let odd = text.parse().ok().filter(|games: &u32| games % 2 == 1 && *games <= 99);
    odd.ok_or_else(|| "not an odd number from 1 to 99".to_owned())
}

/// Run `klasktron play`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let seats = [Seat::read(&args.left)?, Seat::read(&args.right)?];
    let names = seats.each_ref().map(|seat| seat.as_ref().map_or_else(none, Seat::to_string));
    let filter = args.ekf.as_deref().map(read_settings).transpose()?;
    let files = args.read_files()?;
    if let Some(model) = &args.simulation {
        if args.session.has_live_view() {
            bail!(
                "--simulation runs faster than real time: record it, and show it with `klasktron replay`"
            );
        }
        return args.simulate(model, seats, (names, &files));
    }
    if let BusSpec::Replay(_) = args.table.bus {
        bail!("{} is a log; a match needs a live bus or --bus virtual", args.table.bus);
    }
    if !args.table.has_camera() {
        bail!("a match needs a camera: give --camera");
    }
    let filter = filter.unwrap_or_default();
    let mut game = Match::new(seats, &files.robot, &filter, args.seed)?;
    if let Some(points_per_game) = args.points {
        game = game.until_won(MatchFormat { points_per_game, best_of: args.best_of });
    }
    for warning in game.warnings(&files.robot) {
        tell(&format!("warning: {warning}"));
    }
    let motion = Motion {
        players: game.players(),
        rate_hz: game.rate_hz(),
        hold_gain_per_s: HOLD_GAIN_PER_S,
    };
    let homing = args.session.homing(&args.table, None)?;
    let table = (&args.table, &files);
    let mut config = args.session.config(table, motion, homing, &args.output)?;
    config.metadata.extend(game.metadata());
    if let Some(scene) = &mut config.scene {
        scene.filter = filter;
    }
    let stretch = FreeStretch { pilot: &mut game, seconds: args.seconds, label: label() };
    let (report, table) = args.session.run(table, &args.output, |table, output| {
        run_session(table.link(), &files.robot, &config, Work::Free(stretch), output)
    })?;
    args.tell((&report, game.score()), names, table.truth().as_ref().map(Goals::of))
}

fn none() -> String {
    "none".to_owned()
}

impl Args {
    fn read_files(&self) -> anyhow::Result<TableFiles> {
        let rig =
            RigConfig { seed: self.seed, ball: BallConfig::in_a_match(), ..RigConfig::default() };
        self.table.read_files(rig)
    }

    /// Play in the simulation `model`; domain randomization and sensors are those of the policy's
    /// training.
    fn simulate(
        &self,
        model: &Path,
        seats: [Option<Seat>; 2],
        ([left, right], files): ([String; 2], &TableFiles),
    ) -> anyhow::Result<Outcome> {
        refuse_existing_file(&self.output, self.session.overwrite)?;
        let (mut game, source) = game_with_actuator(model)?;
        let trained = seats.iter().flatten().find_map(|seat| match seat {
            Seat::Policy { policy, .. } => Some(&policy.settings),
            Seat::Scripted(_) => None,
        });
        game.randomization = trained.and_then(TrainSettings::randomization_ranges);
        game.sensors = trained.and_then(|settings| settings.sensors);
        let mut played = SimulatedMatch::new(seats, &game, (&files.robot, &files.rig), self.seed)?;
        let entries = [
            ("schema_version", "1".to_owned()),
            ("source", "simulation".to_owned()),
            ("session", "match".to_owned()),
            ("robot", "simulated".to_owned()),
            ("player_left", left.clone()),
            ("player_right", right.clone()),
            ("actuator", source.kind.clone()),
            ("actuator_sha256", source.sha256.clone().unwrap_or_default()),
            ("seed", self.seed.to_string()),
        ];
        let metadata = entries.map(|(key, value)| (key.to_owned(), value)).into();
        let place = (self.output.as_path(), self.session.overwrite.existing());
        let goals = played.record(self.seconds, metadata, place)?;
        if self.session.json {
            let document = SimulatedReport {
                left,
                right,
                actuator: source,
                seconds: self.seconds,
                truth_goals: goals,
            };
            print(&serde_json::to_string_pretty(&document)?)?;
        } else {
            print(&format!("{left} against {right}: {} : {}", goals.left, goals.right))?;
            print(&format!("wrote {}", self.output.display()))?;
        }
        Ok(Outcome::Done)
    }

    fn tell(
        &self,
        (report, score): (&SessionReport, MatchScore),
        [left, right]: [String; 2],
        truth_goals: Option<Goals>,
    ) -> anyhow::Result<Outcome> {
        session::tell_warnings(report);
        let mut done = format!("{left} against {right} {score}, {} actions", report.samples);
        if self.session.json {
            let document = MatchReport { session: report, left, right, score, truth_goals };
            print(&serde_json::to_string_pretty(&document)?)?;
        }
        if let Some(Goals { left, right }) = truth_goals {
            done.push_str(&format!(", true goals {left} : {right}"));
        }
        if let Some(wait) = report.image_to_command {
            note(&format!(
                "image-to-command latency {:.1} ms (median), {:.1} ms (99 %)",
                wait.median_ms, wait.p99_ms
            ));
        }
        Ok(session::tell_outcome(report, &self.output, &done))
    }
}
