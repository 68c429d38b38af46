//! Single axes of a recording.

use super::{AxisStage, Measured};
use crate::{
    effects::InputKind,
    recording::{
        Recording, RecordingError,
        message::{AxisInput, AxisOutput},
        topic,
    },
    stats::median,
    units::Nanos,
};
use std::{collections::BTreeSet, f64::consts::TAU, ops::Range};

/// Length of the pieces into which long runs are cut (samples): an eighth of the run within these limits.
const PIECE: std::ops::RangeInclusive<f64> = 500.0..=2500.0;
/// Pieces of a run, and fewest of them into which a run is cut.
const PIECES: f64 = 8.0;
const LEAST_PIECES: f64 = 2.0;
/// Fewest samples of an axis that is compared.
const LEAST_SAMPLES: usize = 200;
/// Longest step between samples that is no pause, in usual steps.
const PAUSE_STEPS: f64 = 10.0;
/// Units of the input of a single axis: those of a force, of what makes one, or of a velocity setpoint.
pub(in crate::twin) const INPUT_UNITS: &[&str] = &["N", "N m", "A", "V", "m/s", "rad/s"];
/// Units of its position.
pub(in crate::twin) const POSITION_UNITS: &[&str] = &["m", "rad"];
/// Range of an angle that a sensor reports within one turn (rad), with room for rounding and noise.
const ONE_TURN: f64 = 1.01 * TAU;
/// Fewest samples of a segment that is filtered by itself.
const LEAST_SEGMENT: usize = 30;

/// Reasons why an axis of a recording cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum AxisError {
    /// The recording could not be decoded.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The input neither makes a force nor is a velocity setpoint.
    #[error(
        "axis '{name}' is driven by a {what} ({unit}); only a force, what makes one, or a velocity setpoint ({}) can be \
         compared by inverse dynamics",
        INPUT_UNITS.join(", ")
    )]
    OtherInput {
        /// The axis.
        name: String,
        /// Quantity of its input.
        what: &'static str,
        /// Unit of its input.
        unit: String,
    },
    /// The velocity setpoint is one of another coordinate.
    #[error(
        "axis '{name}' has a velocity setpoint in {unit} and a position in {position_unit}; import it with both in m or \
         both in rad (--input-scale converts the setpoint)"
    )]
    OtherCoordinate {
        /// The axis.
        name: String,
        /// Unit of its input.
        unit: &'static str,
        /// Unit of its position.
        position_unit: &'static str,
    },
    /// Too few samples to compare.
    #[error(
        "axis '{name}' has {found} samples of input and position at the same time; at least \
         {LEAST_SAMPLES} are needed"
    )]
    TooShort {
        /// The axis.
        name: String,
        /// Number of samples.
        found: usize,
    },
}

impl AxisStage {
    /// Every axis of `recording` that has both input and output, in `spans` (seconds since the
    /// recording began); long spans are cut into pieces.
    ///
    /// # Errors
    /// When messages do not decode, an input has another unit, or an axis is too short.
    pub fn from_recording(
        recording: &Recording,
        spans: &[Range<f64>],
    ) -> Result<Vec<Self>, AxisError> {
        let origin = recording.time_range().map_or(Nanos(0), |(first, _)| first);
        let marked: Vec<Range<f64>> =
            recording.marked_runs()?.iter().map(|run| run.seconds_since(origin)).collect();
        let mut stages = Vec::new();
        for name in names(recording) {
            let (measured, pauses) = measured(recording, name)?;
            let segments = segments(&measured, &marked, &pauses);
            let runs: Vec<Range<f64>> =
                spans.iter().flat_map(|run| pieces(run, measured.dt)).collect();
            stages.push(Self::in_segments(measured, segments, &runs));
        }
        Ok(stages)
    }
}

/// Names of the axes with input and output, in order.
fn names(recording: &Recording) -> Vec<String> {
    let name_of = |channel: &crate::recording::Channel, end: &str| {
        let rest = channel.topic.strip_prefix("/axis/")?.strip_suffix(end)?;
        (!channel.messages.is_empty() && !rest.is_empty()).then(|| rest.to_owned())
    };
    let with = |end: &str| -> BTreeSet<String> {
        recording.channels.iter().filter_map(|channel| name_of(channel, end)).collect()
    };
    with("/input").intersection(&with("/output")).cloned().collect()
}

