//! `klasktron info`: summary and data quality of recordings.

mod layout;

use super::{Outcome, one_line, print, tell};
use anyhow::bail;
use klasktron::recording::{
    Recording,
    inspect::{self, Inspection, QualityWarning},
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `klasktron info`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron info match.mcap\n  klasktron info --json train.mcap validation.mcap"
)]
pub(crate) struct Args {
    /// Recordings of the data contract, ROS 2 bags in MCAP, or any other MCAP file
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
}

/// Document of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    schema_version: u32,
    /// Files that could be read, in the order of the arguments.
    files: Vec<Inspection>,
    /// Warnings about the files together.
    warnings: Vec<QualityWarning>,
}

/// Run `klasktron info`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::Done;
    let mut files = Vec::new();
    for path in &args.files {
        match look_at(path) {
            Ok((inspection, found)) => {
                files.push(inspection);
                if found == Outcome::Lossy {
                    outcome = found;
                }
            }
            // The error of a single file is the error of the command.
            Err(error) if args.files.len() == 1 => return Err(error),
            Err(error) => {
                tell(&format!("error: {}", one_line(&error)));
                outcome = Outcome::Lossy;
            }
        }
    }
    if files.is_empty() {
        bail!("none of the {} files could be read", args.files.len());
    }
    let warnings = inspect::compare(&files);
    if args.json {
        let document = Document { schema_version: inspect::SCHEMA_VERSION, files, warnings };
        print(&serde_json::to_string_pretty(&document)?)?;
    } else {
        let mut text: Vec<String> = files.iter().map(layout::inspection).collect();
        if !warnings.is_empty() {
            text.push(layout::warnings("warnings about the files together", &warnings));
        }
        print(&text.join("\n\n"))?;
    }
    Ok(outcome)
}

fn look_at(path: &Path) -> anyhow::Result<(Inspection, Outcome)> {
    let recording = Recording::open(path)?;
    let inspection = inspect::inspect(&recording)?;
    if recording.loss.is_none() {
        return Ok((inspection, Outcome::Done));
    }
    tell(&super::loss_sentence(&recording));
    Ok((inspection, Outcome::Lossy))
}
