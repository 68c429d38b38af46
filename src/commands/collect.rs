//! `klasktron collect`: arguments to a plan, a link and a session, and its outcome.

use super::{
    Outcome, interrupt,
    live_view::LiveView,
    print,
    table::{OpenTable, TableArgs, TableFiles},
    tell,
};
use anyhow::{Context, bail};
use clap::ValueEnum;
use klasktron::{
    collect::{
        HomingPolicy, Leg, Plan, Proof, RawFrames, Schedule, SessionConfig, SessionError,
        SessionOutput, SessionReport, WatchdogPolicy, Work, listen, plan_page, prove, run_session,
    },
    gantry::Pattern,
    link::BusSpec,
    provenance::{CRATE_VERSION, GIT_HASH},
    recording::{
        ExistingFile, FlushPolicy, RecordingWriter, SESSION_COMPLETED, Split, partial_name,
        topic::Player, write_bytes,
    },
};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Largest rate of the control loop (Hz).
const LARGEST_RATE_HZ: f64 = 500.0;
/// Rate at which the KlaskTron table is controlled (Hz).
const USUAL_RATE_HZ: f64 = 50.0;

/// What can be typed after `klasktron collect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron collect --plan paper --dry-run plan
  klasktron collect --bus virtual --speed max --plan paper -o virtual.mcap
  klasktron collect --bus socketcan:can0 --camera udp:127.0.0.1:9870 \\
      --pattern circle:radius_m=0.05,speed_m_per_s=0.3 --seconds 30 --repeat 4 -o circles.mcap
  klasktron collect --bus replay:bus.log --listen -o bus.mcap")]
