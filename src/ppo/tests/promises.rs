//! Equal bytes for any number of threads and after a restart; errors leave the learner unchanged.

use super::{SPACES, made_up_rollout, small_settings, threads};
use crate::ppo::{
    End, Learner, LearnerState, NetworkLayout, Normalization, PpoError, PpoSettings, Rollout,
    Schedule, Scratch, StepIndex, UpdateReport,
};

/// More than one lane and more than one block of parameters.
fn settings() -> PpoSettings {
    PpoSettings { hidden: vec![48, 48], minibatch: 1200, epochs: 2, ..PpoSettings::paper() }
}

/// Upstream's settings with small networks.
fn upstream() -> PpoSettings {
    PpoSettings { hidden: vec![40, 24], minibatch: 1200, epochs: 2, ..PpoSettings::upstream() }
}

const ENVIRONMENTS: usize = 230;

fn train(learner: &mut Learner, updates: std::ops::Range<u64>, count: usize) -> UpdateReport {
    let mut last = None;
    for seed in updates {
        let (rollout, last_values) = made_up_rollout(learner, ENVIRONMENTS, seed);
        last = Some(learner.learn(&rollout, &last_values, threads(count)).unwrap());
    }
    last.unwrap()
}

/// Debug text of the state, which also distinguishes the signs of zeros.
fn bytes(state: &LearnerState) -> String {
    format!("{state:?}")
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    for settings in [settings(), upstream()] {
        let run = |count| {
            let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
            let report = train(&mut learner, 1..3, count);
            (bytes(&learner.state()), report)
        };
        let one = run(1);
        assert_eq!(one, run(2));
        assert_eq!(one, run(3));
        assert_eq!(one.1.minibatches, settings.epochs * 3);
        let mut other = Learner::new(&settings, SPACES, 6).unwrap();
        train(&mut other, 1..3, 1);
        assert_ne!(one.0, bytes(&other.state()), "another seed learns something else");
    }
}

#[test]
fn a_resumed_learner_continues_with_the_same_bytes() {
    let schedules = [Schedule::AdaptiveKl { target: 1e-4 }, Schedule::Linear { updates: 9 }];
    for (schedule, layout) in
        schedules.into_iter().zip([NetworkLayout::Shared, NetworkLayout::Separate])
    {
        let values = Normalization::Running { limit: 5.0, epsilon: 1e-5 };
        let settings = PpoSettings { schedule, layout, values, ..settings() };
        let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
        train(&mut learner, 1..3, 2);
        let mut resumed = Learner::resume(&settings, SPACES, &learner.state()).unwrap();
        assert_eq!(bytes(&learner.state()), bytes(&resumed.state()));
        let reports = [&mut learner, &mut resumed].map(|l| train(l, 3..5, 2));
        assert_eq!(reports[0], reports[1]);
        assert_eq!(reports[0].update, 4);
        assert_eq!(bytes(&learner.state()), bytes(&resumed.state()));
    }
}

#[test]
fn an_entropy_bonus_widens_the_policy_no_further_than_the_limit() {
    let widest = |most_log_deviation| {
        let settings = PpoSettings { entropy_coef: 10.0, most_log_deviation, ..settings() };
        let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
        train(&mut learner, 1..3, 1);
        learner.state().deviations.logarithms.iter().copied().fold(f32::MIN, f32::max)
    };
    assert!(0.0 < widest(None));
    assert_eq!(widest(Some(0.0)), 0.0);
}

#[test]
fn a_state_of_another_shape_is_refused_with_both() {
    let state = Learner::new(&settings(), SPACES, 5).unwrap().state();
    let other = PpoSettings { hidden: vec![48, 32], ..settings() };
    let error = Learner::resume(&other, SPACES, &state).unwrap_err().to_string();
    assert!(error.starts_with("policy network of the state: found [3, 48, 48, 2"), "{error}");
    assert!(error.contains("expected [3, 48, 32, 2"), "{error}");
    let shared = PpoSettings { layout: NetworkLayout::Shared, ..settings() };
    assert!(matches!(Learner::resume(&shared, SPACES, &state), Err(PpoError::State { .. })));
}

#[test]
fn decisions_do_not_depend_on_how_environments_are_divided() {
    let learner = Learner::new(&small_settings(), SPACES, 8).unwrap();
    let (whole, _) = made_up_rollout(&learner, 300, 1);
    let mut divided = whole.clone();
    divided.actions.fill(0.0);
    divided.values.fill(0.0);
    let mut scratch = Scratch::default();
    for part in divided.split(&[0..1, 1..130, 130..300]) {
        for (step, mut row) in part.steps.into_iter().enumerate() {
            let first_environment = part.first_environment;
            let place = StepIndex { step: 1000 + step as u64, first_environment };
            learner.act(place, &mut row, &mut scratch);
        }
    }
    assert_eq!(whole.actions, divided.actions);
    assert_eq!(whole.values, divided.values);
    assert_eq!(whole.log_probabilities, divided.log_probabilities);
}

