//! Levenberg-Marquardt with numerical derivatives, for problems of some hundred parameters.
//!
//! Source: Nocedal and Wright, "Numerical Optimization", 2nd edition, section 10.3. Derivatives are central
//! differences with a step per parameter.

/// Largest number of accepted or refused steps.
const MAX_STEPS: usize = 100;
/// Relative decrease of the cost below which the fit has converged.
const TOLERANCE: f64 = 1e-12;

/// Result of a fit.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Parameters.
    pub(super) parameters: Vec<f64>,
    /// Sum of the squared residuals.
    pub(super) cost: f64,
    /// Inverse of the normal matrix `J^T J`, row by row.
    pub(super) inverse: Vec<f64>,
}

/// Residuals of a problem, in blocks that each depend on few parameters.
pub(super) trait Problem {
    /// Number of blocks.
    fn blocks(&self) -> usize;
    /// Indices of the parameters that a block depends on.
    fn parameters_of(&self, block: usize) -> Vec<usize>;
    /// Append the residuals of a block.
    fn residuals(&self, parameters: &[f64], block: usize, out: &mut Vec<f64>);
    /// Step of the derivative by a parameter.
    fn step(&self, parameter: usize) -> f64;
}

/// Minimize the squared residuals; `None` when the normal matrix is singular.
pub(super) fn minimize(problem: &impl Problem, start: &[f64]) -> Option<Fit> {
    let count = start.len();
    let mut parameters = start.to_vec();
    let mut cost = cost_of(problem, &parameters);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let (normal, gradient) = linearize(problem, &parameters);
        let mut damped = normal.clone();
        for at in 0..count {
            damped[at * count + at] *= 1.0 + damping;
        }
        let Some(step) = solve(&damped, &gradient) else {
            damping *= 10.0;
            if 1e12 < damping {
                return None;
            }
            continue;
        };
        let trial: Vec<f64> = parameters.iter().zip(&step).map(|(p, s)| p - s).collect();
        let new_cost = cost_of(problem, &trial);
        if new_cost < cost {
            let gain = (cost - new_cost) / cost.max(f64::MIN_POSITIVE);
            (parameters, cost) = (trial, new_cost);
            damping = (damping / 10.0).max(1e-15);
            if gain < TOLERANCE {
                break;
            }
        } else {
            damping *= 10.0;
            if 1e12 < damping {
                break;
            }
        }
    }
    let (normal, _) = linearize(problem, &parameters);
    let inverse = invert(&normal, count)?;
    Some(Fit { parameters, cost, inverse })
}

fn cost_of(problem: &impl Problem, parameters: &[f64]) -> f64 {
    let mut residuals = Vec::new();
    (0..problem.blocks()).for_each(|block| problem.residuals(parameters, block, &mut residuals));
    let cost: f64 = residuals.iter().map(|own| own * own).sum();
    if cost.is_finite() { cost } else { f64::INFINITY }
}

