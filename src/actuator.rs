//! The actuator model: from recorded motion to a network that predicts it, judged honestly.
//!
//! The model answers the next velocity of the carriage (or the striker) from a history of
//! commands and velocities,
//!
//! ```text
//! v[k+1] = f(u[k], ..., u[k-9]; v[k], ..., v[k-9])
//! ```
//!
//! with `f` a multi-layer perceptron of three hidden layers of 64 (KlaskTron paper, section IV-C
//! and appendix C). The way of the data:
//!
//! 1. [`load`] reads recordings, puts every run on a 50 Hz grid ([`resample`]) and divides the
//!    runs, never the samples, into those that are fitted and those that judge.
//! 2. [`fit_all`] fits seeds or a whole [`ablation_configs`] grid in parallel, and keeps each fit
//!    as soon as it is finished ([`Store`]).
//! 3. [`Study`] judges the fits beside the ideal actuator, a lag with delay ([`LagDelay`]) and
//!    linear [`Arx`], one step ahead and free-running ([`Judgement`]), and draws the [`Coverage`]
//!    of the training data.
//! 4. [`write_actuator`] and [`page()`] make `actuator.mcap` and `index.html` of it.
//!
//! Velocities are m/s in the board frame, x and y together. Equal inputs and seeds give equal
//! bytes, whatever the number of threads.

mod ablation;
mod baseline;
mod coverage;
mod dataset;
mod error;
mod export;
mod file;
mod fit;
mod fits;
mod judge;
mod layout;
mod model;
mod page;
mod run;
mod study;
mod window;

pub use ablation::{Ablation, AblationFit, Cell, HISTORIES, WIDTHS, configs as ablation_configs};
pub use baseline::{Arx, Ideal, Lag, LagDelay};
pub use coverage::{AxisCoverage, CELLS, Coverage, CoverageMask};
pub use dataset::{DataWarning, Dataset, InputFile, PlayerChoice, load};
pub use error::ActuatorError;
pub use export::{WeightsFormat, export_weights};
pub use file::{
    ACTUATOR_METADATA, ONNX_ATTACHMENT, StoredActuator, read as read_actuator,
    write as write_actuator,
};
pub use fit::{Epoch, Fit, FitConfig, FitObserver, Schedule, fit};
pub use fits::{FitsObserver, Store, fit_all};
pub use judge::{Component, ErrorRow, HORIZONS_S, Judgement};
pub use layout::{AXES, Layout, LayoutKind};
pub use model::{ActuatorNetwork, VelocityModel};
pub use page::page;
pub use run::{ResampleConfig, Run, Target, resample};
pub use study::{Judged, Study, StudyKind, Summary, Verdict, Warning, weights_name};
pub use window::{Scale, Windows};
