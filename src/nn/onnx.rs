//! ONNX export: the network as one `ModelProto`, for onnxruntime and other ONNX readers.
//!
//! Each dense layer is a `Gemm` node with `transB = 1`, so weights keep PyTorch's order. `Relu`,
//! `Softsign`, `Elu` or `Tanh` nodes are between them; a standardisation before them is `Sub`,
//! `Mul` and `Clip`. The messages below are the required subset of `onnx.proto3` (onnx/onnx,
//! release 1.8: IR version 7, operator set 13), with the same field numbers. Old versions are used
//! on purpose: every recent runtime reads them, and no newer operator is needed.
//!
//! Not supported: reading ONNX, external data files, training information, other operators.

use super::{
    network::{Activation, Dense, Network},
    standardizer::Standardizer,
};
use prost::Message;
use std::collections::BTreeMap;

/// Name of the model's only input: command and velocity history, float32 `[batch, inputs]`.
pub const INPUT_NAME: &str = "history";

/// Name of the model's only output: next velocity, float32 `[batch, outputs]`.
pub const OUTPUT_NAME: &str = "velocity";

/// Name of the free first dimension of input and output.
pub const BATCH_NAME: &str = "batch";

/// ONNX file format version, that of release 1.8 (December 2020).
const IR_VERSION: i64 = 7;

/// Version of the default operator set, that of release 1.8.
const OPSET_VERSION: i64 = 13;

/// `TensorProto.DataType.FLOAT`
const FLOAT: i32 = 1;

/// `AttributeProto.AttributeType.INT`
const INT: i32 = 2;

/// Interface of a model: names of its input and output, and preprocessing.
#[derive(Debug, Clone, Copy)]
pub struct Interface<'a> {
    /// Name of the input, float32 `[batch, inputs]`.
    pub input: &'a str,
    /// Name of the output, float32 `[batch, outputs]`.
    pub output: &'a str,
    /// Standardisation of the input before the network.
    pub standardizer: Option<&'a Standardizer>,
}

impl Interface<'static> {
    /// Interface of an actuator model.
    pub const ACTUATOR: Self = Self { input: INPUT_NAME, output: OUTPUT_NAME, standardizer: None };
}

/// Write the network as the bytes of an ONNX file, from `history` to `velocity`.
///
/// `metadata` becomes `metadata_props`, in the map's order: normalisation, history length, origin.
/// Equal arguments give equal bytes.
#[must_use]
pub fn to_onnx(network: &Network, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    to_onnx_with(network, &Interface::ACTUATOR, metadata)
}

/// Write the network as [`to_onnx`] does, with another interface.
#[must_use]
pub fn to_onnx_with(
    network: &Network,
    interface: &Interface<'_>,
    metadata: &BTreeMap<String, String>,
) -> Vec<u8> {
    let metadata_props = metadata
        .iter()
        .map(|(key, value)| StringEntry { key: key.clone(), value: value.clone() })
        .collect();
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "klasktron".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph(network, interface)),
        opset_import: vec![OperatorSet { version: OPSET_VERSION }],
        metadata_props,
    };
    model.encode_to_vec()
}

/// Build the chain of nodes. Every value is named after the node that produces it; the last is the
/// output.
fn graph(network: &Network, interface: &Interface<'_>) -> Graph {
    let last = network.layers.len() - 1;
    let mut nodes = Vec::new();
    let mut initializers = Vec::new();
    let mut value = interface.input.to_owned();
    if let Some(standardizer) = interface.standardizer {
        value = standardize(standardizer, value, &mut nodes, &mut initializers);
    }
    for (index, (layer, name)) in network.layers.iter().zip(network.layer_names()).enumerate() {
        let is_last = index == last;
        let output = if is_last { interface.output.to_owned() } else { format!("{name}.linear") };
        nodes.push(gemm(&name, value, output.clone()));
        initializers.extend(parameters(layer, &name));
        value = output;
        if !is_last {
            let output = format!("{name}.active");
            nodes.push(activate(network.activation, &name, value, output.clone()));
            value = output;
        }
    }
    Graph {
        nodes,
        name: "klasktron".to_owned(),
        initializers,
        inputs: vec![value_info(interface.input, network.inputs())],
        outputs: vec![value_info(interface.output, network.outputs())],
    }
}

