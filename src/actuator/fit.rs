//! Training of one network: mean squared error, Adam, one step or several free-running steps.

use super::{
    ActuatorError,
    layout::{AXES, Layout, LayoutKind},
    model::ActuatorNetwork,
    run::Run,
    window::{Scale, Windows},
};
use crate::{
    nn::{Adam, Dense, InputGradient, Network, Tape, Trainer, padded},
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};

/// Learning-rate schedule over the epochs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Schedule {
    /// Half a cosine from the learning rate down to zero (Loshchilov and Hutter, SGDR, 2017,
    /// without restarts). The weights converge in the last epochs instead of fluctuating.
    Cosine,
    /// Constant learning rate.
    Constant,
}

/// Settings of a fit: everything that decides it except its data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitConfig {
    /// Order of the inputs.
    pub layout: LayoutKind,
    /// Number of commands in the input history; 10 in the paper.
    pub history_steps: usize,
    /// Units of each hidden layer; 64 in the paper.
    pub width: usize,
    /// Number of hidden layers; 3 in the paper.
    pub hidden_layers: usize,
    /// Number of passes over the data.
    pub epochs: usize,
    /// Windows per Adam step.
    pub batch: usize,
    /// Initial step size of Adam.
    pub learning_rate: f64,
    /// Schedule of the learning rate.
    pub schedule: Schedule,
    /// Samples predicted from each window, each fed back as input; 1 trains one-step prediction.
    pub horizon: usize,
    /// Seed of the initial weights and of the order of windows.
    pub seed: u64,
}

impl FitConfig {
    /// Return the layout of the inputs.
    #[must_use]
    pub fn input_layout(&self) -> Layout {
        Layout { kind: self.layout, history_steps: self.history_steps }
    }

    fn learning_rate_at(&self, step: usize, steps: usize) -> f32 {
        let fraction = step as f64 / steps as f64;
        let factor = match self.schedule {
            Schedule::Cosine => 0.5 * (1.0 + (std::f64::consts::PI * fraction).cos()),
            Schedule::Constant => 1.0,
        };
        (self.learning_rate * factor) as f32
    }
}

/// One point of a learning curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Number of the epoch, from 1.
    pub epoch: usize,
    /// Root mean square over the epoch's training windows, while the weights change (m/s).
    pub train_rmse_m_per_s: f64,
    /// One-step-ahead error on held-out runs, where it was measured (m/s).
    pub held_out_rmse_m_per_s: Option<f64>,
}

/// A finished fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Settings of the fit.
    pub config: FitConfig,
    /// Fitted network, in m/s.
    pub model: ActuatorNetwork,
    /// Learning curve.
    pub curve: Vec<Epoch>,
}

/// Receiver of the progress of a fit.
pub trait FitObserver: Sync {
    /// Report the end of an epoch.
    fn epoch_done(&self);
}

/// Number of points of the learning curve at which the held-out error is measured.
const CURVE_POINTS: usize = 100;

