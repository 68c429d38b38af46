//! Equations of the effects: where each acts in the measured chain, and the state that it receives.

use super::{
    elastic_load::{ElasticLoad, Resonance},
    expression::{Expression, Place},
};
use crate::lanes::Lanes;
use pulp::Scalar;

/// State of the perpendicular coordinate.
#[derive(Debug, Clone, Copy, Default)]
pub struct CrossMotion {
    /// Position (m).
    pub position: f64,
    /// Velocity (m/s).
    pub velocity: f64,
    /// Acceleration over the last step (m/s^2).
    pub acceleration: f64,
    /// Drive force (N).
    pub force: f64,
}

/// State of one coordinate during one step: a belt (a, b), an axis (x, y) or a single axis.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motion {
    /// Index of the coordinate: 0 for a or x, 1 for b or y.
    pub index: usize,
    /// Time since the session began (s).
    pub time: f64,
    /// Time at which the run began, since the session began (s).
    pub run_start_time: f64,
    /// How far the measured position is ahead of `position` (m): a simulated position drifts by more than the period of
    /// a ripple, which follows the rotor. Zero where nothing was measured.
    pub measured_ahead: f64,
    /// Position as it was recorded at which `position` is zero (m).
    pub position_origin: f64,
    /// Turns of the motor per metre of belt (1/m). Zero where no belt is known.
    pub turns_per_metre: f64,
    /// Length of the step (s).
    pub dt: f64,
    /// Position (m).
    pub position: f64,
    /// Velocity (m/s).
    pub velocity: f64,
    /// Acceleration over the last step (m/s^2).
    pub acceleration: f64,
    /// Drive force along this coordinate (N).
    pub force: f64,
    /// Moving mass along this coordinate (kg).
    pub mass: f64,
    /// The perpendicular coordinate: b for a, y for x, and vice versa.
    pub other: CrossMotion,
}

impl Motion {
    /// Position on which the phase of a ripple depends (m): the measured one where there is one.
    #[must_use]
    pub fn phase_position(&self) -> f64 {
        self.position + self.measured_ahead
    }
}

/// Force that repeats along the way: A sin(k q) + B cos(k q).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Amplitude A of the sine (N).
    pub sine: f64,
    /// Amplitude B of the cosine (N).
    pub cosine: f64,
    /// Angle k per way (rad/m).
    pub per_metre: f64,
}

impl Wave {
    /// Force (N) in this motion.
    #[must_use]
    pub fn force(&self, motion: &Motion) -> f64 {
        let angle = self.per_metre * motion.phase_position();
        let (sine, cosine) = Lanes::splat(Scalar, angle).sin_cos();
        self.sine * sine.get(0) + self.cosine * cosine.get(0)
    }
}

/// Bristle model of the dry friction that elastic contacts carry (LuGre).
///
/// The force is `-F z - c d z'` with the deflection `z' = (v - h(v) z) / d` and `h(v) = |v| / tanh(|v| / v0)`.
/// The stiffness is `F / d`, the damping `c`. Below the speed `v0` the level decreases towards rest, as in
/// lubricated contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristles {
    /// Sliding friction (N).
    pub force: f64,
    /// Presliding distance (m), positive.
    pub distance: f64,
    /// Speed below which the contacts creep (m/s), positive.
    pub velocity: f64,
    /// Damping of the deflection (N s/m).
    pub damping: f64,
}

impl Bristles {
    /// Relaxation speed of the deflection (m/s): the speed of the motion, and the creep speed at rest.
    #[must_use]
    pub fn pace(&self, velocity: f64) -> f64 {
        let ratio = velocity.abs() / self.velocity;
        if ratio < 1e-6 { self.velocity } else { velocity.abs() / ratio.tanh() }
    }

    /// Deflection after `dt` seconds at a constant `velocity`, from the deflection `bend`.
    #[must_use]
    pub fn bent(&self, bend: f64, velocity: f64, dt: f64) -> f64 {
        let pace = self.pace(velocity);
        let end = velocity / pace;
        end + (bend - end) * (-pace * dt / self.distance).exp()
    }

    /// Force (N) against the motion at the deflection `bend` and its `rate` (1/s).
    #[must_use]
    pub fn pull(&self, bend: f64, rate: f64) -> f64 {
        self.force * bend + self.damping * self.distance * rate
    }

    /// The same contacts under `ratio` times the dry friction: equal stiffness.
    #[must_use]
    pub fn scaled(self, ratio: f64) -> Self {
        Self { force: ratio * self.force, distance: ratio * self.distance, ..self }
    }

