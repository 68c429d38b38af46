//! Tests of rigs as environments of training.

use super::*;
use crate::{
    game::ObservationKind,
    opponent::{self, Scripted},
    play::{Match, Seat},
    rig::config::{BallConfig, Launch},
};

/// A ball that rolls from the side into the left cup, past the strikers at their home points.
fn into_left_cup() -> RigConfig {
    let start = Launch { x_m: 0.08, y_m: -0.17, vx_m_per_s: -0.3, vy_m_per_s: 0.0 };
    let ball = BallConfig {
        start: Some(start),
        put_back_after_s: 0.5,
        put_back_still_after_s: 1.0,
        ..BallConfig::default()
    };
    RigConfig { ball, ..RigConfig::default() }
}

fn source(rig: RigConfig) -> TrainingRig {
    let game = GameSettings::default();
    TrainingRig::new(rig, Robot::default(), FilterSettings::default(), game, 4).unwrap()
}

/// Step `games` with the commands of `choose` from the exact observations; return the endings of
/// every environment.
fn play(
    games: &mut dyn Environments,
    (boards, steps): (usize, usize),
    choose: impl Fn(Player, &Observation) -> [f32; 2],
) -> Vec<Vec<Ending>> {
    let mut endings = vec![Vec::new(); boards];
    for _ in 0..steps {
        let mut commands: Vec<Commands> = (0..boards)
            .map(|board| Player::BOTH.map(|player| choose(player, &games.exact(board, player))))
            .collect();
        games.advance(&mut commands).unwrap();
        for (own, ended) in endings.iter_mut().zip(&games.outcomes().ended) {
            own.extend(*ended);
        }
        games.begin_ended().unwrap();
    }
    endings
}

#[test]
fn a_ball_in_a_cup_is_a_goal_of_the_other_player_and_the_next_episode_begins_at_the_serve() {
    let mut games = source(into_left_cup()).build(0..2, || 0.0).unwrap();
    let endings = play(games.as_mut(), (2, 150), |_player, _seen| [0.0; 2]);
    for (own, scorer) in endings.iter().zip([Player::Right, Player::Left]) {
        assert!(2 < own.len(), "{endings:?}");
        // The first ball may lie in the cup when the session begins.
        assert!(own[1..].iter().all(|ending| *ending == Ending::Goal { scorer }), "{endings:?}");
    }
    // In the frame of the learner both begin alike; the returned ball is seen within 0.1 s.
    for (board, player) in Player::BOTH.into_iter().enumerate() {
        let Observation(seen) = games.exact(board, player);
        assert!((-0.01..0.081).contains(&seen[8]) && (seen[9] + 0.17).abs() < 0.01, "{seen:?}");
    }
}

#[test]
fn a_striker_over_its_own_cup_is_an_own_goal_once() {
    let mut rig = into_left_cup();
    rig.ball.start = Some(Launch { x_m: 0.12, y_m: -0.02, ..Launch::default() });
    rig.ball.put_back_still_after_s = 100.0;
    let mut games = source(rig).build(0..2, || 0.0).unwrap();
    // The right player goes back until it stands over its cup, and stays.
    let back = |player: Player, seen: &Observation| {
        if player == Player::Left {
            return [0.0; 2];
        }
        let to_cup = [-seen.0[0], -0.17 - seen.0[1]];
        to_cup.map(|way| (4.0 * way).clamp(-0.3, 0.3))
    };
    let endings = play(games.as_mut(), (2, 150), back);
    for own in &endings {
        assert_eq!(*own, [Ending::OwnGoal { loser: Player::Right }], "{endings:?}");
    }
}

#[test]
fn a_ball_at_rest_ends_an_episode_in_the_half_where_it_lies() {
    let mut rig = into_left_cup();
    rig.ball.start = Some(Launch { x_m: 0.12, y_m: -0.05, ..Launch::default() });
    let mut games = source(rig).build(0..2, || 0.0).unwrap();
    let endings = play(games.as_mut(), (2, 150), |_player, _seen| [0.0; 2]);
    for (own, half) in endings.iter().zip(Player::BOTH) {
        assert!(!own.is_empty(), "{endings:?}");
        assert!(own.iter().all(|ending| *ending == Ending::BallAtRest { half }), "{endings:?}");
    }
}

#[test]
fn the_time_limit_ends_an_episode_and_the_players_go_on() {
    let mut game = GameSettings::default();
    game.episode.time_limit = 1.0;
    let mut rig = into_left_cup();
    rig.ball.start = Some(Launch { x_m: 0.12, y_m: -0.02, ..Launch::default() });
    rig.ball.put_back_still_after_s = 100.0;
    let source =
        TrainingRig::new(rig, Robot::default(), FilterSettings::default(), game, 4).unwrap();
    let mut games = source.build(0..1, || 0.0).unwrap();
    let endings = play(games.as_mut(), (1, 100), |_player, _seen| [0.0; 2]);
    assert_eq!(endings, [[Ending::TimeLimit; 2]]);
}

