//! CoreXY kinematics in the board frame, and the assignment of the four drives.
//!
//! With `d` the belt per motor turn: `a = (x + y) / d`, `b = (x - y) / d`, so `x = d/2 (a + b)`, `y
//! = d/2 (a - b)`. The same holds for velocities. Both are after the sign of each motor. Source:
//! the upstream commander (image frame): `right = s (vx + vy) / d`, `left = s (vy - vx) / d`, with
//! `s` = +1 for the right and -1 for the left player. With `x = y_img`, `y = x_img` that is `a = s
//! right`, `b = s left`. Torques have the same sign.
//!
//! Older upstream software commanded with `2/d`, so its carriage moved at twice the command. That
//! is a property of such recordings, not of these kinematics.

use crate::recording::{
    message::MotorState,
    topic::{Motor, Player},
};
use serde::{Deserialize, Serialize};

pub use crate::recording::BELT_METRES_PER_TURN;

/// Motor angles in turns, or speeds in turns per second, with signs applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorPair {
    /// Motor `a`, which moves x + y.
    pub a: f64,
    /// Motor `b`, which moves x - y.
    pub b: f64,
}

/// Error: a belt length per turn outside the allowed range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a belt of {metres_per_turn} m per motor turn: it must lie above 0 and up to 1 m; \
     the KlaskTron gantry has 0.04 m"
)]
pub struct BeltError {
    /// Belt length given (m).
    pub metres_per_turn: f64,
}

/// Return the belt coordinates of a vector along the axes: a = x + y, b = x - y.
#[must_use]
pub fn belts([x, y]: [f64; 2]) -> [f64; 2] {
    [x + y, x - y]
}

/// Return the axis coordinates of a belt vector.
#[must_use]
pub fn rails([a, b]: [f64; 2]) -> [f64; 2] {
    [0.5 * (a + b), 0.5 * (a - b)]
}

/// Kinematics of one gantry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoreXy {
    metres_per_turn: f64,
}

impl Default for CoreXy {
    fn default() -> Self {
        Self { metres_per_turn: BELT_METRES_PER_TURN }
    }
}

impl CoreXy {
    /// Create a gantry that moves `metres_per_turn` of belt with each motor turn (m).
    ///
    /// # Errors
    /// When `metres_per_turn` is not in (0, 1] m.
    pub fn new(metres_per_turn: f64) -> Result<Self, BeltError> {
        if 0.0 < metres_per_turn && metres_per_turn <= 1.0 {
            Ok(Self { metres_per_turn })
        } else {
            Err(BeltError { metres_per_turn })
        }
    }

    /// Return the belt length per motor turn (m).
    #[must_use]
    pub fn metres_per_turn(self) -> f64 {
        self.metres_per_turn
    }

    /// Inverse kinematics: convert a displacement (m) or velocity (m/s) of the board frame into
    /// motor turns or turns per second.
    #[must_use]
    pub fn motors_from_board(self, rail: [f64; 2]) -> MotorPair {
        let [a, b] = belts(rail).map(|belt| belt / self.metres_per_turn);
        MotorPair { a, b }
    }

    /// Forward kinematics: convert motor turns or turns per second into a displacement (m) or
    /// velocity (m/s) of the board frame.
    #[must_use]
    pub fn board_from_motors(self, MotorPair { a, b }: MotorPair) -> [f64; 2] {
        let half = self.metres_per_turn / 2.0;
        [half * (a + b), half * (a - b)]
    }
}

/// Assignment of a drive to a motor of a gantry, with its sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorSeat {
    /// Node id of the drive on the bus, and number N of its `/odrive_axisN` topics.
    pub node: u8,
    /// Player of the gantry.
    pub player: Player,
    /// Motor of the gantry.
    pub motor: Motor,
    /// Sign, +1 or -1: multiplies position, velocity and torque of the drive.
    pub sign: i8,
}

