//! Actuators against plain loops over the same models.

use super::{ASIDE, STILL, determinism::network, long};
use crate::{
    actuator::{Layout, LayoutKind},
    effects::{self, Axis},
    game::{Actuation, GameSettings, Games, LimiterPlace, Outcomes},
    gantry::belts,
    twin::{Instance, Machine, Plant, Source, Twin},
};

/// Commands of the left player that stay far from every wall.
fn wave(step: usize) -> [f64; 2] {
    let t = step as f64 * 0.02;
    [0.2 * (9.0 * t).sin(), 0.15 * (7.0 * t).cos().signum()]
}

/// Settings whose limits do not change [`wave`].
fn unlimited(actuation: Actuation) -> GameSettings {
    let mut settings = long(GameSettings { actuation, ..GameSettings::default() });
    settings.limits.slew = 1e6;
    settings.limits.deceleration_distance = 1e-3;
    settings.limits.clearance = 0.0;
    settings
}

fn single(command: [f64; 2]) -> [f32; 2] {
    command.map(|value| value as f32)
}

#[test]
fn a_learned_actuator_is_the_plain_network_on_its_own_history() {
    for kind in [LayoutKind::Klasktron, LayoutKind::KlaskRl] {
        let layout = Layout { kind, history_steps: 4 };
        let model = network(layout, 8);
        let settings = unlimited(Actuation::learned(model.clone()));
        let mut games = Games::new(70, &settings, 0).unwrap();
        for board in 0..70 {
            games.set_positions(board, [0.14, 0.0], [0.0; 2], [[0.02, -0.1], [-0.02, 0.1]]);
        }
        // Reference: histories of commands and velocities, zero before the start.
        let mut commands = vec![[0.0; 2]; 8];
        let mut velocities = vec![[0.0; 2]; 9];
        let mut place = [0.02, -0.1];
        for step in 0..40 {
            let command = single(wave(step));
            // Both players have equal commands in their own frames, so both get the same answer of
            // the network.
            let mut outcomes = Outcomes::new(70);
            games.advance(&vec![[command, command]; 70], &mut outcomes).unwrap();
            commands.push(command.map(f64::from));
            let mut input = vec![0.0; layout.inputs()];
            layout.fill(&mut input, &commands, &velocities, commands.len() - 1);
            let answer = model.network.forward(&input);
            let next = [f64::from(answer[0]), f64::from(answer[1])];
            let before = *velocities.last().unwrap();
            for axis in 0..2 {
                place[axis] += 0.01 * (before[axis] + next[axis]);
            }
            velocities.push(next);
            for board in [0, 1, 63, 64, 69] {
                let now = games.snapshot(board);
                for (player, sign) in [(0, 1.0), (1, -1.0)] {
                    for axis in 0..2 {
                        let velocity = sign * now.striker_velocities[player][axis];
                        assert!((velocity - next[axis]).abs() < 1e-5, "{step} {board} {player}");
                        let found = sign * now.striker_positions[player][axis];
                        assert!((found - place[axis]).abs() < 1e-6, "{step} {found} {place:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_limiter_behind_a_learned_actuator_holds_its_answer() {
    let layout = Layout { kind: LayoutKind::Klasktron, history_steps: 2 };
    let mut model = network(layout, 8);
    // It moves to the right for any command.
    for layer in &mut model.network.layers {
        layer.weight.fill(0.0);
    }
    model.network.layers[2].bias = vec![0.4, 0.0];
    let mut settings = long(GameSettings {
        actuation: Actuation::learned(crate::actuator::ActuatorNetwork::new(layout, model.network)),
        ..GameSettings::default()
    });
    let mut ends = Vec::new();
    for limiter in [LimiterPlace::Command, LimiterPlace::Motion] {
        settings.limits.limiter = limiter;
        let mut games = Games::new(1, &settings, 0).unwrap();
        games.set_positions(0, [0.0; 2], [0.0; 2], ASIDE);
        for _ in 0..300 {
            games.advance(&[STILL], &mut Outcomes::new(1)).unwrap();
        }
        ends.push(games.snapshot(0).striker_positions[0][0]);
    }
    // With the limiter on the command only the board's edge stops the carriage.
    assert!((ends[0] - 0.1525).abs() < 1e-9 && (ends[1] - 0.1465).abs() < 1e-3, "{ends:?}");
}

/// The twin's carriage under [`wave`] in steps of `dt`, the commands `delay` (s) late.
fn plain_plant(twin: &Twin, start: [f64; 2], steps: usize, delay: f64, dt: f64) -> Vec<[f64; 2]> {
    let plant = Plant::new(twin);
    let mut state = plant.start();
    state.place(start, [0.0; 2]);
    let per_period = (0.02 / dt).round() as usize;
    let mut places = Vec::new();
    for step in 0..steps {
        for small in 0..per_period {
            let sent = (step as f64 * 0.02 + (small as f64 + 0.5) * dt - delay) / 0.02;
            let command = if sent < 0.0 {
                [0.0; 2]
            } else {
                single(wave(sent.floor() as usize)).map(f64::from)
            };
            plant.step(&mut state, belts(command), dt);
        }
        places.push(state.position);
    }
    places
}

#[test]
fn a_twin_in_the_game_is_its_plant_in_fine_steps() {
    let mut twin = Twin::nominal(Machine::Table);
    let delay = 0.033;
    let effect = effects::find("drive.delay").unwrap();
    twin.instances.push(Instance::new(effect, Axis::Motors, &[delay], Source::Nominal));
    let start = [0.02, -0.1];
    let fine = plain_plant(&twin, start, 60, delay, 1e-4);
    for (step, bound) in [(1e-3, 1e-4), (2e-3, 2e-4), (5e-3, 6e-4)] {
        let settings = unlimited(Actuation::Twin { twin: Box::new(twin.clone()), step });
        let mut games = Games::new(2, &settings, 0).unwrap();
        for board in 0..2 {
            games.set_positions(board, [0.14, 0.0], [0.0; 2], [start, start.map(|v| -v)]);
        }
        let mut worst = 0.0_f64;
        for (index, want) in fine.iter().enumerate() {
            let command = single(wave(index));
            games.advance(&[[command, command]; 2], &mut Outcomes::new(2)).unwrap();
            let now = games.snapshot(1).striker_positions;
            for axis in 0..2 {
                worst = worst.max((now[0][axis] - want[axis]).abs());
                assert_eq!(now[0][axis], -now[1][axis]);
            }
        }
        assert!(worst < bound, "steps of {step} s: {worst} m off");
    }
}

#[test]
fn a_magnet_spring_of_the_twin_makes_the_striker_lag_by_mass_times_acceleration_over_stiffness() {
    let mut twin = Twin::nominal(Machine::Table);
    let effect = effects::find("coupling.magnet_spring").unwrap();
    let values = [30.0, 0.7, 1.0, 0.0];
    twin.instances.push(Instance::new(effect, Axis::Whole, &values, Source::Nominal));
    let mut games = Games::new(1, &unlimited(Actuation::twin(twin)), 0).unwrap();
    games.set_positions(0, [0.14, 0.0], [0.0; 2], [[-0.1, -0.1], ASIDE[1]]);
    let mut most = 0.0_f64;
    for _ in 0..30 {
        games.advance(&[[[0.4, 0.0], [0.0; 2]]], &mut Outcomes::new(1)).unwrap();
        let carriage = games.strikers_of(0)[0].carriage[0];
        most = most.max(carriage - games.snapshot(0).striker_positions[0][0]);
    }
    // The slew limit of the nominal drive is 15 m/s^2 for 27 ms: up to m a / k = 6 mm, less while
    // the spring still stretches.
    assert!((0.5e-3..6.5e-3).contains(&most), "{most}");
}

#[test]
fn a_twin_carriage_stops_at_the_end_of_its_rails() {
    let mut settings = unlimited(Actuation::twin(Twin::nominal(Machine::Table)));
    settings.limits.deceleration_distance = 1e-3;
    let mut games = Games::new(1, &settings, 0).unwrap();
    games.set_positions(0, [0.0; 2], [0.0; 2], ASIDE);
    for _ in 0..100 {
        games.advance(&[[[-0.4, 0.0], [0.0; 2]]], &mut Outcomes::new(1)).unwrap();
        assert!(-0.1525 - 1e-12 <= games.snapshot(0).striker_positions[0][0]);
    }
    for _ in 0..50 {
        games.advance(&[[[0.4, 0.0], [0.0; 2]]], &mut Outcomes::new(1)).unwrap();
    }
    assert!(0.1 < games.snapshot(0).striker_positions[0][0], "it comes back");
}

#[test]
fn nothing_decays_to_denormal_numbers() {
    // A lag whose output halves every few milliseconds would be denormal after some seconds at
    // rest.
    let mut twin = Twin::nominal(Machine::Table);
    let effect = effects::find("drive.lag1").unwrap();
    twin.instances.push(Instance::new(effect, Axis::Motors, effect.probes[0], Source::Nominal));
    let effect = effects::find("coupling.magnet_spring").unwrap();
    twin.instances.push(Instance::new(effect, Axis::Whole, effect.probes[0], Source::Nominal));
    let mut games = Games::new(1, &long(GameSettings::default().with_twin(&twin)), 0).unwrap();
    games.set_positions(0, [0.05, -0.06], [0.3, 0.2], [[0.05, -0.1], ASIDE[1]]);
    let mut outcomes = Outcomes::new(1);
    for _ in 0..50 {
        games.advance(&[[[0.1, 0.4], [0.3, 0.3]]], &mut outcomes).unwrap();
    }
    for second in 0..40 {
        for _ in 0..50 {
            games.advance(&[STILL], &mut outcomes).unwrap();
        }
        // The debug text contains all numbers of all parts, private ones too.
        let text = format!("{games:?}");
        let numbers = text.split(|c: char| !(c.is_ascii_alphanumeric() || "+-.".contains(c)));
        let denormal = numbers
            .filter_map(|word| word.parse::<f64>().ok())
            .find(|number| number.is_subnormal());
        assert_eq!(denormal, None, "after {second} s");
    }
}
