//! Prediction of the striker that the camera sees, from the measured carriage.

use super::{
    Channel, Instance, Linkage, MeasuredPath, Places, Stage, StageKind, TakenStriker, Twin,
    noise::FrameLosses, plant::Part,
};
use crate::{
    effects::{
        Axis, Carriage, CarriageLanes, Effect, Physics, Place, StrikerLanes, StrikerStateLanes,
        both,
    },
    lanes::{self, Lanes, SideBySide},
};
use pulp::Simd;
use std::{cmp::Ordering, iter};

/// Time step along the measured path (s).
pub(super) const STEP: f64 = 1e-3;

/// Time by which the march begins before the first sample, so that memories have settled even where the camera is
/// 0.2 s late (s).
const RUN_IN: f64 = 0.5;

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
                Physics::Stretch(_)
                    | Physics::Gap(_)
                    | Physics::Encoder(_)
                    | Physics::Expression(Place::Output, _)
                    | Physics::Frame(_)
                    | Physics::Coupling(_)
                    | Physics::Striker(_)
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

    /// The drives do not show where the load is within a gap.
    fn feels_parameter(&self, instance: &Instance, parameter: usize) -> bool {
        let Instance { effect, axis, .. } = *instance;
        let is_of_load = || instance.spring().is_some() && !instance.is_of_spring(parameter);
        self.feels(effect, axis) || self.calls(effect) && is_of_load()
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
        self.predict_alone(twin, nuisance, predicted);
    }

    fn predict_each(
        &self,
        twins: &[&Twin],
        nuisance: &[Vec<f64>],
        predicted: &mut [Vec<Vec<f64>>],
    ) -> bool {
        let offset = nuisance.first().map_or([0.0; 2], |both| [both[0], both[1]]);
        predicted.iter_mut().flatten().for_each(|values| values.fill(f64::NAN));
        let samples: Vec<usize> = self.samples().collect();
        let mut dynamic = Vec::new();
        for (twin, predicted) in twins.iter().zip(predicted) {
            let mut chain = Chain::new(twin);
            match chain.linkage.is_dynamic() {
                true => dynamic.push(Walk::new(self, chain, &samples, predicted)),
                false => self.look_up(&mut chain, offset, predicted),
            }
        }
        lanes::side_by_side(&mut March { stage: self, offset }, &mut dynamic);
        true
    }

    fn width(&self) -> usize {
        lanes::width()
    }
}

impl CameraStage {
    /// Without memory in the chain, each sample is a reading of the path.
    fn look_up(&self, chain: &mut Chain, offset: [f64; 2], predicted: &mut [Vec<f64>]) {
        let mut cursor = 0;
        for sample in self.samples() {
            let time = self.channels[0].times[sample];
            let seen_at = time - chain.delay(time);
            let carriage = self.carriage.carriage(seen_at, STEP, chain.striker_mass, &mut cursor);
            let place = chain.striker(carriage);
            let seen = chain.seen(place, self.height);
            predicted[0][sample] = seen[0] + offset[0];
            predicted[1][sample] = seen[1] + offset[1];
        }
    }

    /// Time at which a march begins (s); a camera that is later than that sees the carriage where it is then.
    fn march_start(&self) -> f64 {
        self.samples().next().map_or(0.0, |first| self.channels[0].times[first] - RUN_IN)
    }

    /// Samples of all runs, in order.
    fn samples(&self) -> impl Iterator<Item = usize> {
        self.channels[0].runs.iter().cloned().flatten()
    }
}

/// March of several twins. With memory, the path is marched in small steps and read between them, from the first run
/// to the last: slip in one run remains in the next. The steps are the same for every twin.
struct March<'a> {
    stage: &'a CameraStage,
    offset: [f64; 2],
}

/// Progress of one twin along the path.
struct Walk<'a> {
    chain: Chain,
    predicted: &'a mut [Vec<f64>],
    /// Samples that were not read, and the time on the path of the first of them (s).
    samples: &'a [usize],
    wanted: f64,
    /// Striker at the end of the last step and of the present one (m).
    strikers: [[f64; 2]; 2],
}

impl<'a> Walk<'a> {
    /// Walk through the `samples` of a `stage`.
    fn new(
        stage: &CameraStage,
        chain: Chain,
        samples: &'a [usize],
        predicted: &'a mut [Vec<f64>],
    ) -> Self {
        let start = stage.carriage.at(stage.march_start(), &mut 0).0;
        let mut walk = Self { chain, predicted, samples, wanted: 0.0, strikers: [start; 2] };
        walk.look_ahead(stage);
        walk
    }

    /// Find the time of the next sample, if there is one.
    fn look_ahead(&mut self, stage: &CameraStage) {
        if let Some(next) = self.samples.first() {
            let time = stage.channels[0].times[*next];
            self.wanted = time - self.chain.delay(time);
        }
    }

