//! Tests of the ball against results that need no simulation.

use super::*;
use crate::{
    effects::{Axis, CATALOGUE, Wall, find},
    twin::{Instance, Source},
};

const GRAVITY: f64 = 9.81;

/// One span around everything.
const WHOLE: [Range<f64>; 1] = [0.0..f64::INFINITY];

fn instance(name: &str, values: &[f64]) -> Instance {
    let effect = find(name).expect("the effect is in the catalogue");
    Instance::new(effect, Axis::Whole, values, Source::Known)
}

fn rules(instances: &[(&str, &[f64])]) -> Rules {
    let instances: Vec<Instance> =
        instances.iter().map(|(name, values)| instance(name, values)).collect();
    Rules::new(&instances)
}

/// Positions of a ball from `start` after each of `times`.
fn path(rules: &Rules, start: [f64; 4], times: &[f64]) -> Vec<[f64; 2]> {
    let mut roller = Roller::new(rules, &start);
    times
        .iter()
        .map(|time| {
            roller.advance_to(*time);
            roller.place()
        })
        .collect()
}

fn frames(seconds: f64) -> Vec<f64> {
    (0..(seconds * 120.0) as usize).map(|k| k as f64 / 120.0).collect()
}

fn assert_close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} against {expected} +-{tolerance}");
}

#[test]
fn a_roll_stops_where_constant_deceleration_says() {
    let rules = rules(&[("ball.rolling_resistance", &[0.02, 0.0])]);
    let deceleration = 0.02 * GRAVITY;
    let places = path(&rules, [-0.1, 0.0, 0.18, 0.24], &[0.5, 1.5289, 1.54, 5.0]);
    let way = 0.3 * 0.5 - deceleration * 0.125;
    assert_close(places[0][0], -0.1 + 0.6 * way, 1e-12);
    let stopped = 0.09 / (2.0 * deceleration);
    for place in &places[2..] {
        assert_close(place[1] + BALL_RADIUS, HALF_BOARD[1].min(0.8 * stopped + BALL_RADIUS), 1e-6);
        assert_close(place[0], -0.1 + 0.6 * stopped, 1e-6);
    }
}

#[test]
fn a_ball_at_rest_stays_on_a_slope_that_resistance_holds() {
    let tilt: &[f64] = &[0.004, 0.0];
    let held = rules(&[("ball.tilt", tilt), ("ball.rolling_resistance", &[0.005, 0.0])]);
    assert_eq!(path(&held, [0.0; 4], &[2.0])[0], [0.0, 0.0]);
    let free = rules(&[("ball.tilt", tilt), ("ball.rolling_resistance", &[0.003, 0.0])]);
    assert_close(path(&free, [0.0; 4], &[1.0])[0][0], 0.001 * GRAVITY / 2.0, 1e-9);
}

#[test]
fn tilt_is_the_same_in_every_direction() {
    let rules = rules(&[("ball.tilt", &[0.004, -0.002])]);
    for velocity in [[0.2, 0.1], [-0.2, 0.1], [0.0, -0.3]] {
        let place = path(&rules, [0.0, 0.0, velocity[0], velocity[1]], &[0.5])[0];
        assert_close(place[0] - velocity[0] * 0.5, 0.004 * GRAVITY * 0.125, 1e-12);
        assert_close(place[1] - velocity[1] * 0.5, -0.002 * GRAVITY * 0.125, 1e-12);
    }
}

#[test]
fn a_wall_returns_its_share_at_the_solved_instant() {
    let rules = rules(&[("impact.wall_restitution", &[0.5])]);
    // 0.153 m to the wall at 1 m/s, then back at half the speed.
    let place = path(&rules, [0.0, 0.0, 1.0, 0.2], &[0.2531])[0];
    assert_close(place[0], 0.153 - 0.5 * (0.2531 - 0.153), 1e-12);
    assert_close(place[1], 0.2 * 0.2531, 1e-12);
}

