//! The learner's side of `scripts/bench_ppo.py`: `cargo bench --bench ppo -- MODE ...`
//!
//! `sample NETWORK FILE` writes a minibatch, the networks, their loss and gradient as JSON, for
//! PyTorch to repeat. `time NETWORK THREADS HORIZON` plays and learns one update after a warm-up and
//! prints seconds and the rate of faer's products at the learner's shapes as JSON. NETWORK is
//! `256-128-64` (upstream's preset: shared, 8 epochs) or `64-64` (the paper's: two networks, 4 epochs).

#![expect(clippy::print_stdout, reason = "its output is its result")]

use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use klasktron::{
    nn::Network,
    ppo::{
        End, Learner, LearnerState, NetworkLayout, PpoSettings, Rollout, RolloutPart, RolloutShape,
        Schedule, Scratch, Spaces, StepIndex,
    },
    seed::Stream,
};
use serde_json::{Value, json};
use std::{env, fs, hint::black_box, num::NonZeroUsize, thread, time::Instant};

const SPACES: Spaces = Spaces { observations: 20, actions: 2 };
const ENVIRONMENTS: usize = 4096;

fn settings(network: &str) -> PpoSettings {
    match network {
        "256-128-64" => PpoSettings::upstream(),
        "64-64" => PpoSettings::paper(),
        other => panic!("network {other:?}, expected 256-128-64 or 64-64"),
    }
}

fn main() {
    let arguments: Vec<String> = env::args().skip(1).filter(|a| a != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["sample", network, file] => {
            let text = sample(&settings(network)).to_string();
            fs::write(file, text).unwrap_or_else(|error| panic!("{file}: {error}"));
        }
        ["time", network, threads, horizon] => {
            let [threads, horizon] = [threads, horizon]
                .map(|text| text.parse().unwrap_or_else(|_| panic!("{text}: expected a number")));
            println!("{}", time(&settings(network), threads, horizon));
        }
        // Without arguments, as in `cargo bench`, there is nothing to do.
        _ => println!("usage: ppo sample NETWORK FILE | ppo time NETWORK THREADS HORIZON"),
    }
}

/// A minibatch with ratios and values on both sides of every clip, and what is made of it.
///
/// With an epsilon and a rate far above every gradient, one step of Adam subtracts the gradient
/// itself, so that it can be read off the weights; nothing may hold them.
fn sample(settings: &PpoSettings) -> Value {
    const HUGE: f32 = 1e6;
    let settings = PpoSettings {
        epochs: 1,
        learning_rate: HUGE,
        adam_epsilon: HUGE,
        schedule: Schedule::Fixed,
        max_gradient_norm: None,
        most_log_deviation: None,
        values: klasktron::ppo::Normalization::Off,
        ..settings.clone()
    };
    let mut learner = new_learner(&settings);
    let shape = RolloutShape { horizon: 1, environments: settings.minibatch, spaces: SPACES };
    let (mut rollout, mut stream) = (Rollout::new(shape), Stream::new(1, "sample"));
    let mut step = rollout.whole().steps.remove(0);
    step.observations.iter_mut().for_each(|x| *x = stream.uniform_f32(-1.0, 1.0));
    let place = StepIndex { step: 0, first_environment: 0 };
    learner.act(place, &mut step, &mut Scratch::default());
    step.rewards.iter_mut().for_each(|r| *r = stream.uniform_f32(-1.0, 1.0));
    step.ends.fill(End::Terminal);
    for value in step.log_probabilities.iter_mut().chain(step.values.iter_mut()) {
        *value += stream.uniform_f32(-0.5, 0.5);
    }
    let mut found = json!({
        "observations": step.observations,
        "actions": step.actions,
        "log_probabilities": step.log_probabilities,
        "values": step.values,
        "rewards": step.rewards,
        "settings": settings,
        "shared": settings.layout == NetworkLayout::Shared,
    });
    let before = learner.state();
    let standardizer = learner.policy().standardizer().clone();
    let last_values = vec![0.0; settings.minibatch];
    let report = learner.learn(&rollout, &last_values, NonZeroUsize::MIN);
    let report = report.unwrap_or_else(|error| panic!("{error}"));
    found["standardize_mean"] = json!(standardizer.mean);
    found["standardize_scale"] = json!(standardizer.scale);
    found["report"] = json!(report);
    found["networks"] = networks(&before);
    found["networks_after"] = networks(&learner.state());
    found["log_deviations"] = json!(before.deviations.logarithms);
    found["log_deviations_after"] = json!(learner.state().deviations.logarithms);
    found
}

