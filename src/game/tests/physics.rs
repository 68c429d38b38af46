//! Rolls, bounces and contacts.

use super::{ASIDE, STILL, ball, long, one};
use crate::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    game::{
        BallSettings, BiscuitSettings, BoardPhysics, Ending, GameSettings, Games, Outcomes,
        Surface,
        body::{BallState, Mover, length, subtract},
        contact::strike,
        laws::BallLaws,
        motion::{Play, Table},
        settings::instances,
    },
};
use proptest::prelude::*;
use std::f64::consts::TAU;

const TOUCH: f64 = BALL_RADIUS + STRIKER_RADIUS;
const REACH: [f64; 2] = [0.16 - BALL_RADIUS, 0.21 - BALL_RADIUS];

#[test]
fn a_free_roll_follows_the_closed_formula() {
    // dv/dt = -(c g + b v): v = (v0 + cg/b) exp(-bt) - cg/b, x = (v0 + cg/b)(1 - exp(-bt))/b - cg t/b.
    let (c, b, v0) = (0.008, 0.3, 0.2);
    for (pieces, bound) in [(1, 2e-6), (4, 2e-6), (20, 2e-6)] {
        let effects = instances(&[("ball.rolling_resistance", &[c, b])]);
        let ball = BallSettings { effects, ..BallSettings::default() };
        let settings = long(GameSettings { ball, pieces, ..GameSettings::default() });
        let direction = [0.6, 0.8];
        let mut games = one(&settings, [-0.1, -0.1], direction.map(|d| d * v0));
        let steady = c * 9.81 / b;
        for step in 1..60 {
            games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
            let t = f64::from(step) * 0.02;
            let decay = (-b * t).exp();
            let (v, x) = ((v0 + steady) * decay - steady, {
                (v0 + steady) * (1.0 - decay) / b - steady * t
            });
            let now = games.snapshot(0);
            for (axis, direction) in direction.into_iter().enumerate() {
                let place = -0.1 + direction * x;
                let off = (now.ball_position[axis] - place).abs();
                assert!(off < bound, "{pieces} pieces, step {step}: {off} m off");
                assert!((now.ball_velocity[axis] - direction * v).abs() < bound);
            }
        }
    }
}

#[test]
fn a_period_without_contacts_is_as_good_in_one_piece() {
    // Biscuits, here far away, force the game to divide every period.
    let ball = BallSettings {
        effects: instances(&[
            ("ball.rolling_resistance", &[0.01, 0.1]),
            ("ball.tilt", &[0.004, -0.003]),
            ("ball.air_drag", &[0.1]),
        ]),
        ..BallSettings::default()
    };
    let whole = long(GameSettings { ball, ..GameSettings::default() });
    let cut = GameSettings { biscuits: Some(BiscuitSettings::default()), ..whole.clone() };
    let mut games = [whole, cut].map(|settings| one(&settings, [0.1, 0.02], [-0.2, 0.15]));
    for step in 0..40 {
        let [a, b] = games.each_mut().map(|games| {
            games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
            games.snapshot(0)
        });
        assert_ne!(a.ball_velocity, [0.0; 2]);
        let off = length(subtract(a.ball_position, b.ball_position));
        let change = length(subtract(a.ball_velocity, b.ball_velocity));
        // The square of the ratio of the period to the 2.5 s in which the ball would stop.
        assert!(off < 1e-5 && change < 5e-5, "step {step}: {off} m, {change} m/s");
    }
}

#[test]
fn a_ball_stops_where_the_closed_formula_says_and_stays() {
    let (c, v0) = (0.02, 0.15);
    let effects = instances(&[("ball.rolling_resistance", &[c, 0.0])]);
    let ball = BallSettings { effects, ..BallSettings::default() };
    let mut games = one(&GameSettings { ball, ..GameSettings::default() }, [0.0; 2], [v0, 0.0]);
    for _ in 0..100 {
        games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    }
    let now = games.snapshot(0);
    // v0^2 / 2cg; the last piece may end up to c g h^2 / 8 early or late.
    let stop = v0 * v0 / (2.0 * c * 9.81);
    assert!((now.ball_position[0] - stop).abs() < c * 9.81 * 0.005_f64.powi(2));
    assert_eq!(now.ball_velocity, [0.0; 2]);
}

