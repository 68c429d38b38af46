//! Tasks with a known best policy. Each also runs with reversed rewards, which reverse the
//! gradient, and must then fail.

use super::threads;
use crate::{
    ppo::{
        AdvantageNormalization, End, Imitation, Learner, Normalization, PpoSettings, Reflection,
        Rollout, RolloutShape, Scratch, Spaces, StepIndex,
    },
    seed::Stream,
};

const ENVIRONMENTS: usize = 64;

/// Position control of a carriage on a line. Observation: its distance to the target (m). Action:
/// its velocity (m/s), limited to 1, constant for 0.1 s. Reward: minus the distance after the step.
/// An episode is truncated after 20 steps.
///
/// The best policy moves at full speed and then stops: a distance `d` is 0.1 less after each step.
struct Reaching {
    distances: Vec<f32>,
    ages: Vec<usize>,
    stream: Stream,
}

impl Reaching {
    const STEPS: usize = 20;

    fn new(seed: u64) -> Self {
        let mut reaching =
            Self { distances: Vec::new(), ages: Vec::new(), stream: Stream::new(seed, "reaching") };
        for environment in 0..ENVIRONMENTS {
            let start = reaching.start();
            reaching.distances.push(start);
            // Not all at the same age, so that an update contains every age.
            reaching.ages.push(environment % Self::STEPS);
        }
        reaching
    }

    fn start(&mut self) -> f32 {
        self.stream.uniform_f32(-1.0, 1.0)
    }

    fn step(distance: f32, action: f32) -> f32 {
        distance + 0.1 * action.clamp(-1.0, 1.0)
    }

    fn rollout(&mut self, learner: &Learner, rollout: &mut Rollout, update: u64, sign: f32) {
        let mut scratch = Scratch::default();
        let horizon = rollout.shape().horizon as u64;
        for (number, mut row) in rollout.whole().steps.into_iter().enumerate() {
            row.observations.copy_from_slice(&self.distances);
            let place = StepIndex { step: update * horizon + number as u64, first_environment: 0 };
            learner.act(place, &mut row, &mut scratch);
            for environment in 0..ENVIRONMENTS {
                let distance = Self::step(self.distances[environment], row.actions[environment]);
                row.rewards[environment] = -sign * distance.abs();
                self.distances[environment] = distance;
                self.ages[environment] += 1;
                row.ends[environment] = End::Running;
                if self.ages[environment] == Self::STEPS {
                    row.ends[environment] = End::Truncated;
                    let value = &mut row.final_values[environment..=environment];
                    learner.values(&[distance], value, &mut scratch);
                    self.ages[environment] = 0;
                    self.distances[environment] = self.start();
                }
            }
        }
    }
}

/// Mean return of 20 steps from positions between -1 and 1, of the policy `action(distance)`.
fn judged(mut action: impl FnMut(f32) -> f32) -> f32 {
    const STARTS: usize = 41;
    let starts = (0..STARTS).map(|i| -1.0 + i as f32 / 20.0);
    let returns = starts.map(|mut distance| {
        (0..Reaching::STEPS)
            .map(|_| {
                distance = Reaching::step(distance, action(distance));
                -distance.abs()
            })
            .sum::<f32>()
    });
    returns.sum::<f32>() / STARTS as f32
}

fn train_reaching(settings: &PpoSettings, sign: f32, reflection: Option<Reflection>) -> f32 {
    let spaces = Spaces { observations: 1, actions: 1 };
    let mut learner = Learner::new(settings, spaces, 1).unwrap();
    if let Some(reflection) = reflection {
        learner = learner.with_reflection(reflection);
    }
    let shape = RolloutShape { horizon: 32, environments: ENVIRONMENTS, spaces };
    let mut rollout = Rollout::new(shape);
    let mut reaching = Reaching::new(2);
    for update in 0..25 {
        reaching.rollout(&learner, &mut rollout, update, sign);
        let mut last_values = vec![0.0; ENVIRONMENTS];
        learner.values(&reaching.distances, &mut last_values, &mut Scratch::default());
        learner.learn(&rollout, &last_values, threads(2)).unwrap();
    }
    let (policy, mut scratch) = (learner.policy(), Scratch::default());
    judged(|distance| {
        let mut action = [0.0];
        policy.act_mean(&[distance], &mut action, &mut scratch);
        action[0]
    })
}

