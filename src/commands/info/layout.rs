//! An [`Inspection`] as text for people, within 100 columns.

use klasktron::recording::inspect::{Inspection, QualityWarning, RunReport, Timing};
use std::collections::BTreeMap;

/// Width that fits a terminal side by side with another window.
const MAX_COLUMNS: usize = 100;
/// The first column of a table that is too wide shrinks down to this.
const MIN_NAME_COLUMNS: usize = 16;
/// Other names longer than this are cut.
const MAX_NAME_COLUMNS: usize = 24;

/// All of one file.
pub(super) fn inspection(file: &Inspection) -> String {
    let mut parts = vec![heading(file), topics(file)];
    parts.extend(runs(file));
    parts.extend(speeds(file));
    parts.extend(axes(file));
    parts.extend(attachments(file));
    if file.warnings.is_empty() {
        parts.push("  no warnings".to_owned());
    } else {
        parts.push(warnings("  warnings", &file.warnings));
    }
    parts.join("\n\n")
}

/// A titled list of sentences.
pub(super) fn warnings(title: &str, warnings: &[QualityWarning]) -> String {
    let lines = warnings.iter().map(|warning| wrapped(&warning.message));
    std::iter::once(format!("{title}:")).chain(lines).collect::<Vec<_>>().join("\n")
}

fn heading(file: &Inspection) -> String {
    let about: Vec<String> = [
        ("source", &file.source),
        ("session", &file.session),
        ("split", &file.split),
        ("robot", &file.robot),
    ]
    .into_iter()
    .filter_map(|(name, value)| Some(format!("{name} {}", value.as_ref()?)))
    .collect();
    let mut lines = vec![
        file.file.clone(),
        format!(
            "  {}, {:.2} s, {} messages on {} topics; profile {}, written by {}",
            size(file.bytes),
            file.duration_s,
            file.messages,
            file.topics.len(),
            if file.profile.is_empty() { "none" } else { &file.profile },
            if file.library.is_empty() { "unknown" } else { &file.library },
        ),
    ];
    if !about.is_empty() {
        lines.push(format!("  {}", about.join(", ")));
    }
    lines.push(format!("  sha256 {}", file.sha256));
    lines.join("\n")
}

fn topics(file: &Inspection) -> String {
    let mut rows = vec![cells(&[
        "topic",
        "schema",
        "count",
        "Hz",
        "jitter ms",
        "dropout s",
        "at s",
        "first s",
        "last s",
    ])];
    for topic in &file.topics {
        let Timing { first_s, last_s, .. } = topic.timing;
        let timing = &topic.timing;
        rows.push(vec![
            topic.topic.clone(),
            short_schema(&topic.schema),
            topic.messages.to_string(),
            number(timing.measured_rate_hz, 2),
            number(timing.jitter_ms, 3),
            number(timing.longest_dropout_s, 3),
            number(timing.longest_dropout_at_s, 1),
            number((0 < topic.messages).then_some(first_s), 1),
            number((0 < topic.messages).then_some(last_s), 1),
        ]);
    }
    aligned(&rows, 2)
}

/// Runs of one pattern and split together.
fn runs(file: &Inspection) -> Option<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&RunReport>> = BTreeMap::new();
    for run in &file.runs {
        groups.entry((&run.pattern, &run.split)).or_default().push(run);
    }
    let mut rows = vec![cells(&["pattern", "split", "runs", "total s", "samples"])];
    for ((pattern, split), runs) in &groups {
        let total: f64 = runs.iter().filter_map(|run| run.duration_s).sum();
        let samples: u64 = runs.iter().map(|run| run.samples).sum();
        rows.push(vec![
            (*pattern).to_owned(),
            (*split).to_owned(),
            runs.len().to_string(),
            format!("{total:.2}"),
            samples.to_string(),
        ]);
    }
    (1 < rows.len()).then(|| aligned(&rows, 2))
}

fn speeds(file: &Inspection) -> Option<String> {
    let mut rows = vec![cells(&[
        "striker",
        "axis",
        "commanded m/s",
        "measured m/s",
        "slope",
        "explained",
        "lag ms",
        "camera",
    ])];
    for speed in &file.speeds {
        rows.push(vec![
            speed.player.to_string(),
            speed.axis.to_string(),
            range(speed.commanded_m_per_s),
            range(speed.measured_m_per_s),
            number(speed.velocity_per_command, 3),
            speed
                .variance_explained
                .map_or_else(dash, |fraction| format!("{:.1} %", 100.0 * fraction)),
            number(speed.lag_s.map(|lag| lag * 1e3), 0),
            number(speed.camera_scale, 4),
        ]);
    }
    (1 < rows.len()).then(|| aligned(&rows, 2))
}

