//! Dead zone of the reported velocity.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `estimator.velocity_deadzone`: dead zone of the reported velocity.
///
/// V is the speed where the estimator zeroes both coordinates together. The effect is sought only where velocities of
/// exactly zero are reported.
pub(crate) static VELOCITY_DEADZONE: Effect = Effect {
    name: "estimator.velocity_deadzone",
    summary: "the estimator reports zero velocity below a threshold",
    domain: Domain::Estimator,
    site: Site::Whole,
    equation: "v′ = 0 for |v| < v0, otherwise v",
    parameters: &[Parameter {
        name: "threshold_m_per_s",
        symbol: "v0",
        unit: "m/s",
        scale: 0.05,
        bounds: (0.0, 0.5),
        plausible: (0.005, 0.05),
        per_session: false,
    }],
    null: &[0.0],
    // The cost is piecewise constant in the threshold, so no gradient connects the start values.
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
    signals: Signal::STATE,
    excitation: "creeping moves, with the velocities of the state estimator recorded, of which some are exactly zero",
    experiment: "creep",
    confused_with: &["drive.friction.coulomb", "drive.input_deadband"],
    reference: "Tao and Kokotović 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
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
