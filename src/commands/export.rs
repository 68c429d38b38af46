//! `klasktron export`: tables of any recording, weights of an `actuator.mcap`.

use super::{Outcome, tell};
use anyhow::{Context as _, bail};
use klasktron::{
    actuator::{self, WeightsFormat},
    recording::{
        ExistingFile, Recording, RecordingError,
        table::{self, TableFormat},
        write_bytes,
    },
};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
};

/// Attachments with this prefix hold the weights of an `actuator.mcap`.
const WEIGHTS_PREFIX: &str = "weights/";

/// What can be typed after `klasktron export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron export train.mcap --to parquet --topic /striker/left/command --out commands.parquet
  klasktron export train.mcap --to csv --out tables
  klasktron export actuator/actuator.mcap --to onnx --out model.onnx")]
pub(crate) struct Args {
    /// A recording, or an actuator.mcap
    file: PathBuf,
    /// What to write: onnx, safetensors and torchscript are weights of an actuator.mcap; parquet
    /// and csv are tables of any recording; npz is weights where there are any, else tables
    #[arg(long)]
    to: Format,
    /// File to write; with several topics and no --topic a folder, one file per topic
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Write this topic only
    #[arg(long)]
    topic: Option<String>,
    /// Weights of this seed [default: the chosen one]
    #[arg(long)]
    seed: Option<u64>,
    /// Replace files that exist already
    #[arg(long)]
    overwrite: bool,
}

/// What `--to` can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    Onnx,
    Safetensors,
    Torchscript,
    Npz,
    Parquet,
    Csv,
}

impl Format {
    /// The format of a table, for those that can hold one.
    fn of_table(self) -> Option<TableFormat> {
        match self {
            Self::Npz => Some(TableFormat::Npz),
            Self::Parquet => Some(TableFormat::Parquet),
            Self::Csv => Some(TableFormat::Csv),
            Self::Onnx | Self::Safetensors | Self::Torchscript => None,
        }
    }

    fn extension(self) -> &'static str {
        match self {
            Self::Onnx => "onnx",
            Self::Safetensors => "safetensors",
            Self::Torchscript => "pt",
            Self::Npz => "npz",
            Self::Parquet => "parquet",
            Self::Csv => "csv",
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.file)?;
    let existing = if args.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse };
    let has_weights = recording.attachments.iter().any(|a| a.name.starts_with(WEIGHTS_PREFIX));
    let table_format = match args.to.of_table() {
        Some(format) if !(has_weights && args.to == Format::Npz && args.topic.is_none()) => format,
        _ => {
            export_weights(&recording, args, existing)?;
            return Ok(outcome_of(&recording));
        }
    };
    let topics: BTreeSet<&str> = recording.channels.iter().map(|c| c.topic.as_str()).collect();
    let only = match (&args.topic, topics.len()) {
        (Some(topic), _) => Some(topic.as_str()),
        (None, 1) => topics.first().copied(),
        (None, _) => None,
    };
    let Some(topic) = only else {
        return export_folder(&recording, &topics, args, existing);
    };
    let table = table::read_table(&recording, topic)?;
    table::write_table(&table, &args.out, table_format, existing)?;
    Ok(outcome_of(&recording))
}

/// Writes the weights of an `actuator.mcap`.
fn export_weights(
    recording: &Recording,
    args: &Args,
    existing: ExistingFile,
) -> anyhow::Result<()> {
    let format = match args.to {
        Format::Onnx => WeightsFormat::Onnx,
        Format::Safetensors => WeightsFormat::Safetensors,
        Format::Torchscript => WeightsFormat::Torchscript,
        Format::Npz | Format::Parquet | Format::Csv => WeightsFormat::Npz,
    };
    let stored = actuator::read_actuator(recording)?;
    let bytes = actuator::export_weights(&stored, format, args.seed)?;
    Ok(write_bytes(&args.out, existing, &bytes)?)
}

fn outcome_of(recording: &Recording) -> Outcome {
    if recording.loss.is_none() {
        return Outcome::Done;
    }
    tell(&super::loss_sentence(recording));
    Outcome::Lossy
}

fn export_folder(
    recording: &Recording,
    topics: &BTreeSet<&str>,
    args: &Args,
    existing: ExistingFile,
) -> anyhow::Result<Outcome> {
    let Some(format) = args.to.of_table() else { unreachable!("weights are written elsewhere") };
    if topics.is_empty() {
        bail!("{}: it has no topic, so there is nothing to write", args.file.display());
    }
    fs::create_dir_all(&args.out)
        .with_context(|| format!("{}: cannot make the folder", args.out.display()))?;
    let mut outcome = outcome_of(recording);
    let mut written = 0_usize;
    for (name, topic) in file_names(topics) {
        let path = args.out.join(format!("{name}.{}", args.to.extension()));
        let exported = table::read_table(recording, topic)
            .and_then(|table| table::write_table(&table, &path, format, existing));
        match exported {
            Ok(()) => written += 1,
            Err(
                error @ (RecordingError::NotTabular { .. }
                | RecordingError::MixedSchemas { .. }
                | RecordingError::BadMessage { .. }),
            ) => {
                tell(&format!("left out: {error}"));
                outcome = Outcome::Lossy;
            }
            Err(error) => return Err(error.into()),
        }
    }
    if written == 0 {
        bail!("{}: none of its {} topics makes a table", args.file.display(), topics.len());
    }
    Ok(outcome)
}

/// A file name for each topic: `/striker/left/command` is `striker_left_command`. Where two topics
/// give one name, the later in alphabetical order gets a number.
fn file_names<'a>(topics: &BTreeSet<&'a str>) -> BTreeMap<String, &'a str> {
    let mut names = BTreeMap::new();
    for topic in topics {
        let plain = topic.trim_matches('/').replace(['/', '\\', '\0'], "_");
        let plain = if plain.is_empty() { "topic".to_owned() } else { plain };
        let mut name = plain.clone();
        let mut count = 1;
        while names.contains_key(&name) {
            count += 1;
            name = format!("{plain}_{count}");
        }
        names.insert(name, *topic);
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_give_distinct_plain_file_names() {
        let topics = BTreeSet::from(["/a/b", "/a_b", "/../x", "/"]);
        let names: Vec<String> = file_names(&topics).into_keys().collect();
        assert_eq!(names, [".._x", "a_b", "a_b_2", "topic"]);
    }
}
