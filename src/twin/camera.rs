//! Prediction of the striker that the camera sees, from the measured carriage.

use super::{
    Channel, Linkage, MeasuredPath, Places, Stage, StageKind, Twin, noise::FrameLosses, plant::Part,
};
use crate::effects::{Axis, Carriage, Effect, Physics, Place, both};

/// Time step along the measured path (s).
pub(super) const STEP: f64 = 1e-3;

/// Time by which the march begins before the first run, so that memories have settled (s).
const RUN_IN: f64 = 0.3;

/// One gantry of one session. Input: the carriage of the encoders; output: the striker of the
/// camera.
#[derive(Debug, Clone)]
pub struct CameraStage {
    /// Carriage as measured by the encoders.
    pub carriage: MeasuredPath,
    /// `camera.striker_x`, `camera.striker_y` (m).
    pub channels: Vec<Channel>,
    /// Height of the detected object above the board (m).
    pub height: f64,
    /// True if the drives were recorded as well: they then show the load on the motors.
    pub has_drives: bool,
    /// Frames that were lost or came twice; `None` with too few frames.
    pub losses: Option<FrameLosses>,
}

type DelayPart = Part<fn(&[f64], f64) -> f64>;
type CameraPart = Part<fn(&[f64], [f64; 2], f64) -> [f64; 2]>;

/// The functions between encoder and camera, in their order.
struct Chain {
    linkage: Linkage,
    memory: Vec<f64>,
    cameras: Vec<CameraPart>,
    delays: Vec<DelayPart>,
    striker_mass: f64,
}

impl Chain {
    fn new(twin: &Twin) -> Self {
        let linkage = Linkage::new(twin, Places::Reported);
        let mut chain = Self {
            memory: vec![0.0; linkage.memory()],
            linkage,
            cameras: Vec::new(),
            delays: Vec::new(),
            striker_mass: twin.striker_mass,
        };
        for instance in &twin.instances {
            match instance.effect.physics {
                Physics::Camera(call) => chain.cameras.push(Part::new(call, instance, &mut 0)),
                Physics::CameraDelay(call) => chain.delays.push(Part::new(call, instance, &mut 0)),
                _ => {}
            }
        }
        chain
    }

    /// The carriage on `path` at `time`, for one step of the march.
    fn carriage(&self, path: &MeasuredPath, time: f64, cursor: &mut usize) -> Carriage {
        path.carriage(time, STEP, self.striker_mass, cursor)
    }

    /// Striker of a carriage at one time.
    fn striker(&mut self, carriage: Carriage) -> [f64; 2] {
        self.linkage.striker(&mut self.memory, carriage)
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
        let is_called = |equation: &Physics| {
            matches!(
                equation,
                Physics::Backlash(_)
                    | Physics::Encoder(_)
                    | Physics::Expression(Place::Output, _)
                    | Physics::Frame(_)
                    | Physics::Coupling(_)
                    | Physics::Camera(_)
                    | Physics::CameraDelay(_)
            )
        };
        effect.physics.equations().iter().any(is_called)
    }

    fn feels(&self, effect: &Effect, axis: Axis) -> bool {
        let is_between = |equation: &Physics| matches!(equation, Physics::Transmission(_));
        let is_felt = axis.is_motor() && effect.physics.equations().iter().any(is_between);
        self.calls(effect) && !(self.has_drives && is_felt)
    }

    fn frame_losses(&self) -> Option<&FrameLosses> {
        self.losses.as_ref()
    }

    /// One offset for the whole session: the zero of the camera relative to that of the homed
    /// carriage.
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

    fn offsets(&self, nuisance: &[Vec<f64>]) -> Option<Vec<f64>> {
        nuisance.first().cloned()
    }

    fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let mut chain = Chain::new(twin);
        let offset = nuisance.first().map_or([0.0; 2], |both| [both[0], both[1]]);
        for values in predicted.iter_mut() {
            values.fill(f64::NAN);
        }
        let samples = self.channels[0].runs.iter().cloned().flatten();
        if chain.linkage.is_dynamic() {
            self.march(&mut chain, samples, offset, predicted);
        } else {
            self.look_up(&mut chain, samples, offset, predicted);
        }
    }
}

