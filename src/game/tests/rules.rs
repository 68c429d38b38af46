//! Tests of goals, rim-outs, own goals, biscuits, time limits, command limits and invalid settings.

use super::{ASIDE, STILL, ball, long, one, until_end};
use crate::{
    board::CUP_RADIUS,
    game::{
        BallSettings, BiscuitSettings, CupRule, CupSettings, Ending, GameError, GameSettings,
        Games, LimiterPlace, Outcomes, Randomization, StrikerOverCup, settings::CONTROL_PERIOD,
        sure_fall_speed,
    },
    recording::topic::Player,
};

/// Shoot a ball at the far cup along y, `aside` (m) from its middle; returns the end of the episode
/// and the speed of the ball after the first bounce or fall.
fn shoot(speed: f64, aside: f64, rule: CupRule) -> (Option<Ending>, f64) {
    let cup = CupSettings { rule, ..CupSettings::default() };
    let settings = long(GameSettings { ball: ball(1.0, 0.0), cup, ..Default::default() });
    let mut games = one(&settings, [aside, 0.14], [0.0, speed]);
    let mut outcomes = Outcomes::new(1);
    // To the wall behind the cup, 63 mm away, and not back into it.
    let mut left = 0.062 / speed;
    while 0.0 < left && outcomes.ended[0].is_none() {
        games.advance(&[STILL], &mut outcomes).unwrap();
        left -= 0.02;
    }
    let [x, y] = games.snapshot(0).ball_velocity;
    (outcomes.ended[0], x.hypot(y))
}

#[test]
fn a_slow_ball_falls_wherever_it_crosses_the_cup() {
    let scored = Some(Ending::Goal { scorer: Player::Left });
    for share in [0.0, 0.3, -0.6, 0.9, -0.99, 0.9999] {
        let bound = sure_fall_speed(CUP_RADIUS);
        for speed in [0.1, 0.4, 0.99 * bound] {
            let found = shoot(speed, share * CUP_RADIUS, CupRule::Fall);
            assert_eq!(found.0, scored, "{share} {speed}");
        }
    }
    // And one that comes to rest over the cup.
    let mut games = one(&GameSettings::default(), [0.0, -0.165], [0.0; 2]);
    let (ending, steps) = until_end(&mut games, STILL);
    assert_eq!(ending, Ending::Goal { scorer: Player::Right });
    assert_eq!(steps, 2, "sqrt(2 r / g) is 38 ms");
}

#[test]
fn speed_and_length_of_the_way_over_the_cup_decide() {
    // Across the middle 1 m/s falls and 2 m/s leaves; near the edge 1 m/s leaves as well.
    let fell = |speed, aside| shoot(speed, aside, CupRule::Fall).0.is_some();
    assert!(fell(1.0, 0.0) && !fell(2.0, 0.0) && !fell(1.0, 0.98 * CUP_RADIUS));
    // The fastest ball that is captured across the middle, by bisection, against the formula of the
    // rim solved by hand: 1.4 m/s.
    let (mut low, mut high) = (1.0, 2.0);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if fell(middle, 0.0) { low = middle } else { high = middle }
    }
    let q = |v: f64| {
        let (r, g, t) = (0.007, 9.81, 2.0 * CUP_RADIUS / v);
        let h = 0.5 * g * t * t;
        let s: f64 = 1.0 - h / r;
        v * s - g * t * (1.0 - s * s).sqrt() - (2.0 * g * h).sqrt()
    };
    assert!(q(low).abs() < 1e-6, "{low} {}", q(low));
}

#[test]
fn a_ball_that_leaves_a_cup_is_slower_and_turned() {
    let (ending, speed) = shoot(2.0, 0.0, CupRule::Fall);
    assert_eq!(ending, None);
    assert!(speed < 1.9, "{speed}");
    // Off the middle the rim removes radial speed only, so the path bends outwards or inwards.
    let mut games = one(
        &long(GameSettings { ball: ball(1.0, 0.0), ..Default::default() }),
        [0.012, 0.14],
        [0.0, 2.0],
    );
    games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    let now = games.snapshot(0);
    assert!(now.ball_velocity[0] < -0.01, "{now:?}");
}

