//! Arming and disarming in the order of ODrive's documentation, without blocking the loop that
//! feeds the watchdogs.
//!
//! The sequence is `Set_Limits`, `Set_Controller_Mode`, `Set_Input_Vel 0`, `Clear_Errors` once,
//! `Set_Axis_State 8`. During the wait, mode and state are repeated every 200 ms, and zero velocity
//! is sent in every period. The heartbeat is the only acknowledgement.

use super::{
    control::ControlLoop,
    guard::check_presses,
    reason::{Reaction, StopReason},
    station::Station,
    watch::Armed,
};
use crate::{
    can::{AxisErrors, AxisState, ControlMode, InputMode, Message},
    recording::topic::Player,
    units::Nanos,
};

/// Repetition interval of a request that a drive has not answered (s).
const REPEAT_SECONDS: f64 = 0.2;
/// Longest wait of an arming message for a full transmit queue (s).
const PATIENCE_SECONDS: f64 = 0.05;
/// Duration of zero velocity before the motors are disarmed (s).
const HOLD_SECONDS: f64 = 0.1;
/// Ratio of the drives' own speed limit to the largest commanded speed.
const SPEED_HEADROOM: f64 = 1.5;
/// Longest duration of a ramp to zero (s); a longer one counts as not followed.
const LONGEST_RAMP_SECONDS: f64 = 2.0;

/// Policy for the drives' watchdogs, which must stop the drives when this program dies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WatchdogPolicy {
    /// Test before any motion: the drives are armed at zero velocity and receive nothing. Each must
    /// disarm by itself.
    Test,
    /// Trust the operator that the watchdogs are on.
    Trust,
    /// Accept that the watchdogs are off.
    None,
}

/// Arm every drive of the station and wait for their heartbeats.
pub(super) fn arm(station: &mut Station<'_>, control: &mut ControlLoop) -> Result<(), StopReason> {
    station.note_of("phase", None, "arming");
    let started = station.now();
    control.restart(started);
    for index in 0..station.drives.len() {
        prepare(station, index)?;
    }
    let mut asked_at = station.now();
    while !station.drives.iter().all(|drive| drive.armed == Armed::Confirmed) {
        idle_period(station, control)?;
        let waited_s = station.now().seconds_since(started);
        if station.robot.timeouts.arming_s < waited_s {
            return Err(not_armed(station, waited_s));
        }
        if REPEAT_SECONDS <= station.now().seconds_since(asked_at) {
            asked_at = station.now();
            for index in 0..station.drives.len() {
                if station.drives[index].armed == Armed::Asked {
                    send(station, station.drives[index].seat.node, &velocity_mode())?;
                    ask_for_closed_loop(station, index)?;
                }
            }
        }
    }
    Ok(())
}

/// Run one period at zero velocity.
pub(super) fn idle_period(
    station: &mut Station<'_>,
    control: &mut ControlLoop,
) -> Result<(), StopReason> {
    let tick = control.wait(station)?;
    check_presses(station.presses())?;
    for player in station.robot.players() {
        control.command(station, player, [0.0; 2], tick);
    }
    control.finish(station, tick)
}

fn send(station: &mut Station<'_>, node: u8, message: &Message) -> Result<(), StopReason> {
    let give_up = station.now().after_seconds(PATIENCE_SECONDS);
    station
        .send_by(give_up, node, message)
        .map_err(|error| StopReason::LinkBroken { reason: error.to_string() })
}

fn prepare(station: &mut Station<'_>, index: usize) -> Result<(), StopReason> {
    let node = station.drives[index].seat.node;
    let limits = &station.robot.limits;
    let fastest = station.gantry.motors_from_board([limits.speed_m_per_s; 2]).a;
    let limits = Message::SetLimits {
        velocity_turns_per_s: (SPEED_HEADROOM * fastest) as f32,
        current_amps: limits.current_a as f32,
    };
    send(station, node, &limits)?;
    send(station, node, &velocity_mode())?;
    let zero = Message::SetInputVel { velocity_turns_per_s: 0.0, torque_newton_metres: 0.0 };
    send(station, node, &zero)?;
    send(station, node, &Message::ClearErrors { identify: 0 })?;
    station.drives[index].armed = Armed::Asked;
    // An earlier heartbeat does not answer the new request.
    station.drives[index].heartbeat = None;
    ask_for_closed_loop(station, index)
}

fn velocity_mode() -> Message {
    Message::SetControllerMode {
        control_mode: ControlMode::Velocity.number().into(),
        input_mode: InputMode::Passthrough.number().into(),
    }
}

fn ask_for_closed_loop(station: &mut Station<'_>, index: usize) -> Result<(), StopReason> {
    let node = station.drives[index].seat.node;
    let state = AxisState::ClosedLoopControl.number().into();
    send(station, node, &Message::SetAxisState { state })
}

fn not_armed(station: &Station<'_>, waited_s: f64) -> StopReason {
    let waiting = station.drives.iter().find(|drive| drive.armed != Armed::Confirmed);
    let drive = waiting.unwrap_or(&station.drives[0]);
    let (state, errors) = drive.state_and_errors();
    StopReason::NotArmed { seat: drive.seat, state, errors, waited_s }
}

