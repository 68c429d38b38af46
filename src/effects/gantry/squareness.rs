//! Squareness error of the guides.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.squareness`: squareness error of the guides.
///
/// The y guide leans towards x.
pub(crate) static SQUARENESS: Effect = Effect {
    name: "gantry.squareness",
    summary: "the axes are not at right angles, so x shifts in proportion to y",
    domain: Domain::Gantry,
    site: Site::Whole,
    equation: "x′ = x + y · tan(α)",
    parameters: &[Parameter {
        name: "angle_rad",
        symbol: "α",
        unit: "rad",
        scale: 0.01,
        bounds: (-0.5, 0.5),
        plausible: (-0.018, 0.018),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.005]],
    memory: 0,
    physics: Physics::Frame(|p, carriage| {
        let [x, y] = carriage.position;
        [x + p[0].tan() * y, y]
    }),
    regressors: &[Regressor::OtherAxis, Regressor::Position],
    signals: Signal::STRIKER,
    excitation: "the corners of the workspace, with camera and encoders",
    experiment: "diagonal",
    confused_with: &["sensor.camera_scale_rotation", "gantry.cross_coupling"],
    reference: "Slocum 1992, Precision Machine Design (geometric errors)",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Carriage;

    #[test]
    fn x_shifts_with_y() {
        let Physics::Frame(frame) = SQUARENESS.physics else { panic!("a frame") };
        let carriage = Carriage { position: [0.05, -0.2], ..Carriage::default() };
        let [x, y] = frame(&[0.01], &carriage);
        assert!((x - 0.047_999_933).abs() < 1e-8 && y == -0.2, "{x}");
        assert_eq!(frame(SQUARENESS.null, &carriage), carriage.position);
    }
}
