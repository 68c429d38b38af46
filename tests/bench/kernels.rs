//! The kernels behind `fit-actuator`, beside the matrix product of faer, the filter of `tune-ekf`, an update
//! of `ppo`, and the boards of the game.
//!
//! Throughput is in floating-point operations: a product of `m x k` by `k x n` counts `2 m n k`, a
//! training step the products of forward pass, weight gradients and inner input gradients, and
//! neither counts activations, Adam or copies. Every output is checked before it is timed.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use klasktron::{
    actuator::{ActuatorNetwork, Layout, LayoutKind},
    ekf::{BoardFilter, Detections, FilterSettings, Object, ObjectFilter, Observed},
    game::{Actuation, GameSettings, Games, ObservationKind, Outcomes},
    nn::{Activation, Adam, Dense, InputGradient, Network, Stack, Tape, Trainer},
    ppo::{Learner, PpoSettings, Rollout, RolloutShape, Scratch, Spaces, StepIndex},
    recording::topic::Player,
    seed::Stream,
    twin::{Machine, Twin},
    units::Nanos,
};
use std::{hint::black_box, num::NonZeroUsize, time::Duration};

/// Inputs of the network: ten commands and ten velocities in x and y.
const INPUTS: usize = 40;
const OUTPUTS: usize = 2;
const WIDTHS: [usize; 2] = [64, 128];
const BATCHES: [usize; 2] = [256, 1024];
const PRODUCT_ROWS: [usize; 3] = [256, 1024, 4096];
const PRODUCT_WIDTH: usize = 64;

/// Agreement of two sums of some hundred `f32` in different order.
const SUM_TOLERANCE: f32 = 1e-4;
/// Relative agreement of a gradient with a central difference in `f32`.
const DIFFERENCE_TOLERANCE: f32 = 2e-2;

fn values(name: &str, count: usize) -> Vec<f32> {
    let mut stream = Stream::new(0, name);
    (0..count).map(|_| stream.uniform_f32(-1.0, 1.0)).collect()
}

fn network(width: usize) -> Network {
    let sizes = [INPUTS, width, width, width, OUTPUTS];
    let layers = sizes.windows(2).enumerate().map(|(index, pair)| {
        let (inputs, outputs) = (pair[0], pair[1]);
        let bound = (inputs as f32).sqrt().recip();
        let scaled = |name: &str, count| {
            values(&format!("{name} {index}"), count).into_iter().map(|v| v * bound).collect()
        };
        let (weight, bias) = (scaled("weight", inputs * outputs), scaled("bias", outputs));
        Dense { inputs, outputs, weight, bias }
    });
    Network { activation: Activation::Relu, layers: layers.collect() }
}

fn tape(batch: usize) -> Tape {
    let mut tape = Tape::default();
    tape.x = values("inputs", batch * INPUTS);
    tape
}

/// Operations of one forward pass for one sample.
fn forward_flop(network: &Network) -> u64 {
    network.layers.iter().map(|layer| 2 * (layer.inputs * layer.outputs) as u64).sum()
}

/// Operations of one training step for one sample: three products for each layer, but the first
/// needs no gradient of its inputs.
fn training_flop(network: &Network) -> u64 {
    let first = &network.layers[0];
    3 * forward_flop(network) - 2 * (first.inputs * first.outputs) as u64
}

fn check_close(what: &str, found: f32, expected: f32, tolerance: f32) {
    assert!((found - expected).abs() <= tolerance, "{what}: found {found}, expected {expected}");
}