fn networks(state: &LearnerState) -> Value {
    let layers = |network: &Network| -> Vec<Value> {
        network.layers.iter().map(|l| json!({ "weight": l.weight, "bias": l.bias })).collect()
    };
    let critic = state.critic.as_ref().map(|critic| layers(&critic.network));
    std::iter::once(layers(&state.policy.network)).chain(critic).collect()
}

/// A learner that has seen some observations of the fake game.
fn new_learner(settings: &PpoSettings) -> Learner {
    let learner = Learner::new(settings, SPACES, 1);
    let mut learner = learner.unwrap_or_else(|error| panic!("{error}"));
    let mut stream = Stream::new(2, "observations");
    let seen: Vec<f32> = (0..4096 * 20).map(|_| stream.uniform_f32(-1.0, 1.0)).collect();
    learner.observe(&seen).unwrap_or_else(|error| panic!("{error}"));
    learner
}

/// The fake game: observations decay, the first two follow the action, the reward is what the first
/// has come to. `bench_ppo.py` has the same.
fn play(learner: &Learner, part: RolloutPart<'_>, state: &mut [f32], first_step: u64) {
    let mut scratch = Scratch::default();
    for (number, mut step) in part.steps.into_iter().enumerate() {
        step.observations.copy_from_slice(state);
        let first_environment = part.first_environment;
        let place = StepIndex { step: first_step + number as u64, first_environment };
        learner.act(place, &mut step, &mut scratch);
        let rows = state.chunks_exact_mut(20).zip(step.actions.chunks_exact(2));
        for ((x, action), reward) in rows.zip(step.rewards.iter_mut()) {
            x.iter_mut().for_each(|x| *x *= 0.95);
            x[0] += 0.1 * action[0].clamp(-1.0, 1.0);
            x[1] += 0.1 * action[1].clamp(-1.0, 1.0);
            *reward = -x[0].abs();
        }
        step.ends.fill(End::Running);
    }
}

fn time(settings: &PpoSettings, threads: usize, horizon: usize) -> Value {
    let mut learner = new_learner(settings);
    let shape = RolloutShape { horizon, environments: ENVIRONMENTS, spaces: SPACES };
    let mut rollout = Rollout::new(shape);
    let mut stream = Stream::new(3, "state");
    let mut state: Vec<f32> =
        (0..ENVIRONMENTS * 20).map(|_| stream.uniform_f32(-1.0, 1.0)).collect();
    let ranges: Vec<_> = (0..threads)
        .map(|i| i * ENVIRONMENTS / threads..(i + 1) * ENVIRONMENTS / threads)
        .collect();
    let (mut act_seconds, mut learn_seconds, mut report) = (0.0, 0.0, Value::Null);
    // The first update warms up.
    for update in 0..2 {
        let start = Instant::now();
        let mut states = state.as_mut_slice();
        thread::scope(|scope| {
            for (range, part) in ranges.iter().zip(rollout.split(&ranges)) {
                let (own, rest) = std::mem::take(&mut states).split_at_mut(20 * range.len());
                states = rest;
                let learner = &learner;
                scope.spawn(move || {
                    klasktron::nn::flushing_denormals(|| {
                        play(learner, part, own, update * horizon as u64);
                    });
                });
            }
        });
        let mut last_values = vec![0.0; ENVIRONMENTS];
        learner.values(&state, &mut last_values, &mut Scratch::default());
        act_seconds = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let count = NonZeroUsize::new(threads).unwrap_or(NonZeroUsize::MIN);
        let learned = learner.learn(&rollout, &last_values, count);
        learn_seconds = start.elapsed().as_secs_f64();
        report = json!(learned.unwrap_or_else(|error| panic!("{error}")));
    }
    let products = Products::new(settings);
    let visits = (shape.samples() * settings.epochs) as f64;
    json!({
        "samples": shape.samples(),
        "act_seconds": act_seconds,
        "learn_seconds": learn_seconds,
        "learner_gflop_per_s": visits * products.flop_per_sample() / learn_seconds * 1e-9,
        "faer_gflop_per_s": products.faer_rate(settings.minibatch, threads) * 1e-9,
        "report": report,
    })
}

