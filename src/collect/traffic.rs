//! Traffic of a session: the messages of each node with their rates, its firmware and errors, and the
//! camera frames.

use super::preflight::firmware_text;
use crate::{
    can::{AxisErrors, AxisState, Command, Message},
    gantry::Robot,
    units::Nanos,
};
use serde::Serialize;
use std::{collections::BTreeMap, fmt};

/// Rate of one kind of message or frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Arrivals {
    /// Number of arrivals.
    pub count: u64,
    /// Mean rate between the first and the last arrival (Hz); null for a single arrival.
    pub rate_hz: Option<f64>,
}

/// Traffic of one message of a node.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MessageTraffic {
    /// Name of the message in ODrive's spelling.
    pub message: &'static str,
    /// Number and rate.
    #[serde(flatten)]
    pub arrivals: Arrivals,
}

/// Traffic of one node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NodeTraffic {
    /// Node id.
    pub node: u8,
    /// Motor in the robot file, such as `left a`; null for a node that is not in it.
    pub motor: Option<String>,
    /// Firmware as `major.minor.revision`; null when the node has not reported it.
    pub firmware: Option<String>,
    /// Axis state of the last heartbeat; null without a heartbeat.
    pub axis_state: Option<String>,
    /// Errors of the last heartbeat, `none` for no error; null without a heartbeat.
    pub errors: Option<String>,
    /// Messages from and to the node, without requests.
    pub messages: Vec<MessageTraffic>,
}

/// Traffic of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraTraffic {
    /// Number of decoded frames.
    pub frames: u64,
    /// Mean rate between the first and the last frame (Hz); null below two frames.
    pub rate_hz: Option<f64>,
    /// Number of datagrams that could not be decoded.
    pub rejected: u64,
}

/// Traffic of a session on the bus and from the camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Traffic {
    /// Rate of all frames on the bus (Hz); null below two frames.
    pub frames_per_s: Option<f64>,
    /// Nodes by id.
    pub nodes: Vec<NodeTraffic>,
    /// Camera.
    pub camera: CameraTraffic,
}

/// Number of arrivals with the times of the first and the last.
#[derive(Debug, Clone, Copy)]
struct Counter {
    count: u64,
    first: Nanos,
    last: Nanos,
}

impl Counter {
    fn add(counter: &mut Option<Self>, time: Nanos) {
        let counter = counter.get_or_insert(Self { count: 0, first: time, last: time });
        counter.count += 1;
        counter.last = time;
    }

    fn arrivals(&self) -> Arrivals {
        let seconds = self.last.seconds_since(self.first);
        let rate_hz = (0.0 < seconds).then(|| (self.count - 1) as f64 / seconds);
        Arrivals { count: self.count, rate_hz }
    }
}

/// Messages and state of one node.
#[derive(Debug, Clone, Default)]
struct NodeWatch {
    messages: BTreeMap<u8, Option<Counter>>,
    version: Option<[u8; 8]>,
    heartbeat: Option<(AxisState, AxisErrors)>,
}

/// Collector of the traffic of a session.
#[derive(Debug, Clone, Default)]
pub(super) struct TrafficWatch {
    frames: Option<Counter>,
    nodes: BTreeMap<u8, NodeWatch>,
    camera: Option<Counter>,
}

impl TrafficWatch {
    /// Count one frame on the bus.
    pub(super) fn push_frame(&mut self, time: Nanos) {
        Counter::add(&mut self.frames, time);
    }

    /// Count one decoded message from or to a node.
    pub(super) fn push_message(&mut self, time: Nanos, node: u8, message: &Message) {
        if matches!(message, Message::Request(_)) {
            return;
        }
        let watch = self.nodes.entry(node).or_default();
        Counter::add(watch.messages.entry(message.command() as u8).or_default(), time);
        match *message {
            Message::Version(bytes) => watch.version = Some(bytes),
            Message::Heartbeat { axis_error, axis_state, .. } => {
                let state = AxisState::from_number(axis_state);
                watch.heartbeat = Some((state, AxisErrors(axis_error)));
            }
            _ => {}
        }
    }

    /// Count one camera frame.
    pub(super) fn push_camera_frame(&mut self, time: Nanos) {
        Counter::add(&mut self.camera, time);
    }

