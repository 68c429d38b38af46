//! Output of whole lines to a byte stream that may accept only a part of one.
//!
//! A line of which no byte was accepted is rejected and discarded, so that no frame waits here. A
//! line that was accepted in part is finished first, so that the other end never reads a torn line.

use std::io::{self, ErrorKind, Write};

/// Result of sending a line.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// The line is sent or in progress.
    Whole,
    /// No byte of the line was sent.
    Nothing,
}

/// Stream and the unsent rest of its last line. The stream's own write time-out limits the wait.
#[derive(Debug)]
pub(super) struct Outbox<W> {
    stream: W,
    rest: Vec<u8>,
}

impl<W: Write> Outbox<W> {
    pub(super) fn new(stream: W) -> Self {
        Self { stream, rest: Vec::new() }
    }

    /// Send `line` now or not at all.
    pub(super) fn send(&mut self, line: &[u8]) -> io::Result<Taken> {
        let unfinished = std::mem::take(&mut self.rest);
        let taken = write_what_fits(&mut self.stream, &unfinished)?;
        if taken < unfinished.len() {
            self.rest = unfinished[taken..].to_vec();
            return Ok(Taken::Nothing);
        }
        let taken = write_what_fits(&mut self.stream, line)?;
        if taken == 0 && !line.is_empty() {
            return Ok(Taken::Nothing);
        }
        self.rest = line[taken..].to_vec();
        Ok(Taken::Whole)
    }
}

/// Write until everything is accepted or the stream's time-out expires; return the number of bytes
/// written.
fn write_what_fits(stream: &mut impl Write, bytes: &[u8]) -> io::Result<usize> {
    let mut taken = 0;
    while taken < bytes.len() {
        match stream.write(&bytes[taken..]) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => taken += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                break;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(taken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Writer that accepts the given number of bytes at each call, nothing at a 0.
    struct Narrow {
        widths: Vec<usize>,
        call: usize,
        taken: Vec<u8>,
    }

    impl Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let width = self.widths[self.call % self.widths.len()].min(bytes.len());
            self.call += 1;
            if width == 0 {
                return Err(ErrorKind::WouldBlock.into());
            }
            self.taken.extend_from_slice(&bytes[..width]);
            Ok(width)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// The received text is the accepted lines, each whole, for any stream.
        #[test]
        fn lines_are_never_torn(widths in proptest::collection::vec(0_usize..9, 1..8)) {
            let mut outbox = Outbox::new(Narrow { widths, call: 0, taken: Vec::new() });
            let mut accepted = Vec::new();
            for number in 0..40 {
                let line = format!("line {number}\r");
                if outbox.send(line.as_bytes()).unwrap() == Taken::Whole {
                    accepted.extend_from_slice(line.as_bytes());
                }
            }
            let mut arrived = outbox.stream.taken.clone();
            arrived.extend_from_slice(&outbox.rest);
            prop_assert_eq!(arrived, accepted);
        }
    }
}