/// The matrix products of one visit of a sample.
struct Products {
    /// Widths of each network, from inputs to outputs.
    networks: Vec<Vec<usize>>,
}

impl Products {
    fn new(settings: &PpoSettings) -> Self {
        let widths = |outputs: usize| [&[20], settings.hidden.as_slice(), &[outputs]].concat();
        let networks = match settings.layout {
            NetworkLayout::Shared => vec![widths(3)],
            NetworkLayout::Separate => vec![widths(2), widths(1)],
        };
        Self { networks }
    }

    /// `(inputs, outputs, products)` of each layer: forward, gradient of the weights, and of the
    /// inputs but for the first layer.
    fn layers(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        let pairs = self.networks.iter().flat_map(|widths| widths.windows(2).enumerate());
        pairs.map(|(layer, pair)| (pair[0], pair[1], if layer == 0 { 2 } else { 3 }))
    }

    fn flop_per_sample(&self) -> f64 {
        self.layers().map(|(inputs, outputs, n)| (2 * n * inputs * outputs) as f64).sum()
    }

    /// Operations a second of faer's own products at these shapes, in `threads` threads at once, the
    /// narrow last layers left out: they are slow in faer and would flatter the learner.
    fn faer_rate(&self, rows: usize, threads: usize) -> f64 {
        let run = || {
            let wide = self.layers().filter(|(_, outputs, _)| 4 < *outputs);
            let (mut flop, mut seconds) = (0.0, 0.0);
            for (inputs, outputs, products) in wide {
                flop += (2 * products * rows * inputs * outputs) as f64;
                seconds += product_seconds([rows, inputs, outputs], Transposed::No);
                seconds += product_seconds([inputs, rows, outputs], Transposed::Left);
                if products == 3 {
                    seconds += product_seconds([rows, outputs, inputs], Transposed::No);
                }
            }
            flop / seconds
        };
        thread::scope(|scope| {
            let running: Vec<_> = (0..threads).map(|_| scope.spawn(run)).collect();
            running.into_iter().map(|thread| thread.join().unwrap_or(f64::NAN)).sum()
        })
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Transposed {
    No,
    Left,
}

/// Shortest of some runs (s) of a product `[m, k, n]`, whose result is checked first.
fn product_seconds([m, k, n]: [usize; 3], transposed: Transposed) -> f64 {
    const RUNS: usize = 15;
    let entry = |i: usize, j: usize| ((7 * i + 3 * j) % 13) as f32 * 0.1;
    let left = match transposed {
        Transposed::No => Mat::from_fn(m, k, entry),
        Transposed::Left => Mat::from_fn(k, m, |i, j| entry(j, i)),
    };
    let right = Mat::from_fn(k, n, entry);
    let mut product = Mat::<f32>::zeros(m, n);
    let mut multiply = || match transposed {
        Transposed::No => {
            matmul(&mut product, Accum::Replace, black_box(&left), &right, 1.0, Par::Seq);
        }
        Transposed::Left => {
            let left = black_box(&left).transpose();
            matmul(&mut product, Accum::Replace, left, &right, 1.0, Par::Seq);
        }
    };
    let runs = (0..RUNS).map(|_| {
        let start = Instant::now();
        multiply();
        start.elapsed().as_secs_f64()
    });
    let shortest = runs.fold(f64::INFINITY, f64::min);
    let expected: f64 = (0..k).map(|i| f64::from(entry(m - 1, i) * entry(i, n - 1))).sum();
    let found = f64::from(product[(m - 1, n - 1)]);
    assert!((found - expected).abs() < 1e-3 * expected, "faer: {found}, expected {expected}");
    shortest
}
