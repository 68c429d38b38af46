//! What the players of a match know of the table, and the limits that their commands meet.
//!
//! A match and the environments of [`RigGames`](super::RigGames) share it, so a policy that is
//! trained on a rig sees and moves there as in a match.

use crate::{
    collect::{Carriage, Moment, StopReason},
    ekf::{Detections, FilterSettings},
    game::{CommandLimits, Estimator, GameSettings, PreviousCommands, Seen, turned},
    gantry::Robot,
    recording::topic::Player,
    units::Nanos,
};

/// Time without a ball in play after which a match ends (s): a person has served it by then.
const MOST_SECONDS_WITHOUT_BALL: f64 = 30.0;

/// Estimate of the table, previous commands and wall limiters.
pub(super) struct TableState {
    estimator: Estimator,
    /// Wall limiters with the workspace of training and that of the robot.
    limits: [CommandLimits; 2],
    /// Previous commands of each player, before the wall limiters, as in training.
    pub(super) previous: [PreviousCommands; 2],
    /// When the ball was last in play; before that, the first decision.
    ball_in_play: Option<Nanos>,
}

impl TableState {
    pub(super) fn new(robot: &Robot, filter: &FilterSettings) -> Self {
        let limits = [GameSettings::default(), GameSettings::default().within_robot(robot)]
            .map(|game| game.limits);
        let home = Player::BOTH.map(|player| {
            let home = robot.home.of(player);
            [home.x_m, home.y_m]
        });
        Self {
            estimator: Estimator::new(filter, home),
            limits,
            previous: [PreviousCommands::default(); 2],
            ball_in_play: None,
        }
    }

    /// Limits of training.
    pub(super) fn training_limits(&self) -> &CommandLimits {
        &self.limits[0]
    }

    /// Take a camera frame.
    pub(super) fn see(&mut self, detections: &Detections) {
        self.estimator.see(detections);
    }

    /// Estimated state at a decision.
    pub(super) fn look(&mut self, moment: &Moment) -> Seen {
        let carriages = moment.carriages.map(|carriage| {
            let Carriage { position: [x, y], velocity: [vx, vy] } = carriage?;
            Some([x, y, vx, vy])
        });
        self.estimator.look(moment.now, carriages)
    }

    /// Reason to end a match that has been without a ball for too long.
    pub(super) fn without_ball(&mut self, seen: &Seen, now: Nanos) -> Option<StopReason> {
        let since = *self.ball_in_play.get_or_insert(now);
        if seen.ball.is_some() {
            self.ball_in_play = Some(now);
            return None;
        }
        let (age_s, limit_s) = (now.seconds_since(since), MOST_SECONDS_WITHOUT_BALL);
        (limit_s < age_s).then_some(StopReason::BallMissing { age_s, limit_s })
    }

    /// Velocities after the wall limiters, from the `wanted` ones of left and right player (m/s,
    /// board frame).
    pub(super) fn limited(&mut self, moment: &Moment, wanted: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        Player::BOTH.map(|player| {
            let wanted = wanted[player as usize];
            let own = turned(player, wanted).map(|value| value as f32);
            self.previous[player as usize].push(own);
            let Some(carriage) = moment.carriages[player as usize] else { return wanted };
            self.limits.iter().fold(wanted, |velocity, limits| {
                let velocity = velocity.map(|v| v.clamp(-limits.speed, limits.speed));
                limits.before_walls(limits.field.of(player), carriage.position, velocity)
            })
        })
    }
}
