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

/// A velocity with a kink at sample 500, as friction makes it: the narrowest filter far from it, a wide one beside it.
#[test]
fn a_kink_has_a_wide_filter_and_the_rest_a_narrow_one() {
    const NOISE_M: f64 = 1e-7;
    let mut random = crate::seed::Stream::new(1, "kink");
    let velocity = |k: usize| 1e-3 * (k as f64 - 500.0) * if k < 500 { 1.0 } else { 0.2 };
    let mut q = 0.0;
    let raw: Vec<f64> = (0..1000)
        .map(|k| {
            q += DT * 0.5 * (velocity(k) + velocity(k + 1));
            let sum: f64 = (0..12).map(|_| f64::from(random.uniform_f32(-0.5, 0.5))).sum();
            q + NOISE_M * sum
        })
        .collect();
    let estimates: Vec<(Vec<f64>, f64)> = [0.4, 0.1, 0.0125]
        .into_iter()
        .map(|edge| {
            let filtered = LowPass::butterworth(edge).apply(&raw);
            (derivative(&filtered, DT), velocity_noise(NOISE_M, edge, DT))
        })
        .collect();
    let (found, _) = narrowest_agreeing(&estimates);
    let worst = |values: &[f64], range: std::ops::Range<usize>| {
        // Sample k of the position is at the end of the step k.
        range.map(|k| (values[k] - velocity(k + 1)).abs()).fold(0.0, f64::max)
    };
    let [wide, _, narrow] = [0, 1, 2].map(|k| &estimates[k].0);
    assert!(worst(&found, 490..510) < 0.5 * worst(narrow, 490..510));
    assert!(worst(&found, 200..300) < 0.5 * worst(wide, 200..300));
}
