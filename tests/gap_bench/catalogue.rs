//! The effects that the bench plants in its gantry: name, where it acts, how large it may be.

use crate::gantry::{BELT_PER_TURN, Gantry, HALF_STROKE, POSITION_LENGTH, ROTOR_MASS};
use std::f64::consts::TAU;

/// Coordinates on which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// Motors a and b; may sit on one.
    Motors,
    /// Rails x and y; may sit on one.
    Rails,
    /// The whole machine.
    Whole,
}

/// How its size is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sizing {
    /// Bisected until it is so many times the noise, lines over 2 s taken out.
    Moving,
    /// The same, lines left in: the effect is a constant.
    Constant,
    /// Given by the range alone: it is about the noise itself.
    Free,
}

/// One effect: `apply` sets it with a magnitude within `range`, `value` reads the parameter back.
pub(crate) struct Spec {
    pub(crate) name: &'static str,
    pub(crate) parameter: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) place: Place,
    pub(crate) sizing: Sizing,
    /// Smallest and largest magnitude.
    pub(crate) range: [f64; 2],
    /// May be negative.
    pub(crate) signed: bool,
    /// A changed parameter of something that the plain twin has.
    pub(crate) known: bool,
    /// Rig that it needs, when not any.
    pub(crate) rig: Option<usize>,
    /// Names that the same recordings honestly allow beside it.
    pub(crate) alike: &'static [&'static str],
    pub(crate) apply: fn(&mut Gantry, [f64; 2], f64),
    pub(crate) value: fn(&Gantry, usize) -> f64,
}

impl Spec {
    pub(crate) fn domain(&self) -> &'static str {
        self.name.split('.').next().unwrap_or_default()
    }
}

const PLAIN: Spec = Spec {
    name: "",
    parameter: "",
    unit: "",
    place: Place::Whole,
    sizing: Sizing::Moving,
    range: [0.0, 0.0],
    signed: false,
    known: false,
    rig: None,
    alike: &[],
    apply: |_, _, _| {},
    value: |_, _| 0.0,
};

fn spread(field: &mut [f64; 2], on: [f64; 2], by: f64) {
    for (value, on) in field.iter_mut().zip(on) {
        *value += on * by;
    }
}

/// Finds an effect by name.
pub(crate) fn spec(name: &str) -> &'static Spec {
    [DRIVE, FRICTION, FRAME, SENSING]
        .into_iter()
        .flatten()
        .find(|spec| spec.name == name)
        .unwrap_or_else(|| unreachable!("{name} is not in the bench's catalogue"))
}

/// All effects of the gantry.
pub(crate) fn all() -> impl Iterator<Item = &'static Spec> {
    [DRIVE, FRICTION, FRAME, SENSING].into_iter().flatten()
}