/// Fit one network to `train`; `held_out` is used only for its learning curve. Return `None` when
/// `stop` was raised before the end.
///
/// # Errors
/// When the loss becomes non-finite.
pub fn fit(
    config: &FitConfig,
    train: &[&Run],
    held_out: &[&Run],
    stop: &AtomicBool,
    observer: &dyn FitObserver,
) -> Result<Option<Fit>, ActuatorError> {
    let scale = Scale::of(train);
    let layout = config.input_layout();
    let windows = Windows::new(train, layout, config.horizon, &scale);
    let watched = Windows::new(held_out, layout, 1, &scale);
    let network = initial_network(config);
    let mut session = Session {
        trainer: Trainer::new(&network, Adam::default()),
        windows: &windows,
        scale: &scale,
        tapes: vec![Tape::default(); config.horizon],
        output_gradient: vec![Vec::new(); config.horizon],
        input_gradient: Vec::new(),
    };
    let mut order: Vec<u32> = (0..windows.len() as u32).collect();
    let mut shuffler = Stream::new(config.seed, "order");
    let batches = windows.len().div_ceil(config.batch);
    let every = config.epochs.div_ceil(CURVE_POINTS);
    let mut curve = Vec::with_capacity(config.epochs);
    for epoch in 1..=config.epochs {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        shuffler.shuffle(&mut order);
        let mut squares = 0.0;
        for (index, chosen) in order.chunks(config.batch).enumerate() {
            let step = (epoch - 1) * batches + index;
            squares += session.learn(chosen);
            session.trainer.update(config.learning_rate_at(step, config.epochs * batches));
        }
        let train_rmse_m_per_s = (squares / (windows.len() * config.horizon * AXES) as f64).sqrt();
        if !train_rmse_m_per_s.is_finite() {
            let (seed, learning_rate) = (config.seed, config.learning_rate);
            return Err(ActuatorError::Diverged { seed, epoch, learning_rate });
        }
        let measured = !watched.is_empty() && (epoch % every == 0 || epoch == config.epochs);
        let held_out_rmse_m_per_s =
            measured.then(|| one_step_rmse(&session.trainer, &watched, &scale));
        curve.push(Epoch { epoch, train_rmse_m_per_s, held_out_rmse_m_per_s });
        observer.epoch_done();
    }
    let network = in_metres_per_second(session.trainer.stack().network(), layout, &scale);
    Ok(Some(Fit { config: *config, model: ActuatorNetwork::new(layout, network), curve }))
}

/// Return a network with weights and biases uniform within `1 / sqrt(inputs)`, PyTorch's
/// initialization of `nn.Linear`.
fn initial_network(config: &FitConfig) -> Network {
    let mut stream = Stream::new(config.seed, "weights");
    let mut sizes = vec![config.input_layout().inputs()];
    sizes.extend(vec![config.width; config.hidden_layers]);
    sizes.push(AXES);
    let layers = sizes
        .windows(2)
        .map(|pair| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let bound = 1.0 / (inputs as f32).sqrt();
            let mut draw = |count| (0..count).map(|_| stream.uniform_f32(-bound, bound)).collect();
            Dense { inputs, outputs, weight: draw(inputs * outputs), bias: draw(outputs) }
        })
        .collect();
    Network { activation: config.layout.activation(), layers }
}

/// Fold the scale into the first and the last layer.
fn in_metres_per_second(mut network: Network, layout: Layout, scale: &Scale) -> Network {
    let first = &mut network.layers[0];
    for row in first.weight.chunks_exact_mut(first.inputs) {
        for (input, weight) in row.iter_mut().enumerate() {
            let part = if input < layout.command_inputs() { scale.command } else { scale.velocity };
            *weight /= part[input % AXES];
        }
    }
    let last = network.layers.len() - 1;
    let last = &mut network.layers[last];
    for (axis, row) in last.weight.chunks_exact_mut(last.inputs).enumerate() {
        row.iter_mut().for_each(|weight| *weight *= scale.velocity[axis]);
        last.bias[axis] *= scale.velocity[axis];
    }
    network
}

/// Number of windows in one pass through the network. A larger batch is split into parts of this
/// size, so that the activations stay in a second-level cache of 1 MiB.
const PART: usize = 256;

/// Buffers of one fit.
struct Session<'a> {
    trainer: Trainer,
    windows: &'a Windows,
    scale: &'a Scale,
    /// One tape for each predicted sample.
    tapes: Vec<Tape>,
    /// Derivative of the loss with respect to each sample's output, `[batch][AXES]`.
    output_gradient: Vec<Vec<f32>>,
    input_gradient: Vec<f32>,
}

