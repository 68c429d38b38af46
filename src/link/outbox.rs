//! Whole lines into a byte stream that may take only a part of one.
//!
//! A line of which nothing was taken is refused and forgotten, so that no frame waits here. A line of
//! which a part is on its way is finished before anything else, or the other end would read a torn
//! one.

use std::io::{self, ErrorKind, Write};

/// What became of a line.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// It is on its way.
    Whole,
    /// Nothing of it was sent.
    Nothing,
}

/// A stream and the rest of the line that it has not taken yet. The stream's own write time-out says
/// how long it may be waited for.
#[derive(Debug)]
pub(super) struct Outbox<W> {
    stream: W,
    rest: Vec<u8>,
}

impl<W: Write> Outbox<W> {
    pub(super) fn new(stream: W) -> Self {
        Self { stream, rest: Vec::new() }
    }

    /// Sends `line` now or not at all.
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

/// Writes until all is taken or the stream takes nothing more within its time-out; the number of
/// bytes taken.
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

    /// Takes so many bytes at each call, nothing at a 0.
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

        /// However little the stream takes: what arrives is the accepted lines, each whole.
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
