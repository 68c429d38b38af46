//! `klasktron train`: it learns, repeats itself, resumes, and says what is wrong.

mod program;
pub(crate) mod support;

use klasktron::{
    board::{BALL_RADIUS, STRIKER_RADIUS},
    game::GameSettings,
    opponent::Scripted,
    train::{
        Choice, Curriculum, Machine, Opponent, OpponentMode, RewardSettings, Run, StartSettings,
        TrainSettings, play_samples,
    },
};
use std::num::NonZeroUsize;
use support::tiny;

fn machine(threads: usize) -> Machine {
    Machine { threads: NonZeroUsize::new(threads).unwrap(), clock: || 0.0 }
}

fn trained(settings: &TrainSettings, threads: usize) -> Run {
    let mut run = Run::new(settings, &GameSettings::default(), machine(threads)).unwrap();
    while !run.is_done() {
        run.update().unwrap();
    }
    run
}

/// Mean distance (m) beyond touching between the policy's striker and a ball in its own half, over games
/// against a player that stands.
fn distance_to_ball(run: &Run) -> f64 {
    let players = [
        Opponent::Policy(Box::new(run.policy()), Choice::Mean),
        Opponent::Scripted(Scripted::Stationary),
    ];
    let of = (run.game(), run.settings().layout());
    let games = play_samples(of, &players, (12, 77)).unwrap();
    let mut distances = Vec::new();
    for game in &games {
        let player = game.seat as usize;
        let side = [-1.0, 1.0][player];
        for moment in &game.moments {
            let [x, y] = moment.board.ball_position;
            let [own_x, own_y] = moment.board.striker_positions[player];
            if 0.02 < side * y {
                let between = (own_x - x).hypot(own_y - y);
                distances.push(between - BALL_RADIUS - STRIKER_RADIUS);
            }
        }
    }
    assert!(100 < distances.len());
    distances.iter().sum::<f64>() / distances.len() as f64
}

/// Paid for closeness to the ball, a policy goes to the ball.
#[test]
fn a_policy_learns_what_it_is_paid_for() {
    let mut settings = tiny();
    settings.opponents.mode = OpponentMode::Scripted(Scripted::Stationary);
    settings.opponents.scripted_fraction = 0.0;
    settings.anneal_transitions = None;
    settings.starts = StartSettings::default();
    settings.action_history = 0;
    settings.sensors = None;
    settings.reward = RewardSettings { proximity: 1.0, ..RewardSettings::of(Curriculum::Sparse) };
    settings.environments = 64;
    settings.ppo.horizon = 32;
    settings.ppo.minibatch = 256;
    settings.ppo.learning_rate = 3e-3;
    settings.ppo.entropy_coef = 0.0;
    settings.checkpoint_updates = 16;
    settings.steps = 140 * settings.transitions_per_update();
    let before =
        Run::new(&settings, &GameSettings::default(), machine(1)).map(|run| distance_to_ball(&run));
    let (before, after) = (before.unwrap(), distance_to_ball(&trained(&settings, 2)));
    assert!(after < 0.5 * before, "{before} m, then {after} m");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let settings = tiny();
    let [one, two, five] = [1, 2, 5].map(|threads| trained(&settings, threads));
    assert_eq!(one.curve().len(), 6);
    for other in [two, five] {
        assert_eq!(one.curve(), other.curve());
        assert_eq!(one.policy().network(), other.policy().network());
        assert_eq!(one.policy().standardizer(), other.policy().standardizer());
    }
    let other_seed = trained(&TrainSettings { seed: 8, ..settings }, 2);
    assert_ne!(one.policy().network(), other_seed.policy().network());
}
