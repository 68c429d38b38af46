//! Drives and gantry of one player, or a single axis.
//!
//! Two slides carry the striker: `y` moves the bridge, `x` the carriage on it. A drive is a `setpoint` slide: a mass so
//! large that no other force moves it, driven to the commanded velocity. The limit of its force is the slew limit, and
//! its actuator has gain, offset, lag and delay of the command. A fixed tendon from setpoint to belt is the velocity
//! loop. Its damping acts on the velocity error and its stiffness on the integral of it:
//!
//! ```text
//! F = M (2 zeta w (r - v) + w^2 integral(r - v) dt),  a = x + y,  b = x - y
//! ```
//!
//! Friction is `damping` and `frictionloss` of slides and of belt tendons; moving masses are `inertial` and `armature`.
//! Controls are the velocities of both belts (m/s): `vx + vy` and `vx - vy`, each held until the next.
//!
//! A single axis is one joint with inertia, friction, spring, and an actuator with the input as control.
//!
//! # Isaac Lab
//!
//! One Python file in plain torch: the drives as forces on the slides, and the integration of the same gantry, which
//! reproduces the twin. Friction and armature are settings of the simulated joints.
//!
//! # What is missing
//!
//! [`Exported::inexpressible`] lists the effects that the target cannot express, and parts of expressed effects that it
//! cannot. Ball, impacts, camera and estimator are no part of the file ([`Exported::outside`]).

mod bam;
mod isaaclab;
mod mechanics;
mod mjcf;

pub use bam::{BamMotor, export_bam};

use super::{Machine, Twin};
use crate::effects::{Axis, InputKind};
use mechanics::Mechanics;
use std::fmt;

/// Simulator for which a twin is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Model file of MuJoCo.
    Mjcf,
    /// Python file with an explicit actuator for Isaac Lab.
    IsaacLab,
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mjcf => "MJCF",
            Self::IsaacLab => "the actuator for Isaac Lab",
        })
    }
}

/// Integration step of the file (s). The error of the velocity is proportional to it: at 0.25 ms some 0.5 % of the
/// velocity's RMS under random commands.
pub const MJCF_TIMESTEP_S: f64 = 0.00025;

/// Twin for another simulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// Content of the file.
    pub text: String,
    /// Effects, or parts of them, that the target cannot express.
    pub inexpressible: Vec<Inexpressible>,
    /// Effects of ball, camera and estimator, which are no part of the file.
    pub outside: Vec<&'static str>,
}

/// Effect of a twin that a file cannot express.
#[derive(Debug, Clone, PartialEq)]
pub struct Inexpressible {
    /// Dotted name of the effect.
    pub effect: &'static str,
    /// Axis on which it acts.
    pub axis: Axis,
    /// Missing part; `None` for the whole effect.
    pub part: Option<String>,
}

impl fmt::Display for Inexpressible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.effect, self.axis.phrase())?;
        self.part.as_ref().map_or(Ok(()), |part| write!(f, ": {part}"))
    }
}

/// Reason why a twin cannot become a file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// No inertia.
    #[error(
        "the twin has no moving mass along {axis} (gantry.inertia is {found} kg); calibrate it with \
         `klasktron calibrate` first"
    )]
    NoMass {
        /// The axis.
        axis: &'static str,
        /// Its mass (kg, or input unit per m/s^2).
        found: f64,
    },
    /// An axis with a velocity setpoint.
    #[error(
        "the twin describes an axis with a velocity setpoint ({unit}), whose mass is unknown; simulate it with \
         `klasktron simulate`, or identify it from recordings of the force"
    )]
    NoForce {
        /// Unit of the setpoint.
        unit: &'static str,
    },
    /// A machine that the target does not have.
    #[error(
        "the actuator for Isaac Lab is that of a table, but the twin describes a single axis; export it with --to mjcf"
    )]
    NoTable,
    /// No rotary servo.
    #[error(
        "BAM describes rotary servos with a torque (N m) or a voltage (V) as input and a position in rad, but the twin \
         describes {found}; import recordings in these units and calibrate on them"
    )]
    NoServo {
        /// Machine of the twin.
        found: String,
    },
    /// Unknown motor.
    #[error(
        "the twin's input is a voltage, from which torques follow only with the motor's data: give \
         --motor-constant-n-m-per-a and --motor-resistance-ohm"
    )]
    NoMotor,
}

