//! The places where physics can act, and what a function sees there.

/// The rest of the gantry, as one coordinate sees it.
#[derive(Debug, Clone, Copy, Default)]
pub struct CrossMotion {
    /// Position of the perpendicular coordinate (m).
    pub position: f64,
    /// Its velocity (m/s).
    pub velocity: f64,
    /// Its acceleration over the last step (m/s^2).
    pub acceleration: f64,
    /// Its drive force (N).
    pub force: f64,
}

/// One coordinate during one step: a belt (a, b), a rail (x, y) or a single axis.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motion {
    /// Which coordinate of its pair: 0 for a or x, 1 for b or y.
    pub index: usize,
    /// Time since the session began (s).
    pub time: f64,
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
    /// The perpendicular coordinate: b for a, y for x, and the other way round.
    pub other: CrossMotion,
}

/// The part of dry friction that contacts carry which bend before they slide.
///
/// The force is `-F z - c d z'` with the bend `z' = (v - h(v) z) / d`, `h(v) = |v| / tanh(|v| / v0)`: LuGre's law of
/// bristles with the stiffness `F / d` and the damping `c`, whose level vanishes towards rest below the speed `v0`,
/// as that of lubricated contacts does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristles {
    /// Friction when they slide (N).
    pub force: f64,
    /// Way over which they bend (m), positive.
    pub distance: f64,
    /// Speed below which they creep (m/s), positive.
    pub velocity: f64,
    /// Damping while they bend (N s/m).
    pub damping: f64,
}

impl Bristles {
    /// Speed with which the bend follows: that of the motion, and at rest the speed of creep (m/s).
    #[must_use]
    pub fn pace(&self, velocity: f64) -> f64 {
        let share = velocity.abs() / self.velocity;
        if share < 1e-6 { self.velocity } else { velocity.abs() / share.tanh() }
    }

    /// The bend after `dt` seconds at a constant `velocity`, from `bend`.
    #[must_use]
    pub fn bent(&self, bend: f64, velocity: f64, dt: f64) -> f64 {
        let pace = self.pace(velocity);
        let end = velocity / pace;
        end + (bend - end) * (-pace * dt / self.distance).exp()
    }

    /// Force (N) against the motion when the bend comes to `bend` at `rate` (1/s).
    #[must_use]
    pub fn pull(&self, bend: f64, rate: f64) -> f64 {
        self.force * bend + self.damping * self.distance * rate
    }

    /// The same contacts where there is less dry friction than they could carry, but some: as stiff, but sliding
    /// earlier.
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

/// What lies between a motor and the load that it moves, in metres and newtons of belt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// Its stiffness (N/m), positive.
    pub stiffness: f64,
    /// Its damping as a share of the critical one of the motor's mass on it.
    pub damping_ratio: f64,
    /// Mass that stays with the motor (kg of belt), positive: its rotor.
    pub motor_mass: f64,
    /// Width within which it passes no force at all (m).
    pub play: f64,
}

impl Spring {
    /// This one and `other` one behind the other: the softer gives way, and the plays add up.
    #[must_use]
    pub fn in_series(self, other: Self) -> Self {
        let softer = if other.stiffness < self.stiffness { other } else { self };
        Self { play: self.play + other.play, ..softer }
    }

    /// Damping (N s/m).
    #[must_use]
    pub fn damping(&self) -> f64 {
        2.0 * self.damping_ratio * (self.stiffness * self.motor_mass).sqrt()
    }
}

/// Gains of the velocity loop, per kilogram of moving mass.
#[derive(Debug, Clone, Copy, Default)]
pub struct LoopGains {
    /// Force per velocity error and mass (1/s).
    pub proportional_per_s: f64,
    /// Force per travelled error and mass (1/s^2).
    pub integral_per_s2: f64,
    /// Age of the velocity that the loop compares with its setpoint (s).
    pub feedback_age_s: f64,
    /// Age of the torque that the drive reports (s).
    pub torque_age_s: f64,
}

/// The magnet under the board at one time.
#[derive(Debug, Clone, Copy, Default)]
pub struct Carriage {
    /// Length of the step (s).
    pub dt: f64,
    /// Place of the magnet (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Its acceleration (m/s^2).
    pub acceleration: [f64; 2],
    /// Mass of the striker (kg).
    pub striker_mass: f64,
}

/// The rolling ball.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ball {
    /// Time since the roll began (s).
    pub time: f64,
    /// Place (m).
    pub position: [f64; 2],
    /// Velocity (m/s).
    pub velocity: [f64; 2],
    /// Time since the last impact, or since the roll began (s).
    pub since_impact: f64,
    /// Places of the two strikers, where they are known (m).
    pub strikers: [Option<[f64; 2]>; 2],
}

/// A wall of the board, by its outward normal.
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
    /// All of them, in their order.
    pub const ALL: [Self; 4] = [Self::Left, Self::Right, Self::Near, Self::Far];

    /// Index of the coordinate that it bounds, and the sign of its outward normal.
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

/// The ball at a wall, before the impact.
#[derive(Debug, Clone, Copy)]
pub struct Impact {
    /// Which wall.
    pub wall: Wall,
    /// Speed into the wall (m/s), positive.
    pub normal_speed: f64,
    /// Velocity along the wall (m/s), to the right of the outward normal seen from above.
    pub tangential_velocity: f64,
    /// Spin about the vertical, counterclockwise seen from above, as surface velocity at the ball's
    /// rim (m/s).
    pub spin: f64,
}

