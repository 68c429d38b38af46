//! Consistency and accuracy of a filter on validation runs, compared with the upstream filter.

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

/// Number of frames at the start of a run that are excluded: the velocity estimates converge there.
const SETTLING_FRAMES: usize = 12;
/// Longest lag of the autocorrelation of innovations (detections).
pub const LONGEST_LAG: usize = 20;
/// Longest lag of the autocorrelation for the effective sample size.
const LONGEST_MEMORY: usize = 200;
/// 97.5 % quantile of the standard normal distribution.
const Z95: f64 = 1.959_964;
/// Minimum effective sample size of a region for a consistency verdict.
const LEAST_INDEPENDENT: f64 = 10.0;

/// Results of both filters for one frame.
#[derive(Debug, Clone, Copy)]
pub struct EvaluatedFrame {
    /// Detections and ground truth.
    pub frame: Frame,
    /// Filter step by object.
    pub steps: [Step; 3],
    /// Mean and covariance after the frame, by object.
    pub estimates: [Option<Estimate>; 3],
    /// State that the upstream filter reports, by object.
    pub upstream: [Option<[f64; 4]>; 3],
    /// Reference velocity (m/s) by object: ground truth, or the slope of the detections.
    pub velocity: [Option<[f64; 2]>; 3],
    /// Latency prediction by object, made at capture time of this frame.
    pub ahead: [Option<Ahead>; 3],
}

/// Position estimate at the capture time of a frame, from the newest frame that had arrived by
/// then. That frame is at least [`FilterSettings::latency_s`] old.
#[derive(Debug, Clone, Copy)]
pub struct Ahead {
    /// Position estimate in the newest frame that had arrived (m).
    pub stale: [f64; 2],
    /// The same estimate predicted to the capture time (m).
    pub predicted: [f64; 2],
}

/// A run with the results of both filters.
#[derive(Debug, Clone)]
pub struct EvaluatedRun {
    /// Name of the recording and number of the run.
    pub name: String,
    /// Results by frame.
    pub frames: Vec<EvaluatedFrame>,
}

/// Mean of a chi-square distributed quantity, and its 95 % band for a consistent filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Number of samples.
    pub samples: usize,
    /// Effective sample size: number of independent samples whose mean has the same variance.
    pub independent_samples: f64,
    /// Mean of the samples.
    pub mean: f64,
    /// 95 % band of the mean for a consistent filter: chi-square quantiles with `degrees` times the
    /// effective sample size as degrees of freedom, divided by the effective sample size.
    pub band95: [f64; 2],
    /// Position of the mean relative to `band95`; `None` below ten independent samples.
    pub verdict: Option<ConsistencyVerdict>,
}

/// Result of the chi-square consistency test (NIS or NEES).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ConsistencyVerdict {
    /// The mean is inside the band.
    Consistent,
    /// The mean is above the band: errors are larger than the covariance states.
    Overconfident,
    /// The mean is below the band: errors are smaller than the covariance states.
    Conservative,
}

impl ConsistencyVerdict {
    fn of(mean: f64, [low, high]: [f64; 2]) -> Self {
        if high < mean {
            Self::Overconfident
        } else if mean < low {
            Self::Conservative
        } else {
            Self::Consistent
        }
    }

    /// Name in documents and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Consistent => "consistent",
            Self::Overconfident => "overconfident",
            Self::Conservative => "conservative",
        }
    }
}

/// Evaluation of one object in one region.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionEvaluation {
    /// The region.
    pub region: Region,
    /// Normalised innovation squared; 2 for a consistent filter.
    pub nis: Option<Consistency>,
    /// Normalised estimation error squared, where ground truth is known; 4 for a consistent filter.
    pub nees: Option<Consistency>,
    /// Root mean square error of the velocity vector (m/s).
    pub velocity_rmse_m_per_s: Option<f64>,
    /// The same with the upstream filter (m/s).
    pub upstream_velocity_rmse_m_per_s: Option<f64>,
}

/// Evaluation of one object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectEvaluation {
    /// The object.
    pub object: Object,
    /// Number of detections with a prediction.
    pub detections: usize,
    /// Fraction of these that the gate rejected, 0 to 1.
    pub gated_fraction: f64,
    /// Source of the reference velocity: `truth` or `slope_of_detections`.
    pub velocity_reference: &'static str,
    /// Root mean square error of the velocity vector over all regions (m/s).
    pub velocity_rmse_m_per_s: Option<f64>,
    /// The same with the upstream filter (m/s).
    pub upstream_velocity_rmse_m_per_s: Option<f64>,
    /// RMS position error after prediction over the measured latency (m), where ground truth is
    /// known.
    pub predicted_position_rmse_m: Option<f64>,
    /// RMS position error without that prediction (m).
    pub unpredicted_position_rmse_m: Option<f64>,
    /// Evaluation by region.
    pub regions: Vec<RegionEvaluation>,
    /// Whiteness of the innovations.
    pub whiteness: Whiteness,
}

/// Autocorrelation of normalised innovations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whiteness {
    /// Autocorrelation by axis, from lag 1 (detections).
    pub autocorrelation: [Vec<f64>; 2],
    /// Half-width of the 95 % band around 0 for white innovations.
    pub limit95: f64,
    /// Fraction of all values within that band.
    pub fraction_within: f64,
}

/// Run both filters over `runs`.
#[must_use]
pub fn follow<'a>(
    settings: &FilterSettings,
    runs: impl Iterator<Item = &'a FrameRun>,
) -> Vec<EvaluatedRun> {
    runs.map(|run| follow_run(settings, run)).collect()
}

