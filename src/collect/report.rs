//! Progress of a session for the live view, and its report as a document.

use super::{
    control::LoopTiming, leg::RunLabel, preflight::BusState, reason::StopReason, traffic::Traffic,
};
use crate::{stats::quantile, units::Nanos};
use serde::Serialize;
use std::collections::BTreeMap;

/// Progress of a running session.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress<'a> {
    /// Current run; `None` before, between and after runs.
    pub run: Option<&'a RunLabel>,
    /// Number of completed runs.
    pub runs_done: usize,
    /// Total number of runs.
    pub runs: usize,
    /// Control periods done, of [`periods`](Self::periods).
    pub periods_done: usize,
    /// Total number of control periods.
    pub periods: usize,
    /// Rate of received frames since the last view (1/s).
    pub frames_per_s: f64,
    /// Rate of camera frames since the last view (1/s).
    pub camera_frames_per_s: f64,
    /// Number of bus faults and dropped setpoints.
    pub errors: u64,
    /// Largest distance from the reference so far (m).
    pub worst_tracking: f64,
    /// Time of the link.
    pub now: Nanos,
}

/// Image-to-command latency: from the capture time of the newest camera frame to the command. With
/// a camera clock other than the host's, it starts at the arrival of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImageToCommand {
    /// Median (ms).
    pub median_ms: f64,
    /// 99th percentile (ms).
    pub p99_ms: f64,
}

impl ImageToCommand {
    /// Summarize the latencies of all commands (ms); `None` for an empty list.
    pub(super) fn of(waits_ms: &[f64]) -> Option<Self> {
        let at = |probability| quantile(waits_ms, probability);
        Some(Self { median_ms: at(0.5)?, p99_ms: at(0.99)? })
    }
}

/// Report of a session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionReport {
    /// Version of this document, 2.
    pub schema_version: u32,
    /// Stop reason: a name, stable between versions.
    pub stop: &'static str,
    /// Stop reason as a sentence.
    pub stop_text: String,
    /// Number of planned runs.
    pub runs_planned: usize,
    /// Number of completed runs.
    pub runs_done: usize,
    /// Number of samples of completed runs, or decisions of a pilot, for each player.
    pub samples: usize,
    /// Duration from the preflight check to the last heartbeat (s).
    pub duration_s: f64,
    /// Nodes not confirmed as disarmed.
    pub not_confirmed_off: Vec<u8>,
    /// State of the bus before arming.
    pub bus: BusState,
    /// Traffic of the whole session: messages of each node, camera frames.
    pub traffic: Traffic,
    /// Timing of the control loop.
    pub control_loop: LoopTiming,
    /// Image-to-command latency of a pilot; absent without a pilot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_to_command: Option<ImageToCommand>,
    /// Largest distance of a carriage from its reference (m).
    pub worst_tracking_m: f64,
    /// Number of received frames.
    pub frames_received: u64,
    /// Number of sent frames.
    pub frames_sent: u64,
    /// Number of camera frames.
    pub camera_frames: u64,
    /// Number of camera datagrams that could not be decoded.
    pub camera_frames_rejected: u64,
    /// Number of setpoints dropped because the bus did not take them in time.
    pub setpoints_dropped: u64,
    /// Number of bus faults by kind.
    pub bus_faults: BTreeMap<String, u64>,
    /// Losses in the recording.
    pub losses: Vec<String>,
    /// Warnings about the session.
    pub warnings: Vec<String>,
}

impl SessionReport {
    /// Return whether the recording has everything that was planned.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.stop == StopReason::Completed.code()
            && self.not_confirmed_off.is_empty()
            && self.losses.is_empty()
    }
}
