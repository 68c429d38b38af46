//! Measured carriage to the striker that the camera sees.

use super::{
    Channel, Instance, MeasuredPath, Stage, StageKind, Twin,
    plant::{Part, belts, rails},
};
use crate::effects::{Carriage, Effect, Motion, Physics, both};

/// Step of the march along the measured path (s).
const STEP: f64 = 1e-3;

/// How long before a run the march begins, so that memories have settled (s).
const RUN_IN: f64 = 0.3;

/// One gantry of one session: the carriage of the encoders in, the camera's striker out.
#[derive(Debug, Clone)]
pub struct CameraStage {
    /// The carriage as the encoders tell it.
    pub carriage: MeasuredPath,
    /// `camera.striker_x`, `camera.striker_y` (m).
    pub channels: Vec<Channel>,
    /// Height of what the camera sees above the board (m).
    pub height: f64,
}

type PlayPart = Part<fn(&[f64], &mut [f64], &Motion) -> f64>;
type EncoderPart = Part<fn(&[f64], f64) -> f64>;
type FramePart = Part<fn(&[f64], &Carriage) -> [f64; 2]>;
type CouplingPart = Part<fn(&[f64], &mut [f64], &Carriage) -> [f64; 2]>;
type DelayPart = Part<fn(&[f64], f64) -> f64>;
type CameraPart = Part<fn(&[f64], [f64; 2], f64) -> [f64; 2]>;

/// The functions between encoder and camera, in their order.
struct Chain {
    encoders: [Vec<EncoderPart>; 2],
    belt_plays: [Vec<PlayPart>; 2],
    rail_plays: [Vec<PlayPart>; 2],
    frames: Vec<FramePart>,
    couplings: Vec<CouplingPart>,
    cameras: Vec<CameraPart>,
    delays: Vec<DelayPart>,
    mass: [f64; 2],
    memory: Vec<f64>,
    striker_mass: f64,
}

impl Chain {
    fn new(twin: &Twin) -> Self {
        let mut chain = Self {
            encoders: [Vec::new(), Vec::new()],
            belt_plays: [Vec::new(), Vec::new()],
            rail_plays: [Vec::new(), Vec::new()],
            frames: Vec::new(),
            couplings: Vec::new(),
            cameras: Vec::new(),
            delays: Vec::new(),
            mass: [0.0; 2],
            memory: Vec::new(),
            striker_mass: twin.striker_mass,
        };
        let mut memory = 0;
        for instance in &twin.instances {
            chain.add(instance, &mut memory);
        }
        chain.memory = vec![0.0; memory];
        chain
    }

    fn add(&mut self, instance: &Instance, memory: &mut usize) {
        let axis = instance.axis;
        let covered = (0..2).filter(|index| axis.covers(*index));
        match instance.effect.physics {
            Physics::Encoder(call) => {
                covered.for_each(|k| self.encoders[k].push(Part::new(call, instance, memory)));
            }
            Physics::Play(call) => {
                let plays =
                    if axis.is_motor() { &mut self.belt_plays } else { &mut self.rail_plays };
                covered.for_each(|k| plays[k].push(Part::new(call, instance, memory)));
            }
            Physics::Frame(call) => self.frames.push(Part::new(call, instance, memory)),
            Physics::Coupling(call) => self.couplings.push(Part::new(call, instance, memory)),
            Physics::Camera(call) => self.cameras.push(Part::new(call, instance, memory)),
            Physics::CameraDelay(call) => self.delays.push(Part::new(call, instance, memory)),
            Physics::Inertia(_) => {
                covered.for_each(|k| self.mass[k] += instance.values[0].value);
            }
            _ => {}
        }
    }

    /// Whether anything between encoder and camera remembers or depends on acceleration.
    fn is_dynamic(&self) -> bool {
        let plays = self.belt_plays.iter().chain(&self.rail_plays).any(|parts| !parts.is_empty());
        plays || !self.couplings.is_empty() || !self.frames.is_empty()
    }