#[test]
fn on_a_tilted_board_the_ball_falls_along_the_slope() {
    let effects = instances(&[("ball.tilt", &[0.01, 0.0])]);
    let ball = BallSettings { effects, ..BallSettings::default() };
    let mut games = one(&GameSettings { ball, ..GameSettings::default() }, [0.0; 2], [0.0; 2]);
    for _ in 0..20 {
        games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    }
    let [x, y] = games.snapshot(0).ball_position;
    let want = 0.5 * 9.81 * 0.01 * 0.16;
    assert!((x - want).abs() < 1e-12 && y == 0.0, "{x} {y} {want}");
}

#[test]
fn a_square_bounce_returns_the_share_of_restitution_at_the_exact_place() {
    let mut games =
        one(&GameSettings { ball: ball(0.8, 0.1), ..Default::default() }, [0.0; 2], [3.0, 0.0]);
    let mut outcomes = Outcomes::new(1);
    for _ in 0..4 {
        games.advance(&[STILL], &mut outcomes).unwrap();
    }
    // 0.153 m at 3 m/s, then 0.029 s at 2.4 m/s.
    let now = games.snapshot(0);
    assert!((now.ball_velocity[0] + 2.4).abs() < 1e-12);
    assert!((now.ball_position[0] - (0.153 - 2.4 * (0.08 - 0.051))).abs() < 1e-12);
}

#[test]
fn an_oblique_bounce_loses_tangential_speed_by_coulombs_law_until_it_rolls_off() {
    // (mu, vt, remaining vt): sliding loses mu (1 + e) vn, gripping 2/7; static friction is 1.5 mu.
    for (mu, tangential, left) in [
        (0.05, 1.0, 1.0 - 0.05 * 1.8),
        (0.05, -1.0, -1.0 + 0.05 * 1.8),
        (1.0, 0.7, 0.5),
        // Needs 2/7 * 0.9 = 0.257: static friction gives 0.27, so it grips although kinetic
        // friction gives 0.18.
        (0.1, 0.9, 0.9 * 5.0 / 7.0),
    ] {
        let settings = GameSettings { ball: ball(0.8, mu), ..Default::default() };
        let mut games = one(&settings, [0.14, 0.0], [1.0, tangential]);
        games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
        let now = games.snapshot(0);
        assert!((now.ball_velocity[1] - left).abs() < 1e-12, "{mu} {tangential} {now:?}");
    }
}

fn parts(e: f64, mu: f64) -> (Table, BoardPhysics) {
    let effects =
        instances(&[("impact.wall_restitution", &[e]), ("impact.wall_friction_spin", &[mu, 0.0])]);
    let laws = BallLaws::new(&effects, &effects);
    let surface = laws.walls.surface(1.5);
    let physics = BoardPhysics { ball_mass: 0.0017, walls: surface, strikers: surface };
    let table = Table { laws, ..Table::new(&GameSettings::default()) };
    (table, physics)
}

