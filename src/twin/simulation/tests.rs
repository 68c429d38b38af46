//! Simulations compared with the predictions of the stages with which `gap` compares recordings.

use super::*;
use crate::{
    effects::{self, Axis},
    provenance::Provenance,
    recording::{ExistingFile, Recording, topic::Player},
    twin::{Instance, Session, Source, Stage, Twin, sessions_of},
};
use proptest::prelude::*;
use std::path::Path;

fn info() -> RecordInfo {
    RecordInfo::new("test".to_owned(), Vec::new(), Provenance::new("klasktron simulate".to_owned()))
}

fn with(mut twin: Twin, effects: &[(&str, Axis, &[f64])]) -> Twin {
    for (name, axis, values) in effects {
        let effect = effects::find(name).unwrap();
        twin.instances.retain(|own| own.effect != effect);
        twin.instances.push(Instance::new(effect, *axis, values, Source::Fitted));
    }
    twin
}

/// A table with delay, compliance-free drives and a magnetic coupling.
fn table(delay: f64) -> Twin {
    with(
        Twin::nominal(Machine::Table),
        &[
            ("drive.delay", Axis::Motors, &[delay]),
            ("coupling.magnet_spring", Axis::Whole, &[120.0, 0.4, 0.02, 0.0]),
            ("sensor.camera_latency", Axis::Whole, &[0.012]),
        ],
    )
}

/// Velocity steps every 20 ms, for 4 s.
fn commands(levels: &[f64]) -> TableCommands {
    let times: Vec<f64> = (0..200).map(|k| 0.02 * f64::from(k)).collect();
    let level = |k: usize, shift: usize| levels[(k / 10 + shift) % levels.len()];
    let velocities = (0..200).map(|k| [level(k, 0), level(k, 3)]).collect();
    TableCommands::new(Path::new("commands.csv"), Player::Left, times, velocities).unwrap()
}

fn recorded(twin: &Twin, commands: &TableCommands, motion: &TableMotion) -> Recording {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("simulation.mcap");
    write_table_recording(twin, commands, motion, &info(), (&path, ExistingFile::Refuse)).unwrap();
    Recording::open(&path).unwrap()
}

/// Largest difference of prediction and measurement over the runs of channel `index`.
fn worst(stage: &dyn Stage, twin: &Twin, nuisance: &[Vec<f64>], index: usize) -> f64 {
    let channels = stage.channels();
    let mut predicted: Vec<Vec<f64>> =
        channels.iter().map(|channel| vec![0.0; channel.times.len()]).collect();
    stage.predict(twin, nuisance, &mut predicted);
    let samples = channels[index].runs.iter().cloned().flatten();
    samples.fold(0.0, |most: f64, sample| {
        most.max((predicted[index][sample] - channels[index].measured[sample]).abs())
    })
}

fn sessions(recording: Recording) -> Vec<Session> {
    sessions_of(&[recording]).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    /// A simulated recording is what the drive stage predicts from its commands.
    #[test]
    fn a_simulation_is_the_prediction_of_the_stages(
        levels in prop::collection::vec(-0.3..0.3_f64, 7),
        delay in 0.0..0.02_f64,
    ) {
        let (twin, commands) = (table(delay), commands(&levels));
        let motion = simulate_table(&twin, &commands, 200.0, 120.0);
        let recording = recorded(&twin, &commands, &motion);
        let again = TableCommands::from_recording(&recording, None).unwrap();
        prop_assert_eq!(&again.velocities, &commands.velocities);
        for session in sessions(recording) {
            let drive = session.drive.as_ref().expect("commands and motors");
            for (index, channel) in drive.channels.iter().enumerate() {
                let limit = if channel.unit == "m/s" { 1e-6 } else { 1e-4 };
                let worst = worst(drive, &twin, &[], index);
                prop_assert!(worst < limit, "{}: {worst}", channel.signal);
            }
            let camera = session.camera.as_ref().expect("carriage and frames");
            for index in 0..2 {
                let worst = worst(camera, &twin, &[vec![0.0; 2]], index);
                prop_assert!(worst < 2e-4, "{index}: {worst} m");
            }
        }
    }
}

#[test]
fn equal_inputs_give_equal_bytes() {
    let (twin, commands) = (table(0.005), commands(&[0.1, -0.2, 0.05]));
    let bytes = [0, 1].map(|_| {
        let motion = simulate_table(&twin, &commands, 100.0, 60.0);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("simulation.mcap");
        let to = (path.as_path(), ExistingFile::Refuse);
        write_table_recording(&twin, &commands, &motion, &info(), to).unwrap();
        (std::fs::read(&path).unwrap(), table_csv(&commands, &motion))
    });
    assert!(bytes[0] == bytes[1]);
    let csv = &bytes[0].1;
    assert_eq!(csv.lines().count(), 2 + 398, "header and 3.98 s at 100 Hz, both ends included");
    assert!(csv.lines().all(|line| line.split(',').count() == 13), "{}", &csv[..400]);
    assert!(!csv.contains("NaN"), "{}", &csv[..400]);
}

