//! Safety check of a plan: every sample of every motion, including the moves between runs, is
//! computed and checked before a motor turns.
//!
//! At each sample the carriage's position and its standstill point after braking (`v t + v^2 / (2
//! a)` further, each axis on its own) lie inside the player's soft limits less the tracking margin.
//! Speed and slew are within their limits; the motor speeds are finite. The check is independent of
//! the generation of the motion.

use super::{
    error::{Part, PlanError, Violation},
    plan::{Plan, PlannedRun},
};
use crate::{
    gantry::{
        CoreXy, Limits, Rectangle, Reference, Robot, Sampling, TRANSFER_SLACK_M, TrajectoryError,
    },
    recording::topic::Player,
};

/// Tolerance for rounding: a nanometre, and a fraction of a speed or slew.
const ROUNDING: f64 = 1e-9;

/// Extreme values of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionExtremes {
    /// Largest speed along any direction (m/s).
    pub max_speed_m_per_s: f64,
    /// Largest speed along x and along y (m/s).
    pub max_axis_speed_m_per_s: [f64; 2],
    /// Largest change of the velocity of one axis (m/s^2).
    pub max_acceleration_m_per_s2: f64,
    /// Smallest distance from the edge of the soft limits to the path or to a standstill point (m).
    pub edge_distance_m: f64,
    /// Largest speed of a motor (turns/s).
    pub max_motor_turns_per_s: f64,
}

impl MotionExtremes {
    /// Extremes of a motion without samples.
    const NOTHING: Self = Self {
        max_speed_m_per_s: 0.0,
        max_axis_speed_m_per_s: [0.0; 2],
        max_acceleration_m_per_s2: 0.0,
        edge_distance_m: f64::INFINITY,
        max_motor_turns_per_s: 0.0,
    };

    /// Return the extremes of both motions.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        let (own, new) = (self.max_axis_speed_m_per_s, other.max_axis_speed_m_per_s);
        Self {
            max_speed_m_per_s: self.max_speed_m_per_s.max(other.max_speed_m_per_s),
            max_axis_speed_m_per_s: [own[0].max(new[0]), own[1].max(new[1])],
            max_acceleration_m_per_s2: self
                .max_acceleration_m_per_s2
                .max(other.max_acceleration_m_per_s2),
            edge_distance_m: self.edge_distance_m.min(other.edge_distance_m),
            max_motor_turns_per_s: self.max_motor_turns_per_s.max(other.max_motor_turns_per_s),
        }
    }
}

/// One checked run. It has one motion for each player of the plan, in the same order and of equal
/// length.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedRun {
    planned: PlannedRun,
    approach: Vec<Reference>,
    references: Vec<Reference>,
    extremes: MotionExtremes,
}

impl CheckedRun {
    /// Return the planned run.
    #[must_use]
    pub fn planned(&self) -> &PlannedRun {
        &self.planned
    }

    /// Return the moves to the start.
    #[must_use]
    pub fn approach(&self) -> &[Reference] {
        &self.approach
    }

    /// Return the motions of the run.
    #[must_use]
    pub fn references(&self) -> &[Reference] {
        &self.references
    }

    /// Return the extremes over all players, without the approach.
    #[must_use]
    pub fn extremes(&self) -> &MotionExtremes {
        &self.extremes
    }
}

/// Plan whose motions are all computed and checked. Only [`check_plan`] creates one.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPlan {
    plan: Plan,
    players: Vec<Player>,
    soft_limits: Vec<Rectangle>,
    runs: Vec<CheckedRun>,
    home: Vec<Reference>,
}

impl CheckedPlan {
    /// Return the plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Return the driven players, in the order of all motions.
    #[must_use]
    pub fn players(&self) -> &[Player] {
        &self.players
    }

    /// Return the soft limits of each player's carriage.
    #[must_use]
    pub fn soft_limits(&self) -> &[Rectangle] {
        &self.soft_limits
    }

    /// Return the runs, in order.
    #[must_use]
    pub fn runs(&self) -> &[CheckedRun] {
        &self.runs
    }

    /// Return the moves from the end of the last run to home, one for each player.
    #[must_use]
    pub fn home(&self) -> &[Reference] {
        &self.home
    }

    /// Return the duration of all motions, including moves between runs (s), without the pauses of
    /// the procedure.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let of = |motions: &[Reference]| motions.first().map_or(0.0, Reference::duration_s);
        let runs = self.runs.iter().map(|run| of(&run.approach) + of(&run.references));
        runs.sum::<f64>() + of(&self.home)
    }

    /// Return the extremes of all runs.
    #[must_use]
    pub fn extremes(&self) -> MotionExtremes {
        let all = self.runs.iter().map(|run| run.extremes);
        all.fold(MotionExtremes::NOTHING, MotionExtremes::joined)
    }
}