/// faer's own product of `rows x 64` by `64 x 64`, the yardstick.
fn faer_product(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("faer_product");
    for rows in PRODUCT_ROWS {
        let left_values = values("left", rows * PRODUCT_WIDTH);
        let right_values = values("right", PRODUCT_WIDTH * PRODUCT_WIDTH);
        let at = |values: &[f32], i: usize, j: usize| values[i * PRODUCT_WIDTH + j];
        let left = Mat::from_fn(rows, PRODUCT_WIDTH, |i, j| at(&left_values, i, j));
        let right = Mat::from_fn(PRODUCT_WIDTH, PRODUCT_WIDTH, |i, j| at(&right_values, i, j));
        let mut product = Mat::<f32>::zeros(rows, PRODUCT_WIDTH);
        let multiply = |product: &mut Mat<f32>| {
            matmul(product, Accum::Replace, black_box(&left), black_box(&right), 1.0, Par::Seq);
        };
        multiply(&mut product);
        let (i, j) = (rows - 1, 3);
        let expected = (0..PRODUCT_WIDTH).map(|k| left[(i, k)] * right[(k, j)]).sum();
        check_close("faer's product", product[(i, j)], expected, SUM_TOLERANCE);
        group.throughput(Throughput::Elements((2 * rows * PRODUCT_WIDTH * PRODUCT_WIDTH) as u64));
        group.bench_function(BenchmarkId::from_parameter(rows), |bencher| {
            bencher.iter(|| multiply(black_box(&mut product)));
        });
    }
    group.finish();
}

/// Our batched forward pass, checked against the plain one.
fn forward(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("forward");
    for width in WIDTHS {
        let network = network(width);
        let stack = Stack::new(&network);
        for batch in BATCHES {
            let mut tape = tape(batch);
            stack.forward(&mut tape);
            for (x, y) in tape.x.chunks_exact(INPUTS).zip(tape.y.chunks_exact(OUTPUTS)) {
                for (found, expected) in y.iter().zip(network.forward(x)) {
                    check_close("forward pass", *found, expected, SUM_TOLERANCE);
                }
            }
            group.throughput(Throughput::Elements(batch as u64 * forward_flop(&network)));
            group.bench_function(BenchmarkId::new(format!("width_{width}"), batch), |bencher| {
                bencher.iter(|| stack.forward(black_box(&mut tape)));
            });
        }
    }
    group.finish();
}

/// One step of training: forward, backward and Adam.
fn training_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("training_step");
    for width in WIDTHS {
        let network = network(width);
        check_gradient(&network);
        for batch in BATCHES {
            let mut trainer = Trainer::new(&network, Adam::default());
            let mut tape = tape(batch);
            let dy = values("output gradient", batch * OUTPUTS);
            let mut dx = Vec::new();
            group.throughput(Throughput::Elements(batch as u64 * training_flop(&network)));
            group.bench_function(BenchmarkId::new(format!("width_{width}"), batch), |bencher| {
                bencher.iter(|| {
                    trainer.forward(&mut tape);
                    trainer.backward(&tape, black_box(&dy), InputGradient::Skip, &mut dx);
                    // So small a rate that the network stays the one that was checked.
                    trainer.update(1e-12);
                });
            });
        }
    }
    group.finish();
}

/// Compares the gradient of one weight of each layer with a central difference. The loss is the
/// sum of the outputs times fixed factors.
fn check_gradient(network: &Network) {
    const ROWS: usize = 8;
    const STEP: f32 = 1e-3;
    /// With an epsilon and a rate far above every gradient, one step of Adam subtracts the
    /// gradient itself.
    const HUGE: f32 = 1e6;
    let mut tape = tape(ROWS);
    let dy = values("output gradient", ROWS * OUTPUTS);
    let mut trainer = Trainer::new(network, Adam { epsilon: HUGE, ..Adam::default() });
    trainer.forward(&mut tape);
    trainer.backward(&tape, &dy, InputGradient::Skip, &mut Vec::new());
    trainer.update(HUGE);
    let stepped = trainer.stack().network();
    let loss = |network: &Network| -> f32 {
        let outputs = tape.x.chunks_exact(INPUTS).flat_map(|x| network.forward(x));
        outputs.zip(&dy).map(|(y, factor)| y * factor).sum()
    };
    for (layer, (before, after)) in network.layers.iter().zip(&stepped.layers).enumerate() {
        let found: Vec<f32> =
            before.weight.iter().zip(&after.weight).map(|(before, after)| before - after).collect();
        // The steepest weight is the one where rounding matters least.
        let steepest = (0..found.len()).max_by(|a, b| found[*a].abs().total_cmp(&found[*b].abs()));
        let Some(index) = steepest else { continue };
        let [up, down] = [STEP, -STEP].map(|step| {
            let mut moved = network.clone();
            moved.layers[layer].weight[index] += step;
            loss(&moved)
        });
        let expected = (up - down) / (2.0 * STEP);
        let tolerance = DIFFERENCE_TOLERANCE * expected.abs();
        check_close(&format!("gradient of layer {layer}"), found[index], expected, tolerance);
    }
}

