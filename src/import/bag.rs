//! Reader of ROS 2 bags: a folder with `metadata.yaml` and its parts, or one file.
//!
//! A part is SQLite (`.db3`) or MCAP, by its first bytes, and may be compressed as a whole with
//! zstd. Single messages may be compressed as well although their channel is `cdr`. A compressed
//! payload is recognized by its zstd magic, which no CDR message starts with (their first byte is
//! 0). A bag whose recorder was killed has no `metadata.yaml`; its parts are then read in the order
//! of their numbers.

use super::{error::ImportError, report::Notice, sqlite};
use crate::{
    recording::{MAGIC, Recording, hexadecimal, sha256_of_file},
    units::Nanos,
};
use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
};

const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];
const SQLITE_MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Largest single message that is decompressed (bytes).
const MOST_MESSAGE_BYTES: u64 = 1 << 28;
const METADATA_FILE: &str = "metadata.yaml";

/// Messages of one topic of a bag.
#[derive(Debug, Clone, Default)]
pub(super) struct BagTopic {
    /// Name.
    pub(super) name: String,
    /// Type, such as `geometry_msgs/msg/Twist`.
    pub(super) type_name: String,
    /// Definition in the bag, with its encoding (`ros2msg`, `ros2idl`).
    pub(super) definition: Option<(String, String)>,
    /// Number of messages, read or not.
    pub(super) count: u64,
    /// Receive time and CDR bytes in order of time; empty for a topic that is not wanted.
    pub(super) messages: Vec<(Nanos, Vec<u8>)>,
}

/// Bag in memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Bag {
    /// Topics in the order of the file.
    pub(super) topics: Vec<BagTopic>,
    /// Name and SHA-256 of each part.
    pub(super) files: Vec<(String, String)>,
    /// Losses.
    pub(super) notices: Vec<Notice>,
}

/// Filter by name and type: read the messages of a topic, or only count them.
pub(super) type Wanted<'a> = &'a dyn Fn(&str, &str) -> bool;

impl Bag {
    /// Read the bag at `path`. Compressed parts are decompressed into `scratch` for the time of
    /// reading.
    pub(super) fn open(
        path: &Path,
        wanted: Wanted<'_>,
        scratch: &Path,
    ) -> Result<Self, ImportError> {
        let mut bag = Self::default();
        for part in bag.parts(path)? {
            let name = part.file_name().unwrap_or_default().to_string_lossy().into_owned();
            bag.files.push((name, sha256_of_file(&part)?));
            bag.read_part(&part, wanted, scratch)?;
        }
        for topic in &mut bag.topics {
            topic.messages.sort_by_key(|(time, _)| *time);
        }
        bag.unpack_messages();
        Ok(bag)
    }

    /// Return the files of the bag in order.
    fn parts(&mut self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        if !path.is_dir() {
            return Ok(vec![path.to_owned()]);
        }
        let listed = match fs::read_to_string(path.join(METADATA_FILE)) {
            Ok(text) => {
                check_compression(path, &text)?;
                listed_files(&text)
            }
            Err(_absent) => Vec::new(),
        };
        let mut parts = Vec::new();
        for name in listed {
            let plain = path.join(&name);
            let packed = path.join(format!("{name}.zstd"));
            match [plain, packed].into_iter().find(|candidate| candidate.is_file()) {
                Some(found) => parts.push(found),
                None => self.notices.push(Notice::MissingPart { file: name }),
            }
        }
        if parts.is_empty() {
            parts = files_in(path)?;
        }
        if parts.is_empty() { Err(ImportError::NoBag { path: path.to_owned() }) } else { Ok(parts) }
    }

