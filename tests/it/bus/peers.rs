//! The far ends that `scripts/check_bus_peers.py` talks to with python-can. Each test needs the
//! variable that the script sets, and passes over itself without it.

use super::{
    data_frame, extended_frame, gateway::Client, next_frame, remote_frame, send_insisting, skipped,
};
use klasktron::{
    can::{Frame, FrameKind},
    link::{Received, Slcan, Transport},
};
use std::{env, net::TcpListener, path::PathBuf, time::Duration};

/// Ends an exchange.
const LAST_ID: u32 = 0x7FF;
const FRAMES: u32 = 200;

fn told(variable: &str) -> Option<String> {
    let value = env::var(variable).ok();
    if value.is_none() {
        skipped("scripts/check_bus_peers.py runs this test");
    }
    value
}

/// What comes back of a frame: the same under the next id.
fn echo_of(frame: &Frame) -> Frame {
    Frame { id: frame.id + 1, ..*frame }
}

/// python-can plays the adapter and echoes; it acknowledges nothing.
#[test]
fn peer_slcan_host() {
    let Some(port) = told("KLASKTRON_PEER_SLCAN_HOST") else { return };
    let bus = Slcan::open(&PathBuf::from(port), 1_000_000).unwrap();
    for count in 0..FRAMES {
        let frame = match count % 4 {
            0 => remote_frame(count),
            1 => extended_frame(0x1000_0000 + count, &count.to_le_bytes()),
            2 => data_frame(count, &[]),
            _ => data_frame(count, &[0xA5; 8]),
        };
        send_insisting(&bus, &frame);
        assert_eq!(next_frame(&bus), echo_of(&frame));
    }
    send_insisting(&bus, &data_frame(LAST_ID, &[]));
}

/// python-can is the host of this device, which echoes.
#[test]
fn peer_slcan_device() {
    let Some(port) = told("KLASKTRON_PEER_SLCAN_DEVICE") else { return };
    let bus = Slcan::serve(&PathBuf::from(port)).unwrap();
    println!("serving");
    loop {
        match bus.receive(Duration::from_secs(1)).unwrap() {
            Received::Frame { frame, .. } if frame.id == LAST_ID => return,
            Received::Frame { frame, .. } => {
                send_insisting(&bus, &echo_of(&frame));
            }
            Received::Nothing => {}
            other => panic!("{other:?}"),
        }
    }
}

/// python-can is a client of the server that the tests use, which echoes: so it stands for the real
/// one.
#[test]
fn peer_socketcand_server() {
    let Some(port) = told("KLASKTRON_PEER_SOCKETCAND") else { return };
    let listener = TcpListener::bind(format!("127.0.0.1:{port}")).unwrap();
    println!("serving");
    let mut client = Client::accept(&listener);
    while let Some(message) = client.hear() {
        let words: Vec<&str> = message.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["<", "open", _, ">"] | ["<", "rawmode", ">"] => client.say("< ok >"),
            ["<", "send", id, length, data @ .., ">"] => {
                let number = u32::from_str_radix(id, 16).unwrap();
                let bytes: Vec<u8> =
                    data.iter().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
                assert_eq!(bytes.len(), usize::from_str_radix(length, 16).unwrap());
                if number == LAST_ID {
                    return;
                }
                let frame = echo_of(&data_frame(number, &bytes));
                assert_eq!(frame.kind, FrameKind::Data);
                let digits: String =
                    frame.data.as_slice().iter().map(|byte| format!("{byte:02X}")).collect();
                let width = if id.len() == 8 { 8 } else { 3 };
                client.say(&format!("< frame {:0width$X} 1795218329.532654 {digits} >", frame.id));
            }
            _ => panic!("{message}"),
        }
    }
}
