//! Live view: a WebSocket server for Foxglove and Lichtblick.
//!
//! [`LiveServer::start`] listens, by default on the loopback interface only. A [`Publisher`] hands
//! messages over; their channels are advertised with their schemas, as in a recording.
//!
//! # Protocol
//!
//! The Foxglove WebSocket protocol: subprotocol `foxglove.sdk.v1`, and `foxglove.websocket.v1` of
//! older viewers, which has the same messages. The server only sends: it has no parameters and no
//! services, and clients cannot publish. Source: `docs/spec.md` of foxglove/ws-protocol.
//!
//! # Timing
//!
//! [`Publisher::publish`] never waits. It puts the message into a bounded queue, or drops and
//! counts it when the queue is full. One thread distributes the messages to a bounded queue for
//! each viewer, and one thread for each viewer writes to its connection. A viewer that stalls
//! loses messages; it delays neither the publisher nor another viewer.
//!
//! ```
//! use klasktron::live::{LiveAddress, LiveServer};
//! let address: LiveAddress = "foxglove:0".parse().unwrap(); // any free port
//! let server = LiveServer::start(&address).unwrap();
//! assert!(server.address().ip().is_loopback());
//! ```

mod address;
mod client;
mod hub;
mod playback;
#[cfg(test)]
mod tests;

pub use address::{LiveAddress, LiveAddressError};
pub use playback::{Playback, Played};

use crate::{
    recording::{FILE_DESCRIPTOR_SET, RawSchema},
    units::Nanos,
};
use hub::{Channel, Job, Outgoing};
use prost::{Message, Name};
use std::{
    collections::BTreeMap,
    io,
    net::{SocketAddr, TcpListener},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering},
        mpsc::{SyncSender, TrySendError, sync_channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

/// Capacity of the queue from the publishers (messages): about two seconds of a session at 500 Hz.
const QUEUE_LENGTH: usize = 1 << 13;
/// Interval at which the listening thread checks for the end.
const PATIENCE: Duration = Duration::from_millis(20);
/// Largest number of connected viewers.
const MOST_CLIENTS: usize = 16;

/// Error of starting the live view.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// Another program has the port.
    #[error(
        "the live view cannot listen on {address}: another program uses port {port}; end it, or give another port \
         from 1 to 65535 with --live foxglove:PORT"
    )]
    PortInUse {
        /// Address to listen on.
        address: String,
        /// Its port.
        port: u16,
    },
    /// The address cannot be used.
    #[error(
        "the live view cannot listen on {address} ({reason}); give --live foxglove:PORT for this computer alone, or \
         --live foxglove:0.0.0.0:PORT for the whole network"
    )]
    Listen {
        /// Address to listen on.
        address: String,
        /// Message of the system.
        reason: String,
    },
}

/// Counters of a live view.
#[derive(Debug, Default)]
struct Counters {
    /// Messages that a full queue did not take, of publishers and viewers.
    dropped: AtomicU64,
    clients: AtomicUsize,
    channels: AtomicU32,
    subscriptions: AtomicUsize,
}

/// Live view that is being served until it is dropped.
#[derive(Debug)]
pub struct LiveServer {
    address: SocketAddr,
    jobs: SyncSender<Job>,
    counters: Arc<Counters>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl LiveServer {
    /// Listen on `address`.
    ///
    /// # Errors
    /// When the port is in use, or the address is not one of this computer.
    pub fn start(address: &LiveAddress) -> Result<Self, LiveError> {
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::AddrInUse => {
                LiveError::PortInUse { address: address.host_and_port(), port: address.port }
            }
            _ => LiveError::Listen { address: address.host_and_port(), reason: error.to_string() },
        };
        let listener = TcpListener::bind((address.host.as_str(), address.port)).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        let (jobs, queue) = sync_channel(QUEUE_LENGTH);
        let counters = Arc::new(Counters::default());
        let stop = Arc::new(AtomicBool::new(false));
        let hub = hub::Hub::new(Arc::clone(&counters));
        let guests =
            Guests { jobs: jobs.clone(), counters: Arc::clone(&counters), stop: Arc::clone(&stop) };
        let threads = vec![
            spawn("live hub", move || hub.run(&queue)).map_err(failed)?,
            spawn("live listener", move || guests.welcome(&listener)).map_err(failed)?,
        ];
        log::info!("the live view listens on {local}");
        Ok(Self { address: local, jobs, counters, stop, threads })
    }