    /// Summarize the traffic; `rejected` is the number of undecodable camera datagrams.
    pub(super) fn summary(&self, robot: &Robot, rejected: u64) -> Traffic {
        let camera = self.camera.map(|counter| counter.arrivals());
        Traffic {
            frames_per_s: self.frames.and_then(|counter| counter.arrivals().rate_hz),
            nodes: self.nodes.iter().map(|(node, watch)| watch.summary(*node, robot)).collect(),
            camera: CameraTraffic {
                frames: camera.map_or(0, |arrivals| arrivals.count),
                rate_hz: camera.and_then(|arrivals| arrivals.rate_hz),
                rejected,
            },
        }
    }
}

impl NodeWatch {
    fn summary(&self, node: u8, robot: &Robot) -> NodeTraffic {
        let seat = robot.seat_of_node(node);
        let messages = self.messages.iter().filter_map(|(command, counter)| {
            let message = Command::from_id(*command)?.name();
            Some(MessageTraffic { message, arrivals: counter.as_ref()?.arrivals() })
        });
        NodeTraffic {
            node,
            motor: seat.map(|seat| format!("{} {}", seat.player, seat.motor.name())),
            firmware: self.version.map(firmware_text),
            axis_state: self.heartbeat.map(|(state, _)| state.to_string()),
            errors: self.heartbeat.map(|(_, errors)| errors.to_string()),
            messages: messages.collect(),
        }
    }
}

impl NodeTraffic {
    /// Return whether the last heartbeat had an error flag.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.errors.as_deref().is_some_and(|errors| errors != "none")
    }
}

impl fmt::Display for Arrivals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rate_hz {
            Some(rate) => write!(f, "{rate:.1} Hz"),
            None => f.write_str("once"),
        }
    }
}

impl fmt::Display for NodeTraffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let motor = self.motor.as_deref().unwrap_or("not in the robot file");
        write!(f, "node {} ({motor}): ", self.node)?;
        match &self.firmware {
            Some(firmware) => write!(f, "firmware {firmware}, ")?,
            None => f.write_str("firmware not reported, ")?,
        }
        match (&self.axis_state, &self.errors) {
            (Some(state), Some(errors)) => write!(f, "state {state}, errors {errors}")?,
            _ => f.write_str("no heartbeat")?,
        }
        let mut separator = "; ";
        for MessageTraffic { message, arrivals } in &self.messages {
            write!(f, "{separator}{message} {arrivals}")?;
            separator = ", ";
        }
        Ok(())
    }
}

impl fmt::Display for CameraTraffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, rejected, .. } = self;
        match self.rate_hz {
            Some(rate) => write!(f, "camera: {frames} frames, {rate:.1} Hz, {rejected} rejected"),
            None => write!(f, "camera: {frames} frames, {rejected} rejected"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_firmware_and_errors_are_those_of_the_messages() {
        let mut watch = TrafficWatch::default();
        for k in 0..11 {
            let time = Nanos(k * 100_000_000);
            let heartbeat = Message::Heartbeat {
                axis_error: 0x0100_0000,
                axis_state: 1,
                procedure_result: 0,
                trajectory: crate::can::TrajectoryState::Done,
            };
            watch.push_frame(time);
            watch.push_message(time, 2, &heartbeat);
            watch.push_message(time, 9, &Message::Request(Command::Version));
        }
        watch.push_message(Nanos(0), 2, &Message::Version([2, 4, 4, 58, 0, 6, 10, 0]));
        watch.push_camera_frame(Nanos(0));
        let traffic = watch.summary(&Robot::default(), 3);
        let [node] = &traffic.nodes[..] else { panic!("{traffic:?}") };
        assert_eq!(
            node.to_string(),
            "node 2 (left a): firmware 0.6.10, state IDLE, errors WATCHDOG_TIMER_EXPIRED; \
             Get_Version once, Heartbeat 10.0 Hz"
        );
        assert!(node.has_errors());
        assert_eq!(traffic.frames_per_s, Some(10.0));
        assert_eq!(traffic.camera.to_string(), "camera: 1 frames, 3 rejected");
    }
}
