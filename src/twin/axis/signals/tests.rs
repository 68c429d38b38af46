use super::*;

const DT: f64 = 1e-3;

#[test]
fn a_rest_is_not_compared() {
    let velocity: Vec<f64> =
        (0..300).map(|k| if (100..200).contains(&k) { 1e-6 } else { 0.1 }).collect();
    let resting = rests(&velocity, 1e-6);
    assert_eq!(resting.iter().filter(|rests| **rests).count(), 100);
    assert!(rests(&velocity, 1e-8).iter().all(|rests| !rests));
}

#[test]
fn a_reversal_reaches_as_far_as_its_filter() {
    let velocity: Vec<f64> = (0..40).map(|k| f64::from(k) - 19.5).collect();
    let beside = beside_reversals(&velocity, 0.1, 5);
    let found: Vec<usize> = (0..40).filter(|k| beside[*k]).collect();
    assert_eq!(found, (15..=25).collect::<Vec<_>>());
    let still = vec![0.05; 40];
    assert!(beside_reversals(&still, 0.1, 5).iter().all(|own| *own));
    assert!(beside_reversals(&still, 0.01, 5).iter().all(|own| !own));
}

/// Friction changes sign where a straight velocity crosses zero, and not at the next sample.
#[test]
fn the_mean_sign_of_a_sample_contains_the_moment_of_a_reversal() {
    for crossing in [9.5, 9.75, 10.0, 10.2] {
        let velocity: Vec<f64> = (0..20).map(|k| f64::from(k) - crossing).collect();
        let sum: f64 = mean_sign(&velocity).iter().sum();
        // Samples take half a period to either side: from -0.5 to 19.5.
        let exact = (19.5 - crossing) - (crossing + 0.5);
        assert!((sum - exact).abs() < 1e-12, "{crossing} {sum} {exact}");
    }
}

/// Position of `velocity` (per second) with white noise, in samples of `DT`.
fn noisy_position(velocity: impl Fn(usize) -> f64, count: usize, noise: f64) -> Vec<f64> {
    let mut random = crate::seed::Stream::new(1, "kink");
    let mut q = 0.0;
    (0..count)
        .map(|k| {
            q += DT * 0.5 * (velocity(k) + velocity(k + 1));
            let sum: f64 = (0..12).map(|_| f64::from(random.uniform_f32(-0.5, 0.5))).sum();
            q + noise * sum
        })
        .collect()
}

/// Slopes over the windows of a wide filter, and the longest agreeing ones.
fn agreeing(position: &[f64], noise: f64) -> (Vec<(Vec<f64>, f64)>, Vec<f64>) {
    let estimates: Vec<(Vec<f64>, f64)> = REACHES
        .into_iter()
        .map(|reach| (line_slopes(position, reach, DT), line_slope_noise(noise, reach, DT)))
        .collect();
    let (found, _) = longest_agreeing(&estimates);
    (estimates, found)
}

/// A velocity with a kink at sample 500, as friction makes it: the window is long far from it, and
/// short near it.
#[test]
fn a_kink_has_a_short_window_and_the_rest_a_long_one() {
    const NOISE_M: f64 = 1e-7;
    let velocity = |k: usize| 1e-3 * (k as f64 - 500.0) * if k < 500 { 1.0 } else { 0.2 };
    let (estimates, found) = agreeing(&noisy_position(velocity, 1000, NOISE_M), NOISE_M);
    let worst = |values: &[f64], range: std::ops::Range<usize>| {
        // Sample k of the position is at the end of the step k.
        range.map(|k| (values[k] - velocity(k + 1)).abs()).fold(0.0, f64::max)
    };
    let (short, long) = (&estimates[0].0, &estimates[REACHES.len() - 1].0);
    assert!(worst(&found, 490..510) < 0.5 * worst(long, 490..510));
    assert!(worst(&found, 200..300) < 0.5 * worst(short, 200..300));
}

/// An axis that sticks for 20 samples, between motions with a constant acceleration. The samples of
/// the rest may stand, except for two at an end, where a longer window still agrees. No sample of
/// the motion may stand.
#[test]
fn a_short_rest_is_not_hidden_by_the_motion_beside_it() {
    const NOISE_M: f64 = 1e-7;
    let velocity = |k: usize| match k {
        0..500 => 2e-3 * (500.0 - k as f64),
        500..520 => 0.0,
        _ => 1e-3 * (k as f64 - 520.0),
    };
    let position = noisy_position(velocity, 1000, NOISE_M);
    let whole = 0..position.len();
    let signals = Signals::of(std::slice::from_ref(&whole), &vec![0.0; 1000], &position, DT);
    let hidden: Vec<usize> = (502..518).filter(|k| !signals.standing[*k]).collect();
    assert!(hidden.is_empty(), "{hidden:?}");
    let elsewhere = || (0..490).chain(530..1000);
    assert!(elsewhere().all(|k| !signals.standing[k]));
    assert!(signals.velocity[502..516].iter().all(|v| v.abs() < 3.0 * NOISE_M / DT));
}

#[test]
fn a_line_has_its_slope_and_its_noise() {
    let straight: Vec<f64> = (0..30).map(|k| 0.5 * f64::from(k)).collect();
    for reach in REACHES {
        let slopes = line_slopes(&straight, reach, DT);
        assert!(slopes.iter().all(|slope| (slope - 0.5 / DT).abs() < 1e-9 / DT), "{reach}");
    }
    let position = noisy_position(|_| 0.0, 20_000, 1.0);
    for reach in [1, 5, 20] {
        let slopes = line_slopes(&position, reach, DT);
        let inside = &slopes[reach..slopes.len() - reach];
        let square = inside.iter().map(|own| own * own).sum::<f64>() / inside.len() as f64;
        let ratio = square.sqrt() / line_slope_noise(1.0, reach, DT);
        assert!((ratio - 1.0).abs() < 0.1, "{reach} {ratio}");
    }
    assert_eq!(line_slopes(&[1.0], 3, DT), [0.0]);
}
