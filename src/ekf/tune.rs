//! Maximum-likelihood tuning of the filter on the innovations of the training runs.
//!
//! The innovation log-likelihood of a filter is the sum of ln N(residual; 0, S) over all detections
//! (Schweppe, "Evaluation of likelihood functions for Gaussian signals", IEEE Transactions on
//! Information Theory 11, 1965). The density is a mixture: with a probability of 0.1 % a detection
//! is clutter, uniform over the board. An outlier therefore costs at most 18 nats.
//!
//! argmin's Nelder-Mead maximizes it by block coordinate search: in stages of a few parameters that
//! act together, repeated twice. The stages are the open board, impacts on walls, the region of the
//! wall, of the striker, and of the goal. All thirteen parameters of a ball at once are too many
//! for a simplex. The objective is deterministic. The size of a region moves samples in and out of
//! it, so the objective has steps and no gradient, which Nelder-Mead does not need. Parameters are
//! optimized as logarithms, so that densities stay positive.

use super::{
    data::{Data, Frame, FrameRun},
    filter::{Gate, Innovation, Measurement, ObjectFilter},
    region::{Region, Strikers},
    settings::{BallSettings, BoardSettings, FilterSettings, Object, ObjectSettings},
    track::{Track, held},
};
use crate::{recording::Split, units::Nanos};
use argmin::{
    core::{CostFunction, Executor},
    solver::neldermead::NelderMead,
};
use serde::Serialize;
use std::f64::consts::TAU;

/// Probability that a detection is clutter.
const CLUTTER: f64 = 1e-3;
/// Minimum number of detections in the training runs for tuning a region (1 s at 120 Hz).
pub const LEAST_SAMPLES: usize = 120;
/// Minimum number of visits for tuning a region.
pub const LEAST_VISITS: usize = 10;
/// Number of passes over all stages.
const ROUNDS: usize = 2;
/// Nelder-Mead iterations per parameter of a stage.
const ITERATIONS_PER_NUMBER: u64 = 22;
/// Convergence tolerance of the simplex (nats per detection).
const TOLERANCE: f64 = 1e-6;

/// Tuning record of one object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tuning {
    /// The object.
    pub object: Object,
    /// Number of detections in the training runs.
    pub detections: usize,
    /// Mean innovation log-likelihood of a detection with the initial settings (nats).
    pub log_likelihood_before_nats: f64,
    /// The same with the tuned settings.
    pub log_likelihood_after_nats: f64,
    /// Number of evaluations of the likelihood.
    pub evaluations: usize,
    /// Tuning record by region.
    pub regions: Vec<RegionTuning>,
}

/// Tuning record of one region.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionTuning {
    /// The region.
    pub region: Region,
    /// Number of detections in it in the training runs.
    pub samples: usize,
    /// Number of times that the object entered it.
    pub visits: usize,
    /// True if its parameters were fitted.
    pub tuned: bool,
    /// Reason why they were not fitted; empty otherwise.
    pub reason: String,
}

/// Observer of the tuning. It cannot change the result; calls come from several threads.
pub trait TuneObserver: Sync {
    /// The tuning of `object` begins, in this number of stages.
    fn object_begun(&self, _object: Object, _stages: usize) {}

    /// One stage of `object` is complete.
    fn stage_done(&self, _object: Object) {}
}

/// Observer that shows nothing.
impl TuneObserver for () {}