    /// The same contacts with at most `level` of dry friction (N): equal stiffness, shorter presliding distance.
    #[must_use]
    pub fn held_to(self, level: f64) -> Self {
        if self.force <= level {
            return self;
        }
        Self {
            force: level,
            distance: (self.distance * level / self.force).max(f64::MIN_POSITIVE),
            ..self
        }
    }
}

/// Gap between a motor and its load, which moves freely within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Width (m).
    pub width: f64,
    /// Deceleration of the load within the gap by its own friction (m/s^2).
    pub deceleration: f64,
}

/// Elastic transmission between a motor and its load, in metres and newtons of belt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// Stiffness (N/m), positive.
    pub stiffness: f64,
    /// Damping ratio of the load on the spring.
    pub damping_ratio: f64,
    /// Mass of the load as a fraction of all that moves along the lighter axis; the rotors have the rest. Positive.
    pub load_fraction: f64,
    /// Width of the backlash, within which no force passes (m).
    pub backlash: f64,
}

impl Spring {
    /// Series connection with `other`: the softer spring, and the sum of both backlash widths.
    #[must_use]
    pub fn in_series(self, other: Self) -> Self {
        let softer = if other.stiffness < self.stiffness { other } else { self };
        Self { backlash: self.backlash + other.backlash, ..softer }
    }
}

/// Gains of the velocity loop per kilogram of moving mass, and its delays.
#[derive(Debug, Clone, Copy, Default)]
pub struct LoopGains {
    /// Proportional gain: force per velocity error and mass (1/s).
    pub proportional_per_s: f64,
    /// Integral gain: force per integrated velocity error and mass (1/s^2).
    pub integral_per_s2: f64,
    /// Delay of the velocity feedback (s).
    pub feedback_delay_s: f64,
    /// Delay of the reported torque (s).
    pub torque_report_delay_s: f64,
    /// Time constant of the estimator that computes the velocity from the encoder (s).
    pub estimator_time_constant_s: f64,
}

/// Velocity controller of a single axis whose force was not recorded. Forces are in the unit of the setpoint: divided by
/// the proportional gain.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VelocityController {
    /// Moving mass divided by the proportional gain (s).
    pub time_constant_s: f64,
    /// Integral gain divided by the proportional gain (1/s).
    pub integral_rate_per_s: f64,
}

/// State of the magnet under the board at one instant.
#[derive(Debug, Clone, Copy, Default)]
pub struct Carriage {
    /// Length of the step (s).
    pub dt: f64,
    /// Position of the magnet (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Its acceleration (m/s^2).
    pub acceleration: [f64; 2],
    /// Mass of the striker (kg).
    pub striker_mass: f64,
}

/// Striker on the spring of its magnet, with friction on the board.
#[derive(Debug, Clone, Copy)]
pub struct Striker {
    /// Dry friction on the board (N).
    pub friction: f64,
    /// Stiffness of the spring at zero displacement (N/m).
    pub stiffness: f64,
    /// Damping ratio at that stiffness.
    pub damping_ratio: f64,
    /// Displacement of the largest force (m).
    pub softening: f64,
}

/// State of the rolling ball.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ball {
    /// Time since the roll began (s).
    pub time: f64,
    /// Position (m).
    pub position: [f64; 2],
    /// Velocity (m/s).
    pub velocity: [f64; 2],
    /// Time since the last impact, or since the roll began (s).
    pub since_impact: f64,
    /// Positions of the two strikers, where known (m).
    pub strikers: [Option<[f64; 2]>; 2],
}

/// Wall of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wall {
    /// x = -0.16 m.
    Left,
    /// x = +0.16 m.
    Right,
    /// y = -0.21 m.
    Near,
    /// y = +0.21 m.
    Far,
}

impl Wall {
    /// All walls in order.
    pub const ALL: [Self; 4] = [Self::Left, Self::Right, Self::Near, Self::Far];

    /// Index of the coordinate that the wall bounds, and the sign of its outward normal.
    #[must_use]
    pub fn outward(self) -> (usize, f64) {
        match self {
            Self::Left => (0, -1.0),
            Self::Right => (0, 1.0),
            Self::Near => (1, -1.0),
            Self::Far => (1, 1.0),
        }
    }
}

