//! Conversion of drive reports and setpoints into motors, carriages and commands.
//!
//! A carriage position needs both motors at one time, but each drive reports on its own clock. Two
//! reports form a pair when each is the nearest of the other and they are at most
//! [`MOST_PAIR_SECONDS`] apart. The pair has the later of the two time stamps. Other reports stay
//! unpaired and are counted: at 0.4 m/s a carriage moves 6 mm in that time.

use super::{
    report::Notice,
    tape::{Outgoing, Tape},
};
use crate::{
    gantry::{CoreXy, MOST_PAIR_SECONDS, MotorPair, MotorSeat},
    recording::{
        message::{CarriageState, MotorState, VelocityCommand},
        topic::{self, Motor, Player},
    },
    stats::median,
    units::Nanos,
};

/// Threshold between a command gain of 1 and the gain of 2 of older upstream software.
const DOUBLED_GAIN: f64 = 1.5;

/// Add one report of a drive's motion, in the drive's own direction.
pub(super) fn push_motor(tape: &mut Tape, seat: MotorSeat, time: Nanos, report: &MotorState) {
    let directed = Outgoing::Motor(seat.directed_motor(report));
    tape.push(&topic::motor(seat.player, seat.motor), time, directed);
}

/// Velocity setpoints of single drives (turns/s, gantry's direction), by player and motor.
#[derive(Debug, Default)]
pub(super) struct Setpoints {
    stamped: [[Vec<(Nanos, f64)>; 2]; 2],
}

impl Setpoints {
    /// Add one `Set_Input_Vel` in the drive's own direction (turns/s).
    pub(super) fn push(&mut self, seat: MotorSeat, time: Nanos, velocity: f64) {
        let [player, motor] = [seat.player as usize, seat.motor as usize];
        self.stamped[player][motor].push((time, seat.directed(velocity)));
    }

    /// Add the commands that result from pairs of setpoints.
    pub(super) fn push_commands(mut self, tape: &mut Tape, gantry: CoreXy) {
        for player in Player::BOTH {
            let [a, b] = &mut self.stamped[player as usize];
            a.sort_by_key(|(time, _)| *time);
            b.sort_by_key(|(time, _)| *time);
            let pairs = mutual_nearest(&times(a), &times(b));
            note_unpaired(tape, topic::command(player), a.len() + b.len() - 2 * pairs.len());
            for (i, j) in pairs {
                let pair = MotorPair { a: a[i].1, b: b[j].1 };
                let [vx, vy] = gantry.board_from_motors(pair);
                let command = Outgoing::Command(VelocityCommand { vx, vy });
                tape.push(&topic::command(player), a[i].0.max(b[j].0), command);
            }
        }
    }
}

fn times<T>(stamped: &[(Nanos, T)]) -> Vec<Nanos> {
    stamped.iter().map(|(time, _)| *time).collect()
}

fn note_unpaired(tape: &mut Tape, topic: String, messages: usize) {
    if 0 < messages {
        tape.notices.push(Notice::Unpaired { topic, messages });
    }
}

/// Positions of the carriage magnet on the board (m) from a source other than the encoders.
#[derive(Debug, Default)]
pub(super) struct MagnetTrack {
    positions: [Vec<(Nanos, [f64; 2])>; 2],
}

impl MagnetTrack {
    /// Add a position in the board frame (m).
    pub(super) fn push(&mut self, player: Player, time: Nanos, position: [f64; 2]) {
        self.positions[player as usize].push((time, position));
    }
}

/// Compute the carriages from the motors on the tape. Positions count from the drives' zero, plus
/// the median difference to `magnets`.
pub(super) fn push_carriages(tape: &mut Tape, gantry: CoreXy, magnets: &mut MagnetTrack) {
    let mut origins = Vec::new();
    for player in Player::BOTH {
        let (mut track, unpaired) = carriage_track(tape, gantry, player);
        note_unpaired(tape, topic::carriage(player), unpaired);
        if track.is_empty() {
            continue;
        }
        let magnet = &mut magnets.positions[player as usize];
        magnet.sort_by_key(|(time, _)| *time);
        let origin = match home_offset(&track, magnet) {
            Some([x0, y0]) => {
                for (_, state) in &mut track {
                    state.x += x0;
                    state.y += y0;
                }
                "magnet_position"
            }
            None => {
                tape.notices.push(Notice::OriginUnknown { topic: topic::carriage(player) });
                "unknown"
            }
        };
        origins.push((player, origin));
        for (time, state) in track {
            tape.push(&topic::carriage(player), time, Outgoing::Carriage(state));
        }
    }
    if let Some(text) = origin_text(&origins) {
        tape.metadata.insert("carriage_origin".to_owned(), text);
    }
    for player in Player::BOTH {
        note_command_gain(tape, player);
    }
}

