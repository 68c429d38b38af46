//! The catalogue in the units of one axis.
//!
//! Scales, bounds and start values of the catalogue are those of a belt-driven table: newtons, decimetres, samples
//! of a millisecond. A single axis may be a wheel driven by volts or a press driven by kilonewtons, and its user may
//! log millinewtons. So every quantity of the catalogue is multiplied by the ratio of its typical sizes on the axis and
//! on the table. Nothing that the search compares a value with is then an absolute number, and its answers do not
//! depend on the units of the recording.

use super::{
    COMMAND_UNIT, Effect, Parameter, Physics,
    drive::compliance_belt::{COMPLIANCE_ENCODER_ON_LOAD, COMPLIANCE_ENCODER_ON_MOTOR},
    find,
};
use std::sync::{Mutex, PoisonError};

/// Typical size of each quantity on an axis, in the units of its recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisScales {
    /// RMS of the input.
    pub input: f64,
    /// Half the range of the position.
    pub position: f64,
    /// RMS of the velocity, per second.
    pub velocity: f64,
    /// RMS of the acceleration, per second squared.
    pub acceleration: f64,
    /// Sample period (s).
    pub sample_period: f64,
    /// Highest frequency that is compared (Hz).
    pub band: f64,
    /// Duration of a session (s).
    pub duration: f64,
    /// Unit of the input.
    pub input_unit: &'static str,
    /// Unit of the position.
    pub position_unit: &'static str,
}

/// Typical sizes on the table for which the catalogue is written.
const TABLE_SCALES: AxisScales = AxisScales {
    input: 5.0,
    position: 0.15,
    velocity: 0.3,
    acceleration: 3.0,
    sample_period: 1e-3,
    band: 40.0,
    duration: 60.0,
    input_unit: "N",
    position_unit: "m",
};

/// Unit of a period within the compared frequencies: s.
pub(super) const PERIOD_UNIT: &str = "period";

/// Parameter scale (s) from which a time belongs to a session, as a warm-up does, and not to the samples.
const SESSION_TIME: f64 = 1.0;

/// Effects with another equation on a single axis, in the sizes of the table.
static ON_AXIS: [&Effect; 2] = [&COMPLIANCE_ENCODER_ON_MOTOR, &COMPLIANCE_ENCODER_ON_LOAD];

