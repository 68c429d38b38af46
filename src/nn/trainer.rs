//! Gradients by reverse-mode differentiation, and Adam.
//!
//! Adam: Kingma and Ba, "Adam: A Method for Stochastic Optimization" (2015), algorithm 1, with the
//! order of operations of PyTorch's `torch.optim.Adam`.

use super::{
    kernel::{self, Curve, Elu, Epilogue, Product, Relu, Softsign, Tanh, padded},
    network::{Activation, Network},
    stack::{MAX_OUTPUTS, Stack, Tape},
};
use pulp::{Arch, Simd, WithSimd};

/// Settings of Adam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adam {
    /// Decay of the first moment, 0 to 1; 0.9 as in the paper.
    pub beta1: f32,
    /// Decay of the second moment, 0 to 1; 0.999 as in the paper.
    pub beta2: f32,
    /// Constant added to the root of the second moment; 1e-8 as in the paper.
    pub epsilon: f32,
}

impl Default for Adam {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

/// Option of a backward pass to compute the gradient with respect to the network's inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputGradient {
    /// Gradient of the parameters only.
    Skip,
    /// Gradient of the inputs as well, for training through several steps.
    Compute,
}

/// Network in training: parameters, gradients and the moments of Adam.
#[derive(Debug, Clone)]
pub struct Trainer {
    stack: Stack,
    gradient: Vec<f32>,
    moment1: Vec<f32>,
    moment2: Vec<f32>,
    /// Transposed weights `[outputs][padded inputs]` of each hidden layer, for the backward pass.
    transposed: Vec<Vec<f32>>,
    back: BackwardScratch,
    adam: Adam,
    steps: i32,
}

/// Scratch memory of the backward pass: gradients of the activations, `[batch][padded width]`, two
/// in turn; reused.
#[derive(Debug, Clone, Default)]
pub struct BackwardScratch([Vec<f32>; 2]);

/// State from which training continues.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainerState {
    /// Parameters.
    pub network: Network,
    /// Adam's first moment of each parameter, at the parameter's place.
    pub moment1: Network,
    /// Adam's second moment of each parameter, at the parameter's place.
    pub moment2: Network,
    /// Number of updates so far.
    pub steps: i32,
}

impl Trainer {
    /// Start training from `network`.
    #[must_use]
    pub fn new(network: &Network, adam: Adam) -> Self {
        let stack = Stack::new(network);
        let size = stack.values.len();
        let transposed =
            stack.hidden.iter().map(|s| vec![0.0; s.outputs * padded(s.inputs)]).collect();
        let mut trainer = Self {
            gradient: vec![0.0; size],
            moment1: vec![0.0; size],
            moment2: vec![0.0; size],
            transposed,
            back: BackwardScratch::default(),
            adam,
            steps: 0,
            stack,
        };
        trainer.transpose();
        trainer
    }

    /// Resume from `state`, with the bytes of an uninterrupted training.
    ///
    /// # Panics
    /// When the three networks of the state differ in shape.
    #[must_use]
    pub fn resume(state: &TrainerState, adam: Adam) -> Self {
        let mut trainer = Self::new(&state.network, adam);
        trainer.moment1 = Stack::new(&state.moment1).values;
        trainer.moment2 = Stack::new(&state.moment2).values;
        let size = trainer.stack.values.len();
        assert!([&trainer.moment1, &trainer.moment2].iter().all(|m| m.len() == size), "one shape");
        trainer.steps = state.steps;
        trainer
    }

    /// Return parameters, moments and number of updates.
    #[must_use]
    pub fn state(&self) -> TrainerState {
        TrainerState {
            network: self.stack.network(),
            moment1: self.stack.unpack(&self.moment1),
            moment2: self.stack.unpack(&self.moment2),
            steps: self.steps,
        }
    }

    /// Return the present parameters.
    #[must_use]
    pub fn stack(&self) -> &Stack {
        &self.stack
    }

    /// Return the gradient accumulated since the last [`update`](Self::update), each value at the
    /// place of its parameter.
    #[must_use]
    pub fn gradient(&self) -> Network {
        self.stack.unpack(&self.gradient)
    }

    /// Return the number of updates so far.
    #[must_use]
    pub fn steps(&self) -> i32 {
        self.steps
    }

    /// Return the length of the flat gradient, padding included.
    #[must_use]
    pub fn parameter_count(&self) -> usize {
        self.gradient.len()
    }

    /// Return the flat gradient of the next update, with the layout of
    /// [`accumulate`](Self::accumulate); padding must stay zero.
    pub fn gradient_mut(&mut self) -> &mut [f32] {
        &mut self.gradient
    }

