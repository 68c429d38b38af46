//! Fitted network in physical units: one-step and free-running prediction.

use super::layout::{AXES, Layout};
use super::run::Run;
use crate::nn::{Network, Stack, Tape};

/// Model that predicts velocity from commands.
pub trait VelocityModel: Sync {
    /// Name in results: `network`, `arx`, `fopdt`, `ideal`.
    fn name(&self) -> &'static str;

    /// Simulate free-running. From each of `starts` (sample numbers of `run`), the model gets the
    /// measurements up to that sample and then only the commands. It predicts the `steps` samples
    /// that follow. `start + steps` lies within the run, with at least `history` samples before.
    ///
    /// Returns `[starts][steps]` velocities (m/s).
    fn simulate(&self, run: &Run, starts: &[usize], steps: usize) -> Vec<[f64; AXES]>;
}

/// Network with the layout of its inputs; inputs and outputs in m/s.
#[derive(Debug, Clone)]
pub struct ActuatorNetwork {
    /// Order of the inputs.
    pub layout: Layout,
    /// Weights; inputs as [`Layout`], output the next velocity (m/s).
    pub network: Network,
    stack: Stack,
}

impl ActuatorNetwork {
    /// Create a network for `layout`; the shapes must agree.
    #[must_use]
    pub fn new(layout: Layout, network: Network) -> Self {
        assert_eq!((network.inputs(), network.outputs()), (layout.inputs(), AXES), "shape");
        let stack = Stack::new(&network);
        Self { layout, network, stack }
    }
}

impl VelocityModel for ActuatorNetwork {
    fn name(&self) -> &'static str {
        "network"
    }

    fn simulate(&self, run: &Run, starts: &[usize], steps: usize) -> Vec<[f64; AXES]> {
        let inputs = self.layout.inputs();
        let mut tape = Tape::default();
        tape.x.resize(starts.len() * inputs, 0.0);
        for (row, start) in tape.x.chunks_exact_mut(inputs).zip(starts) {
            self.layout.fill(row, &run.commands, &run.velocities, *start);
        }
        let mut predicted = vec![[0.0; AXES]; starts.len() * steps];
        for step in 0..steps {
            self.stack.forward(&mut tape);
            for (index, start) in starts.iter().enumerate() {
                let velocity = [tape.y[index * AXES], tape.y[index * AXES + 1]];
                predicted[index * steps + step] = velocity.map(f64::from);
                let [ux, uy] = run.commands[start + step + 1];
                let row = &mut tape.x[index * inputs..(index + 1) * inputs];
                self.layout.advance(row, [ux as f32, uy as f32], velocity);
            }
        }
        predicted
    }
}