#[test]
fn a_turned_wall_turns_the_way_back_by_twice_its_angle() {
    let turn = 0.01_f64;
    let mut numbers = [0.0; 8];
    numbers[4 + Wall::Right as usize] = turn;
    let rules = rules(&[("impact.wall_location", &numbers)]);
    let mut roller = Roller::new(&rules, &[0.1, 0.0, 1.0, 0.0]);
    roller.advance_to(0.1);
    let [vx, vy] = roller.velocity();
    // Further out towards positive y: the wall faces away from it, and so does the ball.
    assert_close(vy / vx.abs(), (2.0 * turn.atan()).tan(), 1e-9);
}

#[test]
fn energy_never_grows() {
    let rules = rules(&[
        ("ball.rolling_resistance", &[0.01, 0.02]),
        ("ball.sliding_phase", &[0.1, 0.3]),
        ("ball.air_drag", &[0.03]),
        ("impact.wall_restitution", &[1.0]),
        ("impact.wall_restitution_speed", &[0.05]),
        ("impact.wall_friction_spin", &[0.2, 0.0]),
    ]);
    for angle in 0..40 {
        let direction = f64::from(angle) * 0.157;
        let start = [0.05, -0.1, 1.5 * direction.cos(), 1.5 * direction.sin()];
        let mut roller = Roller::new(&rules, &start);
        let mut before = f64::INFINITY;
        for step in 1..3000 {
            roller.advance_to(f64::from(step) * 1e-3);
            let energy = roller.energy();
            assert!(energy <= before * (1.0 + 1e-12), "{before} to {energy} at {step}");
            let [x, y] = roller.place();
            assert!(x.abs() <= 0.153 + 1e-9 && y.abs() <= 0.203 + 1e-9, "left at {x} {y}");
            before = energy;
        }
    }
}

#[test]
fn a_mirrored_start_gives_a_mirrored_path() {
    let rules = rules(&[
        ("ball.rolling_resistance", &[0.01, 0.02]),
        ("ball.sliding_phase", &[0.1, 0.3]),
        ("impact.wall_restitution", &[0.85]),
        ("impact.wall_friction_spin", &[0.2, 0.0]),
        ("ball.board_curvature", &[0.0005, 0.0]),
    ]);
    let times = frames(2.0);
    let one = path(&rules, [0.03, -0.05, 0.9, 1.1], &times);
    let other = path(&rules, [-0.03, -0.05, -0.9, 1.1], &times);
    for (one, other) in one.iter().zip(&other) {
        assert_close(one[0], -other[0], 1e-9);
        assert_close(one[1], other[1], 1e-9);
    }
}

#[test]
fn the_path_is_continuous_through_impacts() {
    let rules = rules(&[
        ("ball.rolling_resistance", &[0.01, 0.0]),
        ("impact.wall_restitution", &[0.8]),
        ("impact.wall_friction_spin", &[0.1, 0.0]),
    ]);
    let (start, step) = ([0.1, 0.02, 0.8, 0.5], 1e-6);
    for k in 0..4000 {
        let shift = 1e-6 * f64::from(k);
        let at = |more: f64| {
            path(&rules, [start[0] + shift + more, start[1], start[2], start[3]], &[0.063])[0]
        };
        let (one, other) = (at(0.0), at(step));
        assert!((one[0] - other[0]).abs() < 2.0 * step, "a jump at {shift}");
    }
}

/// Largest difference of two derivatives of a path, and the largest derivative.
fn disagreement(derivative: impl Fn(f64) -> Vec<[f64; 2]>) -> (f64, f64) {
    let (coarse, fine) = (derivative(1e-3), derivative(1e-4));
    coarse
        .iter()
        .zip(&fine)
        .flat_map(|(c, f)| [(c[0], f[0]), (c[1], f[1])])
        .fold((0.0_f64, 0.0_f64), |(worst, size), (coarse, fine)| {
            (worst.max((coarse - fine).abs()), size.max(fine.abs()))
        })
}

