//! The `klasktron` program: arguments in, one call into the library, an exit status out.

mod cli;
mod commands;

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