/// Detections of a ball that swings across the open board (m), 120 a second.
fn swing(frame: u64) -> [f64; 2] {
    let t = frame as f64 / 120.0;
    [0.05 * (1.2 * t).sin(), 0.04 * (0.9 * t).cos()]
}

const STRIKERS: [[f64; 2]; 2] = [[0.0, -0.12], [0.0, 0.12]];
/// Frames in one iteration.
const FRAMES: u64 = 1200;

/// One prediction and one update of one object, and a whole board with its memory of late frames.
fn state_estimate(criterion: &mut Criterion) {
    let settings = FilterSettings::default();
    let filter = ObjectFilter::new(&settings, Object::Ball);
    let strikers = STRIKERS.map(Some);
    let follow = || {
        let mut ball = filter.start(swing(0));
        for frame in 1..FRAMES {
            filter.predict(&mut ball, 1.0 / 120.0, &strikers);
            filter.update(&mut ball, black_box(swing(frame)));
        }
        ball
    };
    let end = (FRAMES - 1) as f64 / 120.0;
    check_close("ball", follow().mean[2] as f32, (0.06 * (1.2 * end).cos()) as f32, 5e-3);
    let seen: Vec<Detections> = (0..FRAMES)
        .map(|frame| {
            let time = Nanos(frame * 1_000_000_000 / 120);
            Detections::new(time, [Some(swing(frame)), strikers[0], strikers[1]])
        })
        .collect();
    let board = || {
        let mut board = BoardFilter::new(&settings);
        let taken = seen.iter().filter(|seen| matches!(board.observe(seen), Observed::Taken(_)));
        assert_eq!(taken.count() as u64, FRAMES);
        board
    };
    let newest = board().estimate_at(Object::Ball, seen[seen.len() - 1].time);
    check_close(
        "board",
        newest.map_or(f32::NAN, |own| own.mean[2] as f32),
        follow().mean[2] as f32,
        1e-9,
    );
    let mut group = criterion.benchmark_group("state_estimate");
    group.throughput(Throughput::Elements(FRAMES - 1));
    group.bench_function("object", |bencher| bencher.iter(follow));
    group.throughput(Throughput::Elements(3 * FRAMES));
    group.bench_function("board", |bencher| bencher.iter(board));
    group.finish();
}

/// One update of PPO on 4096 samples by one thread, in visits of a sample; `scripts/bench_ppo.py` has
/// longer ones beside PyTorch. Checked: two threads learn the same, to the byte.
fn ppo_update(criterion: &mut Criterion) {
    let spaces = Spaces { observations: 20, actions: 2 };
    let shape = RolloutShape { horizon: 1, environments: 4096, spaces };
    let last_values = vec![0.0; shape.environments];
    let mut group = criterion.benchmark_group("ppo_update");
    for (name, settings) in [("paper", PpoSettings::paper()), ("upstream", PpoSettings::upstream())]
    {
        let Ok(mut learner) = Learner::new(&settings, spaces, 1) else { unreachable!("a preset") };
        let mut rollout = Rollout::new(shape);
        let mut step = rollout.whole().steps.remove(0);
        step.observations.copy_from_slice(&values("observations", 20 * shape.samples()));
        step.rewards.copy_from_slice(&values("rewards", shape.samples()));
        let place = StepIndex { step: 0, first_environment: 0 };
        learner.act(place, &mut step, &mut Scratch::default());
        let learned = |threads: usize| {
            let (mut learner, threads) = (learner.clone(), NonZeroUsize::new(threads));
            let report =
                learner.learn(&rollout, &last_values, threads.unwrap_or(NonZeroUsize::MIN));
            assert!(report.is_ok(), "{report:?}");
            learner.state()
        };
        assert!(learned(1) == learned(2), "threads change nothing");
        assert!(learned(1) != learner.state(), "something is learned");
        group.throughput(Throughput::Elements((shape.samples() * settings.epochs) as u64));
        group.bench_function(name, |bencher| {
            bencher.iter(|| black_box(learner.learn(&rollout, &last_values, NonZeroUsize::MIN)));
        });
    }
    group.finish();
}

