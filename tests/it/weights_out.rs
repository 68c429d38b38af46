//! Inputs and outputs of a fitted network for `scripts/check_weights.py`, which runs the exported
//! weights in other software.
//!
//! `KLASKTRON_WEIGHTS_DIR` names a folder with an `actuator.mcap`; `history.npy` and
//! `velocity.npy` are written beside it, one row for every window of the example's held-out runs.

use klasktron::{
    actuator::{self, ResampleConfig, Target, VelocityModel as _},
    recording::{Recording, topic::Player},
};
use ndarray::Array2;
use std::{
    env,
    path::{Path, PathBuf},
};

const VALIDATION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/example-validation.mcap");

#[test]
fn weights_out() {
    let Some(folder) = env::var_os("KLASKTRON_WEIGHTS_DIR").map(PathBuf::from) else {
        println!("skipped: set KLASKTRON_WEIGHTS_DIR to a folder with an actuator.mcap");
        return;
    };
    let stored = Recording::open(&folder.join("actuator.mcap")).unwrap();
    let model = actuator::read_actuator(&stored).unwrap().model;
    let recording = Recording::open(Path::new(VALIDATION)).unwrap();
    let config = ResampleConfig { target: Target::Carriage, rate_hz: 50.0 };
    let runs = actuator::resample(&recording, 0, Player::Left, config).unwrap();
    let layout = model.layout;
    let (mut history, mut velocity) = (Vec::new(), Vec::new());
    for run in &runs {
        let starts: Vec<usize> = (layout.history_steps - 1..run.len() - 1).collect();
        for start in &starts {
            let mut input = vec![0.0f32; layout.inputs()];
            layout.fill(&mut input, &run.commands, &run.velocities, *start);
            history.extend(input);
        }
        let predicted = model.simulate(run, &starts, 1);
        velocity.extend(predicted.into_iter().flatten().map(|v| v as f32));
    }
    let rows = velocity.len() / actuator::AXES;
    assert!(500 < rows, "only {rows} windows");
    let history = Array2::from_shape_vec((rows, layout.inputs()), history).unwrap();
    let velocity = Array2::from_shape_vec((rows, actuator::AXES), velocity).unwrap();
    ndarray_npy::write_npy(folder.join("history.npy"), &history).unwrap();
    ndarray_npy::write_npy(folder.join("velocity.npy"), &velocity).unwrap();
    println!("{rows} windows written to {}", folder.display());
}
