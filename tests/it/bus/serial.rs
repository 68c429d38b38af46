//! Both roles of slcan against each other over a pair of pseudo-terminals.

use super::{
    data_frame, extended_frame, next, next_frame, numbered, remote_frame, send_insisting, skipped,
};
use klasktron::link::{BusFault, LinkError, Received, Slcan, Transport};
use std::{
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

const FRAMES: u32 = 2000;

/// Two pseudo-terminals of which each is the other end of the other.
pub(super) struct Line {
    socat: Child,
    _folder: tempfile::TempDir,
    pub(super) ends: [PathBuf; 2],
}

impl Line {
    /// `None` where there is no socat.
    pub(super) fn new() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let ends = ["a", "b"].map(|name| folder.path().join(name));
        let pty = |end: &Path| format!("pty,raw,echo=0,link={}", end.display());
        let socat = Command::new("socat")
            .args([pty(&ends[0]), pty(&ends[1])])
            .stderr(Stdio::null())
            .spawn();
        let Ok(socat) = socat else {
            skipped("socat is not installed");
            return None;
        };
        let line = Self { socat, _folder: folder, ends };
        for _ in 0..1000 {
            if line.ends.iter().all(|end| end.exists()) {
                return Some(line);
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("socat makes no pseudo-terminals");
    }

    fn cut(&mut self) {
        self.socat.kill().unwrap();
        self.socat.wait().unwrap();
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.socat.kill().ok();
        self.socat.wait().ok();
    }
}

/// A device, and a host that has opened its channel. Serves until then.
fn opened(line: &Line) -> (Slcan, Slcan) {
    let device = Slcan::serve(&line.ends[1]).unwrap();
    let host = thread::scope(|scope| {
        let host = scope.spawn(|| Slcan::open(&line.ends[0], 1_000_000).unwrap());
        while !host.is_finished() {
            assert_eq!(device.receive(Duration::from_millis(5)).unwrap(), Received::Nothing);
        }
        host.join().unwrap()
    });
    (device, host)
}

fn receive_series(bus: &dyn Transport) {
    for count in 0..FRAMES {
        assert_eq!(next_frame(bus), numbered(count));
    }
}

fn send_series(bus: &dyn Transport) {
    for count in 0..FRAMES {
        send_insisting(bus, &numbered(count));
    }
}

#[test]
fn slcan_loses_nothing_in_either_direction() {
    let Some(line) = Line::new() else { return };
    let (device, host) = opened(&line);
    thread::scope(|scope| {
        scope.spawn(|| receive_series(&host));
        scope.spawn(|| receive_series(&device));
        scope.spawn(|| send_series(&host));
        scope.spawn(|| send_series(&device));
    });
    for frame in [remote_frame(0x37), extended_frame(0x1234_5678, &[1, 2]), data_frame(0, &[])] {
        send_insisting(&host, &frame);
        assert_eq!(next_frame(&device), frame);
        send_insisting(&device, &frame);
        assert_eq!(next_frame(&host), frame);
    }
}

#[test]
fn slcan_channel_closes_with_its_host() {
    let Some(line) = Line::new() else { return };
    let (device, host) = opened(&line);
    // The other end stays open, so that the line itself lives on.
    let tap = std::fs::File::open(&line.ends[0]).unwrap();
    drop(host);
    assert_eq!(device.receive(Duration::from_millis(200)).unwrap(), Received::Nothing);
    // Closed: what is on the bus is dropped, however much of it there is.
    for count in 0..FRAMES {
        device.send(&numbered(count)).unwrap();
    }
    drop(tap);
}

#[test]
fn slcan_tells_faults_of_an_adapter_and_of_its_cable() {
    let Some(mut line) = Line::new() else { return };
    let mut adapter = std::fs::OpenOptions::new().write(true).open(&line.ends[1]).unwrap();
    // This adapter acknowledges nothing, as python-can does not.
    let host = Slcan::open(&line.ends[0], 250_000).unwrap();
    adapter.write_all(b"z\rgarbage\rsb000256\rt0290\x07e1a\rt029\rt0290\r").unwrap();
    assert_eq!(next(&host), Received::Fault(BusFault::BusOff));
    assert_eq!(next(&host), Received::Fault(BusFault::Overrun { frames: 1 }));
    assert_eq!(next(&host), Received::Fault(BusFault::NoAcknowledge));
    assert_eq!(next_frame(&host), data_frame(0x29, &[]));
    line.cut();
    assert_eq!(next(&host), Received::Fault(BusFault::LinkDown));
    let gone = host.receive(Duration::from_millis(1)).unwrap_err().to_string();
    assert!(
        gone.ends_with(": the adapter was disconnected; plug it in again and start anew"),
        "{gone}"
    );
    assert!(matches!(host.send(&data_frame(0x29, &[])), Err(LinkError::Unusable { .. })));
}

#[test]
fn slcan_refused_by_its_adapter_says_so() {
    let Some(line) = Line::new() else { return };
    let end = &line.ends[1];
    let mut adapter = std::fs::OpenOptions::new().read(true).write(true).open(end).unwrap();
    // Left behind for an earlier program: no answer to this one.
    adapter.write_all(b"\r\r\rt0290\r").unwrap();
    thread::sleep(Duration::from_millis(100));
    let refused = thread::scope(|scope| {
        let refused = scope.spawn(|| Slcan::open(&line.ends[0], 250_000).unwrap_err().to_string());
        for (command, answer) in [(b"C\r".to_vec(), b"\x07"), (b"S5\r".to_vec(), b"\x07")] {
            let mut heard = vec![0; command.len()];
            adapter.read_exact(&mut heard).unwrap();
            assert_eq!(heard, command);
            adapter.write_all(answer).unwrap();
        }
        refused.join().unwrap()
    });
    assert!(refused.contains("the adapter refuses 250000 bit/s; unplug it"), "{refused}");
}
