//! Stages of a measured gantry: commands to motors, and carriage to camera.

use super::{Readings, Run, gantry::Gantry};
use crate::{
    effects::Domain,
    recording::{
        FrameTimes, Recording, RecordingError,
        message::{CameraDetections, VelocityCommand},
        topic::{self, Player},
    },
    twin::{
        CameraStage, DriveStage, MeasuredPath,
        drive::{Output, RunStart, SETTLING},
        noise::{FRAMES_OF_A_BLOCK, FrameLosses},
        repeats::repeats,
    },
};
use std::ops::Range;

/// A pause of the recording after which the plant starts anew (s).
const PAUSE: f64 = 0.2;

/// Fewest commands of a drive that is compared.
const FEWEST_COMMANDS: usize = 10;

/// Fewest frames of a striker that is compared.
const FEWEST_PICTURES: usize = 20;

/// Height of the striker's mark above the board (m).
pub(in crate::twin) const STRIKER_HEIGHT: f64 = 0.02;

/// The drive stage of `gantry`.
///
/// # Errors
/// When a message does not decode.
pub(super) fn drive_stage(
    recording: &Recording,
    gantry: &Gantry,
    runs: &[Run],
) -> Result<Option<DriveStage>, RecordingError> {
    let Some((origin, _)) = recording.time_range() else { return Ok(None) };
    let commands = recording.series::<VelocityCommand>(&topic::command(gantry.player))?;
    if commands.times.len() < FEWEST_COMMANDS {
        return Ok(None);
    }
    let starts: Vec<RunStart> = run_starts(runs, &gantry.carriage);
    let spans: Vec<Range<f64>> = starts
        .iter()
        .map(|start| start.time + if start.fresh { SETTLING } else { 0.0 }..start.end)
        .collect();
    let mut channels = Vec::new();
    let mut outputs = Vec::new();
    let torque_names = ["motor_a.torque", "motor_b.torque"];
    let velocity_names = ["motor_a.velocity", "motor_b.velocity"];
    let axes = ["a", "b"];
    for k in 0..2 {
        let even = gantry.motors[k].evened();
        let name = (velocity_names[k], "m/s", Domain::Drive, axes[k]);
        channels.push(even.channel(1, &spans, name));
        outputs.push(Output::Velocity(k));
        let torque = &gantry.torques[k];
        if even.values.len() < 2 * torque.values.len() {
            let name = (torque_names[k], "N m", Domain::Drive, axes[k]);
            channels.push(torque.evened().channel(0, &spans, name));
            outputs.push(Output::Torque(k));
        }
    }
    Ok(Some(DriveStage {
        arrivals: recording.command_arrivals(gantry.player)?,
        command_times: commands.times.iter().map(|time| time.seconds_since(origin)).collect(),
        commands: commands.values.iter().map(|command| [command.vx, command.vy]).collect(),
        starts,
        channels,
        outputs,
        path: Some(measured_path(gantry)),
    }))
}

fn run_starts(runs: &[Run], carriage: &Readings<4>) -> Vec<RunStart> {
    let mut starts: Vec<RunStart> = Vec::new();
    for run in runs {
        let first = carriage.times.partition_point(|time| *time < run.span.start - 1e-9);
        let Some(value) = carriage.values.get(first) else { continue };
        let time = carriage.times[first];
        if run.span.end <= time {
            continue;
        }
        let fresh = starts.last().is_none_or(|last| last.end + PAUSE < time);
        starts.push(RunStart {
            time,
            end: run.span.end,
            position: [value[0], value[1]],
            velocity: [value[2], value[3]],
            fresh,
        });
    }
    starts
}

/// Stage from the carriage of `gantry` to the camera. If frames carry a clock of their own epoch,
/// or no clock, the camera's latency is the time up to their arrival (see [`FrameTimes`]).
/// `has_drives` states whether the drives were recorded.
///
/// # Errors
/// When a message does not decode.
pub(super) fn camera_stage(
    recording: &Recording,
    gantry: &Gantry,
    (runs, has_drives): (&[Run], bool),
) -> Result<Option<CameraStage>, RecordingError> {
    let Some((origin, _)) = recording.time_range() else { return Ok(None) };
    let frames = recording.series::<CameraDetections>(topic::CAMERA_DETECTIONS)?;
    let taken = FrameTimes::of(&frames).taken;
    let frames = taken.iter().zip(&frames.values).map(|(time, frame)| {
        let point = match gantry.player {
            Player::Left => &frame.left,
            Player::Right => &frame.right,
        };
        let place = point.as_ref().map_or([f64::NAN; 2], |point| [point.x, point.y]);
        (time.seconds_since(origin), place)
    });
    // Every frame, in the order of arrival: one whose time stamp jitters before the last one is not lost.
    let mut frames: Vec<(f64, [f64; 2])> = frames.collect();
    let (stamps, places): (Vec<f64>, Vec<[f64; 2]>) = frames.iter().copied().unzip();
    let losses = FrameLosses::new(&stamps, &repeats(&places), FRAMES_OF_A_BLOCK);
    frames.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut seen = Readings::<2>::collect(frames.into_iter());
    let repeated = repeats(&seen.values);
    for (place, _) in seen.values.iter_mut().zip(repeated).filter(|(_, repeated)| *repeated) {
        *place = [f64::NAN; 2];
    }
    let seen = seen.evened();
    if seen.values.iter().filter(|value| value[0].is_finite()).count() < FEWEST_PICTURES {
        return Ok(None);
    }
    let spans: Vec<Range<f64>> = runs.iter().map(|run| run.span.clone()).collect();
    let x = ("camera.striker_x", "m", Domain::Sensor, "x");
    let y = ("camera.striker_y", "m", Domain::Sensor, "y");
    let channels = vec![seen.channel(0, &spans, x), seen.channel(1, &spans, y)];
    let carriage = measured_path(gantry);
    Ok(Some(CameraStage { carriage, channels, height: STRIKER_HEIGHT, has_drives, losses }))
}

/// Path of the carriage of `gantry`, by its motors.
fn measured_path(gantry: &Gantry) -> MeasuredPath {
    let column = |first: usize| {
        gantry.carriage.values.iter().map(move |value| [value[first], value[first + 1]])
    };
    MeasuredPath::new(gantry.carriage.times.clone(), column(0).collect(), column(2).collect())
}
