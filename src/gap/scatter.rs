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
    rounds::{Added, FAMILY_ERROR, LEVEL, Unstated},
};
use crate::{
    effects::{self, Axis, Effect, Noise, Physics},
    stats::{f_tail, t_quantile},
    twin::{
        Instance, Scatter, Source, StageKind, Twin, Value,
        noise::{FRAMES_OF_A_BLOCK, FrameLosses, LostShare, Scattering, scattering},
    },
};

/// Tests of one recording: two effects on two links, and one on one.
const TRIES: f64 = 5.0;

/// Least change of the scatter's size that is worth a name.
const LEAST_RATIO: f64 = 1.15;

/// Least standard deviation of the time stamps that is worth a name (s).
const LEAST_JITTER_S: f64 = 1e-4;

/// Least share of frames lost that is worth a name.
const LEAST_LOST: f64 = 0.005;

/// Share of what a known twin leaves more than before that the scatter must account for.
const ACCOUNTS_FOR: f64 = 0.5;

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
fn measure_losses(problem: &Problem<'_>) -> Option<LostShare> {
    let losses = problem.parts.iter().map(|part| part.stage.frame_losses());
    FrameLosses::share(&losses.collect::<Option<Vec<_>>>()?)
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

/// What is stated of the scatter of `link`.
fn stated(twin: &Twin, link: StageKind) -> Option<Scatter> {
    twin.scatter.iter().find(|own| own.link == link).copied()
}

/// States the scatter of `problem` at `point`, and its lost frames, as they are.
pub(super) fn state(twin: &mut Twin, problem: &Problem<'_>, point: &Point) {
    let Some(found) = measure(problem, point) else { return };
    let link = problem.parts[0].stage.kind();
    twin.scatter.retain(|own| own.link != link);
    twin.scatter.push(Scatter {
        link,
        stamp_variance_s2: found.stamp_variance_s2,
        still_variance_m2: found.still_variance_m2,
        whole_variance_m2: found.whole_variance_m2,
        lost_share: measure_losses(problem).map(|lost| lost.share),
    });
}

/// A value and its standard error.
type Estimate = (f64, f64);

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
        let (change, error) = self.changes[index];
        let freedom = self.blocks[index].saturating_sub(1).max(1) as f64;
        (if 0.0 < error { change / error } else { 0.0 }, freedom)
    }

    /// Two-sided probability of the fitted sessions' change by chance, corrected for all tries.
    fn p_value(&self) -> f64 {
        let (t, freedom) = self.t(0);
        (TRIES * f_tail(t * t, 1.0, freedom)).min(1.0)
    }

    /// Whether both kinds of sessions show it, with one sign.
    fn is_in(&self) -> bool {
        let (t, _) = self.t(0);
        let (judged, freedom) = self.t(1);
        self.p_value() < FAMILY_ERROR && t_quantile(1.0 - LEVEL, freedom) < judged * t.signum()
    }

    fn named(self, given: &Twin, rms: Vec<f64>) -> Named {
        let (value, error) = self.value;
        let half = t_quantile(0.975, self.t(0).1) * error;
        let (before, after) = self.unstated.ends();
        let number =
            Value { value, ci95: Some([value - half, value + half]), source: Source::Fitted };
        let step = (!has(given, self.effect)).then(|| Added {
            effect: self.effect,
            axis: Axis::Whole,
            p_value: self.p_value(),
            statistic: self.t(0).0.powi(2),
            held_out_gain: 1.0 - after / before.max(f64::MIN_POSITIVE),
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
    (a.0 - b.0, a.1.hypot(b.1))
}

/// Logarithm of the ratio of two standard deviations, from their variances.
fn log_ratio(a: Estimate, b: Estimate) -> Estimate {
    (0.5 * (a.0 / b.0).ln(), 0.5 * (a.1 / a.0).hypot(b.1 / b.0))
}

/// The change of the time stamps' scatter, where it is large enough; `None` for a jitter that fell in a twin
/// without one.
fn jitter(given: &Twin, known: &Scatter, found: [&Scattering; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameTime);
    let changes = found.map(|own| difference(own.stamp_variance_s2, known.stamp_variance_s2));
    let (variance, error) = found[0].stamp_variance_s2;
    let value = variance.max(0.0).sqrt();
    let worth =
        LEAST_JITTER_S.powi(2) < changes[0].0.abs() && (has(given, effect) || 0.0 < changes[0].0);
    let speed = found[1].mean_square_speed;
    worth.then(|| Change {
        effect,
        changes,
        blocks: found.map(|own| own.blocks),
        value: (value, error / (2.0 * value.max(LEAST_JITTER_S))),
        unstated: Unstated::Variance(
            changes[1].0.abs() * speed,
            difference(found[1].stamp_variance_s2, found[0].stamp_variance_s2).0.abs() * speed,
        ),
    })
}

/// The change of the scatter at rest, where its size changed and not only its colour.
fn size(known: &Scatter, found: [&Scattering; 2]) -> Option<Change> {
    let still = found.map(|own| log_ratio(own.still_variance_m2, known.still_variance_m2));
    let whole = found.map(|own| log_ratio(own.whole_variance_m2, known.whole_variance_m2));
    let least = LEAST_RATIO.ln();
    let agree = (0..2).all(|k| {
        least < still[k].0.abs()
            && still[k].0 * whole[k].0 > 0.0
            && 0.5 * still[k].0.abs() < whole[k].0.abs()
    });
    let ratio = still[0].0.exp();
    let variance = |k: usize| found[k].still_variance_m2.0;
    agree.then(|| Change {
        effect: noise_effect(Noise::Level),
        changes: still,
        blocks: found.map(|own| own.blocks),
        value: (ratio, ratio * still[0].1),
        unstated: Unstated::Variance(
            (variance(1) - known.still_variance_m2.0).abs(),
            (variance(1) - variance(0)).abs(),
        ),
    })
}

/// The change of the share of frames lost, where it is large enough; `None` for a share that fell in a twin without
/// lost frames.
fn losses(given: &Twin, known: &Scatter, problems: [&Problem<'_>; 2]) -> Option<Change> {
    let effect = noise_effect(Noise::FrameLoss);
    let known = known.lost_share?;
    let found = [measure_losses(problems[0])?, measure_losses(problems[1])?];
    let changes = found.map(|own| difference(own.share, known));
    let change = changes[0].0;
    let worth = LEAST_LOST < change.abs() && (has(given, effect) || 0.0 < change);
    worth.then(|| Change {
        effect,
        changes,
        blocks: found.map(|own| own.blocks),
        value: found[0].share,
        unstated: Unstated::FramesLost(
            changes[1].0.abs(),
            (found[1].share.0 - found[0].share.0).abs(),
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
    let scatter = [jitter(given, &known, found), size(&known, found)];
    let mut changes: Vec<Change> = scatter.into_iter().flatten().filter(Change::is_in).collect();
    let accounted: f64 = changes.iter().map(|own| own.unstated.variance()).sum();
    if excess.is_some_and(|own| accounted < ACCOUNTS_FOR * own.most * known.whole_variance_m2.0) {
        changes.clear();
    }
    changes.extend(losses(given, &known, problems).filter(Change::is_in));
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
        for known in &mut twin.scatter {
            match instance.effect.physics {
                Physics::Noise(Noise::FrameTime) => known.stamp_variance_s2.0 = value * value,
                Physics::Noise(Noise::FrameLoss) => {
                    known.lost_share = known.lost_share.map(|(_, error)| (value, error));
                }
                _ => {
                    known.still_variance_m2.0 *= value * value;
                    known.whole_variance_m2.0 *= value * value;
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
