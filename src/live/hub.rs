//! Distribution of messages to the viewers.

use super::Counters;
use crate::{
    recording::{PROTOBUF, RawSchema},
    units::Nanos,
};
use data_encoding::BASE64;
use serde_json::{Value, json};
use std::sync::{
    Arc,
    atomic::Ordering,
    mpsc::{Receiver, SyncSender, TrySendError},
};

/// Capacity of the queue to one viewer (messages).
pub(super) const CLIENT_QUEUE_LENGTH: usize = 1 << 11;

/// Channel: a topic with its schema.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) id: u32,
    /// Entry of the protocol's `advertise` message.
    advertisement: Value,
}

impl Channel {
    pub(super) fn new(id: u32, topic: &str, schema: &RawSchema<'_>) -> Self {
        // Binary definitions travel as base64, textual ones as they are.
        let definition = match schema.encoding {
            PROTOBUF | "flatbuffer" => BASE64.encode(schema.data),
            _ => String::from_utf8_lossy(schema.data).into_owned(),
        };
        let advertisement = json!({
            "id": id,
            "topic": topic,
            "encoding": schema.message_encoding,
            "schemaName": schema.name,
            "schemaEncoding": schema.encoding,
            "schema": definition,
        });
        Self { id, advertisement }
    }
}

/// Message on its way to the viewers.
#[derive(Debug, Clone)]
pub(super) struct Outgoing {
    pub(super) channel: Arc<Channel>,
    pub(super) log_time: Nanos,
    pub(super) data: Arc<[u8]>,
}

/// Job of the distributing thread.
#[derive(Debug)]
pub(super) enum Job {
    Message(Outgoing),
    /// A channel whose first message will come later.
    Channel(Arc<Channel>),
    /// A viewer that has connected.
    Connect(SyncSender<ToClient>),
    End,
}

/// Job of the thread of one viewer.
#[derive(Debug)]
pub(super) enum ToClient {
    /// Message of the protocol as JSON.
    Text(String),
    Message(Outgoing),
}

/// Connected viewer.
struct Guest {
    queue: SyncSender<ToClient>,
    /// Number of channels that it knows, in the order of the hub.
    known: usize,
}

/// Channels and viewers.
pub(super) struct Hub {
    channels: Vec<Arc<Channel>>,
    guests: Vec<Guest>,
    counters: Arc<Counters>,
}

impl Hub {
    pub(super) fn new(counters: Arc<Counters>) -> Self {
        Self { channels: Vec::new(), guests: Vec::new(), counters }
    }

    /// Distribute messages until the end.
    pub(super) fn run(mut self, queue: &Receiver<Job>) {
        for job in queue {
            match job {
                Job::Message(message) => self.distribute(&message),
                Job::Channel(channel) => {
                    self.know(&channel);
                    self.announce();
                }
                Job::Connect(queue) => {
                    self.guests.push(Guest { queue, known: 0 });
                    self.announce();
                }
                Job::End => return,
            }
        }
    }

    fn distribute(&mut self, message: &Outgoing) {
        self.know(&message.channel);
        self.announce();
        let counters = &self.counters;
        self.guests.retain(|guest| {
            match guest.queue.try_send(ToClient::Message(message.clone())) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    counters.dropped.fetch_add(1, Ordering::Relaxed);
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            }
        });
    }

    fn know(&mut self, channel: &Arc<Channel>) {
        if self.channels.iter().all(|own| own.id != channel.id) {
            self.channels.push(Arc::clone(channel));
        }
    }

    /// Advertise channels to viewers that do not know them yet; a full queue gets them later.
    fn announce(&mut self) {
        let all = self.channels.len();
        for guest in self.guests.iter_mut().filter(|guest| guest.known < all) {
            let new: Vec<&Value> =
                self.channels[guest.known..].iter().map(|own| &own.advertisement).collect();
            let text = json!({"op": "advertise", "channels": new}).to_string();
            if guest.queue.try_send(ToClient::Text(text)).is_ok() {
                guest.known = all;
            }
        }
    }
}