/// Effects in the units of an axis. They are kept for the life of the program, one set for each set of scales.
static POOL: Mutex<Vec<(AxisScales, &'static Effect)>> = Mutex::new(Vec::new());

impl AxisScales {
    /// Typical size of the quantity of `parameter`.
    fn size(&self, parameter: &Parameter) -> f64 {
        let Self { input, position, velocity, acceleration, sample_period, band, duration, .. } =
            *self;
        match parameter.unit {
            "N" => input,
            "m" => position,
            "m/s" => velocity,
            "m/s^2" => acceleration,
            "kg" => input / acceleration,
            "kg/m" => input / acceleration / position,
            "kg/m^2" => input / acceleration / position.powi(2),
            "N s/m" => input / velocity,
            "N s^2/m^2" => input / velocity.powi(2),
            "N/m" => input / position,
            "N/m^2" => input / position.powi(2),
            "m/N" => position / input,
            "1/W" => 1.0 / (input * velocity),
            "s" if SESSION_TIME <= parameter.scale => duration,
            "s" => sample_period,
            "Hz" => band,
            PERIOD_UNIT => 1.0 / band,
            "1/s" => 1.0 / sample_period,
            _ => 1.0,
        }
    }

    /// Highest frequency (Hz) that is ever compared at a `sample_period` (s).
    #[must_use]
    pub fn widest_band(sample_period: f64) -> f64 {
        TABLE_SCALES.band * TABLE_SCALES.sample_period / sample_period
    }

    /// What the input sets.
    #[must_use]
    pub fn input_kind(&self) -> InputKind {
        InputKind::of(self.input_unit, self.position_unit)
    }

    /// `unit` of the catalogue in words: that of a period within the compared frequencies is s.
    #[must_use]
    pub fn plain_unit(unit: &str) -> &str {
        if unit == PERIOD_UNIT { "s" } else { unit }
    }

    /// Ratio of the typical sizes of `parameter` on this axis and on the table.
    #[must_use]
    pub fn factor(&self, parameter: &Parameter) -> f64 {
        // The command of a table is a velocity, that of an axis is its input.
        if parameter.unit == COMMAND_UNIT {
            return self.input / TABLE_SCALES.velocity;
        }
        self.size(parameter) / TABLE_SCALES.size(parameter)
    }

    /// These sizes and units for an effect on the command: the velocity of the table is the input of the axis.
    fn of_command(&self) -> Self {
        let rate = self.acceleration / self.velocity;
        Self { velocity: self.input, acceleration: self.input * rate, ..*self }
    }

    /// `unit` of a command of the table, in the units of this axis.
    fn command_unit(&self, unit: &str) -> String {
        match unit {
            "m/s" => self.input_unit.to_owned(),
            "m/s^2" if self.input_kind() == InputKind::Velocity => format!("{}^2", self.input_unit),
            "m/s^2" => format!("{}/s", self.input_unit),
            other => self.unit(other),
        }
    }

    /// `unit` of the catalogue in the units of this axis, such as `N m s/rad` for `N s/m`.
    #[must_use]
    pub fn unit(&self, unit: &str) -> String {
        let (input, position) = (self.input_unit, self.position_unit);
        if self.input_kind() == InputKind::Velocity
            && let Some(own) = unit_of_velocity_driven(unit, position)
        {
            return own;
        }
        let inertia = match (input, position) {
            ("N", "m") => "kg".to_owned(),
            ("N m", "rad") => "kg m^2".to_owned(),
            _ => format!("{input} s^2/{position}"),
        };
        match unit {
            "N" | COMMAND_UNIT => input.to_owned(),
            "m" => position.to_owned(),
            "m/s" => format!("{position}/s"),
            "m/s^2" => format!("{position}/s^2"),
            "kg" => inertia,
            "kg/m" if inertia.contains('/') => format!("{input} s^2/{position}^2"),
            "kg/m^2" if inertia.contains('/') => format!("{input} s^2/{position}^3"),
            "kg/m" => format!("{inertia}/{position}"),
            "kg/m^2" => format!("{inertia}/{position}^2"),
            "N s/m" => format!("{input} s/{position}"),
            "N s^2/m^2" => format!("{input} s^2/{position}^2"),
            "N/m" => format!("{input}/{position}"),
            "N/m^2" => format!("{input}/{position}^2"),
            "m/N" if input.contains(' ') => format!("{position}/({input})"),
            "m/N" => format!("{position}/{input}"),
            "1/W" if (input, position) != ("N", "m") => format!("s/({input} {position})"),
            other => Self::plain_unit(other).to_owned(),
        }
    }
}

/// What the input of a single axis sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputKind {
    /// A force, or what makes one: a torque, a current, a voltage.
    Force,
    /// A setpoint of the velocity.
    Velocity,
}

impl InputKind {
    /// Kind of an input in `input_unit` beside a position in `position_unit`.
    #[must_use]
    pub fn of(input_unit: &str, position_unit: &str) -> Self {
        let is_velocity = input_unit.strip_suffix("/s") == Some(position_unit);
        if is_velocity { Self::Velocity } else { Self::Force }
    }
}

/// `unit` of the catalogue where forces are in the unit of a velocity setpoint; `None` for units without force.
fn unit_of_velocity_driven(unit: &str, position: &str) -> Option<String> {
    Some(match unit {
        "kg" | "m/N" => "s".to_owned(),
        "N s/m" => "1".to_owned(),
        "N/m" => "1/s".to_owned(),
        "kg/m" | "N s^2/m^2" => format!("s/{position}"),
        "kg/m^2" => format!("s/{position}^2"),
        "N/m^2" => format!("1/({position} s)"),
        "1/W" => format!("s^2/{position}^2"),
        _ => return None,
    })
}

impl Effect {
    /// Return whether the effect changes the command and nothing else.
    pub(crate) fn is_on_command(&self) -> bool {
        let is_command = |equation: &Physics| {
            matches!(equation, Physics::Command(_) | Physics::CommandDelay(_) | Physics::Ramp(_))
        };
        self.physics.equations().iter().all(is_command)
    }

