//! CAN bus model: one frame at a time, the lowest id first, with the duration of its bits.
//!
//! A frame of `n` data bytes takes `overhead + 8 n` bits, nominally 111 with eight bytes (stuff
//! bits are neglected). Of the frames that are ready when the bus becomes free the lowest id wins,
//! a data frame before a remote one. A drive holds one frame per id: while it waits for the bus,
//! the next one of that id replaces it. An overloaded bus therefore drops messages with high ids.
//! The host's frames leave in the order of sending, as from one queue.

use super::config::BusConfig;
use crate::can::{Frame, FrameKind};

/// Sender of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sender {
    /// The program.
    Host,
    /// A drive, or another controller.
    Rig,
}

#[derive(Debug, Clone, Copy)]
struct Waiting {
    ready_ns: u64,
    frame: Frame,
    sender: Sender,
}

/// State of the bus.
#[derive(Debug, Clone)]
pub(super) struct Bus {
    bit_ns: f64,
    overhead_bits: f64,
    free_ns: u64,
    waiting: Vec<Waiting>,
    /// Number of frames of drives that were replaced before they were sent.
    pub(super) replaced: u64,
}

impl Bus {
    pub(super) fn new(config: &BusConfig) -> Self {
        Self {
            bit_ns: 1e9 / f64::from(config.bitrate),
            overhead_bits: config.overhead_bits,
            free_ns: 0,
            waiting: Vec::with_capacity(64),
            replaced: 0,
        }
    }

    /// Queue a frame that is ready at `ready_ns`.
    pub(super) fn offer(&mut self, frame: Frame, ready_ns: u64, sender: Sender) {
        if sender == Sender::Rig
            && let Some(older) =
                self.waiting.iter_mut().find(|w| w.sender == sender && w.frame.id == frame.id)
        {
            older.frame = frame;
            self.replaced += 1;
            return;
        }
        self.waiting.push(Waiting { ready_ns, frame, sender });
    }

    /// Number of frames of the host in the queue.
    pub(super) fn queued_by_host(&self) -> usize {
        self.waiting.iter().filter(|waiting| waiting.sender == Sender::Host).count()
    }

    /// Drop the queued frames of the host.
    pub(super) fn flush_host(&mut self) {
        self.waiting.retain(|waiting| waiting.sender != Sender::Host);
    }

    /// The next frame that was sent by `until_ns`, with the time of its last bit.
    pub(super) fn next_sent(&mut self, until_ns: u64) -> Option<(u64, Frame, Sender)> {
        let earliest = self.waiting.iter().map(|waiting| waiting.ready_ns).min()?;
        let begin = earliest.max(self.free_ns);
        let first_of_host = self.waiting.iter().position(|w| w.sender == Sender::Host);
        let competes = |idx: usize, waiting: &Waiting| {
            waiting.ready_ns <= begin
                && (waiting.sender == Sender::Rig || first_of_host == Some(idx))
        };
        let rank = |waiting: &Waiting| {
            (waiting.frame.id, waiting.frame.kind == FrameKind::Remote, waiting.ready_ns)
        };
        let (idx, winner) = self
            .waiting
            .iter()
            .enumerate()
            .filter(|(idx, waiting)| competes(*idx, waiting))
            .min_by_key(|(_, waiting)| rank(waiting))?;
        let bits = self.overhead_bits + 8.0 * winner.frame.data.as_slice().len() as f64;
        let end = begin + (bits * self.bit_ns).round() as u64;
        if until_ns < end {
            return None;
        }
        let Waiting { frame, sender, .. } = self.waiting.remove(idx);
        self.free_ns = end;
        Some((end, frame, sender))
    }
}
