//! Tests of the filter against filterpy, finite differences, moments of sampled points, and itself
//! in another order of frames.

use super::{
    matrix::cholesky,
    motion::{Obstacle, Rolling},
    *,
};
use crate::{seed::Stream, units::Nanos};

const PERIOD: f64 = 1.0 / 120.0;
const NOBODY: Strikers = [None, None];

/// Time of frame `k` at 120 Hz.
fn at(k: u64) -> Nanos {
    Nanos(1_700_000_000_000_000_000 + k * 1_000_000_000 / 120)
}

/// Approximately normal number of variance 1: twelve uniform numbers.
fn normal(stream: &mut Stream) -> f64 {
    (0..12).map(|_| f64::from(stream.uniform_f32(-0.5, 0.5))).sum()
}

/// A gate that rejects nothing in these tests.
fn open_gate() -> FilterSettings {
    FilterSettings { gate_probability: 1e-12, ..FilterSettings::default() }
}

/// A ball on a long path: fast, over walls, past a striker, with a frame missing now and then.
fn ball_frames(count: u64) -> Vec<Detections> {
    let mut stream = Stream::new(5, "frames");
    let fold = |s: f64, reach: f64| {
        let t = (s + reach).rem_euclid(4.0 * reach);
        if t < 2.0 * reach { t - reach } else { 3.0 * reach - t }
    };
    (0..count)
        .map(|k| {
            let t = k as f64 * PERIOD;
            let position = [fold(0.9 * t, 0.153), fold(0.05 + 0.7 * t, 0.203)];
            let seen = position.map(|p| p + 4e-4 * normal(&mut stream));
            let left = [0.05 * (3.0 * t).sin(), -0.12];
            let ball = (k % 13 != 7).then_some(seen);
            Detections::new(at(k), [ball, Some(left), (k % 5 != 0).then_some([0.02, 0.1])])
        })
        .collect()
}

fn run(settings: &FilterSettings, frames: &[Detections]) -> BoardFilter {
    let mut filter = BoardFilter::new(settings);
    for seen in frames {
        assert!(matches!(filter.observe(seen), Observed::Taken(_)));
    }
    filter
}

#[derive(serde::Deserialize)]
struct Reference {
    measurement_sigma_m: f64,
    start_speed_sigma_m_per_s: f64,
    psd_m2_per_s3: f64,
    steps: Vec<ReferenceStep>,
}

#[derive(serde::Deserialize)]
struct ReferenceStep {
    time_ns: u64,
    place_m: Option<[f64; 2]>,
    mean: [f64; 4],
    covariance: Matrix4,
}

#[test]
fn the_linear_case_is_that_of_filterpy() {
    let text = include_str!("../../tests/data/ekf_reference.json");
    let reference: Reference = serde_json::from_str(text).unwrap();
    let mut settings = open_gate();
    settings.left = ObjectSettings {
        measurement_sigma_m: reference.measurement_sigma_m,
        covariance_scale: None,
        start_speed_sigma_m_per_s: reference.start_speed_sigma_m_per_s,
        open_psd_m2_per_s3: reference.psd_m2_per_s3,
        ball: None,
    };
    let mut filter = BoardFilter::new(&settings);
    for step in &reference.steps {
        let time = Nanos(step.time_ns);
        filter.observe(&Detections::new(time, [None, step.place_m, None]));
        let own = filter.estimate_at(Object::Left, time).unwrap();
        for i in 0..4 {
            assert!((own.mean[i] - step.mean[i]).abs() < 1e-9, "{own:?}");
            for j in 0..4 {
                let (found, expected) = (own.covariance[i][j], step.covariance[i][j]);
                assert!((found - expected).abs() < 1e-9 * expected.abs().max(1e-3), "{i} {j}");
            }
        }
    }
}

