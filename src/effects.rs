//! Catalogue of the physical effects that a twin can contain and that `gap` can identify.
//!
//! Each effect is one small file with one `static`: name, equation, parameters with unit and range, the
//! plain function of its physics, observable signals, excitation, confounded effects and reference. The
//! simulators of the [`twin`](crate::twin) module call the function at the place in the measured chain
//! that [`Physics`] defines. No other code refers to an effect by name. To add an effect, write its file,
//! add its line to [`CATALOGUE`] and run `scripts/make_effects_page`.
//!
//! The chain, with the place of each kind of physics:
//!
//! ```text
//! command -> [CommandDelay] -> [Command] -> [Ramp] -> [VelocityLoop] -> [Effort] -> belts and guides
//!   guides: [Force] [Friction] [Inertia]      motor -> [Encoder]      motor -> [Backlash] -> magnet
//! magnet -> [Coupling] -> striker -> [Camera] -> [CameraDelay] -> detection -> [Estimator] -> state
//! ball: [Roll] [Resistance] [Slide] between impacts, [Impact] [Wall] at impacts, then the same camera
//! ```
//!
//! Motor-side physics acts in belt coordinates (`a` = x + y, `b` = x - y), guides and tilt in board
//! coordinates. [`Site`] defines the coordinates; an effect can also act on one axis alone.

mod axis_scales;
mod ball;
mod block;
mod coupling;
mod diagram;
pub mod document;
mod drive;
mod elastic_load;
mod estimator;
mod expression;
mod file;
mod first_order;
mod gantry;
mod impact;
mod oscillator;
mod physics;
mod sensor;

pub use axis_scales::{AxisScales, InputKind};
pub use block::Block;
pub(crate) use coupling::striker::{CarriageLanes, StateLanes as StrikerStateLanes, StrikerLanes};
pub use diagram::diagram;
pub use drive::asymmetric::{Directed, by_direction};
pub use drive::scan::{PhaseSeries, SCANS, Scan, magnitudes, periods};
pub(crate) use drive::slew::slewed;
pub use elastic_load::{ElasticLoad, ElasticState, Resonance};
pub use expression::{
    Coordinates, Definition, DefinitionError, Expression, ParameterDefinition, Place, Sign,
    VARIABLES, define,
};
pub use file::{EffectsFileError, read_effects};
pub(crate) use first_order::follow;
pub(crate) use gantry::endstop::free_range;
pub(crate) use impact::wall_friction_spin::spin_ratio;
pub(crate) use oscillator::Oscillator;
pub use physics::{
    Ball, Bristles, Carriage, Change, CrossMotion, Gap, Impact, Law, LoopGains, Motion, Noise,
    Physics, Sample, Spring, Striker, VelocityController, Wall, Wave,
};

use serde::{Deserialize, Serialize};
use std::fmt;

/// Part of the measured chain to which an effect belongs; the first word of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Command, motor and belt.
    Drive,
    /// Guides, bridge and frame.
    Gantry,
    /// Magnetic coupling of carriage and striker through the board.
    Coupling,
    /// The free ball.
    Ball,
    /// Impacts of the ball on walls and strikers.
    Impact,
    /// Camera and encoders.
    Sensor,
    /// State estimator: velocities from positions.
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

/// Axis on which an instance of an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Axis {
    /// Both motors with the same parameters.
    #[serde(rename = "a+b")]
    Motors,
    /// Motor a.
    #[serde(rename = "a")]
    A,
    /// Motor b.
    #[serde(rename = "b")]
    B,
    /// Both guides with the same parameters.
    #[serde(rename = "x+y")]
    Guides,
    /// The carriage along x.
    #[serde(rename = "x")]
    X,
    /// The carriage and the bridge along y.
    #[serde(rename = "y")]
    Y,
    /// No axis: the effect acts on the whole machine.
    #[serde(rename = "all")]
    Whole,
    /// The only axis of a machine that is no table.
    #[serde(rename = "axis")]
    Single,
}

impl Axis {
    /// Return whether physics on this axis acts on coordinate `index` (0: a or x, 1: b or y).
    #[must_use]
    pub fn covers(self, index: usize) -> bool {
        match self {
            Self::Motors | Self::Guides | Self::Whole => true,
            Self::A | Self::X | Self::Single => index == 0,
            Self::B | Self::Y => index == 1,
        }
    }

