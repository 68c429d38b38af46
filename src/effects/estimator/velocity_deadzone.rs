//! The estimator reports rest below a threshold.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `estimator.velocity_deadzone`: 0 where |v| < threshold, else v.
pub(crate) static VELOCITY_DEADZONE: Effect =
    Effect {
        name: "estimator.velocity_deadzone",
        says: "the estimator reports exactly zero below a threshold of velocity",
        domain: Domain::Estimator,
        site: Site::Whole,
        parameters: &[Parameter {
            name: "threshold_m_per_s",
            unit: "m/s",
            scale: 0.005,
            bounds: (0.0, 0.5),
            plausible: (0.005, 0.05),
            per_session: false,
        }],
        null: &[0.0],
        probes: &[&[0.005], &[0.01], &[0.02], &[0.04]],
        memory: 0,
        physics: Physics::Estimator(|p, _, sample| {
            if sample.velocity.abs() < p[0] { 0.0 } else { sample.velocity }
        }),
        regressors: &[Regressor::Speed],
        excitation: "creeping moves, with velocities of the state recorded",
        experiment: "creep",
        confused_with: &["drive.friction.coulomb", "drive.input_deadband"],
    };

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Sample;

    #[test]
    fn slow_is_rest() {
        let Physics::Estimator(report) = VELOCITY_DEADZONE.physics else { panic!("an estimator") };
        let at = |velocity| report(&[0.01], &mut [], &Sample { dt: 0.02, velocity });
        assert_eq!((at(0.009), at(-0.009), at(-0.011)), (0.0, 0.0, -0.011));
        assert_eq!(report(VELOCITY_DEADZONE.null, &mut [], &Sample::default()), 0.0);
    }
}
