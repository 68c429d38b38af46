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
        .map(|reach| {
            (
                line_slopes(position, reach, DT),
                MotionNoise { position: noise, velocity: 0.0 }.of_line_slope(reach, DT),
            )
        })
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
    let signals =
        Signals::of(std::slice::from_ref(&whole), &vec![0.0; 1000], (&position, None), DT);
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
    assert_eq!(line_slopes(&[1.0], 3, DT), [0.0]);
}

/// RMS of `values` without the first and last `ends`.
fn rms_inside(values: &[f64], ends: usize) -> f64 {
    let inside = &values[ends..values.len() - ends];
    (inside.iter().map(|own| own * own).sum::<f64>() / inside.len() as f64).sqrt()
}

/// The noise of lines, filtered velocities and filtered accelerations is that of a simulation.
#[test]
fn noise_of_position_and_of_velocity_passes_lines_and_filters() {
    const COUNT: usize = 20_000;
    const ENDS: usize = 200;
    let whole = std::slice::from_ref(&(0..COUNT));
    for (position, velocity) in [(1e-6, 0.0), (0.0, 1e-3), (1e-6, 3e-4)] {
        let noise = MotionNoise { position, velocity };
        let position = noise.positions(COUNT, DT);
        for reach in [1, 5, 20] {
            let ratio = rms_inside(&line_slopes(&position, reach, DT), ENDS)
                / noise.of_line_slope(reach, DT);
            assert!((ratio - 1.0).abs() < 0.1, "{noise:?} {reach} {ratio}");
        }
        for edge in [0.025, 0.05] {
            let velocity = slope(whole, &filtered(whole, &position, edge), DT);
            let acceleration = slope(whole, &velocity, DT);
            let ratios = [
                rms_inside(&velocity, ENDS) / noise.of_velocity(edge, DT),
                rms_inside(&acceleration, ENDS) / noise.of_acceleration(edge, DT),
            ];
            assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.25), "{noise:?} {ratios:?}");
        }
    }
}

/// A measured velocity has white noise, or that of the positions it was computed from.
#[test]
fn the_noise_of_a_measured_velocity_is_white_or_that_of_positions() {
    const COUNT: usize = 8000;
    const EDGE: f64 = 0.05;
    let moving = |k: usize| 0.2 * (3.0 * DT * k as f64).sin();
    let found = |noise: &dyn Fn(usize) -> f64| {
        let velocity: Vec<f64> = (0..COUNT).map(|k| moving(k) + noise(k)).collect();
        MotionNoise::of(std::slice::from_ref(&(0..COUNT)), (&[], Some(&velocity)), DT)
            .of_velocity(EDGE, DT)
    };
    let white = white_samples(1.0, "white", COUNT + 1);
    let ratio = found(&|k| 2e-3 * white[k])
        / MotionNoise { position: 0.0, velocity: 2e-3 }.of_velocity(EDGE, DT);
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    let backward = found(&|k| 1e-6 * (white[k + 1] - white[k]) / DT);
    let of_positions = MotionNoise { position: 1e-6, velocity: 0.0 }.of_velocity(EDGE, DT);
    let ratio = backward / of_positions;
    assert!((0.9..2.0).contains(&ratio), "{ratio}");
}