#[test]
fn the_jacobian_of_rolling_is_that_of_finite_differences() {
    let rolling = Rolling { deceleration: 0.3, drag: 0.4 };
    let start = |mean: [f64; 4]| Estimate { mean, covariance: [[0.0; 4]; 4] };
    for mean in [[0.01, 0.02, 0.7, -0.4], [0.0, 0.0, 0.03, 0.01], [0.1, 0.0, 0.0, -1.5]] {
        for column in 0..4 {
            // The covariance of one certain direction shows that column of F.
            let mut estimate = start(mean);
            estimate.covariance[column][column] = 1.0;
            rolling.advance(&mut estimate, PERIOD);
            let step = 1e-6;
            let [up, down] = [step, -step].map(|step| {
                let mut moved = mean;
                moved[column] += step;
                let mut moved = start(moved);
                rolling.advance(&mut moved, PERIOD);
                moved.mean
            });
            let slope: [f64; 4] = std::array::from_fn(|k| (up[k] - down[k]) / (2.0 * step));
            for i in 0..4 {
                for j in 0..4 {
                    let found = estimate.covariance[i][j];
                    assert!(
                        (found - slope[i] * slope[j]).abs() < 1e-7,
                        "{column} {i} {j}: {found}"
                    );
                }
            }
        }
    }
}

#[test]
fn two_half_steps_are_one_step() {
    let filter = ObjectFilter::new(&open_gate(), Object::Left);
    let mut whole = filter.start([0.01, 0.02]);
    whole.mean[2] = 0.3;
    let mut halves = whole;
    filter.predict(&mut whole, 0.016, &NOBODY);
    filter.predict(&mut halves, 0.008, &NOBODY);
    filter.predict(&mut halves, 0.008, &NOBODY);
    for i in 0..4 {
        assert!((whole.mean[i] - halves.mean[i]).abs() < 1e-15);
        for j in 0..4 {
            let (one, two) = (whole.covariance[i][j], halves.covariance[i][j]);
            assert!((one - two).abs() <= 1e-13 * one.abs(), "{i} {j}: {one} {two}");
        }
    }
}

/// The velocity variance grows by q per second and the position variance by q/3, for any step
/// length. A time step in milliseconds instead of seconds would change both by powers of a
/// thousand.
#[test]
fn noise_is_counted_in_seconds() {
    let mut settings = open_gate();
    settings.left.open_psd_m2_per_s3 = 3.0;
    let filter = ObjectFilter::new(&settings, Object::Left);
    for steps in [60, 1000] {
        let mut estimate = filter.start([0.0; 2]);
        estimate.covariance = [[0.0; 4]; 4];
        for _ in 0..steps {
            filter.predict(&mut estimate, 1.0 / f64::from(steps), &NOBODY);
        }
        assert!((estimate.covariance[2][2] - 3.0).abs() < 1e-9);
        assert!((estimate.covariance[0][0] - 1.0).abs() < 1e-9);
        assert!((estimate.covariance[1][3] - 1.5).abs() < 1e-9);
    }
}

#[test]
fn covariances_stay_symmetric_and_positive_definite() {
    let frames = ball_frames(2400);
    let mut filter = BoardFilter::new(&FilterSettings::default());
    for seen in &frames {
        filter.observe(seen);
        for object in Object::ALL {
            let Some(own) = filter.estimate_at(object, seen.time) else { continue };
            assert!(cholesky(&own.covariance).is_some(), "{object:?} {:?}", own.covariance);
            for i in 0..4 {
                for j in 0..4 {
                    assert_eq!(own.covariance[i][j], own.covariance[j][i]);
                }
            }
        }
    }
}