/// Normal matrix and gradient at `parameters`.
fn linearize(problem: &impl Problem, parameters: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let count = parameters.len();
    let (mut normal, mut gradient) = (vec![0.0; count * count], vec![0.0; count]);
    let mut moved = parameters.to_vec();
    for block in 0..problem.blocks() {
        let own = problem.parameters_of(block);
        let mut residuals = Vec::new();
        problem.residuals(parameters, block, &mut residuals);
        let columns: Vec<Vec<f64>> = own
            .iter()
            .map(|&parameter| {
                let step = problem.step(parameter);
                let mut side = |sign: f64| {
                    moved[parameter] = parameters[parameter] + sign * step;
                    let mut out = Vec::with_capacity(residuals.len());
                    problem.residuals(&moved, block, &mut out);
                    moved[parameter] = parameters[parameter];
                    out
                };
                let (high, low) = (side(1.0), side(-1.0));
                high.iter().zip(&low).map(|(h, l)| (h - l) / (2.0 * step)).collect()
            })
            .collect();
        for (i, &row) in own.iter().enumerate() {
            gradient[row] += dot(&columns[i], &residuals);
            for (j, &column) in own.iter().enumerate() {
                normal[row * count + column] += dot(&columns[i], &columns[j]);
            }
        }
    }
    (normal, gradient)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Cholesky factor of a matrix whose diagonal is scaled to 1, and the scales; `None` unless positive definite.
fn factor(matrix: &[f64], count: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let scale: Vec<f64> = (0..count).map(|at| 1.0 / matrix[at * count + at].sqrt()).collect();
    if scale.iter().any(|own| !own.is_finite()) {
        return None;
    }
    let mut lower = vec![0.0; count * count];
    for row in 0..count {
        for column in 0..=row {
            let known: f64 =
                (0..column).map(|k| lower[row * count + k] * lower[column * count + k]).sum();
            let left = matrix[row * count + column] * scale[row] * scale[column] - known;
            lower[row * count + column] = if row < column + 1 {
                if left < 1e-14 || left.is_nan() {
                    return None;
                }
                left.sqrt()
            } else {
                left / lower[column * count + column]
            };
        }
    }
    Some((lower, scale))
}

fn substitute(lower: &[f64], scale: &[f64], right: &[f64]) -> Vec<f64> {
    let count = right.len();
    let mut x: Vec<f64> = right.iter().zip(scale).map(|(r, s)| r * s).collect();
    for row in 0..count {
        let known: f64 = (0..row).map(|k| lower[row * count + k] * x[k]).sum();
        x[row] = (x[row] - known) / lower[row * count + row];
    }
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|k| lower[k * count + row] * x[k]).sum();
        x[row] = (x[row] - known) / lower[row * count + row];
    }
    x.iter().zip(scale).map(|(x, s)| x * s).collect()
}

/// Solve a symmetric positive definite system; `None` unless it is one.
pub(in crate::camera) fn solve(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    let (lower, scale) = factor(matrix, right.len())?;
    Some(substitute(&lower, &scale, right))
}

fn invert(matrix: &[f64], count: usize) -> Option<Vec<f64>> {
    let (lower, scale) = factor(matrix, count)?;
    let mut inverse = Vec::with_capacity(count * count);
    for column in 0..count {
        let mut unit = vec![0.0; count];
        unit[column] = 1.0;
        inverse.extend(substitute(&lower, &scale, &unit));
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's function as residuals `10 (y - x^2)` and `1 - x`; the minimum is at (1, 1).
    struct Rosenbrock;

    impl Problem for Rosenbrock {
        fn blocks(&self) -> usize {
            2
        }
        fn parameters_of(&self, block: usize) -> Vec<usize> {
            if block == 0 { vec![0, 1] } else { vec![0] }
        }
        fn residuals(&self, p: &[f64], block: usize, out: &mut Vec<f64>) {
            out.push(if block == 0 { 10.0 * (p[1] - p[0] * p[0]) } else { 1.0 - p[0] });
        }
        fn step(&self, _parameter: usize) -> f64 {
            1e-6
        }
    }

    #[test]
    fn the_minimum_and_the_covariance_of_rosenbrock_are_found() {
        let fit = minimize(&Rosenbrock, &[-1.2, 1.0]).unwrap();
        assert!((fit.parameters[0] - 1.0).abs() < 1e-6 && (fit.parameters[1] - 1.0).abs() < 1e-6);
        // J = [[-20, 10], [-1, 0]] at the minimum, so (J^T J)^-1 = [[1, 2], [2, 4.01]].
        for (found, expected) in fit.inverse.iter().zip([1.0, 2.0, 2.0, 4.01]) {
            assert!((found - expected).abs() < 1e-4, "{:?}", fit.inverse);
        }
    }

    #[test]
    fn a_singular_system_is_refused() {
        assert_eq!(solve(&[1.0, 1.0, 1.0, 1.0], &[1.0, 1.0]), None);
    }
}
