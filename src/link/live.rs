//! Real table: a transport and a camera with the system's clock.
//!
//! One thread receives from the transport, one from the camera. Each thread stamps its events and
//! delivers them under one lock, so that events arrive in the order of their stamps. The clock
//! starts at the system's time and is monotonic: a later change of the system's time causes no
//! jump. This is the only part of the library that reads a clock.

use super::{
    BusFault, Capabilities, Event, Link, LinkError, Received, Transport, camera::CameraFeed,
};
use crate::{can::Frame, units::Nanos};
use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// Interval at which a thread checks for the end.
const PATIENCE: Duration = Duration::from_millis(20);

/// Clock in nanoseconds since the Unix epoch, without jumps.
#[derive(Debug, Clone, Copy)]
struct Clock {
    epoch: u64,
    start: Instant,
}

impl Clock {
    fn start() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { epoch: nanos(since), start: Instant::now() }
    }

    fn now(&self) -> Nanos {
        Nanos(self.epoch.saturating_add(nanos(self.start.elapsed())))
    }
}

fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

type Delivery = Result<Event, LinkError>;

/// Delivery of the threads' events.
#[derive(Clone)]
struct Inbox {
    clock: Clock,
    sender: Arc<Mutex<Sender<Delivery>>>,
    stop: Arc<AtomicBool>,
}

