//! `gap.mcap`: measurement, and simulation before and after, for any MCAP viewer.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/gap/SIGNAL/measured` | `AxisInput` | the signal in the first validation session |
//! | `/gap/SIGNAL/before`, `/after` | `AxisInput` | the given twin and the final one |
//! | `/gap/SIGNAL/residual_before`, `/residual_after` | `AxisInput` | measured less simulated |
//! | `/gap/train/SIGNAL/...` | `AxisInput` | the same in the first training session |
//!
//! Times are relative to the start of the session's recording. Attachments: `gap.json`, and `twin.json` if there is a
//! twin.

use super::{find::Found, page::view::View};
use crate::{
    provenance::Provenance,
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
        message::AxisInput,
    },
    twin::Session,
    units::Nanos,
};
use std::{collections::BTreeMap, path::Path};

/// Write `gap.mcap` of `found`, identified from `sessions`.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_tape(
    found: &Found<'_>,
    provenance: &Provenance,
    sessions: &[Session],
    path: &Path,
) -> Result<(), RecordingError> {
    let mut writer = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
    writer.metadata(RECORDING_METADATA, metadata(provenance, sessions))?;
    let mut samples = Vec::new();
    for outcome in &found.outcomes {
        collect("/gap/train", &View::train(outcome), &mut samples);
        collect("/gap", &View::validated(outcome), &mut samples);
    }
    samples.sort_by(|a, b| (a.time, &a.topic).cmp(&(b.time, &b.topic)));
    for sample in &samples {
        let message = AxisInput { value: sample.value, unit: sample.unit.to_owned() };
        writer.write(&sample.topic, sample.time, &message)?;
    }
    let document = serde_json::to_string_pretty(&found.document).unwrap_or_default() + "\n";
    writer.attach("gap.json", "application/json", document.as_bytes())?;
    if found.has_twin() {
        let twin = found.twin.to_json().unwrap_or_default();
        writer.attach("twin.json", "application/json", twin.as_bytes())?;
    }
    writer.finish()
}

fn metadata(provenance: &Provenance, sessions: &[Session]) -> BTreeMap<String, String> {
    let mut metadata: BTreeMap<String, String> = [
        ("schema_version", "1"),
        ("source", "simulation"),
        ("session", "gap"),
        ("command_line", &provenance.command_line),
        ("crate_version", provenance.crate_version),
        ("git_hash", provenance.git_hash),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value.to_owned()))
    .collect();
    let mut inputs: Vec<(&str, &str)> = Vec::new();
    for session in sessions {
        // One file may give two sessions: training runs and validation runs.
        if !inputs.iter().any(|(_, sha256)| *sha256 == session.sha256) {
            inputs.push((&session.name, &session.sha256));
        }
    }
    for (index, (name, sha256)) in inputs.into_iter().enumerate() {
        metadata.insert(format!("input_{index}"), name.to_owned());
        metadata.insert(format!("input_{index}_sha256"), sha256.to_owned());
    }
    metadata
}

/// One value on one topic.
struct Sample {
    time: Nanos,
    topic: std::rc::Rc<str>,
    value: f64,
    unit: &'static str,
}

/// Every finite value of the first session of `view`.
fn collect(root: &str, view: &View<'_>, samples: &mut Vec<Sample>) {
    let Some(part) = view.parts.first() else { return };
    for (index, channel) in part.stage.channels().iter().enumerate() {
        let (measured, before, after) =
            (&channel.measured, &part.before[index], &part.after[index]);
        let columns: [(&str, &dyn Fn(usize) -> f64); 5] = [
            ("measured", &|sample| measured[sample]),
            ("before", &|sample| before[sample]),
            ("after", &|sample| after[sample]),
            ("residual_before", &|sample| measured[sample] - before[sample]),
            ("residual_after", &|sample| measured[sample] - after[sample]),
        ];
        for (name, value) in columns {
            let topic: std::rc::Rc<str> = format!("{root}/{}/{name}", channel.signal).into();
            for sample in channel.runs.iter().flat_map(Clone::clone) {
                let (time, value) = (channel.times[sample], value(sample));
                if value.is_finite() && 0.0 <= time {
                    let time = Nanos(0).after_seconds(time);
                    let topic = topic.clone();
                    samples.push(Sample { time, topic, value, unit: channel.unit });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{gap::page::tests::found, recording::Recording};

    #[test]
    fn the_tape_holds_findings_and_twin_and_is_the_same_every_time() {
        let folder = tempfile::tempdir().unwrap();
        let provenance = Provenance::new("klasktron gap".to_owned());
        let bytes = ["one.mcap", "two.mcap"].map(|name| {
            let path = folder.path().join(name);
            write_tape(&found("nothing"), &provenance, &[], &path).unwrap();
            std::fs::read(path).unwrap()
        });
        assert_eq!(bytes[0], bytes[1]);
        let back = Recording::open(&folder.path().join("one.mcap")).unwrap();
        assert_eq!(back.info("command_line"), Some("klasktron gap"));
        for name in ["gap.json", "twin.json"] {
            assert!(
                back.attachment(name).is_some_and(|part| part.data.starts_with(b"{")),
                "{name}"
            );
        }
    }
}
