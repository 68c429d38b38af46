//! Rise time of the velocity estimate after an impact: time until 63 % of the velocity change.

use super::{
    evaluate::{EvaluatedFrame, EvaluatedRun},
    settings::{FilterSettings, Object},
    slope::{Impact, impacts},
    track::Detections,
};
use crate::stats::{median, quantile};
use serde::Serialize;

/// Fraction of the velocity change that defines the rise time: 1 - 1/e.
const SHARE: f64 = 0.632_120_558_828_557_7;
/// Longest evaluated time after an impact (frames).
pub const LONGEST_FRAMES: usize = 60;
/// Maximum distance of a striker that counts as hit (m): contact distance plus the travel of one
/// frame.
const STRIKER_DISTANCE: f64 = 0.03;

/// Object that the ball hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hit {
    /// A wall, or anything else other than a striker.
    Wall,
    /// A striker.
    Striker,
}

/// Step response of each filter to an impact: fraction of the velocity change by frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Object that the ball hit.
    pub hit: Hit,
    /// Time from the impact to each frame (s), from the last frame before it.
    pub times_s: Vec<f64>,
    /// Response of the tuned filter.
    pub own: Vec<f64>,
    /// Response of the upstream filter.
    pub upstream: Vec<f64>,
}

/// Rise times of one filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rise {
    /// Median number of frames until 63 % of the change; the first frame after the impact is 1.
    pub median_frames: f64,
    /// 95th percentile of that number.
    pub p95_frames: f64,
    /// Median time from the impact to that frame (s).
    pub median_s: f64,
}

/// Rise times after impacts of one kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RiseTimes {
    /// Object that the ball hit.
    pub hit: Hit,
    /// Number of impacts.
    pub impacts: usize,
    /// Rise time of the tuned filter.
    #[serde(rename = "tuned")]
    pub own: Rise,
    /// Rise time of the upstream filter.
    pub upstream: Rise,
}

/// Step responses to all impacts of the ball in `runs`.
#[must_use]
pub fn responses(runs: &[EvaluatedRun], settings: &FilterSettings) -> Vec<Response> {
    let mut all = Vec::new();
    for run in runs {
        let frames: Vec<_> = run.frames.iter().map(|judged| judged.frame).collect();
        let impacts = impacts(&frames, Object::Ball, settings);
        for (k, impact) in impacts.iter().enumerate() {
            let next = impacts.get(k + 1).map_or(run.frames.len(), |next| next.frame);
            let end = next.min(impact.frame + LONGEST_FRAMES);
            all.extend(response(&run.frames[impact.frame - 1..end], impact));
        }
    }
    all
}

fn response(frames: &[EvaluatedFrame], impact: &Impact) -> Option<Response> {
    let ball = Object::Ball.index();
    let first = frames.get(1)?.frame.seen;
    let change = [0, 1].map(|axis| impact.after[axis] - impact.before[axis]);
    let size = impact.change();
    let share = |vx: f64, vy: f64| {
        ((vx - impact.before[0]) * change[0] + (vy - impact.before[1]) * change[1]) / (size * size)
    };
    let mut response = Response {
        hit: hit(&first, impact.position),
        times_s: Vec::new(),
        own: Vec::new(),
        upstream: Vec::new(),
    };
    for judged in frames {
        let (own, upstream) = (judged.estimates[ball]?.mean, judged.upstream[ball]?);
        let since = judged.frame.seen.time.seconds_since(first.time) + impact.since_s;
        response.times_s.push(since);
        response.own.push(share(own[2], own[3]));
        response.upstream.push(share(upstream[2], upstream[3]));
    }
    Some(response)
}

fn hit(seen: &Detections, position: [f64; 2]) -> Hit {
    let near = seen.positions[1..].iter().flatten().any(|striker| {
        (striker[0] - position[0]).hypot(striker[1] - position[1]) < STRIKER_DISTANCE
    });
    if near { Hit::Striker } else { Hit::Wall }
}

/// Rise times by the object that was hit; kinds without an impact are left out.
#[must_use]
pub fn rises(responses: &[Response]) -> Vec<RiseTimes> {
    [Hit::Wall, Hit::Striker]
        .into_iter()
        .filter_map(|hit| {
            let of_kind: Vec<&Response> = responses.iter().filter(|own| own.hit == hit).collect();
            Some(RiseTimes {
                hit,
                impacts: of_kind.len(),
                own: rise(&of_kind, |response| &response.own)?,
                upstream: rise(&of_kind, |response| &response.upstream)?,
            })
        })
        .collect()
}

/// Rise times of `responses`. A response that ends before 63 % counts with its last frame, a lower
/// bound.
fn rise(responses: &[&Response], of: fn(&Response) -> &[f64]) -> Option<Rise> {
    let reached: Vec<(f64, f64)> = responses
        .iter()
        .filter_map(|response| {
            let last = response.times_s.len().checked_sub(1).filter(|last| 1 <= *last)?;
            let frame = of(response).iter().skip(1).position(|share| SHARE <= *share);
            let frame = frame.map_or(last, |frame| frame + 1);
            Some((frame as f64, response.times_s[frame]))
        })
        .collect();
    let (frames, times): (Vec<f64>, Vec<f64>) = reached.into_iter().unzip();
    Some(Rise {
        median_frames: median(&frames)?,
        p95_frames: quantile(&frames, 0.95)?,
        median_s: median(&times)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_frame_after_an_impact_is_one() {
        let response = |own: &[f64]| Response {
            hit: Hit::Wall,
            times_s: (0..own.len()).map(|k| k as f64 / 100.0 - 0.004).collect(),
            own: own.to_vec(),
            upstream: vec![0.0; own.len()],
        };
        let both = [response(&[0.0, 0.9, 1.0]), response(&[0.0, 0.1, 0.5, 0.7])];
        let rises = rises(&both);
        assert_eq!(rises.len(), 1);
        assert_eq!((rises[0].impacts, rises[0].own.median_frames), (2, 2.0));
        assert!((rises[0].own.median_s - 0.016).abs() < 1e-12);
        // Never reached: the last frame of each, 2 and 3.
        assert_eq!(rises[0].upstream.median_frames, 2.5);
    }
}