/// A run, or the equal pieces of a long one, of samples that are `dt` apart (s).
fn pieces(run: &Range<f64>, dt: f64) -> Vec<Range<f64>> {
    let length = run.end - run.start;
    let piece = dt * (length / dt / PIECES).clamp(*PIECE.start(), *PIECE.end());
    let count = if LEAST_PIECES * piece < length { (length / piece).round() } else { 1.0 };
    let border = |k: usize| run.start + length * k as f64 / count;
    (0..count as usize).map(|k| border(k)..border(k + 1)).collect()
}

/// Input and position of axis `name` at the equal steps of its output, and the pauses of the recording (s).
fn measured(recording: &Recording, name: String) -> Result<(Measured, Vec<Range<f64>>), AxisError> {
    let origin = recording.time_range().map_or(Nanos(0), |(first, _)| first);
    let inputs = recording.series::<AxisInput>(&topic::axis_input(&name))?;
    let outputs = recording.series::<AxisOutput>(&topic::axis_output(&name))?;
    let recorded = inputs.values.first().map_or("", |first| first.unit.as_str());
    let unit = unit_of(recorded, &name)?;
    let recorded = outputs.values.first().map_or("", |first| first.position_unit.as_str());
    let position_unit = position_unit(recorded, unit);
    if unit.ends_with("/s") && InputKind::of(unit, position_unit) != InputKind::Velocity {
        return Err(AxisError::OtherCoordinate { name, unit, position_unit });
    }
    let input: Vec<(f64, f64)> =
        inputs.iter().map(|(time, message)| (time.seconds_since(origin), message.value)).collect();
    let mut position: Vec<(f64, f64)> = outputs
        .iter()
        .filter_map(|(time, message)| Some((time.seconds_since(origin), message.position?)))
        .collect();
    let mut velocity: Option<Vec<(f64, f64)>> = None;
    if position.is_empty() {
        let measured = outputs
            .iter()
            .filter_map(|(time, message)| Some((time.seconds_since(origin), message.velocity?)));
        position = integrated(velocity.insert(measured.collect()));
    }
    if position_unit == "rad" {
        unwrap_turns(&mut position);
    }
    let found = position.len().min(input.len());
    if found < LEAST_SAMPLES {
        return Err(AxisError::TooShort { name, found });
    }
    let steps: Vec<f64> = position.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    // Stamps are whole nanoseconds.
    let dt = (median(&steps).unwrap_or(0.0) * 1e9).round() * 1e-9;
    let start = position[0].0.max(input[0].0);
    let end = position[position.len() - 1].0.min(input[input.len() - 1].0);
    let count = if dt > 0.0 && start < end { ((end - start) / dt + 1e-6) as usize + 1 } else { 0 };
    if count < LEAST_SAMPLES {
        return Err(AxisError::TooShort { name, found: count });
    }
    let pauses = [&position, &input].into_iter().flat_map(|samples| pauses(samples, dt)).collect();
    let measured = Measured {
        input: resampled(&input, start, dt, count),
        position: resampled(&position, start, dt, count),
        velocity: velocity.map(|velocity| resampled(&velocity, start, dt, count)),
        name,
        unit,
        position_unit,
        start,
        dt,
    };
    Ok((measured, pauses))
}

/// Make an angle (rad) continuous that a sensor reports within one turn. A step of more than half a turn is one of less
/// than half a turn the other way. An angle beyond one turn was counted by the sensor and stays, and so does one that
/// jumps in pauses only.
fn unwrap_turns(samples: &mut [(f64, f64)]) {
    let values = samples.iter().map(|(_, angle)| *angle);
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(f64::NEG_INFINITY, f64::max);
    let longest = PAUSE_STEPS * median_step(samples);
    let is_jump = |pair: &[(f64, f64)]| {
        0.5 * TAU < (pair[1].1 - pair[0].1).abs() && pair[1].0 - pair[0].0 <= longest
    };
    if ONE_TURN < high - low || !samples.windows(2).any(is_jump) {
        return;
    }
    let mut turns = 0.0;
    let mut last = samples.first().map_or(0.0, |(_, angle)| *angle);
    for (_, angle) in samples {
        turns -= ((*angle - last) / TAU).round();
        last = *angle;
        *angle += TAU * turns;
    }
}