#[test]
fn a_wild_detection_is_refused_and_two_that_fit_are_a_new_start() {
    let settings = FilterSettings::default();
    let mut filter = BoardFilter::new(&settings);
    let seen = |k: u64, x: f64| Detections::new(at(k), [Some([x, 0.0]), None, None]);
    for k in 0..60 {
        filter.observe(&seen(k, 0.0));
    }
    let gate = |observed: Observed| match observed {
        Observed::Taken([step, ..]) => (step.innovation.unwrap().gate, step.started),
        other => panic!("{other:?}"),
    };
    assert_eq!(gate(filter.observe(&seen(60, 0.1))), (Gate::Rejected, false));
    assert!(filter.estimate_at(Object::Ball, at(60)).unwrap().mean[0].abs() < 1e-3);
    assert_eq!(gate(filter.observe(&seen(61, 0.0))), (Gate::Accepted, false));
    // A hand moves the ball away at 1 m/s.
    assert_eq!(gate(filter.observe(&seen(62, 0.02))), (Gate::Rejected, false));
    assert_eq!(gate(filter.observe(&seen(63, 0.02 + PERIOD))), (Gate::Rejected, true));
    let ball = filter.estimate_at(Object::Ball, at(63)).unwrap();
    assert!((ball.mean[2] - 1.0).abs() < 1e-6, "{ball:?}");
    // The gate's threshold is the chi-square quantile: -2 ln p with two degrees of freedom.
    let own = ObjectFilter::new(&settings, Object::Ball);
    let estimate = own.start([0.0; 2]);
    let sigma = (2.0 * own.measurement_variance()).sqrt();
    let edge = (-2.0 * settings.gate_probability.ln()).sqrt();
    assert_eq!(own.innovation(&estimate, [0.999 * edge * sigma, 0.0]).gate, Gate::Accepted);
    assert_eq!(own.innovation(&estimate, [1.001 * edge * sigma, 0.0]).gate, Gate::Rejected);
}

#[test]
fn late_frames_end_where_frames_in_order_do() {
    let frames = ball_frames(400);
    let settings = FilterSettings::default();
    let straight = run(&settings, &frames);
    let mut stream = Stream::new(9, "order");
    let mut late = frames.clone();
    for part in late.chunks_mut(12) {
        stream.shuffle(part);
    }
    assert_ne!(late, frames);
    let shuffled = run(&settings, &late);
    let newest = straight.newest().unwrap();
    assert_eq!(shuffled.newest(), Some(newest));
    for object in Object::ALL {
        for ahead in [-0.05, 0.0, 0.012] {
            let time = newest.after_seconds(ahead);
            let own = straight.estimate_at(object, time);
            assert!(own.is_some());
            assert_eq!(own, shuffled.estimate_at(object, time), "{object:?} {ahead}");
        }
    }
}

#[test]
fn repeated_and_very_late_frames_change_nothing() {
    let frames = ball_frames(200);
    let mut filter = run(&FilterSettings::default(), &frames);
    let newest = filter.newest().unwrap();
    let before = filter.estimate_at(Object::Ball, newest);
    assert_eq!(filter.observe(&frames[199]), Observed::Repeated);
    let old = Detections { time: Nanos(at(100).0 + 1), ..frames[100] };
    assert_eq!(filter.observe(&old), Observed::TooLate);
    assert_eq!(filter.estimate_at(Object::Ball, newest), before);
}

#[test]
fn a_missing_detection_widens_the_belief_and_a_long_gap_ends_it() {
    let frames: Vec<Detections> = (0..60)
        .map(|k| Detections::new(at(k), [Some([0.001 * k as f64, 0.0]), None, None]))
        .collect();
    let mut filter = run(&FilterSettings::default(), &frames);
    let sigma = |filter: &BoardFilter, k| {
        filter.estimate_at(Object::Ball, at(k)).map(|own| own.covariance[0][0].sqrt())
    };
    let known = sigma(&filter, 59).unwrap();
    for k in 60..66 {
        filter.observe(&Detections::new(at(k), [None; 3]));
    }
    assert!(known < sigma(&filter, 65).unwrap());
    assert!(sigma(&filter, 59 + 29).is_some() && sigma(&filter, 59 + 31).is_none());
    let back = Detections::new(at(120), [Some([0.0, 0.1]), None, None]);
    assert!(matches!(filter.observe(&back), Observed::Taken([Step { started: true, .. }, ..])));
}

