//! The log on stderr: chosen by `RUST_LOG`, else by `--verbose`.

use anstream::ColorChoice;
use env_logger::{Builder, WriteStyle};
use std::{env, io::Write, time::Instant};

/// Name of the variable that chooses what is logged.
const VARIABLE: &str = "RUST_LOG";

/// Starts the log. `verbosity` is how often `--verbose` was typed: steps of the work, then details, then
/// everything; `RUST_LOG` takes its place.
pub(crate) fn start(verbosity: u8, color: ColorChoice, begun: Instant) {
    let usual = match verbosity {
        0 => "off",
        1 => "klasktron=info",
        2 => "klasktron=debug",
        _ => "trace",
    };
    let chosen = env::var(VARIABLE).ok().filter(|chosen| !chosen.is_empty());
    let mut builder = Builder::new();
    builder.parse_filters(chosen.as_deref().unwrap_or(usual)).write_style(match color {
        ColorChoice::Auto => WriteStyle::Auto,
        ColorChoice::Always | ColorChoice::AlwaysAnsi => WriteStyle::Always,
        ColorChoice::Never => WriteStyle::Never,
    });
    builder.format(move |line, record| {
        let style = line.default_level_style(record.level());
        let (level, target) = (record.level(), record.target());
        let elapsed_s = begun.elapsed().as_secs_f64();
        writeln!(line, "[{elapsed_s:8.3} s {style}{level:<5}{style:#} {target}] {}", record.args())
    });
    builder.init();
}

/// Whether a log is written that a bar would tear.
pub(crate) fn is_on() -> bool {
    log::Level::Info <= log::max_level()
}