/// What an impact does; effects change it one after the other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Change {
    /// Normal speed after over normal speed before.
    pub restitution: f64,
    /// Velocity along the wall after the impact (m/s).
    pub tangential_velocity: f64,
    /// Spin after the impact (m/s).
    pub spin: f64,
}

/// One measured position and what is made of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sample {
    /// Time since the sample before (s).
    pub dt: f64,
    /// Velocity that a perfect estimator would report (m/s).
    pub velocity: f64,
    /// The same along the other coordinate, where the estimator looks at both together (m/s); else 0.
    pub across: f64,
}

/// Effects on the scatter of a signal rather than on its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noise {
    /// Standard deviation of the frames' time stamps.
    FrameTime,
    /// Share of frames missing or repeated.
    FrameLoss,
    /// Step of the encoder.
    EncoderStep,
    /// Ratio of the scatter to the one that the twin states.
    Scatter,
}

/// Where in the chain an effect acts, and its equation there. `p` are the parameters in the order of
/// the effect, `m` its memory.
#[derive(Debug, Clone, Copy)]
pub enum Physics {
    /// Dead time of the command (s).
    CommandDelay(fn(p: &[f64]) -> f64),
    /// Velocity command of one motor (m/s of belt) to what the drive takes in, over `dt` seconds.
    Command(fn(p: &[f64], m: &mut [f64], command: f64, dt: f64) -> f64),
    /// Command to the setpoint of the velocity loop (m/s of belt), over `dt` seconds.
    Ramp(fn(p: &[f64], m: &mut [f64], command: f64, dt: f64) -> f64),
    /// Gains of the velocity loop.
    VelocityLoop(fn(p: &[f64]) -> LoopGains),
    /// Demanded force (`motion.force`, N of belt) to the force that the motor gives.
    Effort(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Demanded force from which the velocity loop, which knows it, stops adding to its integral (N of belt).
    Windup(fn(p: &[f64]) -> f64),
    /// Force on the coordinate (N), positive along it.
    Force(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Largest friction force at this motion (N, not negative); it opposes the motion and holds at
    /// rest.
    Friction(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// The part of the dry friction that bends before it slides; its memory is the bend.
    Bristles(fn(p: &[f64]) -> Bristles),
    /// Mass beyond the nominal one (kg).
    Inertia(fn(p: &[f64], motion: &Motion) -> f64),
    /// True position of a motor (m of belt) to the reported one; the velocity loop sees its slope too.
    Encoder(fn(p: &[f64], position: f64) -> f64),
    /// What lies between a motor and its load, if it is soft.
    Transmission(fn(p: &[f64]) -> Option<Spring>),
    /// Motion of the motor's side to the position of the load's side (m); `motion.force` is the force
    /// that the load's inertia asks for (N).
    Play(fn(p: &[f64], m: &mut [f64], motion: &Motion) -> f64),
    /// Carriage position (m) to that of the magnet, by the geometry of the gantry.
    Frame(fn(p: &[f64], carriage: &Carriage) -> [f64; 2]),
    /// Magnet to striker: place of the striker (m).
    Coupling(fn(p: &[f64], m: &mut [f64], carriage: &Carriage) -> [f64; 2]),
    /// Carriage to the force of the striker on it (N), less that of its mass, which counts as the carriage's.
    Reaction(fn(p: &[f64], m: &mut [f64], carriage: &Carriage) -> [f64; 2]),
    /// Age of what the camera reports (s), at `elapsed` seconds of the session.
    CameraDelay(fn(p: &[f64], elapsed: f64) -> f64),
    /// True place (m) of something `height` metres above the board to the reported one.
    Camera(fn(p: &[f64], place: [f64; 2], height: f64) -> [f64; 2]),
    /// Acceleration of the rolling ball (m/s^2).
    Roll(fn(p: &[f64], ball: &Ball) -> [f64; 2]),
    /// Largest deceleration of the rolling ball (m/s^2, not negative); it opposes the motion and holds
    /// at rest.
    Resistance(fn(p: &[f64], ball: &Ball) -> f64),
    /// Deceleration by friction on the board while the ball slides after an impact (m/s^2), until it
    /// rolls; without it the ball always rolls.
    Slide(fn(p: &[f64], ball: &Ball) -> f64),
    /// Share of its velocity with which the ball slides where a roll begins; the rest of it is rolling.
    Launch(fn(p: &[f64]) -> f64),
    /// What a wall does to the ball.
    Impact(fn(p: &[f64], impact: &Impact, change: Change) -> Change),
    /// Outward shift of a wall (m) at `along` metres from its middle, along the board's x or y.
    Wall(fn(p: &[f64], wall: Wall, along: f64) -> f64),
    /// True velocity to the reported one.
    Estimator(fn(p: &[f64], m: &mut [f64], sample: &Sample) -> f64),
    /// Scatter instead of a value.
    Noise(Noise),
    /// Two equations at two places of the chain, with the same numbers.
    Both(&'static [Self; 2]),
}

impl Physics {
    /// Its equations, each at one place of the chain.
    #[must_use]
    pub fn equations(&self) -> &[Self] {
        match self {
            Self::Both(both) => *both,
            own => std::slice::from_ref(own),
        }
    }

    /// Whether any of them acts on the ball, its walls among that.
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
