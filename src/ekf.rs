//! State estimation: an extended Kalman filter (EKF) for ball and strikers, tuned on recordings.
//!
//! # Filter
//!
//! State s = (x, y, vx, vy) of each object in the board frame (m, m/s), as in section IV-A of the
//! KlaskTron paper. Transition over one frame interval dt:
//!
//! - **Rolling.** v' = v (1 - b dt - c dt / (|v| + v0)), p' = p + (v + v') dt/2, with its Jacobian
//!   F. c is rolling resistance, b drag, v0 = 0.02 m/s; strikers have b = c = 0.
//! - **Process noise.** White acceleration of spectral density q (m2/s3) in each axis. Covariance:
//!   P' = F P F' + Q with Q = q \[\[dt^3/3, dt^2/2\], \[dt^2/2, dt\]\]. With the constant-velocity F,
//!   two half steps equal one full step. q is the value of the open board plus that of each
//!   [`Region`] on the predicted path. Regions are near a wall (across it), near a striker, and
//!   over a goal and its rim (figure 4 of the paper).
//! - **Walls.** A prediction beyond a wall is reflected with restitution e. The standard deviations
//!   of e and of the tangential velocity change enter as noise. Within the width of the estimate it
//!   is uncertain whether the ball has reached the wall. There the two truncated halves of the
//!   normal distribution are propagated separately and merged by their moments (section 1.4.16 of
//!   Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
//!   2001). A plain Jacobian would give a wrong sign with high certainty there.
//! - **Measurements.** z = p + noise of covariance R, at capture time. R is k C where the detection
//!   carries its covariance C, with `covariance_scale` k, and otherwise r I with r the square of
//!   `measurement_sigma_m`. A detection whose
//!   normalized innovation squared exceeds the chi-square quantile of the gate is rejected. Two
//!   consecutive rejected detections that one motion explains reinitialize the track. After 0.25 s
//!   without an accepted detection the track is lost.
//!
//! [`BoardFilter`] keeps 32 frames, so that a late frame is inserted in time order.
//! [`BoardFilter::estimate_at`] predicts over the latency. Nothing allocates after
//! [`BoardFilter::new`].
//!
//! # Tuning
//!
//! [`tune_recordings`] maximizes the innovation likelihood on the training runs ([`tune()`]). On
//! validation runs it checks NIS, and NEES where a simulator wrote `/truth/board/state`
//! ([`evaluate()`]), and compares with the platform's own filter, [`UpstreamFilter`]. The result is
//! [`Document`], `ekf.json`, which [`read_settings`] reads back.
//!
//! # Limits
//!
//! The impact on a striker is process noise of its region, not a transition, because its normal
//! changes within a frame. Spin, attraction by the magnets and slope of the board are process noise
//! as well.
//!
//! ```
//! use klasktron::ekf::{BoardFilter, FilterSettings, Object, Detections};
//! use klasktron::units::Nanos;
//!
//! let settings = FilterSettings::default();
//! let mut filter = BoardFilter::new(&settings);
//! for frame in 0..60_u64 {
//!     let time = Nanos(frame * 1_000_000_000 / 120);
//!     let x = 0.5 * frame as f64 / 120.0 - 0.12;
//!     filter.observe(&Detections::new(time, [Some([x, 0.0]), None, None]));
//! }
//! let newest = filter.newest().unwrap();
//! let ahead = filter.estimate_at(Object::Ball, newest.after_seconds(0.02)).unwrap();
//! assert!((ahead.mean[2] - 0.5).abs() < 0.02);
//! ```

mod data;
mod document;
mod error;
mod evaluate;
mod filter;
mod matrix;
mod motion;
mod output;
mod page;
mod region;
mod rise;
mod settings;
mod slope;
#[cfg(test)]
mod tests;
mod track;
mod tune;
mod upstream;

pub use data::{Data, Frame, FrameRun, TRUTH_TOPIC};
pub use document::{
    Amount, Document, Input, SCHEMA_VERSION, Tuned, read_settings, tune_recordings,
    tune_recordings_observed,
};
pub use error::EkfError;
pub use evaluate::{
    Ahead, Consistency, ConsistencyVerdict, EvaluatedFrame, EvaluatedRun, LONGEST_LAG,
    ObjectEvaluation, RegionEvaluation, Whiteness, evaluate, follow,
};
pub use filter::{Gate, Innovation, Measurement, ObjectFilter};
pub use matrix::Matrix4;
pub use motion::Estimate;
pub use output::{UPSTREAM_TOPIC, board_state, write_recording};
pub use page::page;
pub use region::{Region, Strikers, region_at};
pub use rise::{Hit, LONGEST_FRAMES, Response, Rise, RiseTimes, responses, rises};
pub use settings::{BallSettings, BoardSettings, FilterSettings, Object, ObjectSettings};
pub use slope::{Impact, impacts, velocities};
pub use track::{
    BoardFilter, Detections, LOST_AFTER_S, LastFrame, Observed, REMEMBERED_FRAMES, Step, Track,
};
pub use tune::{LEAST_SAMPLES, LEAST_VISITS, RegionTuning, TuneObserver, Tuning, tune};
pub use upstream::UpstreamFilter;
