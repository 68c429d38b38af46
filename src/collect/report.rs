//! What a session tells: to the person while it runs, and as a document when it is over.

use super::{control::Lateness, leg::RunLabel, preflight::Census, reason::StopReason};
use crate::{stats::quantile, units::Nanos};
use serde::Serialize;
use std::collections::BTreeMap;

/// What the person sees while it runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress<'a> {
    /// The run at hand; `None` before, between and after runs.
    pub run: Option<&'a RunLabel>,
    /// Runs that are done.
    pub runs_done: usize,
    /// Runs in all.
    pub runs: usize,
    /// Control periods done, of [`periods`](Self::periods).
    pub periods_done: usize,
    /// Control periods in all.
    pub periods: usize,
    /// Frames that came in since the last view (1/s).
    pub frames_per_s: f64,
    /// Pictures that came in since the last view (1/s).
    pub pictures_per_s: f64,
    /// Faults of the bus and setpoints that it did not take.
    pub errors: u64,
    /// Largest distance from the reference so far (m).
    pub worst_tracking: f64,
    /// Time of the link.
    pub now: Nanos,
}

/// From the time at which the newest picture shows the board to the moment when the command was sent. Where
/// the camera's clock is not the host's, from its arrival.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PictureToCommand {
    /// Median (ms).
    pub median_ms: f64,
    /// 99th percentile (ms).
    pub p99_ms: f64,
}

impl PictureToCommand {
    /// Of the time before every command (ms); `None` without any.
    pub(super) fn of(waits_ms: &[f64]) -> Option<Self> {
        let at = |share| quantile(waits_ms, share);
        Some(Self { median_ms: at(0.5)?, p99_ms: at(0.99)? })
    }
}

/// How a session went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionReport {
    /// Version of this document.
    pub schema_version: &'static str,
    /// Why it ended: a name, stable between versions.
    pub stop: &'static str,
    /// The same as a sentence.
    pub stop_text: String,
    /// Runs in the plan.
    pub runs_planned: usize,
    /// Runs that were done to their end.
    pub runs_done: usize,
    /// Samples of the runs that were done, or decisions of a pilot, for each player.
    pub samples: usize,
    /// From the first look to the last heartbeat (s).
    pub duration_s: f64,
    /// Nodes that have not confirmed that they are off.
    pub not_confirmed_off: Vec<u8>,
    /// What the first look has found.
    pub census: Census,
    /// How late the control periods were.
    pub lateness: Lateness,
    /// How old the newest picture was when each command of a pilot was sent; absent without a pilot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture_to_command: Option<PictureToCommand>,
    /// Largest distance of a carriage from its reference (m).
    pub worst_tracking_m: f64,
    /// Frames received.
    pub frames_received: u64,
    /// Frames sent.
    pub frames_sent: u64,
    /// Pictures of the camera.
    pub pictures: u64,
    /// Datagrams of the camera that were not understood.
    pub pictures_refused: u64,
    /// Setpoints that the bus did not take in time; they were dropped.
    pub setpoints_dropped: u64,
    /// Faults of the bus by kind.
    pub bus_faults: BTreeMap<String, u64>,
    /// What the recording lacks.
    pub losses: Vec<String>,
    /// What was doubtful.
    pub warnings: Vec<String>,
}

impl SessionReport {
    /// Whether everything that was planned is in the recording.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.stop == StopReason::Completed.code()
            && self.not_confirmed_off.is_empty()
            && self.losses.is_empty()
    }
}
