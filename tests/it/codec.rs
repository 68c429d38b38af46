//! The codec against cantools and the DBC of PyPI's odrive-can: both directions of every message.
//!
//! The frames come from `scripts/make_dbc_frames.py`; without `KLASKTRON_DBC_FRAMES` the test says that
//! it was skipped. Known frames and round trips are tested in `can::codec` itself.

use klasktron::can::{Command, Frame, FrameKind, IdWidth, Message, Payload, decode, encode};
use serde::Deserialize;
use std::collections::BTreeSet;

#[derive(Debug, Deserialize)]
struct Entry {
    node: u8,
    name: String,
    id: u32,
    data: Vec<u8>,
    /// Physical values in the order of their bits.
    values: Vec<f64>,
}

fn little_endian(value: &Payload) -> f64 {
    let mut bytes = [0; 4];
    bytes[..value.as_slice().len()].copy_from_slice(value.as_slice());
    u32::from_le_bytes(bytes).into()
}

/// The fields of a message in the order of their bits, as physical values.
fn values(message: &Message) -> Vec<f64> {
    let f = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect();
    let u = |values: &[u32]| values.iter().map(|v| f64::from(*v)).collect();
    match *message {
        Message::Request(_) | Message::Estop | Message::EnterDfuMode => vec![],
        Message::Version(bytes) => bytes.iter().map(|b| f64::from(*b)).collect(),
        Message::Heartbeat { axis_error, axis_state, procedure_result, trajectory } => {
            u(&[axis_error, axis_state.into(), procedure_result.into(), trajectory as u32])
        }
        Message::Error { active_errors, disarm_reason } => u(&[active_errors, disarm_reason]),
        Message::RxSdo { opcode, endpoint, value } => {
            vec![opcode.into(), endpoint.into(), little_endian(&value)]
        }
        Message::TxSdo { endpoint, value } => vec![endpoint.into(), little_endian(&value)],
        Message::Address { node, serial, .. } => vec![node.into(), serial as f64],
        Message::SetAxisState { state } => u(&[state]),
        Message::EncoderEstimates { position_turns: a, velocity_turns_per_s: b }
        | Message::SetInputVel { velocity_turns_per_s: a, torque_newton_metres: b }
        | Message::SetLimits { velocity_turns_per_s: a, current_amps: b }
        | Message::SetTrajAccelLimits { acceleration: a, deceleration: b }
        | Message::Iq { setpoint_amps: a, measured_amps: b }
        | Message::Temperature { fet_celsius: a, motor_celsius: b }
        | Message::BusVoltageCurrent { voltage_volts: a, current_amps: b }
        | Message::SetVelGains { gain: a, integrator_gain: b }
        | Message::Torques { target_newton_metres: a, estimate_newton_metres: b }
        | Message::Powers { electrical_watts: a, mechanical_watts: b } => f(&[a, b]),
        Message::SetControllerMode { control_mode, input_mode } => u(&[control_mode, input_mode]),
        Message::SetInputPos { position_turns, .. } => {
            let [velocity, torque] = message.feed_forward().unwrap();
            vec![position_turns.into(), velocity, torque]
        }
        Message::SetInputTorque { torque_newton_metres: a }
        | Message::SetTrajVelLimit { velocity_turns_per_s: a }
        | Message::SetTrajInertia { inertia: a }
        | Message::SetAbsolutePosition { position_turns: a }
        | Message::SetPosGain { gain: a } => f(&[a]),
        Message::Reboot { action: byte } | Message::ClearErrors { identify: byte } => {
            vec![byte.into()]
        }
    }
}

#[test]
fn codec_agrees_with_cantools_and_the_dbc() {
    let Ok(path) = std::env::var("KLASKTRON_DBC_FRAMES") else {
        println!("skipped: KLASKTRON_DBC_FRAMES is not set; see scripts/make_dbc_frames.py");
        return;
    };
    let entries: Vec<Entry> = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let mut names = BTreeSet::new();
    for entry in &entries {
        let data = Payload::new(&entry.data).unwrap();
        let frame = Frame { id: entry.id, width: IdWidth::Standard, kind: FrameKind::Data, data };
        let decoded = decode(&frame).unwrap();
        assert_eq!(decoded.node, entry.node, "{entry:?}");
        assert_eq!(decoded.message.command().name(), entry.name);
        let found = values(&decoded.message);
        assert_eq!(found.len(), entry.values.len(), "{entry:?}");
        for (ours, theirs) in found.iter().zip(&entry.values) {
            assert!((ours - theirs).abs() <= 1e-9 * theirs.abs().max(1.0), "{ours}: {entry:?}");
        }
        assert_eq!(encode(entry.node, &decoded.message), frame, "{entry:?}");
        names.insert(entry.name.clone());
    }
    // Every message of our table is in the DBC, and the other way round.
    let ours: BTreeSet<String> = Command::ALL.iter().map(|c| c.name().to_owned()).collect();
    assert_eq!(names, ours);
}