/// Store the measured command gain of a carriage, `command_gain_PLAYER`, in the metadata. Add a
/// notice when it is close to 2, as in recordings made before upstream's fix.
fn note_command_gain(tape: &mut Tape, player: Player) {
    let Some(gain) = command_gain(tape, player) else { return };
    tape.metadata.insert(format!("command_gain_{player}"), format!("{gain:.4}"));
    if DOUBLED_GAIN < gain {
        tape.notices.push(Notice::DoubledSpeed { topic: topic::carriage(player), gain });
    }
}

/// Return the least-squares slope of the carriage's velocity on the active command, both axes
/// together.
fn command_gain(tape: &Tape, player: Player) -> Option<f64> {
    let commands = tape.series(&topic::command(player), |message| match message {
        Outgoing::Command(command) => Some(command),
        _ => None,
    });
    let carriage = tape.series(&topic::carriage(player), |message| match message {
        Outgoing::Carriage(state) => Some(state),
        _ => None,
    });
    let [mut squares, mut products] = [0.0, 0.0];
    for (time, state) in carriage {
        let later = commands.partition_point(|(at, _)| *at <= time);
        let Some((_, command)) = later.checked_sub(1).and_then(|last| commands.get(last)) else {
            continue;
        };
        squares += command.vx * command.vx + command.vy * command.vy;
        products += command.vx * state.vx + command.vy * state.vy;
    }
    (0.0 < squares).then_some(products / squares)
}

/// Return one word when all carriages share it, else each with its player.
fn origin_text(origins: &[(Player, &str)]) -> Option<String> {
    let (_, first) = origins.first()?;
    if origins.iter().all(|(_, origin)| origin == first) {
        return Some((*first).to_owned());
    }
    let each: Vec<String> = origins.iter().map(|(p, origin)| format!("{p} {origin}")).collect();
    Some(each.join(", "))
}

type Track = Vec<(Nanos, CarriageState)>;

fn carriage_track(tape: &Tape, gantry: CoreXy, player: Player) -> (Track, usize) {
    let motors = |motor| {
        tape.series(&topic::motor(player, motor), |message| match message {
            Outgoing::Motor(state) => Some(state),
            _ => None,
        })
    };
    let [a, b] = [motors(Motor::A), motors(Motor::B)];
    let pairs = mutual_nearest(&times(&a), &times(&b));
    let unpaired = a.len() + b.len() - 2 * pairs.len();
    let track = pairs
        .into_iter()
        .map(|(i, j)| {
            let ((time_a, a), (time_b, b)) = (a[i], b[j]);
            let position = MotorPair { a: a.position_turns, b: b.position_turns };
            let velocity = MotorPair { a: a.velocity_turns_per_s, b: b.velocity_turns_per_s };
            let [x, y] = gantry.board_from_motors(position);
            let [vx, vy] = gantry.board_from_motors(velocity);
            (time_a.max(time_b), CarriageState { x, y, vx, vy })
        })
        .collect();
    (track, unpaired)
}

/// Return the median of magnet minus encoder position (m), over pairs close in time.
fn home_offset(track: &Track, magnet: &[(Nanos, [f64; 2])]) -> Option<[f64; 2]> {
    let pairs = mutual_nearest(&times(track), &times(magnet));
    let offset = |pick: fn(&CarriageState) -> f64, axis: usize| {
        let differences: Vec<f64> =
            pairs.iter().map(|(i, j)| magnet[*j].1[axis] - pick(&track[*i].1)).collect();
        median(&differences)
    };
    Some([offset(|state| state.x, 0)?, offset(|state| state.y, 1)?])
}