/// State of the ball at a wall before an impact.
#[derive(Debug, Clone, Copy)]
pub struct Impact {
    /// The wall.
    pub wall: Wall,
    /// Speed into the wall (m/s), positive.
    pub normal_speed: f64,
    /// Velocity along the wall (m/s), to the right of the outward normal seen from above.
    pub tangential_velocity: f64,
    /// Spin about the vertical, counterclockwise seen from above, as surface velocity at the ball's
    /// rim (m/s).
    pub spin: f64,
}

/// Result of an impact; the effects modify it in sequence.
#[derive(Debug, Clone, Copy, Default)]
pub struct Change {
    /// Ratio of the normal speeds after and before the impact.
    pub restitution: f64,
    /// Velocity along the wall after the impact (m/s).
    pub tangential_velocity: f64,
    /// Spin after the impact (m/s).
    pub spin: f64,
}

/// Input of the state estimator at one sample.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sample {
    /// Time since the previous sample (s).
    pub dt: f64,
    /// True velocity (m/s).
    pub velocity: f64,
    /// True velocity along the other coordinate (m/s) where the estimator uses the speed of both; otherwise 0.
    pub across: f64,
}

/// Effects on the noise of a signal and not on its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noise {
    /// Standard deviation of the frame time stamps.
    FrameTime,
    /// Fraction of missing or repeated frames.
    FrameLoss,
    /// Quantization step of the encoder.
    EncoderStep,
    /// Ratio of the noise to the one that the twin states.
    Level,
}

