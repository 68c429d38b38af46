//! Sessions on the virtual rig: what they record, and what every fault leaves behind.

pub(crate) mod bench;
mod cli;
mod faults;

use bench::{Bench, series};
use klasktron::recording::{
    message::{CarriageState, ControlTick, MotorState, RunMarker, SessionEvent, VelocityCommand},
    topic::{self, Motor, Player},
};

#[test]
fn a_session_records_what_the_contract_lists_and_ends_switched_off() {
    let bench = Bench::new("{}");
    let outcome = bench.run();
    let report = outcome.report.as_ref().unwrap();
    assert_eq!(report.stop, "completed", "{}", report.stop_text);
    assert_eq!((report.runs_done, report.samples), (1, 400));
    assert!(report.not_confirmed_off.is_empty() && report.warnings.is_empty());
    // 11 frames of each of four drives in 100 ms, and 50 Hz x 4 setpoints: 640 frames/s.
    assert!((report.bus.bus_load - 0.284).abs() < 0.01);
    assert_eq!(report.bus.firmware.len(), 4);
    outcome.all_idle();
    let recording = outcome.recording.unwrap();
    for player in Player::BOTH {
        let commands = series::<VelocityCommand>(&recording, &topic::command(player));
        let carriage = series::<CarriageState>(&recording, &topic::carriage(player));
        assert!(400 < commands.len() && 800 < carriage.len());
        // The carriage goes where its commands lead: along +-0.1 m/s, not twice that.
        let [squares, products] = commands.iter().fold([0.0; 2], |[s, p], (time, command)| {
            let later = carriage.partition_point(|(t, _)| t.0 < time.0 + 60_000_000);
            let Some((_, state)) = carriage.get(later) else { return [s, p] };
            [s + command.vx * command.vx, p + command.vx * state.vx]
        });
        let slope = products / squares;
        assert!((slope - 1.0).abs() < 0.1, "{player}: {slope} m/s for each m/s commanded");
        for motor in Motor::BOTH {
            let motors = series::<MotorState>(&recording, &topic::motor(player, motor));
            assert!(800 < motors.len());
        }
    }
    let markers = series::<RunMarker>(&recording, topic::RUN_MARKER);
    assert_eq!(markers.len(), 2);
    assert!((markers[1].0.seconds_since(markers[0].0) - 8.0).abs() < 0.03);
    let ticks = series::<ControlTick>(&recording, topic::CONTROL_TICK);
    assert!(ticks.iter().all(|(_, tick)| tick.lateness_ns == 0 && tick.setpoints_dropped == 0));
    let events = series::<SessionEvent>(&recording, topic::SESSION_EVENT);
    let phases: Vec<&str> = events
        .iter()
        .filter(|(_, event)| event.kind == "phase")
        .map(|(_, event)| event.text.as_str())
        .collect();
    assert_eq!(phases[..2], ["arming", "watchdog test"]);
    assert!(phases[2].starts_with("watchdogs disarmed the drives within"), "{phases:?}");
    assert_eq!(phases[3..], ["arming", "going to the start", "run 1"]);
}

#[test]
fn listening_reports_nodes_rates_errors_and_the_camera() {
    let report = Bench::new("{}").listen(3.0);
    assert_eq!(report.stop, "completed", "{}", report.stop_text);
    assert_eq!((report.frames_sent, report.schema_version), (0, 2));
    assert_eq!(report.traffic.nodes.len(), 4);
    for node in &report.traffic.nodes {
        let rate = |name: &str| {
            let message = node.messages.iter().find(|message| message.message == name).unwrap();
            message.arrivals.rate_hz.unwrap()
        };
        assert!((rate("Heartbeat") - 10.0).abs() < 0.1, "{node}");
        assert!((rate("Get_Encoder_Estimates") - 100.0).abs() < 0.5, "{node}");
        assert_eq!(node.axis_state.as_deref(), Some("IDLE"));
        assert!(!node.has_errors() && node.firmware.is_none(), "nobody asked for the version");
    }
    assert!((report.traffic.camera.rate_hz.unwrap() - 120.0).abs() < 1.0);
    // 440 frames/s of 111 bits at 250 kbit/s.
    assert!((report.bus.bus_load - 0.195).abs() < 0.01, "{}", report.bus.bus_load);
    assert_eq!(report.warnings, Vec::<String>::new());
}

#[test]
fn the_same_session_gives_the_same_bytes() {
    let bytes = || {
        let bench = Bench::new("{}");
        bench.run().report.unwrap();
        std::fs::read(bench.path()).unwrap()
    };
    assert!(bytes() == bytes());
}

#[test]
fn one_gantry_alone_leaves_the_other_alone() {
    let bench = Bench { players: vec![Player::Left], ..Bench::new("{}") };
    let outcome = bench.run();
    assert_eq!(outcome.report.unwrap().stop, "completed");
    let right = outcome.truth.right.carriage;
    assert_eq!([right.vx, right.vy, right.x], [0.0; 3]);
    let recording = outcome.recording.unwrap();
    assert!(series::<VelocityCommand>(&recording, &topic::command(Player::Right)).is_empty());
}

#[test]
fn drives_without_watchdog_are_found_out() {
    // Drives whose watchdog is off keep running when nobody talks to them.
    let rig = r#"{"drive": {"guards": {"watchdog_enabled": false}}}"#;
    let outcome = Bench::new(rig).run();
    let report = outcome.report.as_ref().unwrap();
    assert_eq!(report.stop, "no_watchdog");
    assert!(report.stop_text.contains("axis0.config.enable_watchdog = True"));
    outcome.all_idle();
    outcome.all_still();
}
