//! `policy.mcap`: curves, ratings and sample games as messages, weights as attachments, settings as
//! metadata.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/train/update` | `TrainingUpdate` | learning curve, one update per millisecond |
//! | `/train/evaluation` | `MatchScore` | games against scripted players, by seat |
//! | `/train/elo` | `EloRating` | round robin |
//! | `/board/state` | `BoardState` | sample games, 50 Hz, which `klasktron eval` scores |
//! | `/striker/{left,right}/command` | `VelocityCommand` | their commands |
//!
//! Attachments: `policy.safetensors` and `policy.onnx` (normalization and network; observation in,
//! mean action out), `settings.json`, `summary.json`, `pool/*.safetensors`, and `checkpoint/*`,
//! from which `--resume` continues. Metadata: `klasktron.recording` and `klasktron.policy`. No
//! content depends on clocks, threads or file paths.

use super::{
    actuator::ActuatorSource, evaluate::Evaluation, message::message_of, run::Run,
    sample::SampleGame, settings::TrainSettings,
};
use crate::{
    game::{ActuatorQueries, CONTROL_PERIOD, CommandLimits, Snapshot},
    provenance::Provenance,
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
        message::{EloRating, MatchScore, VelocityCommand},
        topic::{self, Player},
    },
    units::Nanos,
};
use serde::Serialize;
use std::{collections::BTreeMap, path::Path};

/// Name of the metadata record for users of the policy.
pub const POLICY_METADATA: &str = "klasktron.policy";
/// Entry of that record: slew limit of commands in training (m/s^2).
pub(super) const COMMAND_SLEW_ENTRY: &str = "command_slew_m_per_s2";
/// Entry of that record: number of own previous commands in the observation.
pub(super) const ACTION_HISTORY_ENTRY: &str = "action_history";
/// Version of that record and of the observations.
pub(super) const FORMAT_VERSION: &str = "1";
/// Topic of the learning curve.
pub const UPDATE_TOPIC: &str = "/train/update";
const EVALUATION_TOPIC: &str = "/train/evaluation";
const ELO_TOPIC: &str = "/train/elo";
pub(super) const POLICY_ATTACHMENT: &str = "policy.safetensors";
const ONNX_ATTACHMENT: &str = "policy.onnx";
pub(super) const SETTINGS_ATTACHMENT: &str = "settings.json";
const SUMMARY_ATTACHMENT: &str = "summary.json";
const NANOS_PER_UPDATE: u64 = 1_000_000;
/// Time for which the final state of a sample game is repeated (s), so that the referee sees the
/// ball stay in the cup.
const STAND: f64 = 1.5;

/// Result document of a training run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Number of updates done.
    pub updates: u64,
    /// Transitions of all environments.
    pub transitions: u64,
    /// True if all requested steps are done.
    pub finished: bool,
    /// Evaluation against scripted players and earlier policies; null before the end of training.
    pub evaluation: Option<Evaluation>,
    /// Queries of a learned actuator in training; zeros for other actuators.
    pub actuator_queries: ActuatorQueries,
    /// Fraction of these queries outside of its training data (extrapolation); null without
    /// queries.
    pub actuator_extrapolation_fraction: Option<f64>,
    /// Actuator model.
    pub actuator: ActuatorSource,
    /// Data-quality issues, as sentences.
    pub warnings: Vec<String>,
    /// The settings.
    pub settings: TrainSettings,
    /// Command line, crate version and commit.
    pub provenance: Provenance,
}

/// Extrapolation fraction above which a warning is given.
const EXTRAPOLATION_WARNING: f64 = 0.01;

impl Summary {
    /// Summary of the current state of `run`.
    #[must_use]
    pub fn new(
        run: &Run,
        actuator: ActuatorSource,
        evaluation: Option<Evaluation>,
        provenance: Provenance,
    ) -> Self {
        let queries = run.queries();
        let extrapolation_fraction =
            (0 < queries.total).then(|| queries.extrapolated as f64 / queries.total as f64);
        let mut warnings = Vec::new();
        if let Some(share) = extrapolation_fraction.filter(|share| EXTRAPOLATION_WARNING < *share) {
            warnings.push(format!(
                "the actuator model extrapolated: {} of {} queries ({:.1} %) are far from its training data; collect \
                 wider motions and fit it again, or lower the speed",
                queries.extrapolated,
                queries.total,
                100.0 * share
            ));
        }
        if !run.is_done() {
            warnings.push(format!(
                "training stopped after update {} of {}; the same command with --resume continues",
                run.curve().len(),
                run.settings().updates()
            ));
        }
        Self {
            updates: run.curve().len() as u64,
            transitions: run.curve().last().map_or(0, |point| point.transitions),
            finished: run.is_done(),
            evaluation,
            actuator_queries: queries,
            actuator_extrapolation_fraction: extrapolation_fraction,
            actuator,
            warnings,
            settings: run.settings().clone(),
            provenance,
        }
    }
}

