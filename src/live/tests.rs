//! Tests with a WebSocket client on the loopback interface.

use super::*;
use crate::recording::message::VelocityCommand;
use std::{
    io::{Read, Write},
    net::TcpStream,
    time::Instant,
};
use tungstenite::{Error, Message as Frame, WebSocket, client::IntoClientRequest};

const PATIENCE: Duration = Duration::from_secs(20);

fn start() -> LiveServer {
    LiveServer::start(&"foxglove:0".parse().unwrap()).unwrap()
}

struct Viewer(WebSocket<TcpStream>);

impl Viewer {
    fn connect(server: &LiveServer, subprotocol: &str) -> Self {
        let address = server.address();
        let mut request = format!("ws://{address}").into_client_request().unwrap();
        request.headers_mut().insert("Sec-WebSocket-Protocol", subprotocol.parse().unwrap());
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, response) = tungstenite::client(request, stream).unwrap();
        assert_eq!(response.headers()["Sec-WebSocket-Protocol"], subprotocol);
        let mut viewer = Self(socket);
        assert_eq!(viewer.json()["op"], "serverInfo");
        viewer
    }

    fn json(&mut self) -> serde_json::Value {
        loop {
            if let Frame::Text(text) = self.0.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Advertised channels with their topics, until `topic` is among them.
    fn channel(&mut self, topic: &str) -> serde_json::Value {
        loop {
            let advertised = self.json();
            let channels = advertised["channels"].as_array().unwrap().clone();
            if let Some(own) = channels.into_iter().find(|channel| channel["topic"] == topic) {
                return own;
            }
        }
    }

    fn subscribe(&mut self, server: &LiveServer, id: u32, channel: &serde_json::Value) {
        let before = server.subscriptions();
        let entry = serde_json::json!({"id": id, "channelId": channel["id"]});
        let request = serde_json::json!({"op": "subscribe", "subscriptions": [entry]});
        self.0.send(Frame::text(request.to_string())).unwrap();
        until(|| before < server.subscriptions());
    }

    /// Subscription, time and content of the next message.
    fn message(&mut self) -> (u32, u64, Vec<u8>) {
        loop {
            if let Frame::Binary(bytes) = self.0.read().unwrap() {
                assert_eq!(bytes[0], 1);
                let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                let time = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                return (id, time, bytes[13..].to_vec());
            }
        }
    }

    fn is_closed(&mut self) -> bool {
        loop {
            match self.0.read() {
                Ok(Frame::Close(_)) | Err(Error::ConnectionClosed) => return true,
                Ok(_) => {}
                Err(_) => return false,
            }
        }
    }
}

fn until(holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < PATIENCE, "nothing happened");
        thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn viewers_get_what_they_have_subscribed_to_with_its_schema() {
    let server = start();
    let mut publisher = server.publisher();
    let command = |vx| VelocityCommand { vx, vy: -0.5 };
    publisher.publish_message("/left", Nanos(5), &command(0.25));
    publisher.publish_message("/right", Nanos(6), &command(0.25));
    for subprotocol in ["foxglove.sdk.v1", "foxglove.websocket.v1"] {
        let mut viewer = Viewer::connect(&server, subprotocol);
        let channel = viewer.channel("/right");
        assert_eq!(channel["schemaName"], "klasktron.VelocityCommand");
        assert_eq!([&channel["encoding"], &channel["schemaEncoding"]], ["protobuf"; 2]);
        let schema = data_encoding::BASE64.decode(channel["schema"].as_str().unwrap().as_bytes());
        assert!(schema.unwrap() == FILE_DESCRIPTOR_SET);
        viewer.subscribe(&server, 77, &channel);
        publisher.publish_message("/left", Nanos(7), &command(0.5));
        publisher.publish_message("/right", Nanos(8), &command(0.75));
        let (id, time, data) = viewer.message();
        assert_eq!((id, time), (77, 8));
        assert_eq!(VelocityCommand::decode(data.as_slice()).unwrap(), command(0.75));
        // A topic that comes later is advertised when it comes.
        let late = format!("/late/{subprotocol}");
        publisher.publish_message(&late, Nanos(9), &command(1.0));
        viewer.channel(&late);
    }
    until(|| server.subscriptions() == 0); // both have left
    assert_eq!(server.dropped(), 0);
}

#[test]
fn a_stalled_viewer_delays_neither_publisher_nor_other_viewers() {
    let server = start();
    let mut publisher = server.publisher();
    let schema = RawSchema {
        name: "Text",
        encoding: "",
        data: b"",
        message_encoding: "json",
        channel_metadata: &BTreeMap::new(),
    };
    publisher.advertise("/text", &schema);
    let [mut stalled, mut reader] = [(); 2].map(|()| Viewer::connect(&server, "foxglove.sdk.v1"));
    for viewer in [&mut stalled, &mut reader] {
        let channel = viewer.channel("/text");
        viewer.subscribe(&server, 1, &channel);
    }
    let received = thread::spawn(move || {
        let mut count = 0;
        while reader.message().1 != u64::MAX {
            count += 1;
        }
        count
    });
    // 40 MB: more than the buffers of the kernel and the queue hold.
    let data = vec![b'x'; 10_000];
    let mut longest = Duration::ZERO;
    for k in 0..4000 {
        let begun = Instant::now();
        publisher.publish("/text", &schema, Nanos(k), &data);
        longest = longest.max(begun.elapsed());
        thread::sleep(Duration::from_micros(200));
    }
    assert!(longest < Duration::from_millis(500), "{longest:?}");
    assert!(0 < server.dropped());
    // The reader's queue may be full for a moment, so the last message is repeated.
    while !received.is_finished() {
        publisher.publish("/text", &schema, Nanos(u64::MAX), b"end");
        thread::sleep(Duration::from_millis(5));
    }
    assert!(2000 < received.join().unwrap());
    let begun = Instant::now();
    drop(server);
    assert!(begun.elapsed() < Duration::from_secs(3), "{:?}", begun.elapsed());
    drop(stalled);
}

#[test]
fn nonsense_closes_its_own_connection_only() {
    let server = start();
    let mut publisher = server.publisher();
    publisher.publish_message("/left", Nanos(1), &VelocityCommand::default());
    let mut viewer = Viewer::connect(&server, "foxglove.sdk.v1");
    let channel = viewer.channel("/left");
    viewer.subscribe(&server, 1, &channel);
    for bytes in [
        &b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"[..],
        b"GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
          Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
        &[0xff; 4096],
    ] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(bytes).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).ok(); // ends, by a reset at worst
        assert!(!answer.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&answer));
    }
    for nonsense in [
        Frame::text("hello"),
        Frame::text(r#"{"no": "op"}"#),
        Frame::text(r#"{"op": "subscribe"}"#),
        Frame::text(r#"{"op": "subscribe", "subscriptions": [{"id": -1}]}"#),
        Frame::binary(vec![1, 2, 3]),
        Frame::text("x".repeat(1 << 20)),
    ] {
        let mut other = Viewer::connect(&server, "foxglove.websocket.v1");
        other.0.send(nonsense.clone()).ok();
        assert!(other.is_closed() || 1000 < nonsense.len(), "{nonsense:?}");
    }
    // Requests of the protocol that this server does not support are ignored.
    viewer.0.send(Frame::text(r#"{"op": "getParameters"}"#)).unwrap();
    publisher.publish_message("/left", Nanos(2), &VelocityCommand::default());
    assert_eq!(viewer.message().1, 2);
}

#[test]
fn a_port_in_use_and_a_foreign_address_are_one_sentence_each() {
    let server = start();
    let port = server.address().port();
    let second = LiveServer::start(&format!("foxglove:{port}").parse().unwrap());
    assert_eq!(
        second.unwrap_err().to_string(),
        format!(
            "the live view cannot listen on 127.0.0.1:{port}: another program uses port {port}; \
             end it, or give another port from 1 to 65535 with --live foxglove:PORT"
        )
    );
    let foreign = LiveServer::start(&"foxglove:192.0.2.1:1".parse().unwrap()).unwrap_err();
    let text = foreign.to_string();
    assert!(text.starts_with("the live view cannot listen on 192.0.2.1:1 ("), "{text}");
}