/// The split estimate against its definition: many sampled points, each reflected or not.
#[test]
fn a_belief_at_a_wall_has_the_moments_of_its_points() {
    let wall = Obstacle {
        normal: [1.0, 0.0],
        reach: 0.153,
        speed: 0.0,
        restitution: 0.8,
        restitution_sigma: 0.05,
        tangential_sigma: 0.1,
    };
    let l = [
        [2e-3, 0.0, 0.0, 0.0],
        [2e-4, 1e-3, 0.0, 0.0],
        [0.1, 0.0, 0.2, 0.0],
        [0.0, 0.05, 0.0, 0.1],
    ];
    let covariance: Matrix4 =
        std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| l[i][k] * l[j][k]).sum()));
    for beyond in [-3e-3, 0.0, 1e-3, 15e-3] {
        let mean = [0.153 + beyond, 0.0, 1.5, 0.3];
        let mut found = Estimate { mean, covariance };
        wall.bounce(&mut found);
        let mut stream = Stream::new(11, "points");
        let count = 40_000;
        let points: Vec<[f64; 4]> = (0..count)
            .map(|_| {
                let z: [f64; 4] = std::array::from_fn(|_| normal(&mut stream));
                let mut p: [f64; 4] =
                    std::array::from_fn(|i| mean[i] + (0..4).map(|k| l[i][k] * z[k]).sum::<f64>());
                let over = p[0] - 0.153;
                if 0.0 < over {
                    let bounce = 0.8 + 0.05 * normal(&mut stream);
                    let scatter = 0.1 * normal(&mut stream);
                    p[1] += scatter * over;
                    p[3] += scatter * p[2];
                    p[0] = 0.153 - bounce * over;
                    p[2] *= -bounce;
                }
                p
            })
            .collect();
        let n = f64::from(count);
        let centre: [f64; 4] =
            std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / n);
        for i in 0..4 {
            let spread = points.iter().map(|p| (p[i] - centre[i]).powi(2)).sum::<f64>() / n;
            // Five standard errors of the mean. 4 % of a variance, whose standard error is 0.7 %;
            // the tangential noise of the filter uses the mean speed only.
            let error = (found.mean[i] - centre[i]).abs();
            assert!(
                error < 5.0 * (spread / n).sqrt(),
                "{beyond} {i}: {} {}",
                found.mean[i],
                centre[i]
            );
            let ratio = found.covariance[i][i] / spread;
            assert!((ratio - 1.0).abs() < 0.04, "{beyond} {i}: {ratio}");
        }
        assert!(cholesky(&found.covariance).is_some());
    }
}

#[test]
fn a_prediction_over_a_wall_comes_back() {
    let settings = open_gate();
    let filter = ObjectFilter::new(&settings, Object::Ball);
    let ball = settings.ball.ball.unwrap();
    let mut estimate = filter.start([0.15, 0.0]);
    estimate.mean[2] = 1.0;
    (estimate.covariance[2][2], estimate.covariance[3][3]) = (1e-4, 1e-4);
    filter.predict(&mut estimate, 0.05, &NOBODY);
    assert!((estimate.mean[2] + ball.wall_restitution).abs() < 0.05, "{estimate:?}");
    assert!(estimate.mean[0] < 0.153 - 0.7 * ball.wall_restitution * 0.047);
}

