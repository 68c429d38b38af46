//! Effects on the measurement noise of the camera: `sensor.frame_jitter` and `sensor.noise_model` change its variance,
//! `sensor.frame_drop` the number of frames. They apply to the stages that a camera measures.
//!
//! The frame-to-frame variance of the residual, at rest and with speed, is measured on the training and on the
//! validation sessions ([`scattering`]). It is compared with the measurement noise of the given twin, session by
//! session. The same holds for the fraction of lost frames ([`FrameLosses`]). A change of the noise colour alone is no
//! effect: its magnitude is the same.

use super::{
    known::Excess,
    problem::{Point, Problem},
    rounds::{Added, Unstated},
    thresholds::Thresholds,
};
use crate::{
    effects::{self, Axis, Effect, Noise, Physics},
    stats::{f_tail, t_quantile},
    twin::{
        Estimate, Instance, MeasurementNoise, Source, StageKind, Twin, Value,
        noise::{FRAMES_OF_A_BLOCK, FrameLosses, LostFraction, Scattering, scattering},
    },
};

/// Comparisons of one recording: two effects on two stages, and one on one stage.
const TRIES: usize = 5;

/// Effect that is added or updated.
pub(super) struct DetectedChange {
    /// Step for the findings, where the twin lacked the effect.
    pub(super) step: Option<Added>,
    instance: Instance,
}

/// Measurement noise of the camera in all sessions of `problem`; `None` on stages without camera, or with too few
/// frames.
pub(super) fn measure(problem: &Problem<'_>, point: &Point) -> Option<Scattering> {
    let first = problem.parts.first()?;
    if !matches!(first.stage.kind(), StageKind::Camera | StageKind::Ball) {
        return None;
    }
    let (mut residuals, mut speeds) = (Vec::new(), Vec::new());
    for (part, predicted) in problem.parts.iter().zip(problem.prediction(point)) {
        let residual = part.residual(&predicted);
        let channels = part.stage.channels();
        for (k, channel) in channels.iter().enumerate() {
            let mut own = vec![f64::NAN; channel.times.len()];
            for row in part.layout.rows.iter().filter(|row| row.channel as usize == k) {
                let sample = row.sample as usize;
                own[sample] = residual[k][sample];
            }
            residuals.extend(own.into_iter().chain([f64::NAN]));
            speeds.extend(slopes(&channel.times, &predicted[k]).into_iter().chain([f64::NAN]));
        }
    }
    scattering(&residuals, &speeds, FRAMES_OF_A_BLOCK)
}

/// Fraction of lost frames in all sessions of `problem`; `None` without a camera.
fn measure_losses(problem: &Problem<'_>) -> Option<LostFraction> {
    let losses = problem.parts.iter().map(|part| part.stage.frame_losses());
    FrameLosses::fraction(&losses.collect::<Option<Vec<_>>>()?)
}

/// Central differences; not finite at the ends.
fn slopes(times: &[f64], values: &[f64]) -> Vec<f64> {
    (0..times.len())
        .map(|k| match (k.checked_sub(1), values.get(k + 1)) {
            (Some(before), Some(after)) => {
                (after - values[before]) / (times[k + 1] - times[before])
            }
            _ => f64::NAN,
        })
        .collect()
}

/// Measurement noise of `stage` that `twin` states.
fn stated(twin: &Twin, stage: StageKind) -> Option<MeasurementNoise> {
    twin.measurement_noise.iter().find(|own| own.stage == stage).copied()
}

/// State the measurement noise of `problem` at `point`, and its lost frames.
pub(super) fn state(twin: &mut Twin, problem: &Problem<'_>, point: &Point) {
    let Some(found) = measure(problem, point) else { return };
    let stage = problem.parts[0].stage.kind();
    twin.measurement_noise.retain(|own| own.stage != stage);
    twin.measurement_noise.push(MeasurementNoise {
        stage,
        timestamp_variance_s2: found.timestamp_variance_s2,
        frame_to_frame_variance_m2: found.frame_to_frame_variance_m2,
        total_variance_m2: found.total_variance_m2,
        lost_frame_fraction: measure_losses(problem).map(|lost| lost.fraction),
    });
}

/// One change, on the training and on the validation sessions.
struct Change {
    effect: &'static Effect,
    /// Zero for no change.
    changes: [Estimate; 2],
    blocks: [usize; 2],
    /// Parameter of the effect and its standard error.
    value: Estimate,
    unstated: Unstated,
}

impl Change {
    /// Student's t and degrees of freedom of the training (0) or validation (1) sessions.
    fn t(&self, index: usize) -> (f64, f64) {
        let Estimate { value: change, standard_error: error } = self.changes[index];
        let freedom = self.blocks[index].saturating_sub(1).max(1) as f64;
        (if 0.0 < error { change / error } else { 0.0 }, freedom)
    }

