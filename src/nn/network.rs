//! Network as plain data: dense layers with PyTorch's weight order, and a plain forward pass.
//!
//! Networks are stored, exported and compared in this form. Training uses the padded copy in
//! [`super::Trainer`], batched inference the one in [`super::Stack`]; both are tested against
//! [`Network::forward`].

use serde::{Deserialize, Serialize};

/// Activation between two dense layers; the last layer is always linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// `max(z, 0)`
    Relu,
    /// `z / (1 + |z|)`, the upstream actuator network's choice
    Softsign,
    /// `z` above zero, `exp(z) - 1` below, the upstream policy's choice
    Elu,
    /// `tanh(z)`
    Tanh,
}

impl Activation {
    /// Return the activation of one pre-activation `z`.
    #[must_use]
    pub fn apply(self, z: f32) -> f32 {
        match self {
            Self::Relu => z.max(0.0),
            Self::Softsign => z / (1.0 + z.abs()),
            Self::Elu if 0.0 < z => z,
            Self::Elu => z.exp_m1(),
            Self::Tanh => z.tanh(),
        }
    }

    /// Return the name in files: `relu`, `softsign`, `elu` or `tanh`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Relu => "relu",
            Self::Softsign => "softsign",
            Self::Elu => "elu",
            Self::Tanh => "tanh",
        }
    }

    /// All activations, in the order of the enum.
    pub const ALL: [Self; 4] = [Self::Relu, Self::Softsign, Self::Elu, Self::Tanh];
}

/// One dense layer, `y = W x + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Row-major `[outputs][inputs]`, as PyTorch's `nn.Linear.weight`.
    pub weight: Vec<f32>,
    /// Bias `[outputs]`.
    pub bias: Vec<f32>,
}

/// Multi-layer perceptron: dense layers with one activation between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Activation after every layer except the last.
    pub activation: Activation,
    /// Layers, at least one; the outputs of each are the inputs of the next.
    pub layers: Vec<Dense>,
}

impl Network {
    /// Return the names of the layers in upstream's files: `fc1`, `fc2`, ..., `fc_out`.
    #[must_use]
    pub fn layer_names(&self) -> Vec<String> {
        let hidden = self.layers.len() - 1;
        (1..=hidden).map(|i| format!("fc{i}")).chain(["fc_out".to_owned()]).collect()
    }

    /// Return the number of inputs of the first layer.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Return the number of outputs of the last layer.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Compute the output for one input vector; the reference for every faster path.
    #[must_use]
    pub fn forward(&self, input: &[f32]) -> Vec<f32> {
        let last = self.layers.len() - 1;
        let mut values = input.to_vec();
        for (index, layer) in self.layers.iter().enumerate() {
            values = layer
                .weight
                .chunks_exact(layer.inputs)
                .zip(&layer.bias)
                .map(|(row, bias)| {
                    let z = bias + row.iter().zip(&values).map(|(w, x)| w * x).sum::<f32>();
                    if index == last { z } else { self.activation.apply(z) }
                })
                .collect();
        }
        values
    }
}
