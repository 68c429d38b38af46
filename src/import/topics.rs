//! Conversion of the topics of a KlaskTron bag into the topics of the contract.

use super::{
    bag::{Bag, BagTopic},
    bus::BusDecoder,
    cdr::{CdrError, Value},
    drives::{MagnetTrack, push_carriages, push_motor},
    known::Decoder,
    report::{Notice, SkipReason},
    rosmsg::short_name,
    tape::{Outgoing, Tape},
};
use crate::{
    board::{BoardSize, Frame},
    can,
    gantry::{CoreXy, DriveHealth, MotorSeat},
    recording::{
        message::{BoardState, MotorState, ObjectState, VelocityCommand},
        topic::{self, Player},
    },
    units::{NANOS_PER_SECOND, Nanos},
};
use std::collections::BTreeMap;

/// Conversion of a topic.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Route {
    Command(Player),
    CheckedCommand(Player),
    BoardState,
    ControllerStatus(MotorSeat),
    DriveStatus(MotorSeat),
    ControlMessage,
    Magnet(Player),
    CanFrames,
}

/// Return the conversion for a topic of this name and type; `None` when the contract has no
/// counterpart.
fn route(topic: &str, type_name: &str) -> Option<Route> {
    let player_of = |word: &str| match word {
        "left_player" => Some(Player::Left),
        "right_player" => Some(Player::Right),
        _ => None,
    };
    let parts: Vec<&str> = topic.trim_start_matches('/').split('/').collect();
    match (parts.as_slice(), short_name(type_name).as_str()) {
        (["cmd_vel", word], "geometry_msgs/Twist" | "geometry_msgs/TwistStamped") => {
            match word.strip_suffix("_checked") {
                Some(checked) => player_of(checked).map(Route::CheckedCommand),
                None => player_of(word).map(Route::Command),
            }
        }
        (["board_state"], "klask_interfaces/State") => Some(Route::BoardState),
        ([axis, "controller_status"], "odrive_can/ControllerStatus") => {
            seat_of(axis).map(Route::ControllerStatus)
        }
        ([axis, "odrive_status"], "odrive_can/ODriveStatus") => {
            seat_of(axis).map(Route::DriveStatus)
        }
        ([axis, "control_message"], _) => seat_of(axis).map(|_seat| Route::ControlMessage),
        ([name], "std_msgs/Float32MultiArray") => {
            player_of(name.strip_suffix("_magnet_position")?).map(Route::Magnet)
        }
        (_, "can_msgs/Frame") => Some(Route::CanFrames),
        _ => None,
    }
}

fn seat_of(axis: &str) -> Option<MotorSeat> {
    MotorSeat::of_node(axis.strip_prefix("odrive_axis")?.parse().ok()?)
}

/// Return whether the messages of a topic must be read.
pub(super) fn is_wanted(topic: &str, type_name: &str) -> bool {
    !matches!(route(topic, type_name), None | Some(Route::ControlMessage))
}

/// Add the content of a bag to the tape.
pub(super) fn map_bag(bag: Bag, tape: &mut Tape, board: BoardSize, gantry: CoreXy) {
    tape.notices.extend(bag.notices);
    let mut mapping = Mapping {
        tape,
        board,
        magnets: MagnetTrack::default(),
        bus: BusDecoder::default(),
        health: BTreeMap::new(),
    };
    let checked: Vec<Player> = bag
        .topics
        .iter()
        .filter(|topic| !topic.messages.is_empty())
        .filter_map(|topic| match route(&topic.name, &topic.type_name) {
            Some(Route::CheckedCommand(player)) => Some(player),
            _ => None,
        })
        .collect();
    for topic in &bag.topics {
        mapping.topic(topic, &checked);
    }
    mapping.finish(gantry);
}

/// Health message of a drive, before the messages of its two topics are merged.
#[derive(Debug, Clone, Copy)]
enum Health {
    State { axis_state: u32, errors: u32 },
    Status { supply: [f64; 2], temperatures: [f64; 2], errors: u32, disarm_reason: u32 },
}

