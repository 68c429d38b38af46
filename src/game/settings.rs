//! Settings of a game with their sources.

use super::{
    actuation::Actuation,
    error::{GameError, within},
    randomization::Randomization,
    sensing::SensorSettings,
};
use crate::{
    actuator::Coverage,
    board::{BoardSize, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    effects::{self, Axis},
    gantry::{PerPlayer, Rectangle, Robot},
    recording::topic::Player,
    twin::{Instance, Source, Twin},
};

/// Control period (s): 50 Hz, as in the table's controller and upstream's simulator.
pub const CONTROL_PERIOD: f64 = 0.02;

/// Settings of a game: objects on the board, actuators, and rules.
#[derive(Debug, Clone)]
pub struct GameSettings {
    /// Size of the playing field.
    pub board: BoardSize,
    /// The ball.
    pub ball: BallSettings,
    /// The strikers.
    pub striker: StrikerSettings,
    /// The two cups.
    pub cup: CupSettings,
    /// Limits on commands before they reach a drive.
    pub limits: CommandLimits,
    /// Actuator model.
    pub actuation: Actuation,
    /// Coverage of a learned actuator's training data; with it, extrapolating queries are counted
    /// ([`super::Games::queries`]). `None` by default.
    pub coverage: Option<Coverage>,
    /// Start of an episode, and its end without a winner.
    pub episode: EpisodeSettings,
    /// The three biscuits; `None` by default, as in the paper's experiments.
    pub biscuits: Option<BiscuitSettings>,
    /// Domain randomization; `None` by default.
    pub randomization: Option<Randomization>,
    /// Camera and state estimator of the players; `None` by default: exact and current.
    pub sensors: Option<SensorSettings>,
    /// Number of pieces of a control period, 1 to 40; 4 by default. Within a piece all bodies move
    /// on straight lines and every contact is solved; more pieces follow curved paths more closely.
    /// A period without a possible contact is always one piece.
    pub pieces: usize,
}

impl Default for GameSettings {
    fn default() -> Self {
        Self {
            board: BoardSize::default(),
            ball: BallSettings::default(),
            striker: StrikerSettings::default(),
            cup: CupSettings::default(),
            limits: CommandLimits::default(),
            actuation: Actuation::Ideal,
            coverage: None,
            episode: EpisodeSettings::default(),
            biscuits: None,
            randomization: None,
            sensors: None,
            pieces: 4,
        }
    }
}

/// The ball: its mass and the effects of the catalogue that act on it.
#[derive(Debug, Clone, PartialEq)]
pub struct BallSettings {
    /// Mass (kg); 0.0017, upstream's nominal value.
    pub mass: f64,
    /// Effects between impacts and at the walls: rolling, sliding, restitution, friction, positions
    /// of the walls. Default: `ball.rolling_resistance` of the plain twin,
    /// `impact.wall_restitution` 0.85 and `impact.wall_friction_spin` 0.09. These are the means of
    /// ball (0.8; 0.12) and board (0.9; 0.06) in upstream's simulator.
    pub effects: Vec<Instance>,
    /// Effects of an impact on a striker. Default: 0.75 and 0.09, the means of ball and striker
    /// (0.7; 0.06).
    pub striker_effects: Vec<Instance>,
    /// Ratio of static to kinetic friction, at least 1; 1.5, as for all pairs of upstream's
    /// simulator. An impact whose sliding static friction can end does not slide on.
    pub static_friction_ratio: f64,
}

impl Default for BallSettings {
    fn default() -> Self {
        Self {
            mass: 0.0017,
            effects: instances(&[
                ("ball.rolling_resistance", &[0.01, 0.0]),
                ("impact.wall_restitution", &[0.85]),
                ("impact.wall_friction_spin", &[0.09, 0.0]),
            ]),
            striker_effects: instances(&[
                ("impact.wall_restitution", &[0.75]),
                ("impact.wall_friction_spin", &[0.09, 0.0]),
            ]),
            static_friction_ratio: 1.5,
        }
    }
}

/// Whole-board instances of effects by name; an unknown name is left out.
pub(super) fn instances(entries: &[(&str, &[f64])]) -> Vec<Instance> {
    let of = |(name, values): &(&str, &[f64])| {
        let effect = effects::find(name)?;
        Some(Instance::new(effect, Axis::Whole, values, Source::Nominal))
    };
    entries.iter().filter_map(of).collect()
}

/// A striker and its magnetic coupling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrikerSettings {
    /// Mass above the board (kg); 0.012, from the table's CAD model.
    pub mass: f64,
    /// Natural angular frequency of the striker on its magnet (rad/s). 39.5: the paper's lag of 4
    /// mm in reversals at its mean acceleration of 6.25 m/s^2, sqrt(6.25 / 0.004).
    pub magnet_frequency: f64,
    /// Damping ratio of that motion; 0.7, an estimate (grease under the striker).
    pub magnet_damping: f64,
    /// Coulomb friction on the board (N); 0.
    pub friction: f64,
}

