//! Effects that change no value but its scatter, `sensor.frame_jitter` and `sensor.noise_model`, or how many values
//! there are, `sensor.frame_drop`: on the links whose output the camera measures.
//!
//! How the residual scatters from frame to frame, at rest and with the speed, is measured on the fitted and on the
//! judging sessions ([`scattering`]) and compared with what the given twin states, session against session as
//! everything else; so is the share of frames that were lost ([`FrameLosses`]). Noise that only changes its colour
//! is not named: it has the same size.

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

/// Tests of one recording: two effects on two links, and one on one.
const TRIES: usize = 5;

/// What is named or measured again.
pub(super) struct Named {
    /// For the findings, where the twin did not have it.
    pub(super) step: Option<Added>,
    instance: Instance,
}

/// The scatter of the camera on all sessions of `problem`; `None` on links that no camera measures, or with too
/// few frames.
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

/// How many frames all sessions of `problem` lost; `None` where no camera measures them.
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

/// One kind of change, on the fitted and on the judging sessions.
struct Change {
    effect: &'static Effect,
    /// Against zero for no change.
    changes: [Estimate; 2],
    blocks: [usize; 2],
    /// The effect's number and its standard error.
    value: Estimate,
    unstated: Unstated,
}

impl Change {
    /// Student's t and freedom of the fitted (0) or judging (1) sessions.
    fn t(&self, index: usize) -> (f64, f64) {
        let Estimate { value: change, standard_error: error } = self.changes[index];
        let freedom = self.blocks[index].saturating_sub(1).max(1) as f64;
        (if 0.0 < error { change / error } else { 0.0 }, freedom)
    }

    /// Two-sided probability of the fitted sessions' change by chance, corrected for all tries.
    fn p_value(&self) -> f64 {
        let (t, freedom) = self.t(0);
        (TRIES as f64 * f_tail(t * t, 1.0, freedom)).min(1.0)
    }

    /// Whether both kinds of sessions show it, with one sign.
    fn is_in(&self, thresholds: &Thresholds) -> bool {
        let (t, _) = self.t(0);
        let (judged, freedom) = self.t(1);
        self.p_value() < thresholds.family_error
            && t_quantile(1.0 - thresholds.confirmation_level, freedom) < judged * t.signum()
    }

    fn named(self, given: &Twin, rms: Vec<f64>) -> Named {
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
            class: Vec::new(),
            held_out_steps: (rms.clone(), rms),
            unstated: Some(self.unstated),
            contest: Vec::new(),
            numbers: Vec::new(),
        });
        Named {
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

/// The change of the time stamps' scatter, where it is large enough; `None` for a jitter that fell in a twin
/// without one.
fn jitter(given: &Twin, known: &MeasurementNoise, found: [&Scattering; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameTime);
    let least = effect.parameters[0].plausible.0;
    let changes =
        found.map(|own| difference(own.timestamp_variance_s2, known.timestamp_variance_s2));
    let Estimate { value: variance, standard_error: error } = found[0].timestamp_variance_s2;
    let value = variance.max(0.0).sqrt();
    let worth =
        least.powi(2) < changes[0].value.abs() && (has(given, effect) || 0.0 < changes[0].value);
    let speed = found[1].mean_square_speed;
    worth.then(|| Change {
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

/// The change of the scatter at rest, where its size changed and not only its colour.
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

/// The change of the share of frames lost, where it is large enough; `None` for a share that fell in a twin without
/// lost frames.
fn losses(given: &Twin, known: &MeasurementNoise, problems: [&Problem<'_>; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameLoss);
    let known = known.lost_frame_fraction?;
    let found = [measure_losses(problems[0])?, measure_losses(problems[1])?];
    let changes = found.map(|own| difference(own.fraction, known));
    let change = changes[0].value;
    let worth =
        effect.parameters[0].plausible.0 < change.abs() && (has(given, effect) || 0.0 < change);
    worth.then(|| Change {
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

/// Whether `effect` makes the values of the camera scatter.
pub(super) fn is_scatter(effect: &Effect) -> bool {
    matches!(effect.physics, Physics::Noise(Noise::FrameTime | Noise::Level))
}

/// Whether `twin` has the effect already.
fn has(twin: &Twin, effect: &Effect) -> bool {
    twin.instance(effect.name, Axis::Whole).is_some()
}

fn noise_effect(kind: Noise) -> &'static Effect {
    let same = |effect: &&&Effect| matches!(effect.physics, Physics::Noise(own) if own == kind);
    effects::CATALOGUE.iter().copied().find(|effect| same(&effect)).expect("the catalogue has it")
}

/// What the scatter at `points` (fitted, judging) of the two problems says beyond what `given` states;
/// `excess` is the share of the squared residual above what is known to be left.
pub(super) fn find(
    problems: [&Problem<'_>; 2],
    points: [&Point; 2],
    given: &Twin,
    excess: Option<Excess>,
) -> Vec<Named> {
    let [Some(fitted), Some(judged)] =
        [measure(problems[0], points[0]), measure(problems[1], points[1])]
    else {
        return Vec::new();
    };
    let link = problems[0].parts[0].stage.kind();
    // Where nothing is stated there is nothing to compare with: whatever a twin does not follow from frame to
    // frame grows with speed like a jitter.
    let Some(known) = stated(given, link) else { return Vec::new() };
    let found = [&fitted, &judged];
    let options = problems[0].context.options;
    let thresholds = options.thresholds();
    let scatter =
        [jitter(given, &known, found), size(&known, found, (1.0 + thresholds.large_excess).sqrt())];
    let is_in = |own: &Change| options.selects(own.effect) && own.is_in(thresholds);
    let mut changes: Vec<Change> = scatter.into_iter().flatten().filter(is_in).collect();
    let accounted: f64 = changes.iter().map(|own| own.unstated.variance()).sum();
    if excess.is_some_and(|own| {
        accounted < thresholds.majority * own.most * known.total_variance_m2.value
    }) {
        changes.clear();
    }
    changes.extend(losses(given, &known, problems).filter(is_in));
    let rms = problems[1].rms(points[1]);
    changes.into_iter().map(|own| own.named(given, rms.clone())).collect()
}

impl Named {
    /// Whether values scatter otherwise, rather than being fewer.
    pub(super) fn scatters(&self) -> bool {
        is_scatter(self.instance.effect)
    }

    /// Puts it into `twin`, and what it says of the camera beside every link that the camera measures.
    pub(super) fn put_into(self, twin: &mut Twin) -> Option<Added> {
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
