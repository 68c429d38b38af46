//! Actuator model: a neural network fitted to recorded motion and evaluated on held-out runs.
//!
//! The model predicts the next velocity of the carriage (or the striker) from a history of commands
//! and velocities:
//!
//! ```text
//! v[k+1] = f(u[k], ..., u[k-9]; v[k], ..., v[k-9])
//! ```
//!
//! where `f` is a multi-layer perceptron with three hidden layers of 64 units (KlaskTron paper,
//! section IV-C and appendix C). Processing steps:
//!
//! 1. [`load`] reads recordings, resamples every run on a 50 Hz grid ([`resample`]) and splits
//!    whole runs, never samples, into training and held-out data.
//! 2. [`fit_all`] fits several seeds or a whole [`ablation_configs`] grid in parallel. Each
//!    finished fit is stored at once ([`Store`]).
//! 3. [`Study`] evaluates the fits on held-out runs, one step ahead and free-running
//!    ([`Evaluation`]). It compares them with the ideal actuator, a first-order-plus-dead-time
//!    model ([`Fopdt`]) and linear [`Arx`]. It also maps the [`Coverage`] of the training data.
//! 4. [`write_actuator`] and [`page()`] write the results as `actuator.mcap` and `index.html`.
//!
//! Velocities are m/s in the board frame, x and y together. Equal inputs and seeds give equal bytes
//! for any number of threads.

mod ablation;
mod baseline;
mod coverage;
mod dataset;
mod error;
mod evaluation;
mod export;
mod file;
mod fit;
mod fits;
mod layout;
mod model;
mod page;
mod run;
mod study;
mod window;

pub use ablation::{Ablation, AblationFit, Cell, HISTORIES, WIDTHS, configs as ablation_configs};
pub use baseline::{Arx, Fopdt, Ideal, Lag};
pub use coverage::{AxisCoverage, CELLS, Coverage, CoverageMask};
pub use dataset::{DataWarning, Dataset, InputFile, PlayerChoice, load};
pub use error::ActuatorError;
pub use evaluation::{Component, ErrorRow, Evaluation, HORIZONS_S};
pub use export::{WeightsFormat, export_weights};
pub use file::{
    ACTUATOR_METADATA, ONNX_ATTACHMENT, StoredActuator, read as read_actuator,
    write as write_actuator,
};
pub use fit::{Epoch, Fit, FitConfig, FitObserver, Schedule, fit};
pub use fits::{FitsObserver, Store, fit_all};
pub use layout::{AXES, Layout, LayoutKind};
pub use model::{ActuatorNetwork, VelocityModel};
pub use page::page;
pub use run::{ResampleConfig, Run, Target, resample};
pub use study::{EvaluatedFit, Study, StudyKind, Summary, Verdict, Warning, weights_name};
pub use window::{Scale, Windows};