/// Steps of `samples` that are pauses, given the usual step `dt` (s).
fn pauses(samples: &[(f64, f64)], dt: f64) -> Vec<Range<f64>> {
    let usual = dt.max(median_step(samples));
    let steps = samples.windows(2).map(|pair| pair[0].0..pair[1].0);
    steps.filter(|step| PAUSE_STEPS * usual < step.end - step.start).collect()
}

/// Median step of `samples` (s).
fn median_step(samples: &[(f64, f64)]) -> f64 {
    let steps: Vec<f64> = samples.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    median(&steps).unwrap_or(0.0)
}

/// Samples of `measured` without interruption: each marked run by itself, or everything where there are no marks, cut
/// at `pauses` (s). Too short segments are left out.
fn segments(
    measured: &Measured,
    marked: &[Range<f64>],
    pauses: &[Range<f64>],
) -> Vec<Range<usize>> {
    let count = measured.position.len();
    let at = |time: f64| ((time - measured.start) / measured.dt - 1e-6).ceil().max(0.0) as usize;
    let mut segments: Vec<Range<usize>> = match marked {
        [] => std::iter::once(0..count).collect(),
        runs => runs.iter().map(|run| at(run.start).min(count)..at(run.end).min(count)).collect(),
    };
    segments.sort_by_key(|own| own.start);
    for pause in pauses {
        // The last sample before it, and the first one after it.
        let (before, after) = (at(pause.start) + 1, at(pause.end));
        segments = segments
            .into_iter()
            .flat_map(|own| {
                let cut = before.clamp(own.start, own.end);
                [own.start..cut, after.clamp(cut, own.end)..own.end]
            })
            .collect();
    }
    let mut end = 0;
    for own in &mut segments {
        own.start = own.start.max(end);
        end = end.max(own.end);
    }
    segments.retain(|own| own.start + LEAST_SEGMENT <= own.end);
    segments
}

/// The unit of an input.
pub(in crate::twin) fn unit_of(recorded: &str, name: &str) -> Result<&'static str, AxisError> {
    let written = if recorded == "Nm" { "N m" } else { recorded };
    INPUT_UNITS.iter().find(|unit| **unit == written).copied().ok_or_else(|| {
        let what = match recorded {
            "m" | "rad" => "position",
            _ => "quantity of another unit",
        };
        AxisError::OtherInput { name: name.to_owned(), what, unit: recorded.to_owned() }
    })
}

/// The unit of the position of an axis with an input in `input_unit`; `recorded` may be empty.
pub(in crate::twin) fn position_unit(recorded: &str, input_unit: &str) -> &'static str {
    match recorded {
        "rad" => "rad",
        "" if ["N m", "rad/s"].contains(&input_unit) => "rad",
        _ => "m",
    }
}

/// Positions from velocities, from zero, by trapezia.
fn integrated(velocities: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut before: Option<(f64, f64)> = None;
    let mut position = 0.0;
    velocities
        .iter()
        .map(|&(time, velocity)| {
            if let Some((earlier, last)) = before {
                position += 0.5 * (time - earlier) * (velocity + last);
            }
            before = Some((time, velocity));
            (time, position)
        })
        .collect()
}

