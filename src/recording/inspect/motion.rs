//! Checks of the carriage motion: agreement with the command, and of the encoders with the camera.
//!
//! Velocity on command: `v(t + lag) = G u(t) + c` by least squares for both axes together, on a
//! grid of the control period and for lags up to 0.3 s. The smallest lag is used that explains
//! nearly as much variance as the best one. `G` near the identity is a drive that follows. Camera
//! on encoders likewise, with one slope for each axis.
//!
//! Dynamics are omitted on purpose. A slew limit or a speed limit lowers a slope somewhat, so the
//! limits here are wide; the actuator fit evaluates the rest.

use super::{
    issue::DataQualityIssue,
    track::{Covariance, Track},
};
use crate::recording::topic::{self, Motor, Player};
use serde::Serialize;
use std::collections::BTreeMap;

/// Sampling interval of the comparison (s), the control period.
const STEP_S: f64 = 0.02;
/// Largest number of points of the grid; a slope needs no more.
const MAX_POINTS: usize = 20_000;
/// Least number of points for a comparison.
const MIN_POINTS: usize = 50;
/// Largest lag from command to motion in the search (s); drives and cameras stay below.
const MAX_LAG_S: f64 = 0.3;
/// Largest loss of explained variance for which a smaller lag is preferred. On a circle lag and
/// rotation are confounded; the preference prevents a false report of swapped axes.
const LAG_SLACK: f64 = 0.02;
/// Longest time for which a command stays in force (s).
const MAX_HOLD_S: f64 = 0.5;
/// Longest interval over which encoder samples are interpolated (s): ten nominal periods.
const MAX_INTERPOLATION_S: f64 = 0.1;
/// Least standard deviation of an exciting command (m/s).
const MIN_COMMAND_DEVIATION: f64 = 0.005;
/// Least standard deviation of the velocity of a moving axis (m/s); below it is noise.
const MIN_SPEED_DEVIATION: f64 = 0.002;
/// Slopes of the known factor-two bug: half-way between 1 and 2, and as far above 2.
const TWICE: std::ops::Range<f64> = 1.5..2.5;
/// Slope below which an axis moves against its command; a good one is near 1.
const MIRRORED_BELOW: f64 = -0.3;
/// Least ratio of variance explained by the other axis' command for swapped axes.
const SWAPPED_RATIO: f64 = 3.0;
/// Fraction of the motion's variance explained by the command below which both count as
/// uncorrelated. A drive that follows reaches several times as much.
const UNCORRELATED_BELOW: f64 = 0.25;
/// Largest range of a sensor that counts as constant (m): a fifth of a millimetre of belt is
/// several quanta of any encoder in use.
const STILL_M: f64 = 1e-4;
/// Least commanded travel that must move any sensor (m); backlash is ten times smaller.
const MIN_TRAVEL_M: f64 = 0.02;
/// Least travel for a scale (m): a deviation of 0.1 % exceeds the camera's noise.
const MIN_SCALE_RANGE_M: f64 = 0.02;
/// Least fraction of variance explained for a valid scale of camera and encoders.
const MIN_SCALE_EXPLAINED: f64 = 0.95;
/// Largest scale error: two thirds of the 4.5 % of a wrong board length (0.42 m instead of 0.44 m).
/// A peg on a soft magnet overshoots by up to half of that.
const MAX_SCALE_ERROR: f64 = 0.03;
/// Axis names by column.
const AXES: [char; 2] = ['x', 'y'];

/// Topics of one gantry.
#[derive(Debug, Default)]
pub(super) struct GantryTracks {
    /// Commanded velocity x, y (m/s).
    pub(super) command: Track<2>,
    /// Carriage position x, y (m) and velocity x, y (m/s).
    pub(super) carriage: Track<4>,
    /// Peg position from the camera x, y (m).
    pub(super) peg: Track<2>,
    /// Smallest and largest turns of motor a and b.
    pub(super) motor_turns: BTreeMap<Motor, (f64, f64)>,
}

/// Speeds of one player along one axis of the board frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedReport {
    /// Player.
    pub player: Player,
    /// `x` or `y`.
    pub axis: char,
    /// Smallest and largest command (m/s).
    pub commanded_m_per_s: Option<[f64; 2]>,
    /// Smallest and largest velocity of the carriage from the encoders (m/s).
    pub measured_m_per_s: Option<[f64; 2]>,
    /// Slope of measured on commanded velocity, where the command varies.
    pub velocity_per_command: Option<f64>,
    /// Fraction of the measured velocity's variance explained by the commands.
    pub variance_explained: Option<f64>,
    /// Lag from command to motion of that fit (s).
    pub lag_s: Option<f64>,
    /// Ratio of the peg displacement from the camera to the carriage displacement from the
    /// encoders.
    pub camera_scale: Option<f64>,
}

