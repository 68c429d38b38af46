//! Pieces on the board: ball, strikers, goal cups.

/// Radius of the ball (m). Source: scene configuration of the upstream simulator.
pub const BALL_RADIUS: f64 = 0.007;
/// Radius of a striker at the height of the ball (m). Source: upstream motor commander and simulator.
pub const STRIKER_RADIUS: f64 = 0.0075;
/// Radius of a goal cup (m). Source: upstream simulator.
pub const CUP_RADIUS: f64 = 0.01905;
/// Distance of the cups' centres from the centre of the board, along y (m). Source: upstream
/// simulator.
pub const CUP_DISTANCE: f64 = 0.17;
