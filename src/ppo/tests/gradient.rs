//! Gradient of the whole loss against central differences of an independent loss in double
//! precision, which shares no line with the learner's.

#![expect(clippy::needless_range_loop, reason = "indices stand as in the formulas")]

use super::SPACES;
use crate::{
    nn::{Activation, Network, Standardizer, TrainerState},
    ppo::{
        Gaussian, NetworkLayout, Normalization, PpoSettings, Rollout, RolloutShape, ValueLoss,
        batch::{Batch, Units},
        loss::{LossSums, LossTerms},
        model::{Deviations, Model, Scratch},
    },
    seed::Stream,
};
use std::num::NonZeroUsize;

const SAMPLES: usize = 150;
const ADVANTAGE_MEAN: f32 = 0.2;
const ADVANTAGE_SCALE: f32 = 1.5;
/// Weight of the imitation loss.
const IMITATION_COEF: f64 = 0.6;
const OLD_LOG_DEVIATIONS: [f32; 2] = [-0.4, -0.1];

/// Parameters in double precision.
#[derive(Clone)]
struct Plain {
    networks: Vec<Network64>,
    log_deviations: Vec<f64>,
}

#[derive(Clone)]
struct Network64 {
    activation: Activation,
    /// `(inputs, weights, biases)`
    layers: Vec<(usize, Vec<f64>, Vec<f64>)>,
}

impl Network64 {
    fn new(network: &Network) -> Self {
        let wide = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect();
        let layers =
            network.layers.iter().map(|l| (l.inputs, wide(&l.weight), wide(&l.bias))).collect();
        Self { activation: network.activation, layers }
    }

    fn forward(&self, x: &[f32]) -> Vec<f64> {
        let mut values: Vec<f64> = x.iter().map(|v| f64::from(*v)).collect();
        for (index, (inputs, weights, biases)) in self.layers.iter().enumerate() {
            let rows = weights.chunks_exact(*inputs).zip(biases);
            let sums = rows
                .map(|(row, bias)| bias + row.iter().zip(&values).map(|(w, x)| w * x).sum::<f64>());
            values = sums
                .map(|z| match self.activation {
                    _ if index + 1 == self.layers.len() => z,
                    Activation::Tanh => z.tanh(),
                    Activation::Elu => {
                        if 0.0 < z {
                            z
                        } else {
                            z.exp() - 1.0
                        }
                    }
                    Activation::Relu | Activation::Softsign => unreachable!("not used here"),
                })
                .collect();
        }
        values
    }
}

/// Loss of the minibatch as defined in the papers, mean over samples.
fn plain_loss(settings: &PpoSettings, plain: &Plain, rollout: &Rollout, targets: &[f32]) -> f64 {
    let clip = f64::from(settings.clip_coef);
    let mut sum = 0.0;
    for sample in 0..SAMPLES {
        let x = &rollout.observations[3 * sample..3 * sample + 3];
        let outputs: Vec<f64> = plain.networks.iter().flat_map(|n| n.forward(x)).collect();
        let (means, v) = (&outputs[..2], outputs[2]);
        let mut log_probability = 0.0;
        for action in 0..2 {
            let deviation = plain.log_deviations[action].exp();
            let a = f64::from(rollout.actions[2 * sample + action]);
            let density = (-0.5 * ((a - means[action]) / deviation).powi(2)).exp()
                / (deviation * (2.0 * std::f64::consts::PI).sqrt());
            log_probability += density.ln();
        }
        let ratio = (log_probability - f64::from(rollout.log_probabilities[sample])).exp();
        let advantage = f64::from(rollout.rewards[sample] - ADVANTAGE_MEAN) * 1.5;
        sum -= (ratio * advantage).min(ratio.clamp(1.0 - clip, 1.0 + clip) * advantage);
        let (old, target) = (f64::from(rollout.values[sample]), f64::from(targets[sample]));
        let held = old + (v - old).clamp(-clip, clip);
        let squared = (v - target).powi(2);
        let value_loss = match settings.value_loss {
            ValueLoss::Squared => squared,
            ValueLoss::Clipped => squared.max((held - target).powi(2)),
        };
        sum += 0.5 * f64::from(settings.value_coef) * value_loss;
        let excess = means.iter().map(|mean| (mean.abs() - 1.1).max(0.0).powi(2)).sum::<f64>();
        sum += f64::from(settings.bounds_coef) * excess;
        let demonstration = &rollout.demonstrations[2 * sample..2 * sample + 2];
        let squares = means.iter().zip(demonstration).map(|(m, d)| (m - f64::from(*d)).powi(2));
        sum += 0.5 * IMITATION_COEF * squares.sum::<f64>();
    }
    let entropy: f64 = plain
        .log_deviations
        .iter()
        .map(|log| log + 0.5 * (2.0 * std::f64::consts::PI * std::f64::consts::E).ln())
        .sum();
    sum / SAMPLES as f64 - f64::from(settings.entropy_coef) * entropy
}