    fn read_part(
        &mut self,
        part: &Path,
        wanted: Wanted<'_>,
        scratch: &Path,
    ) -> Result<(), ImportError> {
        let begins = first_bytes(part)?;
        if begins.starts_with(&ZSTD_MAGIC) {
            let unpacked = Unpacked::from_zstd(part, scratch)?;
            if first_bytes(&unpacked.path)?.starts_with(&ZSTD_MAGIC) {
                return Err(unreadable(part, "it is compressed twice".to_owned()));
            }
            return self.read_plain(&unpacked.path, part, wanted);
        }
        self.read_plain(part, part, wanted)
    }

    /// Read the file at `path`; `shown` is its name for messages.
    fn read_plain(
        &mut self,
        path: &Path,
        shown: &Path,
        wanted: Wanted<'_>,
    ) -> Result<(), ImportError> {
        let begins = first_bytes(path)?;
        if begins.starts_with(SQLITE_MAGIC) {
            let part = sqlite::read_bag(path, shown, wanted)?;
            self.notices.extend(part.notices);
            part.topics.into_iter().for_each(|topic| self.merge(topic));
            Ok(())
        } else if begins.starts_with(&MAGIC) {
            self.read_mcap(path, shown, wanted)
        } else {
            let begins = hexadecimal(&begins[..begins.len().min(8)]);
            Err(unreadable(shown, format!("it starts with {begins}, neither SQLite nor MCAP")))
        }
    }

    fn read_mcap(
        &mut self,
        path: &Path,
        shown: &Path,
        wanted: Wanted<'_>,
    ) -> Result<(), ImportError> {
        let recording = Recording::open(path)?;
        if !recording.loss.is_none() {
            self.notices.push(Notice::Damaged {
                file: shown.display().to_string(),
                what: recording.loss.to_string(),
            });
        }
        for channel in recording.channels {
            let definition = String::from_utf8_lossy(&channel.schema_data).into_owned();
            let is_read = channel.encoding == "cdr" && wanted(&channel.topic, &channel.schema);
            let messages = if is_read {
                channel.raw().map(|(at, bytes)| (at.log_time, bytes.to_vec())).collect()
            } else {
                Vec::new()
            };
            self.merge(BagTopic {
                count: channel.messages.len() as u64,
                definition: (!definition.is_empty())
                    .then(|| (channel.schema_encoding.clone(), definition)),
                messages,
                type_name: channel.schema,
                name: channel.topic,
            });
        }
        Ok(())
    }

    /// Append a topic of one part to the same topic of earlier parts.
    fn merge(&mut self, topic: BagTopic) {
        let same =
            |known: &&mut BagTopic| known.name == topic.name && known.type_name == topic.type_name;
        match self.topics.iter_mut().find(same) {
            Some(known) => {
                known.count += topic.count;
                known.messages.extend(topic.messages);
                known.definition = known.definition.take().or(topic.definition);
            }
            None => self.topics.push(topic),
        }
    }

    fn unpack_messages(&mut self) {
        for topic in &mut self.topics {
            for (_, data) in &mut topic.messages {
                if data.starts_with(&ZSTD_MAGIC) {
                    // A message that cannot be decompressed is later counted as undecodable.
                    if let Ok(unpacked) = unpack_message(data) {
                        *data = unpacked;
                    }
                }
            }
        }
    }
}

fn unreadable(path: &Path, reason: String) -> ImportError {
    ImportError::Sqlite { path: path.to_owned(), reason }
}

fn unpack_message(data: &[u8]) -> io::Result<Vec<u8>> {
    let mut unpacked = Vec::new();
    zstd::stream::read::Decoder::new(data)?.take(MOST_MESSAGE_BYTES).read_to_end(&mut unpacked)?;
    Ok(unpacked)
}

fn first_bytes(path: &Path) -> Result<Vec<u8>, ImportError> {
    let file = File::open(path).map_err(ImportError::io(path, "open"))?;
    let mut bytes = Vec::new();
    let length = SQLITE_MAGIC.len() as u64;
    file.take(length).read_to_end(&mut bytes).map_err(ImportError::io(path, "read"))?;
    Ok(bytes)
}

/// Part decompressed for the time of reading.
struct Unpacked {
    path: PathBuf,
}

