//! The proof that a plan may be driven: every sample of every motion, moves between runs included,
//! computed and checked before a motor turns.
//!
//! At each sample the carriage's position, and the point where it would come to stand if it braked
//! now (`v t + v^2 / (2 a)` further, each axis on its own), lie inside the player's window by the
//! tracking margin; speed and slew are within their limits; the motor speeds are numbers. The check
//! knows nothing of how the motion was made.

use super::{
    error::{Breach, Part, PlanError},
    plan::{Plan, PlannedRun},
};
use crate::{
    gantry::{
        CoreXy, Limits, Rectangle, Reference, Robot, Sampling, TRANSFER_SLACK_M, TrajectoryError,
    },
    recording::topic::Player,
};

/// Rounding that a check forgives: a nanometre, and as share of a speed or slew.
const ROUNDING: f64 = 1e-9;

/// Extremes of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Largest speed along any direction (m/s).
    pub max_speed_m_per_s: f64,
    /// Largest speed along x and along y (m/s).
    pub max_axis_speed_m_per_s: [f64; 2],
    /// Largest change of the velocity of one axis (m/s^2).
    pub max_acceleration_m_per_s2: f64,
    /// Smallest distance from the window's edge to the path or to a point of standstill (m).
    pub edge_distance_m: f64,
    /// Largest speed of a motor (turns/s).
    pub max_motor_turns_per_s: f64,
}

impl Figures {
    /// Of a motion that has no sample.
    const NOTHING: Self = Self {
        max_speed_m_per_s: 0.0,
        max_axis_speed_m_per_s: [0.0; 2],
        max_acceleration_m_per_s2: 0.0,
        edge_distance_m: f64::INFINITY,
        max_motor_turns_per_s: 0.0,
    };

    /// The extremes of both motions.
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

/// One run, ready to be driven; motions are one for each player of the proof, in its order, and
/// equally long.
#[derive(Debug, Clone, PartialEq)]
pub struct ProvenRun {
    planned: PlannedRun,
    approach: Vec<Reference>,
    references: Vec<Reference>,
    figures: Figures,
}

impl ProvenRun {
    /// What was planned.
    #[must_use]
    pub fn planned(&self) -> &PlannedRun {
        &self.planned
    }

    /// The moves to the start.
    #[must_use]
    pub fn approach(&self) -> &[Reference] {
        &self.approach
    }

    /// The run itself.
    #[must_use]
    pub fn references(&self) -> &[Reference] {
        &self.references
    }

    /// Extremes over all players, without the approach.
    #[must_use]
    pub fn figures(&self) -> &Figures {
        &self.figures
    }
}

/// A plan with every motion computed and checked. Only [`prove`] makes one.
#[derive(Debug, Clone, PartialEq)]
pub struct Proof {
    plan: Plan,
    players: Vec<Player>,
    windows: Vec<Rectangle>,
    runs: Vec<ProvenRun>,
    home: Vec<Reference>,
}

impl Proof {
    /// What was proven.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Who is driven, in the order of all motions.
    #[must_use]
    pub fn players(&self) -> &[Player] {
        &self.players
    }

    /// Where each player's carriage may be.
    #[must_use]
    pub fn windows(&self) -> &[Rectangle] {
        &self.windows
    }

    /// The runs, in order.
    #[must_use]
    pub fn runs(&self) -> &[ProvenRun] {
        &self.runs
    }

    /// From the end of the last run home, one for each player.
    #[must_use]
    pub fn home(&self) -> &[Reference] {
        &self.home
    }

    /// Duration of everything, moves between runs included (s); pauses of the procedure come on top.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let of = |motions: &[Reference]| motions.first().map_or(0.0, Reference::duration_s);
        let runs = self.runs.iter().map(|run| of(&run.approach) + of(&run.references));
        runs.sum::<f64>() + of(&self.home)
    }

    /// Extremes of all runs.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let all = self.runs.iter().map(|run| run.figures);
        all.fold(Figures::NOTHING, Figures::joined)
    }
}

/// Checks every sample of `reference`, which must start and end at rest.
///
/// # Errors
/// The first sample that passes a limit: its time (s) and the breach.
pub fn check_reference(
    reference: &Reference,
    limits: &Limits,
    window: &Rectangle,
    gantry: CoreXy,
) -> Result<Figures, (f64, Breach)> {
    let mut figures = Figures::NOTHING;
    let mut before = [0.0; 2];
    let last = reference.setpoints().len().saturating_sub(1);
    for (index, setpoint) in reference.setpoints().iter().enumerate() {
        let [x, y] = setpoint.velocity;
        let stands = limits.standstill(setpoint.position, setpoint.velocity);
        let motors = gantry.motors_from_board(setpoint.velocity);
        let change = (x - before[0]).abs().max((y - before[1]).abs());
        let (near, stop) = (depth(window, setpoint.position), depth(window, stands));
        let sample = Figures {
            max_speed_m_per_s: x.hypot(y),
            max_axis_speed_m_per_s: [x.abs(), y.abs()],
            max_acceleration_m_per_s2: change * reference.rate_hz(),
            edge_distance_m: near.min(stop),
            max_motor_turns_per_s: motors.a.abs().max(motors.b.abs()),
        };
        let time = index as f64 * reference.dt();
        breach_of(&sample, [near, stop], limits).map_err(|breach| (time, breach))?;
        if (index == 0 || index == last) && 0.0 < sample.max_speed_m_per_s {
            let speed_m_per_s = sample.max_speed_m_per_s;
            return Err((time, Breach::NotAtRest { speed_m_per_s }));
        }
        before = setpoint.velocity;
        figures = figures.joined(sample);
    }
    Ok(figures)
}