impl MotorSeat {
    /// Return the seat of the KlaskTron table with this node id; `None` for any other node.
    #[must_use]
    pub fn of_node(node: u8) -> Option<Self> {
        KLASKTRON_SEATS.into_iter().find(|seat| seat.node == node)
    }

    /// Convert a value between the drive's and the gantry's direction; its own inverse.
    #[must_use]
    pub fn directed(self, value: f64) -> f64 {
        f64::from(self.sign) * value + 0.0 // no negative zero on the bus
    }

    /// Convert a drive's report of motion into the gantry's direction.
    #[must_use]
    pub fn directed_motor(self, report: &MotorState) -> MotorState {
        MotorState {
            position_turns: self.directed(report.position_turns),
            velocity_turns_per_s: self.directed(report.velocity_turns_per_s),
            torque_target_nm: report.torque_target_nm.map(|torque| self.directed(torque)),
            torque_estimate_nm: report.torque_estimate_nm.map(|torque| self.directed(torque)),
            torque_age_s: report.torque_age_s,
        }
    }
}

/// Seats of the four drives of the KlaskTron table. The commander's "right" motor of a gantry is
/// `a`, its "left" motor `b`.
pub const KLASKTRON_SEATS: [MotorSeat; 4] = [
    MotorSeat { node: 0, player: Player::Right, motor: Motor::A, sign: 1 },
    MotorSeat { node: 1, player: Player::Right, motor: Motor::B, sign: 1 },
    MotorSeat { node: 2, player: Player::Left, motor: Motor::A, sign: -1 },
    MotorSeat { node: 3, player: Player::Left, motor: Motor::B, sign: -1 },
];

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn forward_undoes_inverse(x in -1.0..1.0_f64, y in -1.0..1.0_f64, belt in 0.001..1.0_f64) {
            let gantry = CoreXy::new(belt).unwrap();
            let [bx, by] = gantry.board_from_motors(gantry.motors_from_board([x, y]));
            prop_assert!((bx - x).abs() < 1e-12 && (by - y).abs() < 1e-12);
        }

        /// Formulas of the upstream commander, image frame, for both players.
        #[test]
        fn the_commanders_formulas_give_the_same_motion(vx_img in -1.0..1.0_f64, vy_img in -1.0..1.0_f64) {
            let gantry = CoreXy::default();
            for (player, s) in [(Player::Right, 1.0), (Player::Left, -1.0)] {
                let right = s * (vx_img + vy_img) / 0.04;
                let left = s * (vy_img - vx_img) / 0.04;
                let seat = |motor| {
                    KLASKTRON_SEATS.into_iter().find(|seat| seat.player == player && seat.motor == motor).unwrap()
                };
                let pair = MotorPair { a: seat(Motor::A).directed(right), b: seat(Motor::B).directed(left) };
                let [vx, vy] = gantry.board_from_motors(pair);
                prop_assert!((vx - vy_img).abs() < 1e-12, "{player}: x {vx} against {vy_img}");
                prop_assert!((vy - vx_img).abs() < 1e-12, "{player}: y {vy} against {vx_img}");
            }
        }
    }

    #[test]
    fn speed_is_not_doubled() {
        // One turn of both motors moves the carriage by one turn of belt, along x alone.
        let moved = CoreXy::default().board_from_motors(MotorPair { a: 1.0, b: 1.0 });
        assert_eq!(moved, [BELT_METRES_PER_TURN, 0.0]);
        // 0.4 m/s along both axes is 20 turns per second of one motor, 0 of the other.
        let both = CoreXy::default().motors_from_board([0.4, 0.4]);
        assert_eq!([both.a, both.b], [20.0, 0.0]);
    }

    #[test]
    fn impossible_belts_are_refused() {
        for belt in [0.0, -0.04, f64::NAN, f64::INFINITY, 2.0] {
            assert!(CoreXy::new(belt).is_err());
        }
    }
}