static DRIVE: &[Spec] = &[
    Spec {
        name: "drive.gain",
        parameter: "gain",
        unit: "1",
        place: Place::Motors,
        range: [0.001, 0.2],
        signed: true,
        apply: |rig, on, m| spread(&mut rig.drive.gain_error, on, m),
        value: |rig, i| 1.0 + rig.drive.gain_error[i],
        ..PLAIN
    },
    Spec {
        name: "drive.offset",
        parameter: "offset_m_per_s",
        unit: "m/s",
        place: Place::Motors,
        sizing: Sizing::Constant,
        range: [1e-4, 0.04],
        signed: true,
        apply: |rig, on, m| spread(&mut rig.drive.offset, on, m),
        value: |rig, i| rig.drive.offset[i],
        ..PLAIN
    },
    Spec {
        name: "drive.delay",
        parameter: "delay_s",
        unit: "s",
        place: Place::Motors,
        range: [0.0002, 0.06],
        apply: |rig, on, m| spread(&mut rig.drive.delay, on, m),
        value: |rig, i| rig.drive.delay[i],
        ..PLAIN
    },
    Spec {
        name: "drive.lag1",
        parameter: "tau_s",
        unit: "s",
        place: Place::Motors,
        range: [0.0005, 0.05],
        alike: &["drive.delay"],
        apply: |rig, on, m| spread(&mut rig.drive.lag, on, m),
        value: |rig, i| rig.drive.lag[i],
        ..PLAIN
    },
    Spec {
        name: "drive.velocity_loop",
        parameter: "natural_frequency_hz",
        unit: "Hz",
        place: Place::Motors,
        range: [0.01, 0.7],
        known: true,
        apply: |rig, on, m| {
            for i in 0..2 {
                rig.drive.kp[i] *= 1.0 - on[i] * m;
                rig.drive.ki[i] *= (1.0 - on[i] * m).powi(2);
            }
        },
        value: |rig, i| (rig.drive.ki[i] / (ROTOR_MASS + 0.2375)).sqrt() / TAU,
        ..PLAIN
    },
    Spec {
        name: "drive.input_deadband",
        parameter: "threshold_m_per_s",
        unit: "m/s",
        place: Place::Motors,
        range: [0.001, 0.07],
        apply: |rig, on, m| spread(&mut rig.drive.deadband, on, m),
        value: |rig, i| rig.drive.deadband[i],
        ..PLAIN
    },
    Spec {
        name: "drive.saturation.torque_speed",
        parameter: "no_load_speed_m_per_s",
        unit: "m/s",
        place: Place::Motors,
        range: [0.15, 1.4],
        apply: |rig, on, m| {
            for i in 0..2 {
                rig.drive.force_limit[i] *= 1.0 - 0.3 * on[i];
                rig.drive.fall[i] += on[i] * m;
            }
        },
        value: |rig, i| 1.0 / rig.drive.fall[i],
        ..PLAIN
    },
    Spec {
        name: "drive.saturation.slew",
        parameter: "limit_m_per_s2",
        unit: "m/s^2",
        place: Place::Motors,
        range: [0.01, 0.6],
        known: true,
        apply: |rig, on, m| {
            for i in 0..2 {
                rig.drive.ramp[i] *= 1.0 - on[i] * m;
            }
        },
        value: |rig, i| rig.drive.ramp[i],
        ..PLAIN
    },
    Spec {
        name: "drive.supply_sag",
        parameter: "sag_at_12_w",
        unit: "1",
        range: [0.005, 0.25],
        alike: &["drive.saturation.torque_speed"],
        apply: |rig, _, m| rig.drive.sag += m,
        value: |rig, _| rig.drive.sag,
        ..PLAIN
    },
    Spec {
        name: "drive.backlash",
        parameter: "width_m",
        unit: "m",
        place: Place::Motors,
        range: [2e-5, 2e-3],
        apply: |rig, on, m| spread(&mut rig.drive.backlash, on, m),
        value: |rig, i| rig.drive.backlash[i],
        ..PLAIN
    },
    Spec {
        name: "drive.compliance.belt",
        parameter: "stiffness_n_per_m",
        unit: "N/m",
        place: Place::Motors,
        range: [8e-6, 5e-4],
        alike: &["coupling.magnet_spring"],
        apply: |rig, on, m| spread(&mut rig.drive.belt, on, m),
        value: |rig, i| 1.0 / rig.drive.belt[i],
        ..PLAIN
    },
    Spec {
        name: "drive.ripple.belt_tooth",
        parameter: "amplitude_n",
        unit: "N",
        place: Place::Motors,
        range: [0.02, 1.2],
        apply: |rig, on, m| spread(&mut rig.drive.tooth, on, m),
        value: |rig, i| rig.drive.tooth[i],
        ..PLAIN
    },
    Spec {
        name: "drive.ripple.pulley",
        parameter: "amplitude_n",
        unit: "N",
        place: Place::Motors,
        range: [0.02, 1.2],
        alike: &["drive.ripple.motor"],
        apply: |rig, on, m| spread(&mut rig.drive.pulley, on, m),
        value: |rig, i| rig.drive.pulley[i],
        ..PLAIN
    },
];

macro_rules! rail_friction {
    ($name:literal, $parameter:literal, $unit:literal, $field:ident, $range:expr, $known:expr) => {
        Spec {
            name: $name,
            parameter: $parameter,
            unit: $unit,
            place: Place::Rails,
            range: $range,
            known: $known,
            apply: |rig, on, m| {
                for i in 0..2 {
                    rig.friction[i].$field += on[i] * m;
                }
            },
            value: |rig, i| rig.friction[i].$field,
            ..PLAIN
        }
    };
}

static FRICTION: &[Spec] = &[
    rail_friction!("drive.friction.coulomb", "force_n", "N", coulomb, [0.03, 6.0], true),
    rail_friction!(
        "drive.friction.viscous",
        "slope_n_s_per_m",
        "N s/m",
        viscous,
        [0.1, 14.0],
        true
    ),
    rail_friction!(
        "drive.friction.quadratic",
        "coefficient_n_s2_per_m2",
        "N s^2/m^2",
        quadratic,
        [0.2, 20.0],
        false
    ),
    rail_friction!("drive.friction.asymmetric", "asymmetry", "1", asymmetry, [0.02, 0.33], false),
    rail_friction!("drive.friction.stribeck", "excess_n", "N", stribeck, [0.05, 3.0], false),
    Spec {
        name: "drive.friction.presliding",
        parameter: "stiffness_n_per_m",
        unit: "N/m",
        place: Place::Rails,
        range: [1e-6, 1e-4],
        apply: |rig, on, m| {
            for i in 0..2 {
                if on[i] > 0.0 {
                    rig.friction[i].presliding = 1.0 / m;
                }
            }
        },
        value: |rig, i| rig.friction[i].presliding,
        ..PLAIN
    },
    rail_friction!("drive.friction.load", "coefficient", "1", load, [0.01, 0.3], false),
    rail_friction!(
        "drive.friction.position",
        "relative_amplitude",
        "1",
        position,
        [0.02, 0.35],
        false
    ),
    Spec {
        name: "drive.friction.thermal_drift",
        parameter: "drop",
        unit: "1",
        place: Place::Rails,
        sizing: Sizing::Constant,
        range: [0.02, 0.4],
        apply: |rig, on, m| {
            for i in 0..2 {
                rig.friction[i].thermal += on[i] * m;
            }
        },
        value: |rig, i| rig.friction[i].thermal,
        ..PLAIN
    },
];

