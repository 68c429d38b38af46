//! A virtual rig with a session on it: both carriages on a circle for 8 s. The circle is computed
//! here, so that the planner is no part of these tests.

use klasktron::{
    collect::{
        HomingPolicy, Leg, Progress, RawFrames, RunLabel, SessionConfig, SessionError,
        SessionOutput, SessionReport, WatchdogPolicy, Work, listen, run_session,
    },
    gantry::{Reference, Robot},
    link::Link,
    recording::{ExistingFile, FlushPolicy, Recording, RecordingWriter, topic::Player},
    rig::{RigConfig, Speed, Truth, VirtualLink},
    units::Nanos,
};
use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

pub(crate) const START: Nanos = Nanos(1_700_000_000_000_000_000);
const RATE_HZ: f64 = 50.0;
const PERIODS: usize = 400;
/// Radius (m) and time of a turn (s): 0.126 m/s.
const RADIUS: f64 = 0.04;
const TURN_SECONDS: f64 = 2.0;
/// A carriage slower than this stands (m/s).
pub(crate) const STANDING: f64 = 0.005;
/// A disarmed drive coasts against friction alone (s).
const COAST_SECONDS: f64 = 3.0;

pub(crate) struct Bench {
    pub(crate) rig: RigConfig,
    pub(crate) robot: Robot,
    pub(crate) players: Vec<Player>,
    pub(crate) accepted_firmware: Vec<String>,
    /// Ctrl-C is pressed so many times once half of the run is done.
    pub(crate) presses: usize,
    /// The session panics once half of the run is done.
    pub(crate) panics: bool,
    pub(crate) dir: tempfile::TempDir,
}

pub(crate) struct BenchOutcome {
    pub(crate) report: Result<SessionReport, SessionError>,
    pub(crate) truth: Truth,
    pub(crate) recording: Option<Recording>,
    /// The last moment after the session at which a carriage really moved.
    pub(crate) moved_until: Option<Nanos>,
}

/// Starts and ends at rest in `centre`: first along x, then the circle with a soft start.
fn circle(centre: [f64; 2]) -> Reference {
    let angle = |k: usize| {
        let u = k as f64 / PERIODS as f64;
        let turns = PERIODS as f64 / RATE_HZ / TURN_SECONDS;
        2.0 * std::f64::consts::PI * turns * (u * u * (3.0 - 2.0 * u))
    };
    let place = |k: usize| {
        let phi = angle(k);
        [centre[0] + RADIUS * (phi.cos() - 1.0), centre[1] + RADIUS * phi.sin()]
    };
    let velocity = |k: usize| {
        let [here, next] = [place(k), place(k + 1)];
        [0, 1].map(|axis| (next[axis] - here[axis]) * RATE_HZ)
    };
    let velocities: Vec<[f64; 2]> = (0..PERIODS).map(velocity).collect();
    Reference::from_velocities(place(0), &velocities, RATE_HZ).unwrap()
}

impl Bench {
    /// A bench with this rig file.
    pub(crate) fn new(rig: &str) -> Self {
        Self {
            rig: RigConfig::from_json(rig).unwrap(),
            robot: Robot::default(),
            players: vec![Player::Left, Player::Right],
            accepted_firmware: vec![],
            presses: 0,
            panics: false,
            dir: tempfile::tempdir().unwrap(),
        }
    }

