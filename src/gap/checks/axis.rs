//! Checks of single axes, over all sessions of one axis: motion, both directions, a varying input, and a motion that
//! the input explains.

use super::{Objection, objection};
use crate::{
    effects::InputKind,
    gap::{
        evidence::least_squares, explain::significant, findings::Verdict, thresholds::Thresholds,
        whiten::Layout,
    },
    recording::Split,
    twin::{AxisStage, Channel, Session, Stage as _},
};

/// First refusal of the axes of `sessions`, if any.
pub(super) fn check_axes(sessions: &[Session], thresholds: &Thresholds) -> Option<Objection> {
    let mut names: Vec<&str> = Vec::new();
    for axis in sessions.iter().flat_map(|session| &session.axes) {
        let name = axis.channels()[0].signal.as_str();
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names.into_iter().find_map(|name| {
        let of = |split: Split| -> Vec<&AxisStage> {
            let own = sessions.iter().filter(|session| session.split == split);
            own.flat_map(|session| &session.axes)
                .filter(|axis| axis.channels()[0].signal == name)
                .collect()
        };
        check(name, &of(Split::Train), thresholds)
            .or_else(|| check_validation(name, &of(Split::Validation)))
    })
}

/// Refusal of the axis with the signal `name`, if its validation sessions leave nothing to compare.
fn check_validation(name: &str, sessions: &[&AxisStage]) -> Option<Objection> {
    if sessions.is_empty() || sessions.iter().any(|axis| compares_any(axis)) {
        return None;
    }
    objection(
        Verdict::NotTestable,
        format!(
            "{name}: no sample of the validation sessions can be compared: their stretches of motion are too short after \
             filtering; record longer moves, or at a higher rate"
        ),
    )
}

/// Return whether a stretch of motion is long enough to be compared.
fn compares_any(axis: &AxisStage) -> bool {
    let is_measured =
        |channel: &Channel| channel.measured.iter().map(|own| own.is_finite()).collect();
    let usable: Vec<Vec<bool>> = axis.channels().iter().map(is_measured).collect();
    !Layout::new(axis, &usable).rows.is_empty()
}

/// Refusal of the axis with the signal `name`, from its training sessions.
fn check(name: &str, train: &[&AxisStage], thresholds: &Thresholds) -> Option<Objection> {
    if train.is_empty() {
        return None;
    }
    let sums = train.iter().map(|axis| axis.input_variation());
    let [within, square] = sums.fold([0.0; 2], |all, own| [all[0] + own[0], all[1] + own[1]]);
    if within <= thresholds.min_fraction.powi(2) * square {
        return objection(
            Verdict::NotTestable,
            format!(
                "{name}: the input does not vary within the runs, so inertia and friction cannot be determined; record \
                 moves with accelerations in both directions"
            ),
        );
    }
    let ways = train.iter().map(|axis| axis.ways());
    let [up, down] = ways.fold([0.0; 2], |all, own| [all[0] + own[0], all[1] + own[1]]);
    if up + down == 0.0 {
        return objection(
            Verdict::InputNotConnected,
            format!(
                "{name}: the input varies and the axis does not move: the motor was off, or input and position belong to \
                 different axes; record again with the drive armed"
            ),
        );
    }
    let (_, unit) = train[0].units();
    if up.min(down) < thresholds.min_fraction * (up + down) {
        return objection(
            Verdict::NotTestable,
            format!(
                "{name}: the training sessions went {} {unit} up and {} {unit} down: from one direction, friction and \
                 offset cannot be distinguished; record moves both ways",
                significant(up),
                significant(down)
            ),
        );
    }
    let samples: Vec<[f64; 5]> = train.iter().flat_map(|axis| axis.motion_and_input()).collect();
    if (samples.len() as f64) < thresholds.min_samples {
        return objection(
            Verdict::NotTestable,
            format!(
                "{name}: only {} samples in motion remain after filtering, at least {} are needed; record \
                 longer, or at a higher rate",
                samples.len(),
                thresholds.min_samples
            ),
        );
    }
    check_connection(name, train[0].input_kind(), &samples, thresholds)
}

/// Refusal where input and motion are not those of one axis; `samples` are input, acceleration, velocity, direction and
/// position.
fn check_connection(
    name: &str,
    kind: InputKind,
    samples: &[[f64; 5]],
    thresholds: &Thresholds,
) -> Option<Objection> {
    let column = |k: usize| -> Vec<f64> {
        let mean = samples.iter().map(|own| own[k]).sum::<f64>() / samples.len() as f64;
        let centred: Vec<f64> = samples.iter().map(|own| own[k] - mean).collect();
        let size = centred.iter().map(|value| value * value).sum::<f64>().sqrt();
        centred.into_iter().map(|value| value / size.max(f64::MIN_POSITIVE)).collect()
    };
    let input = column(0);
    let motion: Vec<Vec<f64>> =
        (1..5).map(column).filter(|own| own.iter().any(|value| *value != 0.0)).collect();
    let weights = least_squares(&motion, &input)?;
    let explained = explained_by(&motion, &input);
    let set = match kind {
        InputKind::Force => 0,
        InputKind::Velocity => 1,
    };
    let mut others = motion.clone();
    others.remove(set);
    let of_set = explained - explained_by(&others, &input);
    let percent = 100.0 * explained.max(0.0);
    if explained < thresholds.min_fraction {
        return objection(
            Verdict::InputNotConnected,
            format!(
                "{name}: acceleration, velocity, direction and position explain {percent:.0} % of the input: the axis was \
                 moved by something else, or input and position belong to different axes or clocks"
            ),
        );
    }
    let is_against =
        weights[set] < 0.0 && (explained < thresholds.majority || thresholds.clear_gain < of_set);
    let what = match kind {
        InputKind::Force => {
            "accelerates against its input, so its inertia would be below zero: the input is not the force that moves it"
        }
        InputKind::Velocity => {
            "moves against its setpoint: the input is not the velocity that it follows"
        }
    };
    let advice = "or one sign is wrong; check the signs of input and position";
    is_against
        .then(|| objection(Verdict::NotTestable, format!("{name}: the axis {what}, {advice}")))
        .flatten()
}

/// Fraction of the squared length of `values` (one) that `columns` explain.
fn explained_by(columns: &[Vec<f64>], values: &[f64]) -> f64 {
    let Some(weights) = least_squares(columns, values) else { return 0.0 };
    let explained = |k: usize| -> f64 {
        columns.iter().zip(&weights).map(|(column, weight)| weight * column[k]).sum()
    };
    1.0 - values.iter().enumerate().map(|(k, value)| (value - explained(k)).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    /// Samples of an axis in a sum of two sines, with the `input` as a function of acceleration, velocity, position and
    /// a random number.
    fn samples(input: impl Fn([f64; 3], f64) -> f64) -> Vec<[f64; 5]> {
        let mut random = Stream::new(1, "input");
        (0..2000)
            .map(|k| {
                let t = 0.01 * f64::from(k);
                let [mut q, mut v, mut a] = [0.0; 3];
                for (size, rate) in [(0.05, 3.0), (0.01, 11.0)] {
                    let (sine, cosine) = (rate * t).sin_cos();
                    q += size * sine;
                    v += size * rate * cosine;
                    a -= size * rate * rate * sine;
                }
                [input([a, v, q], f64::from(random.uniform_f32(-1.0, 1.0))), a, v, v.signum(), q]
            })
            .collect()
    }

    fn verdict(input: impl Fn([f64; 3], f64) -> f64) -> Option<Verdict> {
        verdict_of(InputKind::Force, input)
    }

    fn verdict_of(kind: InputKind, input: impl Fn([f64; 3], f64) -> f64) -> Option<Verdict> {
        check_connection("axis.slide.force", kind, &samples(input), &Thresholds::DEFAULT)
            .map(|own| own.verdict)
    }

    #[test]
    fn an_input_that_the_motion_explains_is_connected_in_any_unit() {
        for unit in [1e-3, 1.0, 1e3] {
            let force = |[a, v, q]: [f64; 3], noise: f64| {
                unit * (3.0 * a + 8.0 * v + 1.5 * v.signum() + 20.0 * q + 2.0 * noise)
            };
            assert_eq!(verdict(force), None);
        }
    }

    #[test]
    fn a_random_input_is_not_connected_and_one_of_the_wrong_sign_is_refused() {
        assert_eq!(verdict(|_, noise| noise), Some(Verdict::InputNotConnected));
        assert_eq!(verdict(|[a, v, _], _| -3.0 * a - 8.0 * v), Some(Verdict::NotTestable));
    }

    #[test]
    fn a_setpoint_has_the_sign_of_the_velocity_and_any_phase() {
        let of = |input: fn([f64; 3], f64) -> f64| verdict_of(InputKind::Velocity, input);
        assert_eq!(of(|[a, v, _], _| v + 0.02 * a), None);
        assert_eq!(of(|[a, v, _], _| v - 0.002 * a), None, "time stamps may lead");
        assert_eq!(of(|[_, v, _], _| -v), Some(Verdict::NotTestable));
    }
}
