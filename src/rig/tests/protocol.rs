//! Tests of the drives' behaviour on the bus.

use super::support::Host;
use crate::{
    can::{AxisState, BROADCAST_NODE, Command, Frame, FrameKind, IdWidth, Message, Payload},
    link::Link,
};

fn data_frame(id: u32, data: &[u8]) -> Frame {
    Frame { id, width: IdWidth::Standard, kind: FrameKind::Data, data: Payload::new(data).unwrap() }
}

fn states(host: &Host) -> Vec<u8> {
    host.link.truth().drives.iter().map(|drive| drive.state.number()).collect()
}

#[test]
fn arming_takes_ten_milliseconds_and_shows_in_the_heartbeat() {
    let text = r#"{"bus": {"bitrate": 1000000}, "drive": {"cyclic_ms": {"heartbeat": 1}}}"#;
    let mut host = Host::from_json(text);
    host.wait(0.05);
    assert_eq!(host.heartbeat(1), (1, 0, 0));
    host.send(1, Message::SetAxisState { state: 8 });
    host.wait(0.008);
    assert_eq!(host.heartbeat(1), (1, 0, 1), "busy while arming");
    host.wait(0.006);
    assert_eq!(host.heartbeat(1), (8, 0, 0));
    assert_eq!(states(&host), [1, 8, 1, 1]);
    host.send(1, Message::SetAxisState { state: 1 });
    host.wait(0.005);
    assert_eq!(host.heartbeat(1), (1, 0, 0));
}

#[test]
fn the_watchdog_bites_when_only_requests_arrive() {
    let mut host = Host::from_json("{}");
    host.arm();
    host.drive([0.1, 0.0], 0.5);
    assert_eq!(states(&host), [8; 4]);
    for _ in 0..17 {
        for node in 0..4 {
            host.send(node, Message::Request(Command::EncoderEstimates));
            host.send(node, Message::ClearErrors { identify: 0 });
        }
        host.wait(0.01);
    }
    assert_eq!(states(&host), [8; 4], "0.19 s after the last setpoint");
    host.wait(0.2);
    for node in 0..4 {
        assert_eq!(host.heartbeat(node), (1, 0x100_0000, 3));
    }
    // Armed again only after Clear_Errors.
    host.send(0, Message::SetAxisState { state: 8 });
    host.wait(0.15);
    assert_eq!(host.heartbeat(0), (1, 0x100_0000, 3));
    host.send(0, Message::ClearErrors { identify: 0 });
    host.send(0, Message::SetAxisState { state: 8 });
    host.wait(0.1);
    assert_eq!(states(&host)[0], 8);
}

