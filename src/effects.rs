//! The catalogue: every physical effect that a twin can have, and that a gap can be named after.
//!
//! An effect is one small file with one `static`: its name, its parameters with unit and range, the
//! plain function that is its physics, what its residual depends on, what excites it, and what it is
//! confused with. The simulators of the `twin` room call the function at the place in the
//! measured chain that [`Physics`] names; nothing else in the crate knows an effect by name. To add
//! one, write its file and add its line to [`CATALOGUE`].
//!
//! The chain, with the place of each kind of physics:
//!
//! ```text
//! command -> [CommandDelay] -> [Command] -> [Ramp] -> [VelocityLoop] -> [Effort] -> belts and rails
//!    rails: [Force] [Friction] [Inertia]        motor -> [Encoder]       motor -> [Play] -> magnet
//! magnet -> [Coupling] -> striker -> [Camera] -> [CameraDelay] -> detection -> [Estimator] -> state
//! ball: [Roll] [Resistance] [Slide] between impacts, [Impact] [Wall] at them, then the same camera
//! ```
//!
//! Motor-side physics acts in belt coordinates (`a` = x + y, `b` = x - y), rails and tilt in board
//! coordinates; [`Site`] says which, and an effect can be present on one axis alone.

mod ball;
mod coupling;
mod drive;
mod estimator;
mod first_order;
mod gantry;
mod impact;
mod oscillator;
mod physics;
mod sensor;

pub use drive::asymmetric::{Directed, by_direction};
pub use drive::scan::{SCANS, Scan, periods};
pub(crate) use oscillator::Oscillator;
pub use physics::{
    Ball, Bristles, Carriage, Change, CrossMotion, Impact, LoopGains, Motion, Noise, Physics,
    Sample, Spring, Wall,
};

use serde::{Deserialize, Serialize};
use std::fmt;

/// Part of the measured chain to which an effect belongs; the first word of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Command, motor, belt.
    Drive,
    /// Rails, beam, frame.
    Gantry,
    /// Carriage to striker through the board.
    Coupling,
    /// The free ball.
    Ball,
    /// The ball against walls and strikers.
    Impact,
    /// Camera and encoders.
    Sensor,
    /// What makes velocities from positions.
    Estimator,
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Drive => "drive",
            Self::Gantry => "gantry",
            Self::Coupling => "coupling",
            Self::Ball => "ball",
            Self::Impact => "impact",
            Self::Sensor => "sensor",
            Self::Estimator => "estimator",
        })
    }
}

/// Where an instance of an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Axis {
    /// Both motors alike; the only motor of a single axis.
    #[serde(rename = "a+b")]
    Motors,
    /// Motor a.
    #[serde(rename = "a")]
    A,
    /// Motor b.
    #[serde(rename = "b")]
    B,
    /// Both rails alike; the only rail of a single axis.
    #[serde(rename = "x+y")]
    Rails,
    /// The carriage along x.
    #[serde(rename = "x")]
    X,
    /// Carriage and bridge along y.
    #[serde(rename = "y")]
    Y,
    /// The effect has no direction of its own.
    #[serde(rename = "all")]
    Whole,
}

impl Axis {
    /// Whether physics at this place acts on coordinate `index` (0: a or x, 1: b or y).
    #[must_use]
    pub fn covers(self, index: usize) -> bool {
        match self {
            Self::Motors | Self::Rails | Self::Whole => true,
            Self::A | Self::X => index == 0,
            Self::B | Self::Y => index == 1,
        }
    }

    /// Whether two instances of one effect at these places would act on the same coordinate. A motor and a
    /// rail never do: friction can sit in both.
    #[must_use]
    pub fn overlaps(self, other: Self) -> bool {
        self.is_motor() == other.is_motor()
            && (0..2).any(|index| self.covers(index) && other.covers(index))
    }

