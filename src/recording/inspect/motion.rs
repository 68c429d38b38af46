//! Whether the carriage does what it is told, and whether encoders and camera agree.
//!
//! Velocity on command: `v(t + lag) = G u(t) + c` by least squares for both axes together, on a
//! grid of the control period and for lags up to 0.3 s; the smallest lag counts that explains
//! nearly as much as the best one. `G` near the identity is a drive that follows. Camera on
//! encoders likewise, one slope for each axis.
//!
//! Left out on purpose: dynamics. A ramp or a limit lowers a slope somewhat, which is why the
//! limits here are wide; the actuator fit is the judge of the rest.

use super::{
    doubt::Doubt,
    track::{Covariance, Track},
};
use crate::recording::topic::{self, Motor, Player};
use serde::Serialize;
use std::collections::BTreeMap;

/// Control period (s), the grid of the comparison.
const STEP_S: f64 = 0.02;
/// Points of the grid at most; a slope needs no more.
const MAX_POINTS: usize = 20_000;
/// Fewer points than this tell nothing.
const MIN_POINTS: usize = 50;
/// Largest lag from command to motion that is tried (s); drives and cameras stay below.
const MAX_LAG_S: f64 = 0.3;
/// A smaller lag is taken when it explains this much less of the variance at most, so that a
/// circle, where lag and rotation look alike, is not read as swapped axes.
const LAG_SLACK: f64 = 0.02;
/// A command older than this is not in force any more (s).
const MAX_HOLD_S: f64 = 0.5;
/// Encoder samples further apart are not interpolated (s): ten nominal periods.
const MAX_SAMPLE_GAP_S: f64 = 0.1;
/// Commands that vary less are no excitation (m/s, standard deviation).
const MIN_COMMAND_DEVIATION: f64 = 0.005;
/// Measured velocities that vary less are noise of a standing axis (m/s).
const MIN_SPEED_DEVIATION: f64 = 0.002;
/// Half-way between the slope 1 of a good recording and 2 of the known bug, and as far above 2.
const TWICE: std::ops::Range<f64> = 1.5..2.5;
/// Below it the axis moves against its command; a good one lies near 1.
const MIRRORED_BELOW: f64 = -0.3;
/// The other axis' command must explain this many times more for axes to count as swapped.
const SWAPPED_RATIO: f64 = 3.0;
/// Share of the motion's variance that a command explains when both are unrelated, at most. Any
/// drive that follows reaches several times as much.
const UNRELATED_BELOW: f64 = 0.25;
/// A sensor that stays within this (m) does not move: a fifth of a millimetre of belt is several
/// quanta of any encoder in use.
const STILL_M: f64 = 1e-4;
/// Commanded travel that must move any sensor (m); free play is ten times smaller.
const MIN_TRAVEL_M: f64 = 0.02;
/// Travel over which a scale of 0.1 % is seen above the camera's noise (m).
const MIN_SCALE_RANGE_M: f64 = 0.02;
/// Camera and encoders must agree this well before their scale is believed.
const MIN_SCALE_EXPLAINED: f64 = 0.95;
/// Two thirds of the 4.5 % that a wrong board length makes (0.42 m and 0.44 m mixed up); a peg on a
/// soft magnet overshoots by up to half of that.
const MAX_SCALE_ERROR: f64 = 0.03;
/// Axis names by column.
const AXES: [char; 2] = ['x', 'y'];

/// What one gantry's topics hold.
#[derive(Debug, Default)]
pub(super) struct GantryTracks {
    /// Commanded velocity x, y (m/s).
    pub(super) command: Track<2>,
    /// Carriage position x, y (m) and velocity x, y (m/s).
    pub(super) carriage: Track<4>,
    /// Peg seen by the camera x, y (m).
    pub(super) peg: Track<2>,
    /// Turns of motor a and b, smallest and largest.
    pub(super) motor_turns: BTreeMap<Motor, (f64, f64)>,
}

/// Speeds of one player along one axis of the board frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedReport {
    /// Whose striker.
    pub player: Player,
    /// `x` or `y`.
    pub axis: char,
    /// Smallest and largest command (m/s).
    pub commanded_m_per_s: Option<[f64; 2]>,
    /// Smallest and largest velocity of the carriage from the encoders (m/s).
    pub measured_m_per_s: Option<[f64; 2]>,
    /// Slope of measured on commanded velocity, where the command varies.
    pub velocity_per_command: Option<f64>,
    /// Share of the measured velocity's variance that the commands explain.
    pub explained: Option<f64>,
    /// Lag from command to motion at which that is so (s).
    pub lag_s: Option<f64>,
    /// Peg displacement seen by the camera over carriage displacement from the encoders.
    pub camera_scale: Option<f64>,
}

