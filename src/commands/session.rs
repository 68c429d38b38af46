//! What `collect` and `play` share: the arguments of a session that drives motors, and its way from there to
//! an outcome.

use super::{
    Outcome, interrupt,
    live_view::LiveView,
    note,
    table::{OpenTable, TableArgs, TableFiles},
    tell,
};
use anyhow::{anyhow, bail};
use clap::ValueEnum;
use klasktron::{
    collect::{
        HomingPolicy, RawFrames, SessionConfig, SessionError, SessionOutput, SessionReport,
        WatchdogPolicy,
    },
    gantry::Robot,
    link::BusSpec,
    provenance::{CRATE_VERSION, GIT_HASH},
    recording::{
        ExistingFile, FlushPolicy, RecordingWriter, SESSION_COMPLETED, partial_name, topic::Player,
    },
};
use std::{collections::BTreeMap, path::Path};

/// How a session is run.
#[derive(Debug, clap::Args)]
pub(crate) struct SessionArgs {
    /// Replace the recording if it is there already
    #[arg(long)]
    overwrite: bool,
    /// How positions are referenced [default: camera when there is one]
    #[arg(long, value_enum)]
    homing: Option<HomingArg>,
    /// How it is made sure that the drives stop by themselves when this program dies
    #[arg(long, value_enum, default_value = "test")]
    watchdog: WatchdogArg,
    /// Also drive firmware of this version, as Get_Version reports it (repeatable)
    #[arg(long, value_name = "VERSION")]
    accept_firmware: Vec<String>,
    /// Record every frame on /can/frames too
    #[arg(long)]
    raw: bool,
    /// Session in the recording's metadata [default: the output's name]
    #[arg(long)]
    session: Option<String>,
    /// Print the result document alone on stdout
    #[arg(long)]
    pub(crate) json: bool,
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

/// Who moves in a session, and how.
pub(crate) struct Motion {
    pub(crate) players: Vec<Player>,
    /// Rate of the control loop (Hz).
    pub(crate) rate_hz: f64,
    /// How strongly commands pull a carriage back to its path ((m/s)/m).
    pub(crate) hold_gain_per_s: f64,
}

impl SessionArgs {
    /// The policy of `--homing`; without it the camera, or `otherwise` where there is none.
    pub(crate) fn homing(
        &self,
        table: &TableArgs,
        otherwise: Option<HomingPolicy>,
    ) -> anyhow::Result<HomingPolicy> {
        match self.homing {
            Some(HomingArg::Declared) => Ok(HomingPolicy::Declared),
            Some(HomingArg::Camera) if !table.has_camera() => {
                bail!("--homing camera needs --camera")
            }
            Some(HomingArg::Camera) => Ok(HomingPolicy::Camera),
            None if table.has_camera() => Ok(HomingPolicy::Camera),
            None => otherwise.ok_or_else(|| anyhow!(
                "there is no camera to say where the carriages are: give --camera, or put them at \
                 their home points and say --homing declared"
            )),
        }
    }

    /// The session of `motion`, to be recorded as `output`.
    pub(crate) fn config(
        &self,
        (table, files): (&TableArgs, &TableFiles),
        motion: Motion,
        homing: HomingPolicy,
        output: &Path,
    ) -> anyhow::Result<SessionConfig> {
        let Motion { players, rate_hz, hold_gain_per_s } = motion;
        let mut config = SessionConfig {
            players,
            rate_hz,
            homing,
            watchdog: match self.watchdog {
                WatchdogArg::Test => WatchdogPolicy::Test,
                WatchdogArg::Trust => WatchdogPolicy::Trust,
                WatchdogArg::None => WatchdogPolicy::None,
            },
            raw: if self.raw { RawFrames::Record } else { RawFrames::Omit },
            accepted_firmware: self.accept_firmware.clone(),
            hold_gain_per_s,
            metadata: metadata(&files.robot, homing)?,
        };
        let name = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut entries = vec![
            ("source", table.source().to_owned()),
            ("session", self.session.clone().unwrap_or(name)),
            ("bus", table.bus.to_string()),
            ("hold_gain_per_s", hold_gain_per_s.to_string()),
        ];
        if table.bus == BusSpec::Virtual {
            entries.push(("rig_json", serde_json::to_string(&files.rig)?));
        }
        config.metadata.extend(entries.into_iter().map(|(key, value)| (key.to_owned(), value)));
        Ok(config)
    }

