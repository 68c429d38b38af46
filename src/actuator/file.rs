//! File format of `actuator.mcap`: traces, curves and metrics are messages, weights are
//! attachments, settings are metadata.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/run/marker` | `RunMarker` | the held-out runs |
//! | `/actuator/command`, `/actuator/measured` | `VelocitySample` | the held-out runs on the grid |
//! | `/actuator/predicted/seed_N`, `/arx`, `/fopdt`, `/ideal` | `VelocitySample` | free-running over each whole run |
//! | `/actuator/training/seed_N` | `TrainingPoint` | learning curves, an epoch every millisecond |
//! | `/actuator/error` | `ModelError` | every metric with its interval |
//! | `/actuator/ablation` | `AblationPoint` | each finished fit of an ablation |
//!
//! Attachments: `weights/seed_N.safetensors`, `model.onnx` (the selected seed), `coverage.json`,
//! `summary.json`. Metadata: `klasktron.recording` and `klasktron.actuator`.

use super::{
    ActuatorError,
    coverage::Coverage,
    fit::{Fit, FitConfig},
    layout::{AXES, Layout, LayoutKind},
    model::ActuatorNetwork,
    run::Run,
    study::{Study, Summary, weights_name},
};
use crate::{
    nn::{Network, onnx, safetensors},
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, Recording, RecordingError, RecordingWriter,
        message::{
            AblationPoint, ModelError, RunMarker, TrainingPoint, VelocitySample, run_marker::Phase,
        },
        topic,
    },
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Name of the metadata record with the settings of the model.
pub const ACTUATOR_METADATA: &str = "klasktron.actuator";
/// Attachment with the selected model.
pub const ONNX_ATTACHMENT: &str = "model.onnx";
const COVERAGE_ATTACHMENT: &str = "coverage.json";
const SUMMARY_ATTACHMENT: &str = "summary.json";
const NANOS_PER_EPOCH: u64 = 1_000_000;

/// Write the outcome of a study.
///
/// # Errors
/// When writing to disk fails.
pub fn write(study: &Study, summary: &Summary, path: &Path) -> Result<(), RecordingError> {
    let mut writer = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
    writer.metadata(RECORDING_METADATA, recording_metadata(summary))?;
    writer.metadata(ACTUATOR_METADATA, model_metadata(study))?;
    let start = study.dataset.held_out.iter().map(|run| run.start).min().unwrap_or_default();
    write_curves(study, start, &mut writer)?;
    write_figures(study, summary, start, &mut writer)?;
    for (index, run) in study.dataset.held_out.iter().enumerate() {
        write_run(study, index as u32, run, &mut writer)?;
    }
    for fit in &study.seeds {
        let bytes =
            safetensors::to_safetensors(&fit.fit.model.network, &fit_metadata(study, &fit.fit));
        let name = weights_name(fit.fit.config.seed);
        writer.attach(&name, "application/octet-stream", &bytes)?;
    }
    let chosen = &study.chosen().fit;
    let bytes = onnx::to_onnx(&chosen.model.network, &fit_metadata(study, chosen));
    writer.attach(ONNX_ATTACHMENT, "application/octet-stream", &bytes)?;
    for (name, json) in [
        (COVERAGE_ATTACHMENT, serde_json::to_vec(&study.coverage)),
        (SUMMARY_ATTACHMENT, serde_json::to_vec_pretty(summary)),
    ] {
        let json = json.unwrap_or_else(|_plain| unreachable!("plain data"));
        writer.attach(name, "application/json", &json)?;
    }
    writer.finish()
}

fn recording_metadata(summary: &Summary) -> BTreeMap<String, String> {
    let mut metadata: BTreeMap<String, String> = [
        ("schema_version", "1"),
        ("source", "simulation"),
        ("session", "fit-actuator"),
        ("robot", &summary.robot),
        ("command_line", &summary.provenance.command_line),
        ("crate_version", summary.provenance.crate_version),
        ("git_hash", summary.provenance.git_hash),
        ("seed", &summary.chosen.seed.to_string()),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value.to_owned()))
    .collect();
    for (index, input) in summary.inputs.iter().enumerate() {
        metadata.insert(format!("input_{index}"), input.name.clone());
        metadata.insert(format!("input_{index}_sha256"), input.sha256.clone());
    }
    metadata
}