/// Add the nodes of `clamp((input - mean) * scale, -limit, limit)`; return the name of the result.
fn standardize(
    standardizer: &Standardizer,
    input: String,
    nodes: &mut Vec<Node>,
    initializers: &mut Vec<Tensor>,
) -> String {
    let columns = [standardizer.columns()];
    let (mean, scale) = ("standardize.mean".to_owned(), "standardize.scale".to_owned());
    initializers.push(tensor(mean.clone(), &columns, &standardizer.mean));
    initializers.push(tensor(scale.clone(), &columns, &standardizer.scale));
    let mut value = input;
    let mut add = |op_type: &str, others: Vec<String>| {
        let output = format!("standardize.{}", op_type.to_lowercase());
        nodes.push(Node {
            inputs: [vec![std::mem::take(&mut value)], others].concat(),
            outputs: vec![output.clone()],
            name: output.clone(),
            op_type: op_type.to_owned(),
            attributes: Vec::new(),
        });
        value = output;
    };
    add("Sub", vec![mean]);
    add("Mul", vec![scale]);
    if standardizer.limit.is_finite() {
        let bounds = ["standardize.low", "standardize.high"].map(str::to_owned);
        add("Clip", bounds.to_vec());
        for (name, bound) in bounds.into_iter().zip([-standardizer.limit, standardizer.limit]) {
            initializers.push(tensor(name, &[], &[bound]));
        }
    }
    value
}

/// Return the node of `output = input weight^T + bias`.
fn gemm(layer: &str, input: String, output: String) -> Node {
    Node {
        inputs: vec![input, format!("{layer}.weight"), format!("{layer}.bias")],
        outputs: vec![output],
        name: layer.to_owned(),
        op_type: "Gemm".to_owned(),
        attributes: vec![Attribute { name: "transB".to_owned(), i: 1, kind: INT }],
    }
}

fn activate(activation: Activation, layer: &str, input: String, output: String) -> Node {
    let op_type = match activation {
        Activation::Relu => "Relu",
        Activation::Softsign => "Softsign",
        Activation::Elu => "Elu",
        Activation::Tanh => "Tanh",
    };
    Node {
        inputs: vec![input],
        outputs: vec![output],
        name: format!("{layer}.{}", op_type.to_lowercase()),
        op_type: op_type.to_owned(),
        attributes: Vec::new(),
    }
}

fn parameters(layer: &Dense, name: &str) -> [Tensor; 2] {
    [
        tensor(format!("{name}.weight"), &[layer.outputs, layer.inputs], &layer.weight),
        tensor(format!("{name}.bias"), &[layer.outputs], &layer.bias),
    ]
}

fn tensor(name: String, shape: &[usize], values: &[f32]) -> Tensor {
    Tensor {
        dims: shape.iter().map(|&size| size as i64).collect(),
        data_type: FLOAT,
        name,
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
    }
}

/// Return a float32 value of shape `[batch, width]`.
fn value_info(name: &str, width: usize) -> ValueInfo {
    let batch = Dimension { size: None, name: Some(BATCH_NAME.to_owned()) };
    let width = Dimension { size: Some(width as i64), name: None };
    let shape = TensorShape { dims: vec![batch, width] };
    let tensor = TensorType { elem_type: FLOAT, shape: Some(shape) };
    ValueInfo { name: name.to_owned(), kind: Some(ValueType { tensor: Some(tensor) }) }
}

#[derive(Clone, PartialEq, Message)]
struct Model {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(string, tag = "3")]
    producer_version: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
    #[prost(message, repeated, tag = "14")]
    metadata_props: Vec<StringEntry>,
}

/// Operator set. The domain, field 1, stays empty: the default operator set.
#[derive(Clone, PartialEq, Message)]
struct OperatorSet {
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct StringEntry {
    #[prost(string, tag = "1")]
    key: String,
    #[prost(string, tag = "2")]
    value: String,
}

#[derive(Clone, PartialEq, Message)]
struct Graph {
    #[prost(message, repeated, tag = "1")]
    nodes: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializers: Vec<Tensor>,
    #[prost(message, repeated, tag = "11")]
    inputs: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    outputs: Vec<ValueInfo>,
}

#[derive(Clone, PartialEq, Message)]
struct Node {
    #[prost(string, repeated, tag = "1")]
    inputs: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    outputs: Vec<String>,
    #[prost(string, tag = "3")]
    name: String,
    #[prost(string, tag = "4")]
    op_type: String,
    #[prost(message, repeated, tag = "5")]
    attributes: Vec<Attribute>,
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, tag = "3")]
    i: i64,
    #[prost(int32, tag = "20")]
    kind: i32,
}

#[derive(Clone, PartialEq, Message)]
struct Tensor {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<ValueType>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueType {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    elem_type: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<TensorShape>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorShape {
    #[prost(message, repeated, tag = "1")]
    dims: Vec<Dimension>,
}

/// Number or name, a oneof in `onnx.proto3`: exactly one is set.
#[derive(Clone, PartialEq, Message)]
struct Dimension {
    #[prost(int64, optional, tag = "1")]
    size: Option<i64>,
    #[prost(string, optional, tag = "2")]
    name: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn metadata() -> BTreeMap<String, String> {
        [("rate_hz", "50"), ("axis", "both")].map(|(k, v)| (k.to_owned(), v.to_owned())).into()
    }