impl Unpacked {
    fn from_zstd(packed: &Path, scratch: &Path) -> Result<Self, ImportError> {
        let name = packed.file_name().unwrap_or_default().to_string_lossy();
        let path = scratch.join(format!(".{name}.{}.unpacked", std::process::id()));
        let unpacked = Self { path };
        let source = File::open(packed).map_err(ImportError::io(packed, "open"))?;
        let mut decoder =
            zstd::stream::read::Decoder::new(source).map_err(ImportError::io(packed, "unpack"))?;
        let mut target =
            File::create(&unpacked.path).map_err(ImportError::io(&unpacked.path, "create"))?;
        io::copy(&mut decoder, &mut target).map_err(ImportError::io(packed, "unpack"))?;
        Ok(unpacked)
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        // The name marks it as a temporary copy, in case it remains.
        fs::remove_file(&self.path).ok();
    }
}

/// Return the bag files of a folder by the number at the end of their names, `_2` before `_10`.
fn files_in(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let entries = fs::read_dir(folder).map_err(ImportError::io(folder, "list"))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| is_bag_file(path))
        .collect();
    files.sort_by_key(|path| (part_number(path), path.clone()));
    Ok(files)
}

/// Return whether a file name is that of a bag, compressed or not.
pub(super) fn is_bag_file(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let plain = name.strip_suffix(".zstd").unwrap_or(&name);
    !name.starts_with('.') && (plain.ends_with(".db3") || plain.ends_with(".mcap"))
}

fn part_number(path: &Path) -> u64 {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').next().unwrap_or_default();
    stem.rsplit('_').next().and_then(|digits| digits.parse().ok()).unwrap_or(0)
}

/// Return the entries of `relative_file_paths` in a bag's metadata.yaml. Its recorder writes a
/// fixed style: a key, then lines of `- name`.
fn listed_files(metadata: &str) -> Vec<String> {
    metadata
        .lines()
        .map(str::trim)
        .skip_while(|line| !line.starts_with("relative_file_paths:"))
        .skip(1)
        .map_while(|line| line.strip_prefix("- "))
        .map(|name| name.trim().trim_matches(['"', '\'']).to_owned())
        .collect()
}

fn check_compression(bag: &Path, metadata: &str) -> Result<(), ImportError> {
    let value = |key: &str| {
        metadata
            .lines()
            .find_map(|line| line.trim().strip_prefix(key))
            .map(|value| value.trim().trim_matches(['"', '\'']).to_lowercase())
    };
    match value("compression_format:").as_deref() {
        None | Some("" | "zstd") => Ok(()),
        Some(other) => {
            Err(ImportError::Compression { path: bag.to_owned(), format: other.to_owned() })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const METADATA: &str = "\
rosbag2_bagfile_information:
  version: 5
  compression_format: zstd
  compression_mode: FILE
  relative_file_paths:
    - bag_0.db3
    - \"bag_1.db3\"
  duration:
    nanoseconds: 1
";

    #[test]
    fn metadata_names_the_parts_and_the_compression() {
        assert_eq!(listed_files(METADATA), ["bag_0.db3", "bag_1.db3"]);
        assert_eq!(listed_files("version: 5"), Vec::<String>::new());
        assert!(check_compression(Path::new("bag"), METADATA).is_ok());
        let error = check_compression(Path::new("bag"), "compression_format: lz4").unwrap_err();
        assert_eq!(
            error.to_string(),
            "bag: compression 'lz4' is not supported; ROS 2 bags use zstd"
        );
    }

    #[test]
    fn parts_are_ordered_by_number() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["run_10.db3", "run_2.db3", "run_0.db3.zstd", "notes.txt"] {
            fs::write(folder.path().join(name), "x").unwrap();
        }
        let names: Vec<_> = files_in(folder.path())
            .unwrap()
            .iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect();
        assert_eq!(names, ["run_0.db3.zstd", "run_2.db3", "run_10.db3"]);
    }
}