/// Equation of an effect and its place in the chain. `p` holds the parameters in the order of the effect, `m`
/// its internal states.
#[derive(Debug, Clone, Copy)]
pub enum Physics {
    /// Dead time of the command (s).
    CommandDelay(fn(p: &[f64]) -> f64),
    /// Velocity command of one motor to the input of the drive (m/s of belt), over `dt` seconds.
    Command(fn(p: &[f64], m: &mut [f64], command: f64, dt: f64) -> f64),
    /// Largest rate of the setpoint of the velocity loop (m/s^2 of belt), which follows the command.
    Ramp(fn(p: &[f64]) -> f64),
    /// Gains and delays of the velocity loop.
    VelocityLoop(fn(p: &[f64]) -> LoopGains),
    /// Velocity controller of a single axis with a velocity setpoint.
    VelocityController(fn(p: &[f64]) -> VelocityController),
    /// Demanded force (`motion.force`) to the motor force (N of belt).
    Effort(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Force limit known to the velocity loop, at which its integrator stops (N of belt).
    Windup(fn(p: &[f64]) -> f64),
    /// Force on the coordinate (N), positive along it.
    Force(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Force on the coordinate that repeats along it, with its turns per metre.
    Wave(fn(p: &[f64], turns_per_metre: f64) -> Wave),
    /// Friction level (N, not negative); friction opposes the motion and holds at rest.
    Friction(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Friction level that is the same in every motion (N, not negative).
    Coulomb(fn(p: &[f64]) -> f64),
    /// Viscous friction: resistance per velocity (N s/m).
    Damping(fn(p: &[f64]) -> f64),
    /// Presliding part of the dry friction; its state is the deflection.
    Bristles(fn(p: &[f64]) -> Bristles),
    /// Load of a single axis on an elastic transmission.
    ElasticLoad(fn(p: &[f64]) -> ElasticLoad),
    /// Resonance between the force of the motor and the measured load of a single axis.
    Resonance(fn(p: &[f64]) -> Resonance),
    /// Moving mass that is the same everywhere (kg).
    Mass(fn(p: &[f64]) -> f64),
    /// Additional moving mass (kg).
    Inertia(fn(p: &[f64], motion: &Motion) -> f64),
    /// True to reported position of a motor (m of belt) with its turns per metre of belt; the velocity loop
    /// sees the derivative.
    Encoder(fn(p: &[f64], position: f64, turns_per_metre: f64) -> f64),
    /// Elastic transmission between a motor and its load; `None` if rigid.
    Transmission(fn(p: &[f64]) -> Option<Spring>),
    /// Position of the motor side to that of the load side (m) of an elastic transmission; `motion.force` is the force
    /// that accelerates the load (N).
    Stretch(fn(p: &[f64], motion: &Motion) -> f64),
    /// Gap between a motor and its load.
    Gap(fn(p: &[f64]) -> Gap),
    /// Carriage position to magnet position (m) by the geometry of the gantry.
    Frame(fn(p: &[f64], carriage: &Carriage) -> [f64; 2]),
    /// Magnet state to the position of the striker (m).
    Coupling(fn(p: &[f64], m: &mut [f64], carriage: &Carriage) -> [f64; 2]),
    /// Striker on the spring of its magnet, with friction on the board; its states are displacement and velocity.
    Striker(fn(p: &[f64]) -> Striker),
    /// The same striker, whose force acts on the carriage; that of its mass counts as part of the carriage.
    Reaction(fn(p: &[f64]) -> Striker),
    /// Latency of the camera (s) at `elapsed` seconds of the session.
    CameraDelay(fn(p: &[f64], elapsed: f64) -> f64),
    /// True to reported position (m) of an object `height` metres above the board.
    Camera(fn(p: &[f64], position: [f64; 2], height: f64) -> [f64; 2]),
    /// Acceleration of the rolling ball (m/s^2).
    Roll(fn(p: &[f64], ball: &Ball) -> [f64; 2]),
    /// Resistance level of the rolling ball (m/s^2, not negative); it opposes the motion and holds at rest.
    Resistance(fn(p: &[f64], ball: &Ball) -> f64),
    /// Deceleration by sliding friction after an impact (m/s^2), until the ball rolls. Without it the ball
    /// always rolls.
    Slide(fn(p: &[f64], ball: &Ball) -> f64),
    /// Fraction of its velocity with which the ball slides at the start of a roll.
    Launch(fn(p: &[f64]) -> f64),
    /// Impact of the ball on a wall.
    Impact(fn(p: &[f64], impact: &Impact, change: Change) -> Change),
    /// Outward shift of a wall (m) at the distance `along` (m) from its middle, along x or y.
    Wall(fn(p: &[f64], wall: Wall, along: f64) -> f64),
    /// True to reported velocity (m/s).
    Estimator(fn(p: &[f64], m: &mut [f64], sample: &Sample) -> f64),
    /// Change of the noise.
    Noise(Noise),
    /// Expression of a user at its place.
    Expression(Place, &'static Expression),
    /// Two equations at two places of the chain with the same parameters.
    Both(&'static [Self; 2]),
}

/// Function of the catalogue, or expression of a user, at one place of the chain.
#[derive(Debug, Clone, Copy)]
pub enum Law<F> {
    /// Function.
    Function(F),
    /// Expression.
    Expression(&'static Expression),
    /// Expression of the level of a friction.
    Level(&'static Expression),
}

impl Law<fn(&[f64], &mut [f64], &Motion) -> f64> {
    /// Force or level of friction (N) with the parameters `p` and the memory `m`.
    #[inline]
    pub fn at(&self, p: &[f64], m: &mut [f64], motion: &Motion) -> f64 {
        match self {
            Self::Function(call) => call(p, m, motion),
            Self::Expression(expression) => expression.value(p, motion),
            Self::Level(expression) => expression.level(p, motion),
        }
    }
}

impl Law<fn(&[f64], &mut [f64], f64, f64) -> f64> {
    /// What becomes of a `command` over `dt` seconds with the parameters `p` and the memory `m`.
    #[inline]
    pub fn at(&self, p: &[f64], m: &mut [f64], command: f64, dt: f64) -> f64 {
        match self {
            Self::Function(call) => call(p, m, command, dt),
            Self::Expression(own) | Self::Level(own) => own.of_value(p, command),
        }
    }
}

impl Law<fn(&[f64], f64, f64) -> f64> {
    /// What is reported of a `position` with the parameters `p` and the motor's `turns_per_metre` of belt.
    #[inline]
    pub fn at(&self, p: &[f64], position: f64, turns_per_metre: f64) -> f64 {
        match self {
            Self::Function(call) => call(p, position, turns_per_metre),
            Self::Expression(own) | Self::Level(own) => own.of_value(p, position),
        }
    }
}

impl Physics {
    /// The equations, each at one place of the chain.
    #[must_use]
    pub fn equations(&self) -> &[Self] {
        match self {
            Self::Both(both) => *both,
            own => std::slice::from_ref(own),
        }
    }

    /// Return whether an equation acts on the ball or its impacts.
    #[must_use]
    pub fn acts_on_ball(&self) -> bool {
        let acts = |equation: &Self| {
            matches!(
                equation,
                Self::Roll(_)
                    | Self::Resistance(_)
                    | Self::Slide(_)
                    | Self::Launch(_)
                    | Self::Impact(_)
                    | Self::Wall(_)
            )
        };
        self.equations().iter().any(acts)
    }
}
