//! Fraction of shots that score, by aim and by angle beside it. The ball lies anywhere in the left half and leaves at a given
//! speed; the right player has had 0.8 s to get ready.

use klasktron::{
    game::{Ending, GameSettings, Games, ObservationKind, Outcomes},
    opponent::{Moment, Scripted},
    recording::topic::Player,
    seed::Stream,
};

const POSITIONS: usize = 128;
const OFFSETS_DEG: [f64; 17] = [
    -12.0, -10.5, -9.0, -7.5, -6.0, -4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0,
];
/// Half sides of the board less the radius of the ball (m).
const HALF: [f64; 2] = [0.153, 0.203];
const CUP: f64 = 0.17;
const READY: u64 = 40;
const STEPS: u64 = 300;

/// Aims in the left player's frame; the sign of x is drawn for each position.
const AIMS: [(&str, [f64; 2]); 4] = [
    ("direct", [0.0, CUP]),
    ("side wall", [2.0 * HALF[0], CUP]),
    ("side and end wall", [2.0 * HALF[0], 2.0 * HALF[1] - CUP]),
    ("end wall", [0.0, 2.0 * HALF[1] - CUP]),
];

fn main() {
    println!("opponent,speed_m_per_s,aim,offset_deg,scored_fraction");
    for opponent in [Scripted::Goalkeeper, Scripted::Stationary] {
        for speed in [0.5, 0.7, 0.9] {
            for (name, aim) in AIMS {
                let scored = scored(opponent, speed, aim);
                for (offset, fraction) in OFFSETS_DEG.iter().zip(scored) {
                    println!("{opponent},{speed},{name},{offset},{fraction:.3}");
                }
            }
        }
    }
}

/// Fraction of the shots that score, for each offset.
fn scored(opponent: Scripted, speed: f64, [aim_x, aim_y]: [f64; 2]) -> Vec<f64> {
    let mut stream = Stream::new(0, "shots");
    let mut draw =
        |low: f64, high: f64| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
    let mut shots = Vec::new();
    for _ in 0..POSITIONS {
        let ball = [draw(-0.15, 0.15), draw(-0.13, -0.03)];
        let side = draw(-1.0, 1.0).signum();
        for offset in OFFSETS_DEG {
            let angle =
                (aim_y - ball[1]).atan2(side * aim_x - ball[0]) + side * offset.to_radians();
            shots.push((ball, [speed * angle.cos(), speed * angle.sin()]));
        }
    }
    let count = shots.len();
    let width = ObservationKind::Standard12.len();
    let mut games = Games::new(count, &GameSettings::default(), 1).unwrap();
    let mut outcomes = Outcomes::new(count);
    let mut seen = vec![0.0; count * width];
    let mut commands = vec![[[0.0; 2]; 2]; count];
    let (mut is_over, mut has_scored) = (vec![false; count], vec![false; count]);
    let aside = |ball: [f64; 2]| [-0.14_f64.copysign(ball[0]), -0.15];
    for (board, (ball, _)) in shots.iter().enumerate() {
        games.set_positions(board, *ball, [0.0; 2], [aside(*ball), [0.0, 0.13]]);
    }
    for step in 0..STEPS {
        games.observe(Player::Right, ObservationKind::Standard12, &mut seen).unwrap();
        for (board, row) in seen.chunks_exact(width).enumerate() {
            let moment = Moment { seed: 0, board: board as u64, step };
            commands[board][1] = opponent.velocity(row, moment, 0.4);
        }
        if step == READY {
            for (board, (ball, velocity)) in shots.iter().enumerate() {
                let keeper = games.snapshot(board).striker_positions[1];
                games.set_positions(board, *ball, *velocity, [aside(*ball), keeper]);
            }
        }
        games.step(&commands, &mut outcomes).unwrap();
        for (board, ending) in outcomes.ended.iter().enumerate() {
            let Some(ending) = ending.filter(|_| READY <= step && !is_over[board]) else {
                continue;
            };
            is_over[board] = true;
            has_scored[board] = ending == Ending::Goal { scorer: Player::Left };
        }
    }
    (0..OFFSETS_DEG.len())
        .map(|offset| {
            let own = has_scored.iter().skip(offset).step_by(OFFSETS_DEG.len());
            own.filter(|scored| **scored).count() as f64 / POSITIONS as f64
        })
        .collect()
}