#[test]
fn without_watchdog_the_last_setpoint_stays_in_force() {
    let mut host = Host::from_json(r#"{"drive": {"guards": {"watchdog_enabled": false}}}"#);
    host.arm();
    host.drive([0.1, 0.0], 0.1);
    host.wait(0.5);
    assert_eq!(states(&host), [8; 4]);
    assert!((host.link.truth().right.carriage.vx - 0.1).abs() < 0.01);
}

#[test]
fn estop_disarms_and_is_remembered_until_cleared() {
    for node in [1, BROADCAST_NODE] {
        let mut host = Host::from_json("{}");
        host.arm();
        host.drive([0.2, 0.0], 0.2);
        host.send(node, Message::Estop);
        host.wait(0.15);
        let stopped: Vec<bool> = states(&host).iter().map(|state| *state == 1).collect();
        let wanted = if node == 1 { [false, true, false, false] } else { [true; 4] };
        assert_eq!(stopped, wanted);
        assert_eq!(host.heartbeat(1), (1, 0x200_0000, 3));
        // Without current only friction brakes.
        let truth = host.link.truth();
        assert_eq!(truth.drives[1].torque_newton_metres, 0.0);
        host.send(1, Message::SetAxisState { state: 8 });
        host.wait(0.02);
        assert_eq!(states(&host)[1], 1);
        host.send(1, Message::ClearErrors { identify: 0 });
        host.send(1, Message::SetAxisState { state: 8 });
        host.wait(0.02);
        assert_eq!(states(&host)[1], 8);
    }
}

#[test]
fn a_disarmed_motor_coasts_until_friction_has_stopped_it() {
    let mut host = Host::from_json("{}");
    host.arm();
    host.drive([0.4, 0.0], 0.2);
    host.send(BROADCAST_NODE, Message::Estop);
    host.wait(0.05);
    let coasting = host.link.truth().right.carriage.vx;
    assert!((0.25..0.4).contains(&coasting), "{coasting}");
    host.wait(2.0);
    assert!(host.link.truth().right.carriage.speed() < 1e-3);
}

#[test]
fn requests_are_answered_unless_they_carry_eight_bytes() {
    let mut host = Host::from_json("{}");
    let count = |host: &Host, command: Command| {
        let of = |m: &Message| m.command() == command;
        host.messages.iter().filter(|(_, d)| d.node == 2 && of(&d.message)).count()
    };
    host.send(2, Message::Request(Command::Version));
    host.wait(0.01);
    assert_eq!(
        host.last(2, |m| if let Message::Version(bytes) = m { Some(*bytes) } else { None }),
        Some([2, 5, 2, 0, 0, 6, 11, 0])
    );
    host.link.send(&data_frame(2 << 5 | 0x17, &[])).unwrap();
    host.wait(0.01);
    assert_eq!(count(&host, Command::BusVoltageCurrent), 1);
    host.link.send(&data_frame(2 << 5 | 0x17, &[0; 8])).unwrap();
    host.wait(0.01);
    assert_eq!(count(&host, Command::BusVoltageCurrent), 1);
    for command in [Command::Iq, Command::Error, Command::Torques, Command::Temperature] {
        host.send(2, Message::Request(command));
        host.wait(0.01);
        assert_eq!(count(&host, command), 1, "{command:?}");
    }
    // Discovery: a remote frame to all, answered with the serial numbers.
    host.send(BROADCAST_NODE, Message::Request(Command::Address));
    host.wait(0.01);
    let serial =
        |m: &Message| if let Message::Address { serial, .. } = m { Some(*serial) } else { None };
    for node in 0..4 {
        assert_eq!(host.last(node, serial), Some(0x3957_0000_0000 + u64::from(node)));
    }
}

#[test]
fn short_frames_are_understood() {
    let mut host = Host::from_json("{}");
    host.link.send(&data_frame(3 << 5 | 0x18, &[1])).unwrap();
    host.link.send(&data_frame(3 << 5 | 0x07, &[8, 0, 0, 0])).unwrap();
    host.wait(0.02);
    assert_eq!(states(&host)[3], 8);
    host.link.send(&data_frame(3 << 5 | 0x02, &[])).unwrap();
    host.wait(0.01);
    assert_eq!(states(&host)[3], 1);
}

#[test]
fn modes_take_effect_at_the_next_arming() {
    let torque = Message::SetControllerMode { control_mode: 1, input_mode: 1 };
    let push = Message::SetInputTorque { torque_newton_metres: 0.05 };
    let mut host = Host::from_json("{}");
    host.arm();
    host.send(0, torque);
    host.send(0, push);
    host.wait(0.05);
    // Still velocity control: the torque is only a feed-forward that the loop counteracts.
    assert!(host.link.truth().drives[0].velocity_turns_per_s.abs() < 0.5);
    host.send(0, Message::SetAxisState { state: 1 });
    host.wait(0.01);
    host.send(0, Message::SetAxisState { state: 8 });
    host.wait(0.02);
    host.send(0, push);
    host.wait(0.1);
    let truth = host.link.truth().drives[0];
    assert!((truth.torque_newton_metres - 0.05).abs() < 1e-6, "{truth:?}");
    assert!(0.5 < truth.velocity_turns_per_s);
    // Modes that are not simulated cannot be armed.
    host.send(1, Message::SetAxisState { state: 1 });
    host.send(1, Message::SetControllerMode { control_mode: 3, input_mode: 5 });
    host.send(1, Message::SetAxisState { state: 8 });
    host.wait(0.15);
    assert_eq!((host.heartbeat(1).0, host.heartbeat(1).2), (1, 13));
}

#[test]
fn vel_ramp_ramps() {
    let mut host = Host::from_json(r#"{"drive": {"ramp_turns_per_s2": 20.0}}"#);
    for node in 0..2 {
        host.send(node, Message::SetControllerMode { control_mode: 2, input_mode: 2 });
        host.send(node, Message::SetAxisState { state: 8 });
    }
    host.wait(0.02);
    for _ in 0..10 {
        host.velocity(0, 8.0);
        host.velocity(1, 8.0);
        host.wait(0.02);
    }
    let speed = host.link.truth().drives[0].velocity_turns_per_s;
    assert!((3.0..4.2).contains(&speed), "{speed} turn/s after 0.2 s of 20 turn/s^2");
}

#[test]
fn limits_hold_and_overspeed_disarms() {
    let limits =
        |speed: f32| Message::SetLimits { velocity_turns_per_s: speed, current_amps: 15.0 };
    let mut host = Host::from_json("{}");
    host.arm();
    for node in 0..2 {
        host.send(node, limits(2.0));
    }
    host.drive([0.3, 0.0], 0.2);
    let speed = host.link.truth().drives[0].velocity_turns_per_s;
    assert!((speed - 2.0).abs() < 0.2, "{speed}");
    host.drive([0.0; 2], 0.2);
    for node in 0..2 {
        host.send(node, limits(20.0));
    }
    host.drive([0.3, 0.0], 0.15);
    host.send(0, limits(1.0));
    host.wait(0.15);
    assert_eq!(host.heartbeat(0), (1, 0x8000, 3));
    // The current limit bounds the torque.
    let mut host = Host::from_json("{}");
    host.arm();
    host.send(0, Message::SetLimits { velocity_turns_per_s: 40.0, current_amps: 1.0 });
    let most = host
        .drive([0.3, 0.3], 0.1)
        .iter()
        .map(|(_, truth)| truth.drives[0].torque_newton_metres)
        .fold(0.0, f64::max);
    assert!((most - 0.0827).abs() < 1e-3, "{most}");
}

#[test]
fn nan_inputs_feed_the_watchdog_and_change_nothing() {
    let mut host = Host::from_json("{}");
    host.arm();
    host.drive([0.05, 0.0], 0.1);
    for _ in 0..20 {
        for node in 0..4 {
            host.velocity(node, f64::NAN);
        }
        host.wait(0.02);
    }
    assert_eq!(states(&host), [8; 4]);
    assert!((host.link.truth().right.carriage.vx - 0.05).abs() < 0.01);
}

#[test]
fn position_control_goes_where_it_is_told() {
    let mut host = Host::from_json("{}");
    for node in 0..2 {
        host.send(node, Message::SetAbsolutePosition { position_turns: 5.0 });
        host.send(node, Message::SetControllerMode { control_mode: 3, input_mode: 1 });
        host.send(
            node,
            Message::SetInputPos { position_turns: 5.0, velocity_counts: 0, torque_counts: 0 },
        );
        host.send(node, Message::SetAxisState { state: 8 });
    }
    host.wait(0.02);
    for _ in 0..50 {
        for node in 0..2 {
            host.send(
                node,
                Message::SetInputPos { position_turns: 6.0, velocity_counts: 0, torque_counts: 0 },
            );
        }
        host.wait(0.02);
    }
    let x = host.link.truth().right.carriage.x;
    assert!((x - 0.04).abs() < 1e-3, "{x}");
}

#[test]
fn firmware_0_5_is_silent_about_its_version_and_beats_otherwise() {
    let mut host = Host::from_json(r#"{"drive": {"firmware": [0, 5, 6]}}"#);
    host.send(0, Message::Request(Command::Version));
    host.wait(0.2);
    let version = |m: &Message| matches!(m, Message::Version(_)).then_some(());
    assert_eq!(host.last(0, version), None);
    assert_eq!(host.heartbeat(0), (1, 0, 0));
    // Any frame to its node feeds the watchdog of 0.5.x.
    host.arm();
    for _ in 0..30 {
        host.send(0, Message::Request(Command::EncoderEstimates));
        host.wait(0.02);
    }
    assert_eq!(host.link.truth().drives[0].state, AxisState::ClosedLoopControl);
    assert_eq!(host.heartbeat(1).0, 1);
    assert_eq!(host.heartbeat(1).1, 0x100_0000);
}

#[test]
fn cyclic_messages_come_at_their_periods() {
    let text = r#"{"bus": {"bitrate": 1000000}, "drive": {"cyclic_ms":
        {"heartbeat": 100, "encoder": 10, "iq": 20, "error": 500, "temperature": 1000,
         "bus_voltage": 250, "torques": 10, "powers": 50}}}"#;
    let mut host = Host::from_json(text);
    host.wait(4.0);
    for (command, wanted) in [
        (Command::Heartbeat, 40),
        (Command::EncoderEstimates, 400),
        (Command::Iq, 200),
        (Command::Error, 8),
        (Command::Temperature, 4),
        (Command::BusVoltageCurrent, 16),
        (Command::Torques, 400),
        (Command::Powers, 80),
    ] {
        for node in 0..4 {
            let of = |d: &crate::can::Decoded| d.node == node && d.message.command() == command;
            let count = host.messages.iter().filter(|(_, d)| of(d)).count();
            assert!(count.abs_diff(wanted) <= 1, "{command:?}: {count} instead of {wanted}");
        }
    }
}