    /// Striker of a carriage at one time.
    fn striker(&mut self, mut carriage: Carriage) -> [f64; 2] {
        let memory = &mut self.memory;
        let mut belt = belts(carriage.position);
        for (k, parts) in self.encoders.iter().enumerate() {
            for part in parts {
                // The path holds the reported position: take away what the encoder adds.
                belt[k] -= (part.call)(part.p(), belt[k]) - belt[k];
            }
        }
        let force = both(|k| self.mass[k] * carriage.acceleration[k]);
        let belt_force = belts(force).map(|sum| 0.5 * sum);
        let (belt_velocity, belt_acceleration) =
            (belts(carriage.velocity), belts(carriage.acceleration));
        for (k, parts) in self.belt_plays.iter().enumerate() {
            for part in parts {
                let motion = Motion {
                    dt: carriage.dt,
                    position: belt[k],
                    velocity: belt_velocity[k],
                    acceleration: belt_acceleration[k],
                    force: belt_force[k],
                    ..Motion::default()
                };
                belt[k] = (part.call)(part.p(), part.memory(memory), &motion);
            }
        }
        let mut place = rails(belt);
        for (k, parts) in self.rail_plays.iter().enumerate() {
            for part in parts {
                let motion = Motion {
                    dt: carriage.dt,
                    position: place[k],
                    velocity: carriage.velocity[k],
                    acceleration: carriage.acceleration[k],
                    force: force[k],
                    ..Motion::default()
                };
                place[k] = (part.call)(part.p(), part.memory(memory), &motion);
            }
        }
        carriage.position = place;
        for part in &self.frames {
            carriage.position = (part.call)(part.p(), &carriage);
        }
        let magnet = carriage.position;
        let mut striker = magnet;
        for part in &self.couplings {
            let moved = (part.call)(part.p(), part.memory(memory), &carriage);
            striker = both(|k| striker[k] + moved[k] - magnet[k]);
        }
        striker
    }

    fn delay(&self, elapsed: f64) -> f64 {
        self.delays.iter().map(|part| (part.call)(part.p(), elapsed)).sum()
    }

    fn seen(&self, place: [f64; 2], height: f64) -> [f64; 2] {
        self.cameras.iter().fold(place, |place, part| (part.call)(part.p(), place, height))
    }
}

impl Stage for CameraStage {
    fn kind(&self) -> StageKind {
        StageKind::Camera
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, effect: &Effect) -> bool {
        matches!(
            effect.physics,
            Physics::Play(_)
                | Physics::Encoder(_)
                | Physics::Frame(_)
                | Physics::Coupling(_)
                | Physics::Camera(_)
                | Physics::CameraDelay(_)
        )
    }

    /// One offset for the whole session: the camera's zero against that of the homed carriage.
    fn nuisance_groups(&self) -> Vec<std::ops::Range<usize>> {
        let session = 0..self.channels[0].runs.len();
        vec![session]
    }

    fn nuisance_start(&self, _group: usize) -> Vec<f64> {
        vec![0.0; 2]
    }

    fn nuisance_scale(&self) -> Vec<f64> {
        vec![1e-3; 2]
    }

    fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let mut chain = Chain::new(twin);
        let offset = nuisance.first().map_or([0.0; 2], |both| [both[0], both[1]]);
        for values in predicted.iter_mut() {
            values.fill(f64::NAN);
        }
        let dynamic = chain.is_dynamic();
        for run in &self.channels[0].runs {
            if dynamic {
                self.march(&mut chain, run.clone(), offset, predicted);
            } else {
                self.look_up(&mut chain, run.clone(), offset, predicted);
            }
        }
    }
}

impl CameraStage {
    /// Without memory in the chain, each sample is a reading of the path.
    fn look_up(
        &self,
        chain: &mut Chain,
        run: std::ops::Range<usize>,
        offset: [f64; 2],
        predicted: &mut [Vec<f64>],
    ) {
        let mut cursor = 0;
        for sample in run {
            let time = self.channels[0].times[sample];
            let carriage = self.carriage_at(time - chain.delay(time), STEP, &mut cursor, chain);
            let place = chain.striker(carriage);
            let seen = chain.seen(place, self.height);
            predicted[0][sample] = seen[0] + offset[0];
            predicted[1][sample] = seen[1] + offset[1];
        }
    }

    /// With memory, the path is marched in small steps and read between them.
    fn march(
        &self,
        chain: &mut Chain,
        run: std::ops::Range<usize>,
        offset: [f64; 2],
        predicted: &mut [Vec<f64>],
    ) {
        let times = &self.channels[0].times;
        let Some(&first) = times.get(run.start) else { return };
        chain.memory.fill(0.0);
        let mut cursor = 0;
        let mut time = first - chain.delay(first) - RUN_IN;
        let mut at = |time: f64, chain: &mut Chain| {
            let carriage = self.carriage_at(time, STEP, &mut cursor, chain);
            chain.striker(carriage)
        };
        let mut before = at(time, chain);
        let mut after = before;
        for sample in run {
            let wanted = times[sample] - chain.delay(times[sample]);
            while time < wanted {
                time += STEP;
                before = after;
                after = at(time, chain);
            }
            let share = (1.0 - (time - wanted) / STEP).clamp(0.0, 1.0);
            let place = both(|k| before[k] + share * (after[k] - before[k]));
            let seen = chain.seen(place, self.height);
            predicted[0][sample] = seen[0] + offset[0];
            predicted[1][sample] = seen[1] + offset[1];
        }
    }

    fn carriage_at(&self, time: f64, dt: f64, cursor: &mut usize, chain: &Chain) -> Carriage {
        let (position, velocity, acceleration) = self.carriage.at(time, cursor);
        Carriage { dt, position, velocity, acceleration, striker_mass: chain.striker_mass }
    }
}
