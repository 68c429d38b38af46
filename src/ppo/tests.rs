//! Tests of the learner as a whole: its gradient against finite differences, its determinism and
//! errors, and tasks with a known solution.

mod gradient;
mod promises;
mod tasks;

use super::{Learner, PpoSettings, Rollout, RolloutShape, Scratch, Spaces, StepIndex};
use crate::seed::Stream;
use std::num::NonZeroUsize;

fn threads(count: usize) -> NonZeroUsize {
    NonZeroUsize::new(count).unwrap()
}

/// Settings that are small and learn quickly.
fn small_settings() -> PpoSettings {
    PpoSettings { hidden: vec![16, 16], minibatch: 256, epochs: 4, ..PpoSettings::paper() }
}

const SPACES: Spaces = Spaces { observations: 3, actions: 2 };

/// A rollout of a synthetic environment in which `learner` acted: random observations, rewards for
/// actions near the first two of them, and occasional ends.
fn made_up_rollout(learner: &Learner, environments: usize, seed: u64) -> (Rollout, Vec<f32>) {
    const HORIZON: usize = 11;
    let mut rollout = Rollout::new(RolloutShape { horizon: HORIZON, environments, spaces: SPACES });
    let mut stream = Stream::new(seed, "environment");
    let mut scratch = Scratch::default();
    for (step, mut row) in rollout.whole().steps.into_iter().enumerate() {
        row.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-3.0, 5.0));
        let place = StepIndex { step: 1000 * seed + step as u64, first_environment: 0 };
        learner.act(place, &mut row, &mut scratch);
        for environment in 0..environments {
            let [a, x] = [row.actions[2 * environment], row.observations[3 * environment]];
            row.rewards[environment] = -(a - x).powi(2) + stream.uniform_f32(-0.1, 0.1);
            row.ends[environment] = match stream.below(10) {
                0 => super::End::Terminal,
                1 => super::End::Truncated,
                _ => super::End::Running,
            };
            row.final_values[environment] = stream.uniform_f32(-1.0, 1.0);
        }
    }
    let last_values = (0..environments).map(|_| stream.uniform_f32(-1.0, 1.0)).collect();
    (rollout, last_values)
}
