//! Weights as safetensors: the format in which networks are stored, and upstream's are imported.
//!
//! A file is an 8-byte little-endian header length, a JSON header, and raw little-endian values
//! (format: huggingface/safetensors, `README.md`, section "Format"). Tensors are `fc1.weight`,
//! `fc1.bias`, ..., `fc_out.bias`, all F32. The header's string map holds the activation and the
//! caller's entries (normalisation, history length, origin).
//!
//! The header is written here because the crate takes its metadata as a hash map, whose order
//! differs from run to run. For reading, the crate parses and validates the header.
//!
//! Not supported: other element types (a file in F16, BF16 or F64 is refused, not converted), and
//! Python pickles (`.pt`), which run code when read; convert them once with Python.

use super::network::{Activation, Dense, Network};
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Header key of the activation: its [`Activation::name`].
pub const ACTIVATION_KEY: &str = "activation";

/// Alignment of the values: the header is padded with spaces to this multiple (bytes).
const ALIGNMENT: usize = 8;

/// Error of reading a network. Shapes are in PyTorch's order, `[outputs, inputs]`.
#[derive(Debug, thiserror::Error)]
pub enum SafetensorsError {
    /// The file ends within its header.
    #[error("safetensors file ends within its header: {found} bytes")]
    Truncated {
        /// Length of the file (bytes).
        found: usize,
    },
    /// The header is not valid JSON, or its offsets, types and shapes contradict each other.
    #[error("safetensors header is invalid: {0}")]
    Header(#[source] serde_json::Error),
    /// Header that describes more or fewer values than the file holds.
    #[error("safetensors file holds {found} bytes of values, its header describes {expected}")]
    DataLength {
        /// Bytes after the header.
        found: usize,
        /// Bytes described by the header.
        expected: usize,
    },
    /// A tensor of the chain is absent.
    #[error(
        "tensor {tensor} is missing; expected fc1, fc2, ..., fc_out, each with weight and bias"
    )]
    MissingTensor {
        /// Name of the tensor.
        tensor: String,
    },
    /// A tensor is not part of the chain.
    #[error("tensor {tensor} is unexpected; expected fc1, fc2, ..., fc_out without gaps")]
    UnexpectedTensor {
        /// Name of the tensor.
        tensor: String,
    },
    /// A tensor has another element type.
    #[error("tensor {tensor}: found type {found}, expected F32; convert the file first")]
    ElementType {
        /// Name of the tensor.
        tensor: String,
        /// The type in the file.
        found: Dtype,
    },
    /// A shape does not continue the chain, or is empty.
    #[error("tensor {tensor}: found shape {found:?}, expected {expected}")]
    Shape {
        /// Name of the tensor.
        tensor: String,
        /// The shape in the file.
        found: Vec<usize>,
        /// Expected shape as text, since a free size has no number: `[above 0, 64]`.
        expected: String,
    },
    /// A value is infinite or not a number.
    #[error("tensor {tensor}: value {value} at index {index}, expected finite values")]
    NonFinite {
        /// Name of the tensor.
        tensor: String,
        /// Index in row-major order.
        index: usize,
        /// The value.
        value: f32,
    },
    /// Unknown activation in the metadata.
    #[error(
        "metadata activation is {found:?}, expected \"relu\", \"softsign\", \"elu\" or \"tanh\""
    )]
    UnknownActivation {
        /// The name in the file.
        found: String,
    },
}

/// Write the network as the bytes of a safetensors file.
///
/// `metadata` goes into the header together with [`ACTIVATION_KEY`], which is always the network's
/// own activation and overrides an entry of the map. Equal arguments give equal bytes.
#[must_use]
pub fn to_safetensors(network: &Network, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let mut metadata = metadata.clone();
    metadata.insert(ACTIVATION_KEY.to_owned(), network.activation.name().to_owned());
    let mut header = BTreeMap::from([("__metadata__".to_owned(), json!(metadata))]);
    let mut data = Vec::new();
    for (layer, name) in network.layers.iter().zip(network.layer_names()) {
        let weight = append(&mut data, &[layer.outputs, layer.inputs], &layer.weight);
        let bias = append(&mut data, &[layer.outputs], &layer.bias);
        header.insert(format!("{name}.weight"), weight);
        header.insert(format!("{name}.bias"), bias);
    }
    assemble(header, &data)
}

/// Return a file of a header and the values that it describes.
pub(super) fn assemble(header: BTreeMap<String, Value>, data: &[u8]) -> Vec<u8> {
    let mut header = json!(header).to_string().into_bytes();
    header.resize(header.len().next_multiple_of(ALIGNMENT), b' ');
    [&(header.len() as u64).to_le_bytes(), header.as_slice(), data].concat()
}

