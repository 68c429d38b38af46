//! The same bytes for the same seed, for any division of the environments.

use super::ball;
use crate::{
    actuator::{ActuatorNetwork, Layout, LayoutKind},
    effects::{self, Axis},
    game::{
        Actuation, BiscuitSettings, EpisodeSettings, GameSettings, Games, ObservationKind,
        Outcomes, Randomization,
    },
    nn::{Dense, Network},
    recording::topic::Player,
    seed::Stream,
    twin::{Instance, Machine, Source, Twin},
};
use std::ops::Range;

/// A network of random weights.
pub(super) fn network(layout: Layout, width: usize) -> ActuatorNetwork {
    let sizes = [layout.inputs(), width, width, 2];
    let layers = sizes.windows(2).enumerate().map(|(index, pair)| {
        let mut stream = Stream::numbered(1, "test.network", &[index as u64]);
        // Outputs of some 0.1 m/s, so that no carriage soon reaches the end of its travel.
        let share = if index == 2 { 0.2 } else { 1.0 };
        let bound = share * (pair[0] as f32).sqrt().recip();
        let mut draw = |count| (0..count).map(|_| stream.uniform_f32(-bound, bound)).collect();
        let weight = draw(pair[0] * pair[1]);
        Dense { inputs: pair[0], outputs: pair[1], weight, bias: draw(pair[1]) }
    });
    let network = Network { activation: layout.kind.activation(), layers: layers.collect() };
    ActuatorNetwork::new(layout, network)
}

/// Commands that depend only on environment and step.
fn command(board: usize, step: usize) -> [[f32; 2]; 2] {
    let mut stream = Stream::numbered(9, "test.commands", &[board as u64, step as u64 / 5]);
    let mut draw = || stream.uniform_f32(-0.5, 0.5);
    [[draw(), draw()], [draw(), draw()]]
}

/// Observations of both players in the environments `range` after every tenth of `steps`.
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

/// Short episodes, so that the comparison includes restarts.
fn settings(actuation: Actuation) -> GameSettings {
    GameSettings {
        actuation,
        episode: EpisodeSettings { time_limit: 0.5, ..EpisodeSettings::default() },
        biscuits: Some(BiscuitSettings::default()),
        randomization: Some(Randomization::paper()),
        ..GameSettings::default()
    }
}

/// Twin with effects on command, motors and striker.
fn twin() -> Twin {
    let mut twin = Twin::nominal(Machine::Table);
    let effects = [
        ("drive.delay", Axis::Motors),
        ("drive.ripple.motor", Axis::Motors),
        ("coupling.magnet_spring", Axis::Whole),
    ];
    for (name, axis) in effects {
        let effect = effects::find(name).unwrap();
        twin.instances.push(Instance::new(effect, axis, effect.probes[0], Source::Nominal));
    }
    twin
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
    for twin in [Twin::nominal(Machine::Table), twin()] {
        check_division(&settings(Actuation::twin(twin)), 75, 30);
    }
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

#[test]
fn restored_boards_go_on_as_the_saved_ones() {
    let layout = Layout { kind: LayoutKind::KlaskRl, history_steps: 10 };
    let twin = twin();
    let actuations =
        [Actuation::Ideal, Actuation::learned(network(layout, 8)), Actuation::twin(twin)];
    let mut lengths = Vec::new();
    for actuation in actuations {
        let settings = settings(actuation);
        let mut games = Games::range(5..75, &settings, 2).unwrap();
        let play = |games: &mut Games, steps: Range<usize>| {
            for step in steps {
                let commands: Vec<_> = (0..70).map(|board| command(board, step)).collect();
                games.step(&commands, &mut Outcomes::new(70)).unwrap();
            }
        };
        play(&mut games, 0..33);
        let saved = games.save();
        let mut again = Games::range(5..75, &settings, 2).unwrap();
        again.restore(&saved).unwrap();
        assert_eq!(again.save(), saved);
        play(&mut games, 33..70);
        play(&mut again, 33..70);
        assert!((0..70).all(|board| again.snapshot(board) == games.snapshot(board)));
        assert_eq!(again.save(), games.save());
        lengths.push(saved.len());
        let error = again.restore(&saved[8..]).unwrap_err();
        assert!(error.to_string().starts_with("the saved state (in bytes) has"), "{error}");
    }
    assert!(lengths[0] < lengths[1] && lengths[0] < lengths[2], "memories are part of the state");
}
