//! `klasktron man`: the command line as manual pages.

use super::{Outcome, print};
use anyhow::Context as _;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use klasktron::{
    provenance::CRATE_VERSION,
    recording::{ExistingFile, write_bytes},
};
use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

/// What can be typed after `klasktron man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron man | man -l -
  klasktron man --out man/man1")]
pub(crate) struct Args {
    /// Write klasktron.1 and a page per subcommand into this folder
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut command = crate::cli::Cli::command().disable_help_subcommand(true);
    command.build();
    let Some(folder) = &args.out else {
        io::stdout().write_all(&page(&command)?)?;
        return Ok(Outcome::Done);
    };
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let pages = write_pages(&command, folder)?;
    print(&format!("wrote {pages} pages to {}", folder.display()))?;
    Ok(Outcome::Done)
}

/// Writes the pages of `command` and of everything below it; gives their number.
fn write_pages(command: &Command, folder: &Path) -> anyhow::Result<usize> {
    let path = folder.join(Man::new(command.clone()).get_filename());
    write_bytes(&path, ExistingFile::Replace, &page(command)?)?;
    let shown = command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set());
    let below = shown.map(|subcommand| write_pages(subcommand, folder));
    Ok(1 + below.sum::<anyhow::Result<usize>>()?)
}

fn page(command: &Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    let man = Man::new(command.clone()).manual("Klasktron");
    man.source(format!("klasktron {CRATE_VERSION}")).render(&mut page)?;
    // The generator has no name for what stands at the end of a help text: with us, examples.
    let page = String::from_utf8_lossy(&page).replace("\n.SH EXTRA\n", "\n.SH EXAMPLES\n");
    Ok(page.into_bytes())
}
