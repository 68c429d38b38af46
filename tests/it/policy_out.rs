//! Observations and actions of a policy for `scripts/check_weights.py`, which runs the exported
//! policy in other software.
//!
//! `KLASKTRON_POLICY_DIR` names a folder for `model.onnx`, `model.safetensors`, `observation.npy` and
//! `action.npy`; `KLASKTRON_POLICY_LAYOUT` is `separate` (the paper's preset, tanh) or `shared`
//! (upstream's, ELU). The policy has learned a little, so that no weight is as it was drawn.

use klasktron::{
    nn::Activation,
    ppo::{Learner, PpoSettings, Rollout, RolloutShape, Scratch, Spaces, StepIndex},
    seed::Stream,
};
use ndarray::Array2;
use std::{collections::BTreeMap, env, fs, num::NonZeroUsize, path::PathBuf};

const SPACES: Spaces = Spaces { observations: 20, actions: 2 };
const ROWS: usize = 1000;

/// Three updates with rewards for actions along the first observations.
fn learned(settings: &PpoSettings) -> Learner {
    let mut learner = Learner::new(settings, SPACES, 1).unwrap();
    let shape = RolloutShape { horizon: 4, environments: 256, spaces: SPACES };
    let (mut rollout, mut scratch) = (Rollout::new(shape), Scratch::default());
    let mut stream = Stream::new(2, "observations");
    for update in 0..3 {
        for (number, mut step) in rollout.whole().steps.into_iter().enumerate() {
            step.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-0.5, 2.0));
            let place = StepIndex { step: 4 * update + number as u64, first_environment: 0 };
            learner.act(place, &mut step, &mut scratch);
            let rows = step.observations.chunks(20).zip(step.actions.chunks(2));
            for (reward, (x, a)) in step.rewards.iter_mut().zip(rows) {
                *reward = x[0] * a[0] - x[1] * a[1];
            }
        }
        learner.learn(&rollout, &[0.0; 256], NonZeroUsize::MIN).unwrap();
    }
    learner
}

#[test]
fn policy_out() {
    let Some(folder) = env::var_os("KLASKTRON_POLICY_DIR").map(PathBuf::from) else {
        println!("skipped: set KLASKTRON_POLICY_DIR to a folder");
        return;
    };
    let settings = match env::var("KLASKTRON_POLICY_LAYOUT").as_deref() {
        Ok("separate") => PpoSettings { activation: Activation::Tanh, ..PpoSettings::paper() },
        Ok("shared") => PpoSettings::upstream(),
        other => panic!("KLASKTRON_POLICY_LAYOUT is {other:?}, expected separate or shared"),
    };
    let settings = PpoSettings { minibatch: 256, learning_rate: 3e-3, ..settings };
    let policy = learned(&settings).policy();
    let mut stream = Stream::new(3, "observations");
    // Some beyond the limit of the standardisation.
    let observations: Vec<f32> =
        (0..ROWS * 20).map(|_| stream.uniform_f32(-1.0, 1.0).powi(3) * 10.0).collect();
    let mut actions = vec![0.0; ROWS * 2];
    policy.act_mean(&observations, &mut actions, &mut Scratch::default());
    assert!(actions.iter().any(|action| 0.05 < action.abs()), "it has learned something");
    fs::write(folder.join("model.onnx"), policy.to_onnx(&BTreeMap::new())).unwrap();
    fs::write(folder.join("model.safetensors"), policy.to_safetensors(&BTreeMap::new())).unwrap();
    let observations = Array2::from_shape_vec((ROWS, 20), observations).unwrap();
    let actions = Array2::from_shape_vec((ROWS, 2), actions).unwrap();
    ndarray_npy::write_npy(folder.join("observation.npy"), &observations).unwrap();
    ndarray_npy::write_npy(folder.join("action.npy"), &actions).unwrap();
}