fn axes(file: &Inspection) -> Option<String> {
    let mut rows = vec![cells(&["axis", "quantity", "smallest", "largest", "unit"])];
    for axis in &file.axes {
        rows.push(vec![
            axis.axis.clone(),
            axis.quantity.to_owned(),
            format!("{:.4}", axis.min),
            format!("{:.4}", axis.max),
            axis.unit.clone(),
        ]);
    }
    (1 < rows.len()).then(|| aligned(&rows, 2))
}

fn attachments(file: &Inspection) -> Option<String> {
    let mut rows = vec![cells(&["attachment", "type", "size"])];
    for part in &file.attachments {
        rows.push(vec![part.name.clone(), part.media_type.clone(), size(part.bytes)]);
    }
    (1 < rows.len()).then(|| aligned(&rows, 2))
}

fn cells(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|text| (*text).to_owned()).collect()
}

fn dash() -> String {
    "-".to_owned()
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(dash, |value| format!("{value:.digits$}"))
}

fn range(range: Option<[f64; 2]>) -> String {
    range.map_or_else(dash, |[low, high]| format!("{low:.3} to {high:.3}"))
}

fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}

/// `klasktron.CameraDetections` and `sensor_msgs/msg/Imu` by their last part.
fn short_schema(name: &str) -> String {
    let last = name.rsplit(['.', '/']).next().unwrap_or_default();
    if last.is_empty() { dash() } else { shortened(last, MAX_NAME_COLUMNS) }
}

/// The end of a name, which tells more than its beginning.
fn shortened(name: &str, columns: usize) -> String {
    let count = name.chars().count();
    if count <= columns {
        return name.to_owned();
    }
    let kept = name.chars().skip(count + 1 - columns);
    std::iter::once('…').chain(kept).collect()
}

/// Rows in columns: the first `left` of them flush left, the others flush right.
fn aligned(rows: &[Vec<String>], left: usize) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |at: usize| {
        rows.iter()
            .filter_map(|row| row.get(at))
            .map(|cell| cell.chars().count())
            .max()
            .unwrap_or(0)
    };
    let mut widths: Vec<usize> = (0..columns).map(width).collect();
    let excess = widths.iter().map(|width| width + 2).sum::<usize>().saturating_sub(MAX_COLUMNS);
    if let Some(first) = widths.first_mut().filter(|_| 0 < excess) {
        *first = first.saturating_sub(excess).max(MIN_NAME_COLUMNS);
    }
    let line = |row: &Vec<String>| {
        let padded = row.iter().zip(&widths).enumerate().map(|(at, (cell, width))| {
            let cell = if at == 0 { shortened(cell, *width) } else { cell.clone() };
            if at < left { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        format!("  {}", padded.collect::<Vec<_>>().join("  ")).trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// One sentence of a list, broken between words.
fn wrapped(sentence: &str) -> String {
    let mut lines = vec!["    -".to_owned()];
    for word in sentence.split_whitespace() {
        let last = lines.len() - 1;
        if MAX_COLUMNS < lines[last].chars().count() + 1 + word.chars().count() {
            lines.push(format!("      {word}"));
        } else {
            lines[last].push(' ');
            lines[last].push_str(word);
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_sentences_broken() {
        let rows = [cells(&["topic", "n"]), cells(&["/a/long/one", "7"]), cells(&["/b", "1234"])];
        assert_eq!(
            aligned(&rows, 1),
            "  topic           n\n  /a/long/one     7\n  /b           1234"
        );
        let sentence = "word ".repeat(40);
        let text = wrapped(&sentence);
        assert!(text.lines().all(|line| line.len() <= MAX_COLUMNS), "{text}");
        assert_eq!(text.lines().count(), 3);
    }

    #[test]
    fn sizes_and_names_are_short() {
        assert_eq!([size(999), size(15_457_088)], ["999 B", "15.5 MB"]);
        assert_eq!(short_schema("sensor_msgs/msg/Imu"), "Imu");
        assert_eq!(shortened("/a/long/topic", 6), "…topic");
        let wide = [vec!["/x".repeat(60), "y".repeat(40)]];
        assert_eq!(aligned(&wide, 1).chars().count(), MAX_COLUMNS);
    }
}