#[test]
fn upstreams_rule_takes_every_ball_up_to_its_limit_and_lets_others_pass() {
    assert!(shoot(1.9, 0.0, CupRule::SlowerThan(2.0)).0.is_some());
    let (ending, speed) = shoot(2.1, 0.0, CupRule::SlowerThan(2.0));
    assert!(ending.is_none() && (speed - 2.1).abs() < 1e-12);
}

#[test]
fn a_striker_over_its_own_cup_loses() {
    for (player, command) in
        [(Player::Left, [[0.0, -0.4], [0.0; 2]]), (Player::Right, [[0.0; 2], [0.0, -0.4]])]
    {
        let mut games = one(&GameSettings::default(), [0.0; 2], [0.0; 2]);
        games.set_positions(0, [0.1, 0.0], [0.0; 2], [[0.0, -0.14], [0.0, 0.14]]);
        let (ending, steps) = until_end(&mut games, command);
        assert_eq!(ending, Ending::OwnGoal { loser: player });
        assert_eq!(ending.winner(), Some([Player::Right, Player::Left][player as usize]));
        // 11 mm at up to 0.4 m/s, slowed by the limiter.
        assert!((2..20).contains(&steps), "{steps}");
    }
}

#[test]
fn a_striker_that_passes_over_its_cup_ends_nothing_under_the_rule_of_the_rig() {
    let mut settings = GameSettings::default();
    settings.cup.striker = StrikerOverCup::Passes;
    settings.episode.still_limit = 3600.0;
    let mut games = one(&settings, [0.0; 2], [0.0; 2]);
    games.set_positions(0, [0.1, 0.0], [0.0; 2], [[0.0, -0.14], [0.0, 0.14]]);
    let mut outcomes = Outcomes::new(1);
    for _ in 0..40 {
        games.advance(&[[[0.0, -0.4], [0.0; 2]]], &mut outcomes).unwrap();
        assert_eq!(outcomes.ended[0], None);
    }
    let [_, y] = games.snapshot(0).striker_positions[0];
    assert!(y < -0.16, "the striker is not over its cup: {y}");
}

#[test]
fn everything_stops_with_the_piece_in_which_an_episode_ends() {
    let settings = GameSettings { pieces: 4, ..GameSettings::default() };
    let cup = settings.cup;
    for offset in 0..10 {
        let mut games = one(&settings, [0.0; 2], [0.0; 2]);
        // The striker passes the cup's rim at a different moment of a period each time.
        let start = -0.14 - 2e-4 * f64::from(offset);
        games.set_positions(0, [0.1, 0.0], [0.0; 2], [[0.0, start], [0.0, 0.14]]);
        until_end(&mut games, [[0.0, -0.4], [0.0; 2]]);
        let rim = cup.radius - cup.distance;
        let place = games.snapshot(0).striker_positions[0][1];
        let piece_way = 0.4 * CONTROL_PERIOD / 4.0;
        assert!(place < rim && rim - place <= piece_way, "{place} {rim}");
    }
}

#[test]
fn nobody_wins_at_the_time_limit() {
    let mut settings = GameSettings::default();
    settings.episode.still_limit = 3600.0;
    let mut games = one(&settings, [0.1, 0.0], [0.0; 2]);
    let (ending, steps) = until_end(&mut games, STILL);
    assert_eq!((ending, steps), (Ending::TimeLimit, 500));
    assert_eq!(ending.winner(), None);
}

#[test]
fn nobody_wins_when_the_ball_lies_still_for_too_long() {
    for (y, half) in [(-0.05, Player::Left), (0.05, Player::Right)] {
        let mut games = one(&GameSettings::default(), [0.1, y], [0.0; 2]);
        let (ending, steps) = until_end(&mut games, STILL);
        assert_eq!((ending, steps), (Ending::BallAtRest { half }, 100));
        assert_eq!(ending.winner(), None);
    }
    // A rolling ball does not end the episode: 0.1 m/s at about 0.1 m/s^2 for one second, then two
    // at rest.
    let mut games = one(&GameSettings::default(), [0.1, 0.0], [-0.1, 0.0]);
    let (ending, steps) = until_end(&mut games, STILL);
    assert_eq!(ending, Ending::BallAtRest { half: Player::Right });
    assert!((130..200).contains(&steps), "{steps}");
}