static FRAME: &[Spec] = &[
    Spec {
        name: "gantry.cross_coupling",
        parameter: "mass_kg",
        unit: "kg",
        range: [0.01, 0.45],
        signed: true,
        apply: |rig, _, m| rig.frame.cross_mass += m,
        value: |rig, _| rig.frame.cross_mass,
        ..PLAIN
    },
    Spec {
        name: "gantry.racking",
        parameter: "mass_kg_at_half_stroke",
        unit: "kg",
        range: [0.02, 0.45],
        signed: true,
        apply: |rig, _, m| rig.frame.racking_mass += m,
        value: |rig, _| rig.frame.racking_mass,
        ..PLAIN
    },
    Spec {
        name: "gantry.belt_asymmetry",
        parameter: "friction_ratio",
        unit: "1",
        range: [0.05, 0.33],
        signed: true,
        rig: Some(3),
        apply: |rig, _, m| {
            rig.friction[2].coulomb *= 1.0 + m;
            rig.friction[3].coulomb *= 1.0 - m;
        },
        value: |rig, _| rig.friction[2].coulomb / rig.friction[3].coulomb,
        ..PLAIN
    },
    Spec {
        name: "gantry.mass_position",
        parameter: "relative_slope_per_m",
        unit: "1/m",
        place: Place::Rails,
        range: [0.01, 0.3],
        apply: |rig, on, m| spread(&mut rig.frame.mass_position, on, m),
        value: |rig, i| rig.frame.mass_position[i] / HALF_STROKE[i],
        ..PLAIN
    },
    Spec {
        name: "gantry.tilt",
        parameter: "slope_rad",
        unit: "rad",
        place: Place::Rails,
        sizing: Sizing::Constant,
        range: [0.002, 0.035],
        signed: true,
        alike: &["drive.offset"],
        apply: |rig, on, m| spread(&mut rig.frame.tilt, on, m),
        value: |rig, i| rig.frame.tilt[i],
        ..PLAIN
    },
    Spec {
        name: "gantry.endstop",
        parameter: "stiffness_n_per_m",
        unit: "N/m",
        range: [20.0, 5e3],
        apply: |rig, _, m| rig.frame.endstop += m,
        value: |rig, _| rig.frame.endstop,
        ..PLAIN
    },
    Spec {
        name: "gantry.squareness",
        parameter: "angle_rad",
        unit: "rad",
        sizing: Sizing::Constant,
        range: [5e-4, 0.0175],
        signed: true,
        apply: |rig, _, m| rig.frame.squareness += m,
        value: |rig, _| rig.frame.squareness,
        ..PLAIN
    },
    Spec {
        name: "coupling.magnet_spring",
        parameter: "stiffness_n_per_m",
        unit: "N/m",
        range: [0.002, 0.05],
        apply: |rig, _, m| rig.coupling.magnet += m,
        value: |rig, _| 1.0 / rig.coupling.magnet,
        ..PLAIN
    },
    Spec {
        name: "coupling.magnet_slip",
        parameter: "force_n",
        unit: "N",
        sizing: Sizing::Free,
        range: [0.05, 0.08],
        alike: &["coupling.magnet_spring"],
        apply: |rig, _, m| {
            rig.coupling.magnet = 1.0 / 400.0;
            rig.coupling.slip_force = m;
        },
        value: |rig, _| rig.coupling.slip_force,
        ..PLAIN
    },
    Spec {
        name: "coupling.striker_friction",
        parameter: "force_n",
        unit: "N",
        range: [0.02, 0.45],
        alike: &["coupling.magnet_spring", "drive.backlash"],
        apply: |rig, _, m| {
            rig.coupling.magnet = 1.0 / 400.0;
            rig.coupling.striker_friction = m;
        },
        value: |rig, _| rig.coupling.striker_friction,
        ..PLAIN
    },
    Spec {
        name: "coupling.striker_wobble",
        parameter: "gain",
        unit: "1",
        range: [0.03, 1.5],
        alike: &["coupling.magnet_spring"],
        apply: |rig, _, m| rig.coupling.wobble += m,
        value: |rig, _| rig.coupling.wobble,
        ..PLAIN
    },
];