/// Boards that are played at once: the time of a board's step is to be the same.
const BOARDS: [usize; 4] = [256, 1024, 4096, 16_384];
/// Steps of all boards in one iteration.
const BOARD_STEPS: usize = 5;

fn actuations() -> [Actuation; 3] {
    let layout = Layout { kind: LayoutKind::Klasktron, history_steps: 10 };
    [
        Actuation::Ideal,
        Actuation::learned(ActuatorNetwork::new(layout, network(64))),
        Actuation::twin(Twin::nominal(Machine::Table)),
    ]
}

/// Commands within 0.4 m/s, each for one board and all steps of an iteration.
fn board_commands(count: usize) -> Vec<[[f32; 2]; 2]> {
    let draws = values("board commands", 4 * count);
    let scaled = |v: &[f32]| [[0.4 * v[0], 0.4 * v[1]], [0.4 * v[2], 0.4 * v[3]]];
    draws.chunks_exact(4).map(scaled).collect()
}

/// Checks that a ball without resistance comes back from a wall as it went there, that boards differ, and
/// that a part of them plays as it does among all.
fn check_boards(settings: &GameSettings) {
    let mut quiet = settings.clone();
    quiet.ball.effects.clear();
    quiet.ball.striker_effects.clear();
    let mut games = Games::new(1, &quiet, 0).expect("settings that can be");
    games.set_positions(0, [0.0, 0.0], [1.0, 0.5], [[-0.15, -0.2], [-0.15, 0.2]]);
    let mut outcomes = Outcomes::new(1);
    for _ in 0..10 {
        games.step(&[[[0.0; 2]; 2]], &mut outcomes).expect("a step");
    }
    // 0.2 m at 1 m/s across: 0.153 m to the wall and 0.047 m back.
    let now = games.snapshot(0);
    check_close("place of the ball", now.ball_position[0] as f32, 0.106, 1e-6);
    check_close("speed of the ball", now.ball_velocity[0] as f32, -1.0, 1e-6);
    let commands = board_commands(200);
    let mut whole = Games::new(200, settings, 1).expect("settings that can be");
    let mut part = Games::range(130..200, settings, 1).expect("settings that can be");
    let (mut all, mut some) = (Outcomes::new(200), Outcomes::new(70));
    for _ in 0..50 {
        whole.step(&commands, &mut all).expect("a step");
        part.step(&commands[130..], &mut some).expect("a step");
    }
    assert!((0..70).all(|board| part.snapshot(board) == whole.snapshot(130 + board)));
    assert_ne!(part.snapshot(0), part.snapshot(1));
}

/// Steps of boards, by actuator and number; elements are board-steps of both players.
fn boards(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("game");
    for actuation in actuations() {
        let name = actuation.name();
        let settings = GameSettings { actuation, ..GameSettings::default() };
        check_boards(&settings);
        for count in BOARDS {
            let mut games = Games::new(count, &settings, 0).expect("settings that can be");
            let mut outcomes = Outcomes::new(count);
            let commands = board_commands(count);
            group.throughput(Throughput::Elements((BOARD_STEPS * count) as u64));
            group.bench_function(BenchmarkId::new(name, count), |bencher| {
                bencher.iter(|| {
                    for _ in 0..BOARD_STEPS {
                        games.step(black_box(&commands), &mut outcomes).expect("a step");
                    }
                });
            });
        }
    }
    let games = Games::new(BOARDS[1], &GameSettings::default(), 0).expect("settings that can be");
    let kind = ObservationKind::Augmented20;
    let mut rows = vec![0.0; games.len() * kind.len()];
    group.throughput(Throughput::Elements(games.len() as u64));
    group.bench_function("observe_20", |bencher| {
        bencher.iter(|| games.observe(Player::Right, kind, black_box(&mut rows)));
    });
    group.finish();
}

fn short() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_millis(1500))
}

criterion_group! {
    name = kernels;
    config = short();
    targets = faer_product, forward, training_step, state_estimate, ppo_update, boards
}
criterion_main!(kernels);