impl StrikerSettings {
    /// The same striker with the mass of `twin`, and with stiffness, damping and friction of its coupling where it has
    /// one.
    fn on_the_magnet_of(mut self, twin: &Twin) -> Self {
        self.mass = twin.striker_mass;
        let coupling = ["coupling.magnet_spring", "coupling.striker_friction"]
            .iter()
            .find_map(|name| twin.instance(name, Axis::Whole));
        if let Some(coupling) = coupling {
            let of = |name| coupling.value(name).unwrap_or_default();
            self.magnet_frequency = (of("stiffness_n_per_m") / self.mass).sqrt();
            self.magnet_damping = of("damping_ratio");
            self.friction = of("force_n");
        }
        self
    }
}

impl Default for StrikerSettings {
    fn default() -> Self {
        Self { mass: 0.012, magnet_frequency: 39.5, magnet_damping: 0.7, friction: 0.0 }
    }
}

/// Capture rule of a cup.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CupRule {
    /// The ball falls while its centre is over the cup. It leaves the cup if it hits the far rim
    /// high and fast enough.
    Fall,
    /// Rule of upstream's simulator: every ball at most this fast (m/s) whose centre is over the
    /// cup is captured; faster ones pass. Upstream: 5 m/s.
    SlowerThan(f64),
}

/// Striker whose centre is over its own cup.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StrikerOverCup {
    /// It falls: the episode ends with an own goal, as in upstream's simulator.
    Falls,
    /// It goes on, as on the virtual rig. The referee of a recorded match calls an own goal when it
    /// stays there.
    Passes,
}

/// A goal cup.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CupSettings {
    /// Radius (m).
    pub radius: f64,
    /// Distance of the centre from the middle of the board, along y (m).
    pub distance: f64,
    /// Capture rule.
    pub rule: CupRule,
    /// Striker over its own cup.
    pub striker: StrikerOverCup,
}

impl Default for CupSettings {
    fn default() -> Self {
        Self {
            radius: CUP_RADIUS,
            distance: CUP_DISTANCE,
            rule: CupRule::Fall,
            striker: StrikerOverCup::Falls,
        }
    }
}

/// Point of action of the wall limiter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimiterPlace {
    /// The command, before the drive: as on the table.
    Command,
    /// The velocity behind an ideal or learned actuator: as in upstream's newer simulator.
    Motion,
}

/// Limits on commands before they reach a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandLimits {
    /// Maximum speed along each axis (m/s); [`DEFAULT_SPEED`](Self::DEFAULT_SPEED).
    pub speed: f64,
    /// Slew limit along each axis (m/s^2); 10, upstream's simulator.
    pub slew: f64,
    /// Deceleration distance of the wall limiter (m); 0.09.
    pub deceleration_distance: f64,
    /// Clearance at which the wall limiter blocks (m); 0.0135, 1.8 radii of the striker.
    pub clearance: f64,
    /// Workspaces of the carriages; by default those of upstream's simulator, one the copy of the
    /// other turned by 180 degrees: x within 0.16 m, y from 0.02 to 0.21 m.
    pub field: PerPlayer<Rectangle>,
    /// Point of action of the wall limiter.
    pub limiter: LimiterPlace,
}

impl CommandLimits {
    /// Default maximum speed along each axis (m/s).
    pub const DEFAULT_SPEED: f64 = 0.4;
}

impl Default for CommandLimits {
    fn default() -> Self {
        let field =
            |y_min_m, y_max_m| Rectangle { x_min_m: -0.16, x_max_m: 0.16, y_min_m, y_max_m };
        Self {
            speed: Self::DEFAULT_SPEED,
            slew: 10.0,
            deceleration_distance: 0.09,
            clearance: 0.0135,
            field: PerPlayer { left: field(-0.21, -0.02), right: field(0.02, 0.21) },
            limiter: LimiterPlace::Command,
        }
    }
}

