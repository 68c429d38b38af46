//! Gravity along an axis.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.tilt`: force M g sin(angle) along one axis. Only the force is identifiable. Rotors have
/// inertia and no weight, so the angle would need the carried mass alone.
pub(crate) static TILT: Effect = Effect {
    name: "gantry.tilt",
    summary: "a constant force acts along the axis, the same in both directions of motion, as on a slope",
    domain: Domain::Gantry,
    site: Site::Guides,
    equation: "F = F_g",
    parameters: &[Parameter {
        name: "force_n",
        symbol: "F_g",
        unit: "N",
        scale: 0.2,
        bounds: (-500.0, 500.0),
        plausible: (-1.0, 1.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.2]],
    memory: 0,
    physics: Physics::Force(|p, _, _| p[0]),
    regressors: &[Regressor::Constant],
    signals: Signal::DRIVE,
    excitation: "slow moves in both directions along each axis, with the torque recorded",
    experiment: "x_line",
    confused_with: &["drive.offset", "drive.friction.asymmetric"],
    reference: "Khalil and Dombre 2002, Modeling, Identification and Control of Robots (gravity terms)",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_force_knows_no_direction() {
        let Physics::Force(force) = TILT.physics else { panic!("a force") };
        let at = |velocity| force(&[-0.3], &mut [], &Motion { velocity, ..Motion::default() });
        assert_eq!((at(0.2), at(-0.2)), (-0.3, -0.3));
    }
}
