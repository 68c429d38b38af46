//! `klasktron export`: tables of any recording, weights of an `actuator.mcap`, a twin for other simulators.

use super::{
    Outcome, note,
    replay::{has_no_scene, scene_settings},
    results::{OverwriteArgs, refuse_existing, refuse_existing_file, write_file},
    table::parse_within,
    tell,
};
use anyhow::{Context as _, bail};
use clap::ValueEnum as _;
use klasktron::{
    actuator::{self, WeightsFormat},
    recording::{
        Recording, RecordingError,
        recover::write_extended,
        table::{self, TableFormat},
        write_bytes,
    },
    scene::{Scene, Sight},
    train::{POLICY_METADATA, PolicyFormat, read_policy},
    twin::{
        export::{BamMotor, Exported, Target, export, export_bam},
        read_twin,
    },
};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
};

/// Attachments with this prefix hold the weights of an `actuator.mcap`.
const WEIGHTS_PREFIX: &str = "weights/";

/// Arguments of `klasktron export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron export train.mcap --to parquet --topic /striker/left/command -o commands.parquet
  klasktron export train.mcap --to csv -o tables
  klasktron export actuator/actuator.mcap --to onnx -o model.onnx
  klasktron export match.mcap --to foxglove -o match-scene.mcap
  klasktron export gap/twin.json --to mjcf -o gantry.xml
  klasktron export gap/twin.json --to isaaclab -o gantry_actuator.py")]
pub(crate) struct Args {
    /// Recording, an actuator.mcap, or a twin.json
    file: PathBuf,
    /// Format: weights of an actuator.mcap or policy.mcap as onnx, safetensors or torchscript; an
    /// actuator.mcap as state-dict; a twin as mjcf, isaaclab or bam; tables of a recording as
    /// parquet, csv or npz; a recording with the scene of the table as foxglove
    #[arg(long)]
    to: Format,
    /// File to write; a folder with one file per topic, where there are several and no --topic
    #[arg(short, long, alias = "out", value_name = "PATH")]
    output: PathBuf,
    /// Export only this topic
    #[arg(long)]
    topic: Option<String>,
    /// Export the weights of this seed [default: the chosen one]
    #[arg(long)]
    seed: Option<u64>,
    /// Fail if the format cannot express an effect of the twin
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    motor: MotorArgs,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

/// Motor of a servo for BAM.
#[derive(Debug, clap::Args)]
struct MotorArgs {
    /// Name of the actuator in BAM, such as xl330
    #[arg(long, value_name = "NAME", required_if_eq("to", "bam"))]
    actuator: Option<String>,
    /// Torque constant of the motor (N m/A), for a twin whose input is a voltage
    #[arg(long, value_name = "VALUE", value_parser = parse_positive, requires = "motor_resistance_ohm")]
    motor_constant_n_m_per_a: Option<f64>,
    /// Resistance of the motor (ohm), for a twin whose input is a voltage
    #[arg(long, value_name = "VALUE", value_parser = parse_positive, requires = "motor_constant_n_m_per_a")]
    motor_resistance_ohm: Option<f64>,
}

fn parse_positive(text: &str) -> Result<f64, String> {
    parse_within(text, 1e-6, 1e6, "in the unit of the option")
}

impl MotorArgs {
    fn for_bam(&self) -> anyhow::Result<BamMotor> {
        let Some(actuator) = self.actuator.clone() else { bail!("--to bam needs --actuator NAME") };
        let values = self.motor_constant_n_m_per_a.zip(self.motor_resistance_ohm);
        Ok(BamMotor { actuator, electrical: values.map(|(kt, ohm)| [kt, ohm]) })
    }
}

/// Value of `--to`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    Onnx,
    Safetensors,
    Torchscript,
    StateDict,
    Npz,
    Parquet,
    Csv,
    Mjcf,
    Isaaclab,
    Bam,
    Foxglove,
}

impl Format {
    /// Format of a table; `None` for formats that hold weights only.
    fn of_table(self) -> Option<TableFormat> {
        match self {
            Self::Npz => Some(TableFormat::Npz),
            Self::Parquet => Some(TableFormat::Parquet),
            Self::Csv => Some(TableFormat::Csv),
            Self::Onnx | Self::Safetensors | Self::Torchscript | Self::StateDict => None,
            Self::Mjcf | Self::Isaaclab | Self::Bam | Self::Foxglove => None,
        }
    }

