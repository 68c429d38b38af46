//! The socketcand client against a small server of the same protocol.

use super::{data_frame, extended_frame, next, next_frame, remote_frame};
use klasktron::{
    link::{BusFault, LinkError, Received, Socketcand, Transport},
    units::Nanos,
};
use std::{
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    thread,
    time::Duration,
};

/// One client of the server: what it says comes out message by message.
pub(super) struct Client {
    stream: TcpStream,
    text: String,
}

impl Client {
    pub(super) fn accept(listener: &TcpListener) -> Self {
        let (stream, _address) = listener.accept().unwrap();
        stream.set_nodelay(true).unwrap();
        let mut client = Self { stream, text: String::new() };
        client.say("< hi >");
        client
    }

    pub(super) fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    /// The next message; `None` when the client has gone.
    pub(super) fn hear(&mut self) -> Option<String> {
        loop {
            if let Some(end) = self.text.find('>') {
                let message = self.text[..=end].trim().to_owned();
                self.text.drain(..=end);
                return Some(message);
            }
            let mut bytes = [0; 1024];
            let count = self.stream.read(&mut bytes).unwrap_or(0);
            if count == 0 {
                return None;
            }
            self.text.push_str(std::str::from_utf8(&bytes[..count]).unwrap());
        }
    }

    fn expect(&mut self, message: &str) {
        assert_eq!(self.hear().as_deref(), Some(message));
    }

    /// Greets as the real server does: its `ok` to raw mode comes before it listens to the bus.
    fn greet(&mut self) {
        self.expect("< open can0 >");
        self.say("< ok >");
        self.expect("< rawmode >");
        self.say("< ok >");
        thread::sleep(Duration::from_millis(20));
        self.expect("< echo >");
        self.say("< echo >");
    }
}

/// A server that does `serve` with its first client, and its address.
fn server(serve: impl FnOnce(&mut Client) + Send + 'static) -> (String, thread::JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    (address, thread::spawn(move || serve(&mut Client::accept(&listener))))
}

#[test]
fn socketcand_sends_and_receives_until_the_server_goes() {
    let (address, serving) = server(|client| {
        client.greet();
        client.expect("< send 2D 8 0 0 20 40 0 0 0 0 >");
        client.expect("< send 1FFFFFFF 0 >");
        client.say("< frame 029 1795218329.532654 0000C03F000080BE >< fra");
        thread::sleep(Duration::from_millis(20));
        client.say("me 0000002D 1.5  >< error 040 1795218329.6 >");
    });
    let bus = Socketcand::open(&address, "can0").unwrap();
    assert!(!bus.capabilities().remote_frames);
    assert!(matches!(bus.send(&remote_frame(0x37)), Err(LinkError::Unusable { .. })));
    bus.send(&data_frame(0x2D, &[0, 0, 0x20, 0x40, 0, 0, 0, 0])).unwrap();
    bus.send(&extended_frame(0x1FFF_FFFF, &[])).unwrap();
    match next(&bus) {
        Received::Frame { frame, stamped_at, .. } => {
            assert_eq!(frame, data_frame(0x29, &[0, 0, 0xC0, 0x3F, 0, 0, 0x80, 0xBE]));
            assert_eq!(stamped_at, Some(Nanos(1_795_218_329_532_654_000)));
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(next_frame(&bus), extended_frame(0x2D, &[]));
    assert_eq!(next(&bus), Received::Fault(BusFault::BusOff));
    serving.join().unwrap();
    assert_eq!(next(&bus), Received::Fault(BusFault::LinkDown));
    let gone = bus.receive(Duration::from_millis(1)).unwrap_err().to_string();
    assert!(gone.contains(": the gateway was disconnected; check whether it runs"), "{gone}");
}

#[test]
fn socketcand_without_server_or_interface_says_so() {
    let (address, serving) = server(|client| {
        client.expect("< open can9 >");
        client.say("< error could not open bus >");
    });
    let refused = Socketcand::open(&address, "can9").unwrap_err().to_string();
    assert!(refused.contains("the server refuses: could not open bus; check"), "{refused}");
    serving.join().unwrap();
    let nobody = Socketcand::open(&address, "can0").unwrap_err().to_string();
    assert!(nobody.contains(&format!("no answer from {address} (")), "{nobody}");
    assert!(nobody.ends_with("; start it there, for example: socketcand -i can0"), "{nobody}");
}