/// Return the speeds of both axes of `player`, and the issues found.
pub(super) fn check(
    player: Player,
    tracks: &GantryTracks,
    belt_metres_per_turn: f64,
) -> (Vec<SpeedReport>, Vec<DataQualityIssue>) {
    if tracks.command.values.is_empty() && tracks.carriage.values.is_empty() {
        return (vec![], vec![]);
    }
    let follow = fit_follow(tracks);
    let mut issues = stuck_sensors(player, tracks, belt_metres_per_turn);
    if let Some(follow) = &follow {
        issues.extend(follow_issues(player, follow));
    }
    let mut reports = Vec::new();
    for (at, axis) in AXES.into_iter().enumerate() {
        let camera_scale = fit_scale(tracks, at);
        if let Some(scale) = camera_scale.filter(|scale| MAX_SCALE_ERROR < (scale - 1.0).abs()) {
            issues.push(DataQualityIssue::CameraScale { player, axis, scale });
        }
        let fit = follow.as_ref().and_then(|follow| follow.axes[at].as_ref());
        reports.push(SpeedReport {
            player,
            axis,
            commanded_m_per_s: tracks.command.range(at).map(<[f64; 2]>::from),
            measured_m_per_s: tracks.carriage.range(at + 2).map(<[f64; 2]>::from),
            velocity_per_command: fit.map(|fit| fit.own),
            variance_explained: fit.map(|fit| fit.explained),
            lag_s: follow.as_ref().filter(|_| fit.is_some()).map(|follow| follow.lag_s),
            camera_scale,
        });
    }
    (reports, issues)
}

/// Fit of one axis.
#[derive(Debug, Clone, Copy)]
struct AxisFit {
    /// Slope on its own command.
    own: f64,
    /// Slope on the other axis' command, where both are distinguishable.
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
            let [_, _, vx, vy] = carriage.between(time + lag_s, MAX_INTERPOLATION_S)?;
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

fn follow_issues(player: Player, follow: &Follow) -> Vec<DataQualityIssue> {
    if is_swapped(follow) {
        return vec![DataQualityIssue::AxesSwapped { player }];
    }
    let mut issues = Vec::new();
    for (axis, fit) in AXES.into_iter().zip(&follow.axes) {
        // An axis without motion is a stuck sensor, not an uncorrelated one.
        let Some(fit) = fit.filter(|fit| MIN_SPEED_DEVIATION <= fit.deviation) else { continue };
        let slope = fit.own;
        if fit.explained < UNCORRELATED_BELOW {
            let variance_explained_percent = 100.0 * fit.explained;
            issues.push(DataQualityIssue::Uncorrelated {
                player,
                axis,
                variance_explained_percent,
            });
        } else if slope < MIRRORED_BELOW {
            issues.push(DataQualityIssue::Mirrored { player, axis, slope });
        } else if TWICE.contains(&slope) {
            issues.push(DataQualityIssue::TwiceTheCommand { player, axis, slope });
        }
    }
    issues
}

fn is_swapped(follow: &Follow) -> bool {
    follow.axes.iter().all(|fit| {
        fit.and_then(|fit| Some((fit, fit.cross?))).is_some_and(|(fit, cross)| {
            SWAPPED_RATIO * fit.own.abs() < cross.abs() && UNCORRELATED_BELOW <= fit.explained
        })
    })
}

/// Return the commanded travel along `direction` of (x, y) (m).
fn commanded_travel(command: &Track<2>, direction: [f64; 2]) -> f64 {
    let steps = command.times_s.windows(2).zip(&command.values);
    steps
        .map(|(pair, [ux, uy])| {
            let held = (pair[1] - pair[0]).min(MAX_HOLD_S);
            (direction[0] * ux + direction[1] * uy).abs() * held
        })
        .sum()
}

fn stuck_sensors(
    player: Player,
    tracks: &GantryTracks,
    belt_metres_per_turn: f64,
) -> Vec<DataQualityIssue> {
    let mut issues = Vec::new();
    let mut check = |topic: String, field: &str, width_m: Option<f64>, direction: [f64; 2]| {
        let commanded_m = commanded_travel(&tracks.command, direction);
        if MIN_TRAVEL_M < commanded_m && width_m.is_some_and(|width| width < STILL_M) {
            issues.push(DataQualityIssue::SensorStuck {
                topic,
                field: field.to_owned(),
                commanded_m,
            });
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
    issues
}

/// Return the slope of the peg on the carriage along column `at`, and the fraction of variance
/// explained. The other axis is included where possible, so that a rotated camera is not a wrong
/// scale.
fn scale_of(covariance: &Covariance<3>, at: usize) -> (f64, f64) {
    let both = covariance.slopes(2).map(|(slopes, explained)| (slopes[at], explained));
    both.unwrap_or_else(|| covariance.slope(2, at))
}

/// Return the ratio of camera to encoder displacement along column `at`, at the best lag; `None`
/// with too little travel or agreement.
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
                let carriage = tracks.carriage.between(time - lag_s, MAX_INTERPOLATION_S)?;
                Some([carriage[0], carriage[1], peg[at]])
            })
            .collect();
        (MIN_POINTS <= rows.len()).then(|| scale_of(&Covariance::new(&rows), at))
    });
    let (slope, explained) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (MIN_SCALE_EXPLAINED <= explained).then_some(slope)
}
