//! Reading a `policy.mcap`: the policy for use, the checkpoint for `--resume`.

use super::{
    CurvePoint, Mismatch, TrainError,
    actuator::ActuatorSource,
    file::{
        ACTION_HISTORY_ENTRY, COMMAND_SLEW_ENTRY, FORMAT_VERSION, POLICY_ATTACHMENT,
        POLICY_METADATA, SETTINGS_ATTACHMENT, UPDATE_TOPIC,
    },
    message::point_of,
    pool::velocity_of,
    run::Checkpoint,
    settings::{ACTIONS, TrainSettings},
};
use crate::{
    board::CUP_DISTANCE,
    game::{
        CONTROL_PERIOD, MOST_PREVIOUS_COMMANDS, Observation, ObservationKind, ObservationLayout,
        PreviousCommands,
    },
    ppo::{Policy, Scratch},
    recording::{Recording, message::TrainingUpdate},
};
use std::collections::{BTreeMap, BTreeSet};

/// A policy read from a `policy.mcap`.
#[derive(Debug, Clone)]
pub struct StoredPolicy {
    /// Observation to mean action.
    pub policy: Policy,
    /// Observations that it requires.
    pub observations: ObservationLayout,
    /// Speed of a full action (m/s).
    pub action_scale_m_per_s: f64,
    /// Slew limit of commands in its training (m/s^2); absent in files of earlier versions.
    pub command_slew_m_per_s2: Option<f64>,
    /// Settings of its training.
    pub settings: TrainSettings,
    /// The metadata record `klasktron.policy`.
    pub metadata: BTreeMap<String, String>,
}

/// Export formats of a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolicyFormat {
    /// ONNX with the normalization; `observation` to `action`.
    Onnx,
    /// TorchScript module with the normalization; the metadata in its extra file `metadata.json`.
    Torchscript,
    /// Safetensors; normalization and deviations as tensors.
    Safetensors,
}

impl StoredPolicy {
    /// Export the policy for other software. The metadata of the file have the order of the
    /// observations, the normalization, and the limits of the actions.
    #[must_use]
    pub fn export(&self, format: PolicyFormat) -> Vec<u8> {
        let limit = self.policy.standardizer().limit;
        let mut metadata = self.metadata.clone();
        let more = [
            ("observation_order", self.observations.names().join(",")),
            (
                "normalization",
                format!("in the file: (observation - mean) * scale, clipped at +-{limit}"),
            ),
            (
                "action_limits",
                "clamp each action to -1..1, then multiply by action_scale_m_per_s".to_owned(),
            ),
        ];
        metadata.extend(more.map(|(key, value)| (key.to_owned(), value)));
        match format {
            PolicyFormat::Onnx => self.policy.to_onnx(&metadata),
            PolicyFormat::Torchscript => self.policy.to_torchscript(&metadata),
            PolicyFormat::Safetensors => self.policy.to_safetensors(&metadata),
        }
    }

    /// Velocity (m/s, own frame) of its mean action for the observation `seen` after the commands
    /// `previous`.
    #[must_use]
    pub fn velocity(
        &self,
        seen: &Observation,
        previous: &PreviousCommands,
        scratch: &mut Scratch,
    ) -> [f32; 2] {
        let mut row = [0.0; ObservationLayout::MOST];
        let row = &mut row[..self.observations.len()];
        self.observations.write(seen, previous, CUP_DISTANCE as f32, row);
        let mut action = [0.0; ACTIONS];
        self.policy.act_mean(row, &mut action, scratch);
        velocity_of(&action, self.action_scale_m_per_s as f32)
    }
}

/// Parts of a file; a missing part is an error with its name.
struct Parts<'a> {
    recording: &'a Recording,
    metadata: &'a BTreeMap<String, String>,
}

impl<'a> Parts<'a> {
    fn of(recording: &'a Recording) -> Result<Self, TrainError> {
        match recording.metadata.get(POLICY_METADATA) {
            Some(metadata) => Ok(Self { recording, metadata }),
            None => Err(TrainError::BadPolicy {
                path: recording.path.clone(),
                reason: "no policy in this file; make one with `klasktron train`".to_owned(),
            }),
        }
    }

    fn bad(&self, reason: String) -> TrainError {
        TrainError::BadPolicy { path: self.recording.path.clone(), reason }
    }

    fn entry(&self, key: &str) -> Result<&'a str, TrainError> {
        let missing = || self.bad(format!("metadata {POLICY_METADATA} has no '{key}'"));
        self.metadata.get(key).map(String::as_str).ok_or_else(missing)
    }

    /// Check that an entry equals `expected`.
    fn expect(&self, key: &str, expected: &str) -> Result<(), TrainError> {
        let found = self.entry(key)?;
        if found == expected {
            return Ok(());
        }
        Err(self.mismatch(
            (key, found),
            ("this program", expected),
            "train it again with this version",
        ))
    }

    fn mismatch(
        &self,
        (what, found): (&str, &str),
        (other, expected): (&'static str, &str),
        remedy: &'static str,
    ) -> TrainError {
        let path = self.recording.path.clone();
        let (what, found, expected) = (what.to_owned(), found.to_owned(), expected.to_owned());
        Box::new(Mismatch { path, what, found, other, expected, remedy }).into()
    }

    /// Number of previous commands in the observation; files of earlier versions have none.
    fn action_history(&self) -> Result<usize, TrainError> {
        let Some(text) = self.metadata.get(ACTION_HISTORY_ENTRY) else { return Ok(0) };
        text.parse().ok().filter(|count| *count <= MOST_PREVIOUS_COMMANDS).ok_or_else(|| {
            self.bad(format!(
                "{ACTION_HISTORY_ENTRY} is {text}; it must be from 0 to {MOST_PREVIOUS_COMMANDS}"
            ))
        })
    }

    fn attachment(&self, name: &str) -> Result<&'a [u8], TrainError> {
        let found = self.recording.attachment(name);
        found
            .map(|attachment| attachment.data.as_slice())
            .ok_or_else(|| self.bad(format!("attachment {name} is missing")))
    }
}

