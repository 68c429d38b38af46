//! How honest and how fast a filter is on runs that it was not tuned on, beside the upstream filter.

use super::{
    data::{Frame, FrameRun},
    filter::{Gate, ObjectFilter},
    matrix::mahalanobis,
    motion::Estimate,
    region::Region,
    settings::{FilterSettings, Object},
    slope::velocities,
    track::{BoardFilter, Observed, Step},
    upstream::UpstreamFilter,
};
use crate::{
    stats::{chi_square_quantile, mean},
    units::Nanos,
};
use serde::Serialize;

/// Frames at the start of a run that are not judged: the filters find their velocities there.
const SETTLING_FRAMES: usize = 12;
/// Longest lag of the autocorrelation of innovations (detections).
pub const LONGEST_LAG: usize = 20;
/// Longest lag that is looked at for the effective number of samples.
const LONGEST_MEMORY: usize = 200;
/// 97.5 % quantile of the standard normal distribution.
const Z95: f64 = 1.959_964;
/// Fewest independent samples in a region of which a mean is judged.
const LEAST_INDEPENDENT: f64 = 10.0;

/// What three filters made of one frame.
#[derive(Debug, Clone, Copy)]
pub struct JudgedFrame {
    /// What was seen, and what is true.
    pub frame: Frame,
    /// What happened, by object.
    pub steps: [Step; 3],
    /// (mean, variances and covariances) after the frame, by object.
    pub estimates: [Option<Estimate>; 3],
    /// What upstream reports, by object.
    pub upstream: [Option<[f64; 4]>; 3],
    /// Velocity that counts as true (m/s), by object: the simulator's, or the slope of the detections.
    pub velocity: [Option<[f64; 2]>; 3],
    /// By object: what a controller knew when this was captured.
    pub ahead: [Option<Ahead>; 3],
}

/// What was known of a place when its picture was taken, the newest picture then being
/// [`FilterSettings::latency_s`] old or a little more.
#[derive(Debug, Clone, Copy)]
pub struct Ahead {
    /// Where the object was believed to be in the newest picture (m).
    pub stale: [f64; 2],
    /// The same moved ahead (m).
    pub predicted: [f64; 2],
}

/// A run with both filters beside the detections.
#[derive(Debug, Clone)]
pub struct JudgedRun {
    /// Of the recording.
    pub name: String,
    /// Frame by frame.
    pub frames: Vec<JudgedFrame>,
}

/// The mean of a chi-square quantity, and where it lies for a consistent filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Samples.
    pub samples: usize,
    /// As many independent samples have a mean that scatters as much.
    pub independent_samples: f64,
    /// Their mean.
    pub mean: f64,
    /// Where 95 % of the means of consistent filters lie: chi-square with `degrees` times the
    /// independent samples, divided by these.
    pub band95: [f64; 2],
    /// Whether the mean lies there; `None` where there are too few independent samples to say.
    pub within: Option<bool>,
}

/// One region of one object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionJudgement {
    /// Which one.
    pub region: Region,
    /// Normalised innovation squared; 2 for a consistent filter.
    pub nis: Option<Consistency>,
    /// Normalised estimation error squared, where the truth is known; 4 for a consistent filter.
    pub nees: Option<Consistency>,
    /// Root mean square error of the velocity vector (m/s).
    pub velocity_rmse_m_per_s: Option<f64>,
    /// The same with upstream's settings.
    pub upstream_velocity_rmse_m_per_s: Option<f64>,
}

/// One object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectJudgement {
    /// Which one.
    pub object: Object,
    /// Detections with a prediction.
    pub detections: usize,
    /// Share of them that the gate refused.
    pub refused_share: f64,
    /// What the velocity is compared with: `truth` or `slope_of_detections`.
    pub velocity_reference: &'static str,
    /// Root mean square error of the velocity vector over all regions (m/s).
    pub velocity_rmse_m_per_s: Option<f64>,
    /// The same with upstream's settings.
    pub upstream_velocity_rmse_m_per_s: Option<f64>,
    /// Error of the place that was predicted over the measured latency (m), where the truth is known.
    pub predicted_place_rmse_m: Option<f64>,
    /// The same without prediction: the newest estimate as it is.
    pub unpredicted_place_rmse_m: Option<f64>,
    /// By region.
    pub regions: Vec<RegionJudgement>,
    /// Innovations after one another.
    pub whiteness: Whiteness,
}

/// Autocorrelation of normalised innovations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whiteness {
    /// By axis, from lag 1 (detections).
    pub autocorrelation: [Vec<f64>; 2],
    /// 95 % of the values of white innovations lie within plus and minus this.
    pub limit95: f64,
    /// Share of all values within it.
    pub share_within: f64,
}