#[test]
fn finite_differences_of_two_sizes_agree() {
    let base = |extra: Instance| {
        let mut instances = vec![
            instance("ball.rolling_resistance", &[0.012, 0.01]),
            instance("impact.wall_restitution", &[0.85]),
        ];
        instances.retain(|found| found.effect.name != extra.effect.name);
        instances.push(extra);
        Rules::new(&instances)
    };
    let start = [-0.02, 0.03, 0.9, -1.1];
    let times = frames(0.64);
    for effect in
        CATALOGUE.iter().filter(|effect| matches!(effect.domain, Domain::Ball | Domain::Impact))
    {
        for probe in effect.probes {
            for (index, parameter) in effect.parameters.iter().enumerate() {
                let (worst, size) = disagreement(|step| {
                    let run = |sign: f64| {
                        let mut values = probe.to_vec();
                        values[index] += sign * step * parameter.scale;
                        path(&base(instance(effect.name, &values)), start, &times)
                    };
                    let (up, down) = (run(1.0), run(-1.0));
                    let slope = |k: usize| (up[k], down[k]);
                    (0..times.len())
                        .map(slope)
                        .map(|(u, d)| [0, 1].map(|axis| (u[axis] - d[axis]) / (2.0 * step)))
                        .collect()
                });
                // Of the order of the second derivative, far below the size of the column.
                assert!(
                    worst <= 0.02 * size + 1e-7,
                    "{} {}: {worst} of {size} m per scale",
                    effect.name,
                    parameter.name
                );
            }
        }
    }
}

#[test]
fn steps_are_short_enough_for_every_effect_of_the_ball() {
    /// Largest difference from a path in steps of 0.1 ms (m); the noise of a camera is ten times larger.
    const SAME: f64 = 25e-6;
    /// Steps of the finer path within a frame.
    const FINE: usize = 83;
    for effect in
        CATALOGUE.iter().filter(|effect| matches!(effect.domain, Domain::Ball | Domain::Impact))
    {
        for probe in effect.probes {
            let mut instances = vec![instance(effect.name, probe)];
            if effect.name != "ball.rolling_resistance" {
                instances.push(instance("ball.rolling_resistance", &[0.012, 0.01]));
            }
            let rules = Rules::new(&instances);
            let places = |steps: usize| -> Vec<[f64; 2]> {
                let mut roller = Roller::new(&rules, &[-0.02, 0.03, 0.9, -1.1]);
                // Three centimetres from the path: a roll ends where the ball may touch a striker.
                roller.strikers([Some([0.02, 0.03]), Some([-0.04, -0.04])]);
                let place = |frame: usize| {
                    for step in 1..=steps {
                        roller.advance_to((frame as f64 + step as f64 / steps as f64) / 120.0);
                    }
                    roller.place()
                };
                (0..76).map(place).collect()
            };
            for (usual, fine) in places(1).iter().zip(places(FINE)) {
                for axis in 0..2 {
                    let difference = (usual[axis] - fine[axis]).abs();
                    assert!(difference < SAME, "{} {probe:?}: {difference} m", effect.name);
                }
            }
        }
    }
}

#[test]
fn finite_differences_of_the_start_agree() {
    let rules =
        rules(&[("ball.rolling_resistance", &[0.012, 0.0]), ("impact.wall_restitution", &[0.85])]);
    let times = frames(0.64);
    for index in 0..4 {
        let (worst, size) = disagreement(|step| {
            let run = |sign: f64| {
                let mut start = [-0.02, 0.03, 0.9, -1.1];
                start[index] += sign * step * START_SCALE[index];
                path(&rules, start, &times)
            };
            run(1.0)
                .iter()
                .zip(run(-1.0))
                .map(|(u, d)| [0, 1].map(|k| (u[k] - d[k]) / (2.0 * step)))
                .collect()
        });
        assert!(worst <= 0.01 * size, "start {index}: {worst} of {size}");
    }
}

/// A track of 120 frames per second with noise, made by `rules`; two strikers far away.
fn track(rules: &Rules, start: [f64; 4], seconds: f64) -> Vec<rolls::Sample> {
    let mut state = 1_u64;
    let mut noise = || {
        let sum: f64 = (0..12)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum();
        2.5e-4 * (sum - 6.0)
    };
    let times = frames(seconds);
    let places = path(rules, start, &times);
    times
        .iter()
        .zip(places)
        .map(|(time, [x, y])| rolls::Sample {
            time: *time,
            arrival: *time,
            ball: [x + noise(), y + noise()],
            strikers: [Some([0.15, -0.2]), None],
        })
        .collect()
}

fn nominal() -> Rules {
    rules(&[("ball.rolling_resistance", &[0.012, 0.0]), ("impact.wall_restitution", &[0.85])])
}

