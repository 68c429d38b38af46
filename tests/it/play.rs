//! Matches on the virtual rig: what they record, what stops them, what is refused. The rig's physics is its own
//! (`tests/it/architecture.rs`), so nothing here is judged by the code that made it.

mod bench;
mod program;
mod safety;

use crate::collect::bench::{START, series};
use bench::{Bench, of_scripts};
use klasktron::{
    opponent::Scripted,
    recording::{
        message::{BoardState, ObjectState, RunMarker, VelocityCommand},
        topic::{self, Player},
    },
    rig::{RigConfig, config::BallConfig},
    stats::quantile,
    units::Nanos,
};
use std::collections::BTreeMap;

#[test]
fn a_match_is_recorded_with_what_the_players_took_the_board_to_be() {
    let bench = Bench::new("{}", 6.0);
    let mut game = of_scripts([Some(Scripted::Goalkeeper), Some(Scripted::Chaser)]);
    let outcome = bench.run(&mut game);
    let report = outcome.report.as_ref().unwrap();
    assert_eq!(report.stop, "completed", "{}", report.stop_text);
    assert_eq!((report.runs_done, report.samples), (1, 300));
    // Pictures arrive 25 ms after they were taken, 8 ms apart.
    let waited = report.image_to_command.unwrap();
    let latency = 1e3 * RigConfig::default().camera.latency_s;
    assert!(latency <= waited.median_ms && waited.p99_ms < latency + 15.0, "{waited:?}");
    outcome.all_idle();
    let recording = outcome.recording.unwrap();
    let markers = series::<RunMarker>(&recording, topic::RUN_MARKER);
    let [(start, first), (end, _)] = &markers[..] else { panic!("{markers:?}") };
    assert_eq!((first.pattern.as_str(), first.split.as_str()), ("match", ""));
    assert!((end.seconds_since(*start) - 6.0).abs() < 0.03);
    let states = series::<BoardState>(&recording, topic::BOARD_STATE);
    assert_eq!(states.len(), 300);
    assert!(states.iter().all(|(_, state)| state.ball.is_some() && state.left.is_some()));
}

type Part = fn(&BoardState) -> Option<ObjectState>;

/// The camera is 25 ms late, in which a striker at 0.4 m/s moves 10 mm: estimates are moved ahead of pictures.
#[test]
fn what_players_see_is_where_things_are_now() {
    let rig = RigConfig { ball: BallConfig::in_a_match(), ..RigConfig::default() };
    let bench = Bench { rig, ..Bench::new("{}", 20.0) };
    let outcome = bench.run(&mut of_scripts([Some(Scripted::Random), Some(Scripted::Chaser)]));
    assert_eq!(outcome.report.unwrap().stop, "completed");
    let recording = outcome.recording.unwrap();
    let believed = series::<BoardState>(&recording, topic::BOARD_STATE);
    let real: BTreeMap<Nanos, BoardState> =
        series::<BoardState>(&recording, topic::TRUE_BOARD_STATE).into_iter().collect();
    // 120 times a second for pictures, 50 times for decisions.
    assert!(160 * 20 < real.len() && believed.len() == 1000);
    for (name, object, most) in [
        ("ball", (|state| state.ball) as Part, 0.002),
        ("left", |state| state.left, 0.007),
        ("right", |state| state.right, 0.007),
    ] {
        let errors: Vec<f64> = believed
            .iter()
            .filter_map(|(time, believed)| {
                let (a, b) = (object(believed)?, object(&real[time])?);
                Some((a.x - b.x).hypot(a.y - b.y))
            })
            .collect();
        assert!(900 < errors.len(), "{name} is seen {} times", errors.len());
        // A ball that is put back is elsewhere until it is seen there.
        let [middle, high] = [0.5, 0.9].map(|share| quantile(&errors, share).unwrap());
        println!("{name}: {:.2} mm off (median), {:.2} mm (90 %)", 1e3 * middle, 1e3 * high);
        assert!(high < most, "{name}: {high} m");
    }
}

#[test]
fn an_empty_seat_leaves_its_gantry_alone() {
    let bench = Bench { players: vec![Player::Left], ..Bench::new("{}", 3.0) };
    let outcome = bench.run(&mut of_scripts([Some(Scripted::Random), None]));
    assert_eq!(outcome.report.as_ref().unwrap().stop, "completed");
    let right = outcome.truth.right.carriage;
    assert_eq!([right.vx, right.vy, right.x], [0.0; 3]);
    let recording = outcome.recording.unwrap();
    let commands = |player| series::<VelocityCommand>(&recording, &topic::command(player));
    assert!(commands(Player::Right).is_empty());
    assert!(commands(Player::Left).iter().any(|(_, command)| 0.1 < command.vx.abs()));
}