#[test]
fn a_policy_on_its_own_decides_like_the_learner() {
    for settings in [settings(), upstream()] {
        let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
        train(&mut learner, 1..2, 1);
        let (rollout, _) = made_up_rollout(&learner, 300, 2);
        let rows = 300 * 11;
        let (policy, mut scratch) = (learner.policy(), Scratch::default());
        let mut means = vec![0.0; 2 * rows];
        policy.act_mean(&rollout.observations, &mut means, &mut scratch);
        assert_eq!(means, rollout.means);
        // Reference: observation by observation.
        for row in [0, 1, rows - 1] {
            let mut x = [0.0; 3];
            policy.standardizer().apply(&rollout.observations[3 * row..3 * row + 3], &mut x);
            for (found, plain) in means[2 * row..].iter().zip(policy.network().forward(&x)) {
                assert!((found - plain).abs() < 1e-5, "{found} {plain}");
            }
        }
        // Sampled actions have the standard deviations of the policy around the means.
        let mut drawn = vec![0.0; 2 * rows];
        let place = StepIndex { step: 3, first_environment: 0 };
        policy.act_random((1, "opponent", place), &rollout.observations, &mut drawn, &mut scratch);
        for action in 0..2 {
            let errors = drawn.iter().zip(&means).skip(action).step_by(2);
            let squares: f32 = errors.map(|(a, mean)| (a - mean).powi(2)).sum();
            let deviation = (squares / rows as f32).sqrt() / policy.gaussian().deviation(action);
            // The standard deviation of 3300 samples is known within 1.2 %.
            assert!((deviation - 1.0).abs() < 0.06, "{deviation}");
        }
    }
}

#[test]
fn nothing_has_changed_when_learning_begins() {
    // One pass, one minibatch: the policy that learns is the one that acted.
    let settings = PpoSettings { epochs: 1, minibatch: 100_000, ..upstream() };
    let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
    for update in 1..3 {
        let report = train(&mut learner, update..update + 1, 1);
        assert!(report.kl.abs() < 1e-6, "{}", report.kl);
        assert!(report.clip_fraction == 0.0);
        assert!(0.0 < report.gradient_norm);
    }
}

#[test]
fn an_update_stops_when_the_policy_has_gone_far() {
    let settings = PpoSettings { learning_rate: 1e-2, epochs: 20, ..settings() };
    let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
    assert_eq!(train(&mut learner, 1..2, 2).epochs, 20);
    let settings = PpoSettings { kl_stop: Some(0.005), ..settings };
    let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
    let report = train(&mut learner, 1..2, 2);
    assert!((1..20).contains(&report.epochs), "{report:?}");
    assert!(report.kl < 1.5 * 0.005, "{report:?}");
}

fn refused(learner: &mut Learner, rollout: &Rollout, last_values: &[f32]) -> PpoError {
    let before = bytes(&learner.state());
    let error = learner.learn(rollout, last_values, threads(2)).unwrap_err();
    assert_eq!(before, bytes(&learner.state()), "{error}");
    error
}

#[test]
fn numbers_that_are_not_finite_stop_learning_and_change_nothing() {
    let mut learner = Learner::new(&small_settings(), SPACES, 5).unwrap();
    train(&mut learner, 1..2, 1);
    let (rollout, last_values) = made_up_rollout(&learner, 20, 2);
    for bad in [f32::NAN, f32::INFINITY] {
        let mut broken = rollout.clone();
        broken.rewards[20 * 4 + 7] = bad;
        let error = refused(&mut learner, &broken, &last_values);
        let expected =
            PpoError::NonFiniteInput { update: 2, what: "the reward", step: 4, environment: 7 };
        assert_eq!(error, expected);
        let mut broken = rollout.clone();
        broken.observations[3 * (20 * 10 + 19) + 2] = bad;
        let text = refused(&mut learner, &broken, &last_values).to_string();
        assert!(text.contains("an observation of environment 19 at step 10"), "{text}");
        let mut last = last_values.clone();
        last[3] = bad;
        let text = refused(&mut learner, &rollout, &last).to_string();
        assert!(text.contains("a last value of environment 3 at step 11"), "{text}");
        let mut broken = rollout.clone();
        broken.ends[5] = End::Truncated;
        broken.final_values[5] = bad;
        let text = refused(&mut learner, &broken, &last_values).to_string();
        assert!(text.contains("a final value of environment 5 at step 0"), "{text}");
        // Otherwise it is not read.
        broken.ends[5] = End::Terminal;
        Learner::resume(&small_settings(), SPACES, &learner.state())
            .unwrap()
            .learn(&broken, &last_values, threads(1))
            .unwrap();
    }
    // The same learner still learns from a valid rollout.
    learner.learn(&rollout, &last_values, threads(2)).unwrap();
}

#[test]
fn learning_that_leaves_the_range_of_numbers_is_an_error_with_its_place() {
    let settings = PpoSettings { learning_rate: 1e30, ..small_settings() };
    let mut learner = Learner::new(&settings, SPACES, 5).unwrap();
    let (rollout, last_values) = made_up_rollout(&learner, 50, 1);
    let error = refused(&mut learner, &rollout, &last_values);
    assert!(matches!(error, PpoError::NonFiniteLearning { update: 1, .. }), "{error}");
    assert!(error.to_string().contains("lower learning_rate"), "{error}");
}

#[test]
fn settings_outside_their_range_are_refused_by_name() {
    let refusal = |settings: PpoSettings| {
        Learner::new(&settings, SPACES, 5).map(|_| ()).unwrap_err().to_string()
    };
    let sound = small_settings;
    assert!(refusal(PpoSettings { gamma: 1.5, ..sound() }).contains("gamma is 1.5, expected 0"));
    assert!(refusal(PpoSettings { clip_coef: f32::NAN, ..sound() }).contains("clip_coef is NaN"));
    assert!(refusal(PpoSettings { hidden: vec![], ..sound() }).contains("hidden is 0"));
    assert!(refusal(PpoSettings { minibatch: 0, ..sound() }).contains("minibatch is 0"));
    let schedule = Schedule::Linear { updates: 0 };
    assert!(refusal(PpoSettings { schedule, ..sound() }).contains("schedule.updates is 0"));
    for settings in [PpoSettings::paper(), PpoSettings::upstream()] {
        settings.check(SPACES).unwrap();
        let text = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<PpoSettings>(&text).unwrap(), settings);
    }
}
