//! Known drives must be found again, and models judged for what they are.

use crate::drive::{DT, Drive};
use klasktron::actuator::{
    Arx, Component, Evaluation, FitConfig, FitObserver, Fopdt, LayoutKind, Run, Schedule,
    VelocityModel, fit,
};
use klasktron::recording::Split;
use std::sync::atomic::{AtomicBool, Ordering};

const LINEAR: Drive = Drive { gain: 0.93, tau: 0.046, delay: 0.034, slew: 1e9 };

fn runs(drive: Drive, count: u32, samples: usize) -> Vec<Run> {
    (0..count).map(|number| drive.run(number, samples, Some(Split::Train))).collect()
}

fn refs(runs: &[Run]) -> Vec<&Run> {
    runs.iter().collect()
}

struct Silent;

impl FitObserver for Silent {
    fn epoch_done(&self) {}
}

fn config() -> FitConfig {
    FitConfig {
        layout: LayoutKind::Klasktron,
        history_steps: 10,
        width: 32,
        hidden_layers: 2,
        epochs: 60,
        batch: 64,
        learning_rate: 3e-3,
        schedule: Schedule::Cosine,
        horizon: 1,
        seed: 0,
    }
}

fn fitted(config: &FitConfig, train: &[Run], held_out: &[Run]) -> klasktron::actuator::Fit {
    let stop = AtomicBool::new(false);
    fit(config, &refs(train), &refs(held_out), &stop, &Silent).unwrap().unwrap()
}

#[test]
fn a_lag_with_delay_is_recovered() {
    let drive = runs(LINEAR, 6, 300);
    let found = Fopdt::fit(&refs(&drive), DT);
    for lag in found.axes {
        assert!((lag.gain - LINEAR.gain).abs() < 0.005, "{lag:?}");
        assert!((lag.tau_s - LINEAR.tau).abs() < 0.03 * LINEAR.tau, "{lag:?}");
        assert!((lag.delay_s - LINEAR.delay).abs() < 0.002, "{lag:?}");
    }
}

#[test]
fn a_linear_drive_is_linear_arx_to_rounding() {
    let (train, held_out) = (runs(LINEAR, 6, 300), [LINEAR.run(50, 300, None)]);
    let arx = Arx::fit(&refs(&train), 10);
    let evaluation = Evaluation::new(&arx, &refs(&held_out), 10, DT);
    let error = evaluation.free_running(2.0, Component::Both);
    assert!(error < 1e-5, "{error}");
}

#[test]
fn a_saturating_drive_needs_the_network() {
    let drive = Drive { slew: 4.0, ..LINEAR };
    let (train, held_out) = (runs(drive, 20, 300), [drive.run(50, 300, None)]);
    let judge = |model: &dyn VelocityModel| {
        Evaluation::new(model, &refs(&held_out), 10, DT).free_running(2.0, Component::Both)
    };
    let network = judge(&fitted(&config(), &train, &held_out).model);
    let simpler = judge(&Arx::fit(&refs(&train), 10)).min(judge(&Fopdt::fit(&refs(&train), DT)));
    assert!(network < 0.4 * simpler, "network {network}, simpler {simpler}");
}

#[test]
fn training_on_several_steps_lowers_the_free_running_error() {
    // Few epochs on short history: one-step training leaves an error that feeds on itself.
    let drive = Drive { slew: 4.0, ..LINEAR };
    let (train, held_out) = (runs(drive, 10, 300), [drive.run(50, 300, None)]);
    let error = |horizon| {
        let config = FitConfig { horizon, history_steps: 4, epochs: 40, ..config() };
        let fit = fitted(&config, &train, &held_out);
        Evaluation::new(&fit.model, &refs(&held_out), 10, DT).free_running(2.0, Component::Both)
    };
    let (one, five) = (error(1), error(5));
    assert!(five < one, "one step {one}, five steps {five}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_does_not() {
    let train = runs(LINEAR, 2, 120);
    let config = FitConfig { epochs: 3, ..config() };
    let weights = |seed| fitted(&FitConfig { seed, ..config }, &train, &[]).model.network;
    assert_eq!(weights(5), weights(5));
    assert_ne!(weights(5), weights(6));
}

#[test]
fn a_raised_stop_ends_a_fit_without_a_result() {
    let train = runs(LINEAR, 2, 120);
    struct StopAtThird<'a>(&'a AtomicBool, std::sync::atomic::AtomicUsize);
    impl FitObserver for StopAtThird<'_> {
        fn epoch_done(&self) {
            if self.1.fetch_add(1, Ordering::Relaxed) == 2 {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let stop = AtomicBool::new(false);
    let observer = StopAtThird(&stop, Default::default());
    let made = fit(&config(), &refs(&train), &[], &stop, &observer).unwrap();
    assert!(made.is_none());
    assert_eq!(observer.1.into_inner(), 3);
}

#[test]
fn a_rate_that_is_too_high_is_named_with_seed_and_epoch() {
    let train = runs(LINEAR, 2, 120);
    let config = FitConfig { learning_rate: 1e30, schedule: Schedule::Constant, ..config() };
    let stop = AtomicBool::new(false);
    let error = fit(&config, &refs(&train), &[], &stop, &Silent).unwrap_err().to_string();
    assert!(error.starts_with("seed 0: the loss is not finite after epoch"), "{error}");
    assert!(error.contains("lower --learning-rate"), "{error}");
}
