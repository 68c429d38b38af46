//! `klasktron man`: manual pages of the command line.

use super::{
    Outcome, print,
    results::{OverwriteArgs, Results},
};
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use klasktron::{
    provenance::CRATE_VERSION,
    recording::{ExistingFile, write_bytes},
};
use std::{
    io::{self, Write},
    path::PathBuf,
};

/// Arguments of `klasktron man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron man | man -l -
  klasktron man -o man/man1")]
pub(crate) struct Args {
    /// Folder for klasktron.1 and a page for every subcommand [default: print klasktron.1]
    #[arg(short, long, alias = "out", value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

/// Run `klasktron man`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut command = crate::cli::Cli::command().disable_help_subcommand(true);
    command.build();
    let Some(folder) = &args.output else {
        io::stdout().write_all(&page(&command)?)?;
        return Ok(Outcome::Done);
    };
    let mut pages = Vec::new();
    collect_pages(&command, &mut pages)?;
    let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
    let results = Results::begin(folder, &names, args.overwrite)?;
    for (name, page) in &pages {
        write_bytes(&results.path(name), ExistingFile::Replace, page)?;
    }
    results.finish()?;
    print(&format!("wrote {} pages to {}", pages.len(), folder.display()))?;
    Ok(Outcome::Done)
}

/// Add the pages of `command` and of all commands below it, with their file names.
fn collect_pages(command: &Command, pages: &mut Vec<(String, Vec<u8>)>) -> io::Result<()> {
    pages.push((Man::new(command.clone()).get_filename(), page(command)?));
    let mut shown = command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set());
    shown.try_for_each(|subcommand| collect_pages(subcommand, pages))
}

fn page(command: &Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    let man = Man::new(command.clone()).manual("Klasktron");
    man.source(format!("klasktron {CRATE_VERSION}")).render(&mut page)?;
    // The generator has no name for the end of a help text: notes of the program, examples of a subcommand.
    let heading = if command.get_name() == "klasktron" { "NOTES" } else { "EXAMPLES" };
    let page =
        String::from_utf8_lossy(&page).replace("\n.SH EXTRA\n", &format!("\n.SH {heading}\n"));
    Ok(page.into_bytes())
}
