//! States and policies as safetensors, and policies as ONNX.
//!
//! Tensors of a state:
//!
//! - `policy.fc1.weight`, ..., with `policy.moment1.` and `policy.moment2.` for Adam; the same for
//!   `critic`;
//! - `log_deviation` (three rows: value and moments);
//! - `observed` and `targets` (rows mean and sum of squares), with the `counts` of both;
//! - `learning_rate`, and `counters` (seed, updates, steps of Adam).
//!
//! A policy has the tensors of a network, `standardize.mean`, `standardize.scale`,
//! `standardize.limit` and `log_deviation`.

use super::{Deviations, Gaussian, LearnerState, Moments, Policy};
use crate::nn::{
    Activation, Dense, MAX_OUTPUTS, Network, Standardizer, TrainerState,
    onnx::{self, Interface},
    safetensors::{ACTIVATION_KEY, SafetensorsError, parse_activation},
    tensors::{self, Tensor, Tensors, Values},
    torchscript,
};
use std::collections::BTreeMap;

/// Name of the only input of an exported policy: observation, float32 `[batch, inputs]`.
pub const INPUT_NAME: &str = "observation";
/// Name of its only output: mean action, float32 `[batch, outputs]`.
pub const OUTPUT_NAME: &str = "action";

impl Policy {
    /// Export normalization and policy network as an ONNX file, from [`INPUT_NAME`] to
    /// [`OUTPUT_NAME`].
    #[must_use]
    pub fn to_onnx(&self, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        let standardizer = Some(self.standardizer());
        let interface = Interface { input: INPUT_NAME, output: OUTPUT_NAME, standardizer };
        onnx::to_onnx_with(self.network(), &interface, metadata)
    }

    /// Export normalization and policy network as a TorchScript module from observation to mean
    /// action; `metadata` is its extra file `metadata.json`.
    #[must_use]
    pub fn to_torchscript(&self, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        torchscript::to_torchscript_with(self.network(), Some(self.standardizer()), metadata)
    }

    /// Encode the complete policy as a safetensors file.
    #[must_use]
    pub fn to_safetensors(&self, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        let mut tensors = Tensors::new();
        put_network(&mut tensors, "", self.network());
        let standardizer = self.standardizer();
        put(&mut tensors, "standardize.mean", &standardizer.mean);
        put(&mut tensors, "standardize.scale", &standardizer.scale);
        put(&mut tensors, "standardize.limit", &[standardizer.limit]);
        put(&mut tensors, "log_deviation", self.gaussian().log_deviations());
        tensors::to_bytes(&tensors, &with_activation(self.network().activation, metadata))
    }

    /// Inverse of [`to_safetensors`](Self::to_safetensors); also returns the metadata.
    ///
    /// # Errors
    /// When the bytes are not a policy; the error names the tensor that is missing or has another
    /// shape.
    pub fn from_safetensors(
        bytes: &[u8],
    ) -> Result<(Self, BTreeMap<String, String>), SafetensorsError> {
        let mut file = File::read(bytes)?;
        let network = file.network("")?;
        let (inputs, outputs) = (network.inputs(), network.outputs());
        let standardizer = Standardizer {
            mean: file.f32s("standardize.mean", &[inputs])?,
            scale: file.f32s("standardize.scale", &[inputs])?,
            limit: file.any_f32s("standardize.limit", &[1])?[0],
        };
        let logarithms = file.f32s("log_deviation", &[outputs])?;
        check_outputs("fc_out.weight", outputs)?;
        let policy = Self::new(network, standardizer, Gaussian::new(&logarithms));
        Ok((policy, file.metadata))
    }
}

impl LearnerState {
    /// Encode the state as a safetensors file; equal states give equal bytes.
    #[must_use]
    pub fn to_safetensors(&self, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        let mut tensors = Tensors::new();
        let networks = [("policy", Some(&self.policy)), ("critic", self.critic.as_ref())];
        for (name, state) in networks {
            let Some(state) = state else { continue };
            put_network(&mut tensors, &format!("{name}."), &state.network);
            put_network(&mut tensors, &format!("{name}.moment1."), &state.moment1);
            put_network(&mut tensors, &format!("{name}.moment2."), &state.moment2);
        }
        let Deviations { logarithms, moment1, moment2 } = &self.deviations;
        let rows = [logarithms.as_slice(), moment1, moment2].concat();
        let shape = vec![3, logarithms.len()];
        tensors.insert("log_deviation".into(), Tensor { shape, values: Values::F32(rows) });
        put(&mut tensors, "learning_rate", &[self.learning_rate]);
        for (name, moments) in [("observed", &self.observed), ("targets", &self.targets)] {
            let shape = vec![2, moments.mean.len()];
            let values = Values::F64([moments.mean.as_slice(), &moments.squares].concat());
            tensors.insert(name.into(), Tensor { shape, values });
        }
        let counts = Values::F64(vec![self.observed.count, self.targets.count]);
        tensors.insert("counts".into(), Tensor { shape: vec![2], values: counts });
        let steps = u64::from(self.policy.steps.unsigned_abs());
        let counters = Values::U64(vec![self.seed, self.updates, steps]);
        tensors.insert("counters".into(), Tensor { shape: vec![3], values: counters });
        tensors::to_bytes(&tensors, &with_activation(self.policy.network.activation, metadata))
    }