static SENSING: &[Spec] = &[
    Spec {
        name: "sensor.camera_latency",
        parameter: "latency_s",
        unit: "s",
        range: [5e-4, 0.06],
        apply: |rig, _, m| rig.sensors.latency += m,
        value: |rig, _| rig.sensors.latency,
        ..PLAIN
    },
    Spec {
        name: "sensor.camera_scale_rotation",
        parameter: "rotation_rad",
        unit: "rad",
        sizing: Sizing::Constant,
        range: [5e-4, 0.03],
        signed: true,
        apply: |rig, _, m| {
            rig.sensors.scale_error += m;
            rig.sensors.rotation += m;
        },
        value: |rig, _| rig.sensors.rotation,
        ..PLAIN
    },
    Spec {
        name: "sensor.camera_distortion",
        parameter: "relative_at_edge",
        unit: "1",
        sizing: Sizing::Constant,
        range: [5e-4, 0.1],
        signed: true,
        alike: &["sensor.camera_scale_rotation"],
        apply: |rig, _, m| rig.sensors.distortion += m,
        value: |rig, _| rig.sensors.distortion,
        ..PLAIN
    },
    Spec {
        name: "sensor.frame_jitter",
        parameter: "sd_s",
        unit: "s",
        range: [1e-4, 3e-3],
        apply: |rig, _, m| rig.sensors.jitter += m,
        value: |rig, _| rig.sensors.jitter,
        ..PLAIN
    },
    Spec {
        name: "sensor.frame_drop",
        parameter: "fraction",
        unit: "1",
        sizing: Sizing::Free,
        range: [0.03, 0.1],
        alike: &["sensor.frame_jitter"],
        apply: |rig, _, m| rig.sensors.drop += m,
        value: |rig, _| rig.sensors.drop,
        ..PLAIN
    },
    Spec {
        name: "sensor.encoder_eccentricity",
        parameter: "amplitude_m",
        unit: "m",
        place: Place::Motors,
        range: [1e-6, 1e-4],
        apply: |rig, on, m| spread(&mut rig.drive.eccentricity, on, m),
        value: |rig, i| rig.drive.eccentricity[i],
        ..PLAIN
    },
    Spec {
        name: "sensor.clock_skew",
        parameter: "rate",
        unit: "1",
        range: [1e-5, 1e-3],
        apply: |rig, _, m| rig.sensors.skew += m,
        value: |rig, _| rig.sensors.skew,
        ..PLAIN
    },
    Spec {
        name: "sensor.noise_model",
        parameter: "factor",
        unit: "1",
        sizing: Sizing::Free,
        range: [2.0, 3.0],
        apply: |rig, _, m| rig.sensors.camera_noise *= m,
        value: |rig, _| rig.sensors.camera_noise / 2.5e-4,
        ..PLAIN
    },
    Spec {
        name: "estimator.velocity_deadzone",
        parameter: "threshold_m_per_s",
        unit: "m/s",
        range: [0.003, 0.05],
        rig: Some(4),
        apply: |rig, _, m| rig.sensors.deadzone += m,
        value: |rig, _| rig.sensors.deadzone,
        ..PLAIN
    },
    Spec {
        name: "estimator.lag",
        parameter: "tau_s",
        unit: "s",
        range: [5e-4, 0.05],
        rig: Some(4),
        apply: |rig, _, m| rig.sensors.estimator_lag += m,
        value: |rig, _| rig.sensors.estimator_lag,
        ..PLAIN
    },
];

/// Parameters that are the same in every case of an effect: name, unit, value.
pub(crate) fn fixed(name: &str) -> &'static [(&'static str, &'static str, f64)] {
    match name {
        "drive.friction.stribeck" => &[("speed_m_per_s", "m/s", 0.012), ("exponent", "1", 1.0)],
        "drive.friction.position" => &[("length_m", "m", POSITION_LENGTH)],
        "drive.friction.thermal_drift" => &[("time_constant_s", "s", 10.0)],
        "drive.ripple.belt_tooth" => &[("period_m", "m", 0.002)],
        "drive.ripple.pulley" => &[("period_m", "m", BELT_PER_TURN)],
        "coupling.striker_friction" | "coupling.magnet_slip" => {
            &[("stiffness_n_per_m", "N/m", 400.0)]
        }
        "coupling.striker_wobble" => &[("frequency_hz", "Hz", 11.0)],
        _ => &[],
    }
}
