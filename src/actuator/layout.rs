//! Layout of the network inputs: the order of past commands and velocities.

use crate::nn::Activation;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of velocity components: x and y.
pub const AXES: usize = 2;

/// Order and number of the inputs. Both layouts are newest first with x and y interleaved: `[u_k,
/// u_k-1, ...]`, then `[v_k, v_k-1, ...]`. The network predicts `v_k+1`. `u_k` is the command in
/// force from sample k to k + 1, `v_k` the velocity at sample k.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LayoutKind {
    /// As many velocities as commands: 40 inputs for 10 steps, as in the paper; ReLU.
    Klasktron,
    /// One velocity less: 38 inputs for 10 steps, as in the upstream repository; softsign.
    KlaskRl,
}

impl LayoutKind {
    /// Return the activation function of the layout.
    #[must_use]
    pub fn activation(self) -> Activation {
        match self {
            Self::Klasktron => Activation::Relu,
            Self::KlaskRl => Activation::Softsign,
        }
    }
}

impl fmt::Display for LayoutKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Klasktron => "klasktron",
            Self::KlaskRl => "klask-rl",
        })
    }
}

/// Layout with its history length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Order and number of the inputs.
    pub kind: LayoutKind,
    /// Number of commands in the history, at least 1 (2 for [`LayoutKind::KlaskRl`]).
    pub history_steps: usize,
}

impl Layout {
    /// Return the number of command inputs.
    #[must_use]
    pub fn command_inputs(self) -> usize {
        AXES * self.history_steps
    }

    /// Return the number of velocity inputs.
    #[must_use]
    pub fn velocity_inputs(self) -> usize {
        match self.kind {
            LayoutKind::Klasktron => AXES * self.history_steps,
            LayoutKind::KlaskRl => AXES * (self.history_steps - 1),
        }
    }

    /// Return the number of inputs of the network.
    #[must_use]
    pub fn inputs(self) -> usize {
        self.command_inputs() + self.velocity_inputs()
    }

    /// Fill the inputs for predicting sample `at + 1` of a run. Requires `at + 1 >= history_steps`.
    pub fn fill(
        self,
        input: &mut [f32],
        commands: &[[f64; 2]],
        velocities: &[[f64; 2]],
        at: usize,
    ) {
        let newest_first = |series: &[[f64; 2]], part: &mut [f32]| {
            for (age, pair) in part.chunks_exact_mut(AXES).enumerate() {
                let [x, y] = series[at - age];
                pair[0] = x as f32;
                pair[1] = y as f32;
            }
        };
        let (command_part, velocity_part) = input.split_at_mut(self.command_inputs());
        newest_first(commands, command_part);
        newest_first(velocities, velocity_part);
    }

    /// Shift the inputs by one sample: every input ages by one, the newest are put in front.
    pub fn advance(self, input: &mut [f32], command: [f32; 2], velocity: [f32; 2]) {
        let (command_part, velocity_part) = input.split_at_mut(self.command_inputs());
        for (part, newest) in [(command_part, command), (velocity_part, velocity)] {
            let kept = part.len().saturating_sub(AXES);
            part.copy_within(..kept, part.len() - kept);
            if let Some(front) = part.first_chunk_mut::<AXES>() {
                *front = newest;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(sign: f64) -> Vec<[f64; 2]> {
        (0..6).map(|k| [sign * f64::from(k), sign * (f64::from(k) + 0.5)]).collect()
    }

    #[test]
    fn the_newest_come_first_and_upstream_has_one_velocity_less() {
        let layout = Layout { kind: LayoutKind::KlaskRl, history_steps: 3 };
        let mut input = vec![0.0; layout.inputs()];
        layout.fill(&mut input, &series(1.0), &series(-1.0), 4);
        assert_eq!(input, [4.0, 4.5, 3.0, 3.5, 2.0, 2.5, -4.0, -4.5, -3.0, -3.5]);
        let ten = |kind| Layout { kind, history_steps: 10 }.inputs();
        assert_eq!((ten(LayoutKind::Klasktron), ten(LayoutKind::KlaskRl)), (40, 38));
    }

    #[test]
    fn advancing_equals_filling_one_sample_later() {
        for kind in [LayoutKind::Klasktron, LayoutKind::KlaskRl] {
            for history_steps in 2..5 {
                let layout = Layout { kind, history_steps };
                let (commands, velocities) = (series(1.0), series(-1.0));
                let mut moved = vec![0.0; layout.inputs()];
                layout.fill(&mut moved, &commands, &velocities, 4);
                layout.advance(&mut moved, [5.0, 5.5], [-5.0, -5.5]);
                let mut filled = vec![0.0; layout.inputs()];
                layout.fill(&mut filled, &commands, &velocities, 5);
                assert_eq!(moved, filled);
            }
        }
    }
}
