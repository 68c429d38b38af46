//! `klasktron collect`: check a plan, drive it on a table and record the session.

use super::{
    Outcome, note, print,
    results::Results,
    session::{self, Motion, SessionArgs},
    table::{OpenTable, TableArgs, TableFiles, parse_within},
};
use anyhow::{Context, bail};
use clap::ValueEnum;
use klasktron::{
    collect::{
        CheckedPlan, HomingPolicy, Leg, Plan, Schedule, SessionConfig, SessionError, SessionOutput,
        SessionReport, Work, check_plan, listen, plan_page, planned_paths, run_session,
    },
    gantry::{Pattern, Robot},
    link::BusSpec,
    recording::{ExistingFile, Split, topic::Player, write_bytes},
    rig::RigConfig,
};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Largest rate of the control loop (Hz): the bus of the table carries no more.
const LARGEST_RATE_HZ: f64 = 500.0;
/// Control rate of the KlaskTron table (Hz).
const USUAL_RATE_HZ: f64 = 50.0;
/// Files of a dry run.
const PLAN_FILES: [&str; 3] = ["index.html", "plan.csv", "plan.json"];

/// Arguments of `klasktron collect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron collect --plan paper --dry-run plan
  klasktron collect --bus virtual --speed max --plan paper -o virtual.mcap
  klasktron collect --bus socketcan:can0 --camera udp:127.0.0.1:9870 \\
      --pattern circle:radius_m=0.05,speed_m_per_s=0.3 --seconds 30 --repeat 4 -o circles.mcap
  klasktron collect --bus replay:bus.log --listen -o bus.mcap")]
pub(crate) struct Args {
    /// Recording to write
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "collect.mcap")]
    output: PathBuf,
    #[command(flatten)]
    table: TableArgs,
    /// Players whose carriages are driven
    #[arg(long, value_enum, default_value = "both")]
    player: PlayersArg,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    session: SessionArgs,
    /// Gain of the position hold along the path ((m/s)/m)
    #[arg(long, value_name = "GAIN", default_value = "1", value_parser = parse_gain)]
    hold_gain_per_s: f64,
    /// Write the plan as a page, a table and JSON into a folder, without using a bus
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "plan")]
    dry_run: Option<PathBuf>,
    /// Record the traffic of the bus for this time (s) or until a log ends; send nothing
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "inf", value_parser = parse_seconds)]
    listen: Option<f64>,
    /// Print the robot file with every value as JSON and exit
    #[arg(long)]
    print_robot: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PlayersArg {
    Left,
    Right,
    Both,
}

#[derive(Debug, clap::Args)]
struct MotionArgs {
    /// Plan: `paper` (the data set of the KlaskTron paper) or a JSON file
    #[arg(long, value_name = "PLAN", required_unless_present_any = ["pattern", "patterns", "listen", "print_robot"], conflicts_with_all = ["pattern", "seconds", "repeat", "validation_every"])]
    plan: Option<String>,
    /// Pattern such as circle:radius_m=0.05,speed_m_per_s=0.3 (repeatable); see --patterns
    #[arg(long, value_name = "PATTERN")]
    pattern: Vec<Pattern>,
    /// Duration of each run of a pattern (s)
    #[arg(long, default_value = "30", value_parser = parse_run_seconds)]
    seconds: f64,
    /// Number of runs of each pattern
    #[arg(long, value_name = "COUNT", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeat: u32,
    /// Hold out every so many runs of a pattern for validation; 0: none
    #[arg(long, value_name = "COUNT", default_value = "5", value_parser = clap::value_parser!(u32).range(0..=1000))]
    validation_every: u32,
    /// List the patterns with their parameters and the effects that they excite, and exit
    #[arg(long)]
    patterns: bool,
    /// Rate of the control loop (Hz), 10 to 500 [default: the rate of a plan file, or 50]
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    rate_hz: Option<f64>,
    /// Seed of the random patterns
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

fn parse_rate(text: &str) -> Result<f64, String> {
    parse_within(text, 10.0, LARGEST_RATE_HZ, "Hz")
}

fn parse_gain(text: &str) -> Result<f64, String> {
    parse_within(text, 0.0, 5.0, "(m/s)/m")
}

fn parse_run_seconds(text: &str) -> Result<f64, String> {
    parse_within(text, 1.0, 3600.0, "s")
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    parse_within(text, 0.1, f64::INFINITY, "s")
}

/// Run `klasktron collect`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if args.motion.patterns {
        return list_patterns();
    }
    let files = args.table.read_files(RigConfig::default())?;
    if args.print_robot {
        print(&serde_json::to_string_pretty(&files.robot)?)?;
        return Ok(Outcome::Done);
    }
    if let Some(seconds) = args.listen {
        return listen_only(args, &files, seconds);
    }
    let plan = args.motion.plan()?;
    let players = args.player.of_robot(&files.robot)?;
    let checked = check_plan(&plan, &files.robot, &players)?;
    if let Some(folder) = &args.dry_run {
        return write_plan(folder, &checked, &files, args);
    }
    if matches!(args.table.bus, BusSpec::Replay(_)) {
        bail!("{} is a log: it can be recorded with --listen, not driven", args.table.bus);
    }
    let homing = args.session.homing(&args.table, None)?;
    let mut config = args.session_config(&files, (players, plan.rate_hz), homing)?;
    config.metadata.extend(plan_metadata(&plan)?);
    let legs = Leg::of_plan(&checked);
    if let Some(scene) = &mut config.scene {
        scene.paths = planned_paths(&legs);
    }
    drive(args, &files, |table, output| {
        run_session(table.link(), &files.robot, &config, Work::Legs(&legs), output)
    })
}

