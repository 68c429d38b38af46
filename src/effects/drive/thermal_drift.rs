//! Friction that changes while the drive warms up.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.thermal_drift`: friction that changes while the drive warms up.
///
/// T is the time since the session began. Warm grease makes d_c and d_v negative.
pub(crate) static THERMAL_DRIFT: Effect = Effect {
    name: "drive.friction.thermal_drift",
    summary: "friction changes slowly while the drive warms up",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "Δ|F_f| = (d_c + d_v · |v|) · (1 − exp(−t / T))",
    parameters: &[
        Parameter {
            name: "coulomb_change_n",
            symbol: "d_c",
            unit: "N",
            scale: 0.5,
            bounds: (-500.0, 500.0),
            plausible: (-10.0, 0.0),
            per_session: false,
        },
        Parameter {
            name: "viscous_change_n_s_per_m",
            symbol: "d_v",
            unit: "N s/m",
            scale: 2.0,
            bounds: (-5000.0, 5000.0),
            plausible: (-40.0, 0.0),
            per_session: false,
        },
        Parameter {
            name: "time_constant_s",
            symbol: "T",
            unit: "s",
            scale: 20.0,
            bounds: (1.0, 10000.0),
            plausible: (5.0, 2000.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 30.0],
    probes: &[&[-0.5, 0.0, 10.0], &[0.0, -2.0, 10.0], &[-0.5, 0.0, 100.0], &[0.0, -2.0, 100.0]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| {
        (p[0] + p[1] * motion.velocity.abs()) * (1.0 - (-motion.time / p[2]).exp())
    }),
    regressors: &[Regressor::Time, Regressor::Direction],
    signals: Signal::DRIVE,
    excitation: "a long session of one repeated move",
    experiment: "x_line",
    confused_with: &["drive.friction.coulomb", "drive.friction.viscous", "sensor.noise_model"],
    reference: "Bittencourt and Gunnarsson 2012, ASME Journal of Dynamic Systems, Measurement, and Control 134(5), 051013",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_starts_cold_and_settles() {
        let Physics::Friction(level) = THERMAL_DRIFT.physics else { panic!("it is friction") };
        let at = |time| Motion { time, velocity: -0.5, ..Motion::default() };
        let p = [-1.0, -2.0, 10.0];
        assert_eq!(level(&p, &mut [], &at(0.0)), 0.0);
        assert!((level(&p, &mut [], &at(10.0)) + 2.0 * (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
        assert_eq!(level(THERMAL_DRIFT.null, &mut [], &at(10.0)), 0.0);
    }
}