struct Mapping<'a> {
    tape: &'a mut Tape,
    board: BoardSize,
    magnets: MagnetTrack,
    bus: BusDecoder,
    /// Health messages by node.
    health: BTreeMap<u8, Vec<(Nanos, Health)>>,
}

impl Mapping<'_> {
    fn topic(&mut self, topic: &BagTopic, checked: &[Player]) {
        let skipped = |why| Notice::Skipped {
            topic: topic.name.clone(),
            type_name: topic.type_name.clone(),
            messages: topic.count,
            why,
        };
        let Some(route) = route(&topic.name, &topic.type_name) else {
            self.tape.notices.push(skipped(SkipReason::NotInContract));
            return;
        };
        match route {
            Route::ControlMessage => self.tape.notices.push(skipped(SkipReason::Redundant)),
            Route::Command(player) if checked.contains(&player) => {
                self.tape.notices.push(skipped(SkipReason::Superseded));
            }
            _ => {
                if let Route::Magnet(_) = route {
                    self.tape.notices.push(skipped(SkipReason::UsedForOrigin));
                }
                self.messages(topic, route);
            }
        }
    }

    fn messages(&mut self, topic: &BagTopic, route: Route) {
        let decoder = match decoder_of(topic) {
            Ok(decoder) => decoder,
            Err(reason) => {
                self.tape.notices.push(Notice::NoDefinition {
                    topic: topic.name.clone(),
                    type_name: topic.type_name.clone(),
                    messages: topic.count,
                    reason,
                });
                return;
            }
        };
        let mut bad = 0;
        let mut first_bad = None;
        for (index, (time, bytes)) in topic.messages.iter().enumerate() {
            let mapped = decoder.read(bytes).and_then(|value| self.message(route, *time, &value));
            if let Err(error) = mapped {
                bad += 1;
                first_bad.get_or_insert((index, error));
            }
        }
        if let Some((first, error)) = first_bad {
            self.tape.notices.push(Notice::Undecodable {
                topic: topic.name.clone(),
                messages: bad,
                first,
                reason: error.to_string(),
            });
        }
    }

    fn message(&mut self, route: Route, time: Nanos, value: &Value) -> Result<(), CdrError> {
        match route {
            Route::Command(player) | Route::CheckedCommand(player) => {
                self.command(player, time, value)
            }
            Route::BoardState => self.board_state(time, value),
            Route::ControllerStatus(seat) => self.controller_status(seat, time, value),
            Route::DriveStatus(seat) => self.drive_status(seat, time, value),
            Route::Magnet(player) => self.magnet(player, time, value),
            Route::CanFrames => self.can_frame(time, value),
            Route::ControlMessage => Ok(()),
        }
    }

    fn command(&mut self, player: Player, time: Nanos, value: &Value) -> Result<(), CdrError> {
        let twist = value.at("twist").unwrap_or(value);
        let image = [finite(twist, "linear.x")?, finite(twist, "linear.y")?];
        let [vx, vy] = Frame::Image.velocity_in_board(image);
        let command = Outgoing::Command(VelocityCommand { vx, vy });
        let times = [time, stamp_of(value).unwrap_or(time)];
        self.tape.push_published(&topic::command(player), times, command);
        Ok(())
    }

    fn board_state(&mut self, time: Nanos, value: &Value) -> Result<(), CdrError> {
        let state = BoardState {
            ball: Some(self.object(value, "ball")?),
            left: Some(self.object(value, "left_peg")?),
            right: Some(self.object(value, "right_peg")?),
            status: value.unsigned("status.data").or_else(|_bare| value.unsigned("status"))?,
        };
        let times = [time, stamp_of(value).unwrap_or(time)];
        self.tape.push_published(topic::BOARD_STATE, times, Outgoing::Board(Box::new(state)));
        Ok(())
    }

    fn object(&self, value: &Value, name: &str) -> Result<ObjectState, CdrError> {
        let object = value.at(name)?;
        let position = [finite(object, "position.x")?, finite(object, "position.y")?];
        let velocity = [finite(object, "velocity.x")?, finite(object, "velocity.y")?];
        let [x, y] = Frame::Image.position_in_board(self.board, position);
        let [vx, vy] = Frame::Image.velocity_in_board(velocity);
        Ok(ObjectState { x, y, vx, vy })
    }

    fn controller_status(
        &mut self,
        seat: MotorSeat,
        time: Nanos,
        value: &Value,
    ) -> Result<(), CdrError> {
        // A torque is NaN as long as the drive does not send it.
        let torque = |path| Ok(Some(value.number(path)?).filter(|torque| torque.is_finite()));
        let report = MotorState {
            position_turns: finite(value, "pos_estimate")?,
            velocity_turns_per_s: finite(value, "vel_estimate")?,
            torque_target_nm: torque("torque_target")?,
            torque_estimate_nm: torque("torque_estimate")?,
            torque_age_s: None,
        };
        let state = Health::State {
            axis_state: small(value, "axis_state")?,
            errors: small(value, "active_errors")?,
        };
        push_motor(self.tape, seat, time, &report);
        self.health.entry(seat.node).or_default().push((time, state));
        Ok(())
    }

    fn drive_status(
        &mut self,
        seat: MotorSeat,
        time: Nanos,
        value: &Value,
    ) -> Result<(), CdrError> {
        let status = Health::Status {
            supply: [value.number("bus_voltage")?, value.number("bus_current")?],
            temperatures: [value.number("fet_temperature")?, value.number("motor_temperature")?],
            errors: small(value, "active_errors")?,
            disarm_reason: small(value, "disarm_reason")?,
        };
        self.health.entry(seat.node).or_default().push((time, status));
        Ok(())
    }

    fn magnet(&mut self, player: Player, time: Nanos, value: &Value) -> Result<(), CdrError> {
        let wrong = || CdrError::Field { path: "data".to_owned(), expected: "pair of metres" };
        let Value::List(values) = value.at("data")? else { return Err(wrong()) };
        let [Value::Float(x), Value::Float(y)] = values.as_slice() else { return Err(wrong()) };
        if !(x.is_finite() && y.is_finite()) {
            return Err(wrong());
        }
        let position = Frame::Image.position_in_board(self.board, [*x, *y]);
        self.magnets.push(player, time, position);
        Ok(())
    }

    fn can_frame(&mut self, time: Nanos, value: &Value) -> Result<(), CdrError> {
        let flag = |path| Ok(value.unsigned(path)? != 0);
        let Value::Bytes(bytes) = value.at("data")? else {
            return Err(CdrError::Field { path: "data".to_owned(), expected: "array of bytes" });
        };
        let length = (value.unsigned("dlc")? as usize).min(bytes.len());
        let kind = match (flag("is_error")?, flag("is_rtr")?) {
            (true, _) => can::FrameKind::Error,
            (false, true) => can::FrameKind::Remote,
            (false, false) => can::FrameKind::Data,
        };
        let used = if kind == can::FrameKind::Remote { 0 } else { length };
        let frame = can::Frame {
            id: small(value, "id")?,
            width: if flag("is_extended")? {
                can::IdWidth::Extended
            } else {
                can::IdWidth::Standard
            },
            kind,
            data: can::Payload::new(&bytes[..used])
                .ok_or(CdrError::Field { path: "data".to_owned(), expected: "8 bytes in" })?,
        };
        let times = [time, stamp_of(value).unwrap_or(time)];
        self.bus.push(self.tape, times, &frame, None);
        Ok(())
    }

    /// Sort each drive's health by time. There is one message for every status, and one for each
    /// change of state or errors in between, so that no disarm is missed.
    fn push_health(&mut self) {
        for (node, mut events) in std::mem::take(&mut self.health) {
            let Some(seat) = MotorSeat::of_node(node) else { continue };
            events.sort_by_key(|(time, _)| *time);
            let topic = topic::drive(seat.player, seat.motor);
            let mut health = DriveHealth::default();
            let mut last = None;
            for (time, event) in events {
                let status = match event {
                    Health::State { axis_state, errors } => {
                        let status = health.at_state(time, axis_state, errors);
                        if last == Some((axis_state, errors)) {
                            continue;
                        }
                        last = Some((axis_state, errors));
                        status
                    }
                    Health::Status { supply, temperatures, errors, disarm_reason } => {
                        health.errors(errors, disarm_reason);
                        health.supply(time, supply[0], supply[1]);
                        health.temperatures(time, temperatures[0], temperatures[1]);
                        health.now(time)
                    }
                };
                self.tape.push(&topic, time, Outgoing::Drive(status));
            }
        }
    }

    fn finish(mut self, gantry: CoreXy) {
        self.push_health();
        self.bus.finish(self.tape, gantry);
        push_carriages(self.tape, gantry, &mut self.magnets);
    }
}

