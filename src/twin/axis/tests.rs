use super::*;
use crate::{
    effects::{self, Axis},
    twin::{Instance, Machine, Source},
};

const DT: f64 = 1e-3;

fn twin(effects: &[(&str, &[f64])]) -> Twin {
    let instances = effects
        .iter()
        .map(|(name, values)| {
            let effect = effects::find(name).expect("the catalogue has it");
            Instance::new(effect, Axis::Motors, values, Source::Known)
        })
        .collect();
    Twin {
        machine: Machine::Axis,
        striker_mass: 0.0,
        belt_per_turn: 0.04,
        instances,
        left: Vec::new(),
        fitted_to: Vec::new(),
    }
}

/// Two slow tones of position; the input is what `force` says about position, velocity and
/// acceleration.
fn stage(force: impl Fn(f64, f64, f64, f64) -> f64) -> AxisStage {
    let (mut input, mut position) = (Vec::new(), Vec::new());
    for index in 0..8000 {
        let t = f64::from(index) * DT;
        let [mut q, mut v, mut a] = [0.0; 3];
        for (size, rate) in [(0.05, 3.0), (0.01, 11.0)] {
            let (sine, cosine) = (rate * t as f64).sin_cos();
            q += size * sine;
            v += size * rate * cosine;
            a -= size * rate * rate * sine;
        }
        input.push(force(t, q, v, a));
        position.push(q);
    }
    let measured =
        Measured { name: "slide".into(), unit: "N", start: 0.0, dt: DT, input, position };
    AxisStage::new(measured, &[0.0..4.0, 4.0..8.0])
}

fn rms(stage: &AxisStage, twin: &Twin) -> f64 {
    let mut predicted = vec![Vec::new()];
    stage.predict(twin, &[], &mut predicted);
    let channel = &stage.channels()[0];
    assert_eq!(predicted[0].len(), channel.measured.len());
    let errors = channel.measured.iter().zip(&predicted[0]).map(|(a, b)| a - b);
    let squares: Vec<f64> = errors.filter(|e| e.is_finite()).map(|e| e * e).collect();
    assert!(500 < squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn inverse_dynamics_gives_the_input() {
    let stage = stage(|_, _, v, a| 3.0 * a + 8.0 * v + 1.5 * v.signum() - 0.4);
    let right = twin(&[
        ("gantry.inertia", &[3.0]),
        ("drive.friction.viscous", &[8.0]),
        ("drive.friction.coulomb", &[1.5]),
        ("drive.offset", &[0.4]),
    ]);
    assert!(rms(&stage, &right) < 0.01, "{}", rms(&stage, &right));
    let runs = &stage.channels()[0].runs;
    assert_eq!(runs.len(), 2);
    assert_eq!(runs[0].end, runs[1].start);
}

#[test]
fn delays_and_lags_are_undone() {
    let smooth = |t: f64| 3.0 * (5.0 * t).sin() + (13.0 * t).cos();
    let late = stage(|t, ..| smooth(t + 0.004));
    let early = stage(|t, ..| smooth(t));
    // The same motion with an input 4 ms ahead: compare the predictions of two twins.
    let mass: (&str, &[f64]) = ("gantry.inertia", &[3.0]);
    let predict = |twin: &Twin| {
        let mut predicted = vec![Vec::new()];
        early.predict(twin, &[], &mut predicted);
        predicted.remove(0)
    };
    let plain = predict(&twin(&[mass]));
    for (name, value) in
        [("drive.delay", 0.02), ("drive.lag1", 0.001), ("drive.current_loop", 0.001)]
    {
        let changed = predict(&twin(&[mass, (name, &[value])]));
        let samples = (value / (DT * 10.0)) as f64;
        let worst = (10..plain.len() - 10)
            .map(|k| {
                let ahead = if 1.0 < samples {
                    plain[k + samples as usize]
                } else {
                    plain[k] + samples * 0.5 * (plain[k + 1] - plain[k - 1])
                };
                (changed[k] - ahead).abs()
            })
            .fold(0.0, f64::max);
        assert!(worst < 0.02, "{name} {worst}");
    }
    assert_ne!(late.channels()[0].measured, early.channels()[0].measured);
}

#[test]
fn a_limit_does_not_hide_what_was_commanded_beyond_it() {
    let stage = stage(|_, _, _, a| 3.0 * a);
    let limited = twin(&[
        ("gantry.inertia", &[3.0]),
        ("drive.saturation.torque_speed", &[100.0, 100.0]),
        ("drive.input_deadband", &[0.0, 0.0]),
    ]);
    assert!(rms(&stage, &limited) < 0.01);
}

#[test]
fn free_run_follows_its_own_input() {
    let stage = stage(|_, _, v, a| 3.0 * a + 8.0 * v);
    let right = twin(&[("gantry.inertia", &[3.0]), ("drive.friction.viscous", &[8.0])]);
    let run = stage.free_run(&right, 2.0).expect("four windows");
    assert_eq!(run.windows, 4);
    assert!(run.position_rms < 2e-4, "{run:?}");
    let heavy = twin(&[("gantry.inertia", &[4.0]), ("drive.friction.viscous", &[8.0])]);
    assert!(1e-3 < stage.free_run(&heavy, 2.0).expect("four windows").position_rms);
}

#[test]
fn a_rest_is_not_compared() {
    let velocity: Vec<f64> =
        (0..300).map(|k| if (100..200).contains(&k) { 1e-6 } else { 0.1 }).collect();
    let resting = rests(&velocity, 1e-6, DT);
    assert_eq!(resting.iter().filter(|rests| **rests).count(), 100);
    assert!(rests(&velocity, 1e-8, DT).iter().all(|rests| !rests));
}

#[test]
fn a_shift_reads_ahead() {
    let line: Vec<f64> = (0..20).map(f64::from).collect();
    let ahead = shifted(&line, 1.25);
    assert!((ahead[5] - 6.25).abs() < 1e-12);
    assert!((shifted(&line, -0.5)[5] - 4.5).abs() < 1e-12);
}