#[test]
fn rolls_end_at_gaps_strikers_and_pushes_but_not_at_walls() {
    let whole = track(&nominal(), [-0.1, 0.0, 0.4, 0.2], 0.6);
    let stage = |samples: Vec<rolls::Sample>| {
        Tracks::new(samples)
            .and_then(|tracks| BallStage::from_tracks(tracks, &WHOLE, Extent::Pieces))
    };
    assert_eq!(stage(whole.clone()).map(|stage| stage.roll_count()), Some(1));
    let mut gap = whole.clone();
    gap.drain(30..45);
    assert_eq!(stage(gap).map(|stage| stage.roll_count()), Some(2));
    let mut striker = whole.clone();
    striker[35].strikers[1] = Some(striker[35].ball);
    assert_eq!(stage(striker).map(|stage| stage.roll_count()), Some(2));
    let mut pushed = whole.clone();
    for (k, sample) in pushed.iter_mut().enumerate().skip(30) {
        sample.ball[1] += 0.3 * (k - 30) as f64 / 120.0;
    }
    let pushed = stage(pushed).map(|stage| stage.channels()[0].runs.clone()).unwrap_or_default();
    assert_eq!(pushed.len(), 2, "{pushed:?}");
    assert!(pushed[0].end <= 30 && 30 <= pushed[1].start, "{pushed:?}");
    let resting = track(&nominal(), [0.0; 4], 2.0);
    assert!(stage(resting).is_none());
}

#[test]
fn a_long_roll_is_looked_at_in_pieces_and_whole() {
    let tracks = Tracks::new(track(&nominal(), [-0.1, 0.0, 0.8, 0.4], 2.0)).expect("a track");
    let lengths = |extent: Extent| -> Vec<usize> {
        let stage = BallStage::from_tracks(tracks.clone(), &WHOLE, extent).expect("rolls");
        stage.channels()[0].runs.iter().map(|run| run.len()).collect()
    };
    let (pieces, whole) = (lengths(Extent::Pieces), lengths(Extent::Whole));
    assert!(pieces.iter().all(|piece| *piece < 80) && pieces.len() == 4, "{pieces:?}");
    assert!(whole.len() == 1 && 200 < whole[0], "{whole:?}");
}

#[test]
fn spans_confine_rolls() {
    let samples = track(&nominal(), [-0.1, 0.0, 0.4, 0.2], 1.2);
    let tracks = Tracks::new(samples).expect("a track");
    let stage =
        BallStage::from_tracks(tracks, &[0.1..0.55, 0.55..0.9], Extent::Pieces).expect("rolls");
    let runs = &stage.channels()[0].runs;
    assert_eq!(runs.len(), 2);
    let times = &stage.channels()[0].times;
    assert!(runs.iter().all(|run| 0.1 <= times[run.start] && times[run.end - 1] < 0.9));
}

#[test]
fn starts_are_guessed_within_the_noise() {
    let tracks = Tracks::new(track(&nominal(), [-0.1, 0.0, 1.0, 0.4], 0.6)).expect("a track");
    assert_close(tracks.noise, 2.5e-4, 5e-5);
    assert_close(tracks.rate_hz, 120.0, 0.1);
    let stage = BallStage::from_tracks(tracks, &WHOLE, Extent::Pieces).expect("a roll");
    for (found, (expected, tolerance)) in
        stage.nuisance_start(0).iter().zip([(-0.1, 1e-3), (0.0, 1e-3), (1.0, 0.03), (0.4, 0.03)])
    {
        assert_close(*found, expected, tolerance);
    }
}

#[test]
fn measured_impacts_show_the_restitution() {
    let samples = track(&nominal(), [-0.1, 0.0, 1.2, 0.5], 2.0);
    let tracks = Tracks::new(samples).expect("a track");
    let stage = BallStage::from_tracks(tracks, &WHOLE, Extent::Pieces).expect("rolls");
    let impacts = stage.impacts();
    assert!(4 <= impacts.len(), "{impacts:?}");
    assert_eq!(impacts[0].wall, Wall::Right);
    for impact in impacts {
        let spread = 2.0 * impact.spread / impact.speed_in;
        assert_close(impact.restitution(), 0.85, 4.0 * spread);
        assert_close(impact.beyond, 0.0, 1e-3);
    }
}