    /// Return whether two instances of one effect on these axes act on the same coordinate. A motor and a
    /// guide never do: friction can act on both.
    #[must_use]
    pub fn overlaps(self, other: Self) -> bool {
        self.is_motor() == other.is_motor()
            && (0..2).any(|index| self.covers(index) && other.covers(index))
    }

    /// The two single axes of a shared axis, on a machine with two motors; `None` for a single axis.
    #[must_use]
    pub fn parts(self) -> Option<[Self; 2]> {
        match self {
            Self::Motors => Some([Self::A, Self::B]),
            Self::Guides => Some([Self::X, Self::Y]),
            Self::A | Self::B | Self::X | Self::Y | Self::Whole | Self::Single => None,
        }
    }

    /// Location that follows the name of an effect in a text: ` on a+b`; nothing on a machine with a single axis.
    #[must_use]
    pub fn phrase(self) -> String {
        if self == Self::Single { String::new() } else { format!(" on {self}") }
    }

    /// Return whether this is an axis in belt coordinates.
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
            Self::Guides => "x+y",
            Self::X => "x",
            Self::Y => "y",
            Self::Whole => "all",
            Self::Single => "axis",
        })
    }
}

/// Coordinates in which an effect may act, and so the axes of its candidates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Site {
    /// Belt coordinates: both motors, then each alone.
    Motors,
    /// Board coordinates: both guides, then each alone.
    Guides,
    /// Motors and guides: friction can act on either.
    MotorsAndGuides,
    /// Belt coordinates, one motor at a time: the effect is a difference between the motors.
    OneMotor,
    /// Belt coordinates, one motor at a time: each motor has its own phase.
    EachMotor,
    /// Belt coordinates of a table, one motor at a time: the effect has a length of the table's belt or pulley.
    EachBelt,
    /// Board coordinates, one guide at a time: each guide has its own parameters.
    OneGuide,
    /// A machine with a single axis; a table does not have the effect.
    SingleAxis,
    /// The whole machine.
    Whole,
}

impl Site {
    /// Axes of the candidates, the shared ones first.
    #[must_use]
    pub fn axes(self) -> &'static [Axis] {
        match self {
            Self::Motors => &[Axis::Motors, Axis::A, Axis::B],
            Self::Guides => &[Axis::Guides, Axis::X, Axis::Y],
            Self::MotorsAndGuides => {
                &[Axis::Guides, Axis::X, Axis::Y, Axis::Motors, Axis::A, Axis::B]
            }
            Self::OneMotor | Self::EachMotor | Self::EachBelt => &[Axis::A, Axis::B],
            Self::OneGuide => &[Axis::X, Axis::Y],
            Self::SingleAxis => &[Axis::Single],
            Self::Whole => &[Axis::Whole],
        }
    }
}

/// Unit of a parameter that is added to a command or compared with one. It is m/s of belt for a velocity
/// drive, and the unit of the input for any other axis.
pub const COMMAND_UNIT: &str = "command";

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name with its unit, such as `force_n`.
    pub name: &'static str,
    /// Symbol in the equation of the effect.
    pub symbol: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// Typical magnitude, which scales the steps of the fit.
    pub scale: f64,
    /// Hard bounds; a fit that ends on one has failed.
    pub bounds: (f64, f64),
    /// Typical range, an estimate; a fitted value outside of it is flagged.
    pub plausible: (f64, f64),
    /// True for a value of a session (a phase, an offset), false for a value of the machine.
    pub per_session: bool,
}

/// Quantity on which a residual can depend, for localization and explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Regressor {
    /// A constant.
    Constant,
    /// Position along the axis.
    Position,
    /// Phase within a turn or a pitch.
    Phase,
    /// Velocity.
    Velocity,
    /// Sign of the velocity.
    Direction,
    /// Speed: magnitude of the velocity.
    Speed,
    /// Acceleration.
    Acceleration,
    /// Derivative of the acceleration.
    Jerk,
    /// Magnitude of the drive force.
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

/// Recorded signal in which an effect is observable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Position of a motor, by its encoder.
    MotorPosition,
    /// Velocity of a motor, by its encoder.
    MotorVelocity,
    /// Torque of a motor, as its drive reports it.
    MotorTorque,
    /// Input of a single axis, such as its force.
    AxisInput,
    /// Position of a striker, by the camera.
    StrikerPosition,
    /// Position of the ball, by the camera.
    BallPosition,
    /// Time stamps of the camera frames.
    FrameTime,
    /// Velocity in the state estimate.
    StateVelocity,
}