/// Read the policy of a `policy.mcap`.
///
/// # Errors
/// When a part is missing or does not match the others.
pub fn read_policy(recording: &Recording) -> Result<StoredPolicy, TrainError> {
    let parts = Parts::of(recording)?;
    parts.expect("format_version", FORMAT_VERSION)?;
    parts.expect("rate_hz", &CONTROL_PERIOD.recip().to_string())?;
    let name = serde_json::Value::String(parts.entry("observations")?.to_owned());
    let state: ObservationKind = serde_json::from_value(name)
        .map_err(|error| parts.bad(format!("observations: {error}")))?;
    let observations = ObservationLayout { state, commands: parts.action_history()? };
    let weights = Policy::from_safetensors(parts.attachment(POLICY_ATTACHMENT)?);
    let (policy, _) = weights.map_err(|source| {
        let (path, attachment) = (recording.path.clone(), POLICY_ATTACHMENT.to_owned());
        TrainError::BadWeights { path, attachment, source }
    })?;
    let (width, expected) = (policy.network().inputs(), observations.len());
    if width != expected {
        return Err(parts.mismatch(
            ("the width of the network's input", &width.to_string()),
            ("its observation layout", &expected.to_string()),
            "train it again",
        ));
    }
    let outputs = policy.network().outputs();
    if outputs != ACTIONS {
        return Err(parts.mismatch(
            ("the width of the network's output", &outputs.to_string()),
            ("this game", &ACTIONS.to_string()),
            "train it again",
        ));
    }
    let settings = serde_json::from_slice(parts.attachment(SETTINGS_ATTACHMENT)?)
        .map_err(|source| TrainError::Settings { path: recording.path.clone(), source })?;
    let scale = parts.entry("action_scale_m_per_s")?;
    let action_scale_m_per_s =
        scale.parse().ok().filter(|scale: &f64| scale.is_finite() && 0.0 < *scale).ok_or_else(
            || parts.bad(format!("action_scale_m_per_s is {scale}; it must be above 0")),
        )?;
    let metadata = parts.metadata.clone();
    let command_slew_m_per_s2 = metadata.get(COMMAND_SLEW_ENTRY).and_then(|slew| slew.parse().ok());
    Ok(StoredPolicy {
        policy,
        observations,
        action_scale_m_per_s,
        command_slew_m_per_s2,
        settings,
        metadata,
    })
}

/// Read the checkpoint of a `policy.mcap` for a run with `settings` and `actuator`. Settings except
/// [`TrainSettings::steps`] and [`TrainSettings::anneal_transitions`] must equal those of the file.
///
/// # Errors
/// When a part is missing or a setting differs; the error has both values.
pub fn read_checkpoint(
    recording: &Recording,
    settings: &TrainSettings,
    actuator: &ActuatorSource,
) -> Result<Checkpoint, TrainError> {
    let stored = read_policy(recording)?;
    let parts = Parts::of(recording)?;
    let remedy = "give the same settings, or another --output for a new run";
    let mismatch = |what: &str, found: &str, expected: &str| {
        parts.mismatch((what, found), ("this command", expected), remedy)
    };
    let TrainSettings { steps, anneal_transitions, .. } = *settings;
    let steps = TrainSettings { steps, anneal_transitions, ..stored.settings.clone() };
    let values =
        [&steps, settings].map(|settings| serde_json::to_value(settings).unwrap_or_default());
    if let Some((key, [found, expected])) = first_difference("", [&values[0], &values[1]]) {
        return Err(mismatch(&key, &found, &expected));
    }
    let sha256 = actuator.sha256.clone().unwrap_or_default();
    for (key, expected) in [("actuator", &actuator.kind), ("actuator_sha256", &sha256)] {
        let found = parts.entry(key)?;
        if found != expected {
            return Err(mismatch(key, found, expected));
        }
    }
    let curve = read_curve(recording)?;
    let find = |name: &str| recording.attachment(name).map(|attachment| attachment.data.clone());
    Checkpoint::from_attachments(settings, actuator, &curve, &find)
        .map_err(|(attachment, reason)| parts.bad(format!("{attachment}: {reason}")))
}

/// Read the learning curve in `recording`, one point per update.
///
/// # Errors
/// When an update does not decode.
pub fn read_curve(recording: &Recording) -> Result<Vec<CurvePoint>, TrainError> {
    let updates = recording.series::<TrainingUpdate>(UPDATE_TOPIC)?;
    Ok(updates.values.iter().map(point_of).collect())
}

/// First key at which two documents differ, with both values.
fn first_difference(key: &str, [a, b]: [&serde_json::Value; 2]) -> Option<(String, [String; 2])> {
    if let (Some(of_a), Some(of_b)) = (a.as_object(), b.as_object()) {
        let keys: BTreeSet<&String> = of_a.keys().chain(of_b.keys()).collect();
        let null = serde_json::Value::Null;
        return keys.into_iter().find_map(|inner| {
            let name = if key.is_empty() { inner.clone() } else { format!("{key}.{inner}") };
            let both = [of_a, of_b].map(|object| object.get(inner).unwrap_or(&null));
            first_difference(&name, both)
        });
    }
    (a != b).then(|| (key.to_owned(), [a.to_string(), b.to_string()]))
}
