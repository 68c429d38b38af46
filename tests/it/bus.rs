//! Buses over real devices: pseudo-terminals, TCP, sockets, and the kernel's CAN where there is one.
//!
//! A test that lacks what it needs prints a line beginning with `skipped:` and passes.

mod camera;
mod gateway;
mod peers;
mod serial;
#[cfg(target_os = "linux")]
mod vcan;

use klasktron::{
    can::{Direction, Frame, FrameKind, IdWidth, Payload},
    link::{LinkError, Received, Transport},
};
use std::{thread, time::Duration};

/// How long a test waits before it gives up.
const PATIENCE: Duration = Duration::from_secs(20);
const STEP: Duration = Duration::from_millis(50);

#[expect(clippy::print_stdout, reason = "a test that checks nothing says so")]
fn skipped(why: &str) {
    println!("skipped: {why}");
}

fn data_frame(id: u32, data: &[u8]) -> Frame {
    let data = Payload::new(data).unwrap();
    Frame { id, width: IdWidth::Standard, kind: FrameKind::Data, data }
}

/// The frame number `count` of a series.
fn numbered(count: u32) -> Frame {
    data_frame(count & 0x7FF, &u64::from(count).to_le_bytes())
}

fn remote_frame(id: u32) -> Frame {
    Frame { kind: FrameKind::Remote, ..data_frame(id, &[]) }
}

fn extended_frame(id: u32, data: &[u8]) -> Frame {
    Frame { width: IdWidth::Extended, ..data_frame(id, data) }
}

/// What arrives next, whatever the number of attempts.
fn next(bus: &dyn Transport) -> Received {
    for _ in 0..PATIENCE.as_millis() / STEP.as_millis() {
        match bus.receive(STEP).unwrap() {
            Received::Nothing => {}
            received => return received,
        }
    }
    panic!("nothing arrived within {PATIENCE:?}");
}

/// The frame that arrives next.
fn next_frame(bus: &dyn Transport) -> Frame {
    match next(bus) {
        Received::Frame { frame, direction: Direction::Received, .. } => frame,
        other => panic!("{other:?} instead of a frame"),
    }
}

/// Sends with patience while the queue is full; the number of attempts that found it full.
fn send_insisting(bus: &dyn Transport, frame: &Frame) -> u32 {
    for refusals in 0..20_000 {
        match bus.send(frame) {
            Ok(()) => return refusals,
            Err(LinkError::Full { .. }) => thread::sleep(Duration::from_millis(1)),
            Err(error) => panic!("{error}"),
        }
    }
    panic!("the queue stayed full");
}
