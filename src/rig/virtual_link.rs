//! The virtual rig as a [`Link`]: a clock, a bus and a camera, as fast as possible or in real time.
//!
//! At [`Speed::Maximum`] time is simulated time only: it advances only in `next_event`. At
//! [`Speed::RealTime`] the same events occur at the same simulated times, but not before the
//! monotonic clock has reached them.

use super::{
    bus::{Bus, Sender},
    config::{ConfigError, RigConfig},
    draw::Artist,
    fault::LinkFaults,
    truth::Truth,
    world::World,
};
use crate::{
    can::{Direction, Frame},
    link::{BusFault, Capabilities, Event, Link, LinkError},
    recording::message::BoardState,
    seed::Stream,
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    thread,
    time::{Duration, Instant},
};

/// Start time of virtual rigs at full speed (2026-01-01, UTC): equal settings give equal bytes.
pub const VIRTUAL_START: Nanos = Nanos(1_767_225_600_000_000_000);

/// Name of the bus in messages.
const NAME: &str = "the virtual bus";

/// Rate of simulated time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// With the monotonic clock.
    RealTime,
    /// As fast as possible.
    Maximum,
}

/// Detector of drawn frames: from the bytes of a frame (YUYV) and its time to a datagram of detections.
pub type Vision = Box<dyn FnMut(&[u8], Nanos) -> Option<Vec<u8>>>;

/// The virtual rig.
pub struct VirtualLink {
    world: World,
    /// Artist and detector, if frames are drawn.
    vision: Option<(Artist, Vision)>,
    bus: Bus,
    start: Nanos,
    /// Reading of the monotonic clock at the start, in real time.
    origin: Option<Instant>,
    now_ns: u64,
    /// Events by time (ns since the start) and order of creation.
    ahead: BTreeMap<(u64, u64), Event>,
    made: u64,
    faults: LinkFaults,
    losses: Stream,
    jitter: Stream,
    transmit_queue: usize,
    receive_jitter: f64,
}

impl VirtualLink {
    /// Build a rig at rest whose time begins at `start`.
    ///
    /// ```
    /// use klasktron::link::{Event, Link};
    /// use klasktron::rig::{RigConfig, Speed, VirtualLink};
    /// use klasktron::units::Nanos;
    ///
    /// let start = Nanos(1_000_000_000);
    /// let mut rig = VirtualLink::new(RigConfig::default(), Speed::Maximum, start).unwrap();
    /// let first = rig.next_event(start.after_seconds(0.2)).unwrap();
    /// assert!(matches!(first, Some(Event::Frame { .. } | Event::Camera { .. })));
    /// ```
    ///
    /// # Errors
    /// When the configuration has a value outside its range.
    pub fn new(config: RigConfig, speed: Speed, start: Nanos) -> Result<Self, ConfigError> {
        let bus = Bus::new(&config.bus);
        let seed = config.seed;
        let transmit_queue = config.bus.transmit_queue as usize;
        let receive_jitter = config.bus.receive_jitter_s;
        Ok(Self {
            world: World::new(config, start)?,
            vision: None,
            bus,
            start,
            origin: (speed == Speed::RealTime).then(Instant::now),
            now_ns: 0,
            ahead: BTreeMap::new(),
            made: 0,
            faults: LinkFaults::default(),
            losses: Stream::new(seed, "rig.link.losses"),
            jitter: Stream::new(seed, "rig.link.jitter"),
            transmit_queue,
            receive_jitter,
        })
    }

    /// Draw frames, and let `vision` detect the pieces in them.
    #[must_use]
    pub fn with_vision(mut self, vision: Vision) -> Self {
        let config = self.world.config();
        let half = [config.board.short_side_m / 2.0, config.board.long_side_m / 2.0];
        self.vision = Some((Artist::new(half, config.seed), vision));
        self.world.draw_frames();
        self
    }

    /// Ground truth at the current time, up to one step ahead of [`Link::now`].
    #[must_use]
    pub fn truth(&self) -> Truth {
        self.world.truth()
    }

    /// World behind the link.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Number of frames of drives that an overloaded bus has replaced by newer ones.
    #[must_use]
    pub fn replaced_frames(&self) -> u64 {
        self.bus.replaced
    }

    fn push(&mut self, at_ns: u64, event: Event) {
        self.made += 1;
        self.ahead.insert((at_ns, self.made), event);
    }

