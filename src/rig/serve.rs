//! The rig as a separate process on a real bus, in real time.
//!
//! A loop on the monotonic clock: receive for at most a millisecond, step the world up to the
//! current time, send all frames that are ready. The bus is real, so the bus model and the faults
//! of the program's connection (`bus_off`, `link_down`) are not used; frames are dropped and
//! delayed as configured.

use super::{
    config::{ConfigError, RigConfig},
    drive::Outgoing,
    truth::{DriveTruth, Truth},
    world::World,
};
use crate::{
    can::{AxisErrors, AxisState, Frame},
    link::{LinkError, Received, Transport},
    seed::Stream,
    units::{NANOS_PER_SECOND, Nanos},
};
use std::{
    collections::VecDeque,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// Longest wait for a frame, and maximum delay of frames that are due.
const RECEIVE: Duration = Duration::from_micros(500);
/// Interval between two attempts to send into a full queue.
const RETRY: Duration = Duration::from_micros(100);
/// Number of attempts to send one frame: one millisecond.
const ATTEMPTS: usize = 10;
/// Maximum lag of the simulation that is caught up after a pause of the process (ns).
const MOST_BEHIND_NS: u64 = 200_000_000;

/// Interval at which the truth is shown (ns).
const SHOW_NS: u64 = 20_000_000;

/// Change of a drive's state or error flags.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveReport {
    /// Time since the rig's start (s).
    pub elapsed: f64,
    /// Node id.
    pub node: u8,
    /// State of the axis.
    pub state: AxisState,
    /// Error flags.
    pub errors: AxisErrors,
    /// True speed of the motor (turn/s).
    pub velocity_turns_per_s: f64,
}

/// Statistics of a rig on a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServeReport {
    /// Number of frames sent.
    pub sent: u64,
    /// Number of frames received.
    pub received: u64,
    /// Number of attempts that found the transmit queue full.
    pub retries: u64,
    /// Number of frames dropped because the queue stayed full for a millisecond.
    pub given_up: u64,
    /// Pauses of the process that were not caught up (ns).
    pub skipped_ns: u64,
}

/// Error of serving.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Error of the configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The bus.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// What a rig on a bus shows in addition to its frames.
#[derive(Debug, Clone, Copy)]
pub enum Shown<'a> {
    /// Datagram of the camera.
    Frame(&'a [u8]),
    /// Change of a drive.
    Drive(DriveReport),
    /// Ground truth, 50 times per second.
    Truth(&'a Truth),
}

/// Simulate the rig on `transport` in real time until `stop` is set or a log ends. Camera, drives
/// and truth go to `show`.
///
/// # Errors
/// When the configuration has a value outside its range, or the bus fails permanently.
pub fn serve(
    transport: &dyn Transport,
    config: RigConfig,
    stop: &AtomicBool,
    mut show: impl FnMut(Shown<'_>),
) -> Result<ServeReport, ServeError> {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let start = Nanos(since_epoch.as_nanos() as u64);
    let mut losses = Stream::new(config.seed, "rig.serve.losses");
    let mut world = World::new(config, start)?;
    let mut watch = Watch::new(&world);
    let mut outbox = VecDeque::new();
    let mut report = ServeReport::default();
    let mut shown_ns = 0;
    let origin = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        match transport.receive(RECEIVE)? {
            Received::Frame { frame, .. } => {
                report.received += 1;
                if !is_lost(&world, &mut losses) {
                    world.receive(&frame);
                }
            }
            Received::End => break,
            Received::Fault(_) | Received::Nothing => {}
        }
        let due_ns = origin.elapsed().as_nanos() as u64 - report.skipped_ns;
        report.skipped_ns += due_ns.saturating_sub(world.now_ns()).saturating_sub(MOST_BEHIND_NS);
        let due_ns = origin.elapsed().as_nanos() as u64 - report.skipped_ns;
        while world.now_ns() < due_ns {
            world.step();
            watch.look(&world, |report| show(Shown::Drive(report)));
            let late_ns = world.link_faults().delay_ns;
            world.drain_frames(|Outgoing { ready_ns, frame }| {
                outbox.push_back((ready_ns + late_ns, frame));
            });
            while let Some((_, datagram)) = world.next_datagram() {
                show(Shown::Frame(&datagram));
            }
        }
        if shown_ns <= world.now_ns() {
            shown_ns = world.now_ns() + SHOW_NS;
            show(Shown::Truth(&world.truth()));
        }
        while let Some((_, frame)) = outbox.pop_front_if(|(ready, _)| *ready <= due_ns) {
            if !is_lost(&world, &mut losses) {
                send(transport, &frame, &mut report)?;
            }
        }
    }
    Ok(report)
}

fn is_lost(world: &World, losses: &mut Stream) -> bool {
    let probability = world.link_faults().drop_probability;
    0.0 < probability && f64::from(losses.uniform_f32(0.0, 1.0)) < probability
}

/// Send one frame; a full queue is retried for a millisecond.
fn send(
    transport: &dyn Transport,
    frame: &Frame,
    report: &mut ServeReport,
) -> Result<(), LinkError> {
    for _ in 0..ATTEMPTS {
        match transport.send(frame) {
            Ok(()) => {
                report.sent += 1;
                return Ok(());
            }
            Err(LinkError::Full { .. }) => {
                report.retries += 1;
                thread::sleep(RETRY);
            }
            Err(other) => return Err(other),
        }
    }
    report.given_up += 1;
    Ok(())
}

/// Detects changes of the drives.
struct Watch {
    known: Vec<(AxisState, AxisErrors)>,
}

impl Watch {
    fn new(world: &World) -> Self {
        Self { known: world.drive_states().collect() }
    }

    fn look(&mut self, world: &World, mut on_change: impl FnMut(DriveReport)) {
        if world.drive_states().eq(self.known.iter().copied()) {
            return;
        }
        let truth = world.truth();
        for (drive, known) in truth.drives.iter().zip(&mut self.known) {
            let DriveTruth { node, state, errors, velocity_turns_per_s, .. } = *drive;
            if (state, errors) != *known {
                *known = (state, errors);
                let elapsed = world.now_ns() as f64 / NANOS_PER_SECOND as f64;
                let report = DriveReport { elapsed, node, state, errors, velocity_turns_per_s };
                on_change(report);
            }
        }
    }
}
