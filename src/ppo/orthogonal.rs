//! Orthogonal initialization (Saxe, McClelland and Ganguli, "Exact Solutions to the Nonlinear
//! Dynamics of Learning in Deep Linear Neural Networks", 2014), biases zero.
//!
//! A matrix of normal random numbers is orthonormalized along its shorter side by modified
//! Gram-Schmidt and multiplied by the gain. Double precision and plain loops give the same bytes
//! for a seed on every vector width.

use super::noise::{Noise, StepNoise};
use crate::nn::{Activation, Dense, Network};

/// Gain of hidden layers.
pub(super) const HIDDEN_GAIN: f32 = std::f32::consts::SQRT_2;
/// Gain of the means of actions: initial actions are noise around zero.
pub(super) const POLICY_GAIN: f32 = 0.01;
/// Gain of the value.
pub(super) const VALUE_GAIN: f32 = 1.0;

/// Number of outputs of a last layer and their gain.
pub(super) type Head = (usize, f32);

/// Network `inputs` - `hidden` - `heads`, each head orthogonal by itself.
pub(super) fn network(
    inputs: usize,
    hidden: &[usize],
    activation: Activation,
    heads: &[Head],
    (seed, name): (u64, &str),
) -> Network {
    let noise = Noise::new(seed, name);
    let mut layers: Vec<Dense> = Vec::new();
    let mut width = inputs;
    for (index, outputs) in hidden.iter().enumerate() {
        layers.push(dense(width, *outputs, HIDDEN_GAIN, noise.at(index as u64)));
        width = *outputs;
    }
    let mut last = Dense { inputs: width, outputs: 0, weight: Vec::new(), bias: Vec::new() };
    for (index, (outputs, gain)) in heads.iter().enumerate() {
        let head = dense(width, *outputs, *gain, noise.at((hidden.len() + index) as u64));
        last.outputs += outputs;
        last.weight.extend(head.weight);
        last.bias.extend(head.bias);
    }
    layers.push(last);
    Network { activation, layers }
}

fn dense(inputs: usize, outputs: usize, gain: f32, noise: StepNoise) -> Dense {
    let (short, long) = (inputs.min(outputs), inputs.max(outputs));
    let rows = orthonormal_rows(short, long, noise);
    let at = |output: usize, input: usize| {
        if outputs <= inputs { rows[output][input] } else { rows[input][output] }
    };
    let weight = (0..outputs)
        .flat_map(|output| (0..inputs).map(move |input| (output, input)))
        .map(|(output, input)| gain * at(output, input) as f32)
        .collect();
    Dense { inputs, outputs, weight, bias: vec![0.0; outputs] }
}

/// `count` orthonormal rows of length `width`, which is at least `count`.
fn orthonormal_rows(count: usize, width: usize, noise: StepNoise) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> = (0..count)
        .map(|row| {
            let pairs = (row * width..(row + 1) * width).map(|place| noise.pair(place as u64)[0]);
            pairs.map(f64::from).collect()
        })
        .collect();
    for index in 0..count {
        let (done, rest) = rows.split_at_mut(index);
        let row = &mut rest[0];
        for other in done {
            let along: f64 = row.iter().zip(other.iter()).map(|(a, b)| a * b).sum();
            row.iter_mut().zip(other.iter()).for_each(|(a, b)| *a -= along * b);
        }
        let norm = row.iter().map(|a| a * a).sum::<f64>().sqrt();
        row.iter_mut().for_each(|a| *a /= norm);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shorter_side_is_orthogonal_with_the_gain_as_length() {
        let network = network(20, &[256, 64], Activation::Elu, &[(2, 0.01), (1, 1.0)], (4, "net"));
        for (layer, gain) in network.layers.iter().zip([HIDDEN_GAIN, HIDDEN_GAIN]) {
            let by_output = layer.outputs <= layer.inputs;
            let count = layer.outputs.min(layer.inputs);
            let entry = |row: usize, place: usize| {
                let (output, input) = if by_output { (row, place) } else { (place, row) };
                f64::from(layer.weight[output * layer.inputs + input])
            };
            for (a, b) in [(0, 0), (count - 1, count - 1), (0, 1), (3, count - 2)] {
                let length = layer.outputs.max(layer.inputs);
                let product: f64 = (0..length).map(|i| entry(a, i) * entry(b, i)).sum();
                let expected = if a == b { f64::from(gain).powi(2) } else { 0.0 };
                assert!((product - expected).abs() < 1e-6, "{a} {b}: {product}");
            }
        }
        let last = &network.layers[2];
        assert_eq!((last.inputs, last.outputs), (64, 3));
        let length = |row: usize| {
            last.weight[64 * row..64 * (row + 1)].iter().map(|w| w * w).sum::<f32>().sqrt()
        };
        for (row, gain) in [0.01, 0.01, 1.0].into_iter().enumerate() {
            assert!((length(row) - gain).abs() < 1e-6 * (1.0 + gain), "{row}");
        }
    }
}
