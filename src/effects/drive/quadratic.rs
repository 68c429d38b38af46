//! Quadratic friction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.quadratic`: resistance in proportion to the square of velocity.
pub(crate) static QUADRATIC: Effect = Effect {
    name: "drive.friction.quadratic",
    summary: "a resistance grows with the square of velocity",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "F_f = −F_q · v · |v|",
    parameters: &[Parameter {
        name: "coefficient_n_s2_per_m2",
        symbol: "F_q",
        unit: "N s^2/m^2",
        scale: 2.0,
        bounds: (0.0, 5000.0),
        plausible: (0.1, 20.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[2.0]],
    memory: 0,
    physics: Physics::Force(|p, _, motion| -p[0] * motion.velocity * motion.velocity.abs()),
    regressors: &[Regressor::Speed, Regressor::Velocity],
    signals: Signal::DRIVE,
    excitation: "maximum speed and half of it, in both directions",
    experiment: "ramp",
    confused_with: &[
        "drive.friction.viscous",
        "drive.friction.stribeck",
        "drive.saturation.torque_speed",
    ],
    reference: "Olsson, Åström, Canudas de Wit, Gäfvert and Lischinsky 1998, European Journal of Control 4(3), 176-195",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_opposes_the_motion_with_the_square_of_speed() {
        let Physics::Force(force) = QUADRATIC.physics else { panic!("it is a force") };
        let at = |velocity| Motion { velocity, ..Motion::default() };
        assert_eq!(force(&[3.0], &mut [], &at(2.0)), -12.0);
        assert_eq!(force(&[3.0], &mut [], &at(-2.0)), 12.0);
        assert_eq!(force(QUADRATIC.null, &mut [], &at(2.0)), 0.0);
    }
}