/// True positions of ball and strikers in a match of scripted players until the first goal.
fn path_of_a_match(rig: RigConfig, scripts: [Scripted; 2], steps: usize) -> Vec<[f64; 6]> {
    struct Watched {
        game: Match,
        link: Rc<RefCell<VirtualLink>>,
        path: Vec<[f64; 6]>,
    }
    impl Pilot for Watched {
        fn see(&mut self, shown: Nanos, picture: &CameraDetections) {
            self.game.see(shown, picture);
        }
        fn decide(&mut self, moment: &Moment) -> Decision {
            let truth = self.link.borrow().truth();
            let ball = truth.ball.unwrap();
            let [left, right] = [truth.left.peg, truth.right.peg];
            self.path.push([ball.x, ball.y, left.x, left.y, right.x, right.y]);
            self.game.decide(moment)
        }
    }
    let robot = Robot::default();
    let seats = scripts.map(|script| Some(Seat::Scripted(script)));
    let game = Match::new(seats, &robot, &FilterSettings::default(), 0).unwrap();
    let link = Rc::new(RefCell::new(VirtualLink::new(rig, Speed::Maximum, VIRTUAL_START).unwrap()));
    let mut pilot = Watched { game, link: Rc::clone(&link), path: Vec::new() };
    let config = session_config();
    let presses = AtomicUsize::new(0);
    let output = SessionOutput { writer: None, presses: &presses, show: &mut |_progress| {} };
    let seconds = steps as f64 * CONTROL_PERIOD;
    let stretch = FreeStretch { pilot: &mut pilot, seconds, label: label() };
    let ended =
        run_session(&mut SharedLink(link), &robot, &config, Work::Free(stretch), output).unwrap();
    assert!(ended.is_complete(), "{}", ended.stop_text);
    pilot.path
}

#[test]
fn the_players_see_and_move_as_in_a_match_on_the_same_rig() {
    const STEPS: usize = 120;
    let mut rig = RigConfig { ball: BallConfig::in_a_match(), ..RigConfig::default() };
    rig.ball.start = Some(Launch { y_m: -0.06, ..Launch::default() });
    let source = source(rig);
    let seed = Stream::new(4, "train.rig.0").below(1 << 62) as u64;
    let scripts = [Scripted::Chaser, Scripted::Goalkeeper];
    let wanted = path_of_a_match(source.shared.rig_of(0, seed), scripts, STEPS);

    let mut games = source.build(0..1, || 0.0).unwrap();
    let layout = ObservationLayout { state: ObservationKind::Standard12, commands: 0 };
    let speed = GameSettings::default().limits.speed as f32;
    let mut path = Vec::new();
    for step in 0..STEPS as u64 {
        let Observation(exact) = games.exact(0, Player::Left);
        path.push([8, 9, 0, 1, 4, 5].map(|index| f64::from(exact[index])));
        let commands = Player::BOTH.map(|player| {
            let mut seen = [0.0; 12];
            games.observe(0, player, layout, &mut seen);
            let moment = opponent::Moment { seed: 0, board: player as u64, step };
            scripts[player as usize].velocity(&seen, moment, speed)
        });
        games.advance(&mut [commands]).unwrap();
        assert_eq!(games.outcomes().ended[0], None, "step {step}");
    }
    let shift: f64 = wanted.iter().zip(&wanted[1..]).map(|(a, b)| (a[2] - b[2]).abs()).sum();
    assert!(0.02 < shift, "the chaser hardly moved: {shift} m");
    for (step, (own, wanted)) in path.iter().zip(&wanted).enumerate() {
        for (own, wanted) in own.iter().zip(wanted) {
            // The observation has single precision.
            assert!((own - wanted).abs() < 1e-7, "step {step}: {own} {wanted}");
        }
    }
}

#[test]
fn hits_are_counted_and_equal_seeds_give_equal_games() {
    let mut rig = RigConfig { ball: BallConfig::in_a_match(), ..RigConfig::default() };
    rig.ball.start = Some(Launch { y_m: -0.06, ..Launch::default() });
    let run = || {
        let mut games = source(rig.clone()).build(2..4, || 0.0).unwrap();
        let mut hits = [0; 2];
        let mut last = Vec::new();
        for step in 0..300 {
            let commands = |board| {
                Player::BOTH.map(|player| {
                    let moment = opponent::Moment { seed: 0, board: player as u64, step };
                    Scripted::Chaser.velocity(&games.exact(board, player).0, moment, 0.4)
                })
            };
            let mut commands = [commands(0), commands(1)];
            games.advance(&mut commands).unwrap();
            for (sum, [left, right]) in hits.iter_mut().zip(&games.outcomes().hits) {
                *sum += u32::from(left + right);
            }
            for (hits, speeds) in games.outcomes().hits.iter().zip(&games.outcomes().hit_speeds) {
                for (count, speed) in hits.iter().zip(speeds) {
                    assert_eq!(0 < *count, 0.0 < *speed, "{hits:?} {speeds:?}");
                }
            }
            last = vec![games.exact(0, Player::Left), games.exact(1, Player::Left)];
            games.begin_ended().unwrap();
        }
        (hits, last)
    };
    let (hits, last) = run();
    assert!(hits.iter().all(|count| 1 < *count), "{hits:?}");
    assert_eq!((hits, last), run());
}

#[test]
fn a_rig_that_never_returns_the_ball_or_cannot_start_is_an_error() {
    let mut rig = into_left_cup();
    rig.ball.put_back_after_s = 0.0;
    let game = GameSettings::default();
    let filter = FilterSettings::default();
    let error = TrainingRig::new(rig, Robot::default(), filter, game.clone(), 0).unwrap_err();
    assert!(error.to_string().contains("put_back_after_s of the rig file is 0"), "{error}");
    let mut slow = Robot::default();
    slow.limits.speed_m_per_s = 0.1;
    let error = TrainingRig::new(into_left_cup(), slow, filter, game, 0).unwrap_err();
    assert!(error.to_string().contains("0.1"), "{error}");
    // Without drives of one player the session does not start.
    let mut rig = into_left_cup();
    rig.drives.truncate(2);
    let error = source(rig).build(3..4, || 0.0).unwrap_err();
    assert!(error.to_string().starts_with("the rig of environment 3: "), "{error}");
}
