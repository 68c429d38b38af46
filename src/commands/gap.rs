//! `klasktron gap` and `klasktron calibrate`: recordings and a twin to a better twin, and what was
//! missing.

use super::{Outcome, loss_sentence, note, print, tell};
use klasktron::{
    gap::{self, Document, Found, Task, Verdict},
    provenance::Provenance,
    recording::{ExistingFile, Recording, write_bytes},
    twin::{self, SessionError, Twin},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// What can be typed after `klasktron gap`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron gap monday.mcap tuesday.mcap --twin twin.json --out gap"
)]
pub(crate) struct Args {
    /// Recordings of at least two sessions; those marked split=validation judge and are never fitted
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The twin to start from [default: the plain built-in one]
    #[arg(long, value_name = "FILE")]
    twin: Option<PathBuf>,
    /// Folder for gap.json, twin.json, index.html and gap.mcap
    #[arg(short, long, value_name = "DIR", default_value = "gap")]
    out: PathBuf,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
}

/// What can be typed after `klasktron calibrate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron calibrate monday.mcap --out twin.json")]
pub(crate) struct CalibrateArgs {
    /// Recordings; those marked split=validation judge and are never fitted
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The twin to start from [default: the plain built-in one]
    #[arg(long, value_name = "FILE")]
    twin: Option<PathBuf>,
    /// The twin to write
    #[arg(short, long, value_name = "FILE", default_value = "twin.json")]
    out: PathBuf,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
}

/// Recordings and twin, read.
struct Inputs {
    recordings: Vec<Recording>,
    start: Option<Twin>,
    lost: bool,
}

impl Inputs {
    fn read(recordings: &[PathBuf], start: Option<&Path>) -> anyhow::Result<Self> {
        let start = start.map(twin::read_twin).transpose()?;
        let mut opened: Vec<Recording> = Vec::new();
        for path in recordings {
            let recording = Recording::open(path)?;
            if opened.iter().any(|other| other.sha256 == recording.sha256) {
                tell(&format!("warning: {} is given twice and counts once", path.display()));
                continue;
            }
            if !recording.loss.is_none() {
                tell(&format!("warning: {}", loss_sentence(&recording)));
            }
            opened.push(recording);
        }
        let lost = opened.iter().any(|recording| !recording.loss.is_none());
        Ok(Self { recordings: opened, start, lost })
    }

    fn sessions(&self) -> Result<Vec<twin::Session>, SessionError> {
        let sessions = twin::sessions_of(&self.recordings)?;
        let recorded = twin::machine_of(&sessions);
        match &self.start {
            Some(start) if start.machine != recorded => {
                Err(SessionError::OtherMachine { twin: start.machine, recorded })
            }
            _ => Ok(sessions),
        }
    }
}

/// Runs `klasktron gap`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let inputs = Inputs::read(&args.recordings, args.twin.as_deref())?;
    let sessions = inputs.sessions()?;
    note(&format!("comparing {} sessions with the twin", sessions.len()));
    let found = gap::find(&sessions, inputs.start.as_ref(), Task::CloseGap);
    let provenance = Provenance::new(args.command_line());
    write_outcome(&found, &provenance, &inputs, &sessions, &args.out)?;
    for doubt in &found.document.doubts {
        tell(&format!("warning: {doubt}"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(&found.document)?)?;
    } else {
        print(&summary(&found.document))?;
        print(&format!(
            "wrote gap.json, twin.json, index.html and gap.mcap in {}",
            args.out.display()
        ))?;
    }
    Ok(outcome(&found.document, &inputs))
}

/// Runs `klasktron calibrate`.
pub(crate) fn calibrate(args: &CalibrateArgs) -> anyhow::Result<Outcome> {
    let inputs = Inputs::read(&args.recordings, args.twin.as_deref())?;
    let sessions = inputs.sessions()?;
    let found = gap::find(&sessions, inputs.start.as_ref(), Task::Calibrate);
    if let Some(parent) = args.out.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent)?;
    }
    twin::write_twin(&found.twin, &args.out)?;
    for doubt in &found.document.doubts {
        tell(&format!("warning: {doubt}"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(&found.document)?)?;
    } else {
        print(&parameters(&found.twin))?;
        print(&gaps(&found.document))?;
        print(&format!("wrote {}", args.out.display()))?;
    }
    Ok(outcome(&found.document, &inputs))
}

