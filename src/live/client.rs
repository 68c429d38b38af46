//! One viewer: handshake, requests, and messages to it.

use super::{
    Counters,
    hub::{CLIENT_QUEUE_LENGTH, Job, Outgoing, ToClient},
};
use serde_json::{Value, json};
use socket2::SockRef;
use std::{
    collections::BTreeMap,
    io::{self, ErrorKind},
    net::TcpStream,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel},
    },
    thread,
    time::Duration,
};
use tungstenite::{
    Error, HandshakeError, Message, WebSocket, accept_hdr_with_config,
    handshake::server::{ErrorResponse, Request, Response},
    http::{HeaderValue, StatusCode, header::SEC_WEBSOCKET_PROTOCOL},
    protocol::{CloseFrame, WebSocketConfig, frame::coding::CloseCode},
};

/// Subprotocols with these messages, the preferred one first.
const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Longest wait in a handshake.
const HANDSHAKE_PATIENCE: Duration = Duration::from_secs(5);
/// Wait for a message or for room in the socket; requests are answered after at most this time.
const PATIENCE: Duration = Duration::from_millis(5);
/// Messages between two looks at the requests.
const MOST_AT_ONCE: usize = 256;
/// Largest request: a subscription to some thousand channels.
const LARGEST_REQUEST_BYTES: usize = 1 << 18;
/// Buffer of the kernel for each connection. The usual megabytes would show a slow viewer the past.
const SEND_BUFFER_BYTES: usize = 1 << 17;
/// Binary opcode of the protocol for message data.
const MESSAGE_DATA: u8 = 1;

/// End of a connection.
#[derive(Debug)]
enum Ended {
    /// The viewer has left, or the connection is broken.
    Gone,
    /// A request is not of the protocol.
    Nonsense(String),
    /// The live view ends.
    Over,
}

/// Connection of a viewer.
struct Client<'a> {
    socket: WebSocket<TcpStream>,
    /// Subscriptions by channel.
    subscriptions: BTreeMap<u32, Vec<u32>>,
    /// The socket does not take more.
    is_full: bool,
    counters: &'a Counters,
}

/// Serve one connection until it ends.
pub(super) fn serve(
    stream: TcpStream,
    jobs: &SyncSender<Job>,
    counters: &Counters,
    stop: &AtomicBool,
) {
    let Some(socket) = shake_hands(stream) else { return };
    let (sender, queue) = sync_channel(CLIENT_QUEUE_LENGTH);
    let info = json!({"op": "serverInfo", "name": "klasktron", "capabilities": []});
    sender.try_send(ToClient::Text(info.to_string())).ok();
    if jobs.send(Job::Connect(sender)).is_err() {
        return;
    }
    counters.clients.fetch_add(1, Ordering::Relaxed);
    let mut client = Client { socket, subscriptions: BTreeMap::new(), is_full: false, counters };
    let ended = client.run(&queue, stop);
    client.close(&ended);
    let left: usize = client.subscriptions.values().map(Vec::len).sum();
    counters.subscriptions.fetch_sub(left, Ordering::Relaxed);
    counters.clients.fetch_sub(1, Ordering::Relaxed);
}

/// Complete the handshake; `None` for anything that is not a viewer.
fn shake_hands(stream: TcpStream) -> Option<WebSocket<TcpStream>> {
    let prepared = stream
        .set_nonblocking(false)
        .and_then(|()| stream.set_read_timeout(Some(HANDSHAKE_PATIENCE)))
        .and_then(|()| stream.set_write_timeout(Some(HANDSHAKE_PATIENCE)))
        .and_then(|()| stream.set_nodelay(true))
        .and_then(|()| SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER_BYTES));
    let config = WebSocketConfig::default()
        .read_buffer_size(1 << 12)
        .max_message_size(Some(LARGEST_REQUEST_BYTES))
        .max_frame_size(Some(LARGEST_REQUEST_BYTES));
    let accepted = accept_hdr_with_config(stream, choose_subprotocol, Some(config));
    let socket = match (prepared, accepted) {
        (Ok(()), Ok(socket)) => socket,
        (_, Err(HandshakeError::Failure(error))) => {
            log::info!("the live view has closed a connection that is no viewer: {error}");
            return None;
        }
        _ => return None,
    };
    socket.get_ref().set_nonblocking(true).ok()?;
    Some(socket)
}

#[expect(clippy::result_large_err, reason = "signature of tungstenite's callback")]
fn choose_subprotocol(
    request: &Request,
    mut response: Response,
) -> Result<Response, ErrorResponse> {
    let offered = request.headers().get_all(SEC_WEBSOCKET_PROTOCOL).iter();
    let offered = offered.flat_map(|header| header.to_str().unwrap_or_default().split(','));
    let offered: Vec<&str> = offered.map(str::trim).collect();
    match SUBPROTOCOLS.into_iter().find(|own| offered.contains(own)) {
        Some(chosen) => {
            let value = HeaderValue::from_static(chosen);
            response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, value);
            Ok(response)
        }
        None => {
            let text = "a viewer with the subprotocol foxglove.sdk.v1 is expected".to_owned();
            let mut refusal = ErrorResponse::new(Some(text));
            *refusal.status_mut() = StatusCode::BAD_REQUEST;
            Err(refusal)
        }
    }
}