    /// The two single places that make up this shared one, on a machine with two motors.
    #[must_use]
    pub fn parts(self) -> Option<[Self; 2]> {
        match self {
            Self::Motors => Some([Self::A, Self::B]),
            Self::Rails => Some([Self::X, Self::Y]),
            Self::A | Self::B | Self::X | Self::Y | Self::Whole => None,
        }
    }

    /// Whether this is a place in belt coordinates.
    #[must_use]
    pub fn is_motor(self) -> bool {
        matches!(self, Self::Motors | Self::A | Self::B)
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Motors => "a+b",
            Self::A => "a",
            Self::B => "b",
            Self::Rails => "x+y",
            Self::X => "x",
            Self::Y => "y",
            Self::Whole => "all",
        })
    }
}

/// The coordinates in which an effect may act, and so the places that are tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Site {
    /// Belt coordinates: both motors, then each alone.
    Motors,
    /// Board coordinates: both rails, then each alone.
    Rails,
    /// Motors and rails: friction can sit in either.
    MotorsAndRails,
    /// Belt coordinates, one motor at a time: what both share has another name.
    OneMotor,
    /// Belt coordinates, one motor at a time: each stands at a phase of its own, so both have it twice.
    EachMotor,
    /// Board coordinates, one rail at a time: it has numbers that are no other rail's.
    OneRail,
    /// One place only.
    Whole,
}

impl Site {
    /// The places to try, the shared ones first.
    #[must_use]
    pub fn axes(self) -> &'static [Axis] {
        match self {
            Self::Motors => &[Axis::Motors, Axis::A, Axis::B],
            Self::Rails => &[Axis::Rails, Axis::X, Axis::Y],
            Self::MotorsAndRails => {
                &[Axis::Rails, Axis::X, Axis::Y, Axis::Motors, Axis::A, Axis::B]
            }
            Self::OneMotor | Self::EachMotor => &[Axis::A, Axis::B],
            Self::OneRail => &[Axis::X, Axis::Y],
            Self::Whole => &[Axis::Whole],
        }
    }
}

/// Unit of a number that is added to a command or compared with one: m/s of belt for a velocity
/// drive, the unit of its input for any other axis.
pub const COMMAND_UNIT: &str = "command";

/// One number of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name with its unit, such as `force_n`.
    pub name: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// A typical size, by which steps of the fit are scaled.
    pub scale: f64,
    /// Hard ends; a fit that stops on one has failed.
    pub bounds: (f64, f64),
    /// Plausible range of the catalogue, an estimate: outside it a name carries a flag.
    pub plausible: (f64, f64),
    /// Belongs to a session (a phase, an offset), and says nothing about the machine.
    pub per_session: bool,
}

/// What a residual can depend on, for locating and for saying why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Regressor {
    /// Nothing: a constant.
    Constant,
    /// Position along the axis.
    Position,
    /// Position within a turn or a pitch.
    Phase,
    /// Velocity.
    Velocity,
    /// Sign of the velocity.
    Direction,
    /// Speed, whatever its sign.
    Speed,
    /// Acceleration.
    Acceleration,
    /// Derivative of the acceleration.
    Jerk,
    /// Size of the drive force.
    Load,
    /// Command.
    Command,
    /// Motion of the other axis.
    OtherAxis,
    /// Time since the direction changed.
    SinceReversal,
    /// Time in the session.
    Time,
    /// Speed of an impact.
    ImpactSpeed,
}

/// One physical effect of the catalogue.
#[derive(Debug)]
pub struct Effect {
    /// Canonical dotted name, such as `drive.friction.coulomb`.
    pub name: &'static str,
    /// What it does, in words that a person at the table understands.
    pub says: &'static str,
    /// Part of the chain.
    pub domain: Domain,
    /// Where it may act.
    pub site: Site,
    /// Its numbers, in the order in which `physics` takes them.
    pub parameters: &'static [Parameter],
    /// Values at which it does nothing.
    pub null: &'static [f64],
    /// Values from which a search starts: small but visible sizes and the shapes worth trying.
    pub probes: &'static [&'static [f64]],
    /// Numbers of memory that `physics` keeps from step to step, all zero at rest.
    pub memory: usize,
    /// Its equation, at its place in the chain.
    pub physics: Physics,
    /// What its residual depends on.
    pub regressors: &'static [Regressor],
    /// The least motion or sensor that shows it.
    pub excitation: &'static str,
    /// Patterns of `klasktron collect` that would show it best.
    pub experiment: &'static str,
    /// Names that look alike when the excitation is poor.
    pub confused_with: &'static [&'static str],
}

