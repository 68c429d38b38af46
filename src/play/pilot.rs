//! Pilot of a match: from camera frames to velocities.

use super::{MatchFormat, MatchScore, PlayError, Seat, score::Scoring, table_state::TableState};
use crate::{
    collect::{Decision, Moment, Pilot, RunLabel},
    ekf::{Detections, FilterSettings, board_state},
    game::{CONTROL_PERIOD, CommandLimits, Observation, turned},
    gantry::Robot,
    opponent,
    ppo::Scratch,
    recording::{message::CameraDetections, topic::Player},
    referee::Frame,
    train::{Mismatch, TrainError},
    units::Nanos,
};
use std::collections::BTreeMap;

/// Gain of the position hold in the moves before a match ((m/s)/m).
pub const HOLD_GAIN_PER_S: f64 = 1.0;

/// Pattern name in the markers of a match.
const PATTERN: &str = "match";

/// Label of a match: it has no split, so a fit divides it by itself.
#[must_use]
pub fn label() -> RunLabel {
    RunLabel { number: 1, pattern: PATTERN.to_owned(), split: String::new() }
}

/// Two seats at a table, with the state of the table.
pub struct Match {
    seats: [Option<Seat>; 2],
    seed: u64,
    /// Speed of scripted players (m/s).
    speed: f32,
    table: TableState,
    filter_settings: FilterSettings,
    /// Capture time of the first frame, from which the referee counts.
    first_frame: Option<Nanos>,
    scoring: Scoring,
    scratch: Scratch,
}

impl Match {
    /// Match of `seats`, left first, on the table of `robot`; `seed` is that of the random player.
    ///
    /// # Errors
    /// When both seats are empty, a player is on a side without drives, or a policy is faster than
    /// the robot permits.
    pub fn new(
        seats: [Option<Seat>; 2],
        robot: &Robot,
        filter_settings: &FilterSettings,
        seed: u64,
    ) -> Result<Self, PlayError> {
        if seats.iter().all(Option::is_none) {
            return Err(PlayError::NobodyPlays);
        }
        for player in Player::BOTH {
            let Some(seat) = &seats[player as usize] else { continue };
            if !robot.players().contains(&player) {
                return Err(PlayError::NoDrives(player));
            }
            check_speed(seat, robot)?;
        }
        let table = TableState::new(robot, filter_settings);
        Ok(Self {
            seats,
            seed,
            speed: scripted_speed(table.training_limits(), robot),
            table,
            filter_settings: *filter_settings,
            first_frame: None,
            scoring: Scoring::new(None),
            scratch: Scratch::default(),
        })
    }

    /// The same match, which ends when it is won by `format`.
    #[must_use]
    pub fn until_won(self, format: MatchFormat) -> Self {
        Self { scoring: Scoring::new(Some(format)), ..self }
    }

    /// Score so far, by the referee.
    #[must_use]
    pub fn score(&self) -> MatchScore {
        self.scoring.score()
    }

    /// Differences between `robot` and the training of a policy that can degrade its play, as
    /// sentences.
    #[must_use]
    pub fn warnings(&self, robot: &Robot) -> Vec<String> {
        let of =
            |seat: &Seat| [seat.slew_warning(robot), seat.filter_warning(&self.filter_settings)];
        self.seats.iter().flatten().flat_map(of).flatten().collect()
    }

    /// Players whose gantries are driven.
    #[must_use]
    pub fn players(&self) -> Vec<Player> {
        let seated = |player: &Player| self.seats[*player as usize].is_some();
        Player::BOTH.into_iter().filter(seated).collect()
    }

    /// Rate of decisions (Hz).
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        CONTROL_PERIOD.recip()
    }

    /// Players and settings, for the metadata of the recording.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let filter = serde_json::to_string(&self.filter_settings)
            .unwrap_or_else(|_plain| unreachable!("settings are plain data"));
        let mut entries = BTreeMap::from([
            ("filter_json".to_owned(), filter),
            ("rate_hz".to_owned(), self.rate_hz().to_string()),
            ("seed".to_owned(), self.seed.to_string()),
        ]);
        for player in Player::BOTH {
            let seat = self.seats[player as usize].as_ref();
            let name = seat.map_or_else(|| "none".to_owned(), Seat::to_string);
            entries.insert(format!("player_{player}"), name);
            if let Some(Seat::Policy { sha256, .. }) = seat {
                entries.insert(format!("player_{player}_sha256"), sha256.clone());
            }
        }
        entries
    }

    /// Velocity that `player` commands, before wall limits (m/s, board frame).
    fn wanted(
        &mut self,
        player: Player,
        (strikers, ball): (&[[f64; 4]; 2], [f64; 4]),
        step: u64,
    ) -> [f64; 2] {
        let Some(seat) = &self.seats[player as usize] else { return [0.0; 2] };
        let seen = Observation::of_board(player, strikers, ball);
        let velocity = match seat {
            Seat::Scripted(script) => {
                let moment = opponent::Moment { seed: self.seed, board: player as u64, step };
                script.velocity(&seen.0, moment, self.speed)
            }
            Seat::Policy { policy, .. } => {
                policy.velocity(&seen, &self.table.previous[player as usize], &mut self.scratch)
            }
        };
        turned(player, velocity.map(f64::from))
    }
}

/// Speed of scripted players (m/s): that of the game, as far as the robot permits it.
pub(super) fn scripted_speed(limits: &CommandLimits, robot: &Robot) -> f32 {
    limits.speed.min(robot.limits.speed_m_per_s) as f32
}

/// Check that the full action of a policy is within the robot's speed limit, which would clamp it
/// silently.
fn check_speed(seat: &Seat, robot: &Robot) -> Result<(), PlayError> {
    let Seat::Policy { file, policy, .. } = seat else { return Ok(()) };
    check_speed_of(file, policy.action_scale_m_per_s, robot)
}

/// Check that the speed `scale` (m/s) of a full action of `owner` is within the robot's limit.
pub(super) fn check_speed_of(owner: &str, scale: f64, robot: &Robot) -> Result<(), PlayError> {
    let top = robot.limits.speed_m_per_s;
    if scale <= top {
        return Ok(());
    }
    let mismatch = Mismatch {
        path: owner.into(),
        what: "action_scale_m_per_s".to_owned(),
        found: scale.to_string(),
        other: "limits.speed_m_per_s of the robot file",
        expected: top.to_string(),
        remedy: "train a slower policy, or raise the limit if the table allows it",
    };
    Err(TrainError::from(Box::new(mismatch)).into())
}

impl Pilot for Match {
    fn see(&mut self, shown: Nanos, picture: &CameraDetections) {
        self.table.see(&Detections::of(shown, picture));
        let first = *self.first_frame.get_or_insert(shown);
        self.scoring.referee().see(&Frame::of(shown.seconds_since(first), picture));
    }

    fn decide(&mut self, moment: &Moment) -> Decision {
        let seen = self.table.look(moment);
        let wanted = Player::BOTH.map(|player| match seen.ball {
            Some(ball) => self.wanted(player, (&seen.strikers, ball), moment.step),
            None => [0.0; 2],
        });
        Decision {
            velocities: self.table.limited(moment, wanted),
            belief: Some(board_state(seen.estimates)),
            stop: self.table.without_ball(&seen, moment.now),
            note: self.scoring.update().map(|score| format!("score {score}")),
            complete: self.scoring.is_over(),
        }
    }
}
