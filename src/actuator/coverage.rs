//! Where the training data lies in (command, velocity), so that a model can say when it is asked
//! about something that it has not seen.

use super::{layout::AXES, run::Run};
use serde::{Deserialize, Serialize};

/// Cells along each side of the map of one axis.
pub const CELLS: usize = 24;

/// Counts of training samples over (command, velocity) of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisCoverage {
    /// Largest absolute command of the training data (m/s); the map spans plus and minus this.
    pub command_span_m_per_s: f64,
    /// Largest absolute velocity of the training data (m/s).
    pub velocity_span_m_per_s: f64,
    /// `[command cell][velocity cell]`, both from the most negative.
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
            let share = 0.5 * (value / span + 1.0);
            (0.0..=1.0).contains(&share).then(|| ((share * CELLS as f64) as usize).min(CELLS - 1))
        };
        Some([
            place(command, self.command_span_m_per_s)?,
            place(velocity, self.velocity_span_m_per_s)?,
        ])
    }

    /// Whether a training sample lay in the same cell or one that touches it.
    #[must_use]
    pub fn contains(&self, command: f64, velocity: f64) -> bool {
        let Some([row, column]) = self.cell(command, velocity) else { return false };
        let around = |at: usize| at.saturating_sub(1)..(at + 2).min(CELLS);
        around(row).any(|row| around(column).any(|column| 0 < self.counts[row][column]))
    }
}

/// The coverage of both axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// x and y.
    pub axes: [AxisCoverage; AXES],
}

impl Coverage {
    /// The coverage of the samples of `runs`.
    #[must_use]
    pub fn of(runs: &[&Run]) -> Self {
        Self { axes: std::array::from_fn(|axis| AxisCoverage::of(runs, axis)) }
    }

    /// Whether the training data holds something close, in both axes.
    ///
    /// A model that is asked where this is `false` extrapolates.
    #[must_use]
    pub fn contains(&self, command: [f64; AXES], velocity: [f64; AXES]) -> bool {
        (0..AXES).all(|axis| self.axes[axis].contains(command[axis], velocity[axis]))
    }

    /// Share of the samples of `run` that lie outside, 0 to 1.
    #[must_use]
    pub fn share_outside(&self, run: &Run) -> f64 {
        let pairs = run.commands.iter().zip(&run.velocities);
        let outside = pairs.filter(|(u, v)| !self.contains(**u, **v)).count();
        outside as f64 / run.len().max(1) as f64
    }
}
