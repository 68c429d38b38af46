//! Tests of the ball: conservation laws, contacts, cups.

use super::support::Host;
use crate::{
    rig::{
        ball::Ball,
        config::{BallConfig, CupConfig, Launch, MagnetConfig, PegConfig},
        magnet::Peg,
    },
    seed::Stream,
};

const HALF_BOARD: [f64; 2] = [0.16, 0.21];
const DT: f64 = 0.000_125;

fn free(launch: Launch) -> BallConfig {
    BallConfig {
        rolling_resistance: 0.0,
        viscous_per_s: 0.0,
        quadratic_per_m: 0.0,
        start: Some(launch),
        ..BallConfig::default()
    }
}

fn no_cups() -> CupConfig {
    CupConfig { radius_m: 0.0, ..CupConfig::default() }
}

/// Uncoupled strikers without friction.
fn loose_pegs(mass_kg: f64) -> [Peg; 2] {
    let config = PegConfig { mass_kg, friction_n: 0.0, ..PegConfig::default() };
    let magnet = MagnetConfig { caught_at_m: 1e-4, ..MagnetConfig::default() };
    [[0.0, -0.1], [0.0, 0.1]].map(|place| {
        let mut peg = Peg::new(&config, &magnet, place, HALF_BOARD);
        peg.magnet_broken = true;
        peg
    })
}

fn energy(ball: &Ball, pegs: &[Peg; 2], mass: f64) -> f64 {
    let square = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
    let pegs: f64 = pegs.iter().map(|peg| peg.mass() * square(peg.velocity)).sum();
    0.5 * (mass * square(ball.velocity) + pegs)
}

fn step(ball: &mut Ball, pegs: &mut [Peg; 2], idx: u32) {
    for peg in pegs.iter_mut() {
        peg.step(peg.position, [0.0; 2], DT);
    }
    ball.step(f64::from(idx) * DT, DT, pegs);
}

#[test]
fn energy_never_grows_and_nothing_is_tunnelled_through() {
    let mut draws = Stream::new(5, "ball test");
    for restitution in [0.5, 0.95, 1.0] {
        for _ in 0..20 {
            let angle = f64::from(draws.uniform_f32(0.0, 6.3));
            let launch = Launch {
                x_m: f64::from(draws.uniform_f32(-0.1, 0.1)),
                y_m: 0.0,
                vx_m_per_s: 5.0 * angle.cos(),
                vy_m_per_s: 5.0 * angle.sin(),
            };
            let config = BallConfig {
                wall_restitution: restitution,
                peg_restitution: restitution,
                ..free(launch)
            };
            let mut pegs = loose_pegs(0.01);
            let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
            let mut before = energy(&ball, &pegs, config.mass_kg);
            for idx in 0..8000 {
                step(&mut ball, &mut pegs, idx);
                let after = energy(&ball, &pegs, config.mass_kg);
                assert!(after <= before * (1.0 + 1e-9), "{before} J became {after} J");
                before = after;
                let [x, y] = ball.place.unwrap();
                assert!(x.abs() <= 0.153 + 1e-9 && y.abs() <= 0.203 + 1e-9, "left the board");
                for peg in &pegs {
                    let d = (x - peg.position[0]).hypot(y - peg.position[1]);
                    // Squeezed against a wall it may overlap a little, but never be inside.
                    assert!(0.0135 < d, "{d}");
                }
            }
        }
    }
}

/// A long step, in which the ball at 5 m/s passes more than its diameter.
#[test]
fn contacts_are_found_in_long_steps() {
    let dt = 0.005;
    let config = free(Launch { x_m: 0.0, y_m: 0.0, vx_m_per_s: 0.0, vy_m_per_s: 5.0 });
    let mut pegs = loose_pegs(1e6);
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..200 {
        ball.step(f64::from(idx) * dt, dt, &mut pegs);
        assert!(ball.place.unwrap()[1] <= 0.1 - 0.0145 + 1e-9);
        assert!(-0.1 + 0.0145 - 1e-9 <= ball.place.unwrap()[1]);
    }
}