pub(crate) struct Args {
    /// The recording to write
    #[arg(short, long, value_name = "OUT", default_value = "collect.mcap")]
    output: PathBuf,
    /// Replace the recording if it is there already
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    table: TableArgs,
    #[command(flatten)]
    motion: MotionArgs,
    /// How positions are referenced [default: camera when there is one]
    #[arg(long, value_enum)]
    homing: Option<HomingArg>,
    /// How it is made sure that the drives stop by themselves when this program dies
    #[arg(long, value_enum, default_value = "test")]
    watchdog: WatchdogArg,
    /// Also drive firmware of this version, as Get_Version reports it (repeatable)
    #[arg(long, value_name = "VERSION")]
    accept_firmware: Vec<String>,
    /// How strongly commands pull a carriage back to its path ((m/s)/m)
    #[arg(long, value_name = "GAIN", default_value = "1", value_parser = parse_gain)]
    hold_gain_per_s: f64,
    /// Record every frame on /can/frames too
    #[arg(long)]
    raw: bool,
    /// Write the plan as page, table and JSON into a folder, and touch no bus
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "plan")]
    dry_run: Option<PathBuf>,
    /// Only record what is on the bus, for so many seconds or until a log ends; send nothing
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "inf", value_parser = parse_seconds)]
    listen: Option<f64>,
    /// Print the robot file with every value as JSON, and end
    #[arg(long)]
    print_robot: bool,
    /// Session in the recording's metadata [default: the output's name]
    #[arg(long)]
    session: Option<String>,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct MotionArgs {
    /// `paper` (the data set of the KlaskTron paper), or a plan as JSON
    #[arg(long, value_name = "PLAN", required_unless_present_any = ["pattern", "patterns", "listen", "print_robot"], conflicts_with_all = ["pattern", "seconds", "repeat", "validation_every"])]
    plan: Option<String>,
    /// A pattern such as circle:radius_m=0.05,speed_m_per_s=0.3 (repeatable); see --patterns
    #[arg(long, value_name = "PATTERN")]
    pattern: Vec<Pattern>,
    /// Length of each run of a pattern (s)
    #[arg(long, default_value = "30", value_parser = parse_run_seconds)]
    seconds: f64,
    /// Runs of each pattern
    #[arg(long, value_name = "COUNT", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeat: u32,
    /// Every so many runs of a pattern, one is held out for validation; 0 for none
    #[arg(long, value_name = "COUNT", default_value = "5", value_parser = clap::value_parser!(u32).range(0..=1000))]
    validation_every: u32,
    /// List the patterns with their parameters and what they reveal
    #[arg(long)]
    patterns: bool,
    /// Rate of the control loop (Hz), 10 to 500 [default: 50, or what a plan file says]
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    rate_hz: Option<f64>,
    /// Seed of what is random in a plan
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum HomingArg {
    /// The camera sees where the strikers are
    Camera,
    /// The carriages stand at the home points of the robot file
    Declared,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum WatchdogArg {
    /// Arm at zero velocity, fall silent, and demand that every drive disarms by itself
    Test,
    /// The operator knows that the watchdogs are on
    Trust,
    /// The operator accepts that they are off
    None,
}

fn parse_within(text: &str, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if low <= value && value <= high => Ok(value),
        _ => Err(format!("must be a number from {low} to {high} {unit}")),
    }
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

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if args.motion.patterns {
        return list_patterns();
    }
    let files = args.table.read_files()?;
    if args.print_robot {
        print(&serde_json::to_string_pretty(&files.robot)?)?;
        return Ok(Outcome::Done);
    }
    if let Some(seconds) = args.listen {
        return listen_only(args, &files, seconds);
    }
    let plan = args.motion.plan()?;
    let players = args.table.players(&files.robot)?;
    let proof = prove(&plan, &files.robot, &players)?;
    if let Some(folder) = &args.dry_run {
        return write_plan(folder, &proof, &files, args);
    }
    if matches!(args.table.bus, BusSpec::Replay(_)) {
        bail!("{} can be listened to (--listen), not driven", args.table.bus);
    }
    let mut config = args.session_config(&files, players)?;
    config.rate_hz = plan.rate_hz;
    config.metadata.extend(plan_metadata(&plan)?);
    let legs = Leg::of_proof(&proof);
    let view = LiveView::new();
    session(args, &files, &view, |table, output| {
        run_session(&mut *table.link, &files.robot, &config, Work::Legs(&legs), output)
    })
}

fn listen_only(args: &Args, files: &TableFiles, seconds: f64) -> anyhow::Result<Outcome> {
    let players = args.table.players(&files.robot)?;
    let config = args.session_config(files, players)?;
    let view = LiveView::new();
    session(args, files, &view, |table, output| {
        listen(&mut *table.link, &files.robot, &config, seconds, output)
    })
}

/// Opens file and table, runs one session and says how it went.
fn session(
    args: &Args,
    files: &TableFiles,
    view: &LiveView,
    run: impl FnOnce(&mut OpenTable, SessionOutput<'_>) -> Result<SessionReport, SessionError>,
) -> anyhow::Result<Outcome> {
    let existing = if args.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse };
    let mut table = args.table.open(files)?;
    let writer = RecordingWriter::create(&args.output, existing, FlushPolicy::EverySecond)?;
    let presses = interrupt::counted_ctrl_c(
        "interrupted: ramping down; once more for an emergency stop",
        "emergency stop; once more to end at once",
    )?;
    let output = SessionOutput { writer, presses, show: &mut |progress| view.show(progress) };
    let result = run(&mut table, output);
    view.close();
    tell_outcome(args, &result?)
}

fn tell_outcome(args: &Args, report: &SessionReport) -> anyhow::Result<Outcome> {
    let file = args.output.display();
    for warning in &report.warnings {
        tell(&format!("warning: {warning}"));
    }
    for loss in &report.losses {
        tell(&format!("lost: {loss}"));
    }
    for node in &report.not_confirmed_off {
        tell(&format!("warning: node {node} has not confirmed that it is off; cut the power"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(report)?)?;
    }
    if let Some((_, firmware)) = report.census.firmware.first() {
        let [load, worst] = [report.census.bus_load, report.census.worst_bus_load].map(|l| 1e2 * l);
        let drives = report.census.firmware.len();
        tell(&format!(
            "{drives} drives, firmware {firmware}; bus {load:.0} % busy, {worst:.0} % at worst"
        ));
    }
    if report.stop != SESSION_COMPLETED {
        tell(&format!("stopped: {}", report.stop_text));
    }
    let kept = if args.output.exists() {
        format!("wrote {file}")
    } else {
        let partial = partial_name(&args.output);
        let partial = partial.display();
        format!(
            "what was written is in {partial}; save it with `klasktron recover {partial} -o OUT`"
        )
    };
    let late = &report.lateness;
    tell(&format!(
        "{kept}: {} of {} runs, {} samples, {:.1} s; periods late by {:.0} us (median), {:.0} us \
         (99 %), {:.0} us (most); {} left out",
        report.runs_done,
        report.runs_planned,
        report.samples,
        report.duration_s,
        late.p50_us,
        late.p99_us,
        late.max_us,
        late.skipped
    ));
    Ok(if report.is_complete() { Outcome::Done } else { Outcome::Lossy })
}

fn write_plan(
    folder: &Path,
    proof: &Proof,
    files: &TableFiles,
    args: &Args,
) -> anyhow::Result<Outcome> {
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let page = plan_page(proof, &files.robot)?;
    for (name, text) in [
        ("index.html", &page.index_html),
        ("plan.csv", &page.plan_csv),
        ("plan.json", &page.plan_json),
    ] {
        write_bytes(&folder.join(name), ExistingFile::Replace, text.as_bytes())?;
    }
    if args.json {
        print(&page.plan_json)?;
    }
    let (runs, samples) = (proof.runs().len(), proof.plan().samples());
    tell(&format!(
        "proven: {runs} runs, {samples} samples, {:.1} min with the moves between runs; nearest to an \
         edge {:.1} mm with its stopping distance; wrote {2}/index.html, {2}/plan.csv and \
         {2}/plan.json",
        proof.duration_s() / 60.0,
        1e3 * proof.figures().edge_distance_m,
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
                    format!("{path}: cannot read; --plan takes `paper` or a plan as JSON")
                })?;
                let plan = Plan::from_json(&text).with_context(|| path.to_owned())?;
                if self.rate_hz.is_some_and(|rate| rate != plan.rate_hz) {
                    bail!("{path}: the plan is for {} Hz; leave --rate-hz out", plan.rate_hz);
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

impl Args {
    fn session_config(
        &self,
        files: &TableFiles,
        players: Vec<Player>,
    ) -> anyhow::Result<SessionConfig> {
        let homing = match self.homing {
            Some(HomingArg::Declared) => HomingPolicy::Declared,
            Some(HomingArg::Camera) if !self.table.has_camera() => {
                bail!("--homing camera needs --camera")
            }
            Some(HomingArg::Camera) => HomingPolicy::Camera,
            None if self.table.has_camera() => HomingPolicy::Camera,
            None if self.listen.is_some() => HomingPolicy::Declared,
            None => bail!(
                "there is no camera to say where the carriages are: give --camera, or put them at \
                 their home points and say --homing declared"
            ),
        };
        Ok(SessionConfig {
            players,
            rate_hz: self.motion.rate(),
            homing,
            watchdog: match self.watchdog {
                WatchdogArg::Test => WatchdogPolicy::Test,
                WatchdogArg::Trust => WatchdogPolicy::Trust,
                WatchdogArg::None => WatchdogPolicy::None,
            },
            raw: if self.raw { RawFrames::Record } else { RawFrames::Omit },
            accepted_firmware: self.accept_firmware.clone(),
            hold_gain_per_s: self.hold_gain_per_s,
            metadata: self.metadata(files, homing)?,
        })
    }

    /// What every recording carries, and how this one was made.
    fn metadata(
        &self,
        files: &TableFiles,
        homing: HomingPolicy,
    ) -> anyhow::Result<BTreeMap<String, String>> {
        let robot = &files.robot;
        let name = self.output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let origin = match homing {
            HomingPolicy::Camera => "camera",
            HomingPolicy::Declared => "declared",
        };
        let mut entries = vec![
            ("schema_version", "1".to_owned()),
            ("source", self.table.source().to_owned()),
            ("session", self.session.clone().unwrap_or(name)),
            ("robot", robot.name.clone()),
            ("bus", self.table.bus.to_string()),
            ("board_short_side_m", robot.board.short_side_m.to_string()),
            ("board_long_side_m", robot.board.long_side_m.to_string()),
            ("belt_metres_per_turn", robot.belt_metres_per_turn.to_string()),
            ("slew_limit_m_per_s2", robot.limits.slew_m_per_s2.to_string()),
            ("hold_gain_per_s", self.hold_gain_per_s.to_string()),
            ("carriage_origin", origin.to_owned()),
            ("robot_json", serde_json::to_string(robot)?),
            ("crate_version", CRATE_VERSION.to_owned()),
            ("git_hash", GIT_HASH.to_owned()),
        ];
        if self.table.bus == BusSpec::Virtual {
            entries.push(("rig_json", serde_json::to_string(&files.rig)?));
        }
        Ok(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    }
}

/// What of the plan stands in the recording's metadata.
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