/// Kinetic energy of the ball (J): motion, rolling along, spin about the vertical.
fn energy(ball: &BallState) -> f64 {
    let v = length(ball.velocity);
    0.5 * 0.0017 * (v * v + 0.4 * ball.spin * ball.spin)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_hit_keeps_the_momentum_and_never_makes_energy(
        angle in 0.0..TAU, v in [-5.0..5.0_f64, -5.0..5.0], u in [-1.0..1.0_f64, -1.0..1.0],
        spin in -3.0..3.0_f64, e in 0.0..1.0_f64, mu in 0.0..0.6_f64, mass in 0.001..0.1_f64,
    ) {
        let (table, physics) = parts(e, mu);
        let mut ball = BallState { velocity: v, spin, ..BallState::at([0.0; 2]) };
        let mut mover = Mover::striker([TOUCH * angle.cos(), TOUCH * angle.sin()], u, mass);
        let sum = |ball: &BallState, mover: &Mover| [0, 1].map(|k| 0.0017 * ball.velocity[k] + mass * mover.velocity[k]);
        let all = |ball: &BallState, mover: &Mover| energy(ball) + 0.5 * mass * length(mover.velocity).powi(2);
        let (momentum, before) = (sum(&ball, &mover), all(&ball, &mover));
        let relative = subtract(v, u);
        let closing = relative[0] * angle.cos() + relative[1] * angle.sin();
        let speed = strike(&table.laws, &physics.strikers, physics.ball_mass, &mut ball, &mut mover);
        prop_assert_eq!(speed.is_some(), 0.0 < closing);
        let after = sum(&ball, &mover);
        prop_assert!((momentum[0] - after[0]).abs() + (momentum[1] - after[1]).abs() < 1e-15);
        prop_assert!(all(&ball, &mover) <= before * (1.0 + 1e-12));
        // Newton's law for the normal velocities.
        if let Some(speed) = speed && 0.01 < speed {
            let relative = subtract(ball.velocity, mover.velocity);
            let parting = relative[0] * angle.cos() + relative[1] * angle.sin();
            prop_assert!((parting + e * speed).abs() < 1e-9);
        }
    }

    #[test]
    fn energy_never_grows_among_standing_things(
        start in [-0.15..0.15_f64, -0.14..0.14], angle in 0.0..TAU, speed in 0.0..5.0_f64, spin in -2.0..2.0_f64,
        e in 0.3..1.0_f64, mu in 0.0..0.5_f64, striker in [-0.1..0.1_f64, -0.15..0.15], pieces in 1..8_u32,
    ) {
        let (table, physics) = parts(e, mu);
        let play = Play { table: &table, physics: &physics };
        prop_assume!(TOUCH < length(subtract(start, striker)));
        let velocity = [speed * angle.cos(), speed * angle.sin()];
        let mut ball = BallState { velocity, spin, ..BallState::at(start) };
        let mut movers = [Mover::striker(striker, [0.0; 2], 0.012), Mover::striker(ASIDE[1], [0.0; 2], 0.012)];
        let all = |ball: &BallState, movers: &[Mover; 2]| {
            energy(ball) + movers.iter().map(|m| 0.006 * length(m.velocity).powi(2)).sum::<f64>()
        };
        let mut before = all(&ball, &movers);
        for _ in 0..100 {
            if play.drift(&mut ball, &mut movers, 0.02 / f64::from(pieces)).taken {
                break;
            }
            let after = all(&ball, &movers);
            prop_assert!(after <= before * (1.0 + 1e-12), "{} {}", after, before);
            before = after;
        }
    }

    #[test]
    fn nothing_is_tunnelled_through(
        start in [-0.15..0.15_f64, -0.14..0.14], angle in 0.0..TAU, speed in 0.0..5.0_f64,
        commands in prop::collection::vec([[-9.0..9.0_f32, -9.0..9.0], [-9.0..9.0_f32, -9.0..9.0]], 40),
        pieces in prop::sample::select(vec![1_usize, 4, 20]),
    ) {
        let settings = long(GameSettings { pieces, ..GameSettings::default() });
        let mut games = Games::new(1, &settings, 0).unwrap();
        let strikers = [[0.0, -0.1], [0.0, 0.1]];
        prop_assume!(strikers.iter().all(|s| TOUCH < length(subtract(start, *s))));
        games.set_positions(0, start, [speed * angle.cos(), speed * angle.sin()], strikers);
        let mut outcomes = Outcomes::new(1);
        for command in commands {
            games.advance(&[command], &mut outcomes).unwrap();
            let now = games.snapshot(0);
            for (place, reach) in now.ball_position.into_iter().zip(REACH) {
                prop_assert!(place.abs() <= reach + 1e-12, "{:?}", now);
            }
            let ended = outcomes.ended[0];
            if matches!(ended, Some(Ending::Goal { .. })) {
                // A ball in a cup is below the strikers.
                break;
            }
            for striker in now.striker_positions {
                prop_assert!(TOUCH - 1e-9 < length(subtract(now.ball_position, striker)), "{:?}", now);
            }
            if ended.is_some() {
                break;
            }
        }
    }
}