/// Samples at equal steps, by linear interpolation of the recorded ones.
pub(in crate::twin) fn resampled(
    samples: &[(f64, f64)],
    start: f64,
    dt: f64,
    count: usize,
) -> Vec<f64> {
    let mut k = 0;
    (0..count)
        .map(|index| {
            let time = start + dt * index as f64;
            while k + 2 < samples.len() && samples[k + 1].0 <= time {
                k += 1;
            }
            let ((t0, y0), (t1, y1)) = (samples[k], samples[k + 1]);
            let share = if t0 < t1 { ((time - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { 0.0 };
            y0 + share * (y1 - y0)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_runs_are_cut_and_short_ones_kept() {
        assert_eq!(pieces(&(1.0..1.9), 1e-3), [1.0..1.9]);
        assert_eq!(pieces(&(10.0..20.0), 1e-3).len(), 8);
        assert_eq!(pieces(&(10.0..70.0), 1e-3).len(), 24);
        let slow = pieces(&(10.0..50.0), 0.02);
        assert_eq!(slow, [10.0..20.0, 20.0..30.0, 30.0..40.0, 40.0..50.0]);
    }

    #[test]
    fn samples_between_stamps_lie_on_the_line() {
        let samples = [(0.0, 1.0), (0.1, 2.0), (0.3, 4.0)];
        assert_eq!(resampled(&samples, 0.05, 0.1, 3), [1.5, 2.5, 3.5]);
    }

    #[test]
    fn an_angle_within_one_turn_becomes_continuous() {
        const ROUNDING: f64 = 1e-9;
        let angle = |k: usize| 9.0 * (0.05 * k as f64).sin() + 0.3;
        let turned: Vec<(f64, f64)> = (0..400).map(|k| (0.01 * k as f64, angle(k))).collect();
        for (low, sign) in [(0.0, 1.0), (-0.5 * TAU, 1.0), (0.0, -1.0)] {
            let mut wrapped: Vec<(f64, f64)> = turned
                .iter()
                .map(|(time, own)| (*time, low + (sign * own - low).rem_euclid(TAU)))
                .collect();
            unwrap_turns(&mut wrapped);
            let shift = wrapped[0].1 - sign * turned[0].1;
            assert!((shift / TAU - (shift / TAU).round()).abs() < ROUNDING);
            let is_same = |(found, truth): (&(f64, f64), &(f64, f64))| {
                (found.1 - sign * truth.1 - shift).abs() < ROUNDING
            };
            assert!(wrapped.iter().zip(&turned).all(is_same));
        }
        // Angles that were counted beyond a turn, that jump in a pause, or that never jump remain
        // unchanged.
        let fast = (0..400).map(|k| (0.01 * k as f64, 4.0 * k as f64)).collect();
        let second_run = (0..400).map(|k| {
            (0.01 * k as f64 + if k < 200 { 0.0 } else { 9.0 }, if k < 200 { 1.0 } else { 5.0 })
        });
        let slow = (0..400).map(|k| (0.01 * k as f64, (0.05 * k as f64).sin())).collect();
        for samples in [fast, second_run.collect(), slow] {
            let mut unwrapped: Vec<(f64, f64)> = samples;
            let before = unwrapped.clone();
            unwrap_turns(&mut unwrapped);
            assert_eq!(unwrapped, before);
        }
    }

    #[test]
    fn segments_end_at_runs_and_pauses() {
        let measured = |count: usize| Measured {
            name: "slide".into(),
            unit: "N",
            position_unit: "m",
            start: 0.0,
            dt: 0.01,
            input: vec![0.0; count],
            position: vec![0.0; count],
            velocity: None,
        };
        let whole = segments(&measured(1000), &[], &[]);
        assert_eq!((whole.len(), &whole[0]), (1, &(0..1000)));
        let pause = 2.0..3.0;
        let cut = segments(&measured(1000), &[], std::slice::from_ref(&pause));
        assert_eq!(cut, [0..201, 300..1000]);
        let marked = [1.0..4.0, 4.0..8.0];
        assert_eq!(segments(&measured(1000), &marked, &[]), [100..400, 400..800]);
        assert_eq!(
            segments(&measured(1000), &marked, std::slice::from_ref(&pause)),
            [100..201, 300..400, 400..800]
        );
        let samples: Vec<(f64, f64)> = (0..100)
            .map(|k| (0.01 * f64::from(k) + if 50 <= k { 1.0 } else { 0.0 }, 0.0))
            .collect();
        assert_eq!(pauses(&samples, 0.01).len(), 1);
    }

    #[test]
    fn an_input_of_another_unit_is_named() {
        let error = unit_of("m", "slide").expect_err("a position is no input").to_string();
        assert!(error.contains("axis 'slide' is driven by a position (m)"), "{error}");
        assert!(error.contains("(N, N m, A, V, m/s, rad/s)"), "{error}");
        assert_eq!(unit_of("Nm", "slide").ok(), Some("N m"));
        assert_eq!(unit_of("rad/s", "slide").ok(), Some("rad/s"));
    }

    #[test]
    fn a_position_without_unit_is_an_angle_where_the_input_turns() {
        let units = ["N m", "rad/s", "m/s", "N"].map(|input| position_unit("", input));
        assert_eq!(units, ["rad", "rad", "m", "m"]);
        assert_eq!([position_unit("rad", "V"), position_unit("m", "rad/s")], ["rad", "m"]);
    }
}