    /// Inverse of [`to_safetensors`](Self::to_safetensors); also returns the metadata.
    ///
    /// # Errors
    /// When the bytes are not a state; the error names the tensor that is missing or has another
    /// shape.
    pub fn from_safetensors(
        bytes: &[u8],
    ) -> Result<(Self, BTreeMap<String, String>), SafetensorsError> {
        let mut file = File::read(bytes)?;
        let counters = file.u64s("counters", 3)?;
        let steps = i32::try_from(counters[2]).unwrap_or(i32::MAX);
        let policy = file.trainer("policy", steps)?;
        let has_critic = file.tensors.keys().any(|name| name.starts_with("critic."));
        let critic = if has_critic { Some(file.trainer("critic", steps)?) } else { None };
        let actions = file.size("log_deviation", 1);
        let rows = file.f32s("log_deviation", &[3, actions])?;
        let row = |index: usize| rows[index * actions..(index + 1) * actions].to_vec();
        let deviations = Deviations { logarithms: row(0), moment1: row(1), moment2: row(2) };
        let counts = file.f64s("counts", &[2])?;
        let columns = policy.network.inputs();
        let observed = moments(counts[0], file.f64s("observed", &[2, columns])?);
        let targets = moments(counts[1], file.f64s("targets", &[2, 1])?);
        let learning_rate = file.f32s("learning_rate", &[1])?[0];
        let [seed, updates] = [counters[0], counters[1]];
        let state =
            Self { seed, updates, learning_rate, policy, critic, deviations, observed, targets };
        Ok((state, file.metadata))
    }
}

fn moments(count: f64, rows: Vec<f64>) -> Moments {
    let (mean, squares) = rows.split_at(rows.len() / 2);
    Moments { count, mean: mean.to_vec(), squares: squares.to_vec() }
}

fn with_activation(
    activation: Activation,
    metadata: &BTreeMap<String, String>,
) -> BTreeMap<String, String> {
    let mut metadata = metadata.clone();
    metadata.insert(ACTIVATION_KEY.to_owned(), activation.name().to_owned());
    metadata
}

fn put(tensors: &mut Tensors, name: &str, values: &[f32]) {
    let values = (vec![values.len()], Values::F32(values.to_vec()));
    tensors.insert(name.to_owned(), Tensor { shape: values.0, values: values.1 });
}

fn put_network(tensors: &mut Tensors, prefix: &str, network: &Network) {
    for (layer, name) in network.layers.iter().zip(network.layer_names()) {
        let values = Values::F32(layer.weight.clone());
        let weight = Tensor { shape: vec![layer.outputs, layer.inputs], values };
        tensors.insert(format!("{prefix}{name}.weight"), weight);
        put(tensors, &format!("{prefix}{name}.bias"), &layer.bias);
    }
}

/// Check that the kernels support the number of outputs; otherwise a later call would panic.
fn check_outputs(tensor: &str, outputs: usize) -> Result<(), SafetensorsError> {
    if outputs <= MAX_OUTPUTS {
        return Ok(());
    }
    let expected = format!("[up to {MAX_OUTPUTS}, any]");
    Err(SafetensorsError::Shape { tensor: tensor.to_owned(), found: vec![outputs], expected })
}

/// A safetensors file during reading.
struct File {
    tensors: Tensors,
    activation: Activation,
    metadata: BTreeMap<String, String>,
}

impl File {
    fn read(bytes: &[u8]) -> Result<Self, SafetensorsError> {
        let (tensors, mut metadata) = tensors::from_bytes(bytes)?;
        let activation = parse_activation(metadata.remove(ACTIVATION_KEY).unwrap_or_default())?;
        Ok(Self { tensors, activation, metadata })
    }

    /// Size of a tensor in one dimension, 0 without the tensor.
    fn size(&self, name: &str, dimension: usize) -> usize {
        let shape = self.tensors.get(name).and_then(|tensor| tensor.shape.get(dimension));
        shape.copied().unwrap_or(0)
    }

    fn take(&mut self, name: &str, shape: &[usize]) -> Result<Values, SafetensorsError> {
        let tensor = name.to_owned();
        let Some(found) = self.tensors.remove(name) else {
            return Err(SafetensorsError::MissingTensor { tensor });
        };
        if found.shape != shape || shape.contains(&0) {
            let expected = format!("{shape:?}");
            return Err(SafetensorsError::Shape { tensor, found: found.shape, expected });
        }
        Ok(found.values)
    }

    /// Read finite numbers.
    fn f32s(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, SafetensorsError> {
        let values = self.any_f32s(name, shape)?;
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(index) => {
                let (tensor, value) = (name.to_owned(), values[index]);
                Err(SafetensorsError::NonFinite { tensor, index, value })
            }
        }
    }

