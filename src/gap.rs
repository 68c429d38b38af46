//! Find where the simulation and the measured data disagree, name what is missing, add it, and show
//! the gap shrink.
//!
//! # The way of the data
//!
//! 1. [`checks`](check): is there enough motion, both ways, and does it follow the command? Only then
//!    physics.
//! 2. Link by link ([`crate::twin::StageKind`]), [`search`] fits what the twin already has, so that bad
//!    tuning is not blamed on structure. Single samples that stand off are left out, and a moment of one session
//!    that holds most of the squared residual of all ([`Incident`]).
//! 3. The screen switches every effect of the catalogue on, on every axis, and regresses what is left on
//!    the change of the simulation, prewhitened, block by block. Where the given twin is a calibrated one,
//!    effects are also simulated on it as it was, before a refit could absorb them.
//! 4. The best are simulated again, everything fitted together, and compared in the metric of the best
//!    one's residual. One is named when its gain is beyond chance for all tries, when the held-out
//!    session follows it in sign and size and gains by it, and no number stands on a bound. One that closes
//!    far more of the gap itself comes before one that shows more clearly: small slow effects are the clearest.
//!    Rivals that explain the data as well are its class; of equals the one with the fewest numbers is added.
//! 5. Then again, until nothing passes; last, what changes the scatter of the camera and no value
//!    (`scatter`). What is left and still depends on something gets a name of its own:
//!    `unknown.<regressor>[<band>]`.
//!    A searched twin notes what it leaves and what each effect explains of that though it is not there
//!    (`known`): in later recordings an effect must explain three times as much, and one that stands beside
//!    a larger one must be more than the larger one's model is wrong.
//! 6. [`find()`] puts it into `gap.json` ([`Document`]), [`page()`] into `index.html`, [`write_tape`] into
//!    `gap.mcap`.
//!
//! # Statistics, with their sources
//!
//! - Prewhitening by autoregressive models up to order 12 (Ljung 1999, chapter 7).
//! - Evidence by blocks of 0.5 s as clusters, from what is left *after* the change in question, moderated
//!   where few blocks are active (Smyth 2004): the amplitude with which the data follow a simulated change
//!   (after Davidson and MacKinnon, Econometrica 49, 1981), and a joint test of several numbers (after Rao
//!   and Scott, Annals of Statistics 12, 1984, or Hotelling's of the blocks' correlations).
//! - Intervals by the sandwich covariance of Liang and Zeger (Biometrika 73, 1986), widened by what sessions
//!   differ in beyond their scatter (DerSimonian and Laird 1986), and by what a fit with errors weighed
//!   otherwise differs in beyond it (after Hausman, Econometrica 46, 1978).
//! - Bonferroni's correction for all pairs of effect and start that a screen tries.
//! - Rivals by the same amplitude between two simulated changes: the better one's must be above one half.
//! - The noise floor from measurements alone, never from a residual.
//! - Every threshold of a decision once, in [`Thresholds`].

mod batch;
mod calibrate_page;
mod checks;
mod compare;
mod describe;
mod direct;
mod document;
mod evidence;
mod experiment;
mod explain;
mod find;
mod findings;
mod fit;
mod floor;
mod incident;
mod isolability;
mod journal;
mod known;
mod locate;
mod memo;
mod nuisance;
mod numbers;
mod numerics;
mod observer;
mod options;
mod outliers;
mod page;
mod problem;
mod round;
mod rounds;
mod scatter;
mod screen;
mod steady;
mod tape;
mod thresholds;
mod unknown;
mod user_effects;
mod verdict;
mod whiten;

pub use calibrate_page::calibration_page;
pub use checks::{Objection, check};
pub use compare::{ComparedSignal, compare};
pub use evidence::LogScoreGain;
pub use explain::significant;
pub use find::{Found, find};
pub use findings::{
    Description, DescriptionScale, DescriptionTerm, Document, Evidence, IdentifiedEffect,
    IdentifiedParameter, Indistinguishable, Localization, NextExperiment, ParameterChange,
    RejectedEffect, SignalResidual, Verdict,
};
pub use fit::{Fit, Uncertainty};
pub use floor::{Floor, FloorSource};
pub use incident::Incident;
pub use isolability::{
    Confusion, Isolability, SignalShare, Signature, StageIsolability, isolability,
};
pub use journal::{JournalEntry, Move, MoveComparison, MoveKind};
pub use numbers::ParameterEstimate;
pub use observer::{SearchObserver, SearchStep};
pub use options::{Context, FixedParameter, OptionError, SearchOptions};
pub use page::{page, residual_figure};
pub use problem::{Part, Point, Problem};
pub use rounds::{Added, Held, Link, Outcome, Reason, Rejected, Task, search};
pub use screen::Candidate;
pub use tape::write_tape;
pub use thresholds::{Threshold, ThresholdValue, Thresholds};
pub use unknown::Unknown;
pub use whiten::{Filter, Filters, Layout, Row};
