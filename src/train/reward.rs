//! Reward of a step: the result, and reward shaping that decays.
//!
//! Source: the paper, appendix A, equation 2, with `t` the transitions of all environments:
//!
//! ```text
//! r = r_result + exp(-t / N) (R_progress exp(-|ball - other cup| / D) - R_defence exp(-|ball - own cup| / D)
//!                             + R_proximity exp(-|ball - own striker| / C) + R_speed |v_ball|
//!                             + R_collision exp(-v_0 / v_hit) for each step with a hit)
//! ```
//!
//! Results are the paper's: +1, -1, and -1 for an own goal; an own goal of the opponent earns
//! nothing, as in upstream. A ball that comes to rest draws the game, and costs the player in whose
//! half it lies `ball_at_rest`. Without that price a policy that avoids the ball loses nothing,
//! whereas the results of both players sum to less than zero. The paper gives no other parameter.
//! `D` (0.2 m), `v_0` (0.1 m/s) and `N` (1e7) are upstream's. The weights are smaller than upstream's. With upstream's, a ball held
//! before the other cup earns more than a goal (0.04 per step, so 2.8 goals at gamma 0.99). Here
//! the maximum discounted shaping, `R / (1 - gamma)`, stays below the one goal that ends it.

use crate::{
    board::CUP_DISTANCE,
    game::{CONTROL_PERIOD, Ending},
    recording::topic::Player,
};
use serde::{Deserialize, Serialize};

/// The paper's three curricula, and one of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Curriculum {
    /// Reward shaping by the path of the ball from the own cup to the other one, by closeness to
    /// the ball, and by its speed: the paper's best.
    DenseBallToGoal,
    /// Reward shaping by hits of the ball.
    CollisionOnly,
    /// Results alone.
    Sparse,
    /// Reward shaping by the motion of the striker towards the ball and of the ball towards the
    /// other cup, which soon decays, and a price for a ball that comes to rest in the own half.
    /// Ours; a ball that is held earns nothing.
    Motion,
}

/// Form of the shaping by closeness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapingForm {
    /// The weighted closeness is earned in every step, as in the paper.
    #[default]
    PerStep,
    /// Potential-based: a step earns `gamma` times the weighted closeness after it, minus that
    /// before it (Ng, Harada and Russell, "Policy Invariance Under Reward Transformations", 1999).
    /// The best policy is that of the results alone: a ball that is held earns nothing.
    Potential,
}

/// Weights and scales of the reward.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardSettings {
    /// Reward of a goal; 1.
    pub goal_scored: f32,
    /// Reward of a conceded goal; -1.
    pub goal_conceded: f32,
    /// Reward of an own goal: own striker over the own cup, or two biscuits on it; -1.
    pub own_goal: f32,
    /// Reward of an own goal of the opponent; 0.
    pub opponent_own_goal: f32,
    /// Reward when the game is drawn because the ball is at rest in the own half; 0, and -0.5 in
    /// the motion curriculum.
    #[serde(default)]
    pub ball_at_rest: f32,
    /// Form of the three terms by closeness.
    #[serde(default)]
    pub form: ShapingForm,
    /// Weight of the ball's closeness to the other cup, per step; 0.006.
    pub progress: f32,
    /// Weight of the ball's closeness to the own cup, subtracted per step; 0.006.
    pub defence: f32,
    /// Decay length of the closeness to a cup (m), above 0; 0.2.
    pub cup_scale_m: f32,
    /// Weight of the striker's closeness to the ball, per step; 0.002.
    pub proximity: f32,
    /// Decay length of that closeness (m), above 0; 0.1.
    pub ball_scale_m: f32,
    /// Weight of the ball's speed (s/m), per step; 0.004.
    pub ball_speed_s_per_m: f32,
    /// Weight of the striker's motion towards the ball (1/m): velocity along the line to the ball,
    /// times the control period. Unlike closeness it is not lost when the ball is hit away.
    #[serde(default)]
    pub approach_per_m: f32,
    /// Weight of the ball's motion towards the other cup (1/m): velocity along the line to the cup,
    /// times the control period.
    #[serde(default)]
    pub ball_to_cup_per_m: f32,
    /// Weight of a hit of the ball by the own striker, per step with a hit; 0.02 in the collision
    /// curriculum.
    pub collision: f32,
    /// Closing speed of a hit that counts 1/e (m/s); 0.1.
    pub collision_scale_m_per_s: f32,
    /// Decay constant of the shaping (transitions of all environments), above 0; 1e7.
    pub decay_transitions: f64,
}

