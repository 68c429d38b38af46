//! What a person sees: lines on stderr, results on stdout, bars. `--quiet`, `--verbose` and `--color` are
//! obeyed here and nowhere else.

use anstream::ColorChoice;
use clap::builder::styling::{AnsiColor, Style, Styles};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    io::{self, Write},
    sync::atomic::{AtomicU8, Ordering},
};

/// How much is said on stderr beside warnings and errors, which are always told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Talk {
    /// Nothing.
    Quiet,
    /// Notes, and bars on a terminal.
    Usual,
    /// Notes and a log; a bar would be torn by it.
    Log,
}

static TALK: AtomicU8 = AtomicU8::new(Talk::Usual as u8);

/// Sets how much is said from here on.
pub(crate) fn set_talk(talk: Talk) {
    TALK.store(talk as u8, Ordering::Relaxed);
}

fn talk_is(talk: Talk) -> bool {
    TALK.load(Ordering::Relaxed) == talk as u8
}

/// Sets where colours are used: `Auto` heeds `NO_COLOR` and whether it is a terminal.
pub(crate) fn set_color(color: ColorChoice) {
    color.write_global();
}

/// Says one line to the person, on stderr, even under `--quiet`: errors, warnings, losses.
pub(crate) fn tell(line: &str) {
    // Nobody is left to tell when stderr is closed.
    writeln!(anstream::stderr(), "{}", colored(line)).ok();
}

/// Says one line that may be missed, on stderr; nothing under `--quiet`.
pub(crate) fn note(line: &str) {
    if !talk_is(Talk::Quiet) {
        tell(line);
    }
}

/// Prints a result on stdout; a reader that has gone away (`| head`) is no failure.
pub(crate) fn print(text: &str) -> io::Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

/// A bar of `length` steps; nothing is drawn when stderr is no terminal, under `--quiet`, or between the
/// lines of a log.
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

/// The word before the first colon, coloured where it says how grave the line is.
fn colored(line: &str) -> String {
    let grave = *Styles::styled().get_error();
    let doubtful = Style::new().fg_color(Some(AnsiColor::Yellow.into())).bold();
    for (label, style) in [("error:", grave), ("lost:", grave), ("warning:", doubtful)] {
        if let Some(rest) = line.strip_prefix(label) {
            return format!("{style}{label}{style:#}{rest}");
        }
    }
    line.to_owned()
}
