//! The twin: a simulator of the measured chain, made of effects of the catalogue.
//!
//! A [`Twin`] is a list of [`Instance`]s: an effect, the axis on which it acts, and its numbers with
//! their source and interval; `twin.json` is that list. The simulators know no effect by name. They
//! collect the functions of all instances at each place of the chain ([`crate::effects::Physics`])
//! and step through them without allocation.
//!
//! A recording is compared with the twin link by link ([`Stage`]): the measured input of a link is
//! replayed through it, and its measured output is compared with the prediction. So an error of the
//! drive cannot pass for one of the camera. Frames count from when they were taken where the camera's
//! stamps are on the recording's clock, else from their arrival, transport included
//! ([`crate::recording::FrameTimes`]).
//!
//! | stage | measured input | predicted output |
//! |---|---|---|
//! | [`DriveStage`] | commands | motor velocities, and torques where they were recorded |
//! | [`CameraStage`] | carriage from the encoders | striker as the camera sees it |
//! | [`BallStage`] | start of each free roll | ball as the camera sees it |
//! | [`AxisStage`] | motion (force drives), command (velocity drives) | force, velocity |
//! | [`EstimatorStage`] | positions of the camera | velocities of `/board/state` |

mod axis;
mod axis_frame;
mod ball;
mod belt_gaps;
mod camera;
mod contact;
mod diff;
mod document;
mod drive;
mod estimator;
pub mod export;
mod linkage;
mod machine;
pub mod noise;
mod nominal;
mod path;
mod plant;
mod repeats;
mod session;
pub mod simulation;
mod stage;
mod transmission;

pub use axis::{AxisError, AxisStage, FreeRun};
pub use axis_frame::AxisFrame;
pub use ball::{BallStage, WallImpact};
pub use camera::CameraStage;
pub use diff::{Change, EffectDiff, ParameterDiff, PropertyDiff, TwinDiff};
pub use document::{TwinError, parse_twin, read_twin, write_twin};
pub use drive::{DriveStage, Output};
pub use estimator::EstimatorStage;
pub(crate) use linkage::TakenStriker;
pub use linkage::{Linkage, Places};
pub use machine::{Machine, machine_of};
pub use noise::Estimate;
pub use path::MeasuredPath;
pub(crate) use plant::MOST_LANES;
pub use plant::{Course, Fleet, Moved, Plant, PlantState};
pub use session::{
    Mask, RecordedSource, Run, Session, SessionError, SessionOptions, check_machine, divide,
    runs_of, sessions_of, sessions_with,
};
pub use stage::{Channel, Stage, StageKind};

use crate::effects::{Axis, Effect, Physics, Spring};
use serde::{Deserialize, Serialize};

/// Source of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The built-in start, before anything was measured.
    Nominal,
    /// Known from drawings or data sheets; never fitted.
    Known,
    /// Fitted to recordings.
    Fitted,
}

/// One number of an instance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// In the unit of its parameter.
    pub value: f64,
    /// 95 % interval, where it was fitted.
    pub ci95: Option<[f64; 2]>,
    /// Source.
    pub source: Source,
}

/// An effect that is switched on.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// Effect of the catalogue.
    pub effect: &'static Effect,
    /// Axis on which it acts.
    pub axis: Axis,
    /// Its numbers, in the order of the effect's parameters.
    pub values: Vec<Value>,
}

impl PartialEq for Effect {
    fn eq(&self, other: &Self) -> bool {
        // On a single axis some effects have other parameters, and one has two forms.
        let names = |own: &Self| own.parameters.iter().map(|parameter| parameter.name);
        self.name == other.name && names(self).eq(names(other))
    }
}

impl Instance {
    /// An instance with the numbers `values`, all of one source.
    #[must_use]
    pub fn new(effect: &'static Effect, axis: Axis, values: &[f64], source: Source) -> Self {
        let values =
            values.iter().map(|value| Value { value: *value, ci95: None, source }).collect();
        Self { effect, axis, values }
    }

    /// The plain numbers.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        self.values.iter().map(|value| value.value).collect()
    }

    /// The value of the parameter `name`.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<f64> {
        let index = self.effect.parameters.iter().position(|own| own.name == name)?;
        self.values.get(index).map(|own| own.value)
    }

    /// Spring between a motor and its load.
    #[must_use]
    pub fn spring(&self) -> Option<Spring> {
        let equations = self.effect.physics.equations();
        let call = equations.iter().find_map(|equation| match equation {
            Physics::Transmission(call) => Some(call),
            _ => None,
        })?;
        call(&self.numbers()).filter(|_| self.axis.is_motor())
    }

    /// Return whether its spring depends on a `parameter`.
    pub(crate) fn is_of_spring(&self, parameter: usize) -> bool {
        let mut moved = self.clone();
        moved.values[parameter].value += self.effect.parameters[parameter].scale;
        self.spring() != moved.spring()
    }

    /// Return whether it lets a motor move without its load.
    #[must_use]
    pub fn rattles(&self) -> bool {
        self.spring().is_some_and(|spring| 0.0 < spring.backlash)
    }
}