/// Tune all objects that move in the training runs of `data`, each in its own thread. The result
/// does not depend on the number of threads.
#[must_use]
pub fn tune(
    start: &FilterSettings,
    data: &Data,
    observer: &dyn TuneObserver,
) -> (FilterSettings, Vec<Tuning>) {
    let tuned = std::thread::scope(|scope| {
        let threads = Object::ALL
            .map(|object| scope.spawn(move || tune_object(start, object, data, observer)));
        threads.map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let mut settings = *start;
    let mut tunings = Vec::new();
    for (own, tuning) in tuned {
        *settings.object_mut(tuning.object) = own;
        tunings.push(tuning);
    }
    (settings, tunings)
}

/// Tuned settings and tuning record of one object.
fn tune_object(
    start: &FilterSettings,
    object: Object,
    data: &Data,
    observer: &dyn TuneObserver,
) -> (ObjectSettings, Tuning) {
    let problem = Problem::new(start, object, data);
    let mut own = *start.object(object);
    if problem.has(Needs::Covariance) {
        own.covariance_scale = Some(own.covariance_scale.unwrap_or(1.0));
    }
    let before = problem.score(&own);
    let mut regions = before.regions(&own);
    if !data.moves(object) {
        for region in &mut regions {
            (region.tuned, region.reason) = (false, data.still(object));
        }
    }
    let is_tuned = |region: Region| regions.iter().any(|own| own.region == region && own.tuned);
    let has_ball = own.ball.is_some();
    let applies = |stage: &&'static Stage| {
        is_tuned(stage.region) && (has_ball || stage.knobs.iter().all(|knob| knob.everywhere))
    };
    let stages: Vec<&'static Stage> = STAGES.iter().filter(applies).collect();
    observer.object_begun(object, ROUNDS * stages.len());
    let mut evaluations = 1;
    for _ in 0..ROUNDS {
        for stage in &stages {
            evaluations += problem.improve(stage, &mut own);
            observer.stage_done(object);
        }
    }
    if let Some(sigma) = problem.equivalent_sigma(&own) {
        own.measurement_sigma_m = sigma;
    }
    let after = problem.score(&own);
    let detections = before.detections;
    log::info!("tuned {}: {detections} detections, {evaluations} evaluations", object.name());
    let tuning = Tuning {
        object,
        detections: before.detections,
        log_likelihood_before_nats: before.mean(),
        log_likelihood_after_nats: after.mean(),
        evaluations: evaluations + 1,
        regions,
    };
    (own, tuning)
}

/// Detections that a parameter needs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Needs {
    /// Any.
    Any,
    /// Detections without a covariance.
    Plain,
    /// Detections with a covariance.
    Covariance,
}

/// A tuned parameter.
struct Knob {
    /// The parameter exists for strikers too.
    everywhere: bool,
    needs: Needs,
    low: f64,
    high: f64,
    number: fn(&mut ObjectSettings) -> Option<&mut f64>,
}

impl Knob {
    const fn ball(
        low: f64,
        high: f64,
        number: fn(&mut ObjectSettings) -> Option<&mut f64>,
    ) -> Self {
        Self { everywhere: false, needs: Needs::Any, low, high, number }
    }
}

/// Parameters that are tuned together if their region was visited.
struct Stage {
    region: Region,
    knobs: &'static [Knob],
}

macro_rules! ball {
    ($field:ident) => {
        |own| own.ball.as_mut().map(|ball: &mut BallSettings| &mut ball.$field)
    };
}

/// Stages of the tuning. The first applies to all objects; for strikers it omits the parameters of
/// the ball.
const STAGES: &[Stage] = &[
    Stage {
        region: Region::Open,
        knobs: &[
            Knob {
                everywhere: true,
                needs: Needs::Plain,
                low: 1e-6,
                high: 0.05,
                number: |own| Some(&mut own.measurement_sigma_m),
            },
            Knob {
                everywhere: true,
                needs: Needs::Covariance,
                low: 1e-2,
                high: 1e2,
                number: |own| own.covariance_scale.as_mut(),
            },
            Knob {
                everywhere: true,
                needs: Needs::Any,
                low: 1e-7,
                high: 1e3,
                number: |own| Some(&mut own.open_psd_m2_per_s3),
            },
        ],
    },
    Stage {
        region: Region::Open,
        knobs: &[
            Knob::ball(1e-3, 1.0, ball!(rolling_deceleration_m_per_s2)),
            Knob::ball(1e-3, 10.0, ball!(rolling_drag_per_s)),
        ],
    },
    Stage {
        region: Region::NearWallX,
        knobs: &[
            Knob::ball(0.05, 1.0, ball!(wall_restitution)),
            Knob::ball(1e-3, 0.5, ball!(wall_restitution_sigma)),
            Knob::ball(1e-3, 0.5, ball!(wall_tangential_sigma)),
        ],
    },
    Stage {
        region: Region::NearWallX,
        knobs: &[
            Knob::ball(1e-5, 1e3, ball!(near_wall_x_psd_m2_per_s3)),
            Knob::ball(1e-5, 1e3, ball!(near_wall_y_psd_m2_per_s3)),
            Knob::ball(2e-3, 0.06, ball!(near_wall_distance_m)),
        ],
    },
    Stage {
        region: Region::NearStriker,
        knobs: &[
            Knob::ball(1e-3, 1e4, ball!(near_striker_psd_m2_per_s3)),
            // Ball and striker touch at 14.5 mm; a striker at 0.4 m/s comes 3.4 mm in a frame.
            Knob::ball(0.018, 0.06, ball!(near_striker_distance_m)),
        ],
    },
    Stage {
        region: Region::GoalRim,
        knobs: &[
            Knob::ball(1e-4, 1e4, ball!(goal_rim_psd_m2_per_s3)),
            Knob::ball(1e-3, 0.03, ball!(goal_rim_width_m)),
        ],
    },
];

