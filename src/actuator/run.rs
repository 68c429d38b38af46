//! Resampling of recordings to runs on a regular grid.
//!
//! Each run is sampled at `t_k = t_0 + k dt` by message time, with `t_0` on its first command:
//! - `u_k` is the mean over `[t_k, t_k + dt)` of the command under a zero-order hold from its own
//!   time stamp. A late command counts from its arrival, so latency stays visible.
//! - `v_k` is the measured velocity at `t_k`: the encoder velocity interpolated between messages,
//!   or the slope of a local parabola through the camera positions.
//!
//! A dropout of commands or motion ends a piece of a run. No window spans a dropout.

use super::{ActuatorError, layout::AXES};
use crate::{
    recording::{
        FrameTimes, MarkedRun, Recording, RecordingError, Series, Split,
        message::{CameraDetections, CarriageState, VelocityCommand},
        topic::{self, Player},
    },
    units::Nanos,
};
use serde::{Deserialize, Serialize};
use std::{ops::Range, path::PathBuf};

/// Longest dropout of commands or measurements inside one piece (s): five control periods of the
/// table. The table's controller tolerates an old command for the same time.
const LONGEST_DROPOUT: f64 = 0.1;

/// Half width of the window of camera positions for one velocity (s): three frames at 120 Hz.
const CAMERA_HALF_WINDOW: f64 = 0.0255;

/// Motion predicted by the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    /// Carriage velocity from the motor encoders.
    Carriage,
    /// Striker velocity from the camera's positions.
    Striker,
}

/// Settings of the resampling.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ResampleConfig {
    /// Predicted motion.
    pub target: Target,
    /// Samples per second; 50 is the rate at which the table is controlled.
    pub rate_hz: f64,
}

/// One uninterrupted piece of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// The recording.
    pub path: PathBuf,
    /// Position of the recording among the inputs.
    pub file: usize,
    /// Number in the run markers; 0 without markers.
    pub number: u32,
    /// Pattern in the run markers; `unknown` without.
    pub pattern: String,
    /// Split given by the recording.
    pub split: Option<Split>,
    /// Time of sample 0.
    pub start: Nanos,
    /// `u_k` in x and y (m/s).
    pub commands: Vec<[f64; AXES]>,
    /// `v_k` in x and y (m/s), as many as commands.
    pub velocities: Vec<[f64; AXES]>,
}

impl Run {
    /// Return the number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.velocities.len()
    }

    /// Return whether the run has no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.velocities.is_empty()
    }
}

/// Return the players that have both commands and motion.
pub(super) fn players_of(recording: &Recording, target: Target) -> Vec<Player> {
    let moves = |player: &Player| match target {
        Target::Carriage => recording.count(&topic::carriage(*player)),
        Target::Striker => recording.count(topic::CAMERA_DETECTIONS),
    };
    let commanded = |player: &Player| recording.count(&topic::command(*player));
    Player::BOTH.into_iter().filter(|p| 0 < commanded(p) && 0 < moves(p)).collect()
}

/// Cut one recording into runs on the grid.
///
/// # Errors
/// When a topic is missing, a value is not finite, time runs backwards, or the signals never
/// change.
pub fn resample(
    recording: &Recording,
    file: usize,
    player: Player,
    config: ResampleConfig,
) -> Result<Vec<Run>, ActuatorError> {
    let command_topic = topic::command(player);
    let commands = command_track(recording, &command_topic)?;
    let (motion_topic, motion) = match config.target {
        Target::Carriage => {
            let topic = topic::carriage(player);
            let track = carriage_track(recording, &topic)?;
            (topic, Motion::Velocity(track))
        }
        Target::Striker => {
            let topic = topic::CAMERA_DETECTIONS.to_owned();
            let track = striker_track(recording, &topic, player)?;
            (topic, Motion::Position(track))
        }
    };
    let mut runs = Vec::new();
    for marked in runs_or_whole(recording)? {
        for piece in pieces(&commands, motion.track(), &marked.span) {
            let mut run = Run {
                path: recording.path.clone(),
                file,
                number: marked.number,
                pattern: marked.pattern.clone(),
                split: marked.split,
                start: piece.start,
                commands: Vec::new(),
                velocities: Vec::new(),
            };
            sample(&mut run, &piece, &commands, &motion, 1.0 / config.rate_hz);
            runs.push(run);
        }
    }
    check_moves(recording, &runs, [&command_topic, &motion_topic])?;
    Ok(runs)
}

