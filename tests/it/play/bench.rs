//! A virtual rig on which a pilot drives.

use super::super::collect::bench::BenchOutcome;
use klasktron::{
    collect::{
        FreeStretch, HomingPolicy, Pilot, Progress, RawFrames, SessionConfig, SessionError,
        SessionOutput, SessionReport, WatchdogPolicy, Work, run_session,
    },
    ekf::FilterSettings,
    gantry::Robot,
    opponent::Scripted,
    play::{Match, Seat, label},
    recording::{ExistingFile, FlushPolicy, RecordingWriter, topic::Player},
    rig::{RigConfig, Speed, VirtualLink},
};
use std::{
    path::PathBuf,
    sync::atomic::{AtomicUsize, Ordering},
};

pub(super) struct Bench {
    pub(super) rig: RigConfig,
    pub(super) robot: Robot,
    pub(super) players: Vec<Player>,
    /// Length of the stretch (s).
    pub(super) seconds: f64,
    /// Ctrl-C is pressed so many times once half of it is done.
    pub(super) presses: usize,
    pub(super) dir: tempfile::TempDir,
}

/// A match of scripted players on the KlaskTron table.
pub(super) fn of_scripts(scripts: [Option<Scripted>; 2]) -> Match {
    let seats = scripts.map(|script| script.map(Seat::Scripted));
    Match::new(seats, &Robot::default(), &FilterSettings::default(), 1).unwrap()
}

impl Bench {
    /// A bench with this rig file, for a stretch of `seconds`.
    pub(super) fn new(rig: &str, seconds: f64) -> Self {
        Self {
            rig: RigConfig::from_json(rig).unwrap(),
            robot: Robot::default(),
            players: vec![Player::Left, Player::Right],
            seconds,
            presses: 0,
            dir: tempfile::tempdir().unwrap(),
        }
    }

    /// A rig with one fault, 4 s after arming: in the third second of the stretch.
    pub(super) fn with_fault(fault: &str, seconds: f64) -> Self {
        let rig = format!(r#"{{"faults": [{{"after_arming_s": 4.0, {fault}}}]}}"#);
        Self::new(&rig, seconds)
    }

    fn path(&self) -> PathBuf {
        self.dir.path().join("match.mcap")
    }

    /// Runs the session to its end, whatever that is.
    pub(super) fn run(&self, pilot: &mut dyn Pilot) -> BenchOutcome {
        let mut link = VirtualLink::new(self.rig.clone(), Speed::Maximum, super::START).unwrap();
        let report = self.session(&mut link, pilot);
        BenchOutcome::after(report, &mut link, &self.path())
    }

    fn session(
        &self,
        link: &mut VirtualLink,
        pilot: &mut dyn Pilot,
    ) -> Result<SessionReport, SessionError> {
        let writer =
            RecordingWriter::create(&self.path(), ExistingFile::Refuse, FlushPolicy::EverySecond)?;
        let config = SessionConfig {
            scene: None,
            players: self.players.clone(),
            rate_hz: 50.0,
            homing: HomingPolicy::Camera,
            watchdog: WatchdogPolicy::Test,
            raw: RawFrames::Omit,
            accepted_firmware: vec![],
            hold_gain_per_s: 1.0,
            metadata: [("source".to_owned(), "virtual".to_owned())].into(),
        };
        let presses = AtomicUsize::new(0);
        let mut show = |progress: &Progress<'_>| {
            if progress.run.is_some() && progress.periods / 2 < progress.periods_done {
                presses.store(self.presses, Ordering::Relaxed);
            }
        };
        let output = SessionOutput { writer: Some(writer), presses: &presses, show: &mut show };
        let stretch = FreeStretch { pilot, seconds: self.seconds, label: label() };
        run_session(link, &self.robot, &config, Work::Free(stretch), output)
    }
}
