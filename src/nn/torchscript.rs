//! TorchScript export: an archive for `torch.jit.load`, as Isaac Lab's `ActuatorNetMLP` reads its
//! `network_file`.
//!
//! The archive is a zip of stored (never compressed) files: `data.pkl`, the module tree in pickle
//! protocol 2; `data/<n>`, one raw little-endian tensor each, aligned to 64 bytes; `code/`, the
//! source of the classes; `constants.pkl`, `version`, `byteorder`. Sources: PyTorch
//! `torch/csrc/jit/docs/serialization.md` and `caffe2/serialize/inline_container.cc`, the zip
//! `APPNOTE` sections 4.3.7 to 4.3.16, and archives written by torch 2.15, whose layout is followed.
//! The module has submodules `fc1` ... `fc_out` of class `Linear`, so that `state_dict` carries
//! upstream's names; parameters do not require gradients.
//!
//! Left out: reading archives, debug records, zip64 (4 GiB and more), the normalisation constants
//! (put them in the safetensors file; the module takes the network's own inputs).

use super::network::{Activation, Network};

/// Directory of all records; torch takes whatever name comes first.
const ARCHIVE: &str = "network";

/// Where each record's data begins, in bytes; torch's `kFieldAlignment`.
const ALIGNMENT: usize = 64;

/// Archive format, torch's `kProducedFileFormatVersion`. `true_divide` instead of `div` in the code
/// keeps version 3 true: `div` changed its meaning in version 4.
const VERSION: &[u8] = b"3\n";

/// An empty tuple: the code uses no constant tensors.
const CONSTANTS: &[u8] = b"\x80\x02).";

/// Where torch keeps the class of a layer, so that its `original_name` reads `Linear`.
const LINEAR_MODULE: &str = "__torch__.torch.nn.modules.linear";

/// The class of every layer; sizes come from its tensors.
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

/// The network as the bytes of a TorchScript archive, usually named `.pt`.
///
/// The loaded module maps float32 `[batch, inputs]` to `[batch, outputs]`. Equal networks give
/// equal bytes: time stamps are fixed to 1980-01-01.
///
/// # Panics
/// When the archive would reach 4 GiB.
#[must_use]
pub fn to_torchscript(network: &Network) -> Vec<u8> {
    let mut archive = Archive::default();
    archive.add("data.pkl", &module_pickle(network));
    archive.add("code/__torch__.py", network_code(network).as_bytes());
    archive.add("code/__torch__/torch/nn/modules/linear.py", LINEAR_CODE.as_bytes());
    let tensors = network.layers.iter().flat_map(|layer| [&layer.weight, &layer.bias]);
    for (index, tensor) in tensors.enumerate() {
        let bytes: Vec<u8> = tensor.iter().flat_map(|value| value.to_le_bytes()).collect();
        archive.add(&format!("data/{index}"), &bytes);
    }
    archive.add("constants.pkl", CONSTANTS);
    archive.add("version", VERSION);
    archive.add("byteorder", b"little");
    archive.finish()
}

/// The class of the whole network, in TorchScript's own serialised form.
fn network_code(network: &Network) -> String {
    let names = network.layer_names();
    let last = names.len() - 1;
    let mut code = "class Network(Module):\n  __parameters__ = []\n  __buffers__ = []\n".to_owned();
    code += "  training : bool\n";
    for name in &names {
        code += &format!("  {name} : {LINEAR_MODULE}.Linear\n");
    }
    code += "  def forward(self: __torch__.Network,\n    input: Tensor) -> Tensor:\n";
    let mut value = "input".to_owned();
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

/// The module tree with its tensors, as pickle.
fn module_pickle(network: &Network) -> Vec<u8> {
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
    pickle.end_module();
    pickle.finish()
}

/// A pickle of protocol 2 in the making; the letters are its opcodes (Python `pickletools`).
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

    /// GLOBAL
    fn global(&mut self, module: &str, name: &str) {
        self.bytes.extend_from_slice(format!("c{module}\n{name}\n").as_bytes());
    }

    /// BINUNICODE
    fn text(&mut self, text: &str) {
        self.ops(b"X");
        self.ops(&to_u32(text.len()).to_le_bytes());
        self.ops(text.as_bytes());
    }

    /// BININT, a signed number of four bytes; sizes stay far below its range.
    fn int(&mut self, value: usize) {
        self.ops(b"J");
        self.ops(&to_u32(value).to_le_bytes());
    }

    /// MARK, the numbers, TUPLE
    fn ints(&mut self, values: &[usize]) {
        self.ops(b"(");
        for &value in values {
            self.int(value);
        }
        self.ops(b"t");
    }

    /// Class, EMPTY_TUPLE, NEWOBJ, EMPTY_DICT, MARK: its attributes follow as key and value.
    fn begin_module(&mut self, module: &str, class: &str) {
        self.global(module, class);
        self.ops(b")\x81}(");
        self.text("training");
        self.ops(b"\x89");
    }

    /// SETITEMS, BUILD
    fn end_module(&mut self) {
        self.ops(b"ub");
    }

    /// `_rebuild_tensor_v2(storage, offset 0, shape, strides, requires_grad, hooks)`, where the
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

    /// STOP
    fn finish(mut self) -> Vec<u8> {
        self.ops(b".");
        self.bytes
    }
}

fn row_major_strides(shape: &[usize]) -> Vec<usize> {
    (0..shape.len()).map(|axis| shape[axis + 1..].iter().product()).collect()
}

/// A zip of stored files in the making.
#[derive(Default)]
struct Archive {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    n_records: usize,
}

impl Archive {
    /// Appends one record; a padding field of PyTorch's kind moves its data to the next multiple of
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

    /// The records, the directory and the end record.
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

/// What a record's own header and its directory entry share, from the version needed (2.0) to the
/// length of the path: no flags, stored, midnight of 1980-01-01, checksum, size twice.
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

    /// Path, offset of the data, and data of each record, found through the directory.
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
        assert_eq!(network_code(&small(Activation::Softsign)), expected);
        assert!(network_code(&small(Activation::Relu)).contains("x0 = torch.relu(z0)\n"));
    }

    #[test]
    fn strides_are_row_major() {
        assert_eq!(row_major_strides(&[64, 40]), [40, 1]);
        assert_eq!(row_major_strides(&[64]), [1]);
    }

    /// Renew the number only after `scripts/check_weights.py` has accepted a new file.
    #[test]
    fn bytes_are_those_that_torch_accepted() {
        assert_eq!(crc32fast::hash(&to_torchscript(&small(Activation::Softsign))), 2_941_473_347);
    }
}