/// A simulator's description: which effects act where, with which numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Twin {
    /// The machine that it describes.
    pub machine: Machine,
    /// Mass of the striker above the board (kg), known from drawings.
    pub striker_mass: f64,
    /// Belt per turn of a motor (m).
    pub belt_metres_per_turn: f64,
    /// Mean moving mass for which the gains of the velocity loops were tuned (kg): a drive keeps its gains when the
    /// mass changes. Without it, the gains follow the mass.
    pub controller_reference_mass: Option<f64>,
    /// Coordinate of a single axis; `None` before it was compared with a recording.
    pub axis_frame: Option<AxisFrame>,
    /// The effects in it, in the order in which they were added.
    pub instances: Vec<Instance>,
    /// Residual of each signal on the recordings to which the twin was fitted.
    pub reference_residuals: Vec<ReferenceResidual>,
    /// Model error on these recordings, expressed as effects that are not there, by stage and effect.
    pub discrepancy: Vec<Discrepancy>,
    /// Measurement noise of the camera on these recordings, by stage.
    pub measurement_noise: Vec<MeasurementNoise>,
    /// SHA-256 of the recordings to which it was fitted.
    pub fitted_to: Vec<String>,
}

/// Residual of one signal on the recordings to which a twin was fitted, training and validation together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceResidual {
    /// The signal, such as `motor_a.velocity`.
    pub signal: String,
    /// RMS of the residual, in the signal's unit.
    pub residual_rms: f64,
    /// A search for missing effects ended there: recordings with the same residual hold nothing new.
    #[serde(default)]
    pub searched: bool,
}

/// Model error of a fitted twin, expressed as an effect that is not there: the effect explains a small fraction of the
/// residual on the reference recordings. In later recordings the effect must explain more.
#[derive(Debug, Clone, PartialEq)]
pub struct Discrepancy {
    /// The stage on which the effect was tried.
    pub stage: StageKind,
    /// Dotted name of the effect.
    pub effect: String,
    /// Fraction of the whitened squared residual that the effect explains, at its best place and magnitude.
    pub explained_fraction: f64,
    /// Estimated offset of each parameter from its value without the effect, in the parameter's unit, bounds ignored.
    /// Recordings of this machine cannot determine a smaller offset. Empty where it was not estimated.
    pub parameter_offsets: Vec<f64>,
    /// The effect as it was fitted; `None` where it was not simulated or failed a check that does not concern its size.
    pub fitted: Option<Instance>,
}

/// Measurement noise of the camera about a fitted twin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasurementNoise {
    /// The stage on which it was measured.
    pub stage: StageKind,
    /// Variance of the frames' time stamps (s^2).
    pub timestamp_variance_s2: Estimate,
    /// Variance at rest of the part that changes from frame to frame (m^2).
    pub frame_to_frame_variance_m2: Estimate,
    /// Variance about the prediction at rest (m^2).
    pub total_variance_m2: Estimate,
    /// Fraction of frames that were missing or repeated; none where it was not measured.
    #[serde(default)]
    pub lost_frame_fraction: Option<Estimate>,
}

/// One fitted number of a twin: which instance, which of its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Slot {
    /// Index into [`Twin::instances`].
    pub instance: usize,
    /// Index into its values.
    pub parameter: usize,
}

impl Twin {
    /// The value in `slot`.
    #[must_use]
    pub fn get(&self, slot: Slot) -> f64 {
        self.instances[slot.instance].values[slot.parameter].value
    }

    /// Replaces the value in `slot`, held within its bounds; what is not finite changes nothing.
    pub fn set(&mut self, slot: Slot, value: f64) {
        if !value.is_finite() {
            return;
        }
        let instance = &mut self.instances[slot.instance];
        let (low, high) = instance.effect.parameters[slot.parameter].bounds;
        instance.values[slot.parameter].value = value.clamp(low, high);
    }

    /// Gives the parameter in `slot` its value without the effect, also outside the bounds of a fit: the smallest
    /// compliance that can be fitted is no rigid belt.
    pub fn set_to_null(&mut self, slot: Slot) {
        let instance = &mut self.instances[slot.instance];
        instance.values[slot.parameter].value = instance.effect.null[slot.parameter];
    }

    /// The instance of `effect` on exactly `axis`.
    #[must_use]
    pub fn instance(&self, effect: &str, axis: Axis) -> Option<&Instance> {
        self.instances.iter().find(|found| found.effect.name == effect && found.axis == axis)
    }

    /// Return whether `effect` acts anywhere that `axis` touches.
    #[must_use]
    pub fn has(&self, effect: &str, axis: Axis) -> bool {
        self.instances.iter().any(|found| found.effect.name == effect && found.axis.overlaps(axis))
    }
}

/// Share of a parameter's scale by which finite differences move it: far above rounding, far below
/// what bends the model.
const DIFFERENCE: f64 = 0.02;

impl Twin {
    /// Return whether `stage` shows impacts at the ends of a backlash.
    #[must_use]
    pub(crate) fn rattles_in(&self, stage: StageKind) -> bool {
        stage == StageKind::Drive && self.instances.iter().any(Instance::rattles)
    }

    /// Typical size of the parameter in `slot`.
    #[must_use]
    pub fn scale(&self, slot: Slot) -> f64 {
        self.instances[slot.instance].effect.parameters[slot.parameter].scale
    }

    /// Moves the value in `slot` by a small step for a finite difference, inwards at a bound.
    pub fn nudge(&mut self, slot: Slot) {
        let (value, step) = (self.get(slot), DIFFERENCE * self.scale(slot));
        let (_, high) = self.instances[slot.instance].effect.parameters[slot.parameter].bounds;
        self.set(slot, if value + step <= high { value + step } else { value - step });
    }

    /// The values that a fit of `stage` may move: those that change something there, but for what is known from
    /// drawings.
    #[must_use]
    pub fn free(&self, stage: &dyn Stage) -> Vec<Slot> {
        let mut slots = Vec::new();
        for (index, instance) in self.instances.iter().enumerate() {
            for (parameter, value) in instance.values.iter().enumerate() {
                if value.source != Source::Known && stage.feels_parameter(instance, parameter) {
                    slots.push(Slot { instance: index, parameter });
                }
            }
        }
        slots
    }
}
