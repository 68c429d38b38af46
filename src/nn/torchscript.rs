//! TorchScript export: the network as a scripted module for `torch.jit.load`.
//!
//! The loaded module is a `torch.jit.ScriptModule` whose `forward(input)` maps a float32 tensor of
//! shape `[batch, inputs]` to one of shape `[batch, outputs]`. For an actuator model, the inputs are
//! past velocity commands and measured velocities (m/s, board frame), ordered as in
//! `actuator::Layout`. The output is the next velocity (vx, vy) in m/s.
//!
//! | inputs of 10 steps | `klasktron` layout: 40 | `klask-rl` layout: 38 |
//! |---|---|---|
//! | commands (vx, vy), newest first | 20 | 20 |
//! | velocities (vx, vy), newest first | 20 | 18 |
//!
//! Isaac Lab's `ActuatorNetMLP` cannot use this module: that class supplies joint position errors
//! and velocities and expects joint torques. Isaac Lab needs a custom actuator class for it (a
//! subclass of `ActuatorBase`). That class keeps the history of commands and velocities, evaluates
//! the module once per control period, and returns joint velocities.
//!
//! The archive is a zip of stored (never compressed) files: `data.pkl`, the module tree in pickle
//! protocol 2; `data/<n>`, one raw little-endian tensor each, aligned to 64 bytes; `code/`, the
//! source of the classes; `constants.pkl`, `version`, `byteorder`. Sources: PyTorch
//! `torch/csrc/jit/docs/serialization.md` and `caffe2/serialize/inline_container.cc`, the zip
//! `APPNOTE` sections 4.3.7 to 4.3.16, and archives written by torch 2.15 with the same layout. The
//! module has submodules `fc1` ... `fc_out` of class `Linear`, so that `state_dict` has upstream's
//! names; parameters do not require gradients.
//!
//! A policy has a standardisation before its first layer, with the buffers `mean` and `scale`.
//! [`to_state_dict`] writes the tensors alone, as `torch.save` does.
//!
//! Not supported: reading archives, debug records, and zip64 (4 GiB and more). An actuator model
//! takes the network's own inputs; its units are in the safetensors file.

use super::{
    network::{Activation, Network},
    standardizer::Standardizer,
};
use std::collections::BTreeMap;

/// Directory of all records; torch accepts any name.
const ARCHIVE: &str = "network";

/// Alignment of each record's data in bytes; torch's `kFieldAlignment`.
const ALIGNMENT: usize = 64;

/// Version of the archive format, torch's `kProducedFileFormatVersion`. `true_divide` instead of
/// `div` in the code keeps version 3 correct, because `div` changed its meaning in version 4.
const VERSION: &[u8] = b"3\n";

/// Empty tuple: the code uses no constant tensors.
const CONSTANTS: &[u8] = b"\x80\x02).";

/// Module of the class of a layer in torch, so that its `original_name` is `Linear`.
const LINEAR_MODULE: &str = "__torch__.torch.nn.modules.linear";

