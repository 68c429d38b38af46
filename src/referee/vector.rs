//! Arithmetic of positions and velocities on the board.

/// A position (m) or a velocity (m/s) on the board.
pub(super) type Vector = [f64; 2];

pub(super) fn plus(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1]]
}

pub(super) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn times(a: Vector, factor: f64) -> Vector {
    [a[0] * factor, a[1] * factor]
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn length(a: Vector) -> f64 {
    a[0].hypot(a[1])
}

pub(super) fn distance(a: Vector, b: Vector) -> f64 {
    length(minus(a, b))
}