/// Return the decoder of the bag's own definition if usable, else of the known one.
fn decoder_of(topic: &BagTopic) -> Result<Decoder, String> {
    let own = match &topic.definition {
        Some((encoding, text)) if encoding == "ros2msg" || encoding.is_empty() => {
            Decoder::of_definition(&topic.type_name, text).map_err(|error| error.to_string())
        }
        Some((encoding, _)) => Err(format!("its encoding is '{encoding}', not ros2msg")),
        None => Err(String::new()),
    };
    own.or_else(|reason| Decoder::of_known_type(&topic.type_name).ok_or(reason))
}

fn finite(value: &Value, path: &str) -> Result<f64, CdrError> {
    let number = value.number(path)?;
    if number.is_finite() {
        Ok(number)
    } else {
        Err(CdrError::Field { path: path.to_owned(), expected: "finite number" })
    }
}

fn small(value: &Value, path: &str) -> Result<u32, CdrError> {
    let wrong = || CdrError::Field { path: path.to_owned(), expected: "32-bit integer" };
    u32::try_from(value.unsigned(path)?).map_err(|_too_large| wrong())
}

/// Return the time in the message's header; `None` without one, or when it was never set.
fn stamp_of(value: &Value) -> Option<Nanos> {
    let seconds = value.unsigned("header.stamp.sec").ok()?;
    let nanos = value.unsigned("header.stamp.nanosec").ok()?;
    let total = seconds.checked_mul(NANOS_PER_SECOND)?.checked_add(nanos)?;
    (0 < total).then_some(Nanos(total))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_find_their_place() {
        let twist = "geometry_msgs/msg/Twist";
        assert_eq!(route("/cmd_vel/left_player", twist), Some(Route::Command(Player::Left)));
        assert_eq!(
            route("/cmd_vel/right_player_checked", twist),
            Some(Route::CheckedCommand(Player::Right))
        );
        assert_eq!(route("/board_state", "klask_interfaces/msg/State"), Some(Route::BoardState));
        let seat = MotorSeat::of_node(3).unwrap();
        assert_eq!(
            route("/odrive_axis3/controller_status", "odrive_can/msg/ControllerStatus"),
            Some(Route::ControllerStatus(seat))
        );
        assert_eq!(
            route("/left_player_magnet_position", "std_msgs/msg/Float32MultiArray"),
            Some(Route::Magnet(Player::Left))
        );
        for (topic, type_name) in [
            ("/odrive_axis4/controller_status", "odrive_can/msg/ControllerStatus"),
            ("/cmd_vel/left_player", "std_msgs/msg/String"),
            ("/board_image/compressed", "sensor_msgs/msg/CompressedImage"),
        ] {
            assert_eq!(route(topic, type_name), None, "{topic}");
            assert!(!is_wanted(topic, type_name));
        }
    }
}