impl Signal {
    /// Signals of effects on the drive of a table and of a single axis.
    pub(crate) const DRIVE: &[Self] = &[Self::MotorVelocity, Self::MotorTorque, Self::AxisInput];
    /// Signals of effects on the drives of a table.
    pub(crate) const MOTOR: &[Self] = &[Self::MotorVelocity, Self::MotorTorque];
    /// Signals of effects that act on the drives and on the striker.
    pub(crate) const MOTION: &[Self] =
        &[Self::MotorVelocity, Self::MotorTorque, Self::StrikerPosition];
    /// Signals of effects between carriage and striker.
    pub(crate) const STRIKER: &[Self] = &[Self::StrikerPosition];
    /// Signals of effects on the ball.
    pub(crate) const BALL: &[Self] = &[Self::BallPosition];
    /// Signals of effects on all camera positions.
    pub(crate) const CAMERA: &[Self] = &[Self::StrikerPosition, Self::BallPosition];
    /// Signals of effects on the frame timing.
    pub(crate) const FRAMES: &[Self] =
        &[Self::FrameTime, Self::StrikerPosition, Self::BallPosition];
    /// Signals of effects on the encoder resolution.
    pub(crate) const ENCODER: &[Self] = &[Self::MotorPosition];
    /// Signals of effects of the state estimator.
    pub(crate) const STATE: &[Self] = &[Self::StateVelocity];

    /// Topic of the data contract that carries the signal.
    #[must_use]
    pub fn topic(self) -> &'static str {
        match self {
            Self::MotorPosition | Self::MotorVelocity | Self::MotorTorque => "/motor/PLAYER/MOTOR",
            Self::AxisInput => "/axis/NAME/input",
            Self::StrikerPosition | Self::BallPosition | Self::FrameTime => "/camera/detections",
            Self::StateVelocity => "/board/state",
        }
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::MotorPosition => "motor position",
            Self::MotorVelocity => "motor velocity",
            Self::MotorTorque => "motor torque",
            Self::AxisInput => "input of a single axis",
            Self::StrikerPosition => "striker position",
            Self::BallPosition => "ball position",
            Self::FrameTime => "frame time stamps",
            Self::StateVelocity => "estimated velocity",
        })
    }
}

/// One physical effect of the catalogue.
#[derive(Debug)]
pub struct Effect {
    /// Canonical dotted name, such as `drive.friction.coulomb`.
    pub name: &'static str,
    /// One-line description, a clause without capital letter and full stop.
    pub summary: &'static str,
    /// Part of the chain.
    pub domain: Domain,
    /// Coordinates in which it may act.
    pub site: Site,
    /// Equation in plain text, with the symbols of the parameters and of [`document::SYMBOLS`].
    pub equation: &'static str,
    /// Parameters, in the order in which `physics` takes them.
    pub parameters: &'static [Parameter],
    /// Parameter values without effect.
    pub null: &'static [f64],
    /// Start values of a search: small but observable magnitudes, and alternative shapes.
    pub probes: &'static [&'static [f64]],
    /// Number of internal states of `physics`, all zero at rest.
    pub memory: usize,
    /// Function at its place in the chain.
    pub physics: Physics,
    /// Quantities on which its residual depends.
    pub regressors: &'static [Regressor],
    /// Recorded signals that show it.
    pub signals: &'static [Signal],
    /// Motion and sensors that excite and show it.
    pub excitation: &'static str,
    /// Pattern of `klasktron collect` that excites it best; empty where none does.
    pub experiment: &'static str,
    /// Effects with a similar residual under poor excitation.
    pub confused_with: &'static [&'static str],
    /// Publication or textbook, or the principle from which the equation follows.
    pub reference: &'static str,
}

