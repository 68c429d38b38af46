//! Position-dependent friction.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site};
use std::f64::consts::TAU;

/// Amplitude of one periodic component.
const WAVE: Parameter = Parameter {
    name: "sine_n",
    symbol: "A",
    unit: "N",
    scale: 0.5,
    bounds: (-500.0, 500.0),
    plausible: (-5.0, 5.0),
    per_session: false,
};

/// `drive.friction.position`: position-dependent friction.
///
/// Q counts from the origin of the coordinate. The polynomial describes a guide that is misaligned
/// or worn in the middle, the sine and cosine a periodic one.
pub(crate) static POSITION: Effect = Effect {
    name: "drive.friction.position",
    summary: "friction depends on the position along the travel",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "Δ|F_f| = s · q + c · q² + A · sin(2π · q / L) + B · cos(2π · q / L)",
    parameters: &[
        Parameter {
            name: "slope_n_per_m",
            symbol: "s",
            unit: "N/m",
            scale: 5.0,
            bounds: (-10000.0, 10000.0),
            plausible: (-100.0, 100.0),
            per_session: false,
        },
        Parameter {
            name: "curvature_n_per_m2",
            symbol: "c",
            unit: "N/m^2",
            scale: 50.0,
            bounds: (-1e6, 1e6),
            plausible: (-2000.0, 2000.0),
            per_session: false,
        },
        WAVE,
        Parameter { name: "cosine_n", symbol: "B", ..WAVE },
        Parameter {
            name: "length_m",
            symbol: "L",
            unit: "m",
            scale: 0.01,
            bounds: (0.02, 1.0),
            plausible: (0.05, 0.5),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0, 0.0, 0.1],
    probes: &[
        &[5.0, 0.0, 0.0, 0.0, 0.1],
        &[0.0, 50.0, 0.0, 0.0, 0.1],
        &[0.0, 0.0, 0.3, 0.0, 0.07],
        &[0.0, 0.0, 0.0, 0.3, 0.07],
        &[0.0, 0.0, 0.3, 0.0, 0.12],
        &[0.0, 0.0, 0.0, 0.3, 0.12],
        &[0.0, 0.0, 0.3, 0.0, 0.2],
        &[0.0, 0.0, 0.0, 0.3, 0.2],
    ],
    memory: 0,
    physics: Physics::Friction(level),
    regressors: &[Regressor::Position, Regressor::Direction],
    signals: Signal::DRIVE,
    excitation: "slow sweeps over the whole travel in both directions",
    experiment: "x_line",
    confused_with: &[
        "drive.ripple.motor",
        "gantry.tilt",
        "gantry.mass_position",
        "drive.friction.asymmetric",
    ],
    reference: "Armstrong 1988, Friction: Experimental Determination, Modeling and Compensation (ICRA)",
};

/// Position-dependent part of the friction level (N).
fn level(p: &[f64], _: &mut [f64], motion: &Motion) -> f64 {
    let (sin, cos) = (TAU * motion.position / p[4]).sin_cos();
    (p[0] + p[1] * motion.position) * motion.position + p[2] * sin + p[3] * cos
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_follows_the_place() {
        let at = |position| Motion { position, velocity: 1.0, ..Motion::default() };
        let parabola = [10.0, 100.0, 0.0, 0.0, 0.1];
        assert!((level(&parabola, &mut [], &at(0.1)) - 2.0).abs() < 1e-12);
        assert!(level(&parabola, &mut [], &at(-0.1)).abs() < 1e-12);
        let wave = [0.0, 0.0, 0.5, -0.2, 0.12];
        assert!((level(&wave, &mut [], &at(0.03)) - 0.5).abs() < 1e-12);
        assert!((level(&wave, &mut [], &at(0.06)) - 0.2).abs() < 1e-12);
        assert_eq!(level(POSITION.null, &mut [], &at(0.1)), 0.0);
    }
}
