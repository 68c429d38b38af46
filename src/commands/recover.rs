//! `klasktron recover`: copy the readable part of a truncated or damaged file into a whole file.

use super::{
    Outcome, note,
    results::{OverwriteArgs, write_file},
    tell,
};
use anyhow::bail;
use klasktron::recording::{Recording, recover::write_copy};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `klasktron recover`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron recover cut.mcap -o saved.mcap")]
pub(crate) struct Args {
    /// Truncated or damaged MCAP file
    file: PathBuf,
    /// Recording to write, with summary and indexes
    #[arg(short, long, alias = "out", value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

/// Run `klasktron recover`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if is_same_file(&args.file, &args.output) {
        bail!(
            "{}: input and output are the same file; give -o another name, so that the damaged \
             original is kept",
            args.file.display()
        );
    }
    let recording = Recording::open(&args.file)?;
    write_file(&args.output, args.overwrite, |existing| {
        Ok(write_copy(&recording, &args.output, existing)?)
    })?;
    let messages: usize = recording.channels.iter().map(|c| c.messages.len()).sum();
    let kept = format!(
        "{}: {messages} messages on {} topics, {} attachments and {} metadata records written to {}",
        args.file.display(),
        recording.channels.len(),
        recording.attachments.len(),
        recording.metadata.len(),
        args.output.display()
    );
    if recording.loss.is_none() {
        note(&format!("{kept}; the file was whole, nothing was lost"));
        return Ok(Outcome::Done);
    }
    tell(&format!("{kept}; lost: {}", recording.loss));
    Ok(Outcome::Lossy)
}

/// Return whether both paths lead to one file, also through links.
fn is_same_file(one: &Path, other: &Path) -> bool {
    match (fs::canonicalize(one), fs::canonicalize(other)) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}