    /// Magnet of the `carriage` at the end of the present step. `strikers` receives the position of the striker without
    /// those on springs.
    #[inline(never)]
    fn magnet(&mut self, carriage: Carriage) -> Carriage {
        let Chain { linkage, memory, striker_mass, .. } = &mut self.chain;
        let magnet = linkage.magnet(memory, Carriage { striker_mass: *striker_mass, ..carriage });
        let away = linkage.away(memory, &magnet);
        self.strikers = [self.strikers[1], both(|k| magnet.position[k] + away[k])];
        magnet
    }

    /// Read all samples of the step that ends at `time` (s). The striker is `away` from where it would be without a
    /// spring (m).
    #[inline(never)]
    fn read(&mut self, away: [f64; 2], time: f64, March { stage, offset }: &March<'_>) {
        self.strikers[1] = both(|k| self.strikers[1][k] + away[k]);
        let [before, after] = self.strikers;
        // A delay that is no number ends the walk as well.
        while let Some((sample, rest)) = self.samples.split_first()
            && time.partial_cmp(&self.wanted) != Some(Ordering::Less)
        {
            let share = (1.0 - (time - self.wanted) / STEP).clamp(0.0, 1.0);
            let place = both(|k| before[k] + share * (after[k] - before[k]));
            let seen = self.chain.seen(place, stage.height);
            for (axis, predicted) in self.predicted.iter_mut().enumerate() {
                predicted[*sample] = seen[axis] + offset[axis];
            }
            self.samples = rest;
            self.look_ahead(stage);
        }
    }
}

impl<'a> SideBySide for March<'a> {
    type Item = Walk<'a>;

    #[inline(always)]
    fn run<S: Simd>(&mut self, simd: S, walks: &mut [Walk<'a>]) {
        let mut time = self.stage.march_start();
        let mut cursor = 0;
        let mut strikers = strikers_of(simd, walks);
        let nothing = [Lanes::splat(simd, 0.0); 2];
        let dt = Lanes::splat(simd, STEP);
        let mut motion = CarriageLanes { dt, velocity: nothing, acceleration: nothing };
        while walks.iter().any(|walk| !walk.samples.is_empty()) {
            let carriage = self.stage.carriage.carriage(time, STEP, 0.0, &mut cursor);
            for (lane, walk) in walks.iter_mut().enumerate() {
                motion.put(lane, &walk.magnet(carriage));
            }
            let mut away = nothing;
            for (strikers, state) in &mut strikers {
                strikers.step(state, &motion);
                away = [away[0] + state.away[0], away[1] + state.away[1]];
            }
            for (lane, walk) in walks.iter_mut().enumerate() {
                walk.read([away[0].get(lane), away[1].get(lane)], time, self);
            }
            time += STEP;
        }
    }
}

/// All strikers on springs of `walks`, the last one of each first, at rest.
#[inline(always)]
fn strikers_of<S: Simd>(
    simd: S,
    walks: &mut [Walk<'_>],
) -> Vec<(StrikerLanes<S>, StrikerStateLanes<S>)> {
    let taken: Vec<Vec<TakenStriker>> = walks
        .iter_mut()
        .map(|walk| iter::from_fn(|| walk.chain.linkage.take_striker()).collect())
        .collect();
    let most = taken.iter().map(Vec::len).max().unwrap_or(0);
    let mut strikers = Vec::with_capacity(most);
    for index in 0..most {
        let of = |lane: usize| Some(taken.get(lane)?.get(index)?.on_spring());
        if let Some(own) = StrikerLanes::new(simd, of) {
            strikers.push((own, StrikerStateLanes::at_rest(simd)));
        }
    }
    strikers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, Domain, find},
        twin::{Machine, Source},
    };
    use std::ops::Range;

