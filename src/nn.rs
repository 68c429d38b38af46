//! Small multi-layer perceptrons: plain data, batched kernels, gradients with Adam, and file
//! formats for other software.

mod denormal;
mod kernel;
mod network;
pub mod npz;
pub mod onnx;
pub mod safetensors;
mod stack;
mod standardizer;
pub mod tensors;
pub mod torchscript;
mod trainer;

pub use denormal::flushing_denormals;
pub use kernel::{PAD, padded};
pub use network::{Activation, Dense, Network};
pub use stack::{MAX_OUTPUTS, Stack, Tape};
pub use standardizer::Standardizer;
pub use trainer::{Adam, BackwardScratch, InputGradient, Trainer, TrainerState};

#[cfg(test)]
mod tests;
