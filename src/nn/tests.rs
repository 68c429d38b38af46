//! Tests of the fast path against the plain one, and of gradients against finite differences.

use super::{Activation, Adam, Dense, InputGradient, Network, Stack, Tape, Trainer, padded};
use crate::seed::Stream;

/// 3-2-1 with weights that are exact in binary.
pub(super) fn small(activation: Activation) -> Network {
    let hidden = Dense {
        inputs: 3,
        outputs: 2,
        weight: vec![1.0, -0.5, 0.25, -2.0, 0.5, 4.0],
        bias: vec![0.5, -0.25],
    };
    let out = Dense { inputs: 2, outputs: 1, weight: vec![2.0, -1.0], bias: vec![0.125] };
    Network { activation, layers: vec![hidden, out] }
}

fn random_network(sizes: &[usize], activation: Activation, seed: u64) -> Network {
    let mut stream = Stream::new(seed, "network");
    let layers = sizes
        .windows(2)
        .map(|pair| {
            let bound = 1.5 / (pair[0] as f32).sqrt();
            let mut draw = |count: usize| -> Vec<f32> {
                (0..count).map(|_| stream.uniform_f32(-bound, bound)).collect()
            };
            let (inputs, outputs) = (pair[0], pair[1]);
            Dense { inputs, outputs, weight: draw(inputs * outputs), bias: draw(outputs) }
        })
        .collect();
    Network { activation, layers }
}

fn random_inputs(count: usize, seed: u64) -> Vec<f32> {
    let mut stream = Stream::new(seed, "inputs");
    (0..count).map(|_| stream.uniform_f32(-1.0, 1.0)).collect()
}

fn tape_of(inputs: Vec<f32>) -> Tape {
    Tape { x: inputs, ..Tape::default() }
}

/// Shapes that exercise every tile: widths below, at and above one vector and one block of depth,
/// batches with 0 to 5 remaining rows.
const SHAPES: [(&[usize], usize); 7] = [
    (&[40, 64, 64, 64, 2], 256),
    (&[38, 64, 64, 64, 2], 7),
    (&[4, 32, 32, 32, 2], 11),
    (&[40, 128, 128, 2], 66),
    (&[5, 17, 2], 1),
    (&[3, 80, 100, 3], 10),
    (&[9, 20, 48, 1], 5),
];

#[test]
fn the_kernels_agree_with_the_plain_forward_pass() {
    for activation in Activation::ALL {
        for (sizes, batch) in SHAPES {
            let network = random_network(sizes, activation, 1);
            let stack = Stack::new(&network);
            assert_eq!(stack.network(), network, "laying out loses nothing");
            let mut tape = tape_of(random_inputs(batch * sizes[0], 2));
            stack.forward(&mut tape);
            let plain = tape.x.chunks_exact(sizes[0]).flat_map(|x| network.forward(x));
            for (fast, plain) in tape.y.iter().zip(plain) {
                assert!((fast - plain).abs() < 1e-5, "{sizes:?} {activation:?}: {fast} {plain}");
            }
        }
    }
}

#[test]
fn activations_are_accurate_over_their_whole_range() {
    // One hidden unit passes z on, the output its activation.
    for (activation, reference) in [
        (Activation::Elu, (|z: f64| if 0.0 < z { z } else { z.exp_m1() }) as fn(f64) -> f64),
        (Activation::Tanh, f64::tanh),
    ] {
        let one = |weight| Dense { inputs: 1, outputs: 1, weight: vec![weight], bias: vec![0.0] };
        let stack = Stack::new(&Network { activation, layers: vec![one(1.0), one(1.0)] });
        let exponents = (-300..=76).map(|i| 2.0f32.powf(i as f32 / 10.0));
        let numbers: Vec<f32> = exponents.flat_map(|x| [x, -x]).chain([0.0, -1e4, 1e4]).collect();
        let mut tape = tape_of(numbers);
        stack.forward(&mut tape);
        for (z, found) in tape.x.iter().zip(&tape.y) {
            let expected = reference(f64::from(*z));
            let error = (f64::from(*found) - expected).abs();
            assert!(error <= 3e-7 * expected.abs(), "{activation:?} {z}: {found} {expected}");
        }
    }
}

