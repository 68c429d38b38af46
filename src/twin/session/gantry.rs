//! The gantry of a recording: its motors and its carriage, decoded once.

use super::Readings;
use crate::{
    gantry::{belts, rails},
    recording::{
        Recording, RecordingError,
        message::{CarriageState, MotorState},
        topic::{self, Motor, Player},
    },
    units::Nanos,
};

/// Fewest readings of a signal that is used.
const FEWEST: usize = 11;

/// One gantry as measured; signals that were not recorded are derived from those that were.
pub(super) struct Gantry {
    /// Its player.
    pub(super) player: Player,
    /// Position and velocity in metres of belt.
    pub(super) motors: [Readings<2>; 2],
    /// Torque of each motor in N m when its drive reported it, where it did.
    pub(super) torques: [Readings<1>; 2],
    /// Position (m) and velocity (m/s) in board coordinates.
    pub(super) carriage: Readings<4>,
}

impl Gantry {
    /// The gantry with the longest travel, the left one of equals; `None` without measurements.
    /// `belt` is the belt per motor turn (m).
    ///
    /// # Errors
    /// When a message does not decode.
    pub(super) fn moving(recording: &Recording, belt: f64) -> Result<Option<Self>, RecordingError> {
        let mut best: Option<(f64, Self)> = None;
        for player in Player::BOTH {
            if let Some(gantry) = Self::of(recording, player, belt)? {
                let travel = gantry.travel();
                if best.as_ref().is_none_or(|(longest, _)| *longest < travel) {
                    best = Some((travel, gantry));
                }
            }
        }
        Ok(best.map(|(_, gantry)| gantry))
    }

    fn of(
        recording: &Recording,
        player: Player,
        belt: f64,
    ) -> Result<Option<Self>, RecordingError> {
        let Some((origin, _)) = recording.time_range() else { return Ok(None) };
        let carriage = carriage_readings(recording, player, origin)?;
        let carriage = (FEWEST <= carriage.times.len()).then_some(carriage);
        let (motors, torques) = motor_readings(recording, (player, belt), origin)?;
        Ok(match (motors, carriage) {
            (None, None) => None,
            (Some(motors), None) => {
                let carriage = carriage_of_motors(&motors);
                Some(Self { player, carriage, motors, torques })
            }
            (None, Some(carriage)) => {
                let motors = motors_of_carriage(&carriage);
                Some(Self { player, motors, torques, carriage })
            }
            (Some(motors), Some(carriage)) => Some(Self { player, motors, torques, carriage }),
        })
    }

    /// Length of the carriage's travel (m).
    fn travel(&self) -> f64 {
        let step = |pair: &[[f64; 4]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        self.carriage.values.windows(2).map(step).filter(|step| step.is_finite()).sum()
    }
}

/// Motors of one gantry with this `belt` per turn (m), where there are enough readings: position and velocity in metres
/// of belt. And their torques in N m. A drive reports these in a message of its own, at another time.
fn motor_readings(
    recording: &Recording,
    (player, belt): (Player, f64),
    origin: Nanos,
) -> Result<(Option<[Readings<2>; 2]>, [Readings<1>; 2]), RecordingError> {
    let mut motors = [Readings::default(), Readings::default()];
    let mut torques = [Readings::default(), Readings::default()];
    for (k, motor) in [Motor::A, Motor::B].into_iter().enumerate() {
        let series = recording.series::<MotorState>(&topic::motor(player, motor))?;
        motors[k] = Readings::collect(series.iter().map(|(time, state)| {
            let (position, velocity) = (state.position_turns, state.velocity_turns_per_s);
            (time.seconds_since(origin), [position * belt, velocity * belt])
        }));
        torques[k] = Readings::collect(series.iter().filter_map(|(time, state)| {
            let torque = state.torque_estimate_nm.or(state.torque_target_nm)?;
            let age = state.torque_age_s.filter(|age| age.is_finite()).unwrap_or(0.0);
            torque.is_finite().then(|| (time.seconds_since(origin) - age, [torque]))
        }));
    }
    let usable = motors.iter().all(|readings| FEWEST <= readings.times.len());
    Ok((usable.then_some(motors), torques))
}

/// Carriage: position and velocity in board coordinates.
fn carriage_readings(
    recording: &Recording,
    player: Player,
    origin: Nanos,
) -> Result<Readings<4>, RecordingError> {
    let series = recording.series::<CarriageState>(&topic::carriage(player))?;
    Ok(Readings::collect(
        series.iter().map(|(time, state)| {
            (time.seconds_since(origin), [state.x, state.y, state.vx, state.vy])
        }),
    ))
}

/// Carriage from the motors' positions, for recordings without the carriage's topic.
fn carriage_of_motors(motors: &[Readings<2>; 2]) -> Readings<4> {
    let [a, b] = motors;
    let mut cursor = 0;
    Readings::collect(a.times.iter().zip(&a.values).filter_map(|(time, value)| {
        while cursor + 1 < b.times.len()
            && (b.times[cursor + 1] - time).abs() <= (b.times[cursor] - time).abs()
        {
            cursor += 1;
        }
        let other = b.values.get(cursor)?;
        let place = rails([value[0], other[0]]);
        let velocity = rails([value[1], other[1]]);
        Some((*time, [place[0], place[1], velocity[0], velocity[1]]))
    }))
}

/// Motors from the carriage, for recordings without the motors' topics.
fn motors_of_carriage(carriage: &Readings<4>) -> [Readings<2>; 2] {
    [0, 1].map(|k| {
        Readings::collect(carriage.times.iter().zip(&carriage.values).map(|(time, value)| {
            let position = belts([value[0], value[1]])[k];
            let velocity = belts([value[2], value[3]])[k];
            (*time, [position, velocity])
        }))
    })
}
