//! Training windows without copies: each part of a window is a contiguous slice.
//!
//! Inputs are newest first, so the runs are stored backwards in time. A window of any history is
//! then a slice, and a batch is gathered by plain copies.

use super::{
    layout::{AXES, Layout},
    run::Run,
};

/// Root mean square of commands and velocities per axis, used to scale the inputs.
///
/// The mean is not subtracted, so standstill at zero command stays zero. The scale folds into the
/// first and last layer; a stored network takes and returns m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Commands (m/s).
    pub command: [f32; AXES],
    /// Velocities (m/s).
    pub velocity: [f32; AXES],
}

/// Scale of an axis that never moves (m/s), instead of zero.
const SMALLEST_SCALE: f64 = 1e-3;

impl Scale {
    /// Compute the root mean square over all samples of `runs`.
    #[must_use]
    pub fn of(runs: &[&Run]) -> Self {
        let rms = |series: fn(&Run) -> &Vec<[f64; AXES]>| {
            std::array::from_fn(|axis| {
                let count: usize = runs.iter().map(|run| run.len()).sum();
                let squares =
                    runs.iter().flat_map(|run| series(run)).map(|pair| pair[axis].powi(2));
                (squares.sum::<f64>() / count.max(1) as f64).sqrt().max(SMALLEST_SCALE) as f32
            })
        };
        Self { command: rms(|run| &run.commands), velocity: rms(|run| &run.velocities) }
    }
}

/// All training windows of a set of runs.
#[derive(Debug, Clone)]
pub struct Windows {
    /// Order of the inputs.
    pub layout: Layout,
    horizon: usize,
    /// Scaled commands and velocities of all runs, each run newest first, x and y interleaved.
    commands: Vec<f32>,
    velocities: Vec<f32>,
    /// Index (in samples, backwards) of the newest input of each window.
    newest: Vec<u32>,
}

impl Windows {
    /// Index every window of `runs` that has its history and `horizon` samples to predict.
    #[must_use]
    pub fn new(runs: &[&Run], layout: Layout, horizon: usize, scale: &Scale) -> Self {
        let mut windows = Self {
            layout,
            horizon,
            commands: Vec::new(),
            velocities: Vec::new(),
            newest: Vec::new(),
        };
        for run in runs {
            let first = windows.commands.len() / AXES;
            for k in (0..run.len()).rev() {
                for axis in 0..AXES {
                    windows.commands.push(run.commands[k][axis] as f32 / scale.command[axis]);
                    windows.velocities.push(run.velocities[k][axis] as f32 / scale.velocity[axis]);
                }
            }
            // Backwards, sample k of a run of n lies at n - 1 - k: the newest input may be any
            // sample with `horizon` after it and its history before it.
            let last = run.len().saturating_sub(layout.history_steps - 1);
            windows.newest.extend((first + horizon..first + last).map(|index| index as u32));
        }
        windows
    }

    /// Return the number of windows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.newest.len()
    }

    /// Return whether the set is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.newest.is_empty()
    }

    /// Gather the inputs of the windows `chosen` into `x`, `[chosen][inputs]`.
    pub fn inputs(&self, chosen: &[u32], x: &mut Vec<f32>) {
        x.clear();
        for index in chosen {
            let at = AXES * self.newest[*index as usize] as usize;
            x.extend_from_slice(&self.commands[at..at + self.layout.command_inputs()]);
            x.extend_from_slice(&self.velocities[at..at + self.layout.velocity_inputs()]);
        }
    }

    /// Return the scaled target velocity at `step` (0 is the next sample).
    #[must_use]
    pub fn target(&self, index: u32, step: usize) -> [f32; AXES] {
        Self::pair(&self.velocities, self.newest[index as usize] as usize - step - 1)
    }

    /// Return the scaled command that joins the history for predicting `step` (from 1).
    #[must_use]
    pub fn command(&self, index: u32, step: usize) -> [f32; AXES] {
        Self::pair(&self.commands, self.newest[index as usize] as usize - step)
    }

    fn pair(values: &[f32], sample: usize) -> [f32; AXES] {
        [values[AXES * sample], values[AXES * sample + 1]]
    }

    /// Return the number of samples predicted from each window.
    #[must_use]
    pub fn horizon(&self) -> usize {
        self.horizon
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::LayoutKind;
    use super::*;
    use std::path::PathBuf;

    fn counting_run(offset: f64, samples: usize) -> Run {
        let series = |sign: f64| {
            (0..samples)
                .map(move |k| [sign * (offset + k as f64), sign * (offset + k as f64 + 0.5)])
        };
        Run {
            path: PathBuf::new(),
            file: 0,
            number: 0,
            pattern: String::new(),
            split: None,
            start: crate::units::Nanos(0),
            commands: series(1.0).collect(),
            velocities: series(-1.0).collect(),
        }
    }

    #[test]
    fn windows_equal_the_layout_and_never_cross_runs() {
        let scale = Scale { command: [1.0; 2], velocity: [1.0; 2] };
        for kind in [LayoutKind::Klasktron, LayoutKind::KlaskRl] {
            let layout = Layout { kind, history_steps: 3 };
            let runs = [counting_run(0.0, 8), counting_run(100.0, 2), counting_run(200.0, 6)];
            let runs: Vec<&Run> = runs.iter().collect();
            let windows = Windows::new(&runs, layout, 2, &scale);
            // Newest input k runs from 2 to n - 3: 4 windows of 8 samples, none of 2, 2 of 6.
            assert_eq!(windows.len(), 4 + 2);
            let mut seen = Vec::new();
            for index in 0..windows.len() as u32 {
                let mut x = Vec::new();
                windows.inputs(&[index], &mut x);
                let run = runs[if x[0] < 100.0 { 0 } else { 2 }];
                let k = x[0] as usize % 100;
                let mut expected = vec![0.0; layout.inputs()];
                layout.fill(&mut expected, &run.commands, &run.velocities, k);
                assert_eq!(x, expected);
                let [next, after] = [k + 1, k + 2].map(|k| run.velocities[k].map(|v| v as f32));
                assert_eq!([windows.target(index, 0), windows.target(index, 1)], [next, after]);
                assert_eq!(windows.command(index, 1), run.commands[k + 1].map(|u| u as f32));
                seen.push(x[0] as usize);
            }
            seen.sort_unstable();
            assert_eq!(seen, [2, 3, 4, 5, 202, 203]);
        }
    }
}
