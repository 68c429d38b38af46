//! The camera's clock runs fast or slow.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `sensor.clock_skew`: t' = (1 + e) t, so that what the camera reports ages by e seconds per second
/// of the session. Its constant part is `sensor.camera_latency`.
pub(crate) static CLOCK_SKEW: Effect = Effect {
    name: "sensor.clock_skew",
    says: "the camera's clock drifts, so its reports grow older during the session",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "skew",
        unit: "1",
        scale: 1e-4,
        bounds: (-0.02, 0.02),
        plausible: (-5e-4, 5e-4),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1e-4]],
    memory: 0,
    physics: Physics::CameraDelay(|p, elapsed| p[0] * elapsed),
    regressors: &[Regressor::Time, Regressor::Velocity],
    excitation: "the same fast move at the beginning and at the end of a long session",
    experiment: "circle",
    confused_with: &["sensor.camera_latency", "drive.friction.thermal_drift", "drive.delay"],
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_grow_older() {
        let Physics::CameraDelay(age) = CLOCK_SKEW.physics else { panic!("a delay") };
        assert!((age(&[2e-4], 60.0) - 0.012).abs() < 1e-15);
        assert_eq!(age(CLOCK_SKEW.null, 60.0), 0.0);
    }
}