/// Write `twin` for `target`.
///
/// # Errors
/// When it has no moving mass, or the target cannot have the machine.
pub fn export(twin: &Twin, target: Target) -> Result<Exported, ExportError> {
    if let Some(frame) = twin.axis_frame
        && frame.scales.input_kind() == InputKind::Velocity
    {
        return Err(ExportError::NoForce { unit: frame.scales.input_unit });
    }
    let mechanics = Mechanics::of(twin, target);
    let axes = ["x", "y"];
    for (axis, mass) in axes.into_iter().zip(mechanics.mass).take(twin.machine.motors()) {
        if !(0.0 < mass && mass.is_finite()) {
            return Err(ExportError::NoMass { axis, found: mass });
        }
    }
    let text = match (target, twin.machine) {
        (Target::Mjcf, Machine::Table) => mjcf::table(twin, &mechanics),
        (Target::Mjcf, Machine::Axis) => mjcf::axis(twin, &mechanics),
        (Target::IsaacLab, Machine::Table) => isaaclab::table(twin, &mechanics),
        (Target::IsaacLab, Machine::Axis) => return Err(ExportError::NoTable),
    };
    Ok(Exported { text, inexpressible: mechanics.inexpressible, outside: mechanics.outside })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{self, Axis, AxisScales},
        twin::{AxisFrame, Instance, Source},
    };

    fn with(twin: &mut Twin, effect: &str, axis: Axis, values: &[f64]) {
        let effect = effects::find(effect).unwrap();
        twin.instances.push(Instance::new(effect, axis, values, Source::Fitted));
    }

    fn mjcf(twin: &Twin) -> Exported {
        export(twin, Target::Mjcf).unwrap()
    }

    fn listed(twin: &Twin) -> Vec<String> {
        mjcf(twin).inexpressible.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn the_plain_twins_are_expressed_completely() {
        for machine in [Machine::Table, Machine::Axis] {
            assert_eq!(listed(&Twin::nominal(machine)), [""; 0]);
        }
        let outside = mjcf(&Twin::nominal(Machine::Table)).outside;
        assert_eq!(outside, ["ball.rolling_resistance", "impact.wall_restitution"]);
    }

    #[test]
    fn numbers_of_the_loop_are_those_of_its_equation() {
        let mut twin = Twin::nominal(Machine::Table);
        twin.controller_reference_mass = Some(2.0);
        let xml = mjcf(&twin).text;
        let w = std::f64::consts::TAU * 20.0;
        let loop_a = format!("name=\"loop_a\" stiffness=\"{}\" damping=\"{}\"", w * w, 4.0 * w);
        assert!(xml.contains(&loop_a), "{loop_a}\n{xml}");
        assert!(xml.contains("frictionloss=\"1\""));
    }

    #[test]
    fn every_effect_is_written_listed_or_outside() {
        for effect in effects::CATALOGUE {
            for machine in [Machine::Table, Machine::Axis] {
                let axes = machine.axes(effect.site);
                let Some(axis) = axes.first() else { continue };
                let mut twin = Twin::nominal(machine);
                twin.instances.retain(|own| own.effect.name != effect.name);
                for target in [Target::Mjcf, Target::IsaacLab] {
                    let mut twin = twin.clone();
                    let before = export(&twin, target);
                    with(&mut twin, effect.name, *axis, effect.probes[0]);
                    let is_refused = target == Target::IsaacLab && machine == Machine::Axis;
                    let after = export(&twin, target);
                    assert!(is_refused || before != after, "{} leaves no trace", effect.name);
                }
            }
        }
    }

    #[test]
    fn parts_that_are_missing_are_named_with_their_value() {
        let mut twin = Twin::nominal(Machine::Table);
        with(&mut twin, "drive.friction.stribeck", Axis::X, &[1.0, 0.05]);
        with(&mut twin, "coupling.magnet_spring", Axis::Whole, &[100.0, 0.3, 0.004, 0.0]);
        with(&mut twin, "drive.delay", Axis::A, &[-0.001]);
        let found = listed(&twin);
        assert_eq!(found.len(), 3, "{found:?}");
        assert_eq!(found[0], "drive.friction.stribeck on x");
        assert!(found[1].contains("softening beyond 0.004 m"), "{found:?}");
        assert!(found[2].contains("a delay of -0.001 s"), "{found:?}");
    }

    #[test]
    fn the_actuator_has_feedback_delays_and_no_striker() {
        let mut twin = Twin::nominal(Machine::Table);
        twin.instances[0].values[2].value = 2e-4;
        twin.instances[0].values[4].value = 1e-3;
        assert!(
            listed(&twin)[0].contains("the lag of 0.0022 s of its feedback"),
            "{:?}",
            listed(&twin)
        );
        with(&mut twin, "coupling.magnet_spring", Axis::Whole, &[100.0, 0.3, 1.0, 0.0]);
        let exported = export(&twin, Target::IsaacLab).unwrap();
        assert!(exported.text.contains("FEEDBACK_DELAY_S = [0.0002, 0.0002]"));
        assert!(exported.text.contains("ESTIMATOR_TIME_CONSTANT_S = [0.001, 0.001]"));
        assert!(!exported.text.contains("@CONSTANTS@"));
        let missing: Vec<String> = exported.inexpressible.iter().map(ToString::to_string).collect();
        assert_eq!(missing, ["coupling.magnet_spring on all"]);
    }

    #[test]
    fn without_mass_there_is_no_file() {
        let mut twin = Twin::nominal(Machine::Table);
        twin.instances.retain(|own| own.effect.name != "gantry.inertia" || own.axis == Axis::X);
        let error = export(&twin, Target::Mjcf).unwrap_err();
        assert!(error.to_string().contains("along y (gantry.inertia is 0 kg)"), "{error}");
    }

    #[test]
    fn an_axis_with_a_velocity_setpoint_has_no_mass_to_export() {
        let scales = AxisScales {
            input: 0.1,
            position: 0.1,
            velocity: 0.1,
            acceleration: 1.0,
            sample_period: 1e-3,
            band: 40.0,
            duration: 10.0,
            input_unit: "m/s",
            position_unit: "m",
        };
        let axis_frame = Some(AxisFrame { position_origin: 0.0, scales });
        let twin = Twin { axis_frame, ..Twin::nominal(Machine::Axis) };
        let error = export(&twin, Target::Mjcf).unwrap_err();
        assert_eq!(error, ExportError::NoForce { unit: "m/s" });
    }
}