#[test]
fn the_carriage_starts_at_the_initial_position() {
    let mut commands = commands(&[0.0]);
    commands.start = [0.03, -0.1];
    let motion = simulate_table(&table(0.0), &commands, 100.0, 60.0);
    for index in [0, 200, motion.times.len() - 1] {
        let [x, y] = motion.position(index);
        assert!((x - 0.03).abs() < 1e-9 && (y + 0.1).abs() < 1e-9, "{x} {y}");
        assert!((motion.striker[index][0] - 0.03).abs() < 1e-6);
    }
}

fn slide() -> Twin {
    with(
        Twin::nominal(Machine::Axis),
        &[
            ("gantry.inertia", Axis::Guides, &[3.0]),
            ("drive.friction.viscous", Axis::Guides, &[8.0]),
            ("drive.friction.coulomb", Axis::Guides, &[1.5]),
        ],
    )
}

#[test]
fn an_axis_is_what_its_stage_predicts() {
    let force = |t: f64| 12.0 * (6.0 * t).sin() + 8.0 * (17.0 * t).sin();
    let samples: Vec<(f64, f64)> =
        (0..8000).map(|k| 1e-3 * f64::from(k)).map(|t| (t, force(t))).collect();
    let inputs = AxisInputs::new(Path::new("axis.csv"), "slide", "N", &samples).unwrap();
    let motion = simulate_axis(&slide(), &inputs);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("axis.mcap");
    let to = (path.as_path(), ExistingFile::Refuse);
    write_axis_recording(&slide(), &inputs, &motion, &info(), to).unwrap();
    let recording = Recording::open(&path).unwrap();
    let again = AxisInputs::from_recording(&recording, None).unwrap();
    assert_eq!(again.values, inputs.values);
    let session = sessions(recording).remove(0);
    let stage = &session.axes[0];
    let mut predicted = vec![Vec::new()];
    stage.predict(&slide(), &[], &mut predicted);
    let errors = stage.channels()[0].measured.iter().zip(&predicted[0]);
    let squares: Vec<f64> =
        errors.map(|(a, b)| (a - b).powi(2)).filter(|square| square.is_finite()).collect();
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(rms < 0.1, "{rms} N of 20 N");
    let run = stage.free_run(&slide(), 2.0).expect("whole windows");
    assert!(run.position_rms < 1e-3, "{run:?}");
    // The same step as the free run: a simulation is one window from the first sample on.
    let csv = axis_csv(&inputs, &motion);
    assert!(csv.starts_with("time_s,force_n,position_m,velocity_m_per_s\n0,0,0,0\n"), "{csv:.90}");
}

/// Linear in between: half of the rate gives the same motion as the full rate for a slow input.
#[test]
fn slow_inputs_are_integrated_with_short_steps() {
    let motion = |step: f64| {
        let samples: Vec<(f64, f64)> = (0..=(4.0 / step) as usize)
            .map(|k| step * k as f64)
            .map(|t| (t, 12.0 * (2.0 * t).sin()))
            .collect();
        let inputs = AxisInputs::new(Path::new("axis.csv"), "slide", "N", &samples).unwrap();
        *simulate_axis(&slide(), &inputs).position.last().unwrap()
    };
    let (coarse, fine) = (motion(0.01), motion(0.001));
    assert!((coarse - fine).abs() < 1e-4 * fine.abs().max(1.0), "{coarse} {fine}");
}

#[test]
fn commands_that_cannot_be_simulated_are_refused_in_one_sentence() {
    let path = Path::new("commands.csv");
    let table = |times: &[f64], velocity: f64| {
        let velocities = vec![[velocity, 0.0]; times.len()];
        let error = TableCommands::new(path, Player::Left, times.to_vec(), velocities);
        error.expect_err("refused").to_string()
    };
    assert!(table(&[], 0.0).contains("no commands"));
    assert!(table(&[0.0], 0.1).contains("the commands span 0 s"));
    assert!(table(&[0.0, 1e5], 0.1).contains("allowed are more than 0 and up to 7200 s"));
    assert!(table(&[0.0, 1.0], f64::NAN).contains("the command at 0 s is not finite"));
    let axis = AxisInputs::new(path, "slide", "m", &[(0.0, 0.0), (1.0, 0.0)]);
    assert!(axis.unwrap_err().to_string().contains("only a force, what makes one"));
    let few = AxisInputs::new(path, "slide", "N", &[(0.0, 0.0)]).unwrap_err().to_string();
    assert!(few.contains("1 inputs; at least 2 are needed"), "{few}");
}
