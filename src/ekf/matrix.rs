//! Four by four matrices on the stack.

/// `[row][column]`; states are (x, y, vx, vy).
pub type Matrix4 = [[f64; 4]; 4];

/// `f p f'` for a symmetric `p`; the result is symmetric to the last bit.
pub(super) fn congruence(f: &Matrix4, p: &Matrix4) -> Matrix4 {
    let mut fp = [[0.0; 4]; 4];
    for (row, f) in fp.iter_mut().zip(f) {
        for (f, p) in f.iter().zip(p) {
            for (sum, p) in row.iter_mut().zip(p) {
                *sum += f * p;
            }
        }
    }
    let mut result = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in i..4 {
            let sum =
                fp[i][0] * f[j][0] + fp[i][1] * f[j][1] + fp[i][2] * f[j][2] + fp[i][3] * f[j][3];
            result[i][j] = sum;
            result[j][i] = sum;
        }
    }
    result
}

/// Adds `factor a a'` to `p`.
pub(super) fn add_outer(p: &mut Matrix4, a: &[f64; 4], factor: f64) {
    for (row, left) in p.iter_mut().zip(a) {
        for (cell, right) in row.iter_mut().zip(a) {
            *cell += factor * (left * right);
        }
    }
}

/// Lower triangle `l` with `l l' = p`; `None` where `p` is not positive definite.
pub(super) fn cholesky(p: &Matrix4) -> Option<Matrix4> {
    let mut l = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..=i {
            let sum: f64 = p[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    Some(l)
}

/// `e' p^-1 e`; `None` where `p` is not positive definite.
pub(super) fn mahalanobis(p: &Matrix4, e: &[f64; 4]) -> Option<f64> {
    let l = cholesky(p)?;
    let mut solved = [0.0; 4];
    for i in 0..4 {
        let sum: f64 = (0..i).map(|k| l[i][k] * solved[k]).sum();
        solved[i] = (e[i] - sum) / l[i][i];
    }
    Some(solved.iter().map(|value| value * value).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// numpy: F = arange(16).reshape(4, 4) / 10, P = diag(1, 2, 3, 4) + 0.1, F @ P @ F.T
    #[test]
    fn a_congruence_is_that_of_numpy() {
        let f: Matrix4 =
            std::array::from_fn(|i| std::array::from_fn(|j| (4 * i + j) as f64 / 10.0));
        let p: Matrix4 = std::array::from_fn(|i| {
            std::array::from_fn(|j| 0.1 + if i == j { i as f64 + 1.0 } else { 0.0 })
        });
        let found = congruence(&f, &p);
        assert!((found[0][0] - 0.536).abs() < 1e-12, "{}", found[0][0]);
        assert!((found[1][3] - 9.688).abs() < 1e-12, "{}", found[1][3]);
        assert_eq!(found[1][3], found[3][1]);
    }

    #[test]
    fn the_mahalanobis_square_of_a_diagonal_is_a_sum() {
        let p = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { (i + 1) as f64 } else { 0.0 })
        });
        let square = mahalanobis(&p, &[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert!((square - (1.0 + 2.0 + 3.0 + 4.0)).abs() < 1e-12);
        assert_eq!(mahalanobis(&[[1.0; 4]; 4], &[1.0; 4]), None);
    }
}