/// A model whose means sometimes exceed the bounds, from weights that are not orthogonal.
fn model(settings: &PpoSettings) -> Model {
    let (mut policy, mut critic, _) = Model::new(settings, SPACES, 1).parts();
    let mut stream = Stream::new(2, "weights");
    for state in std::iter::once(&mut policy).chain(critic.as_mut()) {
        for layer in &mut state.network.layers {
            layer.weight.iter_mut().for_each(|w| *w = stream.uniform_f32(-0.6, 0.6));
            layer.bias.iter_mut().for_each(|w| *w = stream.uniform_f32(-0.3, 0.3));
        }
    }
    let deviations =
        Deviations { logarithms: vec![-0.3, -0.2], moment1: vec![0.0; 2], moment2: vec![0.0; 2] };
    Model::resume(settings, (&policy, critic.as_ref()), &deviations)
}

fn plain(model: &Model) -> Plain {
    let (policy, critic, deviations) = model.parts();
    let states = std::iter::once(&policy).chain(critic.as_ref());
    Plain {
        networks: states.map(|state: &TrainerState| Network64::new(&state.network)).collect(),
        log_deviations: deviations.logarithms.iter().map(|v| f64::from(*v)).collect(),
    }
}

/// Samples on both sides of every clip, away from the kinks; the rewards hold the advantages.
fn samples(plain: &Plain) -> (Rollout, Vec<f32>) {
    let shape = RolloutShape { horizon: 1, environments: SAMPLES, spaces: SPACES };
    let mut rollout = Rollout::new(shape);
    let mut stream = Stream::new(3, "samples");
    let mut targets = Vec::new();
    rollout.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-2.0, 2.0));
    rollout.demonstrations.iter_mut().for_each(|a| *a = stream.uniform_f32(-1.0, 1.0));
    for sample in 0..SAMPLES {
        let x = &rollout.observations[3 * sample..3 * sample + 3];
        let outputs: Vec<f64> = plain.networks.iter().flat_map(|n| n.forward(x)).collect();
        let mut log_probability = 0.0;
        for action in 0..2 {
            let deviation = plain.log_deviations[action].exp();
            let z = f64::from(stream.uniform_f32(-2.0, 2.0));
            rollout.actions[2 * sample + action] = (outputs[action] + deviation * z) as f32;
            rollout.means[2 * sample + action] = outputs[action] as f32 + 0.1;
            log_probability -= 0.5 * z * z + deviation.ln() + 0.918_938_533_204_672_8;
        }
        // Ratios of 0.5, 0.9, 1.1 and 2 with advantages of both signs.
        let ratio = [0.5f64, 0.9, 1.1, 2.0][sample % 4];
        rollout.log_probabilities[sample] = (log_probability - ratio.ln()) as f32;
        rollout.rewards[sample] = [-1.0, 1.0][sample / 4 % 2] * stream.uniform_f32(0.5, 1.5);
        // Values that moved less or more than the clip, towards the target or away from it.
        let moved = [-0.5f32, -0.1, 0.1, 0.5][sample / 8 % 4];
        rollout.values[sample] = outputs[2] as f32 - moved;
        targets.push(rollout.values[sample] + stream.uniform_f32(-1.0, 1.0));
    }
    (rollout, targets)
}