/// Speeds of both axes of `player`, and what is doubtful about them.
pub(super) fn judge(
    player: Player,
    tracks: &GantryTracks,
    belt_metres_per_turn: f64,
) -> (Vec<SpeedReport>, Vec<Doubt>) {
    if tracks.command.values.is_empty() && tracks.carriage.values.is_empty() {
        return (vec![], vec![]);
    }
    let follow = fit_follow(tracks);
    let mut doubts = stuck_sensors(player, tracks, belt_metres_per_turn);
    if let Some(follow) = &follow {
        doubts.extend(follow_doubts(player, follow));
    }
    let mut reports = Vec::new();
    for (at, axis) in AXES.into_iter().enumerate() {
        let camera_scale = fit_scale(tracks, at);
        if let Some(scale) = camera_scale.filter(|scale| MAX_SCALE_ERROR < (scale - 1.0).abs()) {
            doubts.push(Doubt::CameraScale { player, axis, scale });
        }
        let fit = follow.as_ref().and_then(|follow| follow.axes[at].as_ref());
        reports.push(SpeedReport {
            player,
            axis,
            commanded_m_per_s: tracks.command.range(at).map(<[f64; 2]>::from),
            measured_m_per_s: tracks.carriage.range(at + 2).map(<[f64; 2]>::from),
            velocity_per_command: fit.map(|fit| fit.own),
            explained: fit.map(|fit| fit.explained),
            lag_s: follow.as_ref().filter(|_| fit.is_some()).map(|follow| follow.lag_s),
            camera_scale,
        });
    }
    (reports, doubts)
}

/// How one axis follows.
#[derive(Debug, Clone, Copy)]
struct AxisFit {
    /// Slope on its own command.
    own: f64,
    /// Slope on the other axis' command, where both can be told apart.
    cross: Option<f64>,
    explained: f64,
    /// Standard deviation of the measured velocity (m/s).
    deviation: f64,
}

#[derive(Debug, Clone)]
struct Follow {
    lag_s: f64,
    axes: [Option<AxisFit>; 2],
}

fn fit_follow(tracks: &GantryTracks) -> Option<Follow> {
    let lags = (MAX_LAG_S / STEP_S).round() as usize;
    let fits: Vec<Follow> =
        (0..=lags).filter_map(|lag| fit_at_lag(tracks, lag as f64 * STEP_S)).collect();
    let explained =
        |follow: &Follow| -> f64 { follow.axes.iter().flatten().map(|axis| axis.explained).sum() };
    let best = fits.iter().map(explained).max_by(f64::total_cmp)?;
    fits.into_iter().find(|follow| best - LAG_SLACK <= explained(follow))
}

fn fit_at_lag(tracks: &GantryTracks, lag_s: f64) -> Option<Follow> {
    let (command, carriage) = (&tracks.command, &tracks.carriage);
    let from = command.times_s.first()?.max(*carriage.times_s.first()?);
    let to = command.times_s.last()?.min(*carriage.times_s.last()?);
    let step = STEP_S.max((to - from) / MAX_POINTS as f64);
    let count = ((to - from) / step).max(0.0) as usize;
    let rows: Vec<[f64; 4]> = (0..count)
        .filter_map(|k| {
            let time = from + k as f64 * step;
            let [ux, uy] = command.held(time, MAX_HOLD_S)?;
            let [_, _, vx, vy] = carriage.between(time + lag_s, MAX_SAMPLE_GAP_S)?;
            Some([ux, uy, vx, vy])
        })
        .collect();
    let covariance = Covariance::new(&rows);
    let axes = [fit_axis(&covariance, 0), fit_axis(&covariance, 1)];
    (MIN_POINTS <= covariance.count && axes.iter().any(Option::is_some))
        .then_some(Follow { lag_s, axes })
}

fn fit_axis(covariance: &Covariance<4>, axis: usize) -> Option<AxisFit> {
    let deviation = covariance.deviation(axis + 2);
    let moves = |axis: usize| MIN_COMMAND_DEVIATION <= covariance.deviation(axis);
    if !moves(axis) {
        return None;
    }
    if let Some((slopes, explained)) = covariance.slopes(axis + 2).filter(|_| moves(1 - axis)) {
        let cross = Some(slopes[1 - axis]);
        return Some(AxisFit { own: slopes[axis], cross, explained, deviation });
    }
    let (own, explained) = covariance.slope(axis + 2, axis);
    Some(AxisFit { own, cross: None, explained, deviation })
}