impl Effect {
    /// Return whether it changes the noise of a signal and not its value.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        matches!(self.physics, Physics::Noise(_))
    }

    /// Return whether only the first parameter is zero without the effect, and the others define its shape.
    /// An example is the spring that holds a striker without friction.
    #[must_use]
    pub fn has_shape_parameters(&self) -> bool {
        let shape = self.null.get(1..).unwrap_or_default();
        self.null[0] == 0.0 && !shape.is_empty() && shape.iter().all(|null| *null != 0.0)
    }

    /// Return whether the effect depends on the time since the start of the session.
    #[must_use]
    pub fn changes_over_session(&self) -> bool {
        self.regressors.contains(&Regressor::Time)
    }

    /// Return whether either effect lists the other one as similar.
    #[must_use]
    pub fn may_be_confused_with(&self, other: &Self) -> bool {
        self.confused_with.contains(&other.name) || other.confused_with.contains(&self.name)
    }

    /// Return whether a parameter is a shape, such as an exponent or a period: it has no value without the effect.
    #[must_use]
    pub fn is_shape(&self, parameter: usize) -> bool {
        0 < parameter && self.null[parameter] != 0.0
    }

    /// Return whether a parameter is a limit, which does nothing at its upper bound. A limit acts by its reciprocal: a lower
    /// one acts more, and of all that are never reached none differs from another.
    #[must_use]
    pub fn is_limit(&self, parameter: usize) -> bool {
        let (low, high) = self.parameters[parameter].bounds;
        0.0 < low && self.null[parameter] == high
    }

    /// Return whether a parameter is only an addition to the effect: it is zero without it, and at every start of a search.
    #[must_use]
    pub fn is_optional(&self, parameter: usize) -> bool {
        0 < parameter
            && self.null[parameter] == 0.0
            && !self.parameters[parameter].per_session
            && self.probes.iter().all(|probe| probe[parameter] == 0.0)
    }

    /// Effect to which a change of `parameter` belongs. An optional parameter is the size of an effect that acts in addition
    /// to this one, such as the friction of a striker on a soft magnet.
    #[must_use]
    pub fn effect_of_parameter(&self, parameter: usize) -> &'static str {
        let own = &self.parameters[parameter];
        let is_same = |size: &Parameter| (size.name, size.symbol) == (own.name, own.symbol);
        let beside = self.confused_with.iter().filter_map(|name| find(name));
        let mut beside = beside.filter(|other| other.parameters.first().is_some_and(is_same));
        let other = if self.is_optional(parameter) { beside.next() } else { None };
        other.map_or(self.name, |other| other.name)
    }

    /// Index of the parameter that needs a global search.
    #[must_use]
    pub fn scanned_parameter(&self) -> Option<usize> {
        SCANS.iter().find(|(own, _)| own.name == self.name).map(|(_, scan)| scan.parameter)
    }
}