impl Args {
    /// The command without the place of its results, so that equal results are equal files.
    fn command_line(&self) -> String {
        let mut line = "klasktron gap".to_owned();
        for path in &self.recordings {
            line.push_str(&format!(" {}", path.display()));
        }
        if let Some(twin) = &self.twin {
            line.push_str(&format!(" --twin {}", twin.display()));
        }
        line
    }
}

fn write_outcome(
    found: &Found<'_>,
    provenance: &Provenance,
    inputs: &Inputs,
    sessions: &[twin::Session],
    out: &Path,
) -> anyhow::Result<()> {
    fs::create_dir_all(out)?;
    let document = serde_json::to_string_pretty(&found.document)? + "\n";
    let names: Vec<String> =
        inputs.recordings.iter().map(|recording| recording.path.display().to_string()).collect();
    let page = gap::page(found, &names.join(", "), provenance, sessions);
    gap::write_tape(found, provenance, sessions, &out.join("gap.mcap"))?;
    write_bytes(&out.join("index.html"), ExistingFile::Replace, page.as_bytes())?;
    twin::write_twin(&found.twin, &out.join("twin.json"))?;
    write_bytes(&out.join("gap.json"), ExistingFile::Replace, document.as_bytes())?;
    Ok(())
}

/// A gate was not met where nothing could be said about the machine.
fn outcome(document: &Document, inputs: &Inputs) -> Outcome {
    let refused = matches!(
        document.verdict,
        Verdict::NotTestable | Verdict::DifferentMachine | Verdict::InputNotConnected
    );
    if inputs.lost || refused { Outcome::Lossy } else { Outcome::Done }
}

/// The answer for people.
fn summary(document: &Document) -> String {
    let mut lines = vec![document.says.clone()];
    for effect in &document.effects {
        lines.push(format!("  {} on {}", effect.name, effect.axis));
        lines.push(format!("    {}", effect.why));
    }
    for refit in &document.refit {
        let interval =
            refit.ci95.map_or_else(String::new, |[low, high]| format!(" ({low:.4} to {high:.4})"));
        lines.push(format!(
            "  {} on {}: {:.4} -> {:.4}{interval} {}",
            refit.name, refit.axis, refit.before, refit.after, refit.unit
        ));
    }
    lines.push(gaps(document));
    if let Some(experiment) = &document.next_experiment {
        lines.push(format!("next: {experiment}"));
    }
    lines.join("\n")
}

/// The gap of each signal.
fn gaps(document: &Document) -> String {
    let mut lines = vec![format!(
        "{:<24}{:>6}{:>12}{:>12}{:>12}",
        "gap, RMS, held out", "unit", "floor", "before", "after"
    )];
    let figure = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3e}"));
    for gap in &document.gap {
        lines.push(format!(
            "{:<24}{:>6}{:>12}{:>12}{:>12}",
            gap.signal,
            gap.unit,
            figure(gap.noise_floor),
            figure(gap.held_out_before),
            figure(gap.held_out_after)
        ));
    }
    lines.join("\n")
}

/// Every number of a twin with its interval.
fn parameters(twin: &Twin) -> String {
    let mut lines = Vec::new();
    for instance in &twin.instances {
        for (parameter, value) in instance.effect.parameters.iter().zip(&instance.values) {
            let interval = value.ci95.map_or_else(
                || "not fitted".to_owned(),
                |[low, high]| format!("{low:.5} to {high:.5}"),
            );
            lines.push(format!(
                "{:<52}{:>12.5} {:<8} ({interval})",
                format!("{} {} {}", instance.effect.name, instance.axis, parameter.name),
                value.value,
                parameter.unit
            ));
        }
    }
    lines.join("\n")
}
