//! A stretch that somebody drives freely, by what the camera shows: a policy, a scripted player.

use super::leg::{Leg, RunLabel};
use crate::{
    recording::message::{BoardState, CameraDetections},
    units::Nanos,
};

/// What a session drives.
pub enum Work<'a> {
    /// Legs of a proven plan, one after the other.
    Legs(&'a [Leg]),
    /// One stretch that a pilot drives.
    Free(FreeStretch<'a>),
}

/// A stretch that a pilot drives, from the home points on. Needs a camera.
pub struct FreeStretch<'a> {
    /// Who drives.
    pub pilot: &'a mut dyn Pilot,
    /// Its length (s).
    pub seconds: f64,
    /// What its markers say.
    pub label: RunLabel,
}

/// Where a carriage is by its encoders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carriage {
    /// Board frame (m).
    pub position: [f64; 2],
    /// Board frame (m/s).
    pub velocity: [f64; 2],
}

/// What is known at a decision, besides the pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Time of the link.
    pub now: Nanos,
    /// Number of the control period since the stretch began; those that were left out count.
    pub step: u64,
    /// By player, left first; `None` where a carriage is not driven.
    pub carriages: [Option<Carriage>; 2],
}

/// What a pilot wants.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decision {
    /// By player, left first (m/s, board frame); not used for players who are not driven.
    pub velocities: [[f64; 2]; 2],
    /// What it takes the board to be now, for the recording (`/board/state`).
    pub belief: Option<BoardState>,
}

/// Drives carriages freely. What it wants passes the same limits as every other command: of speed, of
/// slew, and never faster towards an edge than the carriage can stop.
pub trait Pilot {
    /// A picture that shows the board at `shown`, as far as that is known: else when it arrived. Pictures
    /// come in the order of their arrival.
    fn see(&mut self, shown: Nanos, picture: &CameraDetections);

    /// What to do in this control period. A velocity that is not finite ends the session.
    fn decide(&mut self, moment: &Moment) -> Decision;
}

impl Work<'_> {
    /// Runs that will be marked.
    pub(super) fn runs(&self) -> usize {
        match self {
            Self::Legs(legs) => legs.iter().filter(|leg| leg.run.is_some()).count(),
            Self::Free(_) => 1,
        }
    }

    /// Control periods in all at `rate_hz`.
    pub(super) fn periods(&self, rate_hz: f64) -> usize {
        match self {
            Self::Legs(legs) => legs.iter().map(Leg::periods).sum(),
            Self::Free(stretch) => stretch.periods(rate_hz),
        }
    }
}

impl FreeStretch<'_> {
    /// Its length in control periods.
    pub(super) fn periods(&self, rate_hz: f64) -> usize {
        (self.seconds * rate_hz).round() as usize
    }
}
