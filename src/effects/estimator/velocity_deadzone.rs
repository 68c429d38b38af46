//! The estimator reports rest below a threshold.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `estimator.velocity_deadzone`: 0 where |v| < threshold, else v; v is the speed where both coordinates are
/// zeroed together.
pub(crate) static VELOCITY_DEADZONE: Effect = Effect {
    name: "estimator.velocity_deadzone",
    says: "the estimator reports exactly zero below a threshold of velocity",
    domain: Domain::Estimator,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "threshold_m_per_s",
        unit: "m/s",
        scale: 0.05,
        bounds: (0.0, 0.5),
        plausible: (0.005, 0.05),
        per_session: false,
    }],
    null: &[0.0],
    // What a threshold changes jumps from sample to sample, so that no slope leads from one to the next.
    probes: &[
        &[0.004],
        &[0.005],
        &[0.0063],
        &[0.008],
        &[0.01],
        &[0.0125],
        &[0.016],
        &[0.02],
        &[0.025],
        &[0.032],
        &[0.04],
        &[0.05],
    ],
    memory: 0,
    physics: Physics::Estimator(|p, _, sample| {
        if sample.velocity.hypot(sample.across) < p[0] { 0.0 } else { sample.velocity }
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
        let both =
            |velocity, across| report(&[0.01], &mut [], &Sample { dt: 0.02, velocity, across });
        let at = |velocity| both(velocity, 0.0);
        assert_eq!((at(0.009), at(-0.009), at(-0.011)), (0.0, 0.0, -0.011));
        assert_eq!((both(0.006, 0.006), both(0.006, -0.009)), (0.0, 0.006));
        assert_eq!(report(VELOCITY_DEADZONE.null, &mut [], &Sample::default()), 0.0);
    }
}