    fn any_f32s(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, SafetensorsError> {
        match self.take(name, shape)? {
            Values::F32(values) => Ok(values),
            other => Err(wrong_type(name, &other)),
        }
    }

    fn f64s(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f64>, SafetensorsError> {
        match self.take(name, shape)? {
            Values::F64(values) => Ok(values),
            other => Err(wrong_type(name, &other)),
        }
    }

    fn u64s(&mut self, name: &str, count: usize) -> Result<Vec<u64>, SafetensorsError> {
        match self.take(name, &[count])? {
            Values::U64(values) => Ok(values),
            other => Err(wrong_type(name, &other)),
        }
    }

    /// Read `fc1`, `fc2`, ..., `fc_out` with `prefix`, with at least one hidden layer.
    fn network(&mut self, prefix: &str) -> Result<Network, SafetensorsError> {
        let mut layers: Vec<Dense> = Vec::new();
        let mut name = format!("{prefix}fc1");
        loop {
            let weight_name = format!("{name}.weight");
            let outputs = self.size(&weight_name, 0);
            let inputs = layers.last().map_or(self.size(&weight_name, 1), |layer| layer.outputs);
            let weight = self.f32s(&weight_name, &[outputs, inputs])?;
            let bias = self.f32s(&format!("{name}.bias"), &[outputs])?;
            layers.push(Dense { inputs, outputs, weight, bias });
            if name.ends_with("fc_out") {
                check_outputs(&weight_name, outputs)?;
                return Ok(Network { activation: self.activation, layers });
            }
            let next = format!("{prefix}fc{}", layers.len() + 1);
            let exists = self.tensors.contains_key(&format!("{next}.weight"));
            name = if exists { next } else { format!("{prefix}fc_out") };
        }
    }

    fn trainer(&mut self, name: &str, steps: i32) -> Result<TrainerState, SafetensorsError> {
        let network = self.network(&format!("{name}."))?;
        let moment1 = self.network(&format!("{name}.moment1."))?;
        let moment2 = self.network(&format!("{name}.moment2."))?;
        Ok(TrainerState { network, moment1, moment2, steps })
    }
}

fn wrong_type(name: &str, found: &Values) -> SafetensorsError {
    SafetensorsError::ElementType { tensor: name.to_owned(), found: found.dtype() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ppo::{Learner, PpoSettings, Spaces};

    fn learner(settings: &PpoSettings) -> Learner {
        let spaces = Spaces { observations: 3, actions: 2 };
        let mut learner = Learner::new(settings, spaces, u64::MAX).unwrap();
        learner.observe(&[0.1, 2.0, -3.0, 0.3, 1.0, 5.0]).unwrap();
        learner
    }

    #[test]
    fn states_and_policies_come_back_as_they_were() {
        let metadata = BTreeMap::from([("run".to_owned(), "7".to_owned())]);
        for settings in [PpoSettings::paper(), PpoSettings::upstream()] {
            let settings = PpoSettings { hidden: vec![8, 4], ..settings };
            let learner = learner(&settings);
            let state = learner.state();
            let bytes = state.to_safetensors(&metadata);
            let read = LearnerState::from_safetensors(&bytes).unwrap();
            assert_eq!(read, (state, metadata.clone()));
            assert_eq!(read.0.to_safetensors(&metadata), bytes);
            let policy = learner.policy();
            let bytes = policy.to_safetensors(&metadata);
            let (read, read_metadata) = Policy::from_safetensors(&bytes).unwrap();
            assert_eq!(read_metadata, metadata);
            assert_eq!(read.network(), policy.network());
            assert_eq!(read.standardizer(), policy.standardizer());
            assert_eq!(read.gaussian(), policy.gaussian());
        }
    }

    #[test]
    fn what_is_missing_or_misshaped_is_named() {
        let policy = learner(&PpoSettings { hidden: vec![8], ..PpoSettings::paper() }).policy();
        let bytes = policy.to_safetensors(&BTreeMap::new());
        let (tensors, metadata) = tensors::from_bytes(&bytes).unwrap();
        let refusal = |change: &dyn Fn(&mut Tensors)| {
            let mut tensors = tensors.clone();
            change(&mut tensors);
            let bytes = tensors::to_bytes(&tensors, &metadata);
            Policy::from_safetensors(&bytes).map(|_| ()).unwrap_err().to_string()
        };
        for name in tensors.keys() {
            let text = refusal(&|tensors| {
                tensors.remove(name);
            });
            assert!(text.contains("missing") || text.contains("shape"), "{name}: {text}");
        }
        let text = refusal(&|tensors| put(tensors, "standardize.scale", &[1.0]));
        assert!(text.contains("standardize.scale: found shape [1], expected [3]"), "{text}");
        let text = refusal(&|tensors| put(tensors, "log_deviation", &[0.0, f32::NAN]));
        assert!(text.contains("log_deviation: value NaN at index 1"), "{text}");
        assert!(LearnerState::from_safetensors(&bytes).is_err());
    }
}
