//! The rails are not at right angles.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `gantry.squareness`: x + y tan(angle): the y rail leans towards x.
pub(crate) static SQUARENESS: Effect = Effect {
    name: "gantry.squareness",
    says: "the rails are not at right angles, so x shifts in proportion to y",
    domain: Domain::Gantry,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "angle_rad",
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
    excitation: "the corners of the field, with camera and encoders",
    experiment: "diagonal",
    confused_with: &["sensor.camera_scale_rotation", "gantry.cross_coupling"],
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