/// Start of an episode, and its end without a winner. Source: events of upstream's simulator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeSettings {
    /// Time limit (s); 10.
    pub time_limit: f64,
    /// Rest time of the ball after which an episode ends without a winner (s); 2. Upstream waits
    /// for the time limit, although on half of its board no player can reach the ball any more.
    pub still_limit: f64,
    /// Maximum |x| of strikers (m); 0.1.
    pub striker_x: f64,
    /// Range of the distance of strikers from the middle along y (m); 0.03 to 0.14.
    pub striker_y: [f64; 2],
    /// Maximum |x| of the ball (m); 0.15.
    pub ball_x: f64,
    /// Range of |y| of the ball (m); 0.03 to 0.1. Upstream draws from 0 on, but behind the wall
    /// limiter no striker reaches a ball that is nearer to the middle.
    pub ball_y: [f64; 2],
    /// Fraction of the episodes that begin with a moving ball, 0 to 1; 0. Training with moving
    /// balls shows a policy more of what it meets in a rally.
    pub moving_fraction: f64,
    /// Fraction of the episodes, beyond the half that chance gives, that serve into the half of one
    /// seat: left on boards of even number, right on the others; -1 to 1; 0. Training seats the
    /// learner so: no opponent that never returns a ball from its half then wastes an episode.
    pub served_fraction: f64,
    /// Fraction of the episodes that begin with one striker close behind the ball on its line to
    /// the other cup, 0 to 1; 0. The fraction counts draws: a start that would put the striker over
    /// its own cup stays as it was.
    pub aligned_fraction: f64,
    /// Fraction of the episodes after a goal or a time limit in which the players go on from where
    /// they are, as in a match, and only the ball is put back; 0 to 1; 0.
    pub continued_fraction: f64,
    /// Maximum speed of a moving ball at the start (m/s), drawn uniformly, as is the direction; 1.
    pub ball_speed: f64,
}

impl Default for EpisodeSettings {
    fn default() -> Self {
        Self {
            time_limit: 10.0,
            still_limit: 2.0,
            striker_x: 0.1,
            striker_y: [0.03, 0.14],
            ball_x: 0.15,
            ball_y: [0.03, 0.1],
            moving_fraction: 0.0,
            served_fraction: 0.0,
            aligned_fraction: 0.0,
            continued_fraction: 0.0,
            ball_speed: 1.0,
        }
    }
}

/// The three biscuits on the centre line. No source gives their parameters: all are estimates from
/// the size of the commercial game's pieces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiscuitSettings {
    /// Radius (m); 0.006.
    pub radius: f64,
    /// Mass (kg); 0.001.
    pub mass: f64,
    /// Distance of centres at which a striker's magnet captures a biscuit (m); 0.02.
    pub capture_distance: f64,
    /// Friction coefficient on the board; 0.2.
    pub friction: f64,
    /// Distance between neighbours on the centre line (m); 0.08, a quarter of the short side.
    pub spacing: f64,
}

impl Default for BiscuitSettings {
    fn default() -> Self {
        Self { radius: 0.006, mass: 0.001, capture_distance: 0.02, friction: 0.2, spacing: 0.08 }
    }
}

impl GameSettings {
    /// The same game with the actuators of `twin`, with its magnetic coupling of the striker, and with its ball and
    /// walls where recordings have determined one of their parameters. Wall effects that such a twin lacks are removed;
    /// restitution and friction of impacts on strikers stay as they are, since a twin does not describe them.
    #[must_use]
    pub fn with_twin(mut self, twin: &Twin) -> Self {
        let of_ball = || twin.instances.iter().filter(|own| own.effect.physics.acts_on_ball());
        let is_known = |own: &Instance| own.values.iter().any(|own| own.source != Source::Nominal);
        if of_ball().any(is_known) {
            self.ball.effects = of_ball().cloned().collect();
        }
        self.striker = self.striker.on_the_magnet_of(twin);
        self.actuation = Actuation::twin(twin.clone());
        self
    }

    /// The same game within the workspaces and the clearance of `robot`, whose halves may differ.
    #[must_use]
    pub fn within_robot(mut self, robot: &Robot) -> Self {
        self.limits.field = robot.workspace;
        self.limits.clearance = robot.clearance_m;
        self
    }

    /// Maximum number of control periods in an episode.
    #[must_use]
    pub fn most_steps(&self) -> u32 {
        periods(self.episode.time_limit)
    }

    /// Number of control periods for which the ball may be at rest.
    #[must_use]
    pub fn most_still_steps(&self) -> u32 {
        periods(self.episode.still_limit)
    }

