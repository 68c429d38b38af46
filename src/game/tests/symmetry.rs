//! Turned and mirrored games.

use super::{ASIDE, long};
use crate::{
    game::{BiscuitSettings, GameSettings, Games, ObservationKind, Outcomes, Snapshot},
    recording::topic::Player,
    seed::Stream,
};

/// Random commands, each constant for a few steps.
struct Commands {
    stream: Stream,
    current: [[f32; 2]; 2],
    step: usize,
}

impl Commands {
    fn next(&mut self) -> [[f32; 2]; 2] {
        if self.step.is_multiple_of(7) {
            let mut draw = || self.stream.uniform_f32(-0.6, 0.6);
            self.current = [[draw(), draw()], [draw(), draw()]];
        }
        self.step += 1;
        self.current
    }
}

/// Play a game and its image under `turn` and compare them exactly. `seats` maps the strikers and
/// `command` the commands.
fn compare(
    settings: &GameSettings,
    turn: impl Fn([f64; 2]) -> [f64; 2],
    seats: [usize; 2],
    command: impl Fn([[f32; 2]; 2]) -> [[f32; 2]; 2],
) {
    let image = |now: &Snapshot| {
        let both = |pair: [[f64; 2]; 2]| {
            let turned = pair.map(&turn);
            seats.map(|seat| turned[seat])
        };
        (
            turn(now.ball_position),
            turn(now.ball_velocity),
            both(now.striker_positions),
            both(now.striker_velocities),
        )
    };
    let of = |now: &Snapshot| {
        (now.ball_position, now.ball_velocity, now.striker_positions, now.striker_velocities)
    };
    let mut hits = [0_u32; 2];
    for game in 0..80 {
        let (mut one, mut other) =
            (Games::new(1, settings, 0).unwrap(), Games::new(1, settings, 0).unwrap());
        let mut stream = Stream::numbered(3, "test.start", &[game]);
        let mut draw = |half: f32| f64::from(stream.uniform_f32(-half, half));
        let (ball, velocity) = ([draw(0.15), draw(0.07)], [draw(1.0), draw(1.0)]);
        let strikers = [[draw(0.1), -0.09], [draw(0.1), 0.11]];
        one.set_positions(0, ball, velocity, strikers);
        let start = image(&one.snapshot(0));
        other.set_positions(0, start.0, start.1, start.2);
        let stream = Stream::numbered(3, "test.commands", &[game]);
        let mut commands = Commands { stream, current: [[0.0; 2]; 2], step: 0 };
        let (mut a, mut b) = (Outcomes::new(1), Outcomes::new(1));
        for step in 0..400 {
            let now = commands.next();
            one.advance(&[now], &mut a).unwrap();
            other.advance(&[command(now)], &mut b).unwrap();
            let (found, wanted) = (of(&other.snapshot(0)), image(&one.snapshot(0)));
            assert_eq!(found, wanted, "game {game}, step {step}");
            hits = [0, 1].map(|k| hits[k] + u32::from(a.hits[0][k]));
            assert_eq!(a.ended[0].is_some(), b.ended[0].is_some());
            if a.ended[0].is_some() {
                break;
            }
        }
    }
    assert!(hits.iter().all(|hits| 10 < *hits), "too little happens: {hits:?}");
}

fn settings() -> GameSettings {
    long(GameSettings { biscuits: Some(BiscuitSettings::default()), ..GameSettings::default() })
}

#[test]
fn a_board_turned_by_180_degrees_plays_the_same_game_with_the_players_swapped() {
    let turn = |[x, y]: [f64; 2]| [-x, -y];
    compare(&GameSettings { biscuits: None, ..settings() }, turn, [1, 0], |[a, b]| [b, a]);
}

#[test]
fn a_mirrored_board_plays_the_mirrored_game() {
    let mirrored = |[x, y]: [f32; 2]| [-x, y];
    compare(&settings(), |[x, y]| [-x, y], [0, 1], |both| both.map(mirrored));
}

#[test]
fn the_right_player_sees_what_the_left_one_sees_on_the_turned_board() {
    let mut games = Games::new(2, &GameSettings::default(), 0).unwrap();
    games.set_positions(0, [0.03, 0.05], [0.4, -0.7], [[0.01, -0.1], [-0.06, 0.12]]);
    games.set_positions(1, [-0.03, -0.05], [-0.4, 0.7], [[0.06, -0.12], [-0.01, 0.1]]);
    for kind in ObservationKind::ALL {
        let (mut left, mut right) = (vec![0.0; 2 * kind.len()], vec![0.0; 2 * kind.len()]);
        games.observe(Player::Left, kind, &mut left).unwrap();
        games.observe(Player::Right, kind, &mut right).unwrap();
        assert_eq!(left[..kind.len()], right[kind.len()..]);
        assert_eq!(right[..kind.len()], left[kind.len()..]);
        assert_ne!(left[..kind.len()], right[..kind.len()]);
    }
    games.set_positions(0, [0.0; 2], [0.0; 2], ASIDE);
    let mut row = vec![0.0; 24];
    games.observe(Player::Left, ObservationKind::Standard12, &mut row).unwrap();
    assert_eq!(row[..6], [-0.14, -0.19, 0.0, 0.0, 0.14, 0.19]);
}
