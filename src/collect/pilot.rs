//! Free runs, driven by a pilot from camera frames: a policy or a scripted player.

use super::{
    leg::{Leg, RunLabel},
    reason::StopReason,
};
use crate::{
    recording::message::{BoardState, CameraDetections},
    units::Nanos,
};

/// Motion of a session.
pub enum Work<'a> {
    /// Legs of a checked plan, one after the other.
    Legs(&'a [Leg]),
    /// One free run of a pilot.
    Free(FreeStretch<'a>),
}

/// Free run of a pilot, starting at the home points. Requires a camera.
pub struct FreeStretch<'a> {
    /// Pilot.
    pub pilot: &'a mut dyn Pilot,
    /// Duration (s).
    pub seconds: f64,
    /// Content of the run markers.
    pub label: RunLabel,
}

/// Carriage state from its encoders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carriage {
    /// Position in the board frame (m).
    pub position: [f64; 2],
    /// Velocity in the board frame (m/s).
    pub velocity: [f64; 2],
}

/// State at a decision, apart from the camera frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Time of the link.
    pub now: Nanos,
    /// Number of the control period since the start; missed periods count.
    pub step: u64,
    /// Carriages by player, left first; `None` where a carriage is not driven.
    pub carriages: [Option<Carriage>; 2],
}

/// Decision of a pilot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decision {
    /// Velocities by player, left first (m/s, board frame); ignored for players who are not driven.
    pub velocities: [[f64; 2]; 2],
    /// Estimated board state, for the recording (`/board/state`).
    pub belief: Option<BoardState>,
    /// Reason to end the session.
    pub stop: Option<StopReason>,
    /// Text for the recording (`/collect/event`, kind `match`).
    pub note: Option<String>,
    /// True if the run is complete before its time.
    pub complete: bool,
}

/// Driver of carriages in a free run. Its commands pass the same limits as every other command:
/// speed, slew, and never faster towards an edge than the carriage can stop.
pub trait Pilot {
    /// Take a camera frame that shows the board at `shown`: the capture time if known, else the
    /// time of arrival. Frames come in the order of their arrival.
    fn see(&mut self, shown: Nanos, picture: &CameraDetections);

    /// Decide the command of this control period. A non-finite velocity ends the session.
    fn decide(&mut self, moment: &Moment) -> Decision;
}

impl Work<'_> {
    /// Return the number of marked runs.
    pub(super) fn runs(&self) -> usize {
        match self {
            Self::Legs(legs) => legs.iter().filter(|leg| leg.run.is_some()).count(),
            Self::Free(_) => 1,
        }
    }

    /// Return the total number of control periods at `rate_hz`.
    pub(super) fn periods(&self, rate_hz: f64) -> usize {
        match self {
            Self::Legs(legs) => legs.iter().map(Leg::periods).sum(),
            Self::Free(stretch) => stretch.periods(rate_hz),
        }
    }
}

impl FreeStretch<'_> {
    /// Return the length in control periods.
    pub(super) fn periods(&self, rate_hz: f64) -> usize {
        (self.seconds * rate_hz).round() as usize
    }
}