#[test]
fn reaching_is_learned_to_near_the_best_and_not_with_the_sign_turned() {
    let best = judged(|distance| (-10.0 * distance).clamp(-1.0, 1.0));
    let idle = judged(|_| 0.0);
    // By hand: idling costs 20 steps of a mean distance of 0.51.
    assert!((idle + 20.0 * 0.512_195).abs() < 1e-3, "{idle}");
    for settings in [
        PpoSettings {
            hidden: vec![16, 16],
            learning_rate: 4e-3,
            minibatch: 256,
            ..PpoSettings::paper()
        },
        PpoSettings {
            hidden: vec![16, 16],
            learning_rate: 1e-3,
            epochs: 4,
            minibatch: 256,
            gamma: 0.95,
            ..PpoSettings::upstream()
        },
    ] {
        let good = train_reaching(&settings, 1.0, None);
        let turned = train_reaching(&settings, -1.0, None);
        println!("best {best}, learned {good}, idle {idle}, turned {turned}");
        assert!(best - 0.1 * (best - idle) < good, "best {best}, learned {good}, idle {idle}");
        assert!(turned < idle, "idle {idle}, with the sign turned {turned}");
    }
}

#[test]
fn mirrored_experience_teaches_a_symmetric_task_and_spoils_one_that_is_not() {
    let settings = PpoSettings {
        hidden: vec![16, 16],
        learning_rate: 4e-3,
        minibatch: 256,
        ..PpoSettings::paper()
    };
    let [best, idle] =
        [-10.0, 0.0].map(|gain: f32| judged(|distance| (gain * distance).clamp(-1.0, 1.0)));
    let trained = |sign| {
        let reflection = Reflection { observations: vec![-1], actions: vec![sign] };
        train_reaching(&settings, 1.0, Some(reflection))
    };
    // The task is the same with distance and velocity reversed, but not with the distance alone.
    let (right, wrong) = (trained(-1), trained(1));
    println!("best {best}, right {right}, wrong {wrong}, idle {idle}");
    assert!(best - 0.1 * (best - idle) < right, "best {best}, learned {right}, idle {idle}");
    assert!(wrong < best - 0.5 * (best - idle), "best {best}, learned {wrong}, idle {idle}");
}

/// One step with a reward of 300 minus the squared distance of the action from half the
/// observation. The best action and its value are known, and the value is far from that of a new
/// critic.
fn train_bandit(settings: &PpoSettings, sign: f32) -> (f32, f32) {
    let spaces = Spaces { observations: 1, actions: 1 };
    let mut learner = Learner::new(settings, spaces, 3).unwrap();
    let shape = RolloutShape { horizon: 8, environments: ENVIRONMENTS, spaces };
    let mut rollout = Rollout::new(shape);
    let mut stream = Stream::new(4, "bandit");
    let mut scratch = Scratch::default();
    for update in 0..40 {
        for (number, mut row) in rollout.whole().steps.into_iter().enumerate() {
            row.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-1.0, 1.0));
            let place = StepIndex { step: 8 * update + number as u64, first_environment: 0 };
            learner.act(place, &mut row, &mut scratch);
            row.ends.fill(End::Terminal);
            for ((reward, x), a) in
                row.rewards.iter_mut().zip(row.observations.iter()).zip(row.actions.iter())
            {
                *reward = 300.0 - sign * (a - 0.5 * x).powi(2);
            }
        }
        learner.learn(&rollout, &[0.0; ENVIRONMENTS], threads(1)).unwrap();
    }
    let observations: Vec<f32> = (0..21).map(|i| -1.0 + 0.1 * i as f32).collect();
    let (mut actions, mut values) = ([0.0; 21], [0.0; 21]);
    learner.policy().act_mean(&observations, &mut actions, &mut scratch);
    learner.values(&observations, &mut values, &mut scratch);
    let errors = actions.iter().zip(&observations).map(|(a, x)| (a - 0.5 * x).powi(2));
    ((errors.sum::<f32>() / 21.0).sqrt(), values.iter().sum::<f32>() / 21.0)
}