/// Runs both filters over `runs`.
#[must_use]
pub fn follow<'a>(
    settings: &FilterSettings,
    runs: impl Iterator<Item = &'a FrameRun>,
) -> Vec<JudgedRun> {
    runs.map(|run| follow_run(settings, run)).collect()
}

fn follow_run(settings: &FilterSettings, run: &FrameRun) -> JudgedRun {
    let mut filter = BoardFilter::new(settings);
    let mut upstream = UpstreamFilter::new(&settings.board);
    let slopes = Object::ALL.map(|object| velocities(&run.frames, object, settings));
    let mut frames = Vec::with_capacity(run.frames.len());
    for (k, frame) in run.frames.iter().enumerate() {
        let time = frame.seen.time;
        let ahead = Object::ALL.map(|object| ahead(settings, &frames, time, object));
        let Observed::Taken(steps) = filter.observe(&frame.seen) else { continue };
        let estimates = Object::ALL.map(|object| filter.estimate_at(object, time));
        let velocity = Object::ALL.map(|object| match frame.truth[object.index()] {
            Some([_, _, vx, vy]) => Some([vx, vy]),
            None => slopes[object.index()][k],
        });
        let upstream = upstream.observe(&frame.seen);
        frames.push(JudgedFrame { frame: *frame, steps, estimates, upstream, velocity, ahead });
    }
    JudgedRun { name: run.name.clone(), frames }
}

/// The newest belief that had arrived when `time` was captured, as it was and moved ahead.
fn ahead(
    settings: &FilterSettings,
    before: &[JudgedFrame],
    time: Nanos,
    object: Object,
) -> Option<Ahead> {
    let arrived = time.after_seconds(-settings.latency_s);
    let newest = before.iter().rev().find(|frame| frame.frame.seen.time <= arrived)?;
    let mut estimate = newest.estimates[object.index()]?;
    let stale = [estimate.mean[0], estimate.mean[1]];
    let [_, left, right] = newest.frame.seen.places;
    let waited = time.seconds_since(newest.frame.seen.time);
    ObjectFilter::new(settings, object).predict(&mut estimate, waited, &[left, right]);
    Some(Ahead { stale, predicted: [estimate.mean[0], estimate.mean[1]] })
}

/// Judges `object`, which has one region or all.
#[must_use]
pub fn judge(runs: &[JudgedRun], object: Object, settings: &FilterSettings) -> ObjectJudgement {
    let index = object.index();
    let judged: Vec<&JudgedFrame> =
        runs.iter().flat_map(|run| run.frames.iter().skip(SETTLING_FRAMES)).collect();
    let innovations = || judged.iter().filter_map(|frame| frame.steps[index].innovation);
    let detections = innovations().count();
    let refused = innovations().filter(|own| own.gate == Gate::Refused).count();
    let has_ball = settings.object(object).ball.is_some();
    let regions = if has_ball { &Region::ALL[..] } else { &Region::ALL[..1] };
    let [own, upstream] = velocity_rmse(&judged, index, None);
    let known = judged.iter().any(|frame| frame.frame.truth[index].is_some());
    let place_rmse = |place: &dyn Fn(&JudgedFrame) -> Option<[f64; 2]>| {
        let squares: Vec<f64> = judged
            .iter()
            .filter_map(|frame| {
                let (place, truth) = (place(frame)?, frame.frame.truth[index]?);
                Some((place[0] - truth[0]).powi(2) + (place[1] - truth[1]).powi(2))
            })
            .collect();
        mean(&squares).map(f64::sqrt)
    };
    ObjectJudgement {
        object,
        detections,
        refused_share: refused as f64 / detections.max(1) as f64,
        velocity_reference: if known { "truth" } else { "slope_of_detections" },
        velocity_rmse_m_per_s: own,
        upstream_velocity_rmse_m_per_s: upstream,
        predicted_place_rmse_m: place_rmse(&|frame| Some(frame.ahead[index]?.predicted)),
        unpredicted_place_rmse_m: place_rmse(&|frame| Some(frame.ahead[index]?.stale)),
        regions: regions.iter().map(|region| judge_region(&judged, index, *region)).collect(),
        whiteness: whiteness(runs, index),
    }
}