fn follow_doubts(player: Player, follow: &Follow) -> Vec<Doubt> {
    if is_swapped(follow) {
        return vec![Doubt::AxesSwapped { player }];
    }
    let mut doubts = Vec::new();
    for (axis, fit) in AXES.into_iter().zip(&follow.axes) {
        // An axis that stands still is a stuck sensor, not an unrelated one.
        let Some(fit) = fit.filter(|fit| MIN_SPEED_DEVIATION <= fit.deviation) else { continue };
        let slope = fit.own;
        if fit.explained < UNRELATED_BELOW {
            let explained_percent = 100.0 * fit.explained;
            doubts.push(Doubt::Unrelated { player, axis, explained_percent });
        } else if slope < MIRRORED_BELOW {
            doubts.push(Doubt::Mirrored { player, axis, slope });
        } else if TWICE.contains(&slope) {
            doubts.push(Doubt::TwiceTheCommand { player, axis, slope });
        }
    }
    doubts
}

fn is_swapped(follow: &Follow) -> bool {
    follow.axes.iter().all(|fit| {
        fit.and_then(|fit| Some((fit, fit.cross?))).is_some_and(|(fit, cross)| {
            SWAPPED_RATIO * fit.own.abs() < cross.abs() && UNRELATED_BELOW <= fit.explained
        })
    })
}

/// Travel that is commanded along `direction` of (x, y) (m).
fn commanded_travel(command: &Track<2>, direction: [f64; 2]) -> f64 {
    let steps = command.times_s.windows(2).zip(&command.values);
    steps
        .map(|(pair, [ux, uy])| {
            let held = (pair[1] - pair[0]).min(MAX_HOLD_S);
            (direction[0] * ux + direction[1] * uy).abs() * held
        })
        .sum()
}

fn stuck_sensors(player: Player, tracks: &GantryTracks, belt_metres_per_turn: f64) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let mut check = |topic: String, field: &str, width_m: Option<f64>, direction: [f64; 2]| {
        let commanded_m = commanded_travel(&tracks.command, direction);
        if MIN_TRAVEL_M < commanded_m && width_m.is_some_and(|width| width < STILL_M) {
            doubts.push(Doubt::SensorStuck { topic, field: field.to_owned(), commanded_m });
        }
    };
    let width = |range: Option<(f64, f64)>| range.map(|(low, high)| high - low);
    let directions = [[1.0, 0.0], [0.0, 1.0]];
    for (at, direction) in directions.into_iter().enumerate() {
        let fields = [["x", "y"][at], ["vx", "vy"][at]];
        check(topic::carriage(player), fields[0], width(tracks.carriage.range(at)), direction);
        check(topic::carriage(player), fields[1], width(tracks.carriage.range(at + 2)), direction);
        let peg = format!("{player}.{}", fields[0]);
        let detections = topic::CAMERA_DETECTIONS.to_owned();
        check(detections, &peg, width(tracks.peg.range(at)), direction);
    }
    for (motor, (low, high)) in &tracks.motor_turns {
        // Motor a turns with x + y, b with x - y.
        let direction = match motor {
            Motor::A => [1.0, 1.0],
            Motor::B => [1.0, -1.0],
        };
        let width = Some((high - low) * belt_metres_per_turn);
        check(topic::motor(player, *motor), "position_turns", width, direction);
    }
    doubts
}

/// Slope of the peg on the carriage along column `at`, the other axis taken out where it can be,
/// so that a turned camera is not a wrong scale; and the share of the variance explained.
fn scale_of(covariance: &Covariance<3>, at: usize) -> (f64, f64) {
    let both = covariance.slopes(2).map(|(slopes, explained)| (slopes[at], explained));
    both.unwrap_or_else(|| covariance.slope(2, at))
}

/// Camera over encoder displacement along column `at`, at the lag that fits best; `None` when
/// there is too little travel or agreement.
fn fit_scale(tracks: &GantryTracks, at: usize) -> Option<f64> {
    let (low, high) = tracks.carriage.range(at)?;
    if high - low < MIN_SCALE_RANGE_M || tracks.peg.values.len() < MIN_POINTS {
        return None;
    }
    let stride = tracks.peg.values.len().div_ceil(MAX_POINTS);
    let steps = 40;
    let fits = (0..=steps).filter_map(|step| {
        let lag_s = MAX_LAG_S * f64::from(step) / f64::from(steps);
        let frames = tracks.peg.times_s.iter().zip(&tracks.peg.values).step_by(stride);
        let rows: Vec<[f64; 3]> = frames
            .filter_map(|(time, peg)| {
                let carriage = tracks.carriage.between(time - lag_s, MAX_SAMPLE_GAP_S)?;
                Some([carriage[0], carriage[1], peg[at]])
            })
            .collect();
        (MIN_POINTS <= rows.len()).then(|| scale_of(&Covariance::new(&rows), at))
    });
    let (slope, explained) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (MIN_SCALE_EXPLAINED <= explained).then_some(slope)
}