/// A step as input of the reward.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Standard values after the step, in the player's own frame (m, m/s).
    pub seen: &'a [f32],
    /// End of the episode in this step, if any.
    pub ended: Option<Ending>,
    /// Player that receives the reward.
    pub player: Player,
    /// Largest closing speed of the player's hits of the ball (m/s); 0 without one.
    pub hit_speed: f32,
    /// Potential before the step and discount factor; read for [`ShapingForm::Potential`].
    pub potential: (f32, f32),
}

impl RewardSettings {
    /// Reward of a curriculum.
    #[must_use]
    pub fn of(curriculum: Curriculum) -> Self {
        let sparse = Self {
            goal_scored: 1.0,
            goal_conceded: -1.0,
            own_goal: -1.0,
            opponent_own_goal: 0.0,
            ball_at_rest: 0.0,
            form: ShapingForm::PerStep,
            progress: 0.0,
            defence: 0.0,
            cup_scale_m: 0.2,
            proximity: 0.0,
            ball_scale_m: 0.1,
            ball_speed_s_per_m: 0.0,
            approach_per_m: 0.0,
            ball_to_cup_per_m: 0.0,
            collision: 0.0,
            collision_scale_m_per_s: 0.1,
            decay_transitions: 1e7,
        };
        match curriculum {
            Curriculum::Sparse => sparse,
            Curriculum::Motion => Self {
                ball_at_rest: -0.5,
                approach_per_m: 0.5,
                ball_to_cup_per_m: 0.5,
                decay_transitions: 6e6,
                ..sparse
            },
            Curriculum::CollisionOnly => Self { collision: 0.02, ..sparse },
            Curriculum::DenseBallToGoal => Self {
                progress: 0.006,
                defence: 0.006,
                proximity: 0.002,
                ball_speed_s_per_m: 0.004,
                ..sparse
            },
        }
    }

    /// Factor of the shaping after `transitions`, 1 decaying to 0.
    #[must_use]
    pub fn shaping_left(&self, transitions: u64) -> f32 {
        (-(transitions as f64) / self.decay_transitions).exp() as f32
    }

    /// Reward of `step`, with the factor `left` on the shaping.
    #[must_use]
    pub fn of_step(&self, step: &Step<'_>, left: f32) -> f32 {
        self.result(step) + left * self.shaping(step)
    }

    fn result(&self, step: &Step<'_>) -> f32 {
        match step.ended {
            None | Some(Ending::TimeLimit) => 0.0,
            Some(Ending::Goal { scorer }) if scorer == step.player => self.goal_scored,
            Some(Ending::Goal { .. }) => self.goal_conceded,
            Some(Ending::OwnGoal { loser } | Ending::Biscuits { loser })
                if loser == step.player =>
            {
                self.own_goal
            }
            Some(Ending::OwnGoal { .. } | Ending::Biscuits { .. }) => self.opponent_own_goal,
            Some(Ending::BallAtRest { half }) if half == step.player => self.ball_at_rest,
            Some(Ending::BallAtRest { .. }) => 0.0,
        }
    }

    fn shaping(&self, step: &Step<'_>) -> f32 {
        let closeness = match self.form {
            ShapingForm::PerStep => self.closeness(step.seen),
            ShapingForm::Potential => {
                let (before, gamma) = step.potential;
                let runs = matches!(step.ended, None | Some(Ending::TimeLimit));
                let after = if runs { self.closeness(step.seen) } else { 0.0 };
                gamma * after - before
            }
        };
        let seen = step.seen;
        let mut sum = closeness + self.ball_speed_s_per_m * seen[10].hypot(seen[11]);
        if self.approach_per_m != 0.0 {
            let to_ball = [seen[8] - seen[0], seen[9] - seen[1]];
            sum += self.approach_per_m * covered([seen[2], seen[3]], to_ball);
        }
        if self.ball_to_cup_per_m != 0.0 {
            let to_cup = [-seen[8], CUP_DISTANCE as f32 - seen[9]];
            sum += self.ball_to_cup_per_m * covered([seen[10], seen[11]], to_cup);
        }
        if 0.0 < step.hit_speed {
            sum += self.collision * (-self.collision_scale_m_per_s / step.hit_speed).exp();
        }
        sum
    }

