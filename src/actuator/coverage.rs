//! Coverage of the training data over (command, velocity), to detect extrapolation of a model.

use super::{layout::AXES, run::Run};
use serde::{Deserialize, Serialize};

/// Number of cells along each side of the map of one axis.
pub const CELLS: usize = 24;

/// Histogram of training samples over (command, velocity) of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisCoverage {
    /// Largest absolute command of the training data (m/s); the map spans plus and minus this.
    pub command_span_m_per_s: f64,
    /// Largest absolute velocity of the training data (m/s).
    pub velocity_span_m_per_s: f64,
    /// Counts `[command cell][velocity cell]`, both from the most negative.
    pub counts: Vec<Vec<u32>>,
}

impl AxisCoverage {
    fn of(runs: &[&Run], axis: usize) -> Self {
        let span = |series: fn(&Run) -> &Vec<[f64; AXES]>| {
            let values = runs.iter().flat_map(|run| series(run)).map(|pair| pair[axis].abs());
            values.fold(f64::MIN_POSITIVE, f64::max)
        };
        let mut coverage = Self {
            command_span_m_per_s: span(|run| &run.commands),
            velocity_span_m_per_s: span(|run| &run.velocities),
            counts: vec![vec![0; CELLS]; CELLS],
        };
        for run in runs {
            for (command, velocity) in run.commands.iter().zip(&run.velocities) {
                if let Some([row, column]) = coverage.cell(command[axis], velocity[axis]) {
                    coverage.counts[row][column] += 1;
                }
            }
        }
        coverage
    }

    fn cell(&self, command: f64, velocity: f64) -> Option<[usize; 2]> {
        let place = |value: f64, span: f64| {
            let fraction = 0.5 * (value / span + 1.0);
            (0.0..=1.0)
                .contains(&fraction)
                .then(|| ((fraction * CELLS as f64) as usize).min(CELLS - 1))
        };
        Some([
            place(command, self.command_span_m_per_s)?,
            place(velocity, self.velocity_span_m_per_s)?,
        ])
    }

    /// Return whether a training sample lies in the same cell or in an adjacent one.
    #[must_use]
    pub fn contains(&self, command: f64, velocity: f64) -> bool {
        let Some([row, column]) = self.cell(command, velocity) else { return false };
        let around = |at: usize| at.saturating_sub(1)..(at + 2).min(CELLS);
        around(row).any(|row| around(column).any(|column| 0 < self.counts[row][column]))
    }
}

/// Lookup table of [`Coverage`], evaluated at the centre of each cell.
#[derive(Debug, Clone)]
pub struct CoverageMask {
    /// Reciprocals of the spans of command and velocity, per axis.
    scales: [[f32; 2]; AXES],
    /// Flags `[axis][command cell][velocity cell]`.
    cells: Vec<bool>,
}

impl CoverageMask {
    /// Build the mask of `coverage`.
    #[must_use]
    pub fn new(coverage: &Coverage) -> Self {
        let middle = |cell: usize| 2.0 * (cell as f64 + 0.5) / CELLS as f64 - 1.0;
        let mut cells = Vec::with_capacity(AXES * CELLS * CELLS);
        for axis in &coverage.axes {
            for (row, column) in (0..CELLS).flat_map(|row| (0..CELLS).map(move |c| (row, c))) {
                let command = middle(row) * axis.command_span_m_per_s;
                cells.push(axis.contains(command, middle(column) * axis.velocity_span_m_per_s));
            }
        }
        let scales = std::array::from_fn(|axis| {
            let AxisCoverage { command_span_m_per_s, velocity_span_m_per_s, .. } =
                coverage.axes[axis];
            [command_span_m_per_s, velocity_span_m_per_s].map(|span| span.recip() as f32)
        });
        Self { scales, cells }
    }

    /// Return whether the point is covered, as [`Coverage::contains`]; in m/s.
    #[must_use]
    pub fn contains(&self, command: [f32; AXES], velocity: [f32; AXES]) -> bool {
        (0..AXES).all(|axis| {
            let place = |value: f32, scale: f32| {
                let fraction = 0.5 * (value * scale + 1.0);
                (0.0..=1.0)
                    .contains(&fraction)
                    .then(|| ((fraction * CELLS as f32) as usize).min(CELLS - 1))
            };
            let [of_command, of_velocity] = self.scales[axis];
            place(command[axis], of_command)
                .zip(place(velocity[axis], of_velocity))
                .is_some_and(|(row, column)| self.cells[(axis * CELLS + row) * CELLS + column])
        })
    }
}

/// Coverage of both axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Maps of x and y.
    pub axes: [AxisCoverage; AXES],
}

impl Coverage {
    /// Map the coverage of the samples of `runs`.
    #[must_use]
    pub fn of(runs: &[&Run]) -> Self {
        Self { axes: std::array::from_fn(|axis| AxisCoverage::of(runs, axis)) }
    }

    /// Return whether the training data holds a nearby sample in both axes.
    ///
    /// For `false`, a model extrapolates.
    #[must_use]
    pub fn contains(&self, command: [f64; AXES], velocity: [f64; AXES]) -> bool {
        (0..AXES).all(|axis| self.axes[axis].contains(command[axis], velocity[axis]))
    }

    /// Return the fraction of the samples of `run` outside the coverage, 0 to 1.
    #[must_use]
    pub fn fraction_outside(&self, run: &Run) -> f64 {
        let pairs = run.commands.iter().zip(&run.velocities);
        let outside = pairs.filter(|(u, v)| !self.contains(**u, **v)).count();
        outside as f64 / run.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mask_answers_as_the_map_does() {
        let mut axis = AxisCoverage {
            command_span_m_per_s: 0.5,
            velocity_span_m_per_s: 0.4,
            counts: vec![vec![0; CELLS]; CELLS],
        };
        axis.counts[12][12] = 3;
        axis.counts[0][20] = 1;
        let coverage = Coverage { axes: [axis.clone(), axis] };
        let mask = CoverageMask::new(&coverage);
        let mut inside = 0;
        for (k, m) in (0..60).flat_map(|k| (0..60).map(move |m| (k, m))) {
            let (command, velocity) = (-0.591 + 0.02 * f64::from(k), -0.591 + 0.02 * f64::from(m));
            let truth = coverage.contains([command; 2], [velocity; 2]);
            assert_eq!(mask.contains([command as f32; 2], [velocity as f32; 2]), truth);
            inside += u32::from(truth);
        }
        assert!(10 < inside && inside < 1000, "{inside}");
    }
}
