//! SocketCAN against the kernel's own CAN: `vcan0`, and `slcan0` where `scripts/check_can` made one.
//!
//! `scripts/can_lab` runs these on a machine whose kernel has no CAN. They share one interface, so
//! they take turns.

use super::{
    data_frame, extended_frame, next, next_frame, numbered, remote_frame, send_insisting, skipped,
};
use klasktron::{
    can::Direction,
    link::{BusFault, Event, IdFilter, Link, LinkError, LiveLink, Received, SocketCan, Transport},
};
use std::{
    env,
    fs::{File, OpenOptions},
    io::{Read, Write},
    path::Path,
    process::Command,
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    thread,
    time::Duration,
};

static TURN: Mutex<()> = Mutex::new(());

/// A turn on `vcan0`; `None` where there is none.
fn turn() -> Option<MutexGuard<'static, ()>> {
    if !Path::new("/sys/class/net/vcan0").exists() {
        assert!(env::var_os("KLASKTRON_CAN_LAB").is_none(), "the lab has no vcan0");
        skipped("there is no vcan0 (scripts/check_can makes one)");
        return None;
    }
    Some(TURN.lock().unwrap_or_else(PoisonError::into_inner))
}

fn vcan0() -> SocketCan {
    SocketCan::open("vcan0", &[]).unwrap()
}

fn run(command: &str) {
    let mut words = command.split(' ');
    let status = Command::new(words.next().unwrap()).args(words).status().unwrap();
    assert!(status.success(), "{command}: {status}");
}

fn silent(bus: &SocketCan) -> bool {
    bus.receive(Duration::from_millis(30)).unwrap() == Received::Nothing
}

