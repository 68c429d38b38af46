//! Import of `candump -L` logs from the drives' bus.

use super::{
    bus::BusDecoder,
    drives::{MagnetTrack, push_carriages},
    error::ImportError,
    report::{ImportReport, Notice},
    run::{ImportConfig, Table, identity},
    tape::Tape,
};
use crate::can::candump::{CandumpError, LogLine, parse_line};
use std::{
    collections::BTreeSet,
    fs::File,
    io::{BufRead, BufReader},
    path::Path,
};

/// Import a log. Invalid lines and CAN FD frames are skipped and counted. When the log has several
/// interfaces, `interface` selects the drives' bus.
///
/// # Errors
/// When the log cannot be read or has no frame, the interface is ambiguous, or writing the output
/// fails.
pub fn import_candump(
    path: &Path,
    interface: Option<&str>,
    table: &Table,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let mut tape = Tape::default();
    let mut lines = read_lines(path, &mut tape)?;
    choose_interface(path, interface, &mut lines)?;
    lines.sort_by_key(|line| line.time);
    let mut bus = BusDecoder::default();
    for line in &lines {
        bus.push(&mut tape, [line.time, line.time], &line.frame, line.direction);
    }
    bus.finish(&mut tape, table.gantry);
    push_carriages(&mut tape, table.gantry, &mut MagnetTrack::default());
    let split = config.split_or_train();
    tape.mark_run(0, "unknown", &split.to_string());
    table.note(&mut tape);
    config.write(tape, path, split, &[identity(path)?])
}

/// Lines skipped for one reason.
#[derive(Default)]
struct Skipped {
    lines: usize,
    first: Option<(usize, String)>,
}

impl Skipped {
    fn add(&mut self, number: usize, error: &CandumpError) {
        self.lines += 1;
        self.first.get_or_insert_with(|| (number, error.to_string()));
    }

    fn note(self, what: &'static str, tape: &mut Tape) {
        if let Some((first_line, reason)) = self.first {
            tape.notices.push(Notice::SkippedLines { what, lines: self.lines, first_line, reason });
        }
    }
}

fn read_lines(path: &Path, tape: &mut Tape) -> Result<Vec<LogLine>, ImportError> {
    let file = File::open(path).map_err(ImportError::io(path, "open"))?;
    let mut reader = BufReader::new(file);
    let [mut unreadable, mut flexible] = [Skipped::default(), Skipped::default()];
    let mut lines = Vec::new();
    let mut number = 0;
    let mut bytes = Vec::new();
    while 0 < reader.read_until(b'\n', &mut bytes).map_err(ImportError::io(path, "read"))? {
        number += 1;
        let text = String::from_utf8_lossy(&bytes);
        if !text.trim().is_empty() {
            match parse_line(&text) {
                Ok(line) => lines.push(line),
                Err(error @ CandumpError::FlexibleData) => flexible.add(number, &error),
                Err(error) => unreadable.add(number, &error),
            }
        }
        bytes.clear();
    }
    if lines.is_empty() {
        let reason = unreadable.first.or(flexible.first).map(|(_, reason)| reason);
        let reason = reason.unwrap_or_else(|| "the file has no line".to_owned());
        return Err(ImportError::NoFrames { path: path.to_owned(), lines: number, reason });
    }
    unreadable.note("lines that are not frames", tape);
    flexible.note("CAN FD frames", tape);
    Ok(lines)
}

fn choose_interface(
    path: &Path,
    interface: Option<&str>,
    lines: &mut Vec<LogLine>,
) -> Result<(), ImportError> {
    let found: BTreeSet<String> = lines.iter().map(|line| line.interface.clone()).collect();
    let wrong = || ImportError::Interfaces {
        path: path.to_owned(),
        found: found.iter().cloned().collect(),
    };
    match interface {
        None if 1 < found.len() => Err(wrong()),
        Some(wanted) if !found.contains(wanted) => Err(wrong()),
        Some(wanted) => {
            lines.retain(|line| line.interface == wanted);
            Ok(())
        }
        None => Ok(()),
    }
}