/// Check every sample of `reference`, which must start and end at rest.
///
/// # Errors
/// The first sample that violates a limit: its time (s) and the violation.
pub fn check_reference(
    reference: &Reference,
    limits: &Limits,
    workspace: &Rectangle,
    gantry: CoreXy,
) -> Result<MotionExtremes, (f64, Violation)> {
    let mut extremes = MotionExtremes::NOTHING;
    let mut before = [0.0; 2];
    let last = reference.setpoints().len().saturating_sub(1);
    for (index, setpoint) in reference.setpoints().iter().enumerate() {
        let [x, y] = setpoint.velocity;
        let stands = limits.standstill(setpoint.position, setpoint.velocity);
        let motors = gantry.motors_from_board(setpoint.velocity);
        let change = (x - before[0]).abs().max((y - before[1]).abs());
        let (near, stop) = (depth(workspace, setpoint.position), depth(workspace, stands));
        let sample = MotionExtremes {
            max_speed_m_per_s: x.hypot(y),
            max_axis_speed_m_per_s: [x.abs(), y.abs()],
            max_acceleration_m_per_s2: change * reference.rate_hz(),
            edge_distance_m: near.min(stop),
            max_motor_turns_per_s: motors.a.abs().max(motors.b.abs()),
        };
        let time = index as f64 * reference.dt();
        violation_of(&sample, [near, stop], limits).map_err(|violation| (time, violation))?;
        if (index == 0 || index == last) && 0.0 < sample.max_speed_m_per_s {
            let speed_m_per_s = sample.max_speed_m_per_s;
            return Err((time, Violation::NotAtRest { speed_m_per_s }));
        }
        before = setpoint.velocity;
        extremes = extremes.joined(sample);
    }
    Ok(extremes)
}

/// Return the distance to the nearest edge (m), positive inside; far outside for a non-finite
/// point.
fn depth(workspace: &Rectangle, point: [f64; 2]) -> f64 {
    if point.iter().all(|part| part.is_finite()) {
        workspace.depth(point)
    } else {
        f64::NEG_INFINITY
    }
}

fn violation_of(
    sample: &MotionExtremes,
    [near, stop]: [f64; 2],
    limits: &Limits,
) -> Result<(), Violation> {
    let within = |value: f64, limit: f64| value <= limit * (1.0 + ROUNDING);
    let margin_m = limits.tracking_margin_m;
    let speed_m_per_s = sample.max_axis_speed_m_per_s[0].max(sample.max_axis_speed_m_per_s[1]);
    let turns = sample.max_motor_turns_per_s;
    if !within(speed_m_per_s, limits.speed_m_per_s) {
        return Err(Violation::AxisSpeed { speed_m_per_s, limit_m_per_s: limits.speed_m_per_s });
    }
    if !within(sample.max_speed_m_per_s, limits.total_speed_m_per_s) {
        let (speed_m_per_s, limit_m_per_s) = (sample.max_speed_m_per_s, limits.total_speed_m_per_s);
        return Err(Violation::TotalSpeed { speed_m_per_s, limit_m_per_s });
    }
    if !within(sample.max_acceleration_m_per_s2, limits.slew_m_per_s2) {
        let (slew_m_per_s2, limit_m_per_s2) =
            (sample.max_acceleration_m_per_s2, limits.slew_m_per_s2);
        return Err(Violation::Slew { slew_m_per_s2, limit_m_per_s2 });
    }
    if !turns.is_finite() {
        return Err(Violation::MotorSpeed { a_turns_per_s: turns, b_turns_per_s: turns });
    }
    if near < margin_m - ROUNDING {
        return Err(Violation::Position { edge_m: near, margin_m });
    }
    if stop < margin_m - ROUNDING {
        return Err(Violation::Standstill { edge_m: stop, margin_m });
    }
    Ok(())
}

