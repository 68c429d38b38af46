//! `klasktron`: parse the command line, run one command, return its exit status.

mod cli;
mod commands;

use commands::interrupt::{EXIT_INTERRUPTED, Interrupted};
use std::{process::ExitCode, time::Instant};

fn main() -> ExitCode {
    let begun = Instant::now();
    let cli = match cli::Cli::start(begun) {
        Ok(cli) => cli,
        Err(status) => return status,
    };
    let result = cli.run();
    log::info!("ended after {:.3} s", begun.elapsed().as_secs_f64());
    match result {
        Ok(outcome) => outcome.exit_code(),
        Err(error) if error.is::<Interrupted>() => {
            commands::tell(&error.to_string());
            ExitCode::from(EXIT_INTERRUPTED)
        }
        Err(error) => {
            commands::tell(&format!("error: {}", commands::one_line(&error)));
            ExitCode::from(commands::EXIT_FAILED)
        }
    }
}
