//! `klasktron completions`: the command line as a script for a shell.

use super::Outcome;
use clap::CommandFactory;
use clap_complete::{Shell, generate};
use std::io::{self, Write};

/// What can be typed after `klasktron completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron completions bash > klasktron.bash
  klasktron completions zsh > _klasktron
  klasktron completions fish > klasktron.fish

Where shells look for them: ~/.local/share/bash-completion/completions/klasktron, a folder of zsh's
$fpath, ~/.config/fish/completions/klasktron.fish. For this shell alone:
  source <(klasktron completions bash)")]
pub(crate) struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    generate(args.shell, &mut crate::cli::Cli::command(), "klasktron", &mut script);
    io::stdout().write_all(&script)?;
    Ok(Outcome::Done)
}