#[test]
fn momentum_is_kept_between_ball_and_striker_and_restitution_is_exact() {
    let config = free(Launch { x_m: 0.0, y_m: 0.05, vx_m_per_s: 0.0, vy_m_per_s: 1.0 });
    let mut pegs = loose_pegs(0.01);
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..400 {
        step(&mut ball, &mut pegs, idx);
    }
    let momentum = config.mass_kg * ball.velocity[1] + 0.01 * pegs[1].velocity[1];
    assert!((momentum - config.mass_kg).abs() < 1e-12);
    let apart = pegs[1].velocity[1] - ball.velocity[1];
    assert!((apart - config.peg_restitution).abs() < 1e-9, "{apart}");
}

#[test]
fn restitution_falls_with_speed_when_told_to() {
    for (speed, wanted) in [(1.0, 0.8), (3.0, 0.6)] {
        let config = BallConfig {
            wall_restitution: 0.9,
            wall_restitution_loss_s_per_m: 0.1,
            ..free(Launch { x_m: 0.1, y_m: 0.0, vx_m_per_s: speed, vy_m_per_s: 0.0 })
        };
        let mut pegs = loose_pegs(0.01);
        let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
        for idx in 0..500 {
            step(&mut ball, &mut pegs, idx);
        }
        assert!((-ball.velocity[0] / speed - wanted).abs() < 1e-9, "{:?}", ball.velocity);
    }
}

#[test]
fn a_slow_ball_drops_into_the_cup_and_a_fast_one_rolls_over_it() {
    for (speed, goals) in [(0.5, [0, 1]), (2.5, [0, 0])] {
        let launch = Launch { x_m: 0.05, y_m: 0.17, vx_m_per_s: -speed, vy_m_per_s: 0.0 };
        let mut pegs = loose_pegs(0.01);
        let mut ball = Ball::new(&free(launch), &CupConfig::default(), HALF_BOARD, 1);
        for idx in 0..700 {
            step(&mut ball, &mut pegs, idx);
        }
        assert_eq!(ball.goals, goals, "{speed} m/s");
    }
}

#[test]
fn rolling_resistance_and_tilt_are_those_of_the_configuration() {
    let launch = Launch { x_m: 0.0, y_m: -0.05, vx_m_per_s: 0.0, vy_m_per_s: 0.3 };
    let config = BallConfig { rolling_resistance: 0.01, x_tilt_rad: 0.004, ..free(launch) };
    let mut pegs = loose_pegs(0.01);
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..800 {
        step(&mut ball, &mut pegs, idx);
    }
    // 0.1 s of 5/7 g 0.004 downhill, minus the component of the friction across.
    let [vx, vy] = ball.velocity;
    assert!((vx + 5.0 / 7.0 * 9.81 * 0.004 * 0.1).abs() < 1e-4, "{vx}");
    assert!((vy - (0.3 - 0.01 * 9.81 * 0.1)).abs() < 1e-4, "{vy}");
}