/// How far inside (m); far outside for what is no number.
fn depth(window: &Rectangle, point: [f64; 2]) -> f64 {
    if point.iter().all(|part| part.is_finite()) { window.depth(point) } else { f64::NEG_INFINITY }
}

fn breach_of(sample: &Figures, [near, stop]: [f64; 2], limits: &Limits) -> Result<(), Breach> {
    let within = |value: f64, limit: f64| value <= limit * (1.0 + ROUNDING);
    let margin_m = limits.tracking_margin_m;
    let speed_m_per_s = sample.max_axis_speed_m_per_s[0].max(sample.max_axis_speed_m_per_s[1]);
    let turns = sample.max_motor_turns_per_s;
    if !within(speed_m_per_s, limits.speed_m_per_s) {
        return Err(Breach::AxisSpeed { speed_m_per_s, limit_m_per_s: limits.speed_m_per_s });
    }
    if !within(sample.max_speed_m_per_s, limits.total_speed_m_per_s) {
        let (speed_m_per_s, limit_m_per_s) = (sample.max_speed_m_per_s, limits.total_speed_m_per_s);
        return Err(Breach::TotalSpeed { speed_m_per_s, limit_m_per_s });
    }
    if !within(sample.max_acceleration_m_per_s2, limits.slew_m_per_s2) {
        let (slew_m_per_s2, limit_m_per_s2) =
            (sample.max_acceleration_m_per_s2, limits.slew_m_per_s2);
        return Err(Breach::Slew { slew_m_per_s2, limit_m_per_s2 });
    }
    if !turns.is_finite() {
        return Err(Breach::MotorSpeed { a_turns_per_s: turns, b_turns_per_s: turns });
    }
    if near < margin_m - ROUNDING {
        return Err(Breach::Position { edge_m: near, margin_m });
    }
    if stop < margin_m - ROUNDING {
        return Err(Breach::Standstill { edge_m: stop, margin_m });
    }
    Ok(())
}

/// Computes every motion of `plan` for `players` and checks it against the limits of `robot`.
///
/// A player's runs lie in the middle of that player's own window. The right player's are those of
/// the left turned by half a turn, as the players face each other: both move away from the middle
/// of the table at the same time, and each diagonal is that of the same motor.
///
/// # Errors
/// At the first motion that cannot be made or passes a limit.
pub fn prove(plan: &Plan, robot: &Robot, players: &[Player]) -> Result<Proof, PlanError> {
    plan.check()?;
    robot.check()?;
    check_players(robot, players)?;
    let gantry = robot.kinematics()?;
    let provers: Vec<Prover<'_>> =
        players.iter().map(|&player| Prover::new(plan, robot, player, gantry)).collect();
    let mut places: Vec<[f64; 2]> = provers.iter().map(|prover| prover.home).collect();
    let mut runs = Vec::with_capacity(plan.runs.len());
    for planned in &plan.runs {
        let mut run = ProvenRun {
            planned: *planned,
            approach: Vec::new(),
            references: Vec::new(),
            figures: Figures::NOTHING,
        };
        for (prover, place) in provers.iter().zip(&mut places) {
            let (reference, figures) = prover.run(planned)?;
            let start = reference.start().unwrap_or(*place);
            let part = Part::Approach { run: planned.number };
            run.approach.push(prover.transfer(part, *place, start)?);
            *place = reference.end().unwrap_or(start);
            run.references.push(reference);
            run.figures = run.figures.joined(figures);
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
    let windows = provers.iter().map(|prover| prover.window).collect();
    Ok(Proof { plan, players, windows, runs, home })
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

/// The moves of all players, each resting at its end until the longest is over.
fn equally_long(motions: Vec<Reference>) -> Vec<Reference> {
    let longest = motions.iter().map(|motion| motion.setpoints().len()).max().unwrap_or(0);
    motions.into_iter().map(|motion| motion.resting_until(longest)).collect()
}

/// Makes and checks the motions of one player.
struct Prover<'a> {
    plan: &'a Plan,
    limits: &'a Limits,
    player: Player,
    gantry: CoreXy,
    window: Rectangle,
    home: [f64; 2],
}

impl<'a> Prover<'a> {
    fn new(plan: &'a Plan, robot: &'a Robot, player: Player, gantry: CoreXy) -> Self {
        let home = robot.home.of(player);
        let (window, home) = (robot.window(player), [home.x_m, home.y_m]);
        Self { plan, limits: &robot.limits, player, gantry, window, home }
    }

    fn run(&self, planned: &PlannedRun) -> Result<(Reference, Figures), PlanError> {
        let PlannedRun { number, pattern, samples, .. } = *planned;
        let part = Part::Run { run: number, pattern };
        let inner = self.window.shrunk(self.limits.tracking_margin_m + TRANSFER_SLACK_M);
        let (rate_hz, seed) = (self.plan.rate_hz, self.plan.seed_of(number));
        let reference = pattern
            .reference(&inner, self.limits, &Sampling { rate_hz, samples, seed })
            .map_err(|source| self.cannot_make(part, source))?;
        let reference = match self.player {
            Player::Left => reference,
            Player::Right => reference.turned_about(self.window.centre()),
        };
        let figures = self.check(part, &reference)?;
        Ok((reference, figures))
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

    fn check(&self, part: Part, reference: &Reference) -> Result<Figures, PlanError> {
        check_reference(reference, self.limits, &self.window, self.gantry).map_err(
            |(time_s, breach)| PlanError::Breach { part, player: self.player, time_s, breach },
        )
    }
}

#[cfg(test)]
mod tests;