    /// Return whether every parameter is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.stack.values.iter().all(|value| value.is_finite())
    }

    /// Compute `tape.y` from `tape.x`.
    pub fn forward(&self, tape: &mut Tape) {
        self.stack.forward(tape);
    }

    /// Add the gradient of a loss whose derivative with respect to the outputs of `tape` is `dy`
    /// (`[batch][outputs]`). With [`InputGradient::Compute`], `dx` becomes `[batch][padded
    /// inputs]`, the derivative with respect to the inputs.
    pub fn backward(&mut self, tape: &Tape, dy: &[f32], want: InputGradient, dx: &mut Vec<f32>) {
        let dx = match want {
            InputGradient::Skip => None,
            InputGradient::Compute => {
                let batch = dy.len() / self.stack.outputs();
                dx.resize(batch * padded(self.stack.inputs()), 0.0);
                Some(dx.as_mut_slice())
            }
        };
        let back = self.back.sized(&self.stack, dy);
        Arch::new().dispatch(Backward {
            stack: &self.stack,
            transposed: &self.transposed,
            gradient: &mut self.gradient,
            back,
            tape,
            dy,
            dx,
        });
    }

    /// Add to a gradient of the caller's, of length [`parameter_count`](Self::parameter_count), as
    /// [`backward`](Self::backward) does; for several threads at one network.
    pub fn accumulate(
        &self,
        tape: &Tape,
        dy: &[f32],
        gradient: &mut [f32],
        scratch: &mut BackwardScratch,
    ) {
        Arch::new().dispatch(Backward {
            stack: &self.stack,
            transposed: &self.transposed,
            gradient,
            back: scratch.sized(&self.stack, dy),
            tape,
            dy,
            dx: None,
        });
    }

    /// Apply one step of Adam with the accumulated gradient, and clear the gradient.
    pub fn update(&mut self, learning_rate: f32) {
        self.update_scaled(learning_rate, 1.0);
    }

    /// Apply [`update`](Self::update) with `scale` times the accumulated gradient.
    pub fn update_scaled(&mut self, learning_rate: f32, scale: f32) {
        self.steps += 1;
        let Adam { beta1, beta2, epsilon } = self.adam;
        let correction = |beta: f32| (1.0 - f64::from(beta).powi(self.steps)) as f32;
        Arch::new().dispatch(Update {
            parameters: &mut self.stack.values,
            gradient: &mut self.gradient,
            moments: [&mut self.moment1, &mut self.moment2],
            gradient_scale: scale,
            betas: [beta1, beta2],
            step: learning_rate / correction(beta1),
            scale: 1.0 / correction(beta2).sqrt(),
            epsilon,
        });
        self.transpose();
    }

    fn transpose(&mut self) {
        Arch::new().dispatch(Transpose { stack: &self.stack, transposed: &mut self.transposed });
    }
}

impl BackwardScratch {
    /// Return buffers for the widest layer of `stack` and as many rows as `dy` has.
    fn sized(&mut self, stack: &Stack, dy: &[f32]) -> &mut [Vec<f32>; 2] {
        let batch = dy.len() / stack.outputs();
        let widest = stack.hidden.iter().map(|span| span.stride).max().unwrap_or(0);
        for back in &mut self.0 {
            back.resize(batch * widest, 0.0);
        }
        &mut self.0
    }
}

/// Update of the transposed weights.
struct Transpose<'a> {
    stack: &'a Stack,
    transposed: &'a mut [Vec<f32>],
}

/// Edge of the blocks that are transposed in registers; divides [`kernel::PAD`].
const BLOCK: usize = 8;

impl WithSimd for Transpose<'_> {
    type Output = ();

    /// Uses no explicit vectors, only the instruction set that comes with them.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        for (span, transposed) in self.stack.hidden.iter().zip(self.transposed) {
            let stride = padded(span.inputs);
            let weights = &self.stack.values[span.weights.clone()];
            for first_input in (0..span.inputs).step_by(BLOCK) {
                for first_output in (0..span.outputs).step_by(BLOCK) {
                    let mut block = [[0.0; BLOCK]; BLOCK];
                    let rows = &weights[first_input * span.stride..];
                    for (row, from) in block.iter_mut().zip(rows.chunks_exact(span.stride)) {
                        row.copy_from_slice(&from[first_output..first_output + BLOCK]);
                    }
                    let rows = &mut transposed[first_output * stride..];
                    for (output, row) in rows.chunks_exact_mut(stride).take(BLOCK).enumerate() {
                        let row = &mut row[first_input..first_input + BLOCK];
                        for (value, from) in row.iter_mut().zip(&block) {
                            *value = from[output];
                        }
                    }
                }
            }
        }
    }
}

