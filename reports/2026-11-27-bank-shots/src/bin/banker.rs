//! Goals per minute of a scripted player like the chaser that aims at the cup, or at its image in the farther side wall
//! and the end wall.

use klasktron::{
    game::{Ending, GameSettings, Games, ObservationKind, Outcomes},
    opponent::{Moment, Scripted},
    recording::topic::Player,
};

const BOARDS: usize = 1000;
const STEPS: u64 = 3000;
const PERIOD_S: f64 = 0.02;
const SPEED: f32 = 0.4;
const GAIN: f32 = 10.0;
const RUN_UP: f32 = 0.03;
const CLEARANCE: f32 = 0.01905 + 2.0 * 0.0075;
const OWN_CUP: [f32; 2] = [0.0, -0.17];
const OTHER_CUP: [f32; 2] = [0.0, 0.17];
/// Image of the other cup in a side wall and the end wall: 2 (0.16 - 0.007), 2 (0.21 - 0.007) - 0.17.
const IMAGE: [f32; 2] = [0.306, 0.236];

#[derive(Clone, Copy)]
enum Aim {
    Direct,
    Bank,
}

fn main() {
    println!("opponent,aim,tolerance_m,goals_per_min,conceded_per_min,hits_per_min");
    for opponent in [Scripted::Stationary, Scripted::Goalkeeper, Scripted::Chaser] {
        for (aim, tolerance) in
            [(Aim::Direct, 1.5e-3), (Aim::Bank, 3e-3), (Aim::Bank, 1.5e-3), (Aim::Bank, 8e-4)]
        {
            play(opponent, aim, tolerance);
        }
    }
}

fn play(opponent: Scripted, aim: Aim, tolerance: f32) {
    let mut settings = GameSettings::default();
    settings.episode.time_limit = 30.0;
    let width = ObservationKind::Standard12.len();
    let mut games = Games::new(BOARDS, &settings, 1).unwrap();
    let mut outcomes = Outcomes::new(BOARDS);
    let mut seen = [vec![0.0; BOARDS * width], vec![0.0; BOARDS * width]];
    let mut commands = vec![[[0.0; 2]; 2]; BOARDS];
    let (mut won, mut lost, mut hits) = (0, 0, 0_u64);
    for step in 0..STEPS {
        for player in Player::BOTH {
            let rows = &mut seen[player as usize];
            games.observe(player, ObservationKind::Standard12, rows).unwrap();
        }
        for (board, command) in commands.iter_mut().enumerate() {
            let row = |player: usize| &seen[player][board * width..(board + 1) * width];
            command[0] = shoot(row(0), aim, tolerance);
            let moment = Moment { seed: 0, board: board as u64, step };
            command[1] = opponent.velocity(row(1), moment, SPEED);
        }
        games.step(&commands, &mut outcomes).unwrap();
        hits += outcomes.hits.iter().map(|own| u64::from(own[0])).sum::<u64>();
        for ending in outcomes.ended.iter().flatten() {
            match ending {
                Ending::Goal { scorer: Player::Left } => won += 1,
                Ending::Goal { .. } => lost += 1,
                _ => {}
            }
        }
    }
    let minutes = BOARDS as f64 * STEPS as f64 * PERIOD_S / 60.0;
    let name = match aim {
        Aim::Direct => "direct",
        Aim::Bank => "side and end wall",
    };
    let per_min = |count: f64| count / minutes;
    println!(
        "{opponent},{name},{tolerance},{:.2},{:.2},{:.1}",
        per_min(f64::from(won)),
        per_min(f64::from(lost)),
        per_min(hits as f64)
    );
}

fn shoot(seen: &[f32], aim: Aim, tolerance: f32) -> [f32; 2] {
    let (own, ball, velocity) = ([seen[0], seen[1]], [seen[8], seen[9]], [seen[10], seen[11]]);
    if -0.025 < ball[1] {
        return towards(along(OWN_CUP, ball, 0.08), own);
    }
    let target = match aim {
        Aim::Direct => OTHER_CUP,
        Aim::Bank => [IMAGE[0].copysign(ball[0] - own[0]), IMAGE[1]],
    };
    let time = (length(minus(ball, own)) / SPEED).min(0.2);
    let ball = [ball[0] + time * velocity[0], ball[1] + time * velocity[1]];
    let hit = unit(minus(target, ball));
    let across = [hit[1], -hit[0]];
    let from_ball = minus(own, ball);
    let (behind, beside) = (-dot(from_ball, hit), dot(from_ball, across));
    if 0.0 < behind && beside.abs() < tolerance {
        let room = (-0.0335 - own[1]).clamp(0.0, 0.09) / 0.09;
        let most = hit[0].abs().max(hit[1].abs());
        let forwards = (room / hit[1].max(1e-3)).min(1.0 / most) * SPEED;
        return [0, 1]
            .map(|k| (forwards * hit[k] - GAIN * beside * across[k]).clamp(-SPEED, SPEED));
    }
    let mut place = [ball[0] - RUN_UP * hit[0], ball[1] - RUN_UP * hit[1]];
    if behind < 0.0 {
        let side = RUN_UP.copysign(beside);
        place = [place[0] + side * across[0], place[1] + side * across[1]];
    }
    if length(minus(place, OWN_CUP)) < CLEARANCE {
        place = along(OWN_CUP, own, CLEARANCE);
    }
    towards(place, own)
}

fn towards(place: [f32; 2], own: [f32; 2]) -> [f32; 2] {
    let is_near_cup = length(minus(own, OWN_CUP)) < CLEARANCE;
    let place = if is_near_cup { along(OWN_CUP, own, 2.0 * CLEARANCE) } else { place };
    minus(place, own).map(|distance| (GAIN * distance).clamp(-SPEED, SPEED))
}

fn along(start: [f32; 2], end: [f32; 2], distance: f32) -> [f32; 2] {
    let [x, y] = unit(minus(end, start));
    [start[0] + distance * x, start[1] + distance * y]
}

fn minus(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(a: [f32; 2]) -> f32 {
    dot(a, a).sqrt()
}

fn unit(a: [f32; 2]) -> [f32; 2] {
    let size = length(a).max(1e-9);
    a.map(|part| part / size)
}
