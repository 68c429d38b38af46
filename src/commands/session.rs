//! Sessions that drive motors, for `collect` and `play`: arguments, set-up, run and report.

use super::{
    Outcome, interrupt,
    live::{self, LiveArgs},
    live_view::LiveView,
    note,
    results::{OverwriteArgs, refuse_existing_file},
    table::{OpenTable, TableArgs, TableFiles},
    tell,
};
use anyhow::{anyhow, bail};
use clap::ValueEnum;
use klasktron::{
    board::BoardSize,
    collect::{
        HomingPolicy, NodeFirmware, RawFrames, SessionConfig, SessionError, SessionOutput,
        SessionReport, WatchdogPolicy,
    },
    gantry::Robot,
    link::BusSpec,
    live::LiveServer,
    provenance::{CRATE_VERSION, GIT_HASH},
    recording::{FlushPolicy, RecordingWriter, SESSION_COMPLETED, partial_name, topic::Player},
    scene::SceneSettings,
};
use std::{collections::BTreeMap, path::Path};

/// Arguments of a session.
#[derive(Debug, clap::Args)]
pub(crate) struct SessionArgs {
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    /// Reference of the positions [default: camera where there is one]
    #[arg(long, value_enum)]
    homing: Option<HomingArg>,
    /// Check that the drives stop by themselves when this program dies
    #[arg(long, value_enum, default_value = "test")]
    watchdog: WatchdogArg,
    /// Accept drives with this firmware version too, as Get_Version reports it (repeatable)
    #[arg(long, value_name = "VERSION")]
    accept_firmware: Vec<String>,
    /// Record every CAN frame on /can/frames
    #[arg(long)]
    raw: bool,
    #[command(flatten)]
    live: LiveArgs,
    /// Record a scene for three-dimensional viewers on /scene; --live does so too
    #[arg(long)]
    scene: bool,
    /// Session name in the recording's metadata [default: the name of the file]
    #[arg(long)]
    session: Option<String>,
    /// Print only the result document, on stdout
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum HomingArg {
    /// Positions of the strikers that the camera detects
    Camera,
    /// Home points of the robot file: the operator has put the carriages there
    Declared,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum WatchdogArg {
    /// Arm at zero velocity, send nothing, and require that every drive disarms
    Test,
    /// Assume that the watchdogs are on
    Trust,
    /// Accept that the watchdogs are off
    None,
}

/// Motion of a session.
pub(crate) struct Motion {
    pub(crate) players: Vec<Player>,
    /// Rate of the control loop (Hz).
    pub(crate) rate_hz: f64,
    /// Gain of the position hold along the path ((m/s)/m).
    pub(crate) hold_gain_per_s: f64,
}

impl SessionArgs {
    /// Homing policy of `--homing`; by default the camera, or `otherwise` without one.
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
                "no camera locates the carriages: give --camera, or put the carriages at their home \
                 points and give --homing declared"
            )),
        }
    }

    /// Configuration of a session with `motion`, recorded as `output`.
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
            scene: self.scene_settings(&files.robot)?,
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

    /// Scene to record, without paths; `None` where nobody asked for one.
    fn scene_settings(&self, robot: &Robot) -> anyhow::Result<Option<SceneSettings>> {
        let board = BoardSize::new(robot.board.short_side_m, robot.board.long_side_m)?;
        let settings = SceneSettings { board, ..SceneSettings::default() };
        Ok((self.scene || self.has_live_view()).then_some(settings))
    }

    /// Return whether viewers are served.
    pub(crate) fn has_live_view(&self) -> bool {
        self.live.live.is_some()
    }

    /// Open table and file, run one session, and return its report with the table.
    pub(crate) fn run(
        &self,
        (table, files): (&TableArgs, &TableFiles),
        output: &Path,
        run: impl FnOnce(&mut OpenTable, SessionOutput<'_>) -> Result<SessionReport, SessionError>,
    ) -> anyhow::Result<(SessionReport, OpenTable)> {
        refuse_existing_file(output, self.overwrite)?;
        let server = self.live.start()?;
        let mut table = table.open(files)?;
        let mut writer =
            RecordingWriter::create(output, self.overwrite.existing(), FlushPolicy::EverySecond)?;
        if let Some(mut publisher) = server.as_ref().map(LiveServer::publisher) {
            writer.observe(Box::new(move |topic, schema, time, data| {
                publisher.publish(topic, schema, time, data);
            }));
        }
        let presses = interrupt::counted_ctrl_c(
            "interrupted: ramping down and disarming; press Ctrl-C again for an emergency stop",
            "emergency stop; press Ctrl-C again to abort",
        )?;
        let view = LiveView::new();
        let session_output = SessionOutput {
            writer: Some(writer),
            presses,
            show: &mut |progress| view.show(progress),
        };
        let result = run(&mut table, session_output);
        view.close();
        live::tell_dropped(server.as_ref());
        Ok((result?, table))
    }
}

/// Metadata of every recording of a session about robot and program.
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

/// Print the warnings and losses of a session.
pub(crate) fn tell_warnings(report: &SessionReport) {
    for warning in &report.warnings {
        tell(&format!("warning: {warning}"));
    }
    for loss in &report.losses {
        tell(&format!("lost: {loss}"));
    }
    for node in &report.not_confirmed_off {
        tell(&format!("warning: node {node} has not confirmed that it is disarmed; cut the power"));
    }
}

/// Print the traffic of a session: nodes, rates of their messages, firmware, errors and camera.
pub(crate) fn tell_traffic(report: &SessionReport) {
    for node in &report.traffic.nodes {
        note(&node.to_string());
    }
    for (fault, count) in &report.bus_faults {
        note(&format!("bus fault: {fault}, {count} times"));
    }
    let [load, worst] = bus_load_percent(report);
    let frames = report.traffic.frames_per_s.unwrap_or(0.0);
    note(&format!("bus: {frames:.0} frames/s, load {load:.0} %, at most {worst:.0} %"));
    note(&report.traffic.camera.to_string());
}

/// Bus load of a session (%), without and with the most stuff bits.
fn bus_load_percent(report: &SessionReport) -> [f64; 2] {
    [report.bus.bus_load, report.bus.worst_case_bus_load].map(|load| 1e2 * load)
}

/// Print the report of a session: bus, reason of its end, path of the recording, work `done`, timing.
pub(crate) fn tell_outcome(report: &SessionReport, output: &Path, done: &str) -> Outcome {
    if let Some(NodeFirmware { version, .. }) = report.bus.firmware.first() {
        let [load, worst] = bus_load_percent(report);
        let drives = report.bus.firmware.len();
        note(&format!(
            "{drives} drives, firmware {version}; bus load {load:.0} %, at most {worst:.0} %"
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
            "the unfinished recording is {partial}; save it with `klasktron recover {partial} -o OUTPUT`"
        )
    };
    let timing = &report.control_loop;
    let control_loop = if timing.periods == 0 {
        String::new()
    } else {
        format!(
            "; control-loop jitter {:.0} us (median), {:.0} us (99 %), {:.0} us (largest); {} missed \
             deadlines",
            timing.lateness_p50_us,
            timing.lateness_p99_us,
            timing.lateness_max_us,
            timing.missed_deadlines
        )
    };
    // A session that ended early is reported under --quiet too.
    let say = if report.is_complete() { note } else { tell };
    say(&format!("{kept}: {done}, {:.1} s{control_loop}", report.duration_s));
    if report.is_complete() { Outcome::Done } else { Outcome::Lossy }
}