fn listen_only(args: &Args, files: &TableFiles, seconds: f64) -> anyhow::Result<Outcome> {
    let players = args.player.of_robot(&files.robot)?;
    // Nothing is driven, so positions need no reference.
    let homing = args.session.homing(&args.table, Some(HomingPolicy::Declared))?;
    let config = args.session_config(files, (players, args.motion.rate()), homing)?;
    let (report, _table) =
        args.session.run((&args.table, files), &args.output, |table, output| {
            listen(table.link(), &files.robot, &config, seconds, output)
        })?;
    session::tell_traffic(&report);
    session::tell_warnings(&report);
    if args.session.json {
        print(&serde_json::to_string_pretty(&report)?)?;
    }
    let heard =
        format!("{} frames, {} camera frames", report.frames_received, report.camera_frames);
    Ok(session::tell_outcome(&report, &args.output, &heard))
}

/// Run one session and print its report.
fn drive(
    args: &Args,
    files: &TableFiles,
    run: impl FnOnce(&mut OpenTable, SessionOutput<'_>) -> Result<SessionReport, SessionError>,
) -> anyhow::Result<Outcome> {
    let (report, _table) = args.session.run((&args.table, files), &args.output, run)?;
    session::tell_warnings(&report);
    if args.session.json {
        print(&serde_json::to_string_pretty(&report)?)?;
    }
    let SessionReport { runs_done, runs_planned, samples, .. } = report;
    let done = format!("{runs_done} of {runs_planned} runs, {samples} samples");
    Ok(session::tell_outcome(&report, &args.output, &done))
}

fn write_plan(
    folder: &Path,
    checked: &CheckedPlan,
    files: &TableFiles,
    args: &Args,
) -> anyhow::Result<Outcome> {
    let results = Results::begin(folder, &PLAN_FILES, args.session.overwrite)?;
    let page = plan_page(checked, &files.robot)?;
    let texts = [&page.index_html, &page.plan_csv, &page.plan_json];
    for (name, text) in PLAN_FILES.iter().zip(texts) {
        write_bytes(&results.path(name), ExistingFile::Replace, text.as_bytes())?;
    }
    results.finish()?;
    if args.session.json {
        print(&page.plan_json)?;
    }
    let (runs, samples) = (checked.runs().len(), checked.plan().samples());
    note(&format!(
        "safe plan: {runs} runs, {samples} samples, {:.1} min with the moves between runs; smallest \
         distance to an edge {:.1} mm with the stopping distance; wrote {2}/index.html, {2}/plan.csv and \
         {2}/plan.json",
        checked.duration_s() / 60.0,
        1e3 * checked.extremes().edge_distance_m,
        folder.display()
    ));
    Ok(Outcome::Done)
}

fn list_patterns() -> anyhow::Result<Outcome> {
    for pattern in Pattern::ALL {
        print(&format!("{pattern}\n    {}", pattern.purpose()))?;
    }
    Ok(Outcome::Done)
}

impl MotionArgs {
    fn plan(&self) -> anyhow::Result<Plan> {
        let plan = match self.plan.as_deref() {
            Some("paper") => Plan::paper(self.rate(), self.seed)?,
            Some(path) => {
                let text = fs::read_to_string(path).with_context(|| {
                    format!("{path}: cannot read; --plan takes `paper` or a JSON file")
                })?;
                let plan = Plan::from_json(&text).with_context(|| path.to_owned())?;
                if self.rate_hz.is_some_and(|rate| rate != plan.rate_hz) {
                    bail!("{path}: the plan is for {} Hz; omit --rate-hz", plan.rate_hz);
                }
                if LARGEST_RATE_HZ < plan.rate_hz {
                    bail!("{path}: rate_hz is {}; it must be at most 500 Hz", plan.rate_hz);
                }
                plan
            }
            None => Plan::from_patterns(&self.pattern, &self.schedule())?,
        };
        Ok(plan)
    }

    fn rate(&self) -> f64 {
        self.rate_hz.unwrap_or(USUAL_RATE_HZ)
    }

    fn schedule(&self) -> Schedule {
        Schedule {
            rate_hz: self.rate(),
            seed: self.seed,
            seconds: self.seconds,
            repeat: self.repeat,
            validation_every: (0 < self.validation_every).then_some(self.validation_every),
        }
    }
}

impl PlayersArg {
    /// Selected players; an error where the robot file does not have them.
    fn of_robot(self, robot: &Robot) -> anyhow::Result<Vec<Player>> {
        let all = robot.players();
        let wanted = match self {
            Self::Left => vec![Player::Left],
            Self::Right => vec![Player::Right],
            Self::Both => return Ok(all),
        };
        if wanted.iter().any(|player| !all.contains(player)) {
            bail!("the robot file has no drives for the {} player", wanted[0]);
        }
        Ok(wanted)
    }
}

impl Args {
    fn session_config(
        &self,
        files: &TableFiles,
        (players, rate_hz): (Vec<Player>, f64),
        homing: HomingPolicy,
    ) -> anyhow::Result<SessionConfig> {
        let motion = Motion { players, rate_hz, hold_gain_per_s: self.hold_gain_per_s };
        self.session.config((&self.table, files), motion, homing, &self.output)
    }
}

/// Metadata of the recording about the plan.
fn plan_metadata(plan: &Plan) -> anyhow::Result<BTreeMap<String, String>> {
    let all = |split| plan.runs.iter().all(|run| run.split == split);
    let split = if all(Split::Train) {
        "train"
    } else if all(Split::Validation) {
        "validation"
    } else {
        "by_run"
    };
    let entries = [
        ("split", split.to_owned()),
        ("plan", plan.name.clone()),
        ("plan_json", plan.to_json()?),
        ("seed", plan.seed.to_string()),
        ("rate_hz", plan.rate_hz.to_string()),
    ];
    Ok(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}