/// Loss `sum of c y` in double precision, with one parameter or input changed.
fn loss(network: &Network, inputs: &[f32], weights_of_outputs: &[f32]) -> f64 {
    let outputs = inputs.chunks_exact(network.inputs()).flat_map(|x| forward_f64(network, x));
    outputs.zip(weights_of_outputs).map(|(y, c)| y * f64::from(*c)).sum()
}

/// [`Network::forward`] in double precision, so that finite differences are accurate.
fn forward_f64(network: &Network, input: &[f32]) -> Vec<f64> {
    let last = network.layers.len() - 1;
    let mut values: Vec<f64> = input.iter().map(|x| f64::from(*x)).collect();
    for (index, layer) in network.layers.iter().enumerate() {
        values = layer
            .weight
            .chunks_exact(layer.inputs)
            .zip(&layer.bias)
            .map(|(row, bias)| {
                let products = row.iter().zip(&values).map(|(w, x)| f64::from(*w) * x);
                let z = f64::from(*bias) + products.sum::<f64>();
                match network.activation {
                    _ if index == last => z,
                    Activation::Relu => z.max(0.0),
                    Activation::Softsign => z / (1.0 + z.abs()),
                    Activation::Elu => {
                        if 0.0 < z {
                            z
                        } else {
                            z.exp() - 1.0
                        }
                    }
                    Activation::Tanh => z.tanh(),
                }
            })
            .collect();
    }
    values
}

/// Central difference of the loss in one `f32` that `move_by` changes.
fn slope(mut loss_moved_by: impl FnMut(f32) -> f64) -> f64 {
    const STEP: f32 = 1.0 / 1024.0;
    (loss_moved_by(STEP) - loss_moved_by(-STEP)) / (2.0 * f64::from(STEP))
}

#[test]
fn gradients_agree_with_finite_differences() {
    for (activation, tolerance) in [
        (Activation::Softsign, 2e-3),
        (Activation::Relu, 4e-2),
        (Activation::Elu, 2e-3),
        (Activation::Tanh, 2e-3),
    ] {
        for (sizes, batch) in SHAPES.map(|(sizes, batch)| (sizes, batch.min(13))) {
            check_gradients(&random_network(sizes, activation, 3), batch, tolerance);
        }
    }
}

fn check_gradients(network: &Network, batch: usize, tolerance: f64) {
    let inputs = random_inputs(batch * network.inputs(), 4);
    let dy = random_inputs(batch * network.outputs(), 5);
    let mut trainer = Trainer::new(network, Adam::default());
    let mut tape = tape_of(inputs.clone());
    trainer.forward(&mut tape);
    let mut dx = Vec::new();
    trainer.backward(&tape, &dy, InputGradient::Compute, &mut dx);
    let close = |found: f64, expected: f64, what: &str| {
        let scale = 1.0 + expected.abs();
        assert!((found - expected).abs() < tolerance * scale, "{what}: {found} {expected}");
    };
    for index in (0..inputs.len()).step_by(1 + inputs.len() / 9) {
        let expected = slope(|step| {
            let mut moved = inputs.clone();
            moved[index] += step;
            loss(network, &moved, &dy)
        });
        let (row, column) = (index / network.inputs(), index % network.inputs());
        close(f64::from(dx[row * padded(network.inputs()) + column]), expected, "input");
    }
    let gradient = trainer.gradient();
    for (layer, found) in gradient.layers.iter().enumerate() {
        for index in (0..found.weight.len()).step_by(1 + found.weight.len() / 7) {
            let expected = slope(|step| {
                let mut moved = network.clone();
                moved.layers[layer].weight[index] += step;
                loss(&moved, &inputs, &dy)
            });
            close(f64::from(found.weight[index]), expected, "weight");
        }
        for index in (0..found.bias.len()).step_by(1 + found.bias.len() / 3) {
            let expected = slope(|step| {
                let mut moved = network.clone();
                moved.layers[layer].bias[index] += step;
                loss(&moved, &inputs, &dy)
            });
            close(f64::from(found.bias[index]), expected, "bias");
        }
    }
}

