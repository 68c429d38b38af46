//! A small host: sends messages, advances time, stores the received messages.

use crate::{
    can::{Decoded, Message, decode, encode},
    link::{BusFault, Event, Link},
    rig::{RigConfig, Speed, Truth, VirtualLink},
    units::Nanos,
};

pub(super) const START: Nanos = Nanos(1_700_000_000_000_000_000);
/// Control period (s).
pub(super) const PERIOD: f64 = 0.02;

pub(super) struct Host {
    pub(super) link: VirtualLink,
    pub(super) messages: Vec<(f64, Decoded)>,
    pub(super) pictures: Vec<(f64, Vec<u8>)>,
    pub(super) troubles: Vec<(f64, BusFault)>,
}

impl Host {
    pub(super) fn new(config: RigConfig) -> Self {
        let link = VirtualLink::new(config, Speed::Maximum, START).unwrap();
        Self { link, messages: Vec::new(), pictures: Vec::new(), troubles: Vec::new() }
    }

    pub(super) fn from_json(text: &str) -> Self {
        Self::new(RigConfig::from_json(text).unwrap())
    }

    pub(super) fn time(&self) -> f64 {
        self.link.now().seconds_since(START)
    }

    pub(super) fn send(&mut self, node: u8, message: Message) {
        self.link.send(&encode(node, &message)).unwrap();
    }

    pub(super) fn wait(&mut self, seconds: f64) {
        let until = self.link.now().after_seconds(seconds);
        while let Some(event) = self.link.next_event(until).unwrap() {
            match event {
                Event::Frame { received_at, frame, .. } => {
                    if let Ok(decoded) = decode(&frame) {
                        self.messages.push((received_at.seconds_since(START), decoded));
                    }
                }
                Event::Camera { received_at, datagram } => {
                    self.pictures.push((received_at.seconds_since(START), datagram));
                }
                Event::Fault { at, fault } => self.troubles.push((at.seconds_since(START), fault)),
                Event::End => panic!("a rig has no end"),
            }
        }
        assert_eq!(self.link.now(), until);
    }

    pub(super) fn velocity(&mut self, node: u8, turns_per_s: f64) {
        self.send(
            node,
            Message::SetInputVel {
                velocity_turns_per_s: turns_per_s as f32,
                torque_newton_metres: 0.0,
            },
        );
    }

    /// Arms all four drives in velocity control.
    pub(super) fn arm(&mut self) {
        for node in 0..4 {
            self.send(node, Message::SetControllerMode { control_mode: 2, input_mode: 1 });
            self.velocity(node, 0.0);
        }
        self.wait(0.02);
        for node in 0..4 {
            self.send(node, Message::ClearErrors { identify: 0 });
            self.send(node, Message::SetAxisState { state: 8 });
        }
        self.wait(0.02);
    }

    /// Command the right player's carriage (m/s) for `seconds` at 50 Hz, and the left one to stop;
    /// returns the truth every millisecond.
    pub(super) fn drive(&mut self, [vx, vy]: [f64; 2], seconds: f64) -> Vec<(f64, Truth)> {
        let mut truths = Vec::new();
        for _ in 0..(seconds / PERIOD).round() as usize {
            self.velocity(0, (vx + vy) / 0.04);
            self.velocity(1, (vx - vy) / 0.04);
            self.velocity(2, 0.0);
            self.velocity(3, 0.0);
            for _ in 0..20 {
                self.wait(PERIOD / 20.0);
                truths.push((self.time(), self.link.truth()));
            }
        }
        truths
    }

    /// The last message of a node that matches `pick`.
    pub(super) fn last<T>(&self, node: u8, pick: impl Fn(&Message) -> Option<T>) -> Option<T> {
        let mut from_node = self.messages.iter().rev().filter(|(_, d)| d.node == node);
        from_node.find_map(|(_, decoded)| pick(&decoded.message))
    }

    /// State and errors in the last heartbeat of a node.
    pub(super) fn heartbeat(&self, node: u8) -> (u8, u32, u8) {
        self.last(node, |message| match *message {
            Message::Heartbeat { axis_error, axis_state, procedure_result, .. } => {
                Some((axis_state, axis_error, procedure_result))
            }
            _ => None,
        })
        .unwrap()
    }
}
