//! Standardisation of a network's inputs: its own first layer, kept apart from the weights.

/// `clamp((x - mean) * scale, -limit, limit)` of each column.
///
/// The limit is why this cannot be folded into the weights of the first dense layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Standardizer {
    /// `[columns]`, in the unit of the inputs.
    pub mean: Vec<f32>,
    /// One over the deviation, `[columns]`.
    pub scale: Vec<f32>,
    /// Largest magnitude afterwards; infinite for none.
    pub limit: f32,
}

impl Standardizer {
    /// Changes nothing.
    #[must_use]
    pub fn identity(columns: usize) -> Self {
        Self { mean: vec![0.0; columns], scale: vec![1.0; columns], limit: f32::INFINITY }
    }

    /// Number of columns.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.mean.len()
    }

    /// Standardises rows, `[rows][columns]`; what is not a number stays so.
    pub fn apply(&self, rows: &[f32], out: &mut [f32]) {
        let columns = self.columns();
        for (row, out) in rows.chunks_exact(columns).zip(out.chunks_exact_mut(columns)) {
            let parameters = self.mean.iter().zip(&self.scale);
            for ((out, x), (mean, scale)) in out.iter_mut().zip(row).zip(parameters) {
                *out = ((x - mean) * scale).clamp(-self.limit, self.limit);
            }
        }
    }

    /// The number of column `column` that standardises to `value`.
    #[must_use]
    pub fn invert(&self, column: usize, value: f32) -> f32 {
        value / self.scale[column] + self.mean[column]
    }
}