/// A detection, or its absence, at an instant.
#[derive(Clone, Copy)]
struct Sample {
    time: Nanos,
    seen: Option<Measurement>,
    strikers: Strikers,
}

/// Training runs of one object.
struct Problem {
    start: FilterSettings,
    object: Object,
    runs: Vec<Vec<Sample>>,
    clutter_density: f64,
}

/// Likelihood of the training runs under a filter, and statistics by region.
#[derive(Default)]
struct Score {
    sum: f64,
    detections: usize,
    samples: [usize; 5],
    visits: [usize; 5],
}

impl Score {
    fn mean(&self) -> f64 {
        self.sum / self.detections.max(1) as f64
    }

    /// Tuning record of the regions: all for a ball, one for a striker.
    fn regions(&self, own: &ObjectSettings) -> Vec<RegionTuning> {
        let all = if own.ball.is_some() { &Region::ALL[..] } else { &Region::ALL[..1] };
        let account = |region: &Region| {
            let (samples, visits) = (self.samples[*region as usize], self.visits[*region as usize]);
            let few_visits = *region != Region::Open && visits < LEAST_VISITS;
            let reason = if samples < LEAST_SAMPLES || few_visits {
                format!(
                    "{samples} detections in {visits} visits are too few (at least {LEAST_SAMPLES} in \
                     {LEAST_VISITS}); the default is kept"
                )
            } else {
                String::new()
            };
            RegionTuning { region: *region, samples, visits, tuned: reason.is_empty(), reason }
        };
        all.iter().map(account).collect()
    }
}

impl Problem {
    fn new(start: &FilterSettings, object: Object, data: &Data) -> Self {
        let samples = |run: &FrameRun| {
            let mut strikers: Strikers = [None; 2];
            let sample = |frame: &Frame| {
                strikers = held(strikers, &frame.seen.positions);
                let seen = frame.seen.measurement(object);
                Sample { time: frame.seen.time, seen, strikers }
            };
            run.frames.iter().map(sample).collect()
        };
        let BoardSettings { short_side_m, long_side_m, .. } = start.board;
        Self {
            start: *start,
            object,
            runs: data.runs_for(Split::Train).map(samples).collect(),
            clutter_density: CLUTTER / (short_side_m * long_side_m),
        }
    }

    fn measurements(&self) -> impl Iterator<Item = Measurement> {
        self.runs.iter().flatten().filter_map(|sample| sample.seen)
    }

    /// Return whether the training runs have the detections that a parameter needs.
    fn has(&self, needs: Needs) -> bool {
        match needs {
            Needs::Any => true,
            Needs::Plain => self.measurements().any(|own| own.covariance.is_none()),
            Needs::Covariance => self.measurements().any(|own| own.covariance.is_some()),
        }
    }