#[test]
fn a_hundredfold_covariance_moves_the_estimate_as_the_gain_says() {
    let filter = ObjectFilter::new(&open_gate(), Object::Left);
    let mut prior = filter.start([0.0, 0.0]);
    filter.predict(&mut prior, PERIOD, &NOBODY);
    // Off the diagonal too: the gain is K = P H' (P + R)^-1, whatever the shape of R.
    for scale in [1.0, 100.0] {
        let [xx, xy, yy] = [4e-7, 1e-7, 9e-7].map(|own| scale * own);
        let seen = Measurement { position: [0.002, -0.001], covariance: Some([xx, xy, yy]) };
        let mut estimate = prior;
        let innovation = filter.update(&mut estimate, seen);
        let p = prior.covariance;
        let s = [[p[0][0] + xx, p[0][1] + xy], [p[0][1] + xy, p[1][1] + yy]];
        assert_eq!(innovation.covariance, s);
        let determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
        let weighted = [
            (s[1][1] * 0.002 + s[0][1] * 0.001) / determinant,
            (-s[0][1] * 0.002 - s[0][0] * 0.001) / determinant,
        ];
        for row in 0..4 {
            let expected = p[row][0] * weighted[0] + p[row][1] * weighted[1];
            assert!((estimate.mean[row] - prior.mean[row] - expected).abs() < 1e-12);
            for column in 0..4 {
                // (I - K H) P: equal to the Joseph form for the optimal gain.
                let inverse = [
                    [s[1][1] / determinant, -s[0][1] / determinant],
                    [-s[0][1] / determinant, s[0][0] / determinant],
                ];
                let gain = |k: usize| p[row][0] * inverse[0][k] + p[row][1] * inverse[1][k];
                let expected = p[row][column] - gain(0) * p[0][column] - gain(1) * p[1][column];
                assert!((estimate.covariance[row][column] - expected).abs() < 1e-12);
            }
        }
        cholesky(&estimate.covariance).unwrap();
    }
}

#[test]
fn the_covariance_of_the_settings_written_out_gives_the_same_estimates() {
    let settings = FilterSettings::default();
    let frames = ball_frames(400);
    let constant = run(&settings, &frames);
    let variance = |object: Object| settings.object(object).measurement_sigma_m.powi(2);
    let with_scale = |scale: f64| -> Vec<Detections> {
        let own = |object: Object| Some([scale * variance(object), 0.0, scale * variance(object)]);
        frames
            .iter()
            .map(|seen| Detections { covariances: Object::ALL.map(own), ..*seen })
            .collect()
    };
    let written_out = run(&settings, &with_scale(1.0));
    let mut halved = settings;
    for object in Object::ALL {
        halved.object_mut(object).covariance_scale = Some(0.5);
    }
    let scaled = run(&halved, &with_scale(2.0));
    let end = constant.newest().unwrap().after_seconds(0.01);
    for object in Object::ALL {
        let expected = constant.estimate_at(object, end).unwrap();
        for other in [&written_out, &scaled] {
            let found = other.estimate_at(object, end).unwrap();
            for (a, b) in found.mean.iter().zip(expected.mean) {
                assert!((a - b).abs() < 1e-9, "{object:?}: {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn a_covariance_that_is_none_counts_as_absent() {
    use crate::recording::message::{CameraDetections, Covariance, Point};
    let of = |[xx, xy, yy]: [f64; 3]| {
        let ball_covariance = Some(Covariance { xx, xy, yy });
        let ball = Some(Point { x: 0.0, y: 0.0 });
        let seen = CameraDetections { ball, ball_covariance, ..CameraDetections::default() };
        Detections::of(Nanos(0), &seen).covariances[0]
    };
    assert_eq!(of([1e-7, 1e-8, 2e-7]), Some([1e-7, 1e-8, 2e-7]));
    for wrong in [[0.0, 0.0, 0.0], [1e-7, 2e-7, 1e-7], [-1e-7, 0.0, 1e-7], [f64::NAN, 0.0, 1e-7]] {
        assert_eq!(of(wrong), None, "{wrong:?}");
    }
    assert_eq!(of([f64::INFINITY, 0.0, 1e-7]), None);
}

#[test]
fn saved_frames_without_covariances_have_the_bytes_of_old_ones() {
    let filter = run(&FilterSettings::default(), &ball_frames(20));
    let text = serde_json::to_string(&filter.last_frame()).unwrap();
    assert!(!text.contains("covariances") && !text.contains("refused_covariance"), "{text}");
}