#[test]
fn no_episode_begins_where_no_striker_reaches_the_ball() {
    let games = Games::new(500, &GameSettings::default(), 7).unwrap();
    let places = (0..500).map(|board| games.snapshot(board).ball_position[1]);
    assert!(places.clone().all(|y| (0.03..=0.1).contains(&y.abs())));
    let left = places.filter(|y| *y < 0.0).count();
    assert!((200..300).contains(&left), "{left}");
}

#[test]
fn two_biscuits_on_one_striker_lose_the_point() {
    let settings =
        long(GameSettings { biscuits: Some(BiscuitSettings::default()), ..Default::default() });
    let mut games = one(&settings, [0.0, 0.08], [0.0; 2]);
    games.set_positions(0, [0.14, 0.1], [0.0; 2], [[-0.1, -0.05], ASIDE[1]]);
    // Towards the middle, where the workspace ends 0.0335 m short of the biscuits: they are not
    // captured.
    let mut outcomes = Outcomes::new(1);
    for _ in 0..100 {
        games.advance(&[[[0.0, 0.4], [0.0; 2]]], &mut outcomes).unwrap();
    }
    assert_eq!(games.snapshot(0).biscuits_held, [0, 0]);
    // With a workspace up to the middle line, first one, then another along the line.
    let mut settings = settings;
    settings.limits.field.left.y_max_m = 0.0;
    let mut games = one(&settings, [0.0, 0.08], [0.0; 2]);
    games.set_positions(0, [0.14, 0.1], [0.0; 2], [[-0.08, -0.06], ASIDE[1]]);
    let mut steps = 0;
    while games.snapshot(0).biscuits_held == [0, 0] {
        games.advance(&[[[0.0, 0.4], [0.0; 2]]], &mut outcomes).unwrap();
        assert_eq!(outcomes.ended[0], None);
        steps += 1;
        assert!(steps < 200);
    }
    let held = games.snapshot(0);
    // It moves with the striker.
    for _ in 0..10 {
        games.advance(&[[[0.0, -0.4], [0.0; 2]]], &mut outcomes).unwrap();
    }
    let now = games.snapshot(0);
    let places = [held.biscuits.unwrap()[0], now.biscuits.unwrap()[0]];
    let moved = places[1][1] - places[0][1];
    let striker = now.striker_positions[0][1] - held.striker_positions[0][1];
    assert!(moved < -0.02 && (moved - striker).abs() < 1e-12, "{moved} {striker}");
    // Back to the line, to the start position of the first one, and along it to the next.
    for _ in 0..100 {
        games.advance(&[[[0.0, 0.4], [0.0; 2]]], &mut outcomes).unwrap();
        assert_eq!(outcomes.ended[0], None);
    }
    let (ending, _) = until_end(&mut games, [[0.4, 0.4], [0.0; 2]]);
    assert_eq!(ending, Ending::Biscuits { loser: Player::Left });
    assert_eq!(games.snapshot(0).biscuits_held, [2, 0]);
}

#[test]
fn a_ball_pushes_a_free_biscuit_which_slides_to_rest() {
    let biscuits = BiscuitSettings { mass: 0.0017, friction: 0.3, ..BiscuitSettings::default() };
    let settings =
        long(GameSettings { biscuits: Some(biscuits), ball: ball(1.0, 0.0), ..Default::default() });
    let mut games = one(&settings, [0.0, -0.05], [0.0, 1.0]);
    for _ in 0..50 {
        games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
    }
    // A central impact gives it the speed of a ball of its own mass, and it slides v^2 / 2 mu g, up
    // to a piece more or less.
    let end = 1.0 / (2.0 * 0.3 * 9.81);
    let [x, y] = games.snapshot(0).biscuits.unwrap()[1];
    assert!(x == 0.0 && (y - end).abs() < 0.005, "{x} {y} {end}");
    assert_eq!(games.snapshot(0).ball_velocity, [0.0; 2]);
}

