//! The state estimate: an extended Kalman filter for ball and strikers, tuned on recordings.
//!
//! # Filter
//!
//! State s = (x, y, vx, vy) of each object in the board frame (m, m/s), as in section IV-A of the
//! KlaskTron paper. From frame to frame, dt apart:
//!
//! - **Rolling.** v' = v (1 - b dt - c dt / (|v| + v0)), p' = p + (v + v') dt/2, with its Jacobian
//!   F. c is rolling resistance, b drag, v0 = 0.02 m/s; strikers have b = c = 0.
//! - **Noise.** White acceleration of density q (m2/s3) in each axis, P' = F P F' + Q with
//!   Q = q \[\[dt^3/3, dt^2/2\], \[dt^2/2, dt\]\]. Two half steps make one step, exactly where F is
//!   that of constant velocity. q is that of the open board, plus that of each [`Region`] that the
//!   predicted path touches: near a wall (across it), near a striker, over a goal and its rim (figure
//!   4 of the paper).
//! - **Walls.** What lies beyond a wall is reflected about it with restitution e, with the scatter of
//!   e and of the motion along the wall as noise. Whether the wall has been reached is uncertain within
//!   the width of the belief; there the truncated halves of the normal distribution are moved each in
//!   its way and put together again by their moments (section 1.4.16 of Bar-Shalom, Li and
//!   Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, has the moments of
//!   mixtures). A plain Jacobian would be certain of the wrong sign there.
//! - **Detections** z = p + noise of variance r in each axis, at their capture time. One whose squared
//!   innovation over its covariance exceeds the chi-square quantile of the gate is refused; two such
//!   in a row that one motion explains start the object anew. After 0.25 s unseen it is lost.
//!
//! [`BoardFilter`] remembers 32 frames, so that a late one is put where it belongs;
//! [`BoardFilter::estimate_at`] moves the estimate ahead by the latency. Nothing allocates after
//! [`BoardFilter::new`].
//!
//! # Tuning
//!
//! [`tune_recordings`] maximises the innovation likelihood on the train runs ([`tune()`]), checks NIS and,
//! where a simulator wrote `/truth/board/state`, NEES on held-out runs ([`judge()`]), and compares with
//! [`UpstreamFilter`], the platform's own. The result is [`Document`], `ekf.json`, which
//! [`read_settings`] reads back.
//!
//! # Left out
//!
//! The bounce off a striker is noise of its region, not a transition: its normal changes within a
//! frame. Spin, the magnets' pull on the ball, and slopes of the board are noise as well.
//!
//! ```
//! use klasktron::ekf::{BoardFilter, FilterSettings, Object, Seen};
//! use klasktron::units::Nanos;
//!
//! let settings = FilterSettings::default();
//! let mut filter = BoardFilter::new(&settings);
//! for frame in 0..60_u64 {
//!     let time = Nanos(frame * 1_000_000_000 / 120);
//!     let x = 0.5 * frame as f64 / 120.0 - 0.12;
//!     filter.observe(&Seen { time, places: [Some([x, 0.0]), None, None] });
//! }
//! let newest = filter.newest().unwrap();
//! let ahead = filter.estimate_at(Object::Ball, newest.after_seconds(0.02)).unwrap();
//! assert!((ahead.mean[2] - 0.5).abs() < 0.02);
//! ```

mod data;
mod document;
mod error;
mod filter;
mod judge;
mod matrix;
mod motion;
mod page;
mod region;
mod rise;
mod settings;
mod slope;
mod tape;
#[cfg(test)]
mod tests;
mod track;
mod tune;
mod upstream;

pub use data::{Data, Frame, FrameRun, TRUTH_TOPIC};
pub use document::{
    Amount, Document, Input, SCHEMA_VERSION, Tuned, read_settings, tune_recordings,
};
pub use error::EkfError;
pub use filter::{Gate, Innovation, ObjectFilter};
pub use judge::{
    Ahead, Consistency, JudgedFrame, JudgedRun, LONGEST_LAG, ObjectJudgement, RegionJudgement,
    Whiteness, follow, judge,
};
pub use matrix::Matrix4;
pub use motion::Estimate;
pub use page::page;
pub use region::{Region, Strikers, region_at};
pub use rise::{Hit, LONGEST_FRAMES, Response, Rise, RiseJudgement, responses, rises};
pub use settings::{BallSettings, BoardSettings, FilterSettings, Object, ObjectSettings};
pub use slope::{Impact, impacts, velocities};
pub use tape::{UPSTREAM_TOPIC, board_state, write_tape};
pub use track::{BoardFilter, LOST_AFTER_S, Observed, REMEMBERED_FRAMES, Seen, Step, Track};
pub use tune::{LEAST_SAMPLES, LEAST_VISITS, RegionTuning, Tuning, tune};
pub use upstream::UpstreamFilter;