/// Two signals over time; times never decrease.
struct Track {
    times: Vec<Nanos>,
    values: Vec<[f64; AXES]>,
}

/// Measured motion.
enum Motion {
    Velocity(Track),
    Position(Track),
}

impl Motion {
    fn track(&self) -> &Track {
        match self {
            Self::Velocity(track) | Self::Position(track) => track,
        }
    }

    fn velocity_at(&self, time: Nanos) -> [f64; AXES] {
        match self {
            Self::Velocity(track) => interpolate(track, time),
            Self::Position(track) => parabola_slope(track, time),
        }
    }
}

fn command_track(recording: &Recording, topic: &str) -> Result<Track, ActuatorError> {
    let series: Series<VelocityCommand> = present(recording, topic)?;
    let values = series.values.iter().map(|c| [c.vx, c.vy]).collect();
    finite(recording, topic, Track { times: series.times, values }, ["vx", "vy"])
}

fn carriage_track(recording: &Recording, topic: &str) -> Result<Track, ActuatorError> {
    let series: Series<CarriageState> = present(recording, topic)?;
    let values = series.values.iter().map(|c| [c.vx, c.vy]).collect();
    finite(recording, topic, Track { times: series.times, values }, ["vx", "vy"])
}

fn striker_track(
    recording: &Recording,
    topic: &str,
    player: Player,
) -> Result<Track, ActuatorError> {
    let series: Series<CameraDetections> = present(recording, topic)?;
    let taken = FrameTimes::of(&series).taken;
    let mut seen: Vec<(Nanos, [f64; AXES])> = taken
        .into_iter()
        .zip(&series.values)
        .filter_map(|(time, frame)| {
            let point = match player {
                Player::Left => frame.left.as_ref(),
                Player::Right => frame.right.as_ref(),
            }?;
            Some((time, [point.x, point.y]))
        })
        .collect();
    seen.sort_by_key(|(time, _)| *time);
    let (times, values) = seen.into_iter().unzip();
    finite(recording, topic, Track { times, values }, ["x", "y"])
}

/// Read the messages of a required topic and check their number and order.
fn present<M: prost::Message + prost::Name + Default>(
    recording: &Recording,
    topic: &str,
) -> Result<Series<M>, ActuatorError> {
    for channel in recording.channels_of(topic) {
        let backwards = channel.messages.windows(2).position(|m| m[1].log_time < m[0].log_time);
        if let Some(position) = backwards {
            let [before, after] = [position, position + 1].map(|i| channel.messages[i].log_time);
            return Err(ActuatorError::TimeBackwards {
                path: recording.path.clone(),
                topic: topic.to_owned(),
                index: position + 1,
                seconds: before.seconds_since(after),
            });
        }
    }
    let series = recording.series::<M>(topic)?;
    if series.times.is_empty() {
        let available: Vec<_> = recording
            .channels
            .iter()
            .filter(|channel| !channel.messages.is_empty())
            .map(|channel| channel.topic.as_str())
            .collect();
        return Err(ActuatorError::NoTopic {
            path: recording.path.clone(),
            topic: topic.to_owned(),
            available: if available.is_empty() { "none".into() } else { available.join(", ") },
        });
    }
    Ok(series)
}

