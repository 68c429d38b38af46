//! Recordings made in memory, and the program run on them.

use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingWriter,
        message::{CarriageState, RunMarker, VelocityCommand, run_marker::Phase},
        topic::{self, Player},
    },
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// Control periods per second of [`Rig`].
pub(crate) const RATE_HZ: u64 = 50;
/// Log time of the first message of every fixture.
pub(crate) const START: Nanos = Nanos(1_700_000_000_000_000_000);

/// What `klasktron` with `args` says.
pub(crate) fn klasktron(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_klasktron")).args(args).output().unwrap()
}

/// Standard output and standard error as text, and the exit status.
pub(crate) fn said(output: &Output) -> (String, String, i32) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (text(&output.stdout), text(&output.stderr), output.status.code().unwrap())
}

/// What is typed, the exit status, and what the message must hold.
pub(crate) type Mistake<'a> = (&'a [&'a str], i32, &'a str);

/// Checks that `command` refuses every mistake in one sentence and leaves no file at `out`, which is
/// given where a mistake names no other place.
pub(crate) fn check_mistakes(command: &str, out: &str, cases: &[Mistake<'_>]) {
    for (arguments, expected_status, expected) in cases {
        let mut typed = vec![command];
        typed.extend(*arguments);
        if !arguments.contains(&"-o") {
            typed.extend(["-o", out]);
        }
        let (stdout, stderr, status) = said(&klasktron(&typed));
        assert_eq!(status, *expected_status, "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
        assert!(stdout.is_empty(), "{stdout}");
        assert!(*expected_status == 2 || stderr.trim_end().lines().count() == 1, "{stderr}");
        assert!(!Path::new(out).exists(), "{arguments:?} left a file");
    }
}

/// Starts a file of the contract with its metadata.
pub(crate) fn writer(path: &Path, robot: &str) -> RecordingWriter {
    let mut writer =
        RecordingWriter::create(path, ExistingFile::Refuse, FlushPolicy::EverySecond).unwrap();
    let values = [
        ("schema_version", "1"),
        ("source", "simulation"),
        ("session", "s1"),
        ("split", "train"),
        ("robot", robot),
        ("belt_metres_per_turn", "0.04"),
    ];
    let metadata: BTreeMap<String, String> =
        values.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    writer.metadata(RECORDING_METADATA, metadata).unwrap();
    writer
}

/// A rig whose carriage follows its command after two control periods, and what to change about
/// it. Its commands are two sines that no lag turns into each other.
#[derive(Debug, Clone)]
pub(crate) struct Rig {
    /// Name in the metadata.
    pub(crate) robot: &'static str,
    /// Length (s).
    pub(crate) seconds: u64,
    /// From velocity (vx, vy) two periods ago to measured velocity: [xx, xy, yx, yy].
    pub(crate) gain: [f64; 4],
    /// Changes each message of the carriage before it is written; `None` leaves it out.
    pub(crate) carriage: fn(usize, CarriageState) -> Option<CarriageState>,
    /// Log time of period `k`.
    pub(crate) time: fn(u64) -> Nanos,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            robot: "klasktron",
            seconds: 10,
            gain: [1.0, 0.0, 0.0, 1.0],
            carriage: |_, state| Some(state),
            time: period,
        }
    }
}

/// Log time of control period `k`.
pub(crate) fn period(k: u64) -> Nanos {
    Nanos(START.0 + k * 1_000_000_000 / RATE_HZ)
}

/// Commanded velocity in control period `k` (m/s).
pub(crate) fn command(k: i64) -> VelocityCommand {
    let t = k as f64 / RATE_HZ as f64;
    VelocityCommand { vx: 0.2 * (7.0 * t).sin(), vy: 0.15 * (4.1 * t + 0.3).sin() }
}

impl Rig {
    /// Writes the recording to `name` in `dir` and gives its path.
    pub(crate) fn write(&self, dir: &Path, name: &str) -> PathBuf {
        let path = dir.join(name);
        let mut writer = writer(&path, self.robot);
        let periods = self.seconds * RATE_HZ;
        let marker = |phase: Phase| RunMarker {
            run: 1,
            pattern: "sines".into(),
            phase: phase.into(),
            split: "train".into(),
        };
        writer.write(topic::RUN_MARKER, period(0), &marker(Phase::Start)).unwrap();
        let mut state = CarriageState::default();
        for k in 0..periods {
            let u = command(k as i64 - 2);
            let [xx, xy, yx, yy] = self.gain;
            state.vx = xx * u.vx + xy * u.vy;
            state.vy = yx * u.vx + yy * u.vy;
            state.x += state.vx / RATE_HZ as f64;
            state.y += state.vy / RATE_HZ as f64;
            let now = (self.time)(k);
            writer.write(&topic::command(Player::Left), now, &command(k as i64)).unwrap();
            if let Some(state) = (self.carriage)(k as usize, state) {
                writer.write(&topic::carriage(Player::Left), now, &state).unwrap();
            }
        }
        writer.write(topic::RUN_MARKER, period(periods), &marker(Phase::End)).unwrap();
        writer.finish().unwrap();
        path
    }
}