/// Append the values and return their header entry. Keys are in alphabetical order, so that the
/// text is independent of the map type of `serde_json`.
fn append(data: &mut Vec<u8>, shape: &[usize], values: &[f32]) -> Value {
    let start = data.len();
    data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    json!({ "data_offsets": [start, data.len()], "dtype": "F32", "shape": shape })
}

/// Read the network and the remaining metadata of a safetensors file, ours or a converted upstream
/// one.
///
/// `default_activation` applies when the file has no [`ACTIVATION_KEY`]. That key is removed from
/// the returned map, so that reading is the inverse of [`to_safetensors`].
///
/// # Errors
/// Any byte string that is not exactly one chain of finite F32 layers is refused; it never panics.
pub fn from_safetensors(
    bytes: &[u8],
    default_activation: Activation,
) -> Result<(Network, BTreeMap<String, String>), SafetensorsError> {
    let (header, data) = split(bytes)?;
    let mut metadata: BTreeMap<String, String> =
        header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    let activation = match metadata.remove(ACTIVATION_KEY) {
        Some(name) => parse_activation(name)?,
        None => default_activation,
    };
    let tensors = header.tensors().into_iter().collect();
    let layers = Tensors { infos: tensors, data }.take_layers()?;
    Ok((Network { activation, layers }, metadata))
}

/// Return the validated header and the values.
///
/// Not `SafeTensors::deserialize`: safetensors 0.8.0 adds the described length to the header's
/// before it compares, which overflows on a crafted header and panics where overflow is checked.
pub(super) fn split(bytes: &[u8]) -> Result<(Metadata, &[u8]), SafetensorsError> {
    let truncated = SafetensorsError::Truncated { found: bytes.len() };
    let Some((length, rest)) = bytes.split_first_chunk::<8>() else {
        return Err(truncated);
    };
    let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
    let Some((header, data)) = rest.split_at_checked(length) else {
        return Err(truncated);
    };
    let header: Metadata = serde_json::from_slice(header).map_err(SafetensorsError::Header)?;
    if data.len() != header.data_len() {
        let (found, expected) = (data.len(), header.data_len());
        return Err(SafetensorsError::DataLength { found, expected });
    }
    Ok((header, data))
}

pub(crate) fn parse_activation(name: String) -> Result<Activation, SafetensorsError> {
    let known = Activation::ALL.into_iter().find(|activation| activation.name() == name);
    known.ok_or(SafetensorsError::UnknownActivation { found: name })
}

/// Tensors of a file that are not assigned to a layer yet.
struct Tensors<'a> {
    infos: BTreeMap<String, &'a TensorInfo>,
    data: &'a [u8],
}

impl Tensors<'_> {
    /// Take the layers `fc1`, `fc2`, ... and then `fc_out`; each must fit the previous one.
    fn take_layers(mut self) -> Result<Vec<Dense>, SafetensorsError> {
        let mut layers: Vec<Dense> = Vec::new();
        loop {
            let inputs = layers.last().map(|layer| layer.outputs);
            let name = format!("fc{}", layers.len() + 1);
            if !self.has_layer(&name) {
                layers.push(self.take_layer("fc_out", inputs)?);
                break;
            }
            layers.push(self.take_layer(&name, inputs)?);
        }
        match self.infos.pop_first() {
            Some((tensor, _)) => Err(SafetensorsError::UnexpectedTensor { tensor }),
            None => Ok(layers),
        }
    }

    fn has_layer(&self, name: &str) -> bool {
        ["weight", "bias"].iter().any(|part| self.infos.contains_key(&format!("{name}.{part}")))
    }

    /// Take one layer; `inputs` is `None` for the first, whose width is free.
    fn take_layer(&mut self, name: &str, inputs: Option<usize>) -> Result<Dense, SafetensorsError> {
        let (shape, weight) = self.take(format!("{name}.weight"), &[None, inputs])?;
        let (outputs, inputs) = (shape[0], shape[1]);
        let (_, bias) = self.take(format!("{name}.bias"), &[Some(outputs)])?;
        Ok(Dense { inputs, outputs, weight, bias })
    }

    /// Return shape and values of one tensor. It must be F32, finite, and of the `expected` shape,
    /// in which `None` is any size but 0.
    fn take(
        &mut self,
        tensor: String,
        expected: &[Option<usize>],
    ) -> Result<(Vec<usize>, Vec<f32>), SafetensorsError> {
        let Some(info) = self.infos.remove(&tensor) else {
            return Err(SafetensorsError::MissingTensor { tensor });
        };
        if info.dtype != Dtype::F32 {
            return Err(SafetensorsError::ElementType { tensor, found: info.dtype });
        }
        let shape = info.shape.clone();
        if !fits(&shape, expected) {
            let expected = describe(expected);
            return Err(SafetensorsError::Shape { tensor, found: shape, expected });
        }
        // In bounds: the header's offsets are contiguous from 0 and end where the data end.
        let (words, _) = self.data[info.data_offsets.0..info.data_offsets.1].as_chunks::<4>();
        let values: Vec<f32> = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
        match values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(SafetensorsError::NonFinite { tensor, index, value: values[index] }),
            None => Ok((shape, values)),
        }
    }
}

