//! Log on stderr, filtered by `RUST_LOG` or else by `--verbose`.

use anstream::ColorChoice;
use env_logger::{Builder, WriteStyle};
use std::{env, io::Write, time::Instant};

/// Environment variable with the filter of the log.
const VARIABLE: &str = "RUST_LOG";

/// Start the log. `verbosity` counts `--verbose`: 1 logs steps, 2 details, 3 everything. `RUST_LOG` takes precedence.
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

/// Return whether a log is written, which a progress bar would break up.
pub(crate) fn is_on() -> bool {
    log::Level::Info <= log::max_level()
}
