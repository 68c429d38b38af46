//! Goals per minute of scripted players against one another.

use klasktron::{
    game::{Ending, GameSettings, Games, ObservationKind, Outcomes},
    opponent::{Moment, Scripted},
    recording::topic::Player,
};

const BOARDS: usize = 1000;
const STEPS: u64 = 3000;
const PERIOD_S: f64 = 0.02;
const SPEED: f32 = 0.4;

fn main() {
    println!("player,opponent,goals_per_min,conceded_per_min,hits_per_min");
    for player in [Scripted::Chaser, Scripted::Shooter] {
        for opponent in [Scripted::Stationary, Scripted::Goalkeeper, Scripted::Chaser] {
            play(player, opponent);
        }
    }
}

fn play(player: Scripted, opponent: Scripted) {
    let mut settings = GameSettings::default();
    settings.episode.time_limit = 30.0;
    let width = ObservationKind::Standard12.len();
    let mut games = Games::new(BOARDS, &settings, 1).unwrap();
    let mut outcomes = Outcomes::new(BOARDS);
    let mut seen = [vec![0.0; BOARDS * width], vec![0.0; BOARDS * width]];
    let mut commands = vec![[[0.0; 2]; 2]; BOARDS];
    let (mut won, mut lost, mut hits) = (0, 0, 0_u64);
    for step in 0..STEPS {
        for seat in Player::BOTH {
            let rows = &mut seen[seat as usize];
            games.observe(seat, ObservationKind::Standard12, rows).unwrap();
        }
        for (board, command) in commands.iter_mut().enumerate() {
            let row = |seat: usize| &seen[seat][board * width..(board + 1) * width];
            let moment = Moment { seed: 0, board: board as u64, step };
            command[0] = player.velocity(row(0), moment, SPEED);
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
    println!(
        "{player},{opponent},{:.2},{:.2},{:.1}",
        f64::from(won) / minutes,
        f64::from(lost) / minutes,
        hits as f64 / minutes
    );
}