fn fits(shape: &[usize], expected: &[Option<usize>]) -> bool {
    let same = |(found, expected): (&usize, &Option<usize>)| match expected {
        Some(expected) => found == expected,
        None => 0 < *found,
    };
    shape.len() == expected.len() && shape.iter().zip(expected).all(same)
}

/// Format an expected shape such as `[above 0, 64]`.
fn describe(expected: &[Option<usize>]) -> String {
    let size = |size: &Option<usize>| size.map_or("above 0".to_owned(), |size| size.to_string());
    format!("[{}]", expected.iter().map(size).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn metadata() -> BTreeMap<String, String> {
        let pairs = [("origin", "a \"quoted\"\nline"), ("axis", "both"), ("history", "10")];
        pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).into()
    }

    /// Return a file with this header and the given number of zero bytes.
    fn file(header: &str, n_data: usize) -> Vec<u8> {
        let length = (header.len() as u64).to_le_bytes();
        [length.as_slice(), header.as_bytes(), &vec![0; n_data]].concat()
    }

    /// Entries of F32 tensors, one after the other, and their total length (bytes).
    fn entries(tensors: &[(&str, &[usize])]) -> (String, usize) {
        let mut end = 0;
        let entry = |(name, shape): &(&str, &[usize])| {
            let start = end;
            end += 4 * shape.iter().product::<usize>();
            format!(
                r#""{name}":{{"dtype":"F32","shape":{shape:?},"data_offsets":[{start},{end}]}}"#
            )
        };
        let text = tensors.iter().map(entry).collect::<Vec<_>>().join(",");
        (format!("{{{text}}}"), end)
    }

    fn refusal(bytes: &[u8]) -> String {
        from_safetensors(bytes, Activation::Relu).unwrap_err().to_string()
    }

    fn refusal_of(tensors: &[(&str, &[usize])]) -> String {
        let (header, n_data) = entries(tensors);
        refusal(&file(&header, n_data))
    }

    #[test]
    fn reading_undoes_writing() {
        for activation in Activation::ALL {
            let network = small(activation);
            let bytes = to_safetensors(&network, &metadata());
            let read = from_safetensors(&bytes, Activation::Relu).unwrap();
            assert_eq!(read, (network, metadata()));
        }
    }

    #[test]
    fn header_text_is_fixed() {
        let bytes = to_safetensors(&small(Activation::Softsign), &metadata());
        let expected = concat!(
            r#"{"__metadata__":{"activation":"softsign","axis":"both","history":"10","#,
            r#""origin":"a \"quoted\"\nline"},"#,
            r#""fc1.bias":{"data_offsets":[24,32],"dtype":"F32","shape":[2]},"#,
            r#""fc1.weight":{"data_offsets":[0,24],"dtype":"F32","shape":[2,3]},"#,
            r#""fc_out.bias":{"data_offsets":[40,44],"dtype":"F32","shape":[1]},"#,
            r#""fc_out.weight":{"data_offsets":[32,40],"dtype":"F32","shape":[1,2]}}"#,
        );
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(length % ALIGNMENT, 0);
        assert_eq!(std::str::from_utf8(&bytes[8..8 + length]).unwrap().trim_end(), expected);
        assert_eq!(bytes.len(), 8 + length + 4 * 11);
        assert_eq!(bytes[8 + length..8 + length + 4], 1.0_f32.to_le_bytes());
    }

    #[test]
    fn crate_reads_our_file() {
        let bytes = to_safetensors(&small(Activation::Relu), &metadata());
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(file.len(), 4);
        assert_eq!(file.tensor("fc_out.weight").unwrap().shape(), [1, 2]);
    }

    #[test]
    fn upstream_file_without_metadata_takes_the_default() {
        let (header, n_data) = entries(&[
            ("fc_out.bias", &[2]),
            ("fc1.weight", &[4, 38]),
            ("fc1.bias", &[4]),
            ("fc2.bias", &[3]),
            ("fc2.weight", &[3, 4]),
            ("fc_out.weight", &[2, 3]),
        ]);
        let bytes = file(&header, n_data);
        let (network, metadata) = from_safetensors(&bytes, Activation::Softsign).unwrap();
        assert_eq!(network.activation, Activation::Softsign);
        assert_eq!(network.layer_names(), ["fc1", "fc2", "fc_out"]);
        assert_eq!((network.inputs(), network.outputs()), (38, 2));
        assert!(metadata.is_empty());
    }

    #[test]
    fn refusals_name_tensor_found_and_expected() {
        assert_eq!(
            refusal_of(&[("fc_out.weight", &[2, 3, 1]), ("fc_out.bias", &[2])]),
            "tensor fc_out.weight: found shape [2, 3, 1], \
             expected [above 0, above 0]"
        );
        let hidden: [(&str, &[usize]); 2] = [("fc1.weight", &[4, 3]), ("fc1.bias", &[4])];
        assert_eq!(
            refusal_of(&[hidden[0], hidden[1], ("fc_out.weight", &[2, 5])]),
            "tensor fc_out.weight: found shape [2, 5], expected [above 0, 4]"
        );
        assert_eq!(
            refusal_of(&[("fc_out.weight", &[2, 3]), ("fc_out.bias", &[3])]),
            "tensor fc_out.bias: found shape [3], expected [2]"
        );
        assert_eq!(
            refusal_of(&[("fc_out.weight", &[0, 3]), ("fc_out.bias", &[0])]),
            "tensor fc_out.weight: found shape [0, 3], \
             expected [above 0, above 0]"
        );
        assert!(refusal_of(&hidden).starts_with("tensor fc_out.weight is missing"));
        assert!(refusal_of(&[]).starts_with("tensor fc_out.weight is missing"));
    }

    #[test]
    fn gaps_and_strangers_are_refused() {
        let out: [(&str, &[usize]); 2] = [("fc_out.weight", &[2, 3]), ("fc_out.bias", &[2])];
        let gap = refusal_of(&[out[0], out[1], ("fc2.bias", &[3])]);
        assert!(gap.starts_with("tensor fc2.bias is unexpected"), "{gap}");
        let stranger = refusal_of(&[out[0], out[1], ("input_mean", &[3])]);
        assert!(stranger.starts_with("tensor input_mean is unexpected"), "{stranger}");
        let half = refusal_of(&[out[0], out[1], ("fc1.bias", &[3])]);
        assert!(half.starts_with("tensor fc1.weight is missing"), "{half}");
    }

    #[test]
    fn values_types_and_activation_are_checked() {
        let mut network = small(Activation::Relu);
        network.layers[1].weight[1] = f32::NAN;
        assert_eq!(
            refusal(&to_safetensors(&network, &metadata())),
            "tensor fc_out.weight: value NaN at index 1, expected finite values"
        );
        let half = r#"{"fc_out.weight":{"dtype":"F16","shape":[1,1],"data_offsets":[0,2]}}"#;
        assert_eq!(
            refusal(&file(half, 2)),
            "tensor fc_out.weight: found type F16, expected F32; convert the file first"
        );
        assert_eq!(
            refusal(&file(r#"{"__metadata__":{"activation":"gelu"}}"#, 0)),
            "metadata activation is \"gelu\", expected \"relu\", \"softsign\", \"elu\" or \"tanh\""
        );
    }

    #[test]
    fn lengths_are_checked() {
        let bytes = to_safetensors(&small(Activation::Relu), &metadata());
        assert!((0..bytes.len()).all(|n| from_safetensors(&bytes[..n], Activation::Relu).is_err()));
        assert_eq!(refusal(b"abc"), "safetensors file ends within its header: 3 bytes");
        assert_eq!(refusal(&[255; 9]), "safetensors file ends within its header: 9 bytes");
        assert_eq!(
            refusal(&[bytes, vec![0]].concat()),
            "safetensors file holds 45 bytes of values, its header describes 44"
        );
    }

    /// Eight tensors of almost 2^61 bytes and one of 28 end just below 2^64.
    #[test]
    fn header_near_the_end_of_the_number_range_is_refused() {
        let count = (1_usize << 59) - 1;
        let mut end = 0;
        let mut entry = |(name, count): (char, usize)| {
            let start = end;
            end += 4 * count;
            format!(
                r#""{name}":{{"dtype":"F32","shape":[{count}],"data_offsets":[{start},{end}]}}"#
            )
        };
        let sizes = ('a'..='h').map(|name| (name, count)).chain([('i', 7)]);
        let text = sizes.map(&mut entry).collect::<Vec<_>>().join(",");
        let found = refusal(&file(&format!("{{{text}}}"), 0));
        assert!(found.ends_with("its header describes 18446744073709551612"), "{found}");
    }

    #[test]
    fn no_flipped_bit_panics_and_what_is_accepted_can_be_used() {
        let bytes = to_safetensors(&small(Activation::Relu), &metadata());
        for bit in 0..8 * bytes.len() {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            if let Ok((network, _)) = from_safetensors(&changed, Activation::Relu) {
                assert_eq!(network.forward(&[0.0; 3]).len(), 1);
            }
        }
    }
}
