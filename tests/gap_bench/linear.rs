//! Least squares for the rivals: normal equations, a little ridge, Cholesky.

/// Columns of equal length.
pub(crate) type Columns = Vec<Vec<f64>>;

/// Coefficients that fit `y` by `columns` in the least-squares sense.
pub(crate) fn fit(columns: &[&[f64]], y: &[f64], ridge: f64) -> Vec<f64> {
    let n = columns.len();
    let mut a = vec![vec![0.0; n]; n];
    let mut b = vec![0.0; n];
    for i in 0..n {
        for j in 0..=i {
            a[i][j] = dot(columns[i], columns[j]);
        }
        b[i] = dot(columns[i], y);
        a[i][i] *= 1.0 + ridge;
        a[i][i] += 1e-12;
    }
    solve(a, b)
}

fn dot(p: &[f64], q: &[f64]) -> f64 {
    p.iter().zip(q).map(|(p, q)| p * q).sum()
}

fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        for j in 0..=i {
            let inner: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - inner;
            a[i][j] = if i == j { rest.max(1e-14).sqrt() } else { rest / a[j][j] };
        }
    }
    for i in 0..n {
        let inner: f64 = (0..i).map(|k| a[i][k] * b[k]).sum();
        b[i] = (b[i] - inner) / a[i][i];
    }
    for i in (0..n).rev() {
        let inner: f64 = (i + 1..n).map(|k| a[k][i] * b[k]).sum();
        b[i] = (b[i] - inner) / a[i][i];
    }
    b
}

/// What `coefficients` leave of `y`.
pub(crate) fn left(columns: &[&[f64]], y: &[f64], coefficients: &[f64]) -> Vec<f64> {
    let model = |row: usize| columns.iter().zip(coefficients).map(|(c, k)| c[row] * k).sum::<f64>();
    y.iter().enumerate().map(|(row, value)| value - model(row)).collect()
}

/// Sum of squares that `coefficients` leave.
pub(crate) fn rest(columns: &[&[f64]], y: &[f64], coefficients: &[f64]) -> f64 {
    left(columns, y, coefficients).iter().map(|value| value.powi(2)).sum()
}
