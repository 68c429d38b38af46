//! Spring along a single axis.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.stiffness`: spring along a single axis.
///
/// Examples are a return spring, a flexible cable, and the weight of an arm near its lowest position. The rest position
/// of the spring is part of `drive.offset`.
pub(crate) static STIFFNESS: Effect = Effect {
    name: "gantry.stiffness",
    summary: "a spring pulls the axis back to one position",
    domain: Domain::Gantry,
    site: Site::SingleAxis,
    equation: "F = −k · q",
    parameters: &[Parameter {
        name: "stiffness_n_per_m",
        symbol: "k",
        unit: "N/m",
        scale: 5.0,
        bounds: (-1e4, 1e4),
        plausible: (-1e3, 1e3),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[5.0]],
    memory: 0,
    physics: Physics::Force(|p, _, motion| -p[0] * motion.position),
    regressors: &[Regressor::Position],
    signals: &[Signal::AxisInput],
    excitation: "slow moves in both directions over the whole travel",
    experiment: "",
    confused_with: &["gantry.endstop", "drive.ripple.motor", "drive.friction.position"],
    reference: "Hooke's law",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_pulls_back_to_the_origin() {
        let Physics::Force(force) = STIFFNESS.physics else { panic!("it is a force") };
        let at = |position| Motion { position, ..Motion::default() };
        assert_eq!(force(&[20.0], &mut [], &at(0.1)), -2.0);
        assert_eq!(force(&[20.0], &mut [], &at(-0.1)), 2.0);
        assert_eq!(force(STIFFNESS.null, &mut [], &at(0.3)), 0.0);
    }
}