#[test]
fn adam_follows_the_algorithm_of_the_paper() {
    let network = random_network(&[3, 16, 2], Activation::Softsign, 7);
    let adam = Adam::default();
    let mut trainer = Trainer::new(&network, adam);
    let (mut tape, mut dx) = (tape_of(random_inputs(3 * 4, 8)), Vec::new());
    let dy = random_inputs(2 * 4, 9);
    let mut expected = f64::from(network.layers[0].weight[5]);
    let (mut m, mut v) = (0.0, 0.0);
    for t in 1..=20 {
        trainer.forward(&mut tape);
        trainer.backward(&tape, &dy, InputGradient::Skip, &mut dx);
        let g = f64::from(trainer.gradient().layers[0].weight[5]);
        m = 0.9 * m + 0.1 * g;
        v = 0.999 * v + 0.001 * g * g;
        let (m_hat, v_hat) = (m / (1.0 - 0.9f64.powi(t)), v / (1.0 - 0.999f64.powi(t)));
        expected -= 0.01 * m_hat / (v_hat.sqrt() + 1e-8);
        trainer.update(0.01);
        let found = f64::from(trainer.stack().network().layers[0].weight[5]);
        assert!((found - expected).abs() < 1e-5, "step {t}: {found} {expected}");
    }
}

#[test]
fn training_continues_from_its_state_with_the_same_bytes() {
    let network = random_network(&[5, 17, 20, 2], Activation::Elu, 21);
    let adam = Adam { epsilon: 1e-5, ..Adam::default() };
    let mut trainer = Trainer::new(&network, adam);
    let mut tape = tape_of(random_inputs(5 * 9, 22));
    let dy = random_inputs(2 * 9, 23);
    let step = |trainer: &mut Trainer, tape: &mut Tape| {
        trainer.forward(tape);
        trainer.backward(tape, &dy, InputGradient::Skip, &mut Vec::new());
        trainer.update(0.01);
    };
    for _ in 0..3 {
        step(&mut trainer, &mut tape);
    }
    let mut again = Trainer::resume(&trainer.state(), adam);
    step(&mut trainer, &mut tape);
    step(&mut again, &mut tape);
    assert_eq!(trainer.state(), again.state());
    // Without the moments the training would diverge from it.
    let mut fresh = Trainer::new(&trainer.stack().network(), adam);
    step(&mut trainer, &mut tape);
    step(&mut fresh, &mut tape);
    assert_ne!(trainer.state().network, fresh.state().network);
}

#[test]
fn a_scaled_update_is_one_with_a_scaled_gradient() {
    let network = random_network(&[4, 16, 1], Activation::Tanh, 24);
    let mut trainer = Trainer::new(&network, Adam::default());
    let mut by_hand = trainer.clone();
    let gradient = random_inputs(trainer.parameter_count(), 25);
    for (place, value) in trainer.gradient_mut().iter_mut().zip(&gradient) {
        *place = *value;
    }
    for (place, value) in by_hand.gradient_mut().iter_mut().zip(&gradient) {
        *place = 0.25 * value;
    }
    trainer.update_scaled(0.01, 0.25);
    by_hand.update(0.01);
    assert_eq!(trainer.state(), by_hand.state());
}

#[test]
fn padding_never_wakes_up() {
    // 17 units are padded to 32; after training, laying out the plain network again must give the same outputs.
    let network = random_network(&[5, 17, 17, 2], Activation::Relu, 11);
    let mut trainer = Trainer::new(&network, Adam::default());
    let (mut tape, mut dx) = (tape_of(random_inputs(5 * 9, 12)), Vec::new());
    let dy = random_inputs(2 * 9, 13);
    for _ in 0..50 {
        trainer.forward(&mut tape);
        trainer.backward(&tape, &dy, InputGradient::Skip, &mut dx);
        trainer.update(0.01);
    }
    trainer.forward(&mut tape);
    let trained = tape.y.clone();
    Stack::new(&trainer.stack().network()).forward(&mut tape);
    assert_eq!(trained, tape.y);
}