    /// Weighted closeness of ball, cups and own striker: the shaping of a step, or the potential,
    /// of the observation `seen`.
    #[must_use]
    pub fn closeness(&self, seen: &[f32]) -> f32 {
        let (own, ball) = ([seen[0], seen[1]], [seen[8], seen[9]]);
        let cup = CUP_DISTANCE as f32;
        let closeness =
            |a: [f32; 2], scale: f32| (-(a[0] - ball[0]).hypot(a[1] - ball[1]) / scale).exp();
        let mut sum = 0.0;
        if self.progress != 0.0 || self.defence != 0.0 {
            sum += self.progress * closeness([0.0, cup], self.cup_scale_m);
            sum -= self.defence * closeness([0.0, -cup], self.cup_scale_m);
        }
        if self.proximity != 0.0 {
            sum += self.proximity * closeness(own, self.ball_scale_m);
        }
        sum
    }

    /// The first invalid value: its name, value, and allowed range.
    pub(super) fn wrong(&self) -> Option<(&'static str, f64, &'static str)> {
        let Self { cup_scale_m, ball_scale_m, collision_scale_m_per_s, decay_transitions, .. } =
            *self;
        let positive = [
            ("reward.cup_scale_m", f64::from(cup_scale_m)),
            ("reward.ball_scale_m", f64::from(ball_scale_m)),
            ("reward.collision_scale_m_per_s", f64::from(collision_scale_m_per_s)),
            ("reward.decay_transitions", decay_transitions),
        ];
        let finite = [
            ("reward.goal_scored", self.goal_scored),
            ("reward.goal_conceded", self.goal_conceded),
            ("reward.own_goal", self.own_goal),
            ("reward.opponent_own_goal", self.opponent_own_goal),
            ("reward.ball_at_rest", self.ball_at_rest),
            ("reward.progress", self.progress),
            ("reward.defence", self.defence),
            ("reward.proximity", self.proximity),
            ("reward.ball_speed_s_per_m", self.ball_speed_s_per_m),
            ("reward.approach_per_m", self.approach_per_m),
            ("reward.ball_to_cup_per_m", self.ball_to_cup_per_m),
            ("reward.collision", self.collision),
        ];
        let positive = positive.into_iter().find(|(_, value)| !(0.0 < *value && value.is_finite()));
        let finite = finite.into_iter().find(|(_, value)| value.is_nan() || 1e6 < value.abs());
        positive
            .map(|(name, value)| (name, value, "above 0"))
            .or(finite.map(|(name, value)| (name, f64::from(value), "from -1e6 to 1e6")))
    }
}

