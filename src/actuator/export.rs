//! Export of the weights of an `actuator.mcap` for other software.

use super::{ActuatorError, file::StoredActuator, study::weights_name};
use crate::nn::{npz, onnx, safetensors, torchscript};

/// Export formats of the weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WeightsFormat {
    /// ONNX, for onnxruntime and others; input `history`, output `velocity`, both in m/s.
    Onnx,
    /// Safetensors `fc1.weight` to `fc_out.bias`; layout and units in the metadata.
    Safetensors,
    /// TorchScript module for `torch.jit.load`; input and output in m/s.
    Torchscript,
    /// State dict `fc1.weight` to `fc_out.bias` for `torch.load`, as upstream's loader reads it.
    StateDict,
    /// NumPy arrays `fc1.weight` to `fc_out.bias`.
    Npz,
}

/// Export the weights of `seed`, or of the selected seed.
///
/// # Errors
/// When the file has no such seed, or its weights cannot be read.
pub fn export_weights(
    stored: &StoredActuator,
    format: WeightsFormat,
    seed: Option<u64>,
) -> Result<Vec<u8>, ActuatorError> {
    let (network, metadata) = match seed {
        None => (stored.model.network.clone(), stored.metadata.clone()),
        Some(seed) => stored.weights_of(&weights_name(seed))?,
    };
    Ok(match format {
        WeightsFormat::Onnx => onnx::to_onnx(&network, &metadata),
        WeightsFormat::Safetensors => safetensors::to_safetensors(&network, &metadata),
        WeightsFormat::Torchscript => torchscript::to_torchscript(&network),
        WeightsFormat::StateDict => torchscript::to_state_dict(&network),
        WeightsFormat::Npz => npz::to_npz(&network)
            .map_err(|error| stored.bad(format!("weights do not fit an npz: {error}")))?,
    })
}