#[test]
fn every_shot_at_a_striker_hits_it_from_every_side_with_any_piece() {
    for pieces in [1, 4, 20] {
        let settings = GameSettings { pieces, ball: ball(0.75, 0.1), ..Default::default() };
        let mut games = Games::new(1, &settings, 0).unwrap();
        let striker = [0.0, -0.08];
        for degrees in 0..360 {
            let angle = f64::from(degrees).to_radians();
            let (sine, cosine) = angle.sin_cos();
            for aim in [-0.999, -0.5, 0.0, 0.7, 0.999] {
                for speed in [0.5, 5.0] {
                    // 60 mm away, passing the striker's centre at a fraction of the contact
                    // distance.
                    let offset = aim * TOUCH;
                    let start = [0.06 * cosine - offset * sine, 0.06 * sine + offset * cosine];
                    let start = [striker[0] - start[0], striker[1] - start[1]];
                    games.set_positions(
                        0,
                        start,
                        [speed * cosine, speed * sine],
                        [striker, ASIDE[1]],
                    );
                    let mut outcomes = Outcomes::new(1);
                    let mut hits = 0;
                    for _ in 0..8 {
                        games.advance(&[STILL], &mut outcomes).unwrap();
                        hits += u32::from(outcomes.hits[0][0]);
                        if 0 < hits {
                            break;
                        }
                    }
                    assert_eq!(hits, 1, "{degrees} degrees, aim {aim}, {speed} m/s, {pieces}");
                }
            }
        }
    }
}

#[test]
fn a_striker_runs_into_a_resting_ball() {
    // At 0.4 m/s a striker of mass M gives a ball of mass m (1 + e) M / (M + m) of its speed.
    let settings = GameSettings { ball: ball(0.75, 0.0), ..Default::default() };
    let mut games = Games::new(1, &settings, 0).unwrap();
    // Away from the zone of the limiter.
    games.set_positions(0, [0.05, -0.135], [0.0; 2], [[0.05, -0.17], ASIDE[1]]);
    let mut outcomes = Outcomes::new(1);
    let command = [[0.0, 0.3], [0.0; 2]];
    while outcomes.hits[0][0] == 0 {
        games.advance(&[command], &mut outcomes).unwrap();
    }
    let now = games.snapshot(0);
    let want = 0.3 * 1.75 * 0.012 / (0.012 + 0.0017);
    assert!((now.ball_velocity[1] - want).abs() < 1e-6, "{now:?} {want}");
    assert!((f64::from(outcomes.hit_speeds[0][0]) - 0.3).abs() < 1e-6);
    assert!(now.striker_velocities[0][1] < 0.3);
    // The magnet returns the striker to its position.
    for _ in 0..50 {
        games.advance(&[STILL], &mut outcomes).unwrap();
    }
    assert_eq!(games.snapshot(0).striker_velocities[0], [0.0; 2]);
}

#[test]
fn a_wedged_ball_never_ends_inside_anything() {
    // The striker presses the ball against the wall for two seconds.
    let mut settings = long(GameSettings::default());
    settings.limits.clearance = 0.0;
    let mut games = Games::new(1, &settings, 0).unwrap();
    games.set_positions(0, [0.152, -0.1], [0.0; 2], [[0.1, -0.1], ASIDE[1]]);
    for _ in 0..100 {
        games.advance(&[[[0.4, 0.0], [0.0; 2]]], &mut Outcomes::new(1)).unwrap();
        let now = games.snapshot(0);
        assert!(now.ball_position[0] <= REACH[0] + 1e-12, "{now:?}");
        let distance = length(subtract(now.ball_position, now.striker_positions[0]));
        assert!(TOUCH - 1e-9 < distance, "{distance} {now:?}");
    }
}

#[test]
fn walls_that_stand_elsewhere_turn_the_ball_back_there() {
    let mut ball = ball(1.0, 0.0);
    ball.effects.extend(instances(&[(
        "impact.wall_location",
        &[0.0, -0.002, 0.0, 0.003, 0.0, 0.0, 0.0, 0.05],
    )]));
    let settings = GameSettings { ball, ..Default::default() };
    let mut games = one(&settings, [0.14, 0.0], [1.0, 0.0]);
    games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    // 0.151 m is the end of the way: 11 mm there, 9 mm back.
    assert!((games.snapshot(0).ball_position[0] - 0.142).abs() < 1e-12);
    // A wall turned by atan 0.05 turns the ball by twice that.
    let mut games = one(&settings, [0.0, 0.195], [0.0, 1.0]);
    games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    let [x, y] = games.snapshot(0).ball_velocity;
    let turn = 2.0 * 0.05_f64.atan();
    assert!((x.abs() - turn.sin()).abs() < 1e-9 && (y + turn.cos()).abs() < 1e-9, "{x} {y}");
}

#[test]
fn a_surface_without_laws_gives_everything_back() {
    let surface = BallLaws::new(&[], &[]).walls.surface(1.5);
    let want = Surface { restitution: 1.0, static_friction: 0.0, dynamic_friction: 0.0 };
    assert_eq!(surface, want);
}
