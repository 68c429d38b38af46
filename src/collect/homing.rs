//! Where the carriages are: encoders count from wherever they were switched on, so their origin comes
//! from the camera or from the operator.
//!
//! By camera the striker is taken to sit over its magnet, as upstream does; both must stand still, and
//! the median of a second of pictures counts.

use super::{reason::StopReason, station::Station};
use crate::{recording::topic::Player, stats::median};

/// How long pictures and positions are gathered (s).
const GATHER_SECONDS: f64 = 0.5;
/// Fewest pictures that show the striker.
const FEWEST_PICTURES: usize = 10;
/// Farthest that half of the pictures may lie from the median, and the carriage may move (m).
const STILL_METRES: f64 = 0.003;

/// How positions are referenced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HomingPolicy {
    /// The camera sees where each striker is.
    Camera,
    /// The operator has put each carriage at the home point of the robot file.
    Declared,
}

/// Why positions cannot be referenced.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HomingError {
    /// The bus has failed meanwhile.
    #[error("{0}")]
    Stopped(StopReason),
    /// Both motors of a gantry must report to know its carriage.
    #[error("the drives of the {player} player report no common position; see encoder_msg_rate_ms")]
    NoPosition {
        /// Whose.
        player: Player,
    },
    /// The camera does not see a striker.
    #[error(
        "the camera saw the {player} striker in {pictures} pictures within half a second, \
         {FEWEST_PICTURES} are needed; look at the picture, or put the carriages at their home \
         points and say --homing declared"
    )]
    NotSeen {
        /// Whose.
        player: Player,
        /// In how many pictures it was.
        pictures: usize,
    },
    /// Something moves.
    #[error(
        "the {player} {what} moved by {:.1} mm while its position was taken (limit {:.0} mm); \
         keep hands off the table", 1e3 * metres, 1e3 * STILL_METRES
    )]
    Moving {
        /// Whose.
        player: Player,
        /// Striker or carriage.
        what: &'static str,
        /// How far (m).
        metres: f64,
    },
}

/// References the carriages of `players`.
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
    if places.len() < FEWEST_PICTURES {
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