#[test]
fn a_bandit_is_solved_and_its_value_is_known_in_units_of_reward() {
    let settings = PpoSettings {
        hidden: vec![16],
        learning_rate: 1e-2,
        minibatch: 128,
        values: Normalization::Running { limit: 5.0, epsilon: 1e-5 },
        ..PpoSettings::paper()
    };
    // An idle policy errs by 0.5 times 0.6 = 0.3.
    let (error, value) = train_bandit(&settings, 1.0);
    let (turned, _) = train_bandit(&settings, -1.0);
    println!("error {error}, turned {turned}, value {value}");
    assert!(error < 0.05, "{error}");
    assert!(0.3 < turned, "{turned}");
    assert!((value - 300.0).abs() < 3.0, "{value}");
}

/// RMS error of the mean action from half the observation, after updates without any reward in which that action is
/// demonstrated. Mirrored samples have the action times `sign`.
fn train_imitation(imitation: Option<Imitation>, sign: i8) -> f32 {
    const UPDATES: u64 = 20;
    let settings = PpoSettings {
        hidden: vec![16],
        learning_rate: 1e-2,
        minibatch: 128,
        advantages: AdvantageNormalization::Off,
        imitation,
        ..PpoSettings::paper()
    };
    let spaces = Spaces { observations: 1, actions: 1 };
    let reflection = Reflection { observations: vec![-1], actions: vec![sign] };
    let mut learner = Learner::new(&settings, spaces, 3).unwrap().with_reflection(reflection);
    let shape = RolloutShape { horizon: 8, environments: ENVIRONMENTS, spaces };
    let mut rollout = Rollout::new(shape);
    let mut stream = Stream::new(4, "imitation");
    let mut scratch = Scratch::default();
    for update in 0..UPDATES {
        let expected = imitation.is_some_and(|imitation| update < imitation.updates);
        assert_eq!(learner.imitates(), expected, "update {update}");
        for (number, mut row) in rollout.whole().steps.into_iter().enumerate() {
            row.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-1.0, 1.0));
            let place = StepIndex { step: 8 * update + number as u64, first_environment: 0 };
            learner.act(place, &mut row, &mut scratch);
            row.rewards.fill(0.0);
            row.ends.fill(End::Terminal);
            for (action, x) in row.demonstrations.iter_mut().zip(row.observations.iter()) {
                *action = 0.5 * x;
            }
        }
        learner.learn(&rollout, &[0.0; ENVIRONMENTS], threads(1)).unwrap();
    }
    let observations: Vec<f32> = (0..21).map(|i| -1.0 + 0.1 * i as f32).collect();
    let mut actions = [0.0; 21];
    learner.policy().act_mean(&observations, &mut actions, &mut scratch);
    let errors = actions.iter().zip(&observations).map(|(a, x)| (a - 0.5 * x).powi(2));
    (errors.sum::<f32>() / 21.0).sqrt()
}

#[test]
fn demonstrations_are_imitated_as_long_as_the_settings_say() {
    let imitation = |updates| Some(Imitation { coef: 10.0, updates });
    let (taught, wrongly_mirrored) =
        (train_imitation(imitation(15), -1), train_imitation(imitation(15), 1));
    let alone = train_imitation(None, -1);
    println!("taught {taught}, mirrored with a wrong sign {wrongly_mirrored}, alone {alone}");
    // An idle policy errs by 0.3.
    assert!(taught < 0.05, "{taught}");
    assert!(0.2 < wrongly_mirrored, "{wrongly_mirrored}");
    assert!(0.2 < alone, "{alone}");
}
