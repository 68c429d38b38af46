//! Gravity on an arm.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.gravity`: weight of an arm on a rotary axis.
///
/// The amplitude sqrt(A^2 + B^2) is m g l, of the mass m with its centre at the distance l from the axis. The angle q is
/// that of the recording, so its zero must be the same in all sessions. Where the recorded angle is that of a motor
/// behind a gear, the weight is a `drive.ripple.motor` with the period of one turn of the arm.
pub(crate) static GRAVITY: Effect = Effect {
    name: "gantry.gravity",
    summary: "the weight of an arm acts on a rotary axis, in proportion to the sine of an angle",
    domain: Domain::Gantry,
    site: Site::SingleAxis,
    equation: "F = −A · sin q − B · cos q",
    parameters: &[
        Parameter {
            name: "sine_n",
            symbol: "A",
            unit: "N",
            scale: 0.5,
            bounds: (-500.0, 500.0),
            plausible: (-50.0, 50.0),
            per_session: false,
        },
        Parameter {
            name: "cosine_n",
            symbol: "B",
            unit: "N",
            scale: 0.5,
            bounds: (-500.0, 500.0),
            plausible: (-50.0, 50.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.5, 0.0], &[0.0, 0.5]],
    memory: 0,
    physics: Physics::Force(|p, _, motion| {
        let (sine, cosine) = (motion.position_origin + motion.position).sin_cos();
        -p[0] * sine - p[1] * cosine
    }),
    regressors: &[Regressor::Position],
    signals: &[Signal::AxisInput],
    excitation: "slow moves in both directions over a large angle",
    experiment: "",
    confused_with: &["gantry.stiffness", "drive.ripple.motor", "drive.friction.position"],
    reference: "Khalil and Dombre 2002, Modeling, Identification and Control of Robots (gravity terms)",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_acts_at_the_recorded_angle() {
        let Physics::Force(force) = GRAVITY.physics else { panic!("it is a force") };
        let at = |position, position_origin| {
            force(&[3.0, 0.5], &mut [], &Motion { position, position_origin, ..Motion::default() })
        };
        let expected = -3.0 * 1.2_f64.sin() - 0.5 * 1.2_f64.cos();
        assert!((at(1.2, 0.0) - expected).abs() < 1e-12);
        assert!((at(0.2, 1.0) - expected).abs() < 1e-12);
        let rest = force(GRAVITY.null, &mut [], &Motion { position: 0.3, ..Motion::default() });
        assert_eq!(rest, 0.0);
    }
}
