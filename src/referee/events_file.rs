//! Events as MCAP, on the clock of the recordings, so that viewers can show both together.

use super::{event::Event, matches::ScoredMatch};
use crate::{
    provenance::Provenance,
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
        message::MatchEvent, topic::MATCH_EVENT,
    },
};
use std::{collections::BTreeMap, path::Path};

/// Write the events of `matches` to `path`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_events(
    matches: &[ScoredMatch],
    provenance: &Provenance,
    seed: u64,
    path: &Path,
) -> Result<(), RecordingError> {
    let mut writer = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
    writer.metadata(RECORDING_METADATA, metadata(matches, provenance, seed))?;
    for (idx, scored) in matches.iter().enumerate() {
        for event in &scored.analysis.events {
            let time = scored.origin.after_seconds(event.time);
            writer.write(MATCH_EVENT, time, &message(event, idx))?;
        }
    }
    writer.finish()
}

fn metadata(
    matches: &[ScoredMatch],
    provenance: &Provenance,
    seed: u64,
) -> BTreeMap<String, String> {
    let mut values = vec![
        ("schema_version".to_owned(), "1".to_owned()),
        ("command_line".to_owned(), provenance.command_line.clone()),
        ("crate_version".to_owned(), provenance.crate_version.to_owned()),
        ("git_hash".to_owned(), provenance.git_hash.to_owned()),
        ("seed".to_owned(), seed.to_string()),
    ];
    for (idx, scored) in matches.iter().enumerate() {
        values.push((format!("match_{idx}_file"), scored.path.display().to_string()));
        values.push((format!("match_{idx}_sha256"), scored.sha256.clone()));
    }
    values.into_iter().collect()
}

fn message(event: &Event, idx: usize) -> MatchEvent {
    MatchEvent {
        kind: event.kind.name().to_owned(),
        player: event.player.map_or_else(String::new, |player| player.name().to_owned()),
        episode: event.episode as u32,
        x: event.position[0],
        y: event.position[1],
        speed_in_m_per_s: event.speed_in(),
        speed_out_m_per_s: event.speed_out(),
        confidence: event.confidence,
        detail: if event.goal_directed { "goal_directed".to_owned() } else { String::new() },
        r#match: idx as u32,
    }
}