    /// Simulator for which a twin is written; `None` for other formats.
    fn of_twin(self) -> Option<Target> {
        match self {
            Self::Mjcf => Some(Target::Mjcf),
            Self::Isaaclab => Some(Target::IsaacLab),
            _ => None,
        }
    }

    fn extension(self) -> &'static str {
        match self {
            Self::Onnx => "onnx",
            Self::Safetensors => "safetensors",
            Self::Torchscript | Self::StateDict => "pt",
            Self::Npz => "npz",
            Self::Parquet => "parquet",
            Self::Csv => "csv",
            Self::Mjcf => "xml",
            Self::Isaaclab => "py",
            Self::Bam => "json",
            Self::Foxglove => "mcap",
        }
    }
}

/// Run `klasktron export`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if let Some(target) = args.to.of_twin() {
        return export_twin(args, target);
    }
    if args.to == Format::Bam {
        let twin = read_twin(&args.file)?;
        let exported = export_bam(&twin, &args.motor.for_bam()?);
        let exported = exported.with_context(|| args.file.display().to_string())?;
        return write_twin(args, &exported, "BAM");
    }
    let recording = Recording::open(&args.file)?;
    if args.to == Format::Foxglove {
        return export_scene(&recording, args);
    }
    if recording.metadata.contains_key(POLICY_METADATA) && args.to.of_table().is_none() {
        return export_policy(&recording, args);
    }
    let has_weights = recording.attachments.iter().any(|a| a.name.starts_with(WEIGHTS_PREFIX));
    let table_format = match args.to.of_table() {
        Some(format) if !(has_weights && args.to == Format::Npz && args.topic.is_none()) => format,
        _ => {
            export_weights(&recording, args)?;
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
        return export_folder(&recording, &topics, args);
    };
    refuse_existing_file(&args.output, args.overwrite)?;
    let table = table::read_table(&recording, topic)?;
    write_file(&args.output, args.overwrite, |existing| {
        Ok(table::write_table(&table, &args.output, table_format, existing)?)
    })?;
    Ok(outcome_of(&recording))
}

/// Write a copy of a recording with the scene of the table.
fn export_scene(recording: &Recording, args: &Args) -> anyhow::Result<Outcome> {
    let file = args.file.display();
    if !has_no_scene(recording) {
        bail!("{file}: the recording has a scene (/scene) already; open it in Foxglove as it is");
    }
    let mut scene = Scene::new(scene_settings(recording));
    let mut updates = 0_usize;
    write_file(&args.output, args.overwrite, |existing| {
        Ok(write_extended(recording, &args.output, existing, |writer, topic, times, data| {
            let sight = Sight::decode(topic, data);
            let Some(update) = sight.and_then(|own| scene.see(times, &own)) else { return Ok(()) };
            updates += 1;
            update.write(writer, times[0])
        })?)
    })?;
    if updates == 0 {
        note(&format!("{file}: no detections, carriages or board states, so the scene is empty"));
    }
    Ok(outcome_of(recording))
}

/// Write the weights of an `actuator.mcap`.
fn export_weights(recording: &Recording, args: &Args) -> anyhow::Result<()> {
    let format = match args.to {
        Format::Onnx => WeightsFormat::Onnx,
        Format::Safetensors => WeightsFormat::Safetensors,
        Format::Torchscript => WeightsFormat::Torchscript,
        Format::StateDict => WeightsFormat::StateDict,
        _ => WeightsFormat::Npz,
    };
    let stored = actuator::read_actuator(recording)?;
    let bytes = actuator::export_weights(&stored, format, args.seed)?;
    write_file(&args.output, args.overwrite, |existing| {
        Ok(write_bytes(&args.output, existing, &bytes)?)
    })
}