    /// Equations and parameters that the effect may have on a single axis, in the sizes of the table.
    #[must_use]
    pub fn forms_on_axis(&'static self) -> Vec<&'static Self> {
        let own = self.axis_forms();
        if own.is_empty() { vec![self] } else { own }
    }

    /// The form on a single axis that has all parameters called `names`, else the first one; in the sizes of the table.
    #[must_use]
    pub fn form_on_axis<'n>(
        &'static self,
        names: impl IntoIterator<Item = &'n str> + Clone,
    ) -> &'static Self {
        let forms = self.forms_on_axis();
        let has = |form: &Self, name: &str| form.parameters.iter().any(|own| own.name == name);
        let with_all =
            forms.iter().find(|form| names.clone().into_iter().all(|name| has(form, name)));
        with_all.unwrap_or(&forms[0])
    }

    /// Forms on a single axis that differ from the effect on a table.
    #[must_use]
    pub fn axis_forms(&'static self) -> Vec<&'static Self> {
        ON_AXIS.into_iter().filter(|own| own.name == self.name).collect()
    }

    /// The effect with scales, bounds, start values and units of an axis. Name and physics stay.
    #[must_use]
    pub fn on_axis(&'static self, scales: &AxisScales) -> &'static Self {
        // A user states sizes in the units of the axis already.
        if self.definition().is_some() {
            return self;
        }
        let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        // What is scaled already is scaled from the catalogue again.
        let forms = find(self.name).unwrap_or(self).forms_on_axis();
        let original = forms.iter().find(|form| **form == self).unwrap_or(&forms[0]);
        if let Some((_, own)) = pool.iter().find(|(at, own)| at == scales && own == original) {
            return own;
        }
        let own: &'static Self = Box::leak(Box::new(original.scaled(scales)));
        pool.push((*scales, own));
        own
    }

    fn scaled(&self, scales: &AxisScales) -> Self {
        let is_on_command = self.is_on_command();
        let sizes = if is_on_command { scales.of_command() } else { *scales };
        let unit = |own: &str| {
            if is_on_command { scales.command_unit(own) } else { scales.unit(own) }
        };
        let factors: Vec<f64> = self.parameters.iter().map(|own| sizes.factor(own)).collect();
        // A limit below the typical rate acts on most samples, and explains them whatever the motion is.
        let is_ramp = matches!(self.physics, Physics::Ramp(_));
        let least = |own: &Parameter| if is_ramp { sizes.size(own) } else { f64::NEG_INFINITY };
        let all = |values: &[f64]| -> &'static [f64] {
            values
                .iter()
                .zip(&factors)
                .map(|(value, factor)| value * factor)
                .collect::<Vec<_>>()
                .leak()
        };
        let parameters: Vec<Parameter> = self
            .parameters
            .iter()
            .zip(&factors)
            .map(|(own, factor)| Parameter {
                unit: unit(own.unit).leak(),
                scale: own.scale * factor,
                bounds: ((own.bounds.0 * factor).max(least(own)), own.bounds.1 * factor),
                plausible: (own.plausible.0 * factor, own.plausible.1 * factor),
                ..*own
            })
            .collect();
        Self {
            parameters: parameters.leak(),
            null: all(self.null),
            probes: self.probes.iter().map(|probe| all(probe)).collect::<Vec<_>>().leak(),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CATALOGUE;

    /// A wheel of volts and radians, 50 samples per second.
    const WHEEL: AxisScales = AxisScales {
        input: 3.0,
        position: 40.0,
        velocity: 12.0,
        acceleration: 90.0,
        sample_period: 0.02,
        band: 2.0,
        duration: 30.0,
        input_unit: "V",
        position_unit: "rad",
    };

    #[test]
    fn the_table_keeps_its_catalogue() {
        // The command of a table is a velocity, that of an axis is its input.
        let has_own = |effect: &Effect| {
            effect.is_on_command() || ON_AXIS.iter().any(|own| own.name == effect.name)
        };
        for effect in CATALOGUE.iter().filter(|effect| !has_own(effect)) {
            let own = effect.on_axis(&TABLE_SCALES);
            assert_eq!(
                (own.parameters, own.null),
                (effect.parameters, effect.null),
                "{}",
                own.name
            );
            assert_eq!(own.probes, effect.probes, "{}", own.name);
        }
    }

    #[test]
    fn equal_scales_have_equal_effects_and_scaling_twice_is_scaling_once() {
        let viscous = find("drive.friction.viscous").unwrap();
        let own = viscous.on_axis(&WHEEL);
        assert!(std::ptr::eq(own, viscous.on_axis(&WHEEL)));
        assert!(std::ptr::eq(own, viscous.on_axis(&TABLE_SCALES).on_axis(&WHEEL)));
        let [parameter] = own.parameters else { panic!("one number") };
        assert_eq!(parameter.unit, "V s/rad");
        let factor = (3.0 / 12.0) / (5.0 / 0.3);
        assert!(
            (parameter.bounds.1 / (viscous.parameters[0].bounds.1 * factor) - 1.0).abs() < 1e-12
        );
    }

    #[test]
    fn a_change_of_units_scales_every_size_of_an_axis_alike() {
        let (by_input, by_position, by_time) = (1e3, 1e-3, 4.0);
        let other = AxisScales {
            input: WHEEL.input * by_input,
            position: WHEEL.position * by_position,
            velocity: WHEEL.velocity * by_position / by_time,
            acceleration: WHEEL.acceleration * by_position / (by_time * by_time),
            sample_period: WHEEL.sample_period * by_time,
            band: WHEEL.band / by_time,
            duration: WHEEL.duration * by_time,
            ..WHEEL
        };
        let mass = find("gantry.inertia").unwrap().parameters[0];
        let expected = by_input * by_time * by_time / by_position;
        assert!((other.factor(&mass) / WHEEL.factor(&mass) / expected - 1.0).abs() < 1e-12);
        let delay = find("drive.delay").unwrap().parameters[0];
        assert!((other.factor(&delay) / WHEEL.factor(&delay) - by_time).abs() < 1e-12);
    }

    #[test]
    fn limits_of_the_command_are_in_the_unit_of_the_input() {
        let own =
            |name: &str, scales: &AxisScales| find(name).unwrap().on_axis(scales).parameters[0];
        let wheel = own("drive.saturation.speed", &WHEEL);
        assert_eq!(wheel.unit, "V");
        // 10 m/s of a table at 0.3 m/s are 100 V of a wheel at 3 V.
        assert!((wheel.plausible.1 - 100.0).abs() < 1e-9, "{}", wheel.plausible.1);
        assert_eq!(own("drive.saturation.slew", &WHEEL).unit, "V/s");
        let driven = AxisScales { input_unit: "rad/s", ..WHEEL };
        assert_eq!(own("drive.saturation.speed", &driven).unit, "rad/s");
        assert_eq!(own("drive.saturation.slew", &driven).unit, "rad/s^2");
        assert_eq!(own("drive.input_deadband", &driven).unit, "rad/s");
    }

    #[test]
    fn forces_of_a_velocity_driven_axis_are_in_units_of_its_setpoint() {
        let driven = AxisScales { input_unit: "rad/s", ..WHEEL };
        let kinds = [driven, WHEEL].map(|own| own.input_kind());
        assert_eq!(kinds, [InputKind::Velocity, InputKind::Force]);
        for (unit, own) in [
            ("N", "rad/s"),
            ("kg", "s"),
            ("kg/m", "s/rad"),
            ("N s/m", "1"),
            ("N/m", "1/s"),
            ("N/m^2", "1/(rad s)"),
            ("m/N", "s"),
            ("1/W", "s^2/rad^2"),
            ("m", "rad"),
            ("m/s^2", "rad/s^2"),
        ] {
            assert_eq!(driven.unit(unit), own);
        }
    }

    #[test]
    fn units_are_those_of_the_axis() {
        let rotary = AxisScales { input_unit: "N m", ..WHEEL };
        for (unit, wheel, torque) in [
            ("N", "V", "N m"),
            ("kg", "V s^2/rad", "kg m^2"),
            ("kg/m", "V s^2/rad^2", "kg m^2/rad"),
            ("N s/m", "V s/rad", "N m s/rad"),
            ("N/m^2", "V/rad^2", "N m/rad^2"),
            ("m/N", "rad/V", "rad/(N m)"),
            ("m/s^2", "rad/s^2", "rad/s^2"),
            ("s", "s", "s"),
            ("1", "1", "1"),
        ] {
            assert_eq!((WHEEL.unit(unit).as_str(), rotary.unit(unit).as_str()), (wheel, torque));
            assert_eq!(TABLE_SCALES.unit(unit), unit);
        }
    }
}