#[test]
fn vcan_two_sockets_exchange_frames_with_kernel_times() {
    let Some(_turn) = turn() else { return };
    let (a, b) = (vcan0(), vcan0());
    for frame in [
        data_frame(0x29, &[0, 0, 0, 0x40, 0, 0, 0xC0, 0x3F]),
        data_frame(0x7FF, &[]),
        remote_frame(0x37),
        extended_frame(0x1FFF_FFFF, &[1, 2, 3]),
    ] {
        a.send(&frame).unwrap();
        match next(&b) {
            Received::Frame { frame: arrived, stamped_at, direction: Direction::Received } => {
                assert_eq!(arrived, frame);
                let year_2020 = 1_577_836_800_000_000_000;
                assert!(year_2020 < stamped_at.unwrap().0);
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(silent(&a), "own frames do not come back");
}

#[test]
fn vcan_filter_of_the_kernel() {
    let Some(_turn) = turn() else { return };
    let a = vcan0();
    // Node 1 alone, of 11 bits: bit 31 tells 29-bit ids apart.
    let filter = IdFilter { id: 1 << 5, mask: 0x8000_07E0 };
    let b = SocketCan::open("vcan0", &[filter]).unwrap();
    for id in [0x009, 0x029, 0x049, 0x03F] {
        a.send(&data_frame(id, &[1])).unwrap();
    }
    a.send(&extended_frame(0x029, &[1])).unwrap();
    assert_eq!([next_frame(&b).id, next_frame(&b).id], [0x029, 0x03F]);
    assert!(silent(&b));
    run("cansend vcan0 20000040#0000000000000000");
    assert_eq!(next(&b), Received::Fault(BusFault::BusOff), "error frames pass every filter");
}

#[test]
fn vcan_error_frames_become_faults() {
    let Some(_turn) = turn() else { return };
    let bus = vcan0();
    for (frame, faults) in [
        ("20000040#0000000000000000", vec![BusFault::BusOff]),
        ("20000100#0000000000000000", vec![BusFault::Restarted]),
        ("200000A8#0000000000000000", vec![BusFault::NoAcknowledge]),
        ("20000204#0020000000000080", vec![BusFault::ErrorPassive]),
        ("20000204#0004000000000060", vec![BusFault::ErrorWarning]),
        ("20000204#0040000000000000", vec![BusFault::ErrorActive]),
        ("20000088#0000000000000000", vec![BusFault::Protocol]),
        ("20000004#0001000000000000", vec![BusFault::Overrun { frames: 0 }]),
        ("20000044#0030000000000000", vec![BusFault::BusOff, BusFault::ErrorPassive]),
    ] {
        run(&format!("cansend vcan0 {frame}"));
        for fault in faults {
            assert_eq!(next(&bus), Received::Fault(fault), "{frame}");
        }
    }
    assert!(silent(&bus));
}

#[test]
fn vcan_down_is_told_and_up_works_again() {
    let Some(_turn) = turn() else { return };
    let (a, b) = (vcan0(), vcan0());
    run("ip link set vcan0 down");
    let down = a.send(&data_frame(0x29, &[]));
    let received = next(&b);
    let opened = SocketCan::open("vcan0", &[]);
    run("ip link set vcan0 up");
    assert!(matches!(down, Err(LinkError::Down { .. })), "{down:?}");
    assert_eq!(received, Received::Fault(BusFault::LinkDown));
    assert_eq!(
        opened.unwrap_err().to_string(),
        "socketcan:vcan0 is down; bring it up with: sudo ip link set vcan0 up type can bitrate \
         250000"
    );
    a.send(&data_frame(0x2A, &[])).unwrap();
    assert_eq!(next_frame(&b).id, 0x2A);
}

#[test]
fn vcan_frames_dropped_by_the_kernel_are_counted() {
    let Some(_turn) = turn() else { return };
    let (a, b) = (vcan0(), vcan0());
    // More than the largest receive buffer holds.
    let sent = 40_000_u32;
    for count in 0..sent {
        send_insisting(&a, &numbered(count));
    }
    let (mut arrived, mut lost) = (0, 0);
    loop {
        match b.receive(Duration::from_millis(200)).unwrap() {
            Received::Frame { .. } => arrived += 1,
            Received::Fault(BusFault::Overrun { frames }) => lost += frames,
            Received::Nothing => break,
            other => panic!("{other:?}"),
        }
    }
    println!("{arrived} frames arrived, {lost} were dropped and counted");
    assert_eq!(arrived + lost, sent);
    assert!(0 < lost, "the receive buffer holds everything: send more");
}

#[test]
fn vcan_live_link_delivers_in_order_of_time() {
    let Some(_turn) = turn() else { return };
    let peer = vcan0();
    let mut link = LiveLink::start(Arc::new(vcan0()), None).unwrap();
    link.send(&data_frame(0x2D, &[7])).unwrap();
    assert_eq!(next_frame(&peer), data_frame(0x2D, &[7]));
    for count in 0..500 {
        peer.send(&numbered(count)).unwrap();
    }
    let soon = link.now().after_seconds(10.0);
    let mut last = link.now().after_seconds(-10.0);
    for count in 0..500 {
        match link.next_event(soon).unwrap() {
            Some(Event::Frame { received_at, frame, .. }) => {
                assert_eq!(frame, numbered(count));
                assert!(last <= received_at);
                last = received_at;
            }
            other => panic!("{other:?}"),
        }
    }
}

/// The adapter's end of `slcan0`, which `scripts/check_can` makes.
fn slcan0() -> Option<(SocketCan, String)> {
    let Ok(tty) = env::var("KLASKTRON_SLCAN0_TTY") else {
        skipped("there is no slcan0 (scripts/check_can makes one)");
        return None;
    };
    Some((SocketCan::open("slcan0", &[]).unwrap(), tty))
}

#[test]
fn vcan_slcan_status_lines_become_faults_in_the_kernel_and_here() {
    let Some(_turn) = turn() else { return };
    let Some((bus, tty)) = slcan0() else { return };
    let mut adapter = OpenOptions::new().write(true).open(tty).unwrap();
    for (line, fault) in [
        ("sw096000", BusFault::ErrorWarning),
        ("sp128000", BusFault::ErrorPassive),
        ("sb000256", BusFault::BusOff),
        ("sa000000", BusFault::ErrorActive),
        ("e1a", BusFault::NoAcknowledge),
        ("e3bcf", BusFault::Protocol),
        ("e1o", BusFault::Overrun { frames: 0 }),
        ("e1O", BusFault::Overrun { frames: 0 }),
    ] {
        adapter.write_all(format!("z\rnoise\rt0298\r{line}\r").as_bytes()).unwrap();
        assert_eq!(next(&bus), Received::Fault(fault), "{line}");
    }
    adapter.write_all(b"t0298000000000000E0BF\r").unwrap();
    assert_eq!(next_frame(&bus), data_frame(0x29, &[0, 0, 0, 0, 0, 0, 0xE0, 0xBF]));
}

#[test]
fn vcan_slcan_full_queue_is_told_and_patience_loses_nothing() {
    let Some(_turn) = turn() else { return };
    let Some((bus, tty)) = slcan0() else { return };
    let (all, arrived) = mpsc::channel();
    let mut adapter = File::open(tty).unwrap();
    thread::spawn(move || {
        let mut bytes = [0; 64];
        loop {
            let count = adapter.read(&mut bytes).unwrap();
            all.send(bytes[..count].to_vec()).unwrap();
            thread::sleep(Duration::from_millis(1));
        }
    });
    let frames = 1000;
    let refusals: u32 = (0..frames).map(|count| send_insisting(&bus, &numbered(count))).sum();
    let mut text = Vec::new();
    let count = |text: &[u8]| text.iter().filter(|byte| **byte == b't').count();
    while count(&text) < frames as usize || text.last() != Some(&b'\r') {
        text.extend(arrived.recv_timeout(super::PATIENCE).unwrap());
    }
    println!("{frames} frames arrived after {refusals} refusals of a full queue");
    assert!(0 < refusals, "the queue never filled");
}