impl CameraStage {
    /// Without memory in the chain, each sample is a reading of the path.
    fn look_up(
        &self,
        chain: &mut Chain,
        samples: impl Iterator<Item = usize>,
        offset: [f64; 2],
        predicted: &mut [Vec<f64>],
    ) {
        let mut cursor = 0;
        for sample in samples {
            let time = self.channels[0].times[sample];
            let carriage = chain.carriage(&self.carriage, time - chain.delay(time), &mut cursor);
            let place = chain.striker(carriage);
            let seen = chain.seen(place, self.height);
            predicted[0][sample] = seen[0] + offset[0];
            predicted[1][sample] = seen[1] + offset[1];
        }
    }

    /// With memory, the path is marched in small steps and read between them, from the first run to
    /// the last: slip in one run remains in the next.
    fn march(
        &self,
        chain: &mut Chain,
        samples: impl Iterator<Item = usize>,
        offset: [f64; 2],
        predicted: &mut [Vec<f64>],
    ) {
        let times = &self.channels[0].times;
        let mut samples = samples.peekable();
        let Some(first) = samples.peek().and_then(|first| times.get(*first).copied()) else {
            return;
        };
        let mut cursor = 0;
        let mut time = first - chain.delay(first) - RUN_IN;
        let mut at = |time: f64, chain: &mut Chain| {
            let carriage = chain.carriage(&self.carriage, time, &mut cursor);
            chain.striker(carriage)
        };
        let mut before = at(time, chain);
        let mut after = before;
        for sample in samples {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, Domain, find},
        twin::{Instance, Machine, Source},
    };

    /// Two runs with a pause between them: a hard stop in the first, rest in the second.
    #[test]
    fn what_slipped_in_one_run_stays_away_in_the_next() {
        let velocity = |t: f64| (1.0 - 20.0 * (t - 0.5).max(0.0)).max(0.0);
        let place = |t: f64| {
            let braked = (t - 0.5).clamp(0.0, 0.05);
            t.min(0.5) + braked - 10.0 * braked * braked
        };
        let times: Vec<f64> = (0..6000).map(|k| 1e-3 * f64::from(k)).collect();
        let carriage = MeasuredPath::new(
            times.clone(),
            times.iter().map(|t| [place(*t), 0.0]).collect(),
            times.iter().map(|t| [velocity(*t), 0.0]).collect(),
        );
        let frames: Vec<f64> = (0..600).map(|k| 0.01 * f64::from(k)).collect();
        let channel = |axis: &'static str| Channel {
            signal: format!("camera.striker_{axis}"),
            unit: "m",
            domain: Domain::Sensor,
            axis,
            rate_hz: 100.0,
            times: frames.clone(),
            measured: vec![0.0; frames.len()],
            runs: vec![10..200, 400..600],
        };
        let channels = vec![channel("x"), channel("y")];
        let stage =
            CameraStage { carriage, channels, height: 0.0, has_drives: false, losses: None };
        let mut twin = Twin::nominal(Machine::Table);
        twin.striker_mass = 0.012;
        let slip = find("coupling.magnet_slip").unwrap();
        twin.instances = vec![Instance::new(slip, Axis::Whole, &[0.12, 0.0], Source::Known)];
        let mut predicted = vec![vec![0.0; frames.len()]; 2];
        stage.predict(&twin, &[vec![0.0; 2]], &mut predicted);
        // Against 10 m/s^2 the striker slides 25 mm further than the magnet, which stops with 20 m/s^2.
        let away = |sample: usize| predicted[0][sample] - place(frames[sample]);
        assert!(away(40).abs() < 1e-9 && (away(199) - 0.025).abs() < 1e-3, "{}", away(199));
        assert!((away(400) - away(199)).abs() < 1e-9, "{} {}", away(199), away(400));
        assert!(predicted[0][300].is_nan());
    }
}
