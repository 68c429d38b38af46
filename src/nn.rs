//! Small multi-layer perceptrons: plain data, batched kernels, gradients with Adam, and the file
//! formats in which other software reads them.

mod kernel;
mod network;
pub mod npz;
pub mod onnx;
pub mod safetensors;
mod stack;
pub mod torchscript;
mod trainer;

pub use kernel::{PAD, padded};
pub use network::{Activation, Dense, Network};
pub use stack::{MAX_OUTPUTS, Stack, Tape};
pub use trainer::{Adam, InputGradient, Trainer};

#[cfg(test)]
mod tests;