    fn stamp(&self, at_ns: u64) -> Nanos {
        Nanos(self.start.0 + at_ns)
    }

    fn is_lost(&mut self) -> bool {
        0.0 < self.faults.drop_probability
            && f64::from(self.losses.uniform_f32(0.0, 1.0)) < self.faults.drop_probability
    }

    fn step(&mut self) {
        self.world.step();
        self.notice_faults();
        let bus = &mut self.bus;
        self.world.drain_frames(|out| bus.offer(out.frame, out.ready_ns, Sender::Rig));
        while let Some((at_ns, frame, sender)) = self.bus.next_sent(self.world.now_ns()) {
            let lost = self.is_lost();
            match sender {
                Sender::Host if !lost => self.world.receive(&frame),
                Sender::Rig if !lost && !self.faults.bus_off && !self.faults.link_down => {
                    self.hear(at_ns, frame);
                }
                _ => {}
            }
        }
        while let Some((at_ns, datagram)) = self.world.next_datagram() {
            self.push(at_ns, Event::Camera { received_at: self.stamp(at_ns), datagram });
        }
        while let Some((at_ns, scene)) = self.world.next_scene() {
            let Some((artist, vision)) = &mut self.vision else { continue };
            if let Some(datagram) = vision(artist.draw(&scene), scene.capture_time) {
                self.push(at_ns, Event::Camera { received_at: self.stamp(at_ns), datagram });
            }
        }
    }

    fn hear(&mut self, at_ns: u64, frame: Frame) {
        let mut late_ns = self.faults.delay_ns;
        if 0.0 < self.receive_jitter {
            let share = f64::from(self.jitter.uniform_f32(0.0, 1.0));
            late_ns += (share * self.receive_jitter * 1e9) as u64;
        }
        let received_at = self.stamp(at_ns + late_ns);
        let stamped_at = Some(self.stamp(at_ns));
        let direction = Direction::Received;
        self.push(at_ns + late_ns, Event::Frame { received_at, stamped_at, frame, direction });
    }

    fn notice_faults(&mut self) {
        let (before, now) = (self.faults, self.world.link_faults());
        if before == now {
            return;
        }
        self.faults = now;
        let at_ns = self.world.now_ns();
        let mut say = |fault| {
            let at = self.stamp(at_ns);
            self.push(at_ns, Event::Fault { at, fault });
        };
        if now.bus_off && !before.bus_off {
            say(BusFault::BusOff);
        }
        if !now.bus_off && before.bus_off {
            say(BusFault::Restarted);
        }
        if now.link_down && !before.link_down {
            say(BusFault::LinkDown);
        }
        if now.bus_off || now.link_down {
            self.bus.flush_host();
        }
    }

    /// Set the link's time, after waiting for it in real time.
    fn reach(&mut self, at_ns: u64) {
        self.now_ns = self.now_ns.max(at_ns);
        if let Some(origin) = self.origin {
            let due = origin + Duration::from_nanos(self.now_ns);
            thread::sleep(due.saturating_duration_since(Instant::now()));
        }
    }
}

impl Link for VirtualLink {
    fn now(&self) -> Nanos {
        let clock_ns = self.origin.map_or(0, |origin| origin.elapsed().as_nanos() as u64);
        self.stamp(self.now_ns.max(clock_ns))
    }

    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        if self.faults.link_down {
            return Err(LinkError::Down { bus: NAME.to_owned(), interface: "virtual".to_owned() });
        }
        if self.faults.bus_off || self.transmit_queue <= self.bus.queued_by_host() {
            return Err(LinkError::Full { bus: NAME.to_owned() });
        }
        let now_ns = self.now().0 - self.start.0;
        self.bus.offer(*frame, now_ns.max(self.world.now_ns()), Sender::Host);
        Ok(())
    }

    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError> {
        let until_ns = until.0.saturating_sub(self.start.0);
        loop {
            let known_ns = self.world.now_ns();
            if let Some(entry) = self.ahead.first_entry() {
                let at_ns = entry.key().0;
                if at_ns <= known_ns && at_ns < until_ns {
                    let event = entry.remove();
                    self.reach(at_ns);
                    return Ok(Some(event));
                }
            }
            if until_ns <= known_ns {
                self.reach(until_ns);
                return Ok(None);
            }
            self.step();
        }
    }

    fn true_state(&self) -> Option<BoardState> {
        Some(self.truth().board_state())
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { remote_frames: true, error_frames: true, sending: true }
    }
}
