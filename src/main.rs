//! The `klasktron` program: arguments in, one call into the library, an exit status out.

mod cli;
mod commands;

use clap::Parser;
use std::{io::IsTerminal, process::ExitCode};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_unset| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .init();
    match cli::Cli::parse().command.run() {
        Ok(outcome) => outcome.exit_code(),
        Err(error) => {
            commands::tell(&format!("error: {error:#}"));
            ExitCode::from(commands::EXIT_FAILED)
        }
    }
}