#[test]
fn the_gradient_of_the_whole_loss_agrees_with_finite_differences() {
    let options = [
        (NetworkLayout::Separate, Activation::Tanh, ValueLoss::Clipped),
        (NetworkLayout::Shared, Activation::Elu, ValueLoss::Clipped),
        (NetworkLayout::Shared, Activation::Tanh, ValueLoss::Squared),
        (NetworkLayout::Separate, Activation::Elu, ValueLoss::Squared),
    ];
    for (layout, activation, value_loss) in options {
        check(&PpoSettings {
            layout,
            activation,
            value_loss,
            hidden: vec![18, 7],
            value_coef: 0.7,
            entropy_coef: 0.03,
            bounds_coef: 0.2,
            observations: Normalization::Off,
            ..PpoSettings::paper()
        });
    }
}

fn check(settings: &PpoSettings) {
    let mut model = model(settings);
    let plain = plain(&model);
    let (rollout, targets) = samples(&plain);
    let units = Units {
        advantages: &rollout.rewards,
        targets: &targets,
        observations: &Standardizer::identity(3),
        values: &Standardizer::identity(1),
        reflection: None,
        is_demonstrated: true,
    };
    let mut batch = Batch::default();
    batch.fill(&rollout, &units, (NonZeroUsize::MIN, 1)).unwrap();
    let old = Gaussian::new(&OLD_LOG_DEVIATIONS);
    let terms = LossTerms {
        advantage_mean: ADVANTAGE_MEAN,
        advantage_scale: ADVANTAGE_SCALE,
        weight: (SAMPLES as f32).recip(),
        imitation_coef: IMITATION_COEF as f32,
        ..LossTerms::new(settings, model.gaussian(), old)
    };
    let mut gradient = vec![0.0; model.parameter_count()];
    let mut sums = LossSums::default();
    let mut scratch = Scratch::default();
    for index in 0..SAMPLES as u32 {
        batch.observe(index, &mut scratch.policy.x);
    }
    let all = (0..SAMPLES as u32).map(|index| batch.sample(index));
    model.accumulate(&terms, all, (&mut gradient, &mut sums), &mut scratch);

    // The losses themselves.
    let mean = |sum: f64| sum / SAMPLES as f64;
    let found = mean(sums.policy)
        + f64::from(settings.value_coef) * mean(sums.value)
        + f64::from(settings.bounds_coef) * mean(sums.bounds)
        + IMITATION_COEF * mean(sums.imitation)
        - f64::from(settings.entropy_coef * model.gaussian().entropy());
    let loss = |plain: &Plain| plain_loss(settings, plain, &rollout, &targets);
    assert!((found - loss(&plain)).abs() < 1e-5, "{found} {}", loss(&plain));
    // Half of the ratios are outside the clip range.
    assert!((mean(sums.clipped) - 0.5).abs() < 0.01);
    assert!(0.0 < sums.bounds, "some means exceed the bounds");

    let differences = Differences { plain: &plain, loss: &loss };
    let [policy, critic] = model.gradients_mut();
    let (first, second) = gradient.split_at(policy.len());
    policy.copy_from_slice(first);
    critic.copy_from_slice(second);
    for (network, gradient) in model.gradients().iter().enumerate() {
        for (layer, found) in gradient.layers.iter().enumerate() {
            for (index, found) in found.weight.iter().enumerate().step_by(5) {
                let place = |p: &mut Plain, by| p.networks[network].layers[layer].1[index] += by;
                differences.agree(f64::from(*found), place, "weight");
            }
            for (index, found) in found.bias.iter().enumerate() {
                let place = |p: &mut Plain, by| p.networks[network].layers[layer].2[index] += by;
                differences.agree(f64::from(*found), place, "bias");
            }
        }
    }
    for action in 0..2 {
        let found = sums.log_deviation_slopes[action] - f64::from(settings.entropy_coef);
        differences.agree(found, |p, by| p.log_deviations[action] += by, "deviation");
    }
}

struct Differences<'a> {
    plain: &'a Plain,
    loss: &'a dyn Fn(&Plain) -> f64,
}

impl Differences<'_> {
    fn agree(&self, found: f64, move_by: impl Fn(&mut Plain, f64), what: &str) {
        const STEP: f64 = 1e-6;
        let moved = |by| {
            let mut plain = self.plain.clone();
            move_by(&mut plain, by);
            (self.loss)(&plain)
        };
        let expected = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
        let scale = 0.05 + expected.abs();
        assert!((found - expected).abs() < 1e-4 * scale, "{what}: {found} {expected}");
    }
}