fn judge_region(judged: &[&JudgedFrame], index: usize, region: Region) -> RegionJudgement {
    let inside: Vec<&JudgedFrame> =
        judged.iter().copied().filter(|frame| frame.steps[index].region == region).collect();
    let nis: Vec<f64> = inside
        .iter()
        .filter_map(|frame| frame.steps[index].innovation)
        .filter(|own| own.gate == Gate::Accepted)
        .map(|own| own.nis)
        .collect();
    let nees: Vec<f64> = inside.iter().filter_map(|frame| frame.nees(index)).collect();
    let [own, upstream] = velocity_rmse(judged, index, Some(region));
    RegionJudgement {
        region,
        nis: consistency(&nis, 2.0),
        nees: consistency(&nees, 4.0),
        velocity_rmse_m_per_s: own,
        upstream_velocity_rmse_m_per_s: upstream,
    }
}

impl JudgedFrame {
    /// Normalised estimation error squared of an object, where the truth is known.
    #[must_use]
    pub fn nees(&self, index: usize) -> Option<f64> {
        let (estimate, truth) = (self.estimates[index]?, self.frame.truth[index]?);
        let error = std::array::from_fn(|k| estimate.mean[k] - truth[k]);
        mahalanobis(&estimate.covariance, &error)
    }
}

/// Root mean square error of the velocity vector of both filters where both report one (m/s).
fn velocity_rmse(
    judged: &[&JudgedFrame],
    index: usize,
    region: Option<Region>,
) -> [Option<f64>; 2] {
    let mut squares = [Vec::new(), Vec::new()];
    for frame in judged {
        let inside = region.is_none_or(|region| frame.steps[index].region == region);
        let (Some(v), Some(own), Some(upstream)) =
            (frame.velocity[index], frame.estimates[index], frame.upstream[index])
        else {
            continue;
        };
        if inside {
            for (squares, state) in squares.iter_mut().zip([own.mean, upstream]) {
                squares.push((state[2] - v[0]).powi(2) + (state[3] - v[1]).powi(2));
            }
        }
    }
    squares.map(|squares| mean(&squares).map(f64::sqrt))
}

/// Whether the mean of `values` is that of chi-square with `degrees` degrees of freedom.
fn consistency(values: &[f64], degrees: f64) -> Option<Consistency> {
    let centre = mean(values)?;
    let independent = independent_samples(values);
    let edge = |z: f64| chi_square_quantile(z, degrees * independent) / independent;
    let band95 = [edge(-Z95), edge(Z95)];
    let within =
        (LEAST_INDEPENDENT <= independent).then_some(band95[0] <= centre && centre <= band95[1]);
    Some(Consistency {
        samples: values.len(),
        independent_samples: independent,
        mean: centre,
        band95,
        within,
    })
}

/// n / (1 + 2 sum of autocorrelations), up to the first that is not positive (Geyer, "Practical
/// Markov chain Monte Carlo", Statistical Science 7, 1992).
fn independent_samples(values: &[f64]) -> f64 {
    let n = values.len();
    let centre = mean(values).unwrap_or(0.0);
    let lagged = |lag: usize| -> f64 {
        values.iter().zip(&values[lag..]).map(|(a, b)| (a - centre) * (b - centre)).sum()
    };
    let variance = lagged(0);
    if variance <= 0.0 {
        return n as f64;
    }
    let sum: f64 = (1..LONGEST_MEMORY.min(n))
        .map(|lag| lagged(lag) / variance)
        .take_while(|correlation| 0.0 < *correlation)
        .sum();
    (n as f64 / (1.0 + 2.0 * sum)).max(1.0)
}

fn whiteness(runs: &[JudgedRun], index: usize) -> Whiteness {
    let mut sums = [[0.0; LONGEST_LAG + 1]; 2];
    let mut pairs = 0_usize;
    for run in runs {
        let normalised: Vec<[f64; 2]> = run
            .frames
            .iter()
            .skip(SETTLING_FRAMES)
            .filter_map(|frame| frame.steps[index].innovation)
            .filter(|own| own.gate == Gate::Accepted)
            .map(|own| [0, 1].map(|axis| own.residual[axis] / own.covariance[axis][axis].sqrt()))
            .collect();
        pairs += normalised.len();
        for lag in 0..=LONGEST_LAG.min(normalised.len().saturating_sub(1)) {
            for (now, later) in normalised.iter().zip(&normalised[lag..]) {
                for axis in 0..2 {
                    sums[axis][lag] += now[axis] * later[axis];
                }
            }
        }
    }
    let limit95 = Z95 / (pairs.max(1) as f64).sqrt();
    let autocorrelation = sums.map(|sums| {
        sums[1..].iter().map(|sum| sum / sums[0].max(f64::MIN_POSITIVE)).collect::<Vec<f64>>()
    });
    let all = || autocorrelation.iter().flatten();
    let within = all().filter(|value| value.abs() <= limit95).count();
    let share_within = within as f64 / all().count().max(1) as f64;
    Whiteness { autocorrelation, limit95, share_within }
}