fn follow_run(settings: &FilterSettings, run: &FrameRun) -> EvaluatedRun {
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
        frames.push(EvaluatedFrame { frame: *frame, steps, estimates, upstream, velocity, ahead });
    }
    EvaluatedRun { name: run.name.clone(), frames }
}

/// Newest estimate that had arrived when `time` was captured, without and with prediction to
/// `time`.
fn ahead(
    settings: &FilterSettings,
    before: &[EvaluatedFrame],
    time: Nanos,
    object: Object,
) -> Option<Ahead> {
    let arrived = time.after_seconds(-settings.latency_s);
    let newest = before.iter().rev().find(|frame| frame.frame.seen.time <= arrived)?;
    let mut estimate = newest.estimates[object.index()]?;
    let stale = [estimate.mean[0], estimate.mean[1]];
    let [_, left, right] = newest.frame.seen.positions;
    let waited = time.seconds_since(newest.frame.seen.time);
    ObjectFilter::new(settings, object).predict(&mut estimate, waited, &[left, right]);
    Some(Ahead { stale, predicted: [estimate.mean[0], estimate.mean[1]] })
}

/// Evaluate `object`: the ball in every region, a striker in one.
#[must_use]
pub fn evaluate(
    runs: &[EvaluatedRun],
    object: Object,
    settings: &FilterSettings,
) -> ObjectEvaluation {
    let index = object.index();
    let judged: Vec<&EvaluatedFrame> =
        runs.iter().flat_map(|run| run.frames.iter().skip(SETTLING_FRAMES)).collect();
    let innovations = || judged.iter().filter_map(|frame| frame.steps[index].innovation);
    let detections = innovations().count();
    let refused = innovations().filter(|own| own.gate == Gate::Rejected).count();
    let has_ball = settings.object(object).ball.is_some();
    let regions = if has_ball { &Region::ALL[..] } else { &Region::ALL[..1] };
    let [own, upstream] = velocity_rmse(&judged, index, None);
    let known = judged.iter().any(|frame| frame.frame.truth[index].is_some());
    let place_rmse = |position: &dyn Fn(&EvaluatedFrame) -> Option<[f64; 2]>| {
        let squares: Vec<f64> = judged
            .iter()
            .filter_map(|frame| {
                let (position, truth) = (position(frame)?, frame.frame.truth[index]?);
                Some((position[0] - truth[0]).powi(2) + (position[1] - truth[1]).powi(2))
            })
            .collect();
        mean(&squares).map(f64::sqrt)
    };
    ObjectEvaluation {
        object,
        detections,
        gated_fraction: refused as f64 / detections.max(1) as f64,
        velocity_reference: if known { "truth" } else { "slope_of_detections" },
        velocity_rmse_m_per_s: own,
        upstream_velocity_rmse_m_per_s: upstream,
        predicted_position_rmse_m: place_rmse(&|frame| Some(frame.ahead[index]?.predicted)),
        unpredicted_position_rmse_m: place_rmse(&|frame| Some(frame.ahead[index]?.stale)),
        regions: regions.iter().map(|region| evaluate_region(&judged, index, *region)).collect(),
        whiteness: whiteness(runs, index),
    }
}

fn evaluate_region(judged: &[&EvaluatedFrame], index: usize, region: Region) -> RegionEvaluation {
    let inside: Vec<&EvaluatedFrame> =
        judged.iter().copied().filter(|frame| frame.steps[index].region == region).collect();
    let nis: Vec<f64> = inside
        .iter()
        .filter_map(|frame| frame.steps[index].innovation)
        .filter(|own| own.gate == Gate::Accepted)
        .map(|own| own.nis)
        .collect();
    let nees: Vec<f64> = inside.iter().filter_map(|frame| frame.nees(index)).collect();
    let [own, upstream] = velocity_rmse(judged, index, Some(region));
    RegionEvaluation {
        region,
        nis: consistency(&nis, 2.0),
        nees: consistency(&nees, 4.0),
        velocity_rmse_m_per_s: own,
        upstream_velocity_rmse_m_per_s: upstream,
    }
}

impl EvaluatedFrame {
    /// Normalised estimation error squared of an object, where ground truth is known.
    #[must_use]
    pub fn nees(&self, index: usize) -> Option<f64> {
        let (estimate, truth) = (self.estimates[index]?, self.frame.truth[index]?);
        let error = std::array::from_fn(|k| estimate.mean[k] - truth[k]);
        mahalanobis(&estimate.covariance, &error)
    }
}

/// RMS error of the velocity vector of both filters, over frames in which both report one (m/s).
fn velocity_rmse(
    judged: &[&EvaluatedFrame],
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

/// Test the mean of `values` against chi-square with `degrees` degrees of freedom.
fn consistency(values: &[f64], degrees: f64) -> Option<Consistency> {
    let centre = mean(values)?;
    let independent = independent_samples(values);
    let edge = |z: f64| chi_square_quantile(z, degrees * independent) / independent;
    let band95 = [edge(-Z95), edge(Z95)];
    let verdict =
        (LEAST_INDEPENDENT <= independent).then(|| ConsistencyVerdict::of(centre, band95));
    Some(Consistency {
        samples: values.len(),
        independent_samples: independent,
        mean: centre,
        band95,
        verdict,
    })
}

/// Effective sample size n / (1 + 2 sum of autocorrelations), summed up to the first non-positive
/// one (Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7, 1992).
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

fn whiteness(runs: &[EvaluatedRun], index: usize) -> Whiteness {
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
    let fraction_within = within as f64 / all().count().max(1) as f64;
    Whiteness { autocorrelation, limit95, fraction_within }
}
