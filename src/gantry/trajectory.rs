//! Excitation patterns and the commanded motion of a run.
//!
//! A [`Pattern`] with its parameters becomes the [`Reference`] of one run: a velocity for every
//! control period (zero-order hold), and the position as its exact integral `p[k+1] = p[k] + v[k]
//! dt`. Speeds, slew and stopping distance obey [`Limits`](super::Limits). A pattern that violates
//! them is refused with the largest value that fits.
//!
//! Each pattern reveals particular effects; see [`Pattern::purpose`]. Circles, diagonals, ramps and
//! the random walk are those of the paper's data set, lines those of the upstream identification
//! node. Feedback is omitted on purpose: a reference is open loop.
//!
//! ```
//! use klasktron::gantry::{Pattern, Robot, Sampling};
//! use klasktron::recording::topic::Player;
//! let robot = Robot::default();
//! let pattern: Pattern = "circle:radius_m=0.03,speed_m_per_s=0.3".parse()?;
//! let workspace = robot.soft_limits(Player::Left);
//! let sampling = Sampling { rate_hz: 50.0, samples: 750, seed: 1 };
//! let run = pattern.reference(&workspace, &robot.limits, &sampling)?;
//! assert_eq!(run.setpoints().len(), 750);
//! assert_eq!(run.setpoints()[749].velocity, [0.0, 0.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod course;
mod error;
mod fit;
mod reference;
mod text;
mod walk;
mod waves;

pub use error::TrajectoryError;
pub use reference::{Reference, Setpoint, TRANSFER_SLACK_M};

use serde::{Deserialize, Serialize};

/// Sampling of one run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Commands per second (Hz), [10, 1000]; 50 on the KlaskTron table.
    pub rate_hz: f64,
    /// Number of control periods, [10, 1000000].
    pub samples: usize,
    /// Seed of the random walk and of the multisine.
    pub seed: u64,
}

/// A straight direction on the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heading {
    /// Across the board.
    X,
    /// From goal to goal.
    Y,
    /// Diagonal on which x and y grow together: motor `a` alone.
    Up,
    /// Diagonal on which x grows while y falls: motor `b` alone.
    Down,
}

impl Heading {
    /// All headings, in the order of the documentation.
    pub const ALL: [Self; 4] = [Self::X, Self::Y, Self::Up, Self::Down];

    /// Return the unit vector in the board frame.
    #[must_use]
    pub fn vector(self) -> [f64; 2] {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        match self {
            Self::X => [1.0, 0.0],
            Self::Y => [0.0, 1.0],
            Self::Up => [half, half],
            Self::Down => [half, -half],
        }
    }
}

/// Diagonal direction on the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slope {
    /// Diagonal on which x and y grow together: motor `a` alone.
    Up,
    /// Diagonal on which x grows while y falls: motor `b` alone.
    Down,
}

/// Sense of rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Counterclockwise, seen from above.
    Counterclockwise,
    /// Clockwise, seen from above.
    Clockwise,
}

/// Excitation pattern with its parameters; speeds are along the path unless stated otherwise.
///
/// The text form, also in JSON, is `name:key=value,key=value`. A missing parameter has its value in
/// [`Pattern::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
#[expect(missing_docs, reason = "units are in the names; ranges in the errors of parsing")]
pub enum Pattern {
    /// Circle around the workspace's centre at constant speed.
    Circle { radius_m: f64, speed_m_per_s: f64, turn: Turn },
    /// Back and forth at constant speed, with one motor alone; reversals at the slew limit.
    Diagonal { slope: Slope, length_m: f64, speed_m_per_s: f64 },
    /// Back and forth across the board.
    XLine { length_m: f64, speed_m_per_s: f64 },
    /// Back and forth along the board.
    YLine { length_m: f64, speed_m_per_s: f64 },
    /// Linear ramps 0, speed, 0, -speed, with the top speed held as long as `length_m` allows.
    Ramp { heading: Heading, length_m: f64, speed_m_per_s: f64, rate_m_per_s2: f64 },
    /// Random velocities, up to `speed_m_per_s` along each axis, held for random durations.
    RandomWalk { speed_m_per_s: f64, hold_min_s: f64, hold_max_s: f64 },
    /// Sine whose frequency sweeps up and down exponentially within `period_s`.
    Chirp { heading: Heading, f0_hz: f64, f1_hz: f64, speed_m_per_s: f64, period_s: f64 },
    /// Sum of sines of equal amplitude, `lines` on each axis, at distinct frequencies;
    /// `speed_m_per_s` is the peak along each axis.
    Multisine { lines: u32, f0_hz: f64, f1_hz: f64, speed_m_per_s: f64, period_s: f64 },
    /// Forward, rest, backward, rest at each of `levels` speeds up to `speed_m_per_s`.
    StepLadder { heading: Heading, speed_m_per_s: f64, levels: u32, hold_s: f64 },
    /// Slow passage through zero: a triangle of velocity.
    Creep { heading: Heading, speed_m_per_s: f64, period_s: f64 },
}