    /// Opens table and file, runs one session, and gives its report with the table as it was left.
    pub(crate) fn run(
        &self,
        (table, files): (&TableArgs, &TableFiles),
        output: &Path,
        run: impl FnOnce(&mut OpenTable, SessionOutput<'_>) -> Result<SessionReport, SessionError>,
    ) -> anyhow::Result<(SessionReport, OpenTable)> {
        let existing = if self.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse };
        let mut table = table.open(files)?;
        let writer = RecordingWriter::create(output, existing, FlushPolicy::EverySecond)?;
        let presses = interrupt::counted_ctrl_c(
            "interrupted: ramping down; once more for an emergency stop",
            "emergency stop; once more to end at once",
        )?;
        let view = LiveView::new();
        let session_output =
            SessionOutput { writer, presses, show: &mut |progress| view.show(progress) };
        let result = run(&mut table, session_output);
        view.close();
        Ok((result?, table))
    }
}

/// What every recording of a session carries about robot and program.
fn metadata(robot: &Robot, homing: HomingPolicy) -> anyhow::Result<BTreeMap<String, String>> {
    let origin = match homing {
        HomingPolicy::Camera => "camera",
        HomingPolicy::Declared => "declared",
    };
    let entries = [
        ("schema_version", "1".to_owned()),
        ("robot", robot.name.clone()),
        ("board_short_side_m", robot.board.short_side_m.to_string()),
        ("board_long_side_m", robot.board.long_side_m.to_string()),
        ("belt_metres_per_turn", robot.belt_metres_per_turn.to_string()),
        ("slew_limit_m_per_s2", robot.limits.slew_m_per_s2.to_string()),
        ("carriage_origin", origin.to_owned()),
        ("robot_json", serde_json::to_string(robot)?),
        ("crate_version", CRATE_VERSION.to_owned()),
        ("git_hash", GIT_HASH.to_owned()),
    ];
    Ok(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

/// Says what went wrong in a session, if anything did.
pub(crate) fn tell_doubts(report: &SessionReport) {
    for warning in &report.warnings {
        tell(&format!("warning: {warning}"));
    }
    for loss in &report.losses {
        tell(&format!("lost: {loss}"));
    }
    for node in &report.not_confirmed_off {
        tell(&format!("warning: node {node} has not confirmed that it is off; cut the power"));
    }
}

/// Says how a session went: bus, reason of its end, where the recording is, what is `done`, timing.
pub(crate) fn tell_outcome(report: &SessionReport, output: &Path, done: &str) -> Outcome {
    if let Some((_, firmware)) = report.census.firmware.first() {
        let [load, worst] = [report.census.bus_load, report.census.worst_bus_load].map(|l| 1e2 * l);
        let drives = report.census.firmware.len();
        note(&format!(
            "{drives} drives, firmware {firmware}; bus {load:.0} % busy, {worst:.0} % at worst"
        ));
    }
    if report.stop != SESSION_COMPLETED {
        tell(&format!("stopped: {}", report.stop_text));
    }
    let kept = if output.exists() {
        format!("wrote {}", output.display())
    } else {
        let partial = partial_name(output);
        let partial = partial.display();
        format!(
            "what was written is in {partial}; save it with `klasktron recover {partial} -o OUT`"
        )
    };
    let late = &report.lateness;
    // A session that ended early is a loss, and nobody asked to miss that.
    let say = if report.is_complete() { note } else { tell };
    say(&format!(
        "{kept}: {done}, {:.1} s; periods late by {:.0} us (median), {:.0} us (99 %), {:.0} us (most); \
         {} left out",
        report.duration_s, late.p50_us, late.p99_us, late.max_us, late.skipped
    ));
    if report.is_complete() { Outcome::Done } else { Outcome::Lossy }
}