/// Write the policy file: under a temporary name, and renamed when complete.
///
/// # Errors
/// When the file cannot be written.
pub fn write_policy(
    run: &Run,
    summary: &Summary,
    samples: &[SampleGame],
    path: &Path,
) -> Result<(), RecordingError> {
    let mut writer = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
    let policy_metadata = policy_metadata(summary, &run.game().limits);
    writer.metadata(RECORDING_METADATA, recording_metadata(summary))?;
    writer.metadata(POLICY_METADATA, policy_metadata.clone())?;
    for point in run.curve() {
        let time = Nanos(point.update * NANOS_PER_UPDATE);
        writer.write(UPDATE_TOPIC, time, &message_of(point))?;
    }
    let end = Nanos((run.curve().len() as u64 + 1) * NANOS_PER_UPDATE);
    if let Some(evaluation) = &summary.evaluation {
        write_evaluation(evaluation, end, &mut writer)?;
    }
    write_samples(samples, end, &mut writer)?;
    let policy = run.policy();
    let bytes = "application/octet-stream";
    writer.attach(POLICY_ATTACHMENT, bytes, &policy.to_safetensors(&policy_metadata))?;
    writer.attach(ONNX_ATTACHMENT, bytes, &policy.to_onnx(&policy_metadata))?;
    for (name, attachment) in run.checkpoint().to_attachments() {
        writer.attach(&name, bytes, &attachment)?;
    }
    writer.attach(SETTINGS_ATTACHMENT, "application/json", run.settings().to_json().as_bytes())?;
    let json = serde_json::to_vec_pretty(summary)
        .unwrap_or_else(|_plain| unreachable!("a summary is plain data"));
    writer.attach(SUMMARY_ATTACHMENT, "application/json", &json)?;
    writer.finish()
}

fn strings<const N: usize>(entries: [(&str, String); N]) -> BTreeMap<String, String> {
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

fn recording_metadata(summary: &Summary) -> BTreeMap<String, String> {
    let Provenance { command_line, crate_version, git_hash } = &summary.provenance;
    let mut metadata = strings([
        ("schema_version", "1".to_owned()),
        ("source", "simulation".to_owned()),
        ("session", "train".to_owned()),
        ("robot", "simulated".to_owned()),
        ("command_line", command_line.clone()),
        ("crate_version", (*crate_version).to_owned()),
        ("git_hash", (*git_hash).to_owned()),
        ("seed", summary.settings.seed.to_string()),
    ]);
    if let (Some(file), Some(sha256)) = (&summary.actuator.file, &summary.actuator.sha256) {
        metadata.insert("input_0".to_owned(), file.clone());
        metadata.insert("input_0_sha256".to_owned(), sha256.clone());
    }
    metadata
}

fn policy_metadata(summary: &Summary, limits: &CommandLimits) -> BTreeMap<String, String> {
    let settings = &summary.settings;
    strings([
        ("format_version", FORMAT_VERSION.to_owned()),
        ("observations", settings.observations.name().to_owned()),
        (ACTION_HISTORY_ENTRY, settings.action_history.to_string()),
        (
            "observation_frame",
            "own: the board turned by 180 degrees for the right player".to_owned(),
        ),
        ("action_order", "x, y; own frame; -1 to 1, clamped".to_owned()),
        ("action_scale_m_per_s", limits.speed.to_string()),
        (COMMAND_SLEW_ENTRY, limits.slew.to_string()),
        ("rate_hz", CONTROL_PERIOD.recip().to_string()),
        ("actuator", summary.actuator.kind.clone()),
        ("actuator_sha256", summary.actuator.sha256.clone().unwrap_or_default()),
        ("updates", summary.updates.to_string()),
        ("transitions", summary.transitions.to_string()),
    ])
}

fn write_evaluation(
    evaluation: &Evaluation,
    time: Nanos,
    writer: &mut RecordingWriter,
) -> Result<(), RecordingError> {
    for judged in &evaluation.opponents {
        for (seat, count) in
            [(Player::Left, judged.score.left), (Player::Right, judged.score.right)]
        {
            let message = MatchScore {
                opponent: judged.opponent.clone(),
                seat: seat.name().to_owned(),
                won: count.won,
                drawn: count.drawn,
                lost: count.lost,
            };
            writer.write(EVALUATION_TOPIC, time, &message)?;
        }
    }
    for row in &evaluation.elo {
        let message = EloRating {
            player: row.player.clone(),
            rating: row.rating,
            ci95_low: row.ci95.map(|ci| ci.low),
            ci95_high: row.ci95.map(|ci| ci.high),
            games: row.games,
        };
        writer.write(ELO_TOPIC, time, &message)?;
    }
    Ok(())
}

fn write_samples(
    samples: &[SampleGame],
    start: Nanos,
    writer: &mut RecordingWriter,
) -> Result<(), RecordingError> {
    let mut time = start;
    for game in samples {
        for moment in &game.moments {
            for player in Player::BOTH {
                let [vx, vy] = moment.commands[player as usize];
                writer.write(&topic::command(player), time, &VelocityCommand { vx, vy })?;
            }
            writer.write(topic::BOARD_STATE, time, &moment.board.message())?;
            time = time.after_seconds(CONTROL_PERIOD);
        }
        let Some(last) = game.moments.last() else { continue };
        let standing =
            Snapshot { ball_velocity: [0.0; 2], striker_velocities: [[0.0; 2]; 2], ..last.board };
        for _ in 0..(STAND / CONTROL_PERIOD) as usize {
            writer.write(topic::BOARD_STATE, time, &standing.message())?;
            time = time.after_seconds(CONTROL_PERIOD);
        }
    }
    Ok(())
}