    /// Two-sided p-value of the change on the training sessions, corrected for all comparisons.
    fn p_value(&self) -> f64 {
        let (t, freedom) = self.t(0);
        (TRIES as f64 * f_tail(t * t, 1.0, freedom)).min(1.0)
    }

    /// Return whether training and validation sessions show it, with one sign.
    fn is_in(&self, thresholds: &Thresholds) -> bool {
        let (t, _) = self.t(0);
        let (validated, freedom) = self.t(1);
        self.p_value() < thresholds.family_error
            && t_quantile(1.0 - thresholds.confirmation_level, freedom) < validated * t.signum()
    }

    fn detected(self, given: &Twin, rms: Vec<f64>) -> DetectedChange {
        let Estimate { value, standard_error: error } = self.value;
        let half = t_quantile(0.975, self.t(0).1) * error;
        let (before, after) = self.unstated.ends();
        let number =
            Value { value, ci95: Some([value - half, value + half]), source: Source::Fitted };
        let step = (!has(given, self.effect)).then(|| Added {
            effect: self.effect,
            axis: Axis::Whole,
            scanned: None,
            p_value: self.p_value(),
            statistic: self.t(0).0.powi(2),
            data: format!(
                "training sessions, {} blocks of {FRAMES_OF_A_BLOCK} frames",
                self.blocks[0]
            ),
            comparisons: TRIES,
            log_score: None,
            validation_gain: 1.0 - after / before.max(f64::MIN_POSITIVE),
            indistinguishable: Vec::new(),
            has_rival: false,
            held_out_steps: (rms.clone(), rms),
            unstated: Some(self.unstated),
            ranking: Vec::new(),
            estimates: Vec::new(),
        });
        DetectedChange {
            step,
            instance: Instance { effect: self.effect, axis: Axis::Whole, values: vec![number] },
        }
    }
}

fn difference(a: Estimate, b: Estimate) -> Estimate {
    Estimate { value: a.value - b.value, standard_error: a.standard_error.hypot(b.standard_error) }
}

/// Logarithm of the ratio of two standard deviations, from their variances.
fn log_ratio(a: Estimate, b: Estimate) -> Estimate {
    let relative = |own: Estimate| own.standard_error / own.value;
    Estimate {
        value: 0.5 * (a.value / b.value).ln(),
        standard_error: 0.5 * relative(a).hypot(relative(b)),
    }
}

/// Change of the timestamp variance, where it is large enough; `None` for a smaller jitter in a twin without one.
fn jitter(given: &Twin, known: &MeasurementNoise, found: [&Scattering; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameTime);
    let least = effect.parameters[0].plausible.0;
    let changes =
        found.map(|own| difference(own.timestamp_variance_s2, known.timestamp_variance_s2));
    let Estimate { value: variance, standard_error: error } = found[0].timestamp_variance_s2;
    let value = variance.max(0.0).sqrt();
    let is_large_enough =
        least.powi(2) < changes[0].value.abs() && (has(given, effect) || 0.0 < changes[0].value);
    let speed = found[1].mean_square_speed;
    is_large_enough.then(|| Change {
        effect,
        changes,
        blocks: found.map(|own| own.blocks),
        value: Estimate { value, standard_error: error / (2.0 * value.max(least)) },
        unstated: Unstated::Variance(
            changes[1].value.abs() * speed,
            difference(found[1].timestamp_variance_s2, found[0].timestamp_variance_s2).value.abs()
                * speed,
        ),
    })
}

/// Change of the noise at rest, where its magnitude changed and not only its colour.
fn size(known: &MeasurementNoise, found: [&Scattering; 2], ratio: f64) -> Option<Change> {
    let still = found
        .map(|own| log_ratio(own.frame_to_frame_variance_m2, known.frame_to_frame_variance_m2));
    let whole = found.map(|own| log_ratio(own.total_variance_m2, known.total_variance_m2));
    let least = ratio.ln();
    let agree = (0..2).all(|k| {
        let (still, whole) = (still[k].value, whole[k].value);
        least < still.abs() && still * whole > 0.0 && 0.5 * still.abs() < whole.abs()
    });
    let ratio = still[0].value.exp();
    let variance = |k: usize| found[k].frame_to_frame_variance_m2.value;
    agree.then(|| Change {
        effect: noise_effect(Noise::Level),
        changes: still,
        blocks: found.map(|own| own.blocks),
        value: Estimate { value: ratio, standard_error: ratio * still[0].standard_error },
        unstated: Unstated::Variance(
            (variance(1) - known.frame_to_frame_variance_m2.value).abs(),
            (variance(1) - variance(0)).abs(),
        ),
    })
}

