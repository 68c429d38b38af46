//! Messages of a recording in the order and at the pace of their log times.

use crate::{
    recording::{Channel, MessageIndex, Recording},
    units::Nanos,
};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

/// Longest sleep, after which the stop flag is read again.
const PATIENCE: Duration = Duration::from_millis(20);

/// One message of a recording.
#[derive(Debug, Clone, Copy)]
pub struct Played<'a> {
    /// Its channel.
    pub channel: &'a Channel,
    /// Its time stamps.
    pub index: &'a MessageIndex,
    /// Its content.
    pub data: &'a [u8],
}

/// Messages of a recording by log time.
#[derive(Debug)]
pub struct Playback<'a> {
    messages: Vec<Played<'a>>,
}

impl<'a> Playback<'a> {
    /// Sort the messages of `recording` from `start_s` (s after its first message) on.
    #[must_use]
    pub fn new(recording: &'a Recording, start_s: f64) -> Self {
        let mut messages: Vec<Played<'_>> = recording
            .channels
            .iter()
            .flat_map(|channel| {
                channel.raw().map(move |(index, data)| Played { channel, index, data })
            })
            .collect();
        messages.sort_by_key(|message| message.index.log_time);
        if let Some(first) = messages.first().map(|message| message.index.log_time) {
            let start = first.after_seconds(start_s);
            messages.retain(|message| start <= message.index.log_time);
        }
        Self { messages }
    }

    /// Return all messages in order.
    #[must_use]
    pub fn messages(&self) -> &[Played<'a>] {
        &self.messages
    }

    /// Return the length (s); 0 without messages.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let ends = [self.messages.first(), self.messages.last()];
        let [Some(first), Some(last)] = ends else { return 0.0 };
        last.index.log_time.seconds_since(first.index.log_time)
    }

    /// Pass every message to `send` when its time has come, at `rate` times real time, until
    /// `stop`. Return the number of messages.
    pub fn run(&self, rate: f64, stop: &AtomicBool, mut send: impl FnMut(&Played<'a>)) -> usize {
        let Some(first) = self.messages.first().map(|message| message.index.log_time) else {
            return 0;
        };
        let origin = Instant::now();
        for (count, message) in self.messages.iter().enumerate() {
            let due = Duration::from_secs_f64(offset_s(first, message.index.log_time) / rate);
            loop {
                if stop.load(Ordering::Relaxed) {
                    return count;
                }
                let wait = due.saturating_sub(origin.elapsed());
                if wait.is_zero() {
                    break;
                }
                thread::sleep(wait.min(PATIENCE));
            }
            send(message);
        }
        self.messages.len()
    }
}

fn offset_s(first: Nanos, now: Nanos) -> f64 {
    now.seconds_since(first).max(0.0)
}
