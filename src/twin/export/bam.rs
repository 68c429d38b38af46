//! Parameter file of BAM (Rhoban): friction models of servo actuators.
//!
//! | model | friction torque |
//! |---|---|
//! | m1 | `friction_base + friction_viscous |w|` |
//! | m2 | and `friction_stribeck exp(-|w / dtheta_stribeck|^alpha)` |
//! | m3 | m1, and `load_friction_base |load|` |
//! | m4 | m2, and `load_friction_base |load|` |
//!
//! The smallest model with all effects of the twin is written. The models m5 and m6 distinguish the motor's torque from
//! an external one, which no effect does. `armature` is everything that moves. Source: `bam/model.py` of
//! <https://github.com/Rhoban/bam> (names, units and equations, not code).

use super::{ExportError, Exported, Inexpressible};
use crate::{
    effects::Domain,
    twin::{Instance, Twin},
};
use serde_json::{Map, Value, json};

/// Motor of a servo, and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct BamMotor {
    /// Name of the actuator in BAM, such as `xl330`.
    pub actuator: String,
    /// Torque constant (N m/A) and resistance (ohm), where the input is a voltage.
    pub electrical: Option<[f64; 2]>,
}

/// Friction and inertia, in units of the input.
#[derive(Debug, Default)]
struct Servo {
    inertia: f64,
    coulomb: f64,
    viscous: f64,
    stribeck: Option<[f64; 3]>,
    load: Option<f64>,
    delay: f64,
}

impl Servo {
    /// Add an effect; the missing part as [`Inexpressible::part`], if any.
    fn add(&mut self, instance: &Instance) -> Option<Option<String>> {
        let p = instance.numbers();
        match instance.effect.name {
            "gantry.inertia" => self.inertia += p[0],
            "drive.friction.coulomb" => self.coulomb += p[0],
            "drive.friction.viscous" => self.viscous += p[0],
            "drive.friction.stribeck" if self.stribeck.is_none() => {
                self.stribeck = Some([p[0], p[1], p[2]]);
            }
            "drive.friction.load" if self.load.is_none() => self.load = Some(p[0]),
            "drive.delay" if 0.0 <= p[0] => self.delay += p[0],
            "drive.delay" => return Some(Some(format!("a delay of {} s", p[0]))),
            _ => return Some(None),
        }
        None
    }

    fn model(&self) -> &'static str {
        match (self.stribeck.is_some(), self.load.is_some()) {
            (false, false) => "m1",
            (true, false) => "m2",
            (false, true) => "m3",
            (true, true) => "m4",
        }
    }
}

/// Write `twin`, a rotary axis whose input is a torque or a voltage.
///
/// # Errors
/// When it is no such axis, has no moving inertia, or its input is a voltage and the motor is not known.
pub fn export_bam(twin: &Twin, motor: &BamMotor) -> Result<Exported, ExportError> {
    let (input, position) = twin
        .axis_frame
        .map_or(("", ""), |frame| (frame.scales.input_unit, frame.scales.position_unit));
    if position != "rad" || !["N m", "V"].contains(&input) {
        let found = if input.is_empty() {
            format!("a {} without units", twin.machine)
        } else {
            format!("an axis with input in {input} and position in {position}")
        };
        return Err(ExportError::NoServo { found });
    }
    let electrical = match (input, motor.electrical) {
        ("V", None) => return Err(ExportError::NoMotor),
        (_, electrical) => electrical.filter(|_| input == "V"),
    };
    let (mut servo, mut inexpressible, mut outside) = (Servo::default(), Vec::new(), Vec::new());
    for instance in &twin.instances {
        let effect = instance.effect;
        if !matches!(effect.domain, Domain::Drive | Domain::Gantry) {
            outside.push(effect.name);
        } else if let Some(part) = servo.add(instance) {
            let axis = instance.axis;
            inexpressible.push(Inexpressible { effect: effect.name, axis, part });
        }
    }
    if !(0.0 < servo.inertia && servo.inertia.is_finite()) {
        return Err(ExportError::NoMass { axis: "x", found: servo.inertia });
    }
    let text = document(&servo, motor, electrical);
    Ok(Exported { text, inexpressible, outside })
}