/// Source of the class of every layer; sizes come from its tensors.
const LINEAR_CODE: &str = "\
class Linear(Module):
  __parameters__ = [\"weight\", \"bias\", ]
  __buffers__ = []
  weight : Tensor
  bias : Tensor
  training : bool
  def forward(self: __torch__.torch.nn.modules.linear.Linear,
    input: Tensor) -> Tensor:
    weight = self.weight
    bias = self.bias
    return torch.linear(input, weight, bias)
";

/// Write the network as the bytes of a TorchScript archive, usually named `.pt`.
///
/// The loaded module maps float32 `[batch, inputs]` to `[batch, outputs]`. Equal networks give
/// equal bytes: time stamps are fixed to 1980-01-01.
///
/// # Panics
/// When the archive would reach 4 GiB.
#[must_use]
pub fn to_torchscript(network: &Network) -> Vec<u8> {
    to_torchscript_with(network, None, &BTreeMap::new())
}

/// Write the network as [`to_torchscript`] does, after a standardisation of its input. A `metadata`
/// that is not empty becomes the extra file `metadata.json` (`_extra_files` of `torch.jit.load`).
///
/// # Panics
/// When the archive would reach 4 GiB.
#[must_use]
pub fn to_torchscript_with(
    network: &Network,
    standardizer: Option<&Standardizer>,
    metadata: &BTreeMap<String, String>,
) -> Vec<u8> {
    let mut archive = Archive::default();
    archive.add("data.pkl", &module_pickle(network, standardizer));
    archive.add("code/__torch__.py", network_code(network, standardizer).as_bytes());
    archive.add("code/__torch__/torch/nn/modules/linear.py", LINEAR_CODE.as_bytes());
    let moments = standardizer.into_iter().flat_map(|own| [&own.mean, &own.scale]);
    archive.add_tensors(tensors_of(network).chain(moments));
    if !metadata.is_empty() {
        let json = serde_json::to_vec(metadata);
        let json = json.unwrap_or_else(|_plain| unreachable!("a map of strings is plain data"));
        archive.add("extra/metadata.json", &json);
    }
    archive.add("constants.pkl", CONSTANTS);
    archive.add("version", VERSION);
    archive.add("byteorder", b"little");
    archive.finish()
}

/// Write the network as a state dict, `fc1.weight` to `fc_out.bias`, as `torch.save` writes one.
/// `torch.load` reads it with `weights_only=True`. Equal networks give equal bytes.
///
/// # Panics
/// When the archive would reach 4 GiB.
#[must_use]
pub fn to_state_dict(network: &Network) -> Vec<u8> {
    let mut pickle = Pickle::new();
    pickle.global("collections", "OrderedDict");
    pickle.ops(b")R(");
    for (index, (layer, name)) in network.layers.iter().zip(network.layer_names()).enumerate() {
        pickle.text(&format!("{name}.weight"));
        pickle.tensor(2 * index, &[layer.outputs, layer.inputs]);
        pickle.text(&format!("{name}.bias"));
        pickle.tensor(2 * index + 1, &[layer.outputs]);
    }
    pickle.ops(b"u");
    let mut archive = Archive::default();
    archive.add("data.pkl", &pickle.finish());
    archive.add("byteorder", b"little");
    archive.add_tensors(tensors_of(network));
    archive.add("version", VERSION);
    archive.finish()
}

/// Weight and bias of each layer, in order.
fn tensors_of(network: &Network) -> impl Iterator<Item = &Vec<f32>> {
    network.layers.iter().flat_map(|layer| [&layer.weight, &layer.bias])
}

/// Return the source of the class of the whole network, in TorchScript's own serialised form.
fn network_code(network: &Network, standardizer: Option<&Standardizer>) -> String {
    let names = network.layer_names();
    let last = names.len() - 1;
    let buffers = if standardizer.is_some() { "\"mean\", \"scale\", " } else { "" };
    let mut code =
        format!("class Network(Module):\n  __parameters__ = []\n  __buffers__ = [{buffers}]\n");
    code += "  training : bool\n";
    if standardizer.is_some() {
        code += "  mean : Tensor\n  scale : Tensor\n";
    }
    for name in &names {
        code += &format!("  {name} : {LINEAR_MODULE}.Linear\n");
    }
    code += "  def forward(self: __torch__.Network,\n    input: Tensor) -> Tensor:\n";
    let mut value = "input".to_owned();
    if let Some(Standardizer { limit, .. }) = standardizer {
        code += "    mean = self.mean\n    scale = self.scale\n";
        value = "torch.mul(torch.sub(input, mean), scale)".to_owned();
        if limit.is_finite() {
            value = format!("torch.clamp({value}, {:?}, {:?})", -limit, limit);
        }
        code += &format!("    x = {value}\n");
        value = "x".to_owned();
    }
    for (index, name) in names.iter().enumerate() {
        code += &format!("    {name} = self.{name}\n    z{index} = ({name}).forward({value}, )\n");
        value = format!("z{index}");
        if index < last {
            code += &format!("    x{index} = {}\n", activation_code(network.activation, &value));
            value = format!("x{index}");
        }
    }
    code + &format!("    return {value}\n")
}

fn activation_code(activation: Activation, z: &str) -> String {
    match activation {
        Activation::Relu => format!("torch.relu({z})"),
        Activation::Softsign => format!("torch.true_divide({z}, torch.add(torch.abs({z}), 1))"),
        Activation::Elu => format!("torch.elu({z})"),
        Activation::Tanh => format!("torch.tanh({z})"),
    }
}

/// Return the module tree with its tensors, as pickle.
fn module_pickle(network: &Network, standardizer: Option<&Standardizer>) -> Vec<u8> {
    let mut pickle = Pickle::new();
    pickle.begin_module("__torch__", "Network");
    for (index, (layer, name)) in network.layers.iter().zip(network.layer_names()).enumerate() {
        pickle.text(&name);
        pickle.begin_module(LINEAR_MODULE, "Linear");
        pickle.text("weight");
        pickle.tensor(2 * index, &[layer.outputs, layer.inputs]);
        pickle.text("bias");
        pickle.tensor(2 * index + 1, &[layer.outputs]);
        pickle.end_module();
    }
    if let Some(own) = standardizer {
        for (offset, name) in ["mean", "scale"].into_iter().enumerate() {
            pickle.text(name);
            pickle.tensor(2 * network.layers.len() + offset, &[own.columns()]);
        }
    }
    pickle.end_module();
    pickle.finish()
}

/// Writer of a pickle of protocol 2; the letters are its opcodes (Python `pickletools`).
struct Pickle {
    bytes: Vec<u8>,
}

impl Pickle {
    fn new() -> Self {
        Self { bytes: b"\x80\x02".to_vec() }
    }

    fn ops(&mut self, opcodes: &[u8]) {
        self.bytes.extend_from_slice(opcodes);
    }

    /// Append GLOBAL.
    fn global(&mut self, module: &str, name: &str) {
        self.bytes.extend_from_slice(format!("c{module}\n{name}\n").as_bytes());
    }

    /// Append BINUNICODE.
    fn text(&mut self, text: &str) {
        self.ops(b"X");
        self.ops(&to_u32(text.len()).to_le_bytes());
        self.ops(text.as_bytes());
    }

    /// Append BININT, a signed number of four bytes; sizes stay far below its range.
    fn int(&mut self, value: usize) {
        self.ops(b"J");
        self.ops(&to_u32(value).to_le_bytes());
    }

    /// Append MARK, the numbers, TUPLE.
    fn ints(&mut self, values: &[usize]) {
        self.ops(b"(");
        for &value in values {
            self.int(value);
        }
        self.ops(b"t");
    }

    /// Append class, EMPTY_TUPLE, NEWOBJ, EMPTY_DICT, MARK; its attributes follow as key and value.
    fn begin_module(&mut self, module: &str, class: &str) {
        self.global(module, class);
        self.ops(b")\x81}(");
        self.text("training");
        self.ops(b"\x89");
    }

    /// Append SETITEMS, BUILD.
    fn end_module(&mut self) {
        self.ops(b"ub");
    }

    /// Append `_rebuild_tensor_v2(storage, offset 0, shape, strides, requires_grad, hooks)`. The
    /// storage is the persistent id `("storage", FloatStorage, key, "cpu", count)`.
    fn tensor(&mut self, key: usize, shape: &[usize]) {
        self.global("torch._utils", "_rebuild_tensor_v2");
        self.ops(b"((");
        self.text("storage");
        self.global("torch", "FloatStorage");
        self.text(&key.to_string());
        self.text("cpu");
        self.int(shape.iter().product());
        self.ops(b"tQ");
        self.int(0);
        self.ints(shape);
        self.ints(&row_major_strides(shape));
        self.ops(b"\x89");
        self.global("collections", "OrderedDict");
        self.ops(b")RtR");
    }

    /// Append STOP.
    fn finish(mut self) -> Vec<u8> {
        self.ops(b".");
        self.bytes
    }
}

fn row_major_strides(shape: &[usize]) -> Vec<usize> {
    (0..shape.len()).map(|axis| shape[axis + 1..].iter().product()).collect()
}

/// Writer of a zip of stored files.
#[derive(Default)]
struct Archive {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    n_records: usize,
}

impl Archive {
    /// Append one record; a padding field of PyTorch's kind moves its data to the next multiple of
    /// [`ALIGNMENT`].
    fn add(&mut self, name: &str, data: &[u8]) {
        const HEADER: usize = 30;
        let path = format!("{ARCHIVE}/{name}");
        let offset = self.bytes.len();
        let unpadded = offset + HEADER + path.len() + 4;
        let padding = unpadded.next_multiple_of(ALIGNMENT) - unpadded;
        let fields = common_fields(&path, data);

        self.bytes.extend_from_slice(b"PK\x03\x04");
        self.bytes.extend_from_slice(&fields);
        self.bytes.extend_from_slice(&to_u16(4 + padding).to_le_bytes());
        self.bytes.extend_from_slice(path.as_bytes());
        self.bytes.extend_from_slice(b"FB");
        self.bytes.extend_from_slice(&to_u16(padding).to_le_bytes());
        self.bytes.resize(self.bytes.len() + padding, b'Z');
        self.bytes.extend_from_slice(data);

        self.directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        self.directory.extend_from_slice(&fields);
        // No extra field, no comment, disk 0, no attributes.
        self.directory.extend_from_slice(&[0; 12]);
        self.directory.extend_from_slice(&to_u32(offset).to_le_bytes());
        self.directory.extend_from_slice(path.as_bytes());
        self.n_records += 1;
    }

    /// Append tensors as the records `data/0`, `data/1`, ...
    fn add_tensors<'a>(&mut self, tensors: impl Iterator<Item = &'a Vec<f32>>) {
        for (index, tensor) in tensors.enumerate() {
            let bytes: Vec<u8> = tensor.iter().flat_map(|value| value.to_le_bytes()).collect();
            self.add(&format!("data/{index}"), &bytes);
        }
    }

    /// Return the records, the directory and the end record.
    fn finish(mut self) -> Vec<u8> {
        let offset = to_u32(self.bytes.len());
        let n_records = to_u16(self.n_records).to_le_bytes();
        self.bytes.extend_from_slice(&self.directory);
        self.bytes.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        self.bytes.extend_from_slice(&n_records);
        self.bytes.extend_from_slice(&n_records);
        self.bytes.extend_from_slice(&to_u32(self.directory.len()).to_le_bytes());
        self.bytes.extend_from_slice(&offset.to_le_bytes());
        self.bytes.extend_from_slice(&[0; 2]);
        self.bytes
    }
}

