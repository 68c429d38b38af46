//! A drive to be identified: its equations are written here and nowhere in the library.

use klasktron::{actuator::Run, recording::Split, units::Nanos};
use std::path::PathBuf;

/// Integration step (s).
const STEP: f64 = 1e-4;
/// Grid of the runs (s).
pub(crate) const DT: f64 = 0.02;

/// `tau dv/dt = gain u(t - delay) - v`, its slope held within `slew`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    pub(crate) gain: f64,
    pub(crate) tau: f64,
    pub(crate) delay: f64,
    /// m/s^2
    pub(crate) slew: f64,
}

/// A command that jumps at times that no sine has: held random levels (m/s).
fn level(run: u32, axis: usize, k: usize) -> f64 {
    let cell = (k / 9) as u64 * 2 + axis as u64 + 1000 * u64::from(run);
    let mixed = (cell ^ 0x9e37_79b9).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed >> 40) as f64 / (1u64 << 24) as f64 - 0.5) * 0.8
}

impl Drive {
    /// A run of `samples` samples; both axes are the same drive.
    pub(crate) fn run(&self, number: u32, samples: usize, split: Option<Split>) -> Run {
        let commands: Vec<[f64; 2]> =
            (0..samples).map(|k| [0, 1].map(|axis| level(number, axis, k))).collect();
        let axes = [0, 1].map(|axis| self.axis(&commands, axis));
        Run {
            path: PathBuf::from("drive"),
            file: 0,
            number,
            pattern: ["steps", "more_steps"][number as usize % 2].to_owned(),
            split,
            start: Nanos(u64::from(number) * 1_000_000_000_000),
            velocities: (0..samples).map(|k| [axes[0][k], axes[1][k]]).collect(),
            commands,
        }
    }

    fn axis(&self, commands: &[[f64; 2]], axis: usize) -> Vec<f64> {
        let per_sample = (DT / STEP).round() as usize;
        let late = (self.delay / STEP).round() as usize;
        let mut velocity = 0.0;
        let mut sampled = Vec::new();
        for step in 0..commands.len() * per_sample {
            if step % per_sample == 0 {
                sampled.push(velocity);
            }
            let at = step.saturating_sub(late) / per_sample;
            let slope = (self.gain * commands[at][axis] - velocity) / self.tau;
            velocity += STEP * slope.clamp(-self.slew, self.slew);
        }
        sampled
    }
}
