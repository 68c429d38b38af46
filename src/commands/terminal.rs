//! Terminal output: lines on stderr, results on stdout, progress bars. Only this module obeys `--quiet`,
//! `--verbose` and `--color`.

use anstream::ColorChoice;
use clap::builder::styling::{AnsiColor, Style, Styles};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    io::{self, Write},
    sync::atomic::{AtomicU8, Ordering},
};

/// Amount of output on stderr. Warnings and errors are always printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Talk {
    /// No notes.
    Quiet,
    /// Notes, and progress bars on a terminal.
    Usual,
    /// Notes and a log, which would break a bar up.
    Log,
}

static TALK: AtomicU8 = AtomicU8::new(Talk::Usual as u8);

/// Set the amount of output.
pub(crate) fn set_talk(talk: Talk) {
    TALK.store(talk as u8, Ordering::Relaxed);
}

fn talk_is(talk: Talk) -> bool {
    TALK.load(Ordering::Relaxed) == talk as u8
}

/// Set the use of colours: `Auto` obeys `NO_COLOR` and uses them on a terminal only.
pub(crate) fn set_color(color: ColorChoice) {
    color.write_global();
}

/// Print one line on stderr, also under `--quiet`: errors, warnings, losses.
pub(crate) fn tell(line: &str) {
    // Nobody reads a closed stderr.
    writeln!(anstream::stderr(), "{}", colored(line)).ok();
}

/// Print one line on stderr, unless `--quiet` is given.
pub(crate) fn note(line: &str) {
    if !talk_is(Talk::Quiet) {
        tell(line);
    }
}

/// Print a result on stdout. A closed reader (`| head`) is no error.
///
/// # Errors
/// Stdout cannot be written for another reason.
pub(crate) fn print(text: &str) -> io::Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

/// Progress bar of `length` steps; hidden without a terminal, under `--quiet` and with a log.
pub(crate) fn bar(length: Option<u64>, template: &str) -> ProgressBar {
    if !talk_is(Talk::Usual) {
        return ProgressBar::hidden();
    }
    let bar = length.map_or_else(ProgressBar::no_length, ProgressBar::new);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// Colour the label of an error, a loss or a warning.
fn colored(line: &str) -> String {
    let error = *Styles::styled().get_error();
    let warning = Style::new().fg_color(Some(AnsiColor::Yellow.into())).bold();
    for (label, style) in [("error:", error), ("lost:", error), ("warning:", warning)] {
        if let Some(rest) = line.strip_prefix(label) {
            return format!("{style}{label}{style:#}{rest}");
        }
    }
    line.to_owned()
}
