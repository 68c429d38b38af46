//! Blocks of the measured chain, for the diagram of the catalogue.

use super::{Domain, Effect, Noise, Physics, Place};

/// Block of the measured chain in which effects act.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Block {
    /// Command to the input of the drive.
    Command,
    /// Setpoint to motor force.
    Drive,
    /// Friction and ripple on motors and guides.
    Friction,
    /// Masses and forces of the gantry.
    Gantry,
    /// Motor to load.
    Transmission,
    /// Load to magnet, by the geometry of the gantry.
    Geometry,
    /// Magnet to striker.
    Coupling,
    /// Motor to encoder.
    Encoder,
    /// Striker and ball to detection.
    Camera,
    /// Detections to velocities.
    Estimator,
    /// Motion of the ball between impacts.
    Ball,
    /// Impacts of the ball.
    Impact,
}

impl Block {
    /// All blocks, from the command to the state estimate.
    pub const ALL: [Self; 12] = [
        Self::Command,
        Self::Drive,
        Self::Friction,
        Self::Gantry,
        Self::Transmission,
        Self::Geometry,
        Self::Coupling,
        Self::Encoder,
        Self::Camera,
        Self::Estimator,
        Self::Ball,
        Self::Impact,
    ];

    /// Block of `effect`, by its first equation.
    #[must_use]
    pub fn of(effect: &Effect) -> Self {
        match effect.physics.equations()[0] {
            Physics::CommandDelay(_)
            | Physics::Command(_)
            | Physics::Expression(Place::Input, _) => Self::Command,
            Physics::Ramp(_)
            | Physics::VelocityLoop(_)
            | Physics::VelocityController(_)
            | Physics::Effort(_)
            | Physics::Windup(_)
            | Physics::Both(_) => Self::Drive,
            Physics::Force(_)
            | Physics::Wave(_)
            | Physics::Friction(_)
            | Physics::Coulomb(_)
            | Physics::Damping(_)
            | Physics::Bristles(_)
            | Physics::Mass(_)
            | Physics::Inertia(_)
            | Physics::Expression(Place::Force | Place::Friction, _) => {
                if effect.domain == Domain::Gantry { Self::Gantry } else { Self::Friction }
            }
            Physics::Stretch(_)
            | Physics::Gap(_)
            | Physics::Transmission(_)
            | Physics::ElasticLoad(_)
            | Physics::Resonance(_) => Self::Transmission,
            Physics::Frame(_) => Self::Geometry,
            Physics::Coupling(_) | Physics::Striker(_) | Physics::Reaction(_) => Self::Coupling,
            Physics::Encoder(_)
            | Physics::Noise(Noise::EncoderStep)
            | Physics::Expression(Place::Output, _) => Self::Encoder,
            Physics::Camera(_) | Physics::CameraDelay(_) | Physics::Noise(_) => Self::Camera,
            Physics::Estimator(_) => Self::Estimator,
            Physics::Roll(_) | Physics::Resistance(_) | Physics::Slide(_) | Physics::Launch(_) => {
                Self::Ball
            }
            Physics::Impact(_) | Physics::Wall(_) => Self::Impact,
        }
    }

    /// Title in the diagram.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Command => "Command path",
            Self::Drive => "Drive control",
            Self::Friction => "Friction and ripple",
            Self::Gantry => "Gantry mechanics",
            Self::Transmission => "Transmission",
            Self::Geometry => "Gantry geometry",
            Self::Coupling => "Magnetic coupling",
            Self::Encoder => "Encoders",
            Self::Camera => "Camera",
            Self::Estimator => "State estimator",
            Self::Ball => "Ball",
            Self::Impact => "Walls",
        }
    }

    /// Signals that are recorded behind the block.
    #[must_use]
    pub fn recorded(self) -> &'static [&'static str] {
        match self {
            Self::Command => &["commands (input)"],
            Self::Drive => &["motor torque"],
            Self::Encoder => &["motor position", "motor velocity"],
            Self::Camera => &["striker position", "ball position"],
            Self::Estimator => &["estimated velocity"],
            _ => &[],
        }
    }
}
