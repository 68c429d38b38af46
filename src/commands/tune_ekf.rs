//! `klasktron tune-ekf`: tune the Kalman filter on recordings and validate it.

use super::{
    Outcome, loss_sentence, print,
    reported_command::ReportedCommand,
    results::{OverwriteArgs, Results},
    tell, terminal,
};
use indicatif::ProgressBar;
use klasktron::{
    ekf::{self, Document, Object, TuneObserver, Tuned},
    provenance::Provenance,
    recording::{ExistingFile, Recording, write_bytes},
};
use std::path::PathBuf;

/// Files that the command writes.
const FILES: [&str; 3] = ["ekf.mcap", "index.html", "ekf.json"];

/// Template of the progress bar.
const TEMPLATE: &str = "{msg}, stage {pos}/{len}, {elapsed} elapsed, {eta} left";

/// Arguments of `klasktron tune-ekf`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron tune-ekf monday.mcap tuesday.mcap -o ekf")]
pub(crate) struct Args {
    /// Recordings with /camera/detections; runs marked split=validation are held out
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Folder for ekf.json, index.html and ekf.mcap
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "ekf")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
}

/// Run `klasktron tune-ekf`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut recordings: Vec<Recording> = Vec::new();
    for path in &args.recordings {
        let recording = Recording::open(path)?;
        if recordings.iter().any(|other| other.sha256 == recording.sha256) {
            tell(&format!("warning: {} is given twice; it is used once", path.display()));
        } else {
            recordings.push(recording);
        }
    }
    let results = Results::begin(&args.output, &FILES, args.overwrite)?;
    let damaged = || recordings.iter().filter(|recording| !recording.loss.is_none());
    let provenance = Provenance::new(args.command_line());
    let view = TuneView { bar: terminal::bar(Some(0), TEMPLATE) };
    let tuned = ekf::tune_recordings_observed(&recordings, provenance, &view);
    view.bar.finish_and_clear();
    let tuned = tuned?;
    write_outcome(&tuned, &results)?;
    results.finish()?;
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
        print(&format!("wrote ekf.json, index.html and ekf.mcap in {}", args.output.display()))?;
    }
    Ok(if damaged().next().is_none() { Outcome::Done } else { Outcome::Lossy })
}

/// Progress bar of the stages of all objects.
struct TuneView {
    bar: ProgressBar,
}

impl TuneObserver for TuneView {
    fn object_begun(&self, _object: Object, stages: usize) {
        self.bar.inc_length(stages as u64);
    }

    fn stage_done(&self, object: Object) {
        self.bar.set_message(format!("tuning {}", object.name()));
        self.bar.inc(1);
    }
}

impl Args {
    /// Command line without the output folder, so that equal results are equal files.
    fn command_line(&self) -> String {
        ReportedCommand::new("tune-ekf")
            .words(self.recordings.iter().map(|path| path.display()))
            .into_string()
    }
}

fn write_outcome(tuned: &Tuned, results: &Results) -> anyhow::Result<()> {
    ekf::write_recording(tuned, &results.path("ekf.mcap"))?;
    let page = ekf::page(tuned);
    write_bytes(&results.path("index.html"), ExistingFile::Replace, page.as_bytes())?;
    let document = tuned.document.to_json();
    write_bytes(&results.path("ekf.json"), ExistingFile::Replace, document.as_bytes())?;
    Ok(())
}

/// Result as a table.
fn table(document: &Document) -> String {
    let mut lines = vec![format!(
        "{:<24}{:>12}{:>8}{:>8}{:>16}{:>16}",
        "validation runs", "detections", "NIS", "NEES", "velocity mm/s", "upstream mm/s"
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