/// Change of the fraction of lost frames, where it is large enough; `None` for a smaller fraction in a twin without
/// lost frames.
fn losses(given: &Twin, known: &MeasurementNoise, problems: [&Problem<'_>; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameLoss);
    let known = known.lost_frame_fraction?;
    let found = [measure_losses(problems[0])?, measure_losses(problems[1])?];
    let changes = found.map(|own| difference(own.fraction, known));
    let change = changes[0].value;
    let is_large_enough =
        effect.parameters[0].plausible.0 < change.abs() && (has(given, effect) || 0.0 < change);
    is_large_enough.then(|| Change {
        effect,
        changes,
        blocks: found.map(|own| own.blocks),
        value: found[0].fraction,
        unstated: Unstated::FramesLost(
            changes[1].value.abs(),
            difference(found[1].fraction, found[0].fraction).value.abs(),
        ),
    })
}

/// Return whether `effect` changes the noise variance of the camera.
pub(super) fn is_variance_effect(effect: &Effect) -> bool {
    matches!(effect.physics, Physics::Noise(Noise::FrameTime | Noise::Level))
}

/// Return whether `twin` has the effect.
fn has(twin: &Twin, effect: &Effect) -> bool {
    twin.instance(effect.name, Axis::Whole).is_some()
}

fn noise_effect(kind: Noise) -> &'static Effect {
    let same = |effect: &&&Effect| matches!(effect.physics, Physics::Noise(own) if own == kind);
    effects::CATALOGUE.iter().copied().find(|effect| same(&effect)).expect("the catalogue has it")
}

/// Changes of the measurement noise at `points` (training, validation) of the two problems, compared with `given`;
/// `excess` is that of the squared residual over its reference.
pub(super) fn find(
    problems: [&Problem<'_>; 2],
    points: [&Point; 2],
    given: &Twin,
    excess: Option<Excess>,
) -> Vec<DetectedChange> {
    let [Some(fitted), Some(validated)] =
        [measure(problems[0], points[0]), measure(problems[1], points[1])]
    else {
        return Vec::new();
    };
    let stage = problems[0].parts[0].stage.kind();
    // Without reference noise there is no comparison: any frame-to-frame model error grows with speed like a jitter.
    let Some(known) = stated(given, stage) else { return Vec::new() };
    let found = [&fitted, &validated];
    let options = problems[0].context.options;
    let thresholds = options.thresholds();
    let variances =
        [jitter(given, &known, found), size(&known, found, (1.0 + thresholds.large_excess).sqrt())];
    let is_in = |own: &Change| options.selects(own.effect) && own.is_in(thresholds);
    let mut changes: Vec<Change> = variances.into_iter().flatten().filter(is_in).collect();
    let accounted: f64 = changes.iter().map(|own| own.unstated.variance()).sum();
    if excess.is_some_and(|own| {
        accounted < thresholds.majority * own.most * known.total_variance_m2.value
    }) {
        changes.clear();
    }
    changes.extend(losses(given, &known, problems).filter(is_in));
    let rms = problems[1].rms(points[1]);
    changes.into_iter().map(|own| own.detected(given, rms.clone())).collect()
}

impl DetectedChange {
    /// Return whether the noise variance changes, and not the number of frames.
    pub(super) fn changes_variance(&self) -> bool {
        is_variance_effect(self.instance.effect)
    }

    /// Apply the change to `twin`, and to the measurement noise of every stage with a camera.
    pub(super) fn apply_to(self, twin: &mut Twin) -> Option<Added> {
        let Self { step, mut instance } = self;
        let value = instance.values[0].value;
        for known in &mut twin.measurement_noise {
            match instance.effect.physics {
                Physics::Noise(Noise::FrameTime) => {
                    known.timestamp_variance_s2.value = value * value;
                }
                Physics::Noise(Noise::FrameLoss) => {
                    known.lost_frame_fraction =
                        known.lost_frame_fraction.map(|known| Estimate { value, ..known });
                }
                _ => {
                    known.frame_to_frame_variance_m2.value *= value * value;
                    known.total_variance_m2.value *= value * value;
                }
            }
        }
        match twin.instances.iter_mut().find(|own| own.effect == instance.effect) {
            Some(own) => {
                if matches!(own.effect.physics, Physics::Noise(Noise::Level)) {
                    let before = own.values[0].value;
                    let scaled = &mut instance.values[0];
                    scaled.value *= before;
                    scaled.ci95 = scaled.ci95.map(|ends| ends.map(|end| end * before));
                }
                own.values = instance.values;
            }
            None => twin.instances.push(instance),
        }
        step
    }
}
