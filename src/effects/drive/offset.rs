//! Constant offset of the drive input.

use crate::effects::{COMMAND_UNIT, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.offset`: constant offset of the drive input.
///
/// The unit is that of the command. A velocity drive takes m/s of belt. A force drive takes N:
/// there the offset is a constant force, and the published offset of an inverse model is -u0. On a
/// single axis it acts behind limits and dead bands, where a constant load acts too.
pub(crate) static OFFSET: Effect = Effect {
    name: "drive.offset",
    summary: "the drive adds a constant to its command, independent of direction and position",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "u′ = u + u0",
    parameters: &[Parameter {
        name: "offset",
        symbol: "u0",
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
    signals: Signal::DRIVE,
    excitation: "rest, and slow moves in both directions",
    experiment: "creep",
    confused_with: &["drive.friction.asymmetric", "gantry.tilt"],
    reference: "Janot, Gautier and Brunot 2019, Data Set and Reference Models of EMPS",
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
