//! `klasktron completions`: completion script for a shell.

use super::Outcome;
use clap::CommandFactory;
use clap_complete::{Shell, generate};
use std::io::{self, Write};

/// Arguments of `klasktron completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron completions bash > klasktron.bash
  klasktron completions zsh > _klasktron
  klasktron completions fish > klasktron.fish

Folders that shells read: ~/.local/share/bash-completion/completions/klasktron, a folder of zsh's
$fpath, ~/.config/fish/completions/klasktron.fish. For the current shell only:
  source <(klasktron completions bash)")]
pub(crate) struct Args {
    /// Shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Run `klasktron completions`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    generate(args.shell, &mut crate::cli::Cli::command(), "klasktron", &mut script);
    io::stdout().write_all(&script)?;
    Ok(Outcome::Done)
}
