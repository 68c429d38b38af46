//! `klasktron recover`: what a cut-off or damaged file still holds, as a whole file.

use super::{Outcome, note, tell};
use anyhow::bail;
use klasktron::recording::{ExistingFile, Recording, recover::write_copy};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// What can be typed after `klasktron recover`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron recover cut.mcap --out saved.mcap")]
pub(crate) struct Args {
    /// The cut-off or damaged MCAP file
    file: PathBuf,
    /// Where to write what it still holds, with summary and indexes
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// Replace OUT if it exists already
    #[arg(long)]
    overwrite: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if is_same_file(&args.file, &args.out) {
        bail!(
            "{}: input and output are the same file; give -o another name, so that the damaged \
             original is kept",
            args.file.display()
        );
    }
    let recording = Recording::open(&args.file)?;
    let existing = if args.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse };
    write_copy(&recording, &args.out, existing)?;
    let messages: usize = recording.channels.iter().map(|c| c.messages.len()).sum();
    let kept = format!(
        "{}: {messages} messages on {} topics, {} attachments and {} metadata records written to {}",
        args.file.display(),
        recording.channels.len(),
        recording.attachments.len(),
        recording.metadata.len(),
        args.out.display()
    );
    if recording.loss.is_none() {
        note(&format!("{kept}; the file was whole, nothing was lost"));
        return Ok(Outcome::Done);
    }
    tell(&format!("{kept}; lost: {}", recording.loss));
    Ok(Outcome::Lossy)
}

/// Whether both names lead to one file, through links as well.
fn is_same_file(one: &Path, other: &Path) -> bool {
    match (fs::canonicalize(one), fs::canonicalize(other)) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}