#[test]
fn people_put_the_ball_back_and_roll_it() {
    let mut host = Host::from_json(
        r#"{"ball": {"start": {"x_m": 0.05, "y_m": 0.17, "vx_m_per_s": -0.5}, "put_back_after_s": 0.5}}"#,
    );
    host.wait(0.3);
    let truth = host.link.truth();
    assert_eq!(truth.goals, [0, 1]);
    assert_eq!((truth.ball.unwrap().x, truth.ball.unwrap().y), (0.0, 0.17));
    host.wait(0.29);
    assert!(0.01 < host.link.truth().ball.unwrap().speed());
    let mut host = Host::from_json(r#"{"ball": {"start": null, "launch_every_s": 1.0}}"#);
    host.wait(0.9);
    assert_eq!(host.link.truth().ball, None);
    host.wait(0.2);
    assert!(0.2 < host.link.truth().ball.unwrap().speed());
}

#[test]
fn a_ball_at_rest_is_served_again_from_near_its_start() {
    let rig = |seed: u32, serve: &str| {
        format!(
            r#"{{"seed": {seed}, "ball": {{"start": {{"x_m": 0.05}}, "put_back_still_after_s": 0.5{serve}}}}}"#
        )
    };
    // Without a push the ball is returned to its position.
    let mut host = Host::from_json(&rig(1, ""));
    host.wait(2.0);
    let ball = host.link.truth().ball.unwrap();
    assert_eq!([ball.x, ball.y, ball.vx, ball.vy], [0.05, 0.0, 0.0, 0.0]);
    let serve = r#", "serve_spread_m": 0.02, "serve_speed_m_per_s": 0.1"#;
    let served = |seed| {
        let mut host = Host::from_json(&rig(seed, serve));
        let first = host.link.truth().ball.unwrap();
        // It rolls for at most 0.1 / (0.008 * 9.81) s, and 0.5 s later it is served again.
        host.wait(1.27 + 0.5 + 0.05);
        (first, host.link.truth().ball.unwrap())
    };
    let (first, again) = served(1);
    for ball in [first, again] {
        assert!((ball.x - 0.05).abs() < 0.02 + 0.064 && ball.y.abs() < 0.02 + 0.064, "{ball:?}");
    }
    assert!((0.05..=0.1).contains(&first.speed()), "{first:?}");
    assert!(0.0 < again.speed(), "{again:?}");
    assert_eq!(served(1), (first, again));
    assert_ne!(served(2).0, first);
}

#[test]
fn the_serve_of_a_match_scores_no_goal_by_itself() {
    let config = BallConfig::in_a_match();
    for seed in 0..40 {
        let mut pegs = loose_pegs(0.01);
        pegs[0].position = [0.15, -0.2];
        pegs[1].position = [0.15, 0.2];
        let mut ball = Ball::new(&config, &CupConfig::default(), HALF_BOARD, seed);
        for idx in 0..16_000 {
            step(&mut ball, &mut pegs, idx);
        }
        assert_eq!(ball.goals, [0, 0], "seed {seed}");
    }
}

#[test]
fn a_striker_hits_the_ball() {
    let mut host = Host::from_json(r#"{"ball": {"start": {"x_m": 0.0, "y_m": 0.07}}}"#);
    host.arm();
    host.drive([0.0, -0.5], 0.14);
    let ball = host.link.truth().ball.unwrap();
    assert!(ball.vy < -0.4, "{ball:?}");
}

/// A ball that starts sliding without spin rolls at 5/7 of its speed, for any friction.
#[test]
fn a_sliding_ball_ends_rolling_with_five_sevenths() {
    let launch = Launch { x_m: 0.0, y_m: 0.0, vx_m_per_s: 0.0, vy_m_per_s: 0.3 };
    let config = BallConfig { sliding_friction: 0.2, peg_restitution: 1.0, ..free(launch) };
    // Off a wall of e = 1 the spin still points the old way: v' = -v, u = v, so it rolls at
    // (5 v' + 2 u)/7 = -3/7 v.
    let config = BallConfig { wall_restitution: 1.0, ..config };
    let mut pegs = loose_pegs(0.01);
    pegs[1].position = [0.1, 0.1];
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..8000 {
        step(&mut ball, &mut pegs, idx);
    }
    assert!((ball.velocity[1] + 0.3 * 3.0 / 7.0).abs() < 1e-3, "{:?}", ball.velocity);
}

#[test]
fn magnets_patches_and_shifted_walls_act_where_they_are() {
    let launch = Launch { x_m: 0.02, y_m: -0.1, ..Launch::default() };
    let config = BallConfig { peg_attraction_m_per_s2: 0.5, ..free(launch) };
    let mut pegs = loose_pegs(0.01);
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..400 {
        step(&mut ball, &mut pegs, idx);
    }
    assert!(ball.velocity[0] < -0.005, "{:?}", ball.velocity);

    let launch = Launch { x_m: 0.1, y_m: 0.0, vx_m_per_s: 0.5, vy_m_per_s: 0.0 };
    let mut config = BallConfig { wall_restitution: 0.0, ..free(launch) };
    config.wall_shift.x_high_m = 0.002;
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..2000 {
        step(&mut ball, &mut pegs, idx);
    }
    assert!((ball.place.unwrap()[0] - 0.155).abs() < 1e-9);

    let launch = Launch { x_m: 0.0, y_m: 0.0, vx_m_per_s: 0.5, vy_m_per_s: 0.0 };
    let mut config = free(launch);
    (config.patch.x_m, config.patch.radius_m, config.patch.extra_resistance) = (0.05, 0.01, 0.1);
    let mut ball = Ball::new(&config, &no_cups(), HALF_BOARD, 1);
    for idx in 0..1200 {
        step(&mut ball, &mut pegs, idx);
    }
    // v^2 falls by 2 c g 0.02 m on the patch alone.
    let wanted = (0.25_f64 - 2.0 * 0.1 * 9.81 * 0.02).sqrt();
    assert!((ball.velocity[0] - wanted).abs() < 2e-3, "{:?}", ball.velocity);
}