impl Effect {
    /// Whether it changes how a signal scatters rather than its value.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        matches!(self.physics, Physics::Noise(_))
    }

    /// Whether its first number alone is counted from nothing, and the others shape it: they may be there without it,
    /// as a spring without the friction of what it holds.
    #[must_use]
    pub fn has_shape(&self) -> bool {
        let shape = self.null.get(1..).unwrap_or_default();
        self.null[0] == 0.0 && !shape.is_empty() && shape.iter().all(|null| *null != 0.0)
    }

    /// Whether it sits in one place that has to be found: its probes are of one size at many places.
    #[must_use]
    pub fn sits_somewhere(&self) -> bool {
        self.probes.iter().all(|probe| probe[0] == self.probes[0][0])
    }
}

/// Every effect, by domain.
pub static CATALOGUE: &[&Effect] = &[
    &drive::gain::GAIN,
    &drive::offset::OFFSET,
    &drive::delay::DELAY,
    &drive::lag1::LAG1,
    &drive::velocity_loop::VELOCITY_LOOP,
    &drive::current_loop::CURRENT_LOOP,
    &drive::input_deadband::INPUT_DEADBAND,
    &drive::torque_speed::TORQUE_SPEED,
    &drive::slew::SLEW,
    &drive::supply_sag::SUPPLY_SAG,
    &drive::coulomb::COULOMB,
    &drive::viscous::VISCOUS,
    &drive::quadratic::QUADRATIC,
    &drive::asymmetric::ASYMMETRIC,
    &drive::stribeck::STRIBECK,
    &drive::presliding::PRESLIDING,
    &drive::load::LOAD,
    &drive::position::POSITION,
    &drive::thermal_drift::THERMAL_DRIFT,
    &drive::backlash::BACKLASH,
    &drive::compliance_belt::COMPLIANCE_BELT,
    &drive::ripple_motor::RIPPLE_MOTOR,
    &drive::ripple_belt_tooth::RIPPLE_BELT_TOOTH,
    &drive::ripple_pulley::RIPPLE_PULLEY,
    &gantry::inertia::INERTIA,
    &gantry::cross_coupling::CROSS_COUPLING,
    &gantry::racking::RACKING,
    &gantry::belt_asymmetry::BELT_ASYMMETRY,
    &gantry::mass_position::MASS_POSITION,
    &gantry::tilt::TILT,
    &gantry::endstop::ENDSTOP,
    &gantry::squareness::SQUARENESS,
    &coupling::magnet_spring::MAGNET_SPRING,
    &coupling::magnet_slip::MAGNET_SLIP,
    &coupling::striker_friction::STRIKER_FRICTION,
    &coupling::striker_wobble::STRIKER_WOBBLE,
    &ball::rolling_resistance::ROLLING_RESISTANCE,
    &ball::sliding_phase::SLIDING_PHASE,
    &ball::air_drag::AIR_DRAG,
    &ball::tilt::TILT,
    &ball::board_curvature::BOARD_CURVATURE,
    &ball::magnet_drag::MAGNET_DRAG,
    &ball::stiction_patch::STICTION_PATCH,
    &impact::wall_restitution::WALL_RESTITUTION,
    &impact::wall_restitution_speed::WALL_RESTITUTION_SPEED,
    &impact::wall_friction_spin::WALL_FRICTION_SPIN,
    &impact::wall_location::WALL_LOCATION,
    &sensor::camera_latency::CAMERA_LATENCY,
    &sensor::camera_scale_rotation::CAMERA_SCALE_ROTATION,
    &sensor::camera_distortion::CAMERA_DISTORTION,
    &sensor::camera_parallax::CAMERA_PARALLAX,
    &sensor::frame_jitter::FRAME_JITTER,
    &sensor::frame_drop::FRAME_DROP,
    &sensor::encoder_quantisation::ENCODER_QUANTISATION,
    &sensor::encoder_eccentricity::ENCODER_ECCENTRICITY,
    &sensor::clock_skew::CLOCK_SKEW,
    &sensor::noise_model::NOISE_MODEL,
    &estimator::velocity_deadzone::VELOCITY_DEADZONE,
    &estimator::lag::LAG,
];

