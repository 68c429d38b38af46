//! Gravity along a rail.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `gantry.tilt`: M g sin(angle) along one rail. The force is what can be measured; rotors carry
/// inertia but no weight, so the angle would need the carried mass alone.
pub(crate) static TILT: Effect = Effect {
    name: "gantry.tilt",
    says: "a constant force along the rail, the same in both directions of motion, as on a slope",
    domain: Domain::Gantry,
    site: Site::Rails,
    parameters: &[Parameter {
        name: "force_n",
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
    excitation: "slow moves both ways along each rail, with the torque recorded",
    experiment: "x_line",
    confused_with: &["drive.offset", "drive.friction.asymmetric"],
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
