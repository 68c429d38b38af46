//! Referencing of the carriages. Encoders count from their position at power-on, so the origin
//! comes from the camera or from the operator.
//!
//! By camera, the striker is assumed to be centred over its magnet, as upstream does. Both must
//! stand still, and the median over half a second of camera frames is used.

use super::{reason::StopReason, station::Station};
use crate::{recording::topic::Player, stats::median};

/// Duration of the measurement (s).
const GATHER_SECONDS: f64 = 0.5;
/// Least number of camera frames that show the striker.
const FEWEST_FRAMES: usize = 10;
/// Largest median deviation of the striker, and largest motion of the carriage (m).
const STILL_METRES: f64 = 0.003;

/// Method of referencing the positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HomingPolicy {
    /// The camera measures the position of each striker.
    Camera,
    /// The operator has placed each carriage at the home point of the robot file.
    Declared,
}

/// Error of referencing the positions.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HomingError {
    /// The bus has failed during the measurement.
    #[error("{0}")]
    Stopped(StopReason),
    /// The motors of a gantry do not both report.
    #[error("the drives of the {player} player report no common position; see encoder_msg_rate_ms")]
    NoPosition {
        /// Player.
        player: Player,
    },
    /// The camera does not detect a striker.
    #[error(
        "the camera saw the {player} striker in {pictures} frames within half a second, \
         {FEWEST_FRAMES} are needed; check the image, or put the carriages at their home \
         points and use --homing declared"
    )]
    NotSeen {
        /// Player.
        player: Player,
        /// Number of frames that show the striker.
        pictures: usize,
    },
    /// Carriage or striker moves.
    #[error(
        "the {player} {what} moved by {:.1} mm while its position was taken (limit {:.0} mm); \
         keep hands off the table", 1e3 * metres, 1e3 * STILL_METRES
    )]
    Moving {
        /// Player.
        player: Player,
        /// Striker or carriage.
        what: &'static str,
        /// Distance (m).
        metres: f64,
    },
}

/// Reference the carriages of `players`.
pub(super) fn reference(
    station: &mut Station<'_>,
    players: &[Player],
    policy: HomingPolicy,
) -> Result<(), HomingError> {
    let until = station.now().after_seconds(GATHER_SECONDS);
    station.wait_until(until).map_err(HomingError::Stopped)?;
    for player in players {
        let player = *player;
        if !station.carriage(player).has_reported() {
            return Err(HomingError::NoPosition { player });
        }
        let metres = station.carriage(player).recent_travel();
        if STILL_METRES < metres {
            return Err(HomingError::Moving { player, what: "carriage", metres });
        }
        let position = match policy {
            HomingPolicy::Camera => seen(station, player)?,
            HomingPolicy::Declared => {
                let home = station.robot.home.of(player);
                [home.x_m, home.y_m]
            }
        };
        station.carriage_mut(player).set_position(position);
    }
    Ok(())
}

fn seen(station: &Station<'_>, player: Player) -> Result<[f64; 2], HomingError> {
    let places = station.camera.striker(player);
    if places.len() < FEWEST_FRAMES {
        return Err(HomingError::NotSeen { player, pictures: places.len() });
    }
    let middle = |values: Vec<f64>| median(&values).unwrap_or(f64::NAN);
    let [x, y] = [0, 1].map(|axis| middle(places.iter().map(|place| place[axis]).collect()));
    let metres = middle(places.iter().map(|[px, py]| (px - x).hypot(py - y)).collect());
    if STILL_METRES < metres {
        return Err(HomingError::Moving { player, what: "striker", metres });
    }
    Ok([x, y])
}