/// Return the metadata that every user of the model needs.
fn model_metadata(study: &Study) -> BTreeMap<String, String> {
    fit_metadata(study, &study.chosen().fit)
}

fn fit_metadata(study: &Study, fit: &Fit) -> BTreeMap<String, String> {
    let config = &fit.config;
    let entries = [
        ("layout", config.layout.to_string()),
        ("history_steps", config.history_steps.to_string()),
        ("width", config.width.to_string()),
        ("hidden_layers", config.hidden_layers.to_string()),
        ("rate_hz", study.dataset.config.rate_hz.to_string()),
        ("input_unit", "m/s".to_owned()),
        ("output_unit", "m/s".to_owned()),
        ("input_order", input_order(config)),
        ("player", study.dataset.player.name().to_owned()),
        ("target", format!("{:?}", study.dataset.config.target).to_lowercase()),
        ("seed", config.seed.to_string()),
        ("chosen_seed", study.chosen().fit.config.seed.to_string()),
        ("fit_config", serde_json::to_string(config).unwrap_or_default()),
    ];
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

fn input_order(config: &FitConfig) -> String {
    let velocities = config.input_layout().velocity_inputs() / AXES;
    format!(
        "{} commands (vx, vy) newest first, then {velocities} velocities (vx, vy) newest first; \
         output is the next velocity (vx, vy)",
        config.history_steps
    )
}

fn write_curves(
    study: &Study,
    start: Nanos,
    writer: &mut RecordingWriter,
) -> Result<(), RecordingError> {
    for fit in &study.seeds {
        let seed = fit.fit.config.seed;
        let topic = format!("/actuator/training/seed_{seed}");
        for point in &fit.fit.curve {
            let time = Nanos(start.0.saturating_add(point.epoch as u64 * NANOS_PER_EPOCH));
            let message = TrainingPoint {
                seed,
                epoch: point.epoch as u32,
                train_rmse_m_per_s: point.train_rmse_m_per_s,
                held_out_rmse_m_per_s: point.held_out_rmse_m_per_s,
            };
            writer.write(&topic, time, &message)?;
        }
    }
    Ok(())
}

fn write_figures(
    study: &Study,
    summary: &Summary,
    start: Nanos,
    writer: &mut RecordingWriter,
) -> Result<(), RecordingError> {
    for row in &summary.errors {
        let message = ModelError {
            model: row.model.to_owned(),
            pattern: row.pattern.clone(),
            axis: row.component.name().to_owned(),
            horizon_s: row.horizon_s,
            rmse_m_per_s: row.rmse_m_per_s,
            ci95_low_m_per_s: row.ci95_m_per_s.map(|ci| ci.low),
            ci95_high_m_per_s: row.ci95_m_per_s.map(|ci| ci.high),
            peak_m_per_s: row.peak_m_per_s,
            seed: (row.model == "network").then_some(summary.chosen.seed),
        };
        writer.write("/actuator/error", start, &message)?;
    }
    for point in &study.ablation_points {
        let message = AblationPoint {
            history_steps: point.config.history_steps as u32,
            width: point.config.width as u32,
            seed: point.config.seed,
            one_step_rmse_m_per_s: point.one_step_rmse_m_per_s,
            free_running_rmse_m_per_s: point.free_running_rmse_m_per_s,
        };
        writer.write("/actuator/ablation", start, &message)?;
    }
    Ok(())
}

fn write_run(
    study: &Study,
    number: u32,
    run: &Run,
    writer: &mut RecordingWriter,
) -> Result<(), RecordingError> {
    let dt = study.dataset.dt();
    let time = |sample: usize| run.start.after_seconds(sample as f64 * dt);
    let mut marker = RunMarker {
        run: number,
        pattern: run.pattern.clone(),
        phase: Phase::Start.into(),
        split: "validation".to_owned(),
    };
    writer.write(topic::RUN_MARKER, time(0), &marker)?;
    let mut trace = |topic: &str, first: usize, values: &[[f64; 2]]| {
        values.iter().enumerate().try_for_each(|(index, [vx, vy])| {
            let sample = VelocitySample { run: number, vx: *vx, vy: *vy };
            writer.write(topic, time(first + index), &sample)
        })
    };
    trace("/actuator/command", 0, &run.commands)?;
    trace("/actuator/measured", 0, &run.velocities)?;
    for (name, model) in study.models() {
        let predicted = study.whole_run(model, run);
        trace(&format!("/actuator/predicted/{name}"), study.history, &predicted)?;
    }
    marker.phase = Phase::End.into();
    writer.write(topic::RUN_MARKER, time(run.len()), &marker)
}

/// Model read back from an `actuator.mcap`.
#[derive(Debug, Clone)]
pub struct StoredActuator {
    /// Path of the file.
    pub path: PathBuf,
    /// Network of the selected seed.
    pub model: ActuatorNetwork,
    /// Coverage of the training data.
    pub coverage: Coverage,
    /// Settings from the metadata of the file.
    pub metadata: BTreeMap<String, String>,
    /// Weights of every seed by attachment name.
    pub weights: BTreeMap<String, Vec<u8>>,
    /// Selected model as ONNX.
    pub onnx: Vec<u8>,
}

/// Read the model from an `actuator.mcap`.
///
/// # Errors
/// When a part is missing or inconsistent with the others.
pub fn read(recording: &Recording) -> Result<StoredActuator, ActuatorError> {
    let bad = |reason: String| ActuatorError::BadModel { path: recording.path.clone(), reason };
    let metadata = recording.metadata.get(ACTUATOR_METADATA).ok_or_else(|| {
        bad("no actuator model in this file; make one with `klasktron fit-actuator`".to_owned())
    })?;
    let entry = |key: &str| {
        metadata.get(key).ok_or_else(|| bad(format!("metadata {ACTUATOR_METADATA} has no '{key}'")))
    };
    let attachment = |name: &str| {
        recording.attachment(name).ok_or_else(|| bad(format!("attachment {name} is missing")))
    };
    let config: FitConfig = serde_json::from_str(entry("fit_config")?)
        .map_err(|error| bad(format!("metadata fit_config: {error}")))?;
    let seed = entry("chosen_seed")?;
    let name = format!("weights/seed_{seed}.safetensors");
    let layout = config.input_layout();
    let (network, _) = read_weights(&attachment(&name)?.data, &name, layout).map_err(bad)?;
    let coverage = serde_json::from_slice(&attachment(COVERAGE_ATTACHMENT)?.data)
        .map_err(|error| bad(format!("{COVERAGE_ATTACHMENT}: {error}")))?;
    let weights = recording
        .attachments
        .iter()
        .filter(|attachment| attachment.name.starts_with("weights/"))
        .map(|attachment| (attachment.name.clone(), attachment.data.clone()))
        .collect();
    Ok(StoredActuator {
        path: recording.path.clone(),
        model: ActuatorNetwork::new(layout, network),
        coverage,
        metadata: metadata.clone(),
        weights,
        onnx: attachment(ONNX_ATTACHMENT)?.data.clone(),
    })
}

type WeightsAndMetadata = (Network, BTreeMap<String, String>);

fn read_weights(bytes: &[u8], name: &str, layout: Layout) -> Result<WeightsAndMetadata, String> {
    let (network, metadata) = safetensors::from_safetensors(bytes, layout.kind.activation())
        .map_err(|error| format!("{name}: {error}"))?;
    if (network.inputs(), network.outputs()) != (layout.inputs(), AXES) {
        return Err(shape_message(name, &network, layout));
    }
    Ok((network, metadata))
}

impl StoredActuator {
    pub(super) fn bad(&self, reason: String) -> ActuatorError {
        ActuatorError::BadModel { path: self.path.clone(), reason }
    }

    /// Return the network in the attachment `name`, with its metadata.
    pub(super) fn weights_of(&self, name: &str) -> Result<WeightsAndMetadata, ActuatorError> {
        let bytes = self.weights.get(name).ok_or_else(|| {
            let names: Vec<&str> = self.weights.keys().map(String::as_str).collect();
            self.bad(format!("it has no {name}; it has {}", names.join(", ")))
        })?;
        read_weights(bytes, name, self.model.layout).map_err(|reason| self.bad(reason))
    }
}

fn shape_message(name: &str, network: &Network, layout: Layout) -> String {
    let kind: LayoutKind = layout.kind;
    format!(
        "{name} takes {} inputs and gives {}, but layout {kind} with {} steps of history has {} and {}",
        network.inputs(),
        network.outputs(),
        layout.history_steps,
        layout.inputs(),
        AXES
    )
}