    /// Parameters of a stage that the training runs determine.
    fn knobs(&self, stage: &'static Stage) -> Vec<&'static Knob> {
        stage.knobs.iter().filter(|knob| self.has(knob.needs)).collect()
    }

    /// Root mean square of the scaled standard deviations (m) where every detection carries a covariance. A simulation
    /// draws noise of this size.
    fn equivalent_sigma(&self, own: &ObjectSettings) -> Option<f64> {
        if self.has(Needs::Plain) {
            return None;
        }
        let variances = self.measurements().filter_map(|seen| {
            let [xx, _, yy] = seen.covariance?;
            Some(f64::midpoint(xx, yy))
        });
        let variances: Vec<f64> = variances.collect();
        Some((own.covariance_scale? * crate::stats::mean(&variances)?).sqrt())
    }

    fn score(&self, own: &ObjectSettings) -> Score {
        let mut settings = self.start;
        *settings.object_mut(self.object) = *own;
        let filter = ObjectFilter::new(&settings, self.object);
        let mut score = Score::default();
        for run in &self.runs {
            let mut track = None;
            let mut last = None;
            for sample in run {
                let seen = (sample.time, sample.seen);
                let step = Track::observe(&mut track, &filter, seen, &sample.strikers);
                let Some(innovation) = step.innovation else { continue };
                score.sum += self.log_density(&innovation);
                score.detections += 1;
                score.samples[step.region as usize] += 1;
                score.visits[step.region as usize] += usize::from(last != Some(step.region));
                last = Some(step.region);
            }
        }
        score
    }

    /// Logarithm of the density of a detection (nats, density in 1/m2).
    fn log_density(&self, innovation: &Innovation) -> f64 {
        let [[xx, xy], [_, yy]] = innovation.covariance;
        let density = match innovation.gate {
            Gate::Accepted => (-0.5 * innovation.nis).exp() / (TAU * (xx * yy - xy * xy).sqrt()),
            Gate::Rejected => 0.0,
        };
        ((1.0 - CLUTTER) * density + self.clutter_density).ln()
    }

    /// Optimize the parameters of one stage; returns the number of evaluations.
    fn improve(&self, stage: &'static Stage, own: &mut ObjectSettings) -> usize {
        let mut start = *own;
        let knobs = self.knobs(stage);
        let position: Vec<f64> = knobs
            .iter()
            .filter_map(|knob| Some((knob.number)(&mut start)?.clamp(knob.low, knob.high).ln()))
            .collect();
        // Initial steps of a third: noise is known to a factor, and restitution moves far enough.
        let vertex = |index: usize| {
            let mut vertex = position.clone();
            if let Some(number) = index.checked_sub(1) {
                vertex[number] += if vertex[number] < 0.0 { 0.3 } else { -0.3 };
            }
            vertex
        };
        let simplex: Vec<Vec<f64>> = (0..=position.len()).map(vertex).collect();
        let iterations = ITERATIONS_PER_NUMBER * position.len() as u64;
        let cost = StageCost { problem: self, knobs: knobs.clone(), own: start };
        let solved = NelderMead::new(simplex).with_sd_tolerance(TOLERANCE).and_then(|solver| {
            Executor::new(cost, solver).configure(|state| state.max_iters(iterations)).run()
        });
        let Ok(solved) = solved else { return 0 };
        let counts = solved.problem.counts.get("cost_count").copied().unwrap_or(0);
        let before = self.score(own).mean();
        if let Some(best) = solved.state.best_param
            && before < -solved.state.best_cost
        {
            *own = StageCost { problem: self, knobs, own: *own }.with(&best);
        }
        counts as usize + 1
    }
}

/// Negative mean log-likelihood as a function of the logarithms of a stage's parameters.
struct StageCost<'a> {
    problem: &'a Problem,
    knobs: Vec<&'static Knob>,
    own: ObjectSettings,
}

impl StageCost<'_> {
    fn with(&self, logarithms: &[f64]) -> ObjectSettings {
        let mut own = self.own;
        for (knob, logarithm) in self.knobs.iter().zip(logarithms) {
            if let Some(number) = (knob.number)(&mut own) {
                *number = logarithm.exp().clamp(knob.low, knob.high);
            }
        }
        own
    }
}

impl CostFunction for StageCost<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, logarithms: &Self::Param) -> Result<f64, argmin::core::Error> {
        Ok(-self.problem.score(&self.with(logarithms)).mean())
    }
}