impl Session<'_> {
    /// Accumulate the gradient of the mean squared scaled error of the windows `chosen`. Return the
    /// sum of squared errors ((m/s)^2).
    fn learn(&mut self, chosen: &[u32]) -> f64 {
        let weight = 2.0 / (chosen.len() * self.windows.horizon() * AXES) as f32;
        let mut squares = 0.0;
        for part in chosen.chunks(PART) {
            self.roll_out(part);
            squares += self.compare(part, weight);
            self.propagate_back(part.len());
        }
        squares
    }

    /// Predict the samples one after the other; each prediction is fed back as a measurement.
    fn roll_out(&mut self, chosen: &[u32]) {
        let layout = self.windows.layout;
        self.windows.inputs(chosen, &mut self.tapes[0].x);
        for step in 0..self.windows.horizon() {
            self.trainer.forward(&mut self.tapes[step]);
            let (done, rest) = self.tapes.split_at_mut(step + 1);
            let Some(next) = rest.first_mut() else { break };
            let tape = &done[step];
            next.x.clone_from(&tape.x);
            let rows = next.x.chunks_exact_mut(layout.inputs());
            for ((row, index), y) in rows.zip(chosen).zip(tape.y.chunks_exact(AXES)) {
                layout.advance(row, self.windows.command(*index, step + 1), [y[0], y[1]]);
            }
        }
    }

    /// Convert predictions into output gradients, `weight` times the error. Return the sum of
    /// squared errors ((m/s)^2).
    fn compare(&mut self, chosen: &[u32], weight: f32) -> f64 {
        let mut squares = [0.0f64; AXES];
        for (step, gradient) in self.output_gradient.iter_mut().enumerate() {
            gradient.clear();
            let outputs = self.tapes[step].y.chunks_exact(AXES);
            for (y, index) in outputs.zip(chosen) {
                let target = self.windows.target(*index, step);
                for axis in 0..AXES {
                    let error = y[axis] - target[axis];
                    squares[axis] += f64::from(error * error);
                    gradient.push(weight * error);
                }
            }
        }
        (0..AXES).map(|axis| squares[axis] * f64::from(self.scale.velocity[axis]).powi(2)).sum()
    }

    /// Backpropagate through time: a prediction is also a velocity input of the samples after it.
    fn propagate_back(&mut self, batch: usize) {
        let layout = self.windows.layout;
        let stride = padded(layout.inputs());
        for step in (0..self.windows.horizon()).rev() {
            let want = if step == 0 { InputGradient::Skip } else { InputGradient::Compute };
            let (earlier, here) = self.output_gradient.split_at_mut(step);
            self.trainer.backward(&self.tapes[step], &here[0], want, &mut self.input_gradient);
            // Velocity input `age` of this sample is the output of sample `step - 1 - age`.
            let ages = layout.velocity_inputs() / AXES;
            for (age, gradient) in earlier.iter_mut().rev().take(ages).enumerate() {
                let column = layout.command_inputs() + AXES * age;
                for row in 0..batch {
                    for axis in 0..AXES {
                        gradient[row * AXES + axis] +=
                            self.input_gradient[row * stride + column + axis];
                    }
                }
            }
        }
    }
}

/// Number of windows predicted in one batch.
const MEASURE_BATCH: usize = 1024;

fn one_step_rmse(trainer: &Trainer, windows: &Windows, scale: &Scale) -> f64 {
    let mut tape = Tape::default();
    let mut squares = 0.0;
    let all: Vec<u32> = (0..windows.len() as u32).collect();
    for chosen in all.chunks(MEASURE_BATCH) {
        windows.inputs(chosen, &mut tape.x);
        trainer.forward(&mut tape);
        for (y, index) in tape.y.chunks_exact(AXES).zip(chosen) {
            let target = windows.target(*index, 0);
            for axis in 0..AXES {
                squares += f64::from((y[axis] - target[axis]) * scale.velocity[axis]).powi(2);
            }
        }
    }
    (squares / (windows.len() * AXES) as f64).sqrt()
}