/// Every effect, by domain.
pub static CATALOGUE: &[&Effect] = &[
    &drive::gain::GAIN,
    &drive::offset::OFFSET,
    &drive::delay::DELAY,
    &drive::lag1::LAG1,
    &drive::velocity_loop::VELOCITY_LOOP,
    &drive::velocity_controller::VELOCITY_CONTROLLER,
    &drive::current_loop::CURRENT_LOOP,
    &drive::input_deadband::INPUT_DEADBAND,
    &drive::torque_speed::TORQUE_SPEED,
    &drive::slew::SLEW,
    &drive::speed::SPEED,
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
    &gantry::stiffness::STIFFNESS,
    &gantry::gravity::GRAVITY,
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

/// Values of `of(0)` and `of(1)`: both axes or both motors.
///
/// Unrolled, because the optimizer compiles `array::map` over a large closure to a loop of calls.
#[inline(always)]
pub(crate) fn both<T>(mut of: impl FnMut(usize) -> T) -> [T; 2] {
    let first = of(0);
    [first, of(1)]
}

/// Find the effect called `name`.
#[must_use]
pub fn find(name: &str) -> Option<&'static Effect> {
    let built_in = CATALOGUE.iter().copied().find(|effect| effect.name == name);
    built_in.or_else(|| expression::known(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gantry::Pattern;
    use std::collections::BTreeSet;

    #[test]
    fn the_friction_of_a_striker_on_a_soft_magnet_is_striker_friction() {
        let spring = find("coupling.magnet_spring").unwrap();
        let of = |name: &str| {
            let index = spring.parameters.iter().position(|own| own.name == name).unwrap();
            spring.effect_of_parameter(index)
        };
        assert_eq!(of("force_n"), "coupling.striker_friction");
        assert_eq!(of("stiffness_n_per_m"), "coupling.magnet_spring");
        // Nothing else in the catalogue carries another effect.
        for effect in CATALOGUE {
            let own = (0..effect.parameters.len()).map(|index| effect.effect_of_parameter(index));
            let others = own.filter(|name| *name != effect.name).count();
            assert_eq!(others, usize::from(effect.name == spring.name), "{}", effect.name);
        }
    }

    #[test]
    fn every_entry_is_complete() {
        let mut names = BTreeSet::new();
        for effect in CATALOGUE {
            let name = effect.name;
            assert!(names.insert(name), "{name} is a duplicate");
            assert!(name.starts_with(&format!("{}.", effect.domain)), "{name}");
            assert_eq!(effect.null.len(), effect.parameters.len(), "{name}");
            assert!(!effect.probes.is_empty() && !effect.summary.is_empty(), "{name}");
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

    /// Return whether `symbol` is a separate word of `equation`.
    fn mentions(equation: &str, symbol: &str) -> bool {
        // An exponent such as ² ends a word.
        let is_part = |c: char| c.is_alphabetic() || c.is_ascii_digit() || c == '_';
        equation.split(|c: char| !is_part(c)).any(|word| word == symbol)
    }

    #[test]
    fn every_entry_has_the_fields_of_a_catalogue_page() {
        for effect in CATALOGUE {
            let name = effect.name;
            let texts = [effect.summary, effect.equation, effect.excitation, effect.reference];
            assert!(texts.iter().all(|text| !text.is_empty() && !text.ends_with('.')), "{name}");
            assert!(!effect.signals.is_empty() && !effect.confused_with.is_empty(), "{name}");
            for other in effect.confused_with {
                assert!(find(other).is_some_and(|other| other.name != name), "{name}: {other}");
            }
            for parameter in effect.parameters {
                let symbol = parameter.symbol;
                assert!(mentions(effect.equation, symbol), "{name}: no {symbol} in the equation");
                assert!(!parameter.unit.is_empty(), "{name}.{}", parameter.name);
            }
            let symbols: BTreeSet<&str> = effect.parameters.iter().map(|own| own.symbol).collect();
            assert_eq!(symbols.len(), effect.parameters.len(), "{name}: two equal symbols");
        }
    }

    /// Signal that `equation` changes, where it changes one for certain.
    fn changed(equation: &Physics) -> Option<Signal> {
        match equation {
            Physics::Noise(Noise::EncoderStep) => Some(Signal::MotorPosition),
            Physics::Windup(_) | Physics::Noise(_) | Physics::Both(_) => None,
            Physics::Estimator(_) => Some(Signal::StateVelocity),
            own if own.acts_on_ball() => Some(Signal::BallPosition),
            Physics::Frame(_)
            | Physics::Stretch(_)
            | Physics::Gap(_)
            | Physics::Coupling(_)
            | Physics::Striker(_)
            | Physics::Camera(_)
            | Physics::CameraDelay(_) => Some(Signal::StrikerPosition),
            _ => Some(Signal::MotorVelocity),
        }
    }

    #[test]
    fn the_signals_are_those_that_the_physics_changes() {
        for effect in CATALOGUE {
            if effect.site == Site::SingleAxis {
                assert_eq!(effect.signals, [Signal::AxisInput], "{}", effect.name);
                continue;
            }
            for signal in effect.physics.equations().iter().filter_map(changed) {
                assert!(effect.signals.contains(&signal), "{}: {signal}", effect.name);
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
    fn a_shared_axis_consists_of_the_single_axes_that_it_covers() {
        for (shared, parts) in
            [(Axis::Motors, [Axis::A, Axis::B]), (Axis::Guides, [Axis::X, Axis::Y])]
        {
            assert_eq!(shared.parts(), Some(parts));
            for (index, part) in parts.into_iter().enumerate() {
                assert!(part.parts().is_none() && part.overlaps(shared));
                assert!(part.covers(index) && !part.covers(1 - index));
            }
        }
    }

    #[test]
    fn shape_parameters_differ_from_several_magnitudes() {
        let has_shape = |name| find(name).unwrap().has_shape_parameters();
        assert!(has_shape("coupling.striker_friction") && has_shape("drive.friction.stribeck"));
        for several in ["drive.ripple.pulley", "drive.friction.asymmetric", "drive.delay"] {
            assert!(!has_shape(several), "{several}");
        }
    }
}
