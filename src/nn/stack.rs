//! Network in the memory layout of the kernels: padded, contiguous, ready for batches.

use super::{
    kernel::{self, Epilogue, Product, padded},
    network::{Activation, Dense, Network},
};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Largest number of outputs of a network; the narrow last layer has its own kernel.
pub const MAX_OUTPUTS: usize = 4;

/// Location of one layer in the flat parameter vector.
#[derive(Debug, Clone)]
pub(super) struct Span {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// Number of floats from one row of `weights` to the next: padded outputs of a hidden layer,
    /// padded inputs of the last.
    pub(super) stride: usize,
    /// Hidden: `[inputs][stride]`. Last: `[outputs][stride]`.
    pub(super) weights: Range<usize>,
    pub(super) bias: Range<usize>,
}

/// Parameters of a network in one flat vector, with the padding of the kernels.
#[derive(Debug, Clone)]
pub struct Stack {
    pub(super) activation: Activation,
    pub(super) hidden: Vec<Span>,
    pub(super) last: Span,
    pub(super) values: Vec<f32>,
}

/// Intermediate values of a forward pass for the backward pass; reused from batch to batch.
#[derive(Debug, Clone, Default)]
pub struct Tape {
    /// Inputs, `[batch][inputs]`; filled by the caller.
    pub x: Vec<f32>,
    /// Activations of each hidden layer, `[batch][padded width]`.
    pub(super) activations: Vec<Vec<f32>>,
    /// Outputs, `[batch][outputs]`.
    pub y: Vec<f32>,
}

impl Stack {
    /// Lay out `network`, with at least one hidden layer and at most [`MAX_OUTPUTS`] outputs.
    ///
    /// # Panics
    /// When the network has another shape.
    #[must_use]
    pub fn new(network: &Network) -> Self {
        let (last, hidden) = network.layers.split_last().expect("a network has layers");
        assert!(!hidden.is_empty() && last.outputs <= MAX_OUTPUTS, "a hidden layer, few outputs");
        let mut stack = Self {
            activation: network.activation,
            hidden: Vec::new(),
            last: Span { inputs: 0, outputs: 0, stride: 0, weights: 0..0, bias: 0..0 },
            values: Vec::new(),
        };
        for layer in hidden {
            let span = stack.add_span(layer, layer.inputs, padded(layer.outputs));
            stack.fill(layer, &span, |row, column| column * span.stride + row);
            stack.hidden.push(span);
        }
        stack.last = stack.add_span(last, last.outputs, padded(last.inputs));
        let span = stack.last.clone();
        stack.fill(last, &span, |row, column| row * span.stride + column);
        stack
    }

    fn add_span(&mut self, layer: &Dense, rows: usize, stride: usize) -> Span {
        let start = self.values.len();
        let bias = start + rows * stride;
        let end = bias + padded(layer.outputs);
        self.values.resize(end, 0.0);
        Span {
            inputs: layer.inputs,
            outputs: layer.outputs,
            stride,
            weights: start..bias,
            bias: bias..end,
        }
    }

    fn fill(&mut self, layer: &Dense, span: &Span, place: impl Fn(usize, usize) -> usize) {
        for row in 0..layer.outputs {
            for column in 0..layer.inputs {
                self.values[span.weights.start + place(row, column)] =
                    layer.weight[row * layer.inputs + column];
            }
            self.values[span.bias.start + row] = layer.bias[row];
        }
    }

    /// Return the network as plain data.
    #[must_use]
    pub fn network(&self) -> Network {
        self.unpack(&self.values)
    }

    /// Return the plain data of a vector with the layout of the parameters.
    pub(super) fn unpack(&self, values: &[f32]) -> Network {
        let dense = |span: &Span, place: &dyn Fn(usize, usize) -> usize| Dense {
            inputs: span.inputs,
            outputs: span.outputs,
            weight: (0..span.outputs)
                .flat_map(|row| (0..span.inputs).map(move |column| (row, column)))
                .map(|(row, column)| values[span.weights.start + place(row, column)])
                .collect(),
            bias: values[span.bias.clone()][..span.outputs].to_vec(),
        };
        let hidden = self.hidden.iter().map(|s| dense(s, &|row, column| column * s.stride + row));
        let last = dense(&self.last, &|row, column| row * self.last.stride + column);
        Network { activation: self.activation, layers: hidden.chain([last]).collect() }
    }

    /// Return the number of inputs of the network.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.hidden[0].inputs
    }

    /// Return the number of outputs of the network.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.last.outputs
    }

    /// Compute `tape.y` from `tape.x`.
    pub fn forward(&self, tape: &mut Tape) {
        let batch = tape.x.len() / self.inputs();
        tape.activations.resize_with(self.hidden.len(), Vec::new);
        for (activations, span) in tape.activations.iter_mut().zip(&self.hidden) {
            activations.resize(batch * span.stride, 0.0);
        }
        tape.y.resize(batch * self.outputs(), 0.0);
        Arch::new().dispatch(Forward { stack: self, tape });
    }
}

struct Forward<'a> {
    stack: &'a Stack,
    tape: &'a mut Tape,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stack, tape } = self;
        let mut x: (&[f32], usize) = (&tape.x, stack.inputs());
        for (span, y) in stack.hidden.iter().zip(&mut tape.activations) {
            let product = Product {
                x: x.0,
                x_stride: x.1,
                depth: span.inputs,
                weights: &stack.values[span.weights.clone()],
                bias: Some(&stack.values[span.bias.clone()]),
                epilogue: Epilogue::Activate(stack.activation),
            };
            kernel::product(simd, y, span.stride, product);
            x = (y, span.stride);
        }
        let span = &stack.last;
        let weights = (&stack.values[span.weights.clone()], &stack.values[span.bias.clone()]);
        match span.outputs {
            1 => kernel::narrow::<S, 1>(simd, &mut tape.y, weights, x),
            2 => kernel::narrow::<S, 2>(simd, &mut tape.y, weights, x),
            3 => kernel::narrow::<S, 3>(simd, &mut tape.y, weights, x),
            _ => kernel::narrow::<S, MAX_OUTPUTS>(simd, &mut tape.y, weights, x),
        }
    }
}
