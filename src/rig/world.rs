//! Simulation of the rig: drives, gantries, magnets, strikers, ball, camera and faults in one step.
//!
//! One step of [`RigConfig::step_s`]: faults change, drives run and report, strikers follow their
//! magnets, gantries move, the ball rolls, the camera captures. Frames leave into an outbox; the
//! transport (a modelled or a real bus) is not part of the world.

use super::{
    ball::Ball,
    camera::{Camera, Sight},
    config::{ConfigError, FaultKind, RigConfig},
    draw::Scene,
    drive::{Drive, Outgoing},
    fault::{Change, LinkFaults, Schedule},
    friction::Friction,
    gantry::{Gantry, Rotor},
    magnet::Peg,
    truth::{Body, DriveTruth, PlayerTruth, Truth},
};
use crate::{
    can::{AxisErrors, AxisState, Frame, Message, decode, encode},
    recording::topic::{Motor, Player},
    seed::Stream,
    units::Nanos,
};
use std::f64::consts::TAU;

const NANOS: f64 = 1e9;
/// Update interval of the friction drift (steps).
const STEPS_PER_WARMTH: u64 = 1024;

/// Motor of a drive.
#[derive(Debug, Clone, Copy)]
struct Mount {
    player: usize,
    motor: usize,
    sign: f64,
}

/// The rig without its connection.
#[derive(Debug, Clone)]
pub struct World {
    config: RigConfig,
    start: Nanos,
    steps: u64,
    step_ns: u64,
    now_ns: u64,
    mounts: Vec<Mount>,
    drives: Vec<Drive>,
    gantries: [Gantry; 2],
    pegs: [Peg; 2],
    ball: Ball,
    camera: Camera,
    schedule: Schedule,
    armed_once: bool,
    warmth: f64,
    link_faults: LinkFaults,
    outbox: Vec<Outgoing>,
}

impl World {
    /// Build a rig at rest at `start`, with its drives idle.
    ///
    /// # Errors
    /// When the configuration has a value outside its range.
    pub fn new(config: RigConfig, start: Nanos) -> Result<Self, ConfigError> {
        config.check()?;
        let half_board = [config.board.short_side_m / 2.0, config.board.long_side_m / 2.0];
        let mut phases = Stream::new(config.seed, "rig.drive.phases");
        let mut gantries = [
            Gantry::new(&config.gantry.left, &config, -1.0),
            Gantry::new(&config.gantry.right, &config, 1.0),
        ];
        let (mut mounts, mut drives) = (Vec::new(), Vec::new());
        for seat in &config.drives {
            let own = seat.own.as_deref().unwrap_or(&config.drive);
            let mount = Mount {
                player: usize::from(seat.player == Player::Right),
                motor: usize::from(seat.motor == Motor::B),
                sign: f64::from(seat.sign),
            };
            let per_turn = config.belt_metres_per_turn;
            let radius = per_turn / TAU;
            let friction = Friction::of_motor(&own.friction, radius, per_turn);
            gantries[mount.player].rotors[mount.motor] =
                Rotor::new(own.rotor_inertia_kg_m2, mount.sign, radius, friction);
            drives.push(Drive::new(own, seat, config.step_s, &mut phases));
            mounts.push(mount);
        }
        let peg =
            |gantry: &Gantry, peg, magnet| Peg::new(peg, magnet, gantry.position(), half_board);
        let pegs = [
            peg(&gantries[0], &config.peg.left, &config.magnet.left),
            peg(&gantries[1], &config.peg.right, &config.magnet.right),
        ];
        Ok(Self {
            start,
            steps: 0,
            step_ns: (config.step_s * NANOS).round() as u64,
            now_ns: 0,
            mounts,
            drives,
            gantries,
            pegs,
            ball: Ball::new(&config.ball, &config.cups, half_board, config.seed),
            camera: Camera::new(&config.camera, start, config.seed),
            schedule: Schedule::new(&config.faults),
            armed_once: false,
            warmth: 1.0,
            link_faults: LinkFaults::default(),
            outbox: Vec::with_capacity(64),
            config,
        })
    }

    /// Time since the start (ns).
    pub(super) fn now_ns(&self) -> u64 {
        self.now_ns
    }

    pub(super) fn link_faults(&self) -> LinkFaults {
        self.link_faults
    }

    /// State and errors of each drive.
    pub(super) fn drive_states(&self) -> impl Iterator<Item = (AxisState, AxisErrors)> {
        self.drives.iter().map(|drive| (drive.state(), drive.errors()))
    }

    /// Move the frames that are ready into `sink`.
    pub(super) fn drain_frames(&mut self, mut sink: impl FnMut(Outgoing)) {
        self.outbox.drain(..).for_each(&mut sink);
    }

    /// The next datagram of the camera that has arrived, with its arrival time (ns).
    pub(super) fn next_datagram(&mut self) -> Option<(u64, Vec<u8>)> {
        self.camera.arrived(self.now_ns)
    }

    /// Hand over scenes instead of datagrams.
    pub(super) fn draw_frames(&mut self) {
        self.camera.draws = true;
    }

    /// The next scene whose detections have arrived, with their arrival time (ns).
    pub(super) fn next_scene(&mut self) -> Option<(u64, Scene)> {
        self.camera.arrived_scene(self.now_ns)
    }

    /// Deliver a frame of the bus to the drives; unknown messages are ignored.
    pub(super) fn receive(&mut self, frame: &Frame) {
        let Ok(decoded) = decode(frame) else { return };
        for drive in &mut self.drives {
            drive.receive(&decoded, self.now_ns, &mut self.outbox);
        }
    }