#[test]
fn commands_are_slewed_then_limited_and_the_ideal_carriage_obeys() {
    let mut games = one(&GameSettings::default(), [0.1, 0.0], [0.0; 2]);
    games.set_positions(0, [0.1, 0.0], [0.0; 2], [[0.0, -0.1], [0.0, 0.1]]);
    let mut outcomes = Outcomes::new(1);
    let speeds: Vec<f64> = (0..3)
        .map(|_| {
            games.advance(&[[[1.0, 0.0], [-1.0, 0.0]]], &mut outcomes).unwrap();
            let now = games.snapshot(0);
            // In its own frame the right player moved the other way: on the board the same.
            assert_eq!(now.striker_velocities[0], now.striker_velocities[1]);
            now.striker_velocities[0][0]
        })
        .collect();
    for (found, wanted) in speeds.iter().zip([0.2, 0.4, 0.4]) {
        assert!((found - wanted).abs() < 1e-12, "{speeds:?}");
    }
    assert!((games.snapshot(0).striker_positions[0][0] - 0.02).abs() < 1e-12);
    // In steady state it stops 13.5 mm before the edge of its workspace, for any duration of the
    // command.
    for _ in 0..400 {
        games.advance(&[[[1.0, 0.0], [-1.0, 0.0]]], &mut outcomes).unwrap();
    }
    let x = games.snapshot(0).striker_positions[0][0];
    assert!((x - 0.1465).abs() < 1e-6, "{x}");
}

#[test]
fn randomised_physics_stay_within_the_papers_ranges_and_differ_by_board_and_episode() {
    let settings =
        GameSettings { randomization: Some(Randomization::paper()), ..Default::default() };
    let mut games = Games::new(200, &settings, 5).unwrap();
    let ended = Outcomes { ended: vec![Some(Ending::TimeLimit); 200], ..Outcomes::new(200) };
    let first: Vec<_> = (0..200).map(|board| games.snapshot(board).physics).collect();
    games.restart_ended(&ended).unwrap();
    for (board, before) in first.iter().enumerate() {
        let now = games.snapshot(board);
        assert_eq!(now.episode, 1);
        assert_ne!(now.physics, *before);
        for surface in [now.physics.walls, now.physics.strikers] {
            assert!((0.95..0.99).contains(&surface.restitution));
            assert!((0.3..0.45).contains(&surface.dynamic_friction));
            assert!((0.3..0.5).contains(&surface.static_friction));
        }
        assert!((0.0018..0.0022).contains(&now.physics.ball_mass));
        assert!(now.physics != first[(board + 1) % 200]);
    }
    // A bounce uses the drawn restitution.
    games.set_positions(0, [0.1, 0.0], [1.0, 0.0], ASIDE);
    let before = games.snapshot(0);
    for _ in 0..4 {
        games.advance(&vec![STILL; 200], &mut Outcomes::new(200)).unwrap();
    }
    let speed = -games.snapshot(0).ball_velocity[0];
    // Rolling resistance of 0.01 g takes 8 mm/s in the 80 ms.
    assert!((speed - before.physics.walls.restitution).abs() < 0.01, "{speed}");
}

#[test]
fn without_randomisation_every_board_has_the_settings_physics() {
    let games = Games::new(3, &GameSettings::default(), 1).unwrap();
    let physics = games.snapshot(2).physics;
    assert_eq!(physics.ball_mass, 0.0017);
    assert_eq!((physics.walls.restitution, physics.strikers.restitution), (0.85, 0.75));
    assert!((physics.walls.static_friction - 0.135).abs() < 1e-12);
}

