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
    /// Position and velocity in metres of belt, torque in N m (NaN without).
    pub(super) motors: [Readings<3>; 2],
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
        let motors = motor_readings(recording, (player, belt), origin)?;
        Ok(match (motors, carriage) {
            (None, None) => None,
            (Some(motors), None) => {
                Some(Self { player, carriage: carriage_of_motors(&motors), motors })
            }
            (None, Some(carriage)) => {
                Some(Self { player, motors: motors_of_carriage(&carriage), carriage })
            }
            (Some(motors), Some(carriage)) => Some(Self { player, motors, carriage }),
        })
    }

    /// Length of the carriage's travel (m).
    fn travel(&self) -> f64 {
        let step = |pair: &[[f64; 4]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        self.carriage.values.windows(2).map(step).filter(|step| step.is_finite()).sum()
    }
}

/// Motors of one gantry with this `belt` per turn (m): position and velocity in metres of belt,
/// torque in N m (NaN without).
fn motor_readings(
    recording: &Recording,
    (player, belt): (Player, f64),
    origin: Nanos,
) -> Result<Option<[Readings<3>; 2]>, RecordingError> {
    let mut both = [Readings::default(), Readings::default()];
    for (readings, motor) in both.iter_mut().zip([Motor::A, Motor::B]) {
        let series = recording.series::<MotorState>(&topic::motor(player, motor))?;
        *readings = Readings::collect(series.iter().map(|(time, state)| {
            let torque = state.torque_estimate_nm.or(state.torque_target_nm).unwrap_or(f64::NAN);
            let position = state.position_turns * belt;
            let velocity = state.velocity_turns_per_s * belt;
            (time.seconds_since(origin), [position, velocity, torque])
        }));
    }
    let usable = both.iter().all(|readings| FEWEST <= readings.times.len());
    Ok(usable.then_some(both))
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
fn carriage_of_motors(motors: &[Readings<3>; 2]) -> Readings<4> {
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
fn motors_of_carriage(carriage: &Readings<4>) -> [Readings<3>; 2] {
    [0, 1].map(|k| {
        Readings::collect(carriage.times.iter().zip(&carriage.values).map(|(time, value)| {
            let position = belts([value[0], value[1]])[k];
            let velocity = belts([value[2], value[3]])[k];
            (*time, [position, velocity, f64::NAN])
        }))
    })
}
