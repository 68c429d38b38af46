//! The same bytes for the same seed, however the boards are divided.

use super::ball;
use crate::{
    actuator::{ActuatorNetwork, Layout, LayoutKind},
    game::{
        Actuation, BiscuitSettings, EpisodeSettings, GameSettings, Games, ObservationKind,
        Outcomes, Randomization,
    },
    nn::{Dense, Network},
    recording::topic::Player,
    seed::Stream,
    twin::{Machine, Twin},
};
use std::ops::Range;

/// A network of random weights that follows nothing in particular.
pub(super) fn network(layout: Layout, width: usize) -> ActuatorNetwork {
    let sizes = [layout.inputs(), width, width, 2];
    let layers = sizes.windows(2).enumerate().map(|(index, pair)| {
        let mut stream = Stream::numbered(1, "test.network", &[index as u64]);
        // Answers of some 0.1 m/s, so that no carriage is soon at the end of its rail.
        let share = if index == 2 { 0.2 } else { 1.0 };
        let bound = share * (pair[0] as f32).sqrt().recip();
        let mut draw = |count| (0..count).map(|_| stream.uniform_f32(-bound, bound)).collect();
        let weight = draw(pair[0] * pair[1]);
        Dense { inputs: pair[0], outputs: pair[1], weight, bias: draw(pair[1]) }
    });
    let network = Network { activation: layout.kind.activation(), layers: layers.collect() };
    ActuatorNetwork::new(layout, network)
}

/// Commands that depend on board and step alone.
fn command(board: usize, step: usize) -> [[f32; 2]; 2] {
    let mut stream = Stream::numbered(9, "test.commands", &[board as u64, step as u64 / 5]);
    let mut draw = || stream.uniform_f32(-0.5, 0.5);
    [[draw(), draw()], [draw(), draw()]]
}

/// What both players see of the boards `range` after every tenth of `steps`.
fn play(settings: &GameSettings, range: Range<usize>, steps: usize, seed: u64) -> Vec<Vec<u32>> {
    let kind = ObservationKind::Augmented20;
    let mut games = Games::range(range.clone(), settings, seed).unwrap();
    let mut outcomes = Outcomes::new(range.len());
    let mut seen = vec![Vec::new(); range.len()];
    let mut rows = vec![0.0; range.len() * kind.len()];
    for step in 0..steps {
        let commands: Vec<_> = range.clone().map(|board| command(board, step)).collect();
        games.step(&commands, &mut outcomes).unwrap();
        for player in Player::BOTH {
            games.observe(player, kind, &mut rows).unwrap();
            for (seen, row) in seen.iter_mut().zip(rows.chunks_exact(kind.len())) {
                if step % 10 == 9 {
                    seen.extend(row.iter().map(|value| value.to_bits()));
                }
            }
        }
    }
    seen
}

/// Short episodes, so that restarts are among what is compared.
fn settings(actuation: Actuation) -> GameSettings {
    GameSettings {
        actuation,
        episode: EpisodeSettings { time_limit: 0.5, ..EpisodeSettings::default() },
        biscuits: Some(BiscuitSettings::default()),
        randomization: Some(Randomization::paper()),
        ..GameSettings::default()
    }
}

fn check_division(settings: &GameSettings, count: usize, steps: usize) {
    let whole = play(settings, 0..count, steps, 11);
    for cuts in [vec![0, 1, count], vec![0, 37, 64, 70, count]] {
        let parts: Vec<Vec<Vec<u32>>> = std::thread::scope(|scope| {
            let threads: Vec<_> = cuts
                .windows(2)
                .map(|ends| {
                    let range = ends[0]..ends[1];
                    scope.spawn(move || play(settings, range, steps, 11))
                })
                .collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert!(parts.concat() == whole, "divided at {cuts:?} the boards play another game");
    }
    assert!(play(settings, 0..count, steps, 12) != whole, "the seed does not matter");
}

#[test]
fn ideal_boards_play_alike_in_any_division_over_threads() {
    check_division(&settings(Actuation::Ideal), 150, 60);
}

#[test]
fn learned_boards_play_alike_in_any_division_over_threads() {
    let layout = Layout { kind: LayoutKind::Klasktron, history_steps: 10 };
    check_division(&settings(Actuation::learned(network(layout, 16))), 100, 40);
}

#[test]
fn boards_of_a_twin_play_alike_in_any_division_over_threads() {
    let actuation = Actuation::twin(Twin::nominal(Machine::Table));
    check_division(&settings(actuation), 75, 30);
}

#[test]
fn the_next_episode_does_not_depend_on_how_the_last_one_ended() {
    let settings = GameSettings { ball: ball(0.9, 0.1), ..GameSettings::default() };
    let mut games = Games::new(2, &settings, 3).unwrap();
    let mut twice = Games::new(2, &settings, 3).unwrap();
    let ended = |ended| Outcomes { ended, ..Outcomes::new(2) };
    let over = Some(crate::game::Ending::TimeLimit);
    for step in 0..20 {
        let commands = [command(0, step), command(1, step)];
        games.step(&commands, &mut Outcomes::new(2)).unwrap();
    }
    games.restart_ended(&ended(vec![None, over])).unwrap();
    twice.restart_ended(&ended(vec![over, over])).unwrap();
    assert_eq!(games.snapshot(1), twice.snapshot(1));
    assert_eq!((games.snapshot(0).episode, twice.snapshot(0).episode), (0, 1));
}