fn finite(
    recording: &Recording,
    topic: &str,
    track: Track,
    fields: [&'static str; AXES],
) -> Result<Track, ActuatorError> {
    for (index, pair) in track.values.iter().enumerate() {
        for (field, value) in fields.into_iter().zip(pair) {
            if !value.is_finite() {
                return Err(ActuatorError::NonFinite {
                    path: recording.path.clone(),
                    topic: topic.to_owned(),
                    index,
                    field,
                    value: *value,
                });
            }
        }
    }
    Ok(track)
}

/// Return the runs of the markers, or the whole recording when it has no markers.
fn runs_or_whole(recording: &Recording) -> Result<Vec<MarkedRun>, RecordingError> {
    let mut runs = recording.marked_runs()?;
    if runs.is_empty() {
        let end_of_file = recording.time_range().map_or(Nanos(0), |(_, last)| Nanos(last.0 + 1));
        runs.push(MarkedRun {
            number: 0,
            pattern: "unknown".to_owned(),
            split: recording.info("split").and_then(Split::from_text),
            span: Nanos(0)..end_of_file,
        });
    }
    Ok(runs)
}

/// Return the parts of `span` without a dropout of commands or motion.
fn pieces(commands: &Track, motion: &Track, span: &Range<Nanos>) -> Vec<Range<Nanos>> {
    let commanded = covered(&commands.times, span);
    let measured = covered(&motion.times, span);
    let mut both = Vec::new();
    for c in &commanded {
        for m in &measured {
            let (from, to) = (c.start.max(m.start), c.end.min(m.end));
            if from < to {
                both.push(from..to);
            }
        }
    }
    // Sample 0 lies on a command, so that the grid keeps the phase of the control loop.
    for piece in &mut both {
        let next = commands.times.partition_point(|time| *time < piece.start);
        if let Some(time) = commands.times.get(next) {
            piece.start = (*time).min(piece.end);
        }
    }
    both
}

/// Return the stretches of `span` without a dropout between neighbouring `times`.
fn covered(times: &[Nanos], span: &Range<Nanos>) -> Vec<Range<Nanos>> {
    let from = times.partition_point(|time| *time < span.start);
    let to = times.partition_point(|time| *time < span.end);
    let mut stretches: Vec<Range<Nanos>> = Vec::new();
    for time in &times[from..to] {
        match stretches.last_mut() {
            Some(last) if time.seconds_since(last.end) <= LONGEST_DROPOUT => last.end = *time,
            _ => stretches.push(*time..*time),
        }
    }
    stretches
}

fn sample(run: &mut Run, piece: &Range<Nanos>, commands: &Track, motion: &Motion, dt: f64) {
    let count = (piece.end.seconds_since(piece.start) / dt + 1e-6).floor() as usize;
    for k in 0..=count {
        let [from, to] = [k, k + 1].map(|k| piece.start.after_seconds(k as f64 * dt));
        run.commands.push(mean_held(commands, from, to));
        run.velocities.push(motion.velocity_at(from));
    }
}

/// Return the mean over `[from, to)` of the zero-order-hold value.
fn mean_held(track: &Track, from: Nanos, to: Nanos) -> [f64; AXES] {
    let first = track.times.partition_point(|time| *time <= from).saturating_sub(1);
    let mut mean = [0.0; AXES];
    let length = to.seconds_since(from);
    for index in first..track.times.len() {
        let begin = if index == first { from } else { track.times[index] };
        if to <= begin {
            break;
        }
        let end = track.times.get(index + 1).map_or(to, |next| (*next).min(to));
        let fraction = end.seconds_since(begin.min(end)) / length;
        for (mean, value) in mean.iter_mut().zip(track.values[index]) {
            *mean += fraction * value;
        }
    }
    mean
}

/// Interpolate linearly between the neighbours of `time`; the end value outside.
fn interpolate(track: &Track, time: Nanos) -> [f64; AXES] {
    let after = track.times.partition_point(|t| *t < time);
    if after == track.times.len() {
        return track.values[after - 1];
    }
    if after == 0 || track.times[after] == time {
        return track.values[after];
    }
    let span = track.times[after].seconds_since(track.times[after - 1]);
    let fraction = time.seconds_since(track.times[after - 1]) / span;
    let (old, new) = (track.values[after - 1], track.values[after]);
    std::array::from_fn(|axis| old[axis] + fraction * (new[axis] - old[axis]))
}

/// Return the slope at `time` of the least-squares parabola through the positions around it. With
/// two positions it is the slope of the line, with one it is zero.
fn parabola_slope(track: &Track, time: Nanos) -> [f64; AXES] {
    let from = track.times.partition_point(|t| t.seconds_since(time) < -CAMERA_HALF_WINDOW);
    let to = track.times.partition_point(|t| t.seconds_since(time) <= CAMERA_HALF_WINDOW);
    // Scaled times keep the normal equations well conditioned.
    let tau: Vec<f64> =
        track.times[from..to].iter().map(|t| t.seconds_since(time) / CAMERA_HALF_WINDOW).collect();
    let moment = |power: i32| tau.iter().map(|t| t.powi(power)).sum::<f64>();
    let s: [f64; 5] = std::array::from_fn(|power| moment(power as i32));
    std::array::from_fn(|axis| {
        let values = || track.values[from..to].iter().map(|pair| pair[axis]);
        let weighted = |power: i32| tau.iter().zip(values()).map(|(t, x)| t.powi(power) * x).sum();
        let b: [f64; 3] = [weighted(0), weighted(1), weighted(2)];
        let slope = match tau.len() {
            0 | 1 => 0.0,
            2 => (s[0] * b[1] - s[1] * b[0]) / (s[0] * s[2] - s[1] * s[1]),
            _ => {
                let columns = [[s[0], s[1], s[2]], [s[1], s[2], s[3]], [s[2], s[3], s[4]]];
                determinant([columns[0], b, columns[2]]) / determinant(columns)
            }
        };
        if slope.is_finite() { slope / CAMERA_HALF_WINDOW } else { 0.0 }
    })
}

fn determinant([a, b, c]: [[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// Check that the command and the motion change.
fn check_moves(
    recording: &Recording,
    runs: &[Run],
    topics: [&str; 2],
) -> Result<(), ActuatorError> {
    let constant = |series: fn(&Run) -> &Vec<[f64; AXES]>| {
        let mut all = runs.iter().flat_map(series);
        let first = all.next();
        all.all(|pair| Some(pair) == first)
    };
    let refused = if constant(|run| &run.commands) {
        Some((topics[0], "the command"))
    } else if constant(|run| &run.velocities) {
        Some((topics[1], "the measured velocity"))
    } else {
        None
    };
    match refused {
        None => Ok(()),
        Some((topic, what)) => Err(ActuatorError::Constant {
            path: recording.path.clone(),
            topic: topic.to_owned(),
            runs: runs.len(),
            what,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(samples: &[(u64, f64)]) -> Track {
        Track {
            times: samples.iter().map(|(ms, _)| Nanos(ms * 1_000_000)).collect(),
            values: samples.iter().map(|(_, value)| [*value, -*value]).collect(),
        }
    }

    #[test]
    fn a_command_counts_from_its_own_time() {
        // Held at 1 from 0 ms, 3 from 15 ms: over 0..20 ms the mean is (15 * 1 + 5 * 3) / 20.
        let commands = track(&[(0, 1.0), (15, 3.0), (40, 9.0)]);
        let mean = mean_held(&commands, Nanos(0), Nanos(20_000_000));
        assert!((mean[0] - 1.5).abs() < 1e-12 && (mean[1] + 1.5).abs() < 1e-12, "{mean:?}");
        let later = mean_held(&commands, Nanos(20_000_000), Nanos(40_000_000));
        assert!((later[0] - 3.0).abs() < 1e-12, "{later:?}");
    }

    #[test]
    fn a_dropout_ends_a_piece_and_the_grid_starts_on_a_command() {
        let commands = track(&[(7, 1.0), (27, 1.0), (47, 1.0), (500, 1.0), (520, 2.0)]);
        let motion: Vec<(u64, f64)> = (0..60).map(|k| (k * 10, 0.1)).collect();
        let pieces = pieces(&commands, &track(&motion), &(Nanos(0)..Nanos(600_000_000)));
        let in_ms: Vec<_> =
            pieces.iter().map(|p| (p.start.0 / 1_000_000, p.end.0 / 1_000_000)).collect();
        assert_eq!(in_ms, [(7, 47), (500, 520)]);
    }

    #[test]
    fn a_parabola_has_the_right_slope_even_off_centre() {
        let position = |t: f64| 0.1 + 0.4 * t + 4.5 * t * t;
        let frames: Vec<(u64, f64)> =
            (0..40).map(|k| (k * 8 + 3, position((k * 8 + 3) as f64 * 1e-3))).collect();
        let slope = parabola_slope(&track(&frames), Nanos(100_000_000));
        assert!((slope[0] - (0.4 + 2.0 * 4.5 * 0.1)).abs() < 1e-9, "{slope:?}");
    }

    #[test]
    fn velocities_are_interpolated_by_time() {
        let motion = track(&[(0, 0.0), (10, 1.0), (30, 3.0)]);
        assert!((interpolate(&motion, Nanos(20_000_000))[0] - 2.0).abs() < 1e-12);
        assert!((interpolate(&motion, Nanos(10_000_000))[0] - 1.0).abs() < 1e-12);
        assert!((interpolate(&motion, Nanos(90_000_000))[0] - 3.0).abs() < 1e-12);
    }
}
