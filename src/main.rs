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
            commands::tell(&format!("error: {}", one_line(&error)));
            ExitCode::from(commands::EXIT_FAILED)
        }
    }
}

/// The chain of reasons on one line. A reason that the message before it already tells, as library
/// errors do, is not told again.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for reason in error.chain().map(ToString::to_string) {
        if !line.contains(&reason) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&reason);
        }
    }
    line
}
