//! Starts of episodes.

use crate::{
    board::{BALL_RADIUS, CUP_RADIUS, STRIKER_RADIUS},
    game::{Ending, EpisodeSettings, GameSettings, Games, Outcomes},
    recording::topic::Player,
};

const BOARDS: usize = 4000;

fn games(change: impl Fn(&mut EpisodeSettings)) -> Games {
    let mut settings = GameSettings::default();
    change(&mut settings.episode);
    Games::new(BOARDS, &settings, 3).unwrap()
}

fn share(chosen: impl Fn(usize) -> bool) -> f64 {
    (0..BOARDS).filter(|board| chosen(*board)).count() as f64 / BOARDS as f64
}

#[test]
fn a_serve_into_one_half_is_as_frequent_as_set() {
    for (fraction, expected) in [(0.0, 0.5), (0.4, 0.7), (1.0, 1.0), (-1.0, 0.0)] {
        let games = games(|episode| episode.served_fraction = fraction);
        let own = share(|board| {
            let into_left = games.snapshot(board).ball_position[1] < 0.0;
            into_left == board.is_multiple_of(2)
        });
        // Standard deviation of 4000 draws: at most 0.008.
        assert!((own - expected).abs() < 0.03, "{fraction}: {own}");
    }
}

#[test]
fn balls_move_and_strikers_are_aligned_as_often_as_set() {
    let games = games(|episode| (episode.moving_fraction, episode.aligned_fraction) = (0.3, 0.5));
    let speed = |board| {
        let [x, y] = games.snapshot(board).ball_velocity;
        f64::hypot(x, y)
    };
    assert!((share(|board| 0.0 < speed(board)) - 0.3).abs() < 0.03);
    assert!((0..BOARDS).all(|board| speed(board) <= 1.0));
    // Lateral distance of the striker of the ball's half from the line through ball and other cup.
    let cup = games.settings().cup.distance;
    let aligned = |board| {
        let state = games.snapshot(board);
        let [x, y] = state.ball_position;
        let [own_x, own_y] = state.striker_positions[usize::from(0.0 < y)];
        let way = [-x, -cup.copysign(y) - y];
        let (from, size) = ([own_x - x, own_y - y], way[0].hypot(way[1]));
        let across = (from[0] * way[1] - from[1] * way[0]) / size;
        let behind = -(from[0] * way[0] + from[1] * way[1]) / size;
        across.abs() < 0.0101 && (0.015..0.0801).contains(&behind)
    };
    let found = share(aligned);
    // A few more are aligned by chance, a few fewer because of the cup.
    assert!((0.4..0.6).contains(&found), "{found}");
    let over_cup = |board: usize| {
        let [left, right] = games.snapshot(board).striker_positions;
        left[0].hypot(left[1] + cup).min(right[0].hypot(right[1] - cup)) < CUP_RADIUS
    };
    assert_eq!(share(over_cup), 0.0);
}

#[test]
fn players_go_on_after_goals_and_time_limits_as_often_as_set_and_the_ball_is_clear_of_them() {
    let goal = Ending::Goal { scorer: Player::Left };
    let own_goal = Ending::OwnGoal { loser: Player::Left };
    for (ending, fraction, expected) in [
        (goal, 1.0, 1.0),
        (goal, 0.3, 0.3),
        (Ending::TimeLimit, 0.3, 0.3),
        (goal, 0.0, 0.0),
        (own_goal, 1.0, 0.0),
    ] {
        let mut games = games(|episode| {
            (episode.continued_fraction, episode.served_fraction) = (fraction, 1.0);
        });
        let before: Vec<_> = (0..BOARDS).map(|board| games.snapshot(board)).collect();
        let mut outcomes = Outcomes::new(BOARDS);
        outcomes.ended.fill(Some(ending));
        games.restart_ended(&outcomes).unwrap();
        let stays = |board: usize| {
            games.snapshot(board).striker_positions == before[board].striker_positions
        };
        assert!((share(stays) - expected).abs() < 0.03, "{ending:?} {fraction}: {}", share(stays));
        for (board, before) in before.iter().enumerate() {
            let now = games.snapshot(board);
            assert_eq!((now.episode, now.step), (before.episode + 1, 0));
            assert_eq!(now.ball_position[1] < 0.0, board.is_multiple_of(2), "the serve");
            assert_eq!(stays(board), games.is_continued(board, ending));
            for [x, y] in now.striker_positions {
                let [ball_x, ball_y] = now.ball_position;
                assert!(BALL_RADIUS + STRIKER_RADIUS < f64::hypot(ball_x - x, ball_y - y));
            }
        }
    }
}