    /// A rig with one fault, in the middle of the run.
    pub(crate) fn with_fault(fault: &str) -> Self {
        Self::new(&format!(r#"{{"faults": [{{"after_arming_s": 6.0, {fault}}}]}}"#))
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.dir.path().join("session.mcap")
    }

    fn legs(&self) -> Vec<Leg> {
        let home = |player: &Player| {
            let home = self.robot.home.of(*player);
            [home.x_m, home.y_m]
        };
        let references = self.players.iter().map(|p| (*p, circle(home(p)))).collect();
        let (pattern, split) = ("circle".to_owned(), "train".to_owned());
        vec![Leg { run: Some(RunLabel { number: 1, pattern, split }), references }]
    }

    /// Runs the session to its end, whatever that is.
    pub(crate) fn run(&self) -> BenchOutcome {
        let mut link = VirtualLink::new(self.rig.clone(), Speed::Maximum, START).unwrap();
        let report = self.session(&mut link);
        BenchOutcome::after(report, &mut link, &self.path())
    }

    /// Records the rig for `seconds` without sending.
    pub(crate) fn listen(&self, seconds: f64) -> SessionReport {
        let mut link = VirtualLink::new(self.rig.clone(), Speed::Maximum, START).unwrap();
        let (existing, flush) = (ExistingFile::Refuse, FlushPolicy::EverySecond);
        let writer = RecordingWriter::create(&self.path(), existing, flush).unwrap();
        let presses = AtomicUsize::new(0);
        let output = SessionOutput { writer: Some(writer), presses: &presses, show: &mut |_| {} };
        listen(&mut link, &self.robot, &self.config(), seconds, output).unwrap()
    }

    fn config(&self) -> SessionConfig {
        SessionConfig {
            scene: None,
            players: self.players.clone(),
            rate_hz: RATE_HZ,
            homing: HomingPolicy::Camera,
            watchdog: WatchdogPolicy::Test,
            raw: RawFrames::Record,
            accepted_firmware: self.accepted_firmware.clone(),
            hold_gain_per_s: 0.5,
            metadata: std::iter::once(("source".to_owned(), "virtual".to_owned())).collect(),
        }
    }

    /// Runs the session on a rig of the caller's.
    pub(crate) fn session(&self, link: &mut VirtualLink) -> Result<SessionReport, SessionError> {
        let writer =
            RecordingWriter::create(&self.path(), ExistingFile::Refuse, FlushPolicy::EverySecond)?;
        let config = self.config();
        let presses = AtomicUsize::new(0);
        let mut show = |progress: &Progress<'_>| {
            if progress.run.is_some() && 4.0 < progress.now.seconds_since(START) - 3.0 {
                presses.store(self.presses, Ordering::Relaxed);
                assert!(!self.panics, "a bug in the middle of a run");
            }
        };
        let output = SessionOutput { writer: Some(writer), presses: &presses, show: &mut show };
        run_session(link, &self.robot, &config, Work::Legs(&self.legs()), output)
    }
}

impl BenchOutcome {
    /// What a session has left: its report, the file at `path`, and the rig once everything is at rest.
    pub(crate) fn after(
        report: Result<SessionReport, SessionError>,
        link: &mut VirtualLink,
        path: &Path,
    ) -> Self {
        let recording = path.exists().then(|| Recording::open(path).unwrap());
        // Whatever still moves may come to rest, as it would on a table.
        let until = link.now().after_seconds(COAST_SECONDS);
        let mut moved_until = None;
        while link.now() < until {
            let soon = link.now().after_seconds(0.005);
            while link.next_event(soon).is_ok_and(|event| event.is_some()) {}
            let truth = link.truth();
            if [truth.left, truth.right].iter().any(|p| STANDING < p.carriage.speed()) {
                moved_until = Some(link.now());
            }
        }
        Self { report, truth: link.truth(), recording, moved_until }
    }

    /// Every drive of the rig has left closed loop.
    pub(crate) fn all_idle(&self) {
        for drive in &self.truth.drives {
            assert_ne!(drive.state.number(), 8, "node {} is still on", drive.node);
        }
    }

    /// Nothing moves.
    pub(crate) fn all_still(&self) {
        for player in [&self.truth.left, &self.truth.right] {
            let speed = player.carriage.vx.hypot(player.carriage.vy);
            assert!(speed < 1e-3, "a carriage moves at {speed} m/s");
        }
    }
}

/// Log times and messages of a topic.
pub(crate) fn series<M: prost::Message + prost::Name + Default>(
    recording: &Recording,
    topic: &str,
) -> Vec<(Nanos, M)> {
    if !recording.channels.iter().any(|channel| channel.topic == topic) {
        return Vec::new();
    }
    let series = recording.series::<M>(topic).unwrap();
    series.times.iter().copied().zip(series.values).collect()
}
