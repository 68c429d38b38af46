//! Generalised advantage estimation (Schulman et al., "High-Dimensional Continuous Control Using
//! Generalized Advantage Estimation", 2016, equations 11 and 16).
//!
//! `delta_t = r_t + gamma v' - V(s_t)` and `A_t = delta_t + gamma lambda A_(t+1)`. `v'` is
//! `V(s_(t+1))` while the episode runs, 0 at a terminal end, and the value of the last observation
//! at a truncated one (Pardo et al., "Time Limits in Reinforcement Learning", 2018). `A_(t+1)`
//! counts only while the episode runs. The critic's target is `A_t + V(s_t)`.

use super::{End, Rollout};

/// Advantages and targets, `[horizon][environment]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Advantages {
    /// `A_t`, in units of reward.
    pub advantages: Vec<f32>,
    /// Value targets of the critic, in units of reward.
    pub targets: Vec<f32>,
}

impl Advantages {
    /// Compute advantages and targets of `rollout`; `last_values` `[environment]` are the values of
    /// the observations after its last step.
    pub fn compute(&mut self, rollout: &Rollout, last_values: &[f32], gamma: f32, lambda: f32) {
        let environments = rollout.shape.environments;
        let samples = rollout.shape.samples();
        self.advantages.resize(samples, 0.0);
        self.targets.resize(samples, 0.0);
        let mut next_values = last_values;
        let mut next_advantages = vec![0.0; environments];
        for step in (0..rollout.shape.horizon).rev() {
            let range = step * environments..(step + 1) * environments;
            let values = &rollout.values[range.clone()];
            let rewards = &rollout.rewards[range.clone()];
            let ends = &rollout.ends[range.clone()];
            let final_values = &rollout.final_values[range.clone()];
            let advantages = &mut self.advantages[range.clone()];
            let targets = &mut self.targets[range];
            for env in 0..environments {
                let (next_value, carried) = match ends[env] {
                    End::Running => (next_values[env], next_advantages[env]),
                    End::Terminal => (0.0, 0.0),
                    End::Truncated => (final_values[env], 0.0),
                };
                let delta = rewards[env] + gamma * next_value - values[env];
                let advantage = delta + gamma * lambda * carried;
                advantages[env] = advantage;
                targets[env] = advantage + values[env];
                next_advantages[env] = advantage;
            }
            next_values = values;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ppo::{RolloutShape, Spaces},
        seed::Stream,
    };

    fn rollout(horizon: usize, environments: usize) -> Rollout {
        let spaces = Spaces { observations: 1, actions: 1 };
        Rollout::new(RolloutShape { horizon, environments, spaces })
    }

    #[test]
    fn three_steps_by_hand() {
        // gamma 0.5, lambda 0.5; V = 1, 2, 4, after the end 8; r = 1 each.
        // Running: d2 = 1 + 4 - 4 = 1, d1 = 1 + 2 - 2 = 1, d0 = 1 + 1 - 1 = 1, so
        //   A2 = 1, A1 = 1 + 1/4 = 1.25, A0 = 1 + 1.25 / 4 = 1.3125.
        // Terminal at step 1: d1 = 1 - 2 = -1, A1 = -1, A0 = 1 - 1/4 = 0.75; A2 = 1.
        // Truncated at step 1 with final value 6: d1 = 1 + 3 - 2 = 2, A1 = 2, A0 = 1.5; A2 = 1.
        let mut rollout = rollout(3, 3);
        rollout.values = [1.0, 2.0, 4.0].into_iter().flat_map(|v| [v; 3]).collect();
        rollout.rewards = vec![1.0; 9];
        rollout.ends[4] = End::Terminal;
        rollout.ends[5] = End::Truncated;
        rollout.final_values[5] = 6.0;
        // Not read where the episode runs or is terminal.
        rollout.final_values[4] = 1e9;
        rollout.final_values[0] = 1e9;
        let mut found = Advantages::default();
        found.compute(&rollout, &[8.0; 3], 0.5, 0.5);
        assert_eq!(found.advantages, [1.3125, 0.75, 1.5, 1.25, -1.0, 2.0, 1.0, 1.0, 1.0]);
        assert_eq!(found.targets, [2.3125, 1.75, 2.5, 3.25, 1.0, 4.0, 5.0, 5.0, 5.0]);
    }

    /// Definition: the sum of discounted temporal differences up to the episode's end.
    fn direct(rollout: &Rollout, last_values: &[f32], start: usize, env: usize) -> f64 {
        const GAMMA: f64 = 0.99;
        const LAMBDA: f64 = 0.95;
        let shape = rollout.shape;
        let value = |step: usize| match step == shape.horizon {
            true => f64::from(last_values[env]),
            false => f64::from(rollout.values[step * shape.environments + env]),
        };
        let mut sum = 0.0;
        for step in start..shape.horizon {
            let at = step * shape.environments + env;
            let after = match rollout.ends[at] {
                End::Running => value(step + 1),
                End::Terminal => 0.0,
                End::Truncated => f64::from(rollout.final_values[at]),
            };
            let delta = f64::from(rollout.rewards[at]) + GAMMA * after - value(step);
            sum += (GAMMA * LAMBDA).powi((step - start) as i32) * delta;
            if rollout.ends[at] != End::Running {
                break;
            }
        }
        sum
    }

    #[test]
    fn the_recursion_is_the_sum_it_stands_for() {
        let mut rollout = rollout(40, 7);
        let mut stream = Stream::new(5, "rollout");
        for values in [&mut rollout.values, &mut rollout.rewards, &mut rollout.final_values] {
            values.iter_mut().for_each(|v| *v = stream.uniform_f32(-2.0, 2.0));
        }
        for end in &mut rollout.ends {
            *end = match stream.below(12) {
                0 => End::Terminal,
                1 => End::Truncated,
                _ => End::Running,
            };
        }
        let last_values: Vec<f32> = (0..7).map(|_| stream.uniform_f32(-2.0, 2.0)).collect();
        let mut found = Advantages::default();
        found.compute(&rollout, &last_values, 0.99, 0.95);
        for step in 0..40 {
            for env in 0..7 {
                let at = step * 7 + env;
                let expected = direct(&rollout, &last_values, step, env);
                assert!((f64::from(found.advantages[at]) - expected).abs() < 1e-4, "{step} {env}");
                let target = expected + f64::from(rollout.values[at]);
                assert!((f64::from(found.targets[at]) - target).abs() < 1e-4, "{step} {env}");
            }
        }
    }
}