    fn decode(network: &Network) -> Model {
        Model::decode(to_onnx(network, &metadata()).as_slice()).unwrap()
    }

    #[test]
    fn nodes_form_one_chain_from_history_to_velocity() {
        for (activation, op_type) in
            [(Activation::Relu, "Relu"), (Activation::Softsign, "Softsign")]
        {
            let graph = decode(&small(activation)).graph.unwrap();
            let ops: Vec<&str> = graph.nodes.iter().map(|node| node.op_type.as_str()).collect();
            assert_eq!(ops, ["Gemm", op_type, "Gemm"]);
            assert_eq!(graph.nodes[0].inputs, ["history", "fc1.weight", "fc1.bias"]);
            assert_eq!(graph.nodes[1].inputs, graph.nodes[0].outputs);
            assert_eq!(graph.nodes[2].inputs[0], graph.nodes[1].outputs[0]);
            assert_eq!(graph.nodes[2].outputs, ["velocity"]);
        }
    }

    #[test]
    fn tensors_keep_pytorch_order_and_shape() {
        let network = small(Activation::Relu);
        let graph = decode(&network).graph.unwrap();
        let found: Vec<(&str, &[i64])> =
            graph.initializers.iter().map(|t| (t.name.as_str(), t.dims.as_slice())).collect();
        let expected: [(&str, &[i64]); 4] = [
            ("fc1.weight", &[2, 3]),
            ("fc1.bias", &[2]),
            ("fc_out.weight", &[1, 2]),
            ("fc_out.bias", &[1]),
        ];
        assert_eq!(found, expected);
        let values: Vec<f32> = graph.initializers[0]
            .raw_data
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(values, network.layers[0].weight);
    }

    #[test]
    fn batch_dimension_is_free_and_metadata_is_kept() {
        let model = decode(&small(Activation::Relu));
        let graph = model.graph.unwrap();
        assert_eq!(graph.inputs, [value_info("history", 3)]);
        assert_eq!(graph.outputs, [value_info("velocity", 1)]);
        let keys: Vec<&str> = model.metadata_props.iter().map(|e| e.key.as_str()).collect();
        assert_eq!(keys, ["axis", "rate_hz"]);
        assert_eq!((model.ir_version, model.opset_import[0].version), (7, 13));
    }

    #[test]
    fn a_standardisation_comes_first_and_names_are_free() {
        let standardizer = Standardizer { mean: vec![1.0; 3], scale: vec![2.0; 3], limit: 5.0 };
        let chain = |standardizer: &Standardizer| {
            let interface = Interface {
                input: "observation",
                output: "action",
                standardizer: Some(standardizer),
            };
            let bytes = to_onnx_with(&small(Activation::Elu), &interface, &metadata());
            Model::decode(bytes.as_slice()).unwrap().graph.unwrap()
        };
        let graph = chain(&standardizer);
        let ops: Vec<&str> = graph.nodes.iter().map(|node| node.op_type.as_str()).collect();
        assert_eq!(ops, ["Sub", "Mul", "Clip", "Gemm", "Elu", "Gemm"]);
        assert_eq!(graph.nodes[0].inputs, ["observation", "standardize.mean"]);
        for pair in graph.nodes.windows(2) {
            assert_eq!(pair[0].outputs[0], pair[1].inputs[0]);
        }
        assert_eq!(graph.nodes[5].outputs, ["action"]);
        assert_eq!(graph.inputs, [value_info("observation", 3)]);
        let scalar = graph.initializers.iter().find(|t| t.name == "standardize.low").unwrap();
        assert_eq!(
            (scalar.dims.len(), scalar.raw_data.as_slice()),
            (0, &(-5.0f32).to_le_bytes()[..])
        );
        assert_eq!(chain(&Standardizer::identity(3)).nodes.len(), 5, "no limit, no Clip");
    }

    #[test]
    fn single_layer_is_one_node() {
        let mut network = small(Activation::Relu);
        network.layers.truncate(1);
        let graph = decode(&network).graph.unwrap();
        assert_eq!(graph.nodes.len(), 1);
        assert_eq!(graph.nodes[0].outputs, ["velocity"]);
    }

    /// The decoding tests share the field numbers with the code; this test does not. Renew the
    /// number only after `scripts/check_weights.py` has accepted a new file.
    #[test]
    fn bytes_are_those_that_onnx_accepted() {
        let bytes = graph(&small(Activation::Softsign), &Interface::ACTUATOR).encode_to_vec();
        assert_eq!(crc32fast::hash(&bytes), 2_276_033_303);
        let header = to_onnx(&small(Activation::Relu), &BTreeMap::new());
        assert!(header.starts_with(b"\x08\x07\x12\x09klasktron"));
    }
}