impl Client<'_> {
    fn run(&mut self, queue: &Receiver<ToClient>, stop: &AtomicBool) -> Ended {
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ended::Over;
            }
            let done = self.answer_requests().and_then(|()| match self.is_full {
                true => self.push_on(),
                false => self.forward(queue),
            });
            if let Err(ended) = done {
                return ended;
            }
        }
    }

    /// Process the requests that have arrived.
    fn answer_requests(&mut self) -> Result<(), Ended> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => self.answer(&text)?,
                Ok(Message::Binary(_)) => {
                    return Err(Ended::Nonsense("clients cannot publish".to_owned()));
                }
                Ok(Message::Close(_)) => return Err(Ended::Gone),
                Ok(_) => {} // pings are answered by the socket
                Err(Error::Io(error)) if is_busy(&error) => return Ok(()),
                Err(Error::ConnectionClosed | Error::AlreadyClosed | Error::Io(_)) => {
                    return Err(Ended::Gone);
                }
                Err(error) => return Err(Ended::Nonsense(error.to_string())),
            }
        }
    }

    fn answer(&mut self, text: &str) -> Result<(), Ended> {
        let nonsense = |what: &str| Ended::Nonsense(what.to_owned());
        let request: Value = serde_json::from_str(text).map_err(|_no| nonsense("no JSON"))?;
        let number = |value: &Value| {
            value.as_u64().and_then(|own| u32::try_from(own).ok()).ok_or_else(|| nonsense("no id"))
        };
        let list = |key: &str| request[key].as_array().ok_or_else(|| nonsense("a list is missing"));
        match request["op"].as_str() {
            Some("subscribe") => {
                for entry in list("subscriptions")? {
                    self.subscribe(number(&entry["channelId"])?, number(&entry["id"])?);
                }
            }
            Some("unsubscribe") => {
                for id in list("subscriptionIds")? {
                    self.unsubscribe(number(id)?);
                }
            }
            // Requests for capabilities that this server does not advertise.
            Some(_) => {}
            None => return Err(nonsense("no op")),
        }
        Ok(())
    }

    fn subscribe(&mut self, channel: u32, id: u32) {
        self.unsubscribe(id);
        self.subscriptions.entry(channel).or_default().push(id);
        self.counters.subscriptions.fetch_add(1, Ordering::Relaxed);
    }

    fn unsubscribe(&mut self, id: u32) {
        let counters = self.counters;
        self.subscriptions.retain(|_, ids| {
            let before = ids.len();
            ids.retain(|own| *own != id);
            counters.subscriptions.fetch_sub(before - ids.len(), Ordering::Relaxed);
            !ids.is_empty()
        });
    }

    /// Wait for messages and send them.
    fn forward(&mut self, queue: &Receiver<ToClient>) -> Result<(), Ended> {
        let first = match queue.recv_timeout(PATIENCE) {
            Ok(first) => first,
            Err(RecvTimeoutError::Timeout) => return Ok(()),
            Err(RecvTimeoutError::Disconnected) => return Err(Ended::Over),
        };
        self.send(first)?;
        for _ in 1..MOST_AT_ONCE {
            let Ok(next) = queue.try_recv() else { break };
            self.send(next)?;
            if self.is_full {
                return Ok(());
            }
        }
        self.flush()
    }

    fn send(&mut self, job: ToClient) -> Result<(), Ended> {
        match job {
            ToClient::Text(text) => self.write(Message::text(text)),
            ToClient::Message(message) => {
                let Some(ids) = self.subscriptions.get(&message.channel.id) else { return Ok(()) };
                let frames: Vec<Message> = ids.iter().map(|id| data(*id, &message)).collect();
                frames.into_iter().try_for_each(|frame| self.write(frame))
            }
        }
    }

    /// Hand a frame to the socket, which keeps it when the connection does not take it now.
    fn write(&mut self, frame: Message) -> Result<(), Ended> {
        let written = self.socket.write(frame);
        self.note(written)
    }

    fn flush(&mut self) -> Result<(), Ended> {
        let flushed = self.socket.flush();
        self.note(flushed)
    }

    fn note(&mut self, result: Result<(), Error>) -> Result<(), Ended> {
        match result {
            Ok(()) => {
                self.is_full = false;
                Ok(())
            }
            Err(Error::Io(error)) if is_busy(&error) => {
                self.is_full = true;
                Ok(())
            }
            Err(_) => Err(Ended::Gone),
        }
    }

    /// Send what the socket keeps; wait where it does not take it.
    fn push_on(&mut self) -> Result<(), Ended> {
        self.flush()?;
        if self.is_full {
            thread::sleep(PATIENCE);
        }
        Ok(())
    }

    fn close(&mut self, ended: &Ended) {
        let (code, reason) = match ended {
            Ended::Gone => return,
            Ended::Nonsense(what) => {
                log::info!("the live view has closed a connection: {what}");
                (CloseCode::Protocol, "not the protocol of a viewer")
            }
            Ended::Over => (CloseCode::Away, "the live view has ended"),
        };
        self.socket.close(Some(CloseFrame { code, reason: reason.into() })).ok();
        self.socket.flush().ok();
    }
}

/// Message data of the protocol: opcode, subscription, time (ns), content.
fn data(subscription: u32, message: &Outgoing) -> Message {
    let mut bytes = Vec::with_capacity(13 + message.data.len());
    bytes.push(MESSAGE_DATA);
    bytes.extend_from_slice(&subscription.to_le_bytes());
    bytes.extend_from_slice(&message.log_time.0.to_le_bytes());
    bytes.extend_from_slice(&message.data);
    Message::binary(bytes)
}

fn is_busy(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
