//! The drive adds a constant to what it is told.

use crate::effects::{COMMAND_UNIT, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.offset`: u -> u + u0, in the unit of the command: m/s of belt for a velocity drive, N for
/// a force drive, where it is a constant force and the published offset of an inverse model is -u0.
/// Source: Janot, Gautier and Brunot 2019 (EMPS).
pub(crate) static OFFSET: Effect = Effect {
    name: "drive.offset",
    says: "the drive adds a constant to its command, whatever the direction and the place",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "offset",
        unit: COMMAND_UNIT,
        scale: 0.01,
        bounds: (-500.0, 500.0),
        plausible: (-0.05, 0.05),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.01], &[1.0]],
    memory: 0,
    physics: Physics::Command(|p, _, command, _| command + p[0]),
    regressors: &[Regressor::Constant],
    excitation: "rest, and slow moves in both directions",
    experiment: "creep",
    confused_with: &["drive.friction.asymmetric", "gantry.tilt"],
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_added_whatever_the_sign_of_the_command() {
        let Physics::Command(offset) = OFFSET.physics else { panic!("offset acts on the command") };
        assert_eq!(offset(&[0.25], &mut [], 1.0, 1e-3), 1.25);
        assert_eq!(offset(&[0.25], &mut [], -1.0, 1e-3), -0.75);
        assert_eq!(offset(OFFSET.null, &mut [], -1.0, 1e-3), -1.0);
    }
}