    /// Advance by one step.
    pub(super) fn step(&mut self) {
        self.steps += 1;
        self.now_ns = self.steps * self.step_ns;
        let dt = self.config.step_s;
        let now_s = self.now_ns as f64 / NANOS;
        while let Some(change) = self.schedule.next_change(self.now_ns) {
            self.change(change);
        }
        self.drive_motors();
        if self.steps.is_multiple_of(STEPS_PER_WARMTH) {
            let done = 1.0 - (-now_s / self.config.friction_drift_time_s).exp();
            self.warmth = 1.0 - self.config.friction_drift_fraction * done;
        }
        for (gantry, peg) in self.gantries.iter_mut().zip(&mut self.pegs) {
            let load = peg.step(gantry.position(), gantry.velocity(), dt);
            gantry.step(load, self.warmth, dt);
        }
        self.ball.step(now_s, dt, &mut self.pegs);
        if self.camera.next_ns() <= self.now_ns {
            let ball: Sight = self.ball.place.map(|place| (place, self.ball.velocity));
            let [left, right] = [0, 1].map(|p| Some((self.pegs[p].head(), self.pegs[p].velocity)));
            self.camera.take(self.now_ns, [ball, left, right]);
        }
    }

    fn drive_motors(&mut self) {
        let per_turn = self.config.belt_metres_per_turn;
        let current: f64 = self.drives.iter().map(Drive::supply_current).sum();
        let supply = &self.config.supply;
        let volts = (supply.open_volts - supply.resistance_ohm * current).max(0.0);
        for (drive, mount) in self.drives.iter_mut().zip(&self.mounts) {
            let rotor = &mut self.gantries[mount.player].rotors[mount.motor];
            let motion = [rotor.position, rotor.velocity].map(|q| q * mount.sign / per_turn);
            let torque = drive.tick(self.now_ns, motion, volts);
            rotor.force = torque * mount.sign * TAU / per_turn;
            drive.report(self.now_ns, &mut self.outbox);
        }
        let armed = |drive: &Drive| drive.state() == AxisState::ClosedLoopControl;
        if !self.armed_once && self.drives.iter().any(armed) {
            self.armed_once = true;
            self.schedule.armed(self.now_ns);
        }
    }

    fn change(&mut self, change: Change) {
        let (kind, begins) = change.parts();
        if let Some(node) = kind.node() {
            self.change_drive(node, change);
        }
        let side = |player: Player| usize::from(player == Player::Right);
        let faults = &mut self.link_faults;
        match kind {
            FaultKind::FramesDropped { probability } => {
                faults.drop_probability = if begins { probability } else { 0.0 };
            }
            FaultKind::FramesDelayed { delay_s } => {
                faults.delay_ns = if begins { (delay_s * NANOS).round() as u64 } else { 0 };
            }
            FaultKind::BusOff => faults.bus_off = begins,
            FaultKind::LinkDown => faults.link_down = begins,
            FaultKind::PegLost { player } => self.pegs[side(player)].magnet_broken = begins,
            FaultKind::CameraStops => self.camera.stopped = begins,
            FaultKind::CameraShifts { x_m, y_m } => {
                self.camera.shift = if begins { [x_m, y_m] } else { [0.0; 2] };
            }
            FaultKind::Stuck { player } => self.gantries[side(player)].stuck = begins,
            _ => {}
        }
    }

    fn change_drive(&mut self, node: u8, change: Change) {
        let (kind, begins) = change.parts();
        let Some(idx) = self.config.drives.iter().position(|seat| seat.node == node) else {
            return;
        };
        let drive = &mut self.drives[idx];
        match kind {
            FaultKind::HeartbeatStops { .. } => drive.faults.heartbeat_off = begins,
            FaultKind::EncoderStops { .. } => drive.faults.encoder_off = begins,
            FaultKind::DriveSilent { .. } => drive.faults.silent = begins,
            FaultKind::Overheat { fet_celsius, .. } => {
                drive.faults.fet_celsius = begins.then_some(fet_celsius);
            }
            FaultKind::AxisFault { errors, .. } if begins => drive.disarm(errors),
            FaultKind::ForeignCommand { velocity_turns_per_s, .. } if begins => {
                let message = Message::SetInputVel {
                    velocity_turns_per_s: velocity_turns_per_s as f32,
                    torque_newton_metres: 0.0,
                };
                let frame = encode(node, &message);
                self.receive(&frame);
                self.outbox.push(Outgoing { ready_ns: self.now_ns, frame });
            }
            _ => {}
        }
    }

    /// Ground truth at the current time.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let [left, right] = [0, 1].map(|player| {
            let (gantry, peg) = (&self.gantries[player], &self.pegs[player]);
            PlayerTruth {
                carriage: Body::new(gantry.position(), gantry.velocity()),
                peg: Body::new(peg.position, peg.velocity),
                coupled: peg.coupled,
            }
        });
        let drives = self.drives.iter().zip(&self.mounts).map(|(drive, mount)| {
            let rotor = &self.gantries[mount.player].rotors[mount.motor];
            let per_turn = self.config.belt_metres_per_turn;
            DriveTruth {
                node: drive.node,
                state: drive.state(),
                errors: drive.errors(),
                position_turns: rotor.position * mount.sign / per_turn,
                velocity_turns_per_s: rotor.velocity * mount.sign / per_turn,
                torque_newton_metres: drive.torque(),
                fet_celsius: drive.fet_celsius(),
            }
        });
        Truth {
            time: Nanos(self.start.0 + self.now_ns),
            left,
            right,
            ball: self.ball.place.map(|place| Body::new(place, self.ball.velocity)),
            goals: self.ball.goals,
            serves: self.ball.served,
            hits: self.ball.hits,
            drives: drives.collect(),
        }
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &RigConfig {
        &self.config
    }
}
