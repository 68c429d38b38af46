//! Standardisation of a network's inputs, as a first layer separate from the weights.

/// Standardisation `clamp((x - mean) * scale, -limit, limit)` of each column.
///
/// Because of the limit it cannot be folded into the weights of the first dense layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Standardizer {
    /// Mean `[columns]`, in the unit of the inputs.
    pub mean: Vec<f32>,
    /// Reciprocal of the standard deviation, `[columns]`.
    pub scale: Vec<f32>,
    /// Largest magnitude of the result; infinite for no limit.
    pub limit: f32,
}

impl Standardizer {
    /// Create a standardisation that changes nothing.
    #[must_use]
    pub fn identity(columns: usize) -> Self {
        Self { mean: vec![0.0; columns], scale: vec![1.0; columns], limit: f32::INFINITY }
    }

    /// Return the number of columns.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.mean.len()
    }

    /// Standardise rows, `[rows][columns]`; NaN stays NaN.
    pub fn apply(&self, rows: &[f32], out: &mut [f32]) {
        let columns = self.columns();
        for (row, out) in rows.chunks_exact(columns).zip(out.chunks_exact_mut(columns)) {
            let parameters = self.mean.iter().zip(&self.scale);
            for ((out, x), (mean, scale)) in out.iter_mut().zip(row).zip(parameters) {
                *out = ((x - mean) * scale).clamp(-self.limit, self.limit);
            }
        }
    }

    /// Return the input of column `column` that standardises to `value`.
    #[must_use]
    pub fn invert(&self, column: usize, value: f32) -> f32 {
        value / self.scale[column] + self.mean[column]
    }
}
