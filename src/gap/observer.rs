//! Progress of a search, for a display.

use crate::twin::StageKind;
use std::fmt;

/// Step of the search on one stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchStep {
    /// Known parameters are fitted.
    Fit,
    /// Effects of the catalogue are screened.
    Screen,
    /// The best candidates are simulated and fitted.
    Trial,
}

impl fmt::Display for SearchStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fit => "fitting known parameters",
            Self::Screen => "screening candidates",
            Self::Trial => "fitting candidates",
        })
    }
}

/// Observer of a search. It cannot change the result; calls come from several threads.
pub trait SearchObserver: Sync {
    /// A stage of the chain begins; `done` of `count` stages are complete.
    fn stage_begun(&self, _kind: StageKind, _done: usize, _count: usize) {}

    /// A step of the current stage begins, with this number of candidates.
    fn step_begun(&self, _step: SearchStep, _candidates: usize) {}

    /// One candidate of the current step is complete.
    fn candidate_done(&self) {}
}

/// Observer that shows nothing.
pub(super) struct Silent;

/// The only [`Silent`].
pub(super) static SILENT: Silent = Silent;

impl SearchObserver for Silent {}