    /// Return the address that it listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Return a publisher.
    #[must_use]
    pub fn publisher(&self) -> Publisher {
        let (jobs, counters) = (self.jobs.clone(), Arc::clone(&self.counters));
        Publisher { jobs, counters, channels: BTreeMap::new() }
    }

    /// Return the number of messages that full queues did not take.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.counters.dropped.load(Ordering::Relaxed)
    }

    /// Return the number of subscriptions of connected viewers.
    #[must_use]
    pub fn subscriptions(&self) -> usize {
        self.counters.subscriptions.load(Ordering::Relaxed)
    }
}

impl Drop for LiveServer {
    /// Close every connection; messages that are still queued are lost.
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.jobs.try_send(Job::End).ok();
        for thread in self.threads.drain(..) {
            // The panic of a thread was reported already.
            thread.join().ok();
        }
    }
}

/// Source of messages; see [`LiveServer::publisher`].
#[derive(Debug)]
pub struct Publisher {
    jobs: SyncSender<Job>,
    counters: Arc<Counters>,
    /// Channels by topic and name of the schema.
    channels: BTreeMap<(String, String), Arc<Channel>>,
}

impl Publisher {
    /// Send a message to the viewers that have subscribed to its topic. Never waits.
    pub fn publish(&mut self, topic: &str, schema: &RawSchema<'_>, log_time: Nanos, data: &[u8]) {
        let channel = self.channel(topic, schema);
        let message = Outgoing { channel, log_time, data: data.into() };
        if let Err(TrySendError::Full(_)) = self.jobs.try_send(Job::Message(message)) {
            self.counters.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Send a message of the contract.
    pub fn publish_message<M: Message + Name>(
        &mut self,
        topic: &str,
        log_time: Nanos,
        message: &M,
    ) {
        let name = M::full_name();
        let schema = RawSchema::protobuf(&name, FILE_DESCRIPTOR_SET);
        self.publish(topic, &schema, log_time, &message.encode_to_vec());
    }

    /// Make a topic known to viewers before its first message. Waits while the queue is full.
    pub fn advertise(&mut self, topic: &str, schema: &RawSchema<'_>) {
        let known = self.channels.len();
        let channel = self.channel(topic, schema);
        if known < self.channels.len() {
            // A live view that has ended has no viewers.
            self.jobs.send(Job::Channel(channel)).ok();
        }
    }

    fn channel(&mut self, topic: &str, schema: &RawSchema<'_>) -> Arc<Channel> {
        let key = (topic.to_owned(), schema.name.to_owned());
        let new = || {
            let id = self.counters.channels.fetch_add(1, Ordering::Relaxed) + 1;
            Arc::new(Channel::new(id, topic, schema))
        };
        Arc::clone(self.channels.entry(key).or_insert_with(new))
    }
}

/// Listening thread.
struct Guests {
    jobs: SyncSender<Job>,
    counters: Arc<Counters>,
    stop: Arc<AtomicBool>,
}

impl Guests {
    /// Start a thread for each connection until the end.
    fn welcome(&self, listener: &TcpListener) {
        let mut threads: Vec<JoinHandle<()>> = Vec::new();
        while !self.stop.load(Ordering::Relaxed) {
            let Ok((stream, _)) = listener.accept() else {
                thread::sleep(PATIENCE);
                continue;
            };
            threads.retain(|thread| !thread.is_finished());
            if MOST_CLIENTS <= threads.len() {
                log::warn!("a connection was closed: {MOST_CLIENTS} viewers are connected");
                continue;
            }
            let (jobs, counters) = (self.jobs.clone(), Arc::clone(&self.counters));
            let stop = Arc::clone(&self.stop);
            let serve = move || client::serve(stream, &jobs, &counters, &stop);
            match spawn("live viewer", serve) {
                Ok(thread) => threads.push(thread),
                Err(error) => log::warn!("a connection was closed: no thread for it ({error})"),
            }
        }
        for thread in threads {
            thread.join().ok();
        }
    }
}

fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    thread::Builder::new().name(name.to_owned()).spawn(work)
}