/// Stop sending to the armed drives and wait until each has disarmed by its watchdog; then arm them
/// again. Nothing moves: the last setpoint is zero.
pub(super) fn test_watchdogs(
    station: &mut Station<'_>,
    control: &mut ControlLoop,
) -> Result<(), StopReason> {
    station.note_of("phase", None, "watchdog test");
    let started = station.now();
    for drive in &mut station.drives {
        drive.armed = Armed::Released;
    }
    let heartbeat_s = station.robot.timeouts.heartbeat_s;
    let until = started.after_seconds(station.robot.timeouts.watchdog_s + heartbeat_s);
    let running = |station: &Station<'_>| {
        let disarmed = |drive: &super::watch::DriveWatch| {
            let (state, errors) = drive.state_and_errors();
            state != AxisState::ClosedLoopControl
                && errors.contains(AxisErrors::WATCHDOG_TIMER_EXPIRED)
        };
        station.drives.iter().find(|drive| !disarmed(drive)).map(|drive| drive.seat)
    };
    while let Some(seat) = running(station) {
        if until <= station.now() {
            let waited_s = station.now().seconds_since(started);
            return Err(StopReason::NoWatchdog { seat, waited_s });
        }
        let soon = station.now().after_seconds(control.period_seconds());
        station.wait_until(soon)?;
    }
    let took_s = station.now().seconds_since(started);
    station.note_of("phase", None, &format!("watchdogs disarmed the drives within {took_s:.2} s"));
    arm(station, control)
}

/// Stop all motion as `reaction` demands, disarm the drives and wait for their heartbeats. Return
/// the drives that are not confirmed as disarmed.
pub(super) fn stop(
    station: &mut Station<'_>,
    control: &mut ControlLoop,
    reaction: Reaction,
) -> Vec<u8> {
    if station.drives.iter().all(|drive| drive.armed == Armed::No) {
        return Vec::new();
    }
    let started = station.now();
    let driven_down = match reaction {
        Reaction::EstopAll => false,
        _ => ramp_down(station, control, reaction).is_ok(),
    };
    match reaction {
        // After a failed ramp, no setpoint is trusted.
        _ if !driven_down => station.estop(&Player::BOTH),
        Reaction::BrakeGantry(player) => station.estop(&[player]),
        _ => {}
    }
    switch_off(station);
    confirm_off(station, started)
}

/// Ramp the armed drives to zero and hold zero for a moment.
fn ramp_down(
    station: &mut Station<'_>,
    control: &mut ControlLoop,
    reaction: Reaction,
) -> Result<(), StopReason> {
    let started = station.now();
    control.hurry(started);
    let presses = station.presses();
    let mut still_since = None;
    loop {
        let tick = match control.wait(station) {
            // The other drive of the gantry may follow the first; both are being stopped.
            Err(StopReason::AxisLeft { seat, .. })
                if reaction == Reaction::BrakeGantry(seat.player) =>
            {
                continue;
            }
            result => result?,
        };
        for player in station.robot.players() {
            if reaction == Reaction::Brake || reaction == Reaction::BrakeGantry(player) {
                control.command_unlimited(station, player, [0.0; 2]);
            } else {
                control.command(station, player, [0.0; 2], tick);
            }
        }
        control.finish(station, tick)?;
        if presses.max(1) < station.presses() {
            return Err(StopReason::InterruptedTwice);
        }
        let now = station.now();
        let moving = Player::BOTH.iter().any(|p| control.commanded(*p) != [0.0; 2]);
        if LONGEST_RAMP_SECONDS < now.seconds_since(started) {
            return Ok(());
        }
        if !moving && HOLD_SECONDS < now.seconds_since(*still_since.get_or_insert(now)) {
            return Ok(());
        }
    }
}

fn switch_off(station: &mut Station<'_>) {
    for index in 0..station.drives.len() {
        if station.drives[index].armed != Armed::No {
            let node = station.drives[index].seat.node;
            let state = AxisState::Idle.number().into();
            if send(station, node, &Message::SetAxisState { state }).is_ok() {
                station.drives[index].armed = Armed::No;
            }
        }
    }
    if station.drives.iter().any(|drive| drive.armed != Armed::No) {
        station.estop(&Player::BOTH);
    }
}

/// Wait until every drive has reported, after `started`, that it is not in closed loop.
fn confirm_off(station: &mut Station<'_>, started: Nanos) -> Vec<u8> {
    let until = station.now().after_seconds(2.0 * station.robot.timeouts.heartbeat_s);
    let still_on = |station: &Station<'_>| -> Vec<u8> {
        let off = |drive: &&super::watch::DriveWatch| {
            drive.heartbeat.is_none_or(|heartbeat| {
                heartbeat.at <= started || heartbeat.state == AxisState::ClosedLoopControl
            })
        };
        station.drives.iter().filter(off).map(|drive| drive.seat.node).collect()
    };
    loop {
        let nodes = still_on(station);
        if nodes.is_empty() || until <= station.now() {
            return nodes;
        }
        let soon = station.now().after_seconds(0.01).min(until);
        // Alarms are irrelevant now, and a broken link ends the wait.
        if let Err(StopReason::LinkBroken { .. }) = station.wait_until(soon) {
            return still_on(station);
        }
    }
}