/// `of(0)` and `of(1)`: both axes, both motors. Written out, because the optimiser leaves `array::map`
/// over a large closure a loop of calls.
#[inline(always)]
pub(crate) fn both<T>(mut of: impl FnMut(usize) -> T) -> [T; 2] {
    let first = of(0);
    [first, of(1)]
}

/// The effect called `name`.
#[must_use]
pub fn find(name: &str) -> Option<&'static Effect> {
    CATALOGUE.iter().copied().find(|effect| effect.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gantry::Pattern;
    use std::collections::BTreeSet;

    #[test]
    fn patches_and_end_stops_have_to_be_found() {
        let names = CATALOGUE.iter().filter(|effect| 6 <= effect.probes.len());
        let found = names.filter(|effect| effect.sits_somewhere()).map(|effect| effect.name);
        assert_eq!(found.collect::<Vec<_>>(), ["gantry.endstop", "ball.stiction_patch"]);
    }

    #[test]
    fn every_entry_is_whole() {
        let mut names = BTreeSet::new();
        for effect in CATALOGUE {
            let name = effect.name;
            assert!(names.insert(name), "{name} is there twice");
            assert!(name.starts_with(&format!("{}.", effect.domain)), "{name}");
            assert_eq!(effect.null.len(), effect.parameters.len(), "{name}");
            assert!(!effect.probes.is_empty() && !effect.says.is_empty(), "{name}");
            for probe in effect.probes {
                assert_eq!(probe.len(), effect.parameters.len(), "{name}");
                for (value, parameter) in probe.iter().zip(effect.parameters) {
                    let (low, high) = parameter.bounds;
                    assert!((low..=high).contains(value), "{name}.{}", parameter.name);
                }
            }
            if !effect.experiment.is_empty() {
                let pattern: Result<Pattern, _> = effect.experiment.parse();
                assert!(pattern.is_ok(), "{name}: collect knows no pattern {}", effect.experiment);
            }
        }
    }

    #[test]
    fn scales_and_ranges_are_ordered() {
        for effect in CATALOGUE {
            for parameter in effect.parameters {
                assert!(0.0 < parameter.scale, "{}.{}", effect.name, parameter.name);
                assert!(parameter.bounds.0 < parameter.bounds.1, "{}", effect.name);
                assert!(parameter.plausible.0 <= parameter.plausible.1, "{}", effect.name);
            }
        }
    }

    #[test]
    fn what_is_shared_parts_into_what_it_covers() {
        for (shared, parts) in
            [(Axis::Motors, [Axis::A, Axis::B]), (Axis::Rails, [Axis::X, Axis::Y])]
        {
            assert_eq!(shared.parts(), Some(parts));
            for (index, part) in parts.into_iter().enumerate() {
                assert!(part.parts().is_none() && part.overlaps(shared));
                assert!(part.covers(index) && !part.covers(1 - index));
            }
        }
    }

    #[test]
    fn a_size_with_shapes_is_told_from_several_sizes() {
        let has_shape = |name| find(name).unwrap().has_shape();
        assert!(has_shape("coupling.striker_friction") && has_shape("drive.friction.stribeck"));
        for several in ["drive.ripple.pulley", "drive.friction.asymmetric", "drive.delay"] {
            assert!(!has_shape(several), "{several}");
        }
    }
}