impl Inbox {
    /// Stamp and deliver an event under one lock, which preserves the order of time.
    fn deliver(&self, event: impl FnOnce(Nanos) -> Delivery) {
        let sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        // The receiver exists until the link is dropped.
        sender.send(event(self.clock.now())).ok();
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Connection to a real table.
pub struct LiveLink {
    transport: Arc<dyn Transport>,
    clock: Clock,
    events: Receiver<Delivery>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl LiveLink {
    /// Start receiving from `transport` and, if given, `camera`. Events wait in memory until they
    /// are fetched.
    ///
    /// # Errors
    /// When a thread cannot be started.
    pub fn start(
        transport: Arc<dyn Transport>,
        camera: Option<Box<dyn CameraFeed>>,
    ) -> Result<Self, LinkError> {
        let clock = Clock::start();
        let (sender, events) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let inbox = Inbox { clock, sender: Arc::new(Mutex::new(sender)), stop: Arc::clone(&stop) };
        let mut link =
            Self { transport: Arc::clone(&transport), clock, events, stop, threads: Vec::new() };
        let bus_inbox = inbox.clone();
        link.spawn("bus", move || listen_to_bus(transport.as_ref(), &bus_inbox))?;
        if let Some(mut camera) = camera {
            link.spawn("camera", move || listen_to_camera(camera.as_mut(), &inbox))?;
        }
        Ok(link)
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), LinkError> {
        let spawned = thread::Builder::new().name(name.to_owned()).spawn(work);
        self.threads.push(spawned.map_err(|error| LinkError::Unusable {
            bus: name.to_owned(),
            what: format!("a thread cannot be started ({error})"),
            remedy: "end other programs and try again",
        })?);
        Ok(())
    }
}

/// Receive until the link stops, or the transport is broken or at its end.
fn listen_to_bus(transport: &dyn Transport, inbox: &Inbox) {
    while !inbox.stopped() {
        match transport.receive(PATIENCE) {
            Ok(Received::Frame { frame, stamped_at, direction }) => inbox.deliver(|received_at| {
                Ok(Event::Frame { received_at, stamped_at, frame, direction })
            }),
            Ok(Received::Fault(fault)) => {
                inbox.deliver(|at| Ok(Event::Fault { at, fault }));
                if fault == BusFault::LinkDown {
                    // An interface that is down reports this immediately and repeatedly.
                    thread::sleep(PATIENCE);
                }
            }
            Ok(Received::Nothing) => {}
            Ok(Received::End) => return inbox.deliver(|_| Ok(Event::End)),
            Err(error) => return inbox.deliver(|_| Err(error)),
        }
    }
}

/// Receive until the link stops, or the source is broken.
fn listen_to_camera(camera: &mut dyn CameraFeed, inbox: &Inbox) {
    while !inbox.stopped() {
        match camera.receive(PATIENCE) {
            Ok(Some(datagram)) => {
                inbox.deliver(|received_at| Ok(Event::Camera { received_at, datagram }));
            }
            Ok(None) => {}
            Err(error) => return inbox.deliver(|_| Err(error)),
        }
    }
}

impl Link for LiveLink {
    fn now(&self) -> Nanos {
        self.clock.now()
    }

    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        self.transport.send(frame)
    }

    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError> {
        if let Ok(delivery) = self.events.try_recv() {
            return delivery.map(Some);
        }
        let left = Duration::from_nanos(until.0.saturating_sub(self.now().0));
        match self.events.recv_timeout(left) {
            Ok(delivery) => delivery.map(Some),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(LinkError::Unusable {
                bus: "the table".to_owned(),
                what: "the receiving threads have ended".to_owned(),
                remedy: "start anew",
            }),
        }
    }

    fn capabilities(&self) -> Capabilities {
        self.transport.capabilities()
    }
}

impl Drop for LiveLink {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // The panic of a thread was reported already.
            thread.join().ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        can::{Direction, FrameKind, IdWidth, Payload},
        link::CameraSocket,
    };

    /// Bus with a limited number of frames, which then breaks.
    struct Short(Mutex<u32>);

    impl Transport for Short {
        fn send(&self, _frame: &Frame) -> Result<(), LinkError> {
            Err(LinkError::Full { bus: "short".to_owned() })
        }

        fn receive(&self, _timeout: Duration) -> Result<Received, LinkError> {
            let mut left = self.0.lock().unwrap();
            let Some(id) = left.checked_sub(1) else {
                return Err(LinkError::ReadOnly { bus: "short".to_owned() });
            };
            *left = id;
            let frame = Frame {
                id,
                width: IdWidth::Standard,
                kind: FrameKind::Data,
                data: Payload::default(),
            };
            Ok(Received::Frame { frame, stamped_at: None, direction: Direction::Received })
        }

        fn capabilities(&self) -> Capabilities {
            Capabilities { remote_frames: false, error_frames: false, sending: true }
        }
    }

    #[test]
    fn queued_events_come_first_in_order_then_the_break() {
        let mut link = LiveLink::start(Arc::new(Short(Mutex::new(3))), None).unwrap();
        let begin = link.now();
        let mut stamps = Vec::new();
        let soon = begin.after_seconds(10.0);
        for wanted in [2, 1, 0] {
            match link.next_event(soon).unwrap() {
                Some(Event::Frame { received_at, frame, .. }) => {
                    assert_eq!(frame.id, wanted);
                    stamps.push(received_at);
                }
                other => panic!("{other:?}"),
            }
        }
        assert!(stamps.is_sorted());
        assert!(matches!(link.next_event(soon), Err(LinkError::ReadOnly { .. })));
        assert!(matches!(link.next_event(soon), Err(LinkError::Unusable { .. })));
    }

    #[test]
    fn a_deadline_in_the_past_gives_what_is_there_and_then_nothing() {
        struct Silent;
        impl Transport for Silent {
            fn send(&self, _frame: &Frame) -> Result<(), LinkError> {
                Ok(())
            }
            fn receive(&self, timeout: Duration) -> Result<Received, LinkError> {
                thread::sleep(timeout);
                Ok(Received::Nothing)
            }
            fn capabilities(&self) -> Capabilities {
                Capabilities { remote_frames: true, error_frames: true, sending: true }
            }
        }
        let camera = CameraSocket::bind(&"udp:127.0.0.1:0".parse().unwrap()).unwrap();
        let address = camera.udp_address().unwrap();
        let mut link = LiveLink::start(Arc::new(Silent), Some(Box::new(camera))).unwrap();
        assert_eq!(link.next_event(Nanos(0)).unwrap(), None);
        let before = link.now();
        assert_eq!(link.next_event(before.after_seconds(0.01)).unwrap(), None);
        assert!(before.after_seconds(0.01) <= link.now(), "it has waited to the deadline");
        let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.send_to(b"{}", address).unwrap();
        let mut event = None;
        for _ in 0..500 {
            event = link.next_event(Nanos(0)).unwrap();
            if event.is_some() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        let Some(Event::Camera { received_at, datagram }) = event else { panic!("{event:?}") };
        assert_eq!(datagram, b"{}");
        assert!(before <= received_at && received_at <= link.now());
    }
}