    /// Stage of a carriage with position and velocity `at` each of `times`, seen in `frames` (s).
    fn stage(
        times: Vec<f64>,
        at: impl Fn(f64) -> [[f64; 2]; 2],
        frames: &[f64],
        runs: &[Range<usize>],
    ) -> CameraStage {
        let (position, velocity) = times.iter().map(|time| at(*time).into()).unzip();
        let channel = |axis: &'static str| Channel {
            signal: format!("camera.striker_{axis}"),
            unit: "m",
            domain: Domain::Sensor,
            axis,
            rate_hz: 100.0,
            times: frames.to_vec(),
            measured: vec![0.0; frames.len()],
            runs: runs.to_vec(),
        };
        CameraStage {
            carriage: MeasuredPath::new(times, position, velocity),
            channels: vec![channel("x"), channel("y")],
            height: 0.0,
            has_drives: false,
            losses: None,
        }
    }

    /// Runs of a carriage that swings along x and y.
    fn swinging() -> CameraStage {
        let at = |t: f64| {
            let position = [0.05 * (4.0 * t).sin(), 0.03 * (7.0 * t).cos()];
            [position, [0.2 * (4.0 * t).cos(), -0.21 * (7.0 * t).sin()]]
        };
        let times = (0..300).map(|k| 0.01 * f64::from(k)).collect();
        let frames: Vec<f64> = (0..300).map(|k| 0.05 + 0.009 * f64::from(k)).collect();
        stage(times, at, &frames, &[0..120, 150..300])
    }

    #[test]
    fn side_by_side_every_twin_predicts_what_it_does_alone() {
        let rubs = |p: &'static [f64]| ("coupling.striker_friction", Axis::Whole, p);
        let late = ("sensor.camera_latency", Axis::Whole, &[0.013][..]);
        let play = ("drive.backlash", Axis::Motors, &[4e-4, 20.0][..]);
        let wobble = ("coupling.striker_wobble", Axis::Whole, &[1e-4, 10.0, 0.05][..]);
        let spring = ("coupling.magnet_spring", Axis::Whole, &[100.0, 0.3, 0.02, 0.0][..]);
        let lists: &[&[(&str, Axis, &[f64])]] = &[
            &[],
            &[rubs(&[0.1, 400.0, 0.2, 0.02])],
            &[rubs(&[0.5, 2500.0, 3.0, 0.02]), late],
            &[late],
            &[play, rubs(&[0.05, 5000.0, 0.1, 1.0])],
            &[play],
            &[spring, wobble],
            &[wobble, late],
            &[spring, rubs(&[0.02, 100.0, 0.2, 0.02])],
            &[rubs(&[0.0, 5000.0, 20.0, 1.0])],
            &[spring],
        ];
        let stage = swinging();
        let twins = lists.iter().map(|list| {
            let mut twin = Twin::nominal(Machine::Table);
            twin.striker_mass = 0.012;
            for (name, axis, values) in *list {
                let effect = find(name).unwrap();
                twin.instances.push(Instance::new(effect, *axis, values, Source::Known));
            }
            twin
        });
        let twins: Vec<Twin> = twins.collect();
        let nuisance = [vec![1e-3, -2e-3]];
        let blank = || vec![vec![0.0; 300]; 2];
        let mut together = vec![blank(); twins.len()];
        let all: Vec<&Twin> = twins.iter().collect();
        assert!(stage.predict_each(&all, &nuisance, &mut together));
        let bits = |all: &[Vec<f64>]| -> Vec<u64> {
            all.iter().flatten().map(|value| value.to_bits()).collect()
        };
        for (index, twin) in twins.iter().enumerate() {
            let mut alone = blank();
            stage.predict(twin, &nuisance, &mut alone);
            assert_eq!(bits(&alone), bits(&together[index]), "twin {index}");
            assert_eq!(together[index].iter().flatten().filter(|own| own.is_finite()).count(), 540);
            let is_same = |other: &Vec<Vec<f64>>| bits(other) == bits(&together[index]);
            assert!(
                !together[..index].iter().any(is_same),
                "twin {index} predicts what another does"
            );
        }
    }

    #[test]
    fn a_camera_that_is_later_than_the_run_in_sees_the_start() {
        let stage = swinging();
        let mut twin = Twin::nominal(Machine::Table);
        let late = Instance::new(
            find("sensor.camera_latency").unwrap(),
            Axis::Whole,
            &[RUN_IN + 0.3],
            Source::Known,
        );
        let play = Instance::new(
            find("drive.backlash").unwrap(),
            Axis::Motors,
            &[4e-4, 20.0],
            Source::Known,
        );
        twin.instances = vec![late, play];
        let mut predicted = vec![vec![0.0; 300]; 2];
        stage.predict(&twin, &[vec![0.0; 2]], &mut predicted);
        let start = [predicted[0][0], predicted[1][0]];
        assert!(start[0].abs() < 1e-3 && (start[1] - 0.03).abs() < 1e-3, "{start:?}");
    }

    /// Two runs with a pause between them: a hard stop in the first, rest in the second.
    #[test]
    fn what_slipped_in_one_run_stays_away_in_the_next() {
        let velocity = |t: f64| (1.0 - 20.0 * (t - 0.5).max(0.0)).max(0.0);
        let place = |t: f64| {
            let braked = (t - 0.5).clamp(0.0, 0.05);
            t.min(0.5) + braked - 10.0 * braked * braked
        };
        let times = (0..6000).map(|k| 1e-3 * f64::from(k)).collect();
        let frames: Vec<f64> = (0..600).map(|k| 0.01 * f64::from(k)).collect();
        let at = |t: f64| [[place(t), 0.0], [velocity(t), 0.0]];
        let stage = stage(times, at, &frames, &[10..200, 400..600]);
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