/// Return the common fields of a record's header and its directory entry, from the version needed
/// (2.0) to the length of the path: no flags, stored, midnight of 1980-01-01, checksum, size twice.
fn common_fields(path: &str, data: &[u8]) -> Vec<u8> {
    let size = to_u32(data.len()).to_le_bytes();
    let mut fields = b"\x14\0\0\0\0\0\0\0\x21\0".to_vec();
    fields.extend_from_slice(&crc32fast::hash(data).to_le_bytes());
    fields.extend_from_slice(&size);
    fields.extend_from_slice(&size);
    fields.extend_from_slice(&to_u16(path.len()).to_le_bytes());
    fields
}

fn to_u32(size: usize) -> u32 {
    u32::try_from(size).expect("a network archive stays below 4 GiB")
}

fn to_u16(size: usize) -> u16 {
    u16::try_from(size).expect("a network archive has short names and fewer than 65536 records")
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn u16_at(bytes: &[u8], at: usize) -> usize {
        usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()))
    }

    fn u32_at(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    /// Return path, offset of the data, and data of each record, found through the directory.
    fn records(zip: &[u8]) -> Vec<(String, usize, Vec<u8>)> {
        let end = zip.len() - 22;
        assert_eq!(&zip[end..end + 4], b"PK\x05\x06");
        let mut at = u32_at(zip, end + 16);
        assert_eq!(at + u32_at(zip, end + 12), end);
        let mut found = Vec::new();
        while at < end {
            assert_eq!(&zip[at..at + 4], b"PK\x01\x02");
            let path_len = u16_at(zip, at + 28);
            let path = String::from_utf8(zip[at + 46..at + 46 + path_len].to_vec()).unwrap();
            let local = u32_at(zip, at + 42);
            assert_eq!(&zip[local..local + 4], b"PK\x03\x04");
            assert_eq!(&zip[local + 4..local + 28], &zip[at + 6..at + 30]);
            let start = local + 30 + path_len + u16_at(zip, local + 28);
            let data = zip[start..start + u32_at(zip, at + 24)].to_vec();
            assert_eq!(crc32fast::hash(&data) as usize, u32_at(zip, at + 16));
            found.push((path, start, data));
            at += 46 + path_len;
        }
        assert_eq!(found.len(), u16_at(zip, end + 10));
        found
    }

    #[test]
    fn records_are_complete_and_aligned() {
        let found = records(&to_torchscript(&small(Activation::Relu)));
        let paths: Vec<&str> = found.iter().map(|(path, ..)| path.as_str()).collect();
        let expected = [
            "network/data.pkl",
            "network/code/__torch__.py",
            "network/code/__torch__/torch/nn/modules/linear.py",
            "network/data/0",
            "network/data/1",
            "network/data/2",
            "network/data/3",
            "network/constants.pkl",
            "network/version",
            "network/byteorder",
        ];
        assert_eq!(paths, expected);
        assert!(found.iter().all(|(_, start, _)| start % ALIGNMENT == 0));
    }

    #[test]
    fn tensors_are_raw_little_endian_floats() {
        let network = small(Activation::Relu);
        let found = records(&to_torchscript(&network));
        let values: Vec<f32> = found[3]
            .2
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(values, network.layers[0].weight);
    }

    #[test]
    fn code_reads_like_the_network() {
        let expected = "\
class Network(Module):
  __parameters__ = []
  __buffers__ = []
  training : bool
  fc1 : __torch__.torch.nn.modules.linear.Linear
  fc_out : __torch__.torch.nn.modules.linear.Linear
  def forward(self: __torch__.Network,
    input: Tensor) -> Tensor:
    fc1 = self.fc1
    z0 = (fc1).forward(input, )
    x0 = torch.true_divide(z0, torch.add(torch.abs(z0), 1))
    fc_out = self.fc_out
    z1 = (fc_out).forward(x0, )
    return z1
";
        assert_eq!(network_code(&small(Activation::Softsign), None), expected);
        assert!(network_code(&small(Activation::Relu), None).contains("x0 = torch.relu(z0)\n"));
        let network = small(Activation::Relu);
        let columns = network.inputs();
        let standardizer = Standardizer { limit: 5.0, ..Standardizer::identity(columns) };
        let code = network_code(&network, Some(&standardizer));
        let clamp = "x = torch.clamp(torch.mul(torch.sub(input, mean), scale), -5.0, 5.0)\n";
        assert!(code.contains(clamp) && code.contains("(fc1).forward(x, )"), "{code}");
    }

    #[test]
    fn strides_are_row_major() {
        assert_eq!(row_major_strides(&[64, 40]), [40, 1]);
        assert_eq!(row_major_strides(&[64]), [1]);
    }

    #[test]
    fn a_state_dict_has_the_records_of_torch_save() {
        let found = records(&to_state_dict(&small(Activation::Softsign)));
        let paths: Vec<&str> = found.iter().map(|(path, ..)| path.as_str()).collect();
        let expected = ["data.pkl", "byteorder", "data/0", "data/1", "data/2", "data/3", "version"];
        assert_eq!(paths, expected.map(|name| format!("network/{name}")));
        let pickle = String::from_utf8_lossy(&found[0].2).into_owned();
        assert!(pickle.contains("ccollections\nOrderedDict\n)R("));
        assert!(pickle.contains("fc1.weight") && pickle.contains("fc_out.bias"));
    }

    /// Renew the number only after `scripts/check_weights.py` has accepted a new file.
    #[test]
    fn bytes_are_those_that_torch_accepted() {
        assert_eq!(crc32fast::hash(&to_torchscript(&small(Activation::Softsign))), 2_941_473_347);
    }
}