/// Write the policy of a `policy.mcap`.
fn export_policy(recording: &Recording, args: &Args) -> anyhow::Result<Outcome> {
    let format = match args.to {
        Format::Onnx => PolicyFormat::Onnx,
        Format::Torchscript => PolicyFormat::Torchscript,
        Format::Safetensors => PolicyFormat::Safetensors,
        other => bail!(
            "{}: a policy cannot be written as {}; give --to onnx, torchscript or safetensors",
            args.file.display(),
            other.to_possible_value().map_or_else(String::new, |own| own.get_name().to_owned())
        ),
    };
    let bytes = read_policy(recording)?.export(format);
    write_file(&args.output, args.overwrite, |existing| {
        Ok(write_bytes(&args.output, existing, &bytes)?)
    })?;
    Ok(outcome_of(recording))
}

/// Write a twin for another simulator, and list what that cannot express.
fn export_twin(args: &Args, target: Target) -> anyhow::Result<Outcome> {
    let file = args.file.display();
    let twin = read_twin(&args.file)?;
    let exported = export(&twin, target).with_context(|| file.to_string())?;
    write_twin(args, &exported, &target.to_string())
}

/// Write the file of a twin, and list what the simulator `target` cannot express.
fn write_twin(args: &Args, exported: &Exported, target: &str) -> anyhow::Result<Outcome> {
    let file = args.file.display();
    if args.strict && !exported.inexpressible.is_empty() {
        let listed: Vec<String> = exported.inexpressible.iter().map(ToString::to_string).collect();
        bail!(
            "{file}: {target} cannot express {}; without --strict the rest is written",
            listed.join("; ")
        );
    }
    write_file(&args.output, args.overwrite, |existing| {
        Ok(write_bytes(&args.output, existing, exported.text.as_bytes())?)
    })?;
    if !exported.outside.is_empty() {
        note(&format!(
            "the file has drives and friction alone; outside of it: {}",
            exported.outside.join(", ")
        ));
    }
    for missing in &exported.inexpressible {
        tell(&format!("warning: {target} cannot express {missing}"));
    }
    Ok(if exported.inexpressible.is_empty() { Outcome::Done } else { Outcome::Lossy })
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
) -> anyhow::Result<Outcome> {
    let Some(format) = args.to.of_table() else { unreachable!("weights are written elsewhere") };
    if topics.is_empty() {
        bail!("{}: the file has no topic, so there is nothing to export", args.file.display());
    }
    let names = file_names(topics, args.to.extension());
    let files: Vec<&str> = names.keys().map(String::as_str).collect();
    refuse_existing(&args.output, &files, args.overwrite)?;
    fs::create_dir_all(&args.output)
        .with_context(|| format!("{}: cannot create the folder", args.output.display()))?;
    let mut outcome = outcome_of(recording);
    let mut written = 0_usize;
    for (name, topic) in &names {
        let path = args.output.join(name);
        let exported = write_file(&path, args.overwrite, |existing| {
            let table = table::read_table(recording, topic)?;
            Ok(table::write_table(&table, &path, format, existing)?)
        });
        match exported {
            Ok(()) => written += 1,
            Err(error) if is_no_table(&error) => {
                tell(&format!("left out: {error}"));
                outcome = Outcome::Lossy;
            }
            Err(error) => return Err(error),
        }
    }
    if written == 0 {
        bail!(
            "{}: none of its {} topics can be exported as a table",
            args.file.display(),
            topics.len()
        );
    }
    Ok(outcome)
}

/// Return whether a topic cannot be exported as a table, which does not stop the others.
fn is_no_table(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref::<RecordingError>(),
        Some(
            RecordingError::NotTabular { .. }
                | RecordingError::MixedSchemas { .. }
                | RecordingError::BadMessage { .. }
        )
    )
}

/// File name of each topic: `/striker/left/command` becomes `striker_left_command.csv`. A later topic with
/// the same name gets a number.
fn file_names<'a>(topics: &BTreeSet<&'a str>, extension: &str) -> BTreeMap<String, &'a str> {
    let mut names = BTreeMap::new();
    for topic in topics {
        let plain = topic.trim_matches('/').replace(['/', '\\', '\0'], "_");
        let plain = if plain.is_empty() { "topic".to_owned() } else { plain };
        let mut name = format!("{plain}.{extension}");
        let mut count = 1;
        while names.contains_key(&name) {
            count += 1;
            name = format!("{plain}_{count}.{extension}");
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
        let names: Vec<String> = file_names(&topics, "csv").into_keys().collect();
        assert_eq!(names, [".._x.csv", "a_b.csv", "a_b_2.csv", "topic.csv"]);
    }
}
