//! Rigid motion between two right-handed frames: rotation matrix and translation.

/// Below this angle (rad) the series of Rodrigues' formula is used.
const SMALL_ANGLE: f64 = 1e-8;

/// Pose: `point_in_camera = rotation * point_in_board + translation` for `camera_from_board`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation matrix, by rows.
    pub rotation: [[f64; 3]; 3],
    /// Translation (m).
    pub translation: [f64; 3],
}

impl Pose {
    /// Create a pose from a rotation vector (axis times angle, rad) and a translation (m).
    #[must_use]
    pub fn from_vectors(rotation: [f64; 3], translation: [f64; 3]) -> Self {
        Self { rotation: rotation_matrix(rotation), translation }
    }

    /// Return the rotation vector (axis times angle, rad).
    #[must_use]
    pub fn rotation_vector(&self) -> [f64; 3] {
        rotation_vector(&self.rotation)
    }

    /// Return a point of the first frame in the second.
    #[must_use]
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        let turned = multiply_vector(&self.rotation, point);
        [0, 1, 2].map(|axis| turned[axis] + self.translation[axis])
    }

    /// Return the inverse pose.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let r = &self.rotation;
        let rotation = [0, 1, 2].map(|row| [0, 1, 2].map(|column| r[column][row]));
        let turned = multiply_vector(&rotation, self.translation);
        Self { rotation, translation: turned.map(|t| -t) }
    }

    /// Return this pose after a small rotation (rad) in the second frame and a shift (m).
    #[must_use]
    pub fn nudged(&self, turn: [f64; 3], shift: [f64; 3]) -> Self {
        let rotation = multiply(&rotation_matrix(turn), &self.rotation);
        Self { rotation, translation: [0, 1, 2].map(|axis| self.translation[axis] + shift[axis]) }
    }
}

/// Return the product of two matrices.
pub(super) fn multiply(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum()))
}

/// Return the product of a matrix and a vector.
pub(super) fn multiply_vector(a: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|row| a[row][0] * v[0] + a[row][1] * v[1] + a[row][2] * v[2])
}

/// Rodrigues' formula: `I + sin(t) K + (1 - cos(t)) K^2` with the axis' cross-product matrix `K`.
fn rotation_matrix(vector: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    let (s, c) = if angle < SMALL_ANGLE {
        (1.0, 0.5)
    } else {
        (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle))
    };
    let [x, y, z] = vector;
    let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let k2 = multiply(&k, &k);
    [0, 1, 2].map(|row| {
        [0, 1, 2].map(|column| {
            f64::from(u8::from(row == column)) + s * k[row][column] + c * k2[row][column]
        })
    })
}

/// Return the rotation vector of a matrix, by its quaternion, which is stable at every angle.
fn rotation_vector(r: &[[f64; 3]; 3]) -> [f64; 3] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let largest = [r[0][0], r[1][1], r[2][2], trace];
    let at = (0..4).fold(0, |best, k| if largest[best] < largest[k] { k } else { best });
    // Four times the products of the quaternion's components with its largest component.
    let skew = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
    let mut q = [0.0; 4];
    if at == 3 {
        q = [skew[0], skew[1], skew[2], 1.0 + trace];
    } else {
        for (axis, value) in q.iter_mut().take(3).enumerate() {
            *value = r[at][axis] + r[axis][at];
        }
        q[at] = 1.0 - trace + 2.0 * r[at][at];
        q[3] = skew[at];
    }
    let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt();
    if length < SMALL_ANGLE * q[3].abs() {
        return [0, 1, 2].map(|axis| 2.0 * q[axis] / q[3]);
    }
    let angle = 2.0 * length.atan2(sign * q[3]);
    [0, 1, 2].map(|axis| sign * q[axis] / length * angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vectors_and_matrices_are_inverse(v in prop::array::uniform3(-1.8_f64..1.8)) {
            let pose = Pose::from_vectors(v, [0.1, -0.2, 0.3]);
            let back = pose.rotation_vector();
            for axis in 0..3 {
                // Beyond half a turn the vector would be that of the other way round.
                prop_assume!(v.iter().map(|v| v * v).sum::<f64>() < 9.8);
                prop_assert!((back[axis] - v[axis]).abs() < 1e-7, "{v:?} {back:?}");
            }
            let there = pose.apply([0.3, 0.1, -0.4]);
            let home = pose.inverse().apply(there);
            for (found, expected) in home.iter().zip([0.3, 0.1, -0.4]) {
                prop_assert!((found - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn half_a_turn_and_none_are_found() {
        for v in [[std::f64::consts::PI, 0.0, 0.0], [0.0; 3], [1e-12, 0.0, 0.0]] {
            let back = Pose::from_vectors(v, [0.0; 3]).rotation_vector();
            let error = (0..3).map(|k| (back[k] - v[k]).abs()).fold(0.0, f64::max);
            assert!(error < 1e-9, "{v:?} {back:?}");
        }
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let pose = Pose::from_vectors([0.0, 0.0, std::f64::consts::FRAC_PI_2], [0.0; 3]);
        let turned = pose.apply([1.0, 0.0, 0.0]);
        assert!((turned[1] - 1.0).abs() < 1e-15 && turned[0].abs() < 1e-15);
    }
}