struct Backward<'a> {
    stack: &'a Stack,
    transposed: &'a [Vec<f32>],
    gradient: &'a mut [f32],
    back: &'a mut [Vec<f32>; 2],
    tape: &'a Tape,
    dy: &'a [f32],
    dx: Option<&'a mut [f32]>,
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stack, transposed, gradient, back, tape, dy, dx } = self;
        let batch = dy.len() / stack.outputs();
        let [mut here, mut below] = back.each_mut();
        let span = &stack.last;
        let top = stack.hidden.len() - 1;
        let (dw, db) = gradient[span.weights.start..span.bias.end].split_at_mut(span.weights.len());
        let weights = (&stack.values[span.weights.clone()], dy);
        let x = (tape.activations[top].as_slice(), span.stride);
        let first = &mut here[..batch * span.stride];
        let target = ((dw, db), first);
        match stack.activation {
            Activation::Relu => last::<S, Relu>(simd, span.outputs, target, weights, x),
            Activation::Softsign => {
                last::<S, Softsign>(simd, span.outputs, target, weights, x);
            }
            Activation::Elu => last::<S, Elu>(simd, span.outputs, target, weights, x),
            Activation::Tanh => last::<S, Tanh>(simd, span.outputs, target, weights, x),
        }
        let mut dx = dx;
        for layer in (0..=top).rev() {
            let span = &stack.hidden[layer];
            let dz = &here[..batch * span.stride];
            let x = match layer {
                0 => (tape.x.as_slice(), stack.inputs()),
                _ => (tape.activations[layer - 1].as_slice(), stack.hidden[layer - 1].stride),
            };
            let (dw, db) =
                gradient[span.weights.start..span.bias.end].split_at_mut(span.weights.len());
            kernel::gradient(simd, (dw, db), span.stride, x, dz);
            let columns = padded(span.inputs);
            let (target, epilogue) = match (layer, dx.as_deref_mut()) {
                (0, None) => return,
                (0, Some(dx)) => (dx, Epilogue::Linear),
                _ => {
                    let below = &mut below[..batch * columns];
                    (below, Epilogue::Derivative(stack.activation, x.0))
                }
            };
            let product = Product {
                x: dz,
                x_stride: span.stride,
                depth: span.outputs,
                weights: &transposed[layer],
                bias: None,
                epilogue,
            };
            kernel::product(simd, target, columns, product);
            std::mem::swap(&mut here, &mut below);
        }
    }
}

/// Backward pass of the narrow last layer.
#[inline(always)]
fn last<S: Simd, A: Curve>(
    simd: S,
    outputs: usize,
    (target, dx): ((&mut [f32], &mut [f32]), &mut [f32]),
    weights: (&[f32], &[f32]),
    x: (&[f32], usize),
) {
    match outputs {
        1 => kernel::narrow_backward::<S, A, 1>(simd, target, dx, weights, x),
        2 => kernel::narrow_backward::<S, A, 2>(simd, target, dx, weights, x),
        3 => kernel::narrow_backward::<S, A, 3>(simd, target, dx, weights, x),
        _ => kernel::narrow_backward::<S, A, MAX_OUTPUTS>(simd, target, dx, weights, x),
    }
}

struct Update<'a> {
    parameters: &'a mut [f32],
    gradient: &'a mut [f32],
    /// Factor on the gradient: 1, or less when it is clipped.
    gradient_scale: f32,
    moments: [&'a mut [f32]; 2],
    betas: [f32; 2],
    /// Learning rate divided by the first moment's bias correction.
    step: f32,
    /// Reciprocal of the root of the second moment's bias correction.
    scale: f32,
    epsilon: f32,
}

/// Smallest first moment; smaller ones are set to zero. They belong to units that no longer
/// contribute, and would decay into denormal numbers, which are a hundred times slower.
const MOMENT_FLOOR: f32 = 1e-30;

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [beta1, beta2] = self.betas.map(|beta| simd.splat_f32s(beta));
        let [rest1, rest2] = self.betas.map(|beta| simd.splat_f32s(1.0 - beta));
        let (step, scale) = (simd.splat_f32s(-self.step), simd.splat_f32s(self.scale));
        let (epsilon, zero) = (simd.splat_f32s(self.epsilon), simd.splat_f32s(0.0));
        let floor = simd.splat_f32s(MOMENT_FLOOR);
        let gradient_scale = simd.splat_f32s(self.gradient_scale);
        // Every length is a multiple of the widest vector, so there are no tails.
        let [(moment1, _), (moment2, _)] = self.moments.map(|m| S::as_mut_simd_f32s(m));
        let (parameters, _) = S::as_mut_simd_f32s(self.parameters);
        let (gradient, _) = S::as_mut_simd_f32s(self.gradient);
        let moments = moment1.iter_mut().zip(moment2.iter_mut());
        for ((p, place), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            let g = simd.mul_f32s(gradient_scale, *place);
            let first = simd.mul_add_e_f32s(beta1, *m, simd.mul_f32s(rest1, g));
            let kept = simd.less_than_f32s(floor, simd.abs_f32s(first));
            *m = simd.select_f32s(kept, first, zero);
            *v = simd.mul_add_e_f32s(beta2, *v, simd.mul_f32s(rest2, simd.mul_f32s(g, g)));
            let root = simd.mul_add_e_f32s(simd.sqrt_f32s(*v), scale, epsilon);
            *p = simd.mul_add_e_f32s(step, simd.div_f32s(*m, root), *p);
            *place = zero;
        }
    }
}
