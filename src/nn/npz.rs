//! Weights as an npz archive of NumPy arrays: `fc1.weight`, `fc1.bias`, ..., `fc_out.bias`.

use super::Network;
use ndarray::{ArrayView1, ArrayView2};
use ndarray_npy::{NpzWriter, WriteNpzError};
use std::io::Cursor;

/// Write the archive; weights are `[outputs][inputs]`, float32.
///
/// # Errors
/// Only when an array cannot be encoded, which is a bug of this function.
pub fn to_npz(network: &Network) -> Result<Vec<u8>, WriteNpzError> {
    let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
    for (name, layer) in network.layer_names().iter().zip(&network.layers) {
        let shape = (layer.outputs, layer.inputs);
        let weight = ArrayView2::from_shape(shape, &layer.weight)
            .unwrap_or_else(|error| unreachable!("a layer has its own shape: {error}"));
        npz.add_array(format!("{name}.weight"), &weight)?;
        npz.add_array(format!("{name}.bias"), &ArrayView1::from(&layer.bias))?;
    }
    Ok(npz.finish()?.into_inner())
}
