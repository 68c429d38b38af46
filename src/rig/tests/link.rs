//! Tests of the link: bus model, determinism, clocks, and the rig on a transport.

use super::support::{Host, START};
use crate::{
    can::{Frame, Message, encode},
    link::{Capabilities, Event, Link, LinkError, Received, Transport},
    rig::{RigConfig, Shown, Speed, VirtualLink, serve},
    units::Nanos,
};
use std::{
    collections::VecDeque,
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// All output of a second of driving, as text.
fn record(config: &str) -> String {
    let config = RigConfig::from_json(config).unwrap();
    let mut link = VirtualLink::new(config, Speed::Maximum, START).unwrap();
    let mut text = String::new();
    for tick in 0..50 {
        for node in 0..4 {
            link.send(&encode(node, &Message::SetAxisState { state: 8 })).unwrap();
            let turns = (f64::from(tick) * 0.3).sin() as f32 * 5.0;
            let message =
                Message::SetInputVel { velocity_turns_per_s: turns, torque_newton_metres: 0.0 };
            link.send(&encode(node, &message)).unwrap();
        }
        let until = link.now().after_seconds(0.02);
        while let Some(event) = link.next_event(until).unwrap() {
            text.push_str(&format!("{event:?}\n"));
        }
    }
    text + &format!("{:?}", link.truth())
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let config = r#"{"seed": 3, "ball": {"launch_every_s": 0.2},
                     "faults": [{"at_s": 0.4, "kind": "frames_dropped", "probability": 0.1}]}"#;
    let first = record(config);
    assert!(50_000 < first.len());
    assert!(first == record(config));
    assert!(first != record(&config.replace("\"seed\": 3", "\"seed\": 4")));
}

#[test]
fn frames_come_in_order_and_no_closer_than_the_bus_allows() {
    let mut link = VirtualLink::new(RigConfig::default(), Speed::Maximum, START).unwrap();
    let mut last = START;
    let mut count = 0;
    while let Some(event) = link.next_event(START.after_seconds(1.0)).unwrap() {
        if let Event::Frame { received_at, stamped_at, .. } = event {
            assert_eq!(stamped_at, Some(received_at));
            // 111 bits at 250 kbit/s.
            assert!(count == 0 || 444e-6 <= received_at.seconds_since(last) + 1e-9);
            assert_eq!(link.now(), received_at);
            last = received_at;
            count += 1;
        }
    }
    assert!((430..=442).contains(&count), "{count}");
    assert_eq!(link.now(), START.after_seconds(1.0));
}

#[test]
fn an_overloaded_bus_thins_out_high_ids() {
    let text = r#"{"drive": {"cyclic_ms": {"encoder": 1, "torques": 1}}}"#;
    let mut host = Host::from_json(text);
    host.wait(1.0);
    // 1 s of 250 kbit/s carries 2252 frames of 111 bits.
    assert!((2200..=2253).contains(&host.messages.len()), "{}", host.messages.len());
    let of = |node: u8| host.messages.iter().filter(|(_, d)| d.node == node).count();
    assert!(1600 < of(0) && of(3) < 50, "{} {}", of(0), of(3));
    assert!(1000 < host.link.replaced_frames());
}

#[test]
fn the_transmit_queue_is_bounded() {
    let mut host = Host::from_json("{}");
    let frame = encode(0, &Message::Estop);
    for _ in 0..10 {
        host.link.send(&frame).unwrap();
    }
    assert!(matches!(host.link.send(&frame), Err(LinkError::Full { .. })));
    host.wait(0.01);
    host.link.send(&frame).unwrap();
}

#[test]
fn real_time_follows_the_clock() {
    let config = RigConfig::default();
    let begin = Instant::now();
    let mut link = VirtualLink::new(config, Speed::RealTime, START).unwrap();
    let until = START.after_seconds(0.15);
    let mut events = 0;
    while link.next_event(until).unwrap().is_some() {
        events += 1;
    }
    let elapsed = begin.elapsed().as_secs_f64();
    assert!(0.15 <= elapsed, "{elapsed}");
    assert!(50 < events && until <= link.now());
}

/// A bus in memory whose queue is full at every third attempt.
#[derive(Default)]
struct Wire {
    to_rig: Mutex<VecDeque<Frame>>,
    from_rig: Mutex<Vec<Frame>>,
    attempts: Mutex<u32>,
}

impl Transport for Wire {
    fn send(&self, frame: &Frame) -> Result<(), LinkError> {
        let mut attempts = self.attempts.lock().unwrap();
        *attempts += 1;
        if attempts.is_multiple_of(3) {
            return Err(LinkError::Full { bus: "wire".to_owned() });
        }
        self.from_rig.lock().unwrap().push(*frame);
        Ok(())
    }

    fn receive(&self, timeout: Duration) -> Result<Received, LinkError> {
        if let Some(frame) = self.to_rig.lock().unwrap().pop_front() {
            let direction = crate::can::Direction::Received;
            return Ok(Received::Frame { frame, stamped_at: None, direction });
        }
        std::thread::sleep(timeout);
        Ok(Received::Nothing)
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { remote_frames: true, error_frames: false, sending: true }
    }
}

#[test]
fn the_rig_serves_a_transport() {
    let wire = Wire::default();
    for message in [Message::ClearErrors { identify: 0 }, Message::SetAxisState { state: 8 }] {
        wire.to_rig.lock().unwrap().push_back(encode(1, &message));
    }
    let stop = AtomicBool::new(false);
    let mut changes = Vec::new();
    let mut datagrams = 0;
    let mut shown = 0;
    let begin = Instant::now();
    let report = serve(&wire, RigConfig::default(), &stop, |own| match own {
        Shown::Frame(bytes) => {
            assert!(bytes.starts_with(b"{\"capture_time_ns\":"));
            datagrams += 1;
            stop.store(1.0 < begin.elapsed().as_secs_f64(), Ordering::Relaxed);
        }
        Shown::Drive(change) => changes.push(change),
        Shown::Truth(_) => shown += 1,
    })
    .unwrap();
    // It armed and, without frames, its watchdog expired 0.2 s after the request.
    let seen: Vec<(u8, u8, u32)> =
        changes.iter().map(|c| (c.node, c.state.number(), c.errors.0)).collect();
    assert_eq!(seen, [(1, 8, 0), (1, 1, 0x100_0000)]);
    assert!((changes[1].elapsed - 0.2).abs() < 0.1, "{changes:?}");
    assert_eq!((report.received, report.given_up), (2, 0));
    assert!(0 < report.retries && 50 < datagrams);
    assert!((20..=60).contains(&shown), "{shown} in about a second");
    assert_eq!(report.sent, wire.from_rig.lock().unwrap().len() as u64);
    assert!(300 < report.sent, "{report:?}");
}

#[test]
fn the_clock_of_a_new_link_stands_at_its_start() {
    let link = VirtualLink::new(RigConfig::default(), Speed::Maximum, Nanos(42)).unwrap();
    assert_eq!(link.now(), Nanos(42));
    assert!(link.capabilities().remote_frames);
}