fn document(servo: &Servo, motor: &BamMotor, electrical: Option<[f64; 2]>) -> String {
    // Torque for each unit of the input, and the damping by the voltage that the motor induces.
    let [torque, induced] = electrical.map_or([1.0, 0.0], |[kt, ohm]| [kt / ohm, kt * kt / ohm]);
    let mut values = Map::new();
    let mut put = |key: &str, value: Value| values.insert(key.to_owned(), value);
    if let Some([kt, ohm]) = electrical {
        put("kt", json!(kt));
        put("R", json!(ohm));
    }
    put("armature", json!(servo.inertia * torque));
    put("q_offset", json!(0.0));
    put("command_delay", json!(servo.delay));
    put("friction_base", json!(servo.coulomb * torque));
    if let Some([force, velocity, exponent]) = servo.stribeck {
        put("friction_stribeck", json!(force * torque));
        put("dtheta_stribeck", json!(velocity));
        put("alpha", json!(exponent));
    }
    if let Some(coefficient) = servo.load {
        put("load_friction_base", json!(coefficient));
        if servo.stribeck.is_some() {
            put("load_friction_stribeck", json!(0.0));
        }
    }
    put("friction_viscous", json!((servo.viscous * torque - induced).max(0.0)));
    put("model", json!(servo.model()));
    put("actuator", json!(motor.actuator));
    let text = serde_json::to_string_pretty(&values);
    text.unwrap_or_else(|_plain| unreachable!("a map of numbers is plain data")) + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{self, AxisScales},
        twin::{AxisFrame, Machine, Source},
    };

    fn servo(input_unit: &'static str, extra: &[(&str, &[f64])]) -> Twin {
        let mut twin = Twin::nominal(Machine::Axis);
        let scales = AxisScales {
            input: 1.0,
            position: 1.0,
            velocity: 1.0,
            acceleration: 1.0,
            sample_period: 1e-3,
            band: 40.0,
            duration: 10.0,
            input_unit,
            position_unit: "rad",
        };
        twin.axis_frame = Some(AxisFrame { position_origin: 0.0, scales });
        twin.instances.clear();
        let basic: [(&str, &[f64]); 3] = [
            ("gantry.inertia", &[0.02]),
            ("drive.friction.coulomb", &[0.3]),
            ("drive.friction.viscous", &[0.5]),
        ];
        for (name, values) in basic.iter().chain(extra) {
            let effect = effects::find(name).unwrap();
            let axis = Machine::Axis.axes(effect.site)[0];
            twin.instances.push(Instance::new(effect, axis, values, Source::Fitted));
        }
        twin
    }

    fn written(twin: &Twin, electrical: Option<[f64; 2]>) -> (Value, Vec<String>) {
        let motor = BamMotor { actuator: "xl330".to_owned(), electrical };
        let exported = export_bam(twin, &motor).unwrap();
        let missing = exported.inexpressible.iter().map(ToString::to_string).collect();
        (serde_json::from_str(&exported.text).unwrap(), missing)
    }

    #[test]
    fn the_smallest_model_with_all_effects_is_written() {
        let stribeck: (&str, &[f64]) = ("drive.friction.stribeck", &[0.1, 0.05, 1.5]);
        let load: (&str, &[f64]) = ("drive.friction.load", &[0.2]);
        for (extra, model) in [
            (vec![], "m1"),
            (vec![stribeck], "m2"),
            (vec![load], "m3"),
            (vec![stribeck, load], "m4"),
        ] {
            let (document, missing) = written(&servo("N m", &extra), None);
            assert_eq!((document["model"].as_str(), missing.len()), (Some(model), 0));
            assert_eq!([&document["friction_base"], &document["armature"]], [0.3, 0.02]);
            assert_eq!(document["alpha"].is_null(), !extra.contains(&stribeck));
            assert_eq!(document["load_friction_base"].is_null(), !extra.contains(&load));
            assert!(document["kt"].is_null());
        }
    }

    #[test]
    fn a_voltage_becomes_a_torque_and_its_induced_part_is_no_friction() {
        let (document, _) = written(&servo("V", &[]), Some([0.3, 2.0]));
        let number = |key: &str| document[key].as_f64().unwrap();
        assert!((number("friction_base") - 0.3 * 0.15).abs() < 1e-12);
        assert!((number("armature") - 0.02 * 0.15).abs() < 1e-12);
        assert!((number("friction_viscous") - (0.5 * 0.15 - 0.09 / 2.0)).abs() < 1e-12);
        assert_eq!((number("kt"), number("R")), (0.3, 2.0));
    }

    #[test]
    fn other_effects_are_listed_and_other_machines_refused() {
        let twin = servo("N m", &[("gantry.stiffness", &[1.0]), ("drive.delay", &[-0.001])]);
        let (document, missing) = written(&twin, None);
        assert_eq!(document["command_delay"], 0.0);
        assert_eq!(missing[0], "gantry.stiffness");
        assert!(missing[1].ends_with(": a delay of -0.001 s"), "{missing:?}");
        let motor = BamMotor { actuator: "xl330".to_owned(), electrical: None };
        let refused = |twin: &Twin| export_bam(twin, &motor).unwrap_err().to_string();
        assert!(refused(&servo("V", &[])).contains("--motor-constant-n-m-per-a"));
        assert!(refused(&servo("N", &[])).contains("an axis with input in N and position in rad"));
        assert!(refused(&Twin::nominal(Machine::Table)).contains("a table without units"));
        let mut weightless = servo("N m", &[]);
        weightless.instances.remove(0);
        assert!(refused(&weightless).contains("gantry.inertia is 0"));
    }
}