/// Return the pairs of two sorted lists of times: each is the nearest of the other, and at most
/// [`MOST_PAIR_SECONDS`] apart. Of two equally near times the earlier counts.
fn mutual_nearest(a: &[Nanos], b: &[Nanos]) -> Vec<(usize, usize)> {
    let nearest = |list: &[Nanos], time: Nanos| -> Option<usize> {
        let after = list.partition_point(|t| *t < time);
        let distance = |index: usize| list.get(index).map(|t| t.0.abs_diff(time.0));
        let before = after.checked_sub(1).map(|last| list.partition_point(|t| *t < list[last]));
        match (before, distance(after)) {
            (Some(before), Some(d)) if distance(before)? <= d => Some(before),
            (Some(before), None) => Some(before),
            (_, found) => found.map(|_| after),
        }
    };
    let pair = |i: usize| {
        let j = nearest(b, a[i])?;
        let close = b[j].seconds_since(a[i]).abs() <= MOST_PAIR_SECONDS;
        (close && nearest(a, b[j])? == i).then_some((i, j))
    };
    (0..a.len()).filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    fn at(milliseconds: &[u64]) -> Vec<Nanos> {
        milliseconds.iter().map(|t| Nanos(t * MS)).collect()
    }

    #[test]
    fn pairs_are_nearest_and_never_far_apart() {
        assert_eq!(mutual_nearest(&at(&[0, 10, 20]), &at(&[9, 19])), [(1, 0), (2, 1)]);
        assert_eq!(mutual_nearest(&at(&[0]), &at(&[15])), [(0, 0)]);
        assert_eq!(mutual_nearest(&at(&[0]), &at(&[16])), []);
        assert_eq!(mutual_nearest(&at(&[5, 5, 5]), &at(&[5, 5])), [(0, 0)]);
        assert_eq!(mutual_nearest(&at(&[]), &at(&[5])), []);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]

        #[test]
        fn nothing_is_used_twice(mut a in proptest::collection::vec(0_u64..200, 0..30), mut b in proptest::collection::vec(0_u64..200, 0..30)) {
            a.sort_unstable();
            b.sort_unstable();
            let pairs = mutual_nearest(&at(&a), &at(&b));
            let firsts: std::collections::BTreeSet<_> = pairs.iter().map(|p| p.0).collect();
            let seconds: std::collections::BTreeSet<_> = pairs.iter().map(|p| p.1).collect();
            prop_assert_eq!(firsts.len(), pairs.len());
            prop_assert_eq!(seconds.len(), pairs.len());
            for (i, j) in pairs {
                prop_assert!(a[i].abs_diff(b[j]) <= 15);
            }
        }
    }

    #[test]
    fn carriages_move_as_their_motors_say_and_start_at_the_magnet() {
        let mut tape = Tape::default();
        let gantry = CoreXy::default();
        // The left player moves along +x at 0.4 m/s: both its drives run backwards.
        for step in 0..10_u64 {
            for node in [2, 3] {
                let report = MotorState {
                    position_turns: -0.1 * step as f64,
                    velocity_turns_per_s: -10.0,
                    torque_target_nm: Some(-0.2),
                    torque_estimate_nm: None,
                    torque_age_s: None,
                };
                let time = Nanos((10 * step + u64::from(node)) * MS);
                push_motor(&mut tape, MotorSeat::of_node(node).unwrap(), time, &report);
            }
        }
        let mut magnets = MagnetTrack::default();
        magnets.push(Player::Left, Nanos(4 * MS), [0.01, -0.1]);
        push_carriages(&mut tape, gantry, &mut magnets);
        let track = tape.series(&topic::carriage(Player::Left), |message| match message {
            Outgoing::Carriage(state) => Some(state),
            _ => None,
        });
        assert_eq!(track.len(), 10);
        assert_eq!(track[0].0, Nanos(3 * MS));
        let last = track[9].1;
        assert!((last.x - 0.046).abs() < 1e-12 && (last.y + 0.1).abs() < 1e-12, "{last:?}");
        assert!((last.vx - 0.4).abs() < 1e-12 && last.vy.abs() < 1e-12);
        assert_eq!(tape.metadata["carriage_origin"], "magnet_position");
        let motor = tape.series(&topic::motor(Player::Left, Motor::A), |message| match message {
            Outgoing::Motor(state) => Some(state),
            _ => None,
        });
        assert_eq!(motor[0].1.torque_target_nm, Some(0.2));
    }

    #[test]
    fn a_doubled_speed_is_noticed() {
        for (speed, noticed) in [(0.2, false), (0.4, true)] {
            let mut tape = Tape::default();
            for step in 0..10 {
                let command = VelocityCommand { vx: 0.2, vy: 0.0 };
                let state = CarriageState { x: 0.0, y: 0.0, vx: speed, vy: 0.01 };
                let [now, soon] = [Nanos(20 * step * MS), Nanos((20 * step + 5) * MS)];
                tape.push(&topic::command(Player::Left), now, Outgoing::Command(command));
                tape.push(&topic::carriage(Player::Left), soon, Outgoing::Carriage(state));
            }
            note_command_gain(&mut tape, Player::Left);
            let gain: f64 = tape.metadata["command_gain_left"].parse().unwrap();
            assert!((gain - speed / 0.2).abs() < 1e-4);
            assert_eq!(!tape.notices.is_empty(), noticed);
        }
    }
}
