//! Arbitrary named tensors as a safetensors file: training states and policies.
//!
//! The format is that of [`super::safetensors`], without its chain of layers. Equal tensors give
//! equal bytes; values of every type are restored bit by bit.

use super::safetensors::{SafetensorsError, assemble, split};
use safetensors::Dtype;
use serde_json::json;
use std::collections::BTreeMap;

/// Values of a tensor, row-major.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
    /// Unsigned integers.
    U64(Vec<u64>),
}

/// Tensor: shape and values.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Sizes, slowest first; empty for a single number.
    pub shape: Vec<usize>,
    /// Values, as many as the product of the sizes.
    pub values: Values,
}

/// Tensors by name.
pub type Tensors = BTreeMap<String, Tensor>;

impl Values {
    /// Return the type in the file's header.
    #[must_use]
    pub fn dtype(&self) -> Dtype {
        match self {
            Self::F32(_) => Dtype::F32,
            Self::F64(_) => Dtype::F64,
            Self::U64(_) => Dtype::U64,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::U64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        }
    }

    /// Decode values; `None` for an unsupported type.
    fn read(dtype: Dtype, bytes: &[u8]) -> Option<Self> {
        let (fours, _) = bytes.as_chunks::<4>();
        let (eights, _) = bytes.as_chunks::<8>();
        match dtype {
            Dtype::F32 => Some(Self::F32(fours.iter().map(|b| f32::from_le_bytes(*b)).collect())),
            Dtype::F64 => Some(Self::F64(eights.iter().map(|b| f64::from_le_bytes(*b)).collect())),
            Dtype::U64 => Some(Self::U64(eights.iter().map(|b| u64::from_le_bytes(*b)).collect())),
            _ => None,
        }
    }
}

/// Write the tensors as the bytes of a safetensors file.
#[must_use]
pub fn to_bytes(tensors: &Tensors, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let mut header = BTreeMap::from([("__metadata__".to_owned(), json!(metadata))]);
    let mut data = Vec::new();
    for (name, tensor) in tensors {
        let start = data.len();
        data.extend(tensor.values.bytes());
        let offsets = [start, data.len()];
        let (dtype, shape) = (tensor.values.dtype(), &tensor.shape);
        let entry = json!({ "data_offsets": offsets, "dtype": dtype, "shape": shape });
        header.insert(name.clone(), entry);
    }
    assemble(header, &data)
}

/// Read the tensors and the metadata of a safetensors file.
///
/// # Errors
/// For bytes that are not such a file, and for types other than F32, F64 and U64; it never panics.
pub fn from_bytes(bytes: &[u8]) -> Result<(Tensors, BTreeMap<String, String>), SafetensorsError> {
    let (header, data) = split(bytes)?;
    let metadata =
        header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    let mut tensors = Tensors::new();
    let infos: BTreeMap<_, _> = header.tensors().into_iter().collect();
    for (name, info) in infos {
        let range = info.data_offsets.0..info.data_offsets.1;
        let Some(values) = Values::read(info.dtype, &data[range]) else {
            return Err(SafetensorsError::ElementType { tensor: name, found: info.dtype });
        };
        tensors.insert(name, Tensor { shape: info.shape.clone(), values });
    }
    Ok((tensors, metadata))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_comes_back_bit_by_bit() {
        let tensor = |shape: &[usize], values| Tensor { shape: shape.to_vec(), values };
        let tensors = Tensors::from([
            ("a".to_owned(), tensor(&[2], Values::F32(vec![0.1, -0.0]))),
            ("b".to_owned(), tensor(&[], Values::F64(vec![1.0 / 3.0]))),
            ("c".to_owned(), tensor(&[1, 1], Values::U64(vec![u64::MAX]))),
        ]);
        let metadata = BTreeMap::from([("x".to_owned(), "1".to_owned()), ("y".into(), "2".into())]);
        let bytes = to_bytes(&tensors, &metadata);
        assert_eq!(bytes, to_bytes(&tensors, &metadata));
        let (read, read_metadata) = from_bytes(&bytes).unwrap();
        assert_eq!((&read, &read_metadata), (&tensors, &metadata));
        assert_eq!(to_bytes(&read, &metadata), bytes, "the sign of zero as well");
        // The format's own crate agrees.
        let theirs = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(theirs.tensor("b").unwrap().data(), (1.0f64 / 3.0).to_le_bytes());
        assert!((0..bytes.len()).all(|end| from_bytes(&bytes[..end]).is_err()));
    }
}
