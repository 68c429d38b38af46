//! Curves of the report, from the recordings.

use super::{
    page::Pictures,
    plan::{POLICIES, match_name},
};
use crate::{
    recording::{
        Recording,
        message::{
            CameraDetections, CarriageState, RunMarker, TrainingUpdate, VelocityCommand,
            run_marker::Phase,
        },
        topic::{self, Player},
    },
    train::UPDATE_TOPIC,
    units::Nanos,
};
use std::path::Path;

/// Displayed length of the step response (s).
const STEP_SECONDS: f64 = 3.0;

/// Displayed part of a match (s).
const TRACK_SECONDS: [f64; 2] = [6.0, 14.0];

/// Curves from the recordings of the demo in `folder`; missing ones stay empty.
#[must_use]
pub fn pictures(folder: &Path) -> Pictures {
    let mut pictures = Pictures {
        learning: POLICIES
            .iter()
            .map(|kind| learning(&folder.join(kind.name).join("policy.mcap")).unwrap_or_default())
            .collect(),
        ..Pictures::default()
    };
    if let Some([command, carriage]) = steps(&folder.join("monday.mcap")) {
        (pictures.command, pictures.carriage) = (command, carriage);
    }
    let name = format!("{}.mcap", match_name("learned", "chaser", "left"));
    pictures.tracks = tracks(&folder.join("matches").join(name)).unwrap_or_default();
    pictures
}

/// Hits per minute over million transitions.
fn learning(path: &Path) -> Option<Vec<(f64, f64)>> {
    let updates = Recording::open(path).ok()?.series::<TrainingUpdate>(UPDATE_TOPIC).ok()?;
    let point = |update: &TrainingUpdate| (update.transitions as f64 / 1e6, update.hits_per_minute);
    Some(updates.values.iter().map(point).collect())
}

/// Commanded and true velocity along x (m/s) at the beginning of the step ladder (s).
fn steps(path: &Path) -> Option<[Vec<(f64, f64)>; 2]> {
    let recording = Recording::open(path).ok()?;
    let markers = recording.series::<RunMarker>(topic::RUN_MARKER).ok()?;
    let begins = |marker: &RunMarker| {
        marker.pattern == "step_ladder" && marker.phase == i32::from(Phase::Start)
    };
    let index = markers.values.iter().position(begins)?;
    let start = markers.times[index];
    let commands = recording.series::<VelocityCommand>(&topic::command(Player::Left)).ok()?;
    let states = recording.series::<CarriageState>(&topic::carriage(Player::Left)).ok()?;
    let since = |time: &Nanos| time.seconds_since(start);
    let shown = |(time, _): &(f64, f64)| (0.0..STEP_SECONDS).contains(time);
    let commands = commands.times.iter().map(since).zip(commands.values.iter().map(|one| one.vx));
    let states = states.times.iter().map(since).zip(states.values.iter().map(|one| one.vx));
    Some([commands.filter(shown).collect(), states.filter(shown).collect()])
}

/// Left striker, right striker and ball as detected: y and x (m).
fn tracks(path: &Path) -> Option<[Vec<(f64, f64)>; 3]> {
    let recording = Recording::open(path).ok()?;
    let pictures = recording.series::<CameraDetections>(topic::CAMERA_DETECTIONS).ok()?;
    let start = *pictures.times.first()?;
    let [first, last] = TRACK_SECONDS;
    let shown: Vec<&CameraDetections> = pictures
        .times
        .iter()
        .zip(&pictures.values)
        .filter(|(time, _)| (first..last).contains(&time.seconds_since(start)))
        .map(|(_, seen)| seen)
        .collect();
    let track = |of: fn(&CameraDetections) -> Option<(f64, f64)>| {
        shown.iter().filter_map(|seen| of(seen)).collect()
    };
    Some([
        track(|seen| seen.left.as_ref().map(|point| (point.y, point.x))),
        track(|seen| seen.right.as_ref().map(|point| (point.y, point.x))),
        track(|seen| seen.ball.as_ref().map(|point| (point.y, point.x))),
    ])
}