/// Compute every motion of `plan` for `players` and check it against the limits of `robot`.
///
/// A player's runs are centred in that player's soft limits. The right player's runs are those of
/// the left rotated by half a turn, as the players face each other. Both move away from the middle
/// of the table at the same time, and each diagonal belongs to the same motor.
///
/// # Errors
/// At the first motion that cannot be generated or violates a limit.
pub fn check_plan(
    plan: &Plan,
    robot: &Robot,
    players: &[Player],
) -> Result<CheckedPlan, PlanError> {
    plan.check()?;
    robot.check()?;
    check_players(robot, players)?;
    let gantry = robot.kinematics()?;
    let provers: Vec<MotionChecker<'_>> =
        players.iter().map(|&player| MotionChecker::new(plan, robot, player, gantry)).collect();
    let mut places: Vec<[f64; 2]> = provers.iter().map(|prover| prover.home).collect();
    let mut runs = Vec::with_capacity(plan.runs.len());
    for planned in &plan.runs {
        let mut run = CheckedRun {
            planned: *planned,
            approach: Vec::new(),
            references: Vec::new(),
            extremes: MotionExtremes::NOTHING,
        };
        for (prover, place) in provers.iter().zip(&mut places) {
            let (reference, extremes) = prover.run(planned)?;
            let start = reference.start().unwrap_or(*place);
            let part = Part::Approach { run: planned.number };
            run.approach.push(prover.transfer(part, *place, start)?);
            *place = reference.end().unwrap_or(start);
            run.references.push(reference);
            run.extremes = run.extremes.joined(extremes);
        }
        run.approach = equally_long(run.approach);
        runs.push(run);
    }
    let home: Result<Vec<Reference>, PlanError> = provers
        .iter()
        .zip(&places)
        .map(|(prover, place)| prover.transfer(Part::Home, *place, prover.home))
        .collect();
    let (plan, players, home) = (plan.clone(), players.to_vec(), equally_long(home?));
    let soft_limits = provers.iter().map(|prover| prover.workspace).collect();
    Ok(CheckedPlan { plan, players, soft_limits, runs, home })
}

fn check_players(robot: &Robot, players: &[Player]) -> Result<(), PlanError> {
    if players.is_empty() {
        return Err(PlanError::NoPlayer);
    }
    for (index, player) in players.iter().enumerate() {
        if !robot.players().contains(player) {
            return Err(PlanError::PlayerWithoutDrives(*player));
        }
        if players[..index].contains(player) {
            return Err(PlanError::PlayerTwice(*player));
        }
    }
    Ok(())
}

/// Pad the moves of all players with rest to the length of the longest.
fn equally_long(motions: Vec<Reference>) -> Vec<Reference> {
    let longest = motions.iter().map(|motion| motion.setpoints().len()).max().unwrap_or(0);
    motions.into_iter().map(|motion| motion.resting_until(longest)).collect()
}

/// Generator and checker of the motions of one player.
struct MotionChecker<'a> {
    plan: &'a Plan,
    limits: &'a Limits,
    player: Player,
    gantry: CoreXy,
    workspace: Rectangle,
    home: [f64; 2],
}

impl<'a> MotionChecker<'a> {
    fn new(plan: &'a Plan, robot: &'a Robot, player: Player, gantry: CoreXy) -> Self {
        let home = robot.home.of(player);
        let (workspace, home) = (robot.soft_limits(player), [home.x_m, home.y_m]);
        Self { plan, limits: &robot.limits, player, gantry, workspace, home }
    }

    fn run(&self, planned: &PlannedRun) -> Result<(Reference, MotionExtremes), PlanError> {
        let PlannedRun { number, pattern, samples, .. } = *planned;
        let part = Part::Run { run: number, pattern };
        let inner = self.workspace.shrunk(self.limits.tracking_margin_m + TRANSFER_SLACK_M);
        let (rate_hz, seed) = (self.plan.rate_hz, self.plan.seed_of(number));
        let reference = pattern
            .reference(&inner, self.limits, &Sampling { rate_hz, samples, seed })
            .map_err(|source| self.cannot_make(part, source))?;
        let reference = match self.player {
            Player::Left => reference,
            Player::Right => reference.turned_about(self.workspace.centre()),
        };
        let extremes = self.check(part, &reference)?;
        Ok((reference, extremes))
    }

    fn transfer(&self, part: Part, from: [f64; 2], to: [f64; 2]) -> Result<Reference, PlanError> {
        let reference = Reference::transfer(from, to, self.limits, self.plan.rate_hz)
            .map_err(|source| self.cannot_make(part, source))?;
        self.check(part, &reference)?;
        Ok(reference)
    }

    fn cannot_make(&self, part: Part, source: TrajectoryError) -> PlanError {
        PlanError::Trajectory { part, player: self.player, source: Box::new(source) }
    }

    fn check(&self, part: Part, reference: &Reference) -> Result<MotionExtremes, PlanError> {
        check_reference(reference, self.limits, &self.workspace, self.gantry).map_err(
            |(time_s, violation)| PlanError::Violation {
                part,
                player: self.player,
                time_s,
                violation,
            },
        )
    }
}

#[cfg(test)]
mod tests;