impl Pattern {
    /// All patterns with their default parameters, which fit the KlaskTron table.
    pub const ALL: [Self; 10] = [
        Self::Circle { radius_m: 0.04, speed_m_per_s: 0.3, turn: Turn::Counterclockwise },
        Self::Diagonal { slope: Slope::Up, length_m: 0.12, speed_m_per_s: 0.4 },
        Self::XLine { length_m: 0.16, speed_m_per_s: 0.4 },
        Self::YLine { length_m: 0.1, speed_m_per_s: 0.4 },
        Self::Ramp { heading: Heading::X, length_m: 0.15, speed_m_per_s: 0.4, rate_m_per_s2: 1.5 },
        Self::RandomWalk { speed_m_per_s: 0.4, hold_min_s: 0.06, hold_max_s: 0.6 },
        Self::Chirp {
            heading: Heading::X,
            f0_hz: 0.5,
            f1_hz: 8.0,
            speed_m_per_s: 0.15,
            period_s: 10.0,
        },
        Self::Multisine { lines: 6, f0_hz: 0.4, f1_hz: 8.0, speed_m_per_s: 0.25, period_s: 5.0 },
        Self::StepLadder { heading: Heading::X, speed_m_per_s: 0.4, levels: 8, hold_s: 0.2 },
        Self::Creep { heading: Heading::X, speed_m_per_s: 0.03, period_s: 5.0 },
    ];

    /// Return the name in texts and run markers.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Circle { .. } => "circle",
            Self::Diagonal { .. } => "diagonal",
            Self::XLine { .. } => "x_line",
            Self::YLine { .. } => "y_line",
            Self::Ramp { .. } => "ramp",
            Self::RandomWalk { .. } => "random_walk",
            Self::Chirp { .. } => "chirp",
            Self::Multisine { .. } => "multisine",
            Self::StepLadder { .. } => "step_ladder",
            Self::Creep { .. } => "creep",
        }
    }

    /// Return the effects that the pattern reveals, as one sentence.
    #[must_use]
    pub fn purpose(&self) -> &'static str {
        match self {
            Self::Circle { .. } => {
                "Both axes at once through all phases: cross-coupling, racking, gain of each axis."
            }
            Self::Diagonal { .. } => {
                "One motor alone: asymmetry of belts and motors, ripple of the pulley."
            }
            Self::XLine { .. } => {
                "One axis at constant speed with hard reversals: viscous friction, backlash, slew."
            }
            Self::YLine { .. } => {
                "One axis at constant speed with hard reversals, and y acceleration that racks the \
                 beam."
            }
            Self::Ramp { .. } => {
                "Every speed at constant acceleration: Coulomb and Stribeck friction, slew and \
                 torque-speed limits."
            }
            Self::RandomWalk { .. } => {
                "Random commands over the whole workspace: coverage for learned models, delay, \
                 position dependence."
            }
            Self::Chirp { .. } => {
                "Swept frequency: delay versus lag, velocity loop, resonance of the \
                 belt."
            }
            Self::Multisine { .. } => {
                "Known lines on both axes at once: frequency response, cross-coupling and \
                 nonlinearity between the lines."
            }
            Self::StepLadder { .. } => {
                "Steps from rest in both directions at several speeds: delay, lag, saturation, \
                 supply sag."
            }
            Self::Creep { .. } => {
                "Slow passage through zero: Coulomb, Stribeck and presliding friction, input deadband, \
                 offset."
            }
        }
    }

    /// Return the speed parameter (m/s).
    #[must_use]
    pub fn speed(&self) -> f64 {
        match *self {
            Self::Circle { speed_m_per_s, .. }
            | Self::Diagonal { speed_m_per_s, .. }
            | Self::XLine { speed_m_per_s, .. }
            | Self::YLine { speed_m_per_s, .. }
            | Self::Ramp { speed_m_per_s, .. }
            | Self::RandomWalk { speed_m_per_s, .. }
            | Self::Chirp { speed_m_per_s, .. }
            | Self::Multisine { speed_m_per_s, .. }
            | Self::StepLadder { speed_m_per_s, .. }
            | Self::Creep { speed_m_per_s, .. } => speed_m_per_s,
        }
    }
}

#[cfg(test)]
mod tests;
