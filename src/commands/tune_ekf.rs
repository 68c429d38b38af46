//! `klasktron tune-ekf`: recordings to the settings of a filter, and how good it is.

use super::{Outcome, loss_sentence, print, tell};
use klasktron::{
    ekf::{self, Document, Tuned},
    provenance::Provenance,
    recording::{ExistingFile, Recording, write_bytes},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// What can be typed after `klasktron tune-ekf`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron tune-ekf monday.mcap tuesday.mcap --out ekf")]
pub(crate) struct Args {
    /// Recordings with /camera/detections; runs marked split=validation judge and are never fitted
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Folder for ekf.json, index.html and ekf.mcap
    #[arg(short, long, value_name = "DIR", default_value = "ekf")]
    out: PathBuf,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut recordings: Vec<Recording> = Vec::new();
    for path in &args.recordings {
        let recording = Recording::open(path)?;
        if recordings.iter().any(|other| other.sha256 == recording.sha256) {
            tell(&format!("warning: {} is given twice and counts once", path.display()));
        } else {
            recordings.push(recording);
        }
    }
    let damaged = || recordings.iter().filter(|recording| !recording.loss.is_none());
    let tuned = ekf::tune_recordings(&recordings, Provenance::new(args.command_line()))?;
    write_outcome(&tuned, &args.out)?;
    for recording in damaged() {
        tell(&format!("warning: {}", loss_sentence(recording)));
    }
    for warning in &tuned.document.warnings {
        tell(&format!("warning: {warning}"));
    }
    if args.json {
        print(tuned.document.to_json().trim_end())?;
    } else {
        print(&table(&tuned.document))?;
        print(&format!("wrote ekf.json, index.html and ekf.mcap in {}", args.out.display()))?;
    }
    Ok(if damaged().next().is_none() { Outcome::Done } else { Outcome::Lossy })
}

impl Args {
    /// The command without the place of its results, so that equal results are equal files.
    fn command_line(&self) -> String {
        let mut line = "klasktron tune-ekf".to_owned();
        for path in &self.recordings {
            line.push_str(&format!(" {}", path.display()));
        }
        line
    }
}

fn write_outcome(tuned: &Tuned, out: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(out)?;
    ekf::write_recording(tuned, &out.join("ekf.mcap"))?;
    let page = ekf::page(tuned);
    write_bytes(&out.join("index.html"), ExistingFile::Replace, page.as_bytes())?;
    let document = tuned.document.to_json();
    write_bytes(&out.join("ekf.json"), ExistingFile::Replace, document.as_bytes())?;
    Ok(())
}

/// The result for people.
fn table(document: &Document) -> String {
    let mut lines = vec![format!(
        "{:<24}{:>12}{:>8}{:>8}{:>16}{:>16}",
        "held out", "detections", "NIS", "NEES", "velocity mm/s", "upstream mm/s"
    )];
    let figure = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    for own in &document.evaluation {
        for region in &own.regions {
            lines.push(format!(
                "{:<24}{:>12}{:>8}{:>8}{:>16}{:>16}",
                format!("{} {}", own.object.name(), region.region.name()),
                region.nis.map_or(0, |nis| nis.samples),
                figure(region.nis.map(|nis| nis.mean)),
                figure(region.nees.map(|nees| nees.mean)),
                figure(region.velocity_rmse_m_per_s.map(|error| 1e3 * error)),
                figure(region.upstream_velocity_rmse_m_per_s.map(|error| 1e3 * error)),
            ));
        }
    }
    for own in &document.bounces {
        lines.push(format!(
            "63 % of the velocity after {} impacts on a {}: {} frames (upstream {})",
            own.impacts,
            if own.hit == ekf::Hit::Wall { "wall" } else { "striker" },
            own.own.median_frames,
            own.upstream.median_frames
        ));
    }
    lines.join("\n")
}