    /// Check that every value is in its range.
    ///
    /// # Errors
    /// The first value outside its range.
    pub fn check(&self) -> Result<(), GameError> {
        let Self { board, ball, striker, cup, limits, episode, .. } = self;
        within("board.short_side_m", board.short_side, 0.1, 10.0)?;
        within("board.long_side_m", board.long_side, 0.1, 10.0)?;
        within("pieces", self.pieces as f64, 1.0, 40.0)?;
        within("ball.mass_kg", ball.mass, 1e-5, 1.0)?;
        within("ball.static_friction_ratio", ball.static_friction_ratio, 1.0, 10.0)?;
        within("striker.mass_kg", striker.mass, 1e-4, 10.0)?;
        within("striker.magnet_frequency_rad_per_s", striker.magnet_frequency, 1.0, 1e4)?;
        within("striker.magnet_damping", striker.magnet_damping, 0.0, 30.0)?;
        within("striker.friction_n", striker.friction, 0.0, 20.0)?;
        within("cup.radius_m", cup.radius, 1e-3, board.short_side / 2.0)?;
        within("cup.distance_m", cup.distance, cup.radius, board.long_side / 2.0 - cup.radius)?;
        if let CupRule::SlowerThan(speed) = cup.rule {
            within("cup.rule speed_m_per_s", speed, 0.0, 1e3)?;
        }
        within("limits.speed_m_per_s", limits.speed, 1e-3, 5.0)?;
        within("limits.slew_m_per_s2", limits.slew, 1e-2, 1e6)?;
        within("limits.deceleration_distance_m", limits.deceleration_distance, 1e-3, 1.0)?;
        within("limits.clearance_m", limits.clearance, 0.0, 0.1)?;
        within("episode.time_limit_s", episode.time_limit, CONTROL_PERIOD, 3600.0)?;
        within("episode.still_limit_s", episode.still_limit, CONTROL_PERIOD, 3600.0)?;
        self.check_fields()?;
        self.check_start()?;
        if let Some(biscuits) = &self.biscuits {
            biscuits.check(board)?;
        }
        if let Some(randomization) = &self.randomization {
            randomization.check()?;
        }
        if let Some(sensors) = &self.sensors {
            sensors.check()?;
        }
        self.actuation.check(limits.limiter)
    }

    /// Check that both carriages have room on the board.
    fn check_fields(&self) -> Result<(), GameError> {
        let half = [self.board.short_side / 2.0, self.board.long_side / 2.0];
        let room = |low: f64, high: f64, half: f64| {
            let edge = half - STRIKER_RADIUS;
            // Not max and min, which would hide a NaN.
            high.clamp(-edge, edge) - low.clamp(-edge, edge)
        };
        for player in Player::BOTH {
            let field = self.limits.field.of(player);
            let (x, y) = (
                room(field.x_min_m, field.x_max_m, half[0]),
                room(field.y_min_m, field.y_max_m, half[1]),
            );
            within("limits.field: room on the board across, in m", x, 0.0, 10.0)?;
            within("limits.field: room on the board along, in m", y, 0.0, 10.0)?;
        }
        Ok(())
    }

    fn check_start(&self) -> Result<(), GameError> {
        let Self { board, episode, .. } = self;
        let half = [board.short_side / 2.0, board.long_side / 2.0];
        let radius = STRIKER_RADIUS;
        within("episode.striker_x_m", episode.striker_x, 0.0, half[0] - radius)?;
        let [near, far] = episode.striker_y;
        within("episode.striker_y_m[0]", near, radius, half[1] - radius)?;
        within("episode.striker_y_m[1]", far, radius, half[1] - radius)?;
        if far < near {
            return Err(GameError::Range { name: "episode.striker_y_m", low: near, high: far });
        }
        within("episode.ball_x_m", episode.ball_x, 0.0, half[0] - crate::board::BALL_RADIUS)?;
        let [near, far] = episode.ball_y;
        within("episode.ball_y_m[1]", far, 0.0, self.cup.distance - self.cup.radius)?;
        within("episode.ball_y_m[0]", near, 0.0, far)?;
        within("episode.moving_fraction", episode.moving_fraction, 0.0, 1.0)?;
        within("episode.served_fraction", episode.served_fraction, -1.0, 1.0)?;
        within("episode.aligned_fraction", episode.aligned_fraction, 0.0, 1.0)?;
        within("episode.continued_fraction", episode.continued_fraction, 0.0, 1.0)?;
        within("episode.ball_speed_m_per_s", episode.ball_speed, 0.0, 10.0)
    }
}

/// Number of control periods in `seconds`, at least one.
fn periods(seconds: f64) -> u32 {
    (seconds / CONTROL_PERIOD).round().max(1.0) as u32
}

impl BiscuitSettings {
    fn check(&self, board: &BoardSize) -> Result<(), GameError> {
        within("biscuits.radius_m", self.radius, 1e-3, 0.05)?;
        within("biscuits.mass_kg", self.mass, 1e-5, 1.0)?;
        within("biscuits.capture_distance_m", self.capture_distance, 0.0, 0.2)?;
        within("biscuits.friction", self.friction, 0.0, 10.0)?;
        let widest = board.short_side / 2.0 - self.radius;
        within("biscuits.spacing_m", self.spacing, 2.0 * self.radius, widest)
    }
}