#[test]
fn what_cannot_be_is_refused_with_its_number() {
    let mut settings = GameSettings::default();
    settings.cup.radius = -1.0;
    let error = Games::new(1, &settings, 0).unwrap_err();
    assert_eq!(error.to_string(), "cup.radius_m is -1; it must lie in [0.001, 0.16]");
    for edge in [0.12, f64::NAN] {
        let mut settings = GameSettings::default();
        settings.limits.field.right.x_min_m = edge;
        settings.limits.field.right.x_max_m = 0.1;
        let error = Games::new(1, &settings, 0).unwrap_err();
        assert!(error.to_string().starts_with("limits.field: room on the board across"), "{error}");
    }
    let mut settings = GameSettings::default();
    settings.episode.striker_y = [0.1, 0.05];
    let error = Games::new(1, &settings, 0).unwrap_err();
    assert!(matches!(error, GameError::Range { name: "episode.striker_y_m", .. }), "{error}");
    let mut games = Games::new(2, &GameSettings::default(), 0).unwrap();
    let error = games.step(&[STILL], &mut Outcomes::new(2)).unwrap_err();
    assert_eq!(error.to_string(), "commands has 1 entries, but these games need 2");
    let bad = [STILL, [[0.0; 2], [f32::NAN, 0.0]]];
    let error = games.step(&bad, &mut Outcomes::new(2)).unwrap_err();
    assert!(matches!(error, GameError::Command { environment: 1, player: Player::Right, .. }));
    // The error names the environment, episode and step of a non-finite state.
    games.set_positions(1, [0.0; 2], [f64::NAN, 0.0], ASIDE);
    let error = games.step(&[STILL; 2], &mut Outcomes::new(2)).unwrap_err();
    assert_eq!(error, GameError::NotFinite { environment: 1, episode: 0, step: 0, seed: 0 });
}

#[test]
fn the_ball_of_a_twin_that_no_roll_was_recorded_for_is_that_of_the_game() {
    use crate::twin::{Machine, Source, Twin};
    let mut twin = Twin::nominal(Machine::Table);
    let ball = |twin: &Twin| GameSettings::default().with_twin(twin).ball;
    assert_eq!(ball(&twin), BallSettings::default());
    let of_ball = |twin: &Twin| {
        let all = twin.instances.iter().filter(|own| own.effect.physics.acts_on_ball());
        all.cloned().collect::<Vec<_>>()
    };
    let restitution =
        |own: &&mut crate::twin::Instance| own.effect.name == "impact.wall_restitution";
    twin.instances.iter_mut().find(restitution).unwrap().values[0].source = Source::Fitted;
    assert_eq!(ball(&twin).effects, of_ball(&twin));
}

#[test]
fn a_striker_recoils_on_the_coupling_of_its_twin() {
    use crate::{
        effects::{Axis, find},
        game::StrikerSettings,
        twin::{Instance, Machine, Source, Twin},
    };
    let rigid = Twin::nominal(Machine::Table);
    let striker = |twin: &Twin| GameSettings::default().with_twin(twin).striker;
    assert_eq!(striker(&rigid), StrikerSettings { mass: rigid.striker_mass, ..Default::default() });
    let (stiffness, damping, friction) = (164.0, 0.16, 0.66);
    for (name, numbers) in [
        ("coupling.magnet_spring", [stiffness, damping, 0.012, friction]),
        ("coupling.striker_friction", [friction, stiffness, damping, 0.012]),
    ] {
        let mut twin = rigid.clone();
        let effect = find(name).unwrap();
        twin.instances.push(Instance::new(effect, Axis::Whole, &numbers, Source::Fitted));
        let found = striker(&twin);
        let mass = twin.striker_mass;
        let magnet_frequency = (stiffness / mass).sqrt();
        let want = StrikerSettings { mass, magnet_frequency, magnet_damping: damping, friction };
        assert_eq!(found, want, "{name}");
    }
}

#[test]
fn the_limiter_may_act_behind_a_learned_actuator_but_not_behind_a_twin() {
    use crate::twin::{Machine, Twin};
    let twin = Twin::nominal(Machine::Table);
    let mut settings = GameSettings::default().with_twin(&twin);
    settings.limits.limiter = LimiterPlace::Motion;
    assert_eq!(Games::new(1, &settings, 0).unwrap_err(), GameError::LimiterBehindTwin);
    let axis = GameSettings::default().with_twin(&Twin::nominal(Machine::Axis));
    assert!(matches!(Games::new(1, &axis, 0), Err(GameError::NotATable { .. })));
}
