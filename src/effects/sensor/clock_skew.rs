//! Clock skew of the camera.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.clock_skew`: clock skew of the camera.
///
/// The latency of the camera grows by e seconds per second of the session. Its constant part is
/// `sensor.camera_latency`.
pub(crate) static CLOCK_SKEW: Effect = Effect {
    name: "sensor.clock_skew",
    summary: "the clock of the camera drifts, so its latency changes during the session",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "p′(t) = p(t − ε · t)",
    parameters: &[Parameter {
        name: "skew",
        symbol: "ε",
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
    signals: Signal::CAMERA,
    excitation: "the same fast move at the beginning and at the end of a long session",
    experiment: "circle",
    confused_with: &["sensor.camera_latency", "drive.friction.thermal_drift", "drive.delay"],
    reference: "Moon, Skelly and Towsley 1999, Estimation and Removal of Clock Skew from Network Delay Measurements (INFOCOM)",
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