/// Distance (m) covered in one control period along `way` (m) at `velocity` (m/s).
fn covered([vx, vy]: [f32; 2], [x, y]: [f32; 2]) -> f32 {
    let length = x.hypot(y).max(1e-6);
    CONTROL_PERIOD as f32 * (vx * x + vy * y) / length
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Own striker at (0.03, -0.1), ball at (0.03, -0.05) with 0.5 m/s.
    fn seen() -> [f32; 12] {
        let mut seen = [0.0; 12];
        (seen[0], seen[1], seen[8], seen[9]) = (0.03, -0.1, 0.03, -0.05);
        (seen[2], seen[3]) = (0.1, 0.3);
        (seen[10], seen[11]) = (0.3, -0.4);
        seen
    }

    fn step(seen: &[f32], ended: Option<Ending>, hit_speed: f32) -> Step<'_> {
        Step { seen, ended, player: Player::Right, hit_speed, potential: (0.0, 0.99) }
    }

    fn only(change: impl Fn(&mut RewardSettings)) -> RewardSettings {
        let mut settings = RewardSettings::of(Curriculum::Sparse);
        change(&mut settings);
        settings
    }

    #[test]
    fn results_have_their_signs_for_both_players() {
        let seen = seen();
        let resting =
            |curriculum| RewardSettings { ball_at_rest: -0.25, ..RewardSettings::of(curriculum) };
        let settings = resting(Curriculum::DenseBallToGoal);
        let sparse = resting(Curriculum::Sparse);
        let (left, right) = (Player::Left, Player::Right);
        for (ending, of_left, of_right) in [
            (Ending::Goal { scorer: left }, 1.0, -1.0),
            (Ending::Goal { scorer: right }, -1.0, 1.0),
            (Ending::OwnGoal { loser: left }, -1.0, 0.0),
            (Ending::OwnGoal { loser: right }, 0.0, -1.0),
            (Ending::Biscuits { loser: left }, -1.0, 0.0),
            (Ending::TimeLimit, 0.0, 0.0),
            (Ending::BallAtRest { half: left }, -0.25, 0.0),
        ] {
            for (player, expected) in [(left, of_left), (right, of_right)] {
                let potential = (0.0, 0.99);
                let step =
                    Step { seen: &seen, ended: Some(ending), player, hit_speed: 0.0, potential };
                assert_eq!(sparse.of_step(&step, 1.0), expected, "{ending:?} {player}");
                assert_eq!(settings.of_step(&step, 0.0), expected, "{ending:?} {player}");
            }
        }
    }

    #[test]
    fn each_term_is_that_of_a_hand_computed_example() {
        let seen = seen();
        // Distances: other cup (0.03, 0.22) -> 0.222036 m, own cup (0.03, 0.12) -> 0.123693 m,
        // striker 0.05 m; speed 0.5 m/s.
        for (settings, expected) in [
            (only(|s| s.progress = 1.0), 0.329_500), // exp(-0.222036 / 0.2)
            (only(|s| s.defence = 1.0), -0.538_763), // -exp(-0.123693 / 0.2)
            (only(|s| s.proximity = 1.0), 0.606_531), // exp(-0.05 / 0.1)
            (only(|s| s.ball_speed_s_per_m = 1.0), 0.5),
            (only(|s| s.collision = 1.0), 0.367_879), // exp(-0.1 / 0.1)
            // 0.3 m/s of the striker, straight ahead to the ball; 0.02 s.
            (only(|s| s.approach_per_m = 1.0), 0.006),
            // (0.3 (-0.03) + (-0.4) 0.22) / 0.222036 = -0.436866 m/s along the line to the cup.
            (only(|s| s.ball_to_cup_per_m = 1.0), -0.008_737),
        ] {
            let found = settings.of_step(&step(&seen, None, 0.1), 1.0);
            assert!((found - expected).abs() < 2e-5, "{settings:?}: {found} {expected}");
            let faded = settings.of_step(&step(&seen, None, 0.1), 0.25);
            assert!((faded - 0.25 * expected).abs() < 1e-5);
        }
        let none = only(|s| s.collision = 1.0).of_step(&step(&seen, None, 0.0), 1.0);
        assert_eq!(none, 0.0, "no hit, nothing earned");
    }

    #[test]
    fn shaping_fades_over_transitions() {
        let settings = RewardSettings::of(Curriculum::DenseBallToGoal);
        assert_eq!(settings.shaping_left(0), 1.0);
        assert!((settings.shaping_left(10_000_000) - 0.367_879).abs() < 1e-6);
        assert!((settings.shaping_left(20_000_000) - 0.135_335).abs() < 1e-6);
    }

    #[test]
    fn potential_shaping_sums_to_the_difference_of_its_ends() {
        const GAMMA: f32 = 0.9;
        let settings = only(|s| (s.form, s.progress) = (ShapingForm::Potential, 1.0));
        let mut sum = 0.0;
        let rows: Vec<[f32; 12]> = (0..4)
            .map(|step| {
                let mut seen = seen();
                seen[9] += 0.05 * step as f32;
                seen
            })
            .collect();
        let [first, .., last] = [0, 1, 2, 3].map(|row| settings.closeness(&rows[row]));
        for (number, pair) in rows.windows(2).enumerate() {
            let potential = (settings.closeness(&pair[0]), GAMMA);
            let step = Step { potential, ..step(&pair[1], None, 0.0) };
            sum += GAMMA.powi(number as i32) * settings.of_step(&step, 1.0);
        }
        assert!((sum - (GAMMA.powi(3) * last - first)).abs() < 1e-6, "{sum}");
        // A goal ends the sum: the potential afterwards is zero.
        let goal = Some(Ending::Goal { scorer: Player::Right });
        let step = Step { potential: (last, GAMMA), ..step(&rows[3], goal, 0.0) };
        assert!((settings.of_step(&step, 1.0) - (1.0 - last)).abs() < 1e-6);
    }

    #[test]
    fn no_shaping_for_ever_is_worth_a_goal() {
        // Upper bound of every term at once, although a fast ball cannot stay in one position.
        for curriculum in [Curriculum::DenseBallToGoal, Curriculum::CollisionOnly] {
            let s = RewardSettings::of(curriculum);
            let farthest = (-2.0 * CUP_DISTANCE as f32 / s.cup_scale_m).exp();
            // A hit at most every fifth step: back and forth at 0.4 m/s over a ball's diameter.
            let each = s.progress - s.defence * farthest + s.proximity + s.collision / 5.0;
            let speed = 0.5 * s.ball_speed_s_per_m;
            assert!((each + speed) / (1.0 - 0.99) < s.goal_scored, "{curriculum:?} {each}");
        }
    }
}
