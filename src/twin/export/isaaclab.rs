//! The text of an explicit actuator for Isaac Lab.

use super::mechanics::{CARRIAGE_KG, Drive, Guide, Mechanics};
use crate::twin::Twin;

/// The file, with a placeholder for the parameters.
const TEMPLATE: &str = include_str!("isaaclab_actuator.py");
/// Placeholder for the parameters.
const PLACE: &str = "@CONSTANTS@";

/// The drives of one gantry.
pub(super) fn table(twin: &Twin, mechanics: &Mechanics) -> String {
    let of_drives = |get: fn(&Drive) -> f64| mechanics.drives.each_ref().map(get);
    let of_guides = |get: fn(&Guide) -> f64| mechanics.guides.each_ref().map(get);
    let [x, y] = mechanics.mass;
    let bodies = [CARRIAGE_KG + twin.striker_mass, 1.5 * CARRIAGE_KG + twin.striker_mass];
    let armature = [(x - bodies[0]).max(0.0), (y - bodies[1]).max(0.0)];
    let columns = [
        ("COMMAND_DELAY_S", of_drives(|own| own.delay)),
        ("COMMAND_GAIN", of_drives(|own| own.gain)),
        ("COMMAND_OFFSET_M_PER_S", of_drives(|own| own.offset)),
        ("LAG_S", of_drives(|own| own.lag)),
        ("PROPORTIONAL_N_S_PER_M", of_drives(|own| own.proportional)),
        ("INTEGRAL_N_PER_M", of_drives(|own| own.integral)),
        ("FEEDBACK_DELAY_S", of_drives(|own| own.feedback_delay)),
        ("ESTIMATOR_TIME_CONSTANT_S", of_drives(|own| own.estimator_time_constant)),
        ("BELT_DAMPING_N_S_PER_M", of_drives(|own| own.damping)),
        ("MASS_KG", mechanics.mass),
        ("DAMPING_N_S_PER_M", of_guides(|own| own.damping)),
        ("CONSTANT_FORCE_N", of_guides(|own| own.force)),
        ("JOINT_FRICTION_N", of_guides(|own| own.friction)),
        ("JOINT_ARMATURE_KG", armature),
    ];
    let slew = mechanics
        .drives
        .each_ref()
        .map(|own| own.slew.map_or_else(|| "None".to_owned(), |limit| format!("{limit:?}")));
    let mut lines: Vec<String> =
        columns.iter().map(|(name, [a, b])| format!("{name} = [{a:?}, {b:?}]")).collect();
    lines.push(format!("SLEW_LIMIT_M_PER_S2 = [{}]", slew.join(", ")));
    TEMPLATE.replace(PLACE, &(lines.join("\n") + "\n"))
}
