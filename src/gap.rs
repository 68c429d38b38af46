//! Identify effects that the simulation lacks, add them to the twin, and measure the reduction of the gap.
//!
//! # Workflow
//!
//! 1. [`checks`](check) tests the data: enough motion, in both directions, connected to the command. Physics is fitted
//!    only to data that pass.
//! 2. [`search`] fits the known parameters stage by stage ([`crate::twin::StageKind`]), so that a wrong parameter is not
//!    attributed to a missing effect. Outliers (single samples) are excluded, and so are one-off disturbances: a moment
//!    of one session that holds most of the squared residual of all ([`Incident`]).
//! 3. The screen regresses the residual on the simulated change of every effect on every axis, prewhitened, block by
//!    block. Effects are also simulated at a calibrated given twin, before a refit can absorb them.
//! 4. The best candidates are simulated again, everything fitted together, and compared in the metric of the best one's
//!    residual. An effect passes if its gain is significant after correction for all comparisons, the validation
//!    sessions confirm sign, magnitude and gain, and no parameter is on a bound. An effect that closes far more of the
//!    gap precedes a more significant one: small slow effects are the most significant. Rivals that explain the data
//!    equally well are reported as indistinguishable. Among them, the effect with the fewest parameters is added.
//! 5. The search repeats until no candidate passes. Changes of the camera noise are tested last (`noise`). An
//!    unexplained dependence of the residual is reported as `unknown.<regressor>[<band>]`.
//! 6. A searched twin stores its final residual, and the fraction that each rejected effect explains (`known`). In later
//!    recordings an effect must explain three times that fraction. An effect in addition to a larger one must exceed the
//!    model error of the larger one.
//! 7. [`find()`] writes the result into `gap.json` ([`Document`]), [`page()`] into `index.html`, [`write_tape`] into
//!    `gap.mcap`.
//!
//! # Statistics, with their sources
//!
//! - Prewhitening by autoregressive models up to order 12 (Ljung 1999, chapter 7).
//! - Evidence by blocks of 0.5 s as clusters, from the residual *after* the change in question, moderated where few
//!   blocks are active (Smyth 2004).
//! - Test of one parameter: the amplitude with which the data follow a simulated change (after Davidson and MacKinnon,
//!   Econometrica 49, 1981).
//! - Joint test of several parameters (after Rao and Scott, Annals of Statistics 12, 1984, or Hotelling's test of the
//!   blocks' correlations).
//! - Confidence intervals by the sandwich covariance of Liang and Zeger (Biometrika 73, 1986). They are widened by the
//!   variance between sessions (DerSimonian and Laird 1986), and by the difference to a fit with another weighting of
//!   the errors (after Hausman, Econometrica 46, 1978).
//! - Bonferroni correction for all pairs of effect and start that a screen tries, weighted by the size of an effect on
//!   the validation sessions (Genovese, Roeder and Wasserman, Biometrika 93, 2006).
//! - Selection between rivals by the same amplitude between two simulated changes: that of the better one must be above
//!   one half.
//! - Noise floors from measurements alone, never from a residual.
//! - Every decision threshold once, in [`Thresholds`].

mod batch;
mod calibrate_page;
mod checks;
mod compare;
mod describe;
mod direct;
mod document;
mod estimates;
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
mod magnitude;
mod memo;
mod noise;
mod nuisance;
mod numerics;
mod observer;
mod options;
mod outliers;
mod page;
mod problem;
mod round;
mod rounds;
mod screen;
mod speed_dependence;
mod tape;
#[cfg(test)]
mod test_stage;
mod thresholds;
mod unknown;
mod user_effects;
mod verdict;
mod whiten;

pub use calibrate_page::calibration_page;
pub use checks::{Objection, check};
pub use compare::{ComparedSignal, compare};
pub use estimates::ParameterEstimate;
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
pub use observer::{SearchObserver, SearchStep};
pub use options::{Context, FixedParameter, OptionError, SearchOptions};
pub use page::{page, residual_figure};
pub use problem::{Part, Point, Problem};
pub use rounds::{Added, Held, Outcome, Reason, Rejected, StageData, Task, search};
pub use screen::Candidate;
pub use tape::write_tape;
pub use thresholds::{Threshold, ThresholdValue, Thresholds};
pub use unknown::Unknown;
pub use whiten::{Filter, Filters, Layout, Row};
