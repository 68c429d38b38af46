//! Position-dependent moving mass.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site};

/// Smallest remaining fraction of the moving mass.
const LEAST_FRACTION: f64 = 0.2;

/// `gantry.mass_position`: position-dependent moving mass.
///
/// Q is the position on the axis in the board frame. Examples are a cable that is carried along, or
/// a bridge that is carried off its centre. Lagrange's equation with the kinetic energy M(q) v^2 /
/// 2 gives the term in v^2.
pub(crate) static MASS_POSITION: Effect = Effect {
    name: "gantry.mass_position",
    summary: "the moving mass changes along the axis",
    domain: Domain::Gantry,
    site: Site::Guides,
    equation: "M(q) = M + m1 · q + m2 · q², M(q) · a + ½ · dM/dq · v² = F",
    parameters: &[
        Parameter {
            name: "slope_kg_per_m",
            symbol: "m1",
            unit: "kg/m",
            scale: 0.5,
            bounds: (-50.0, 50.0),
            plausible: (-3.0, 3.0),
            per_session: false,
        },
        Parameter {
            name: "curvature_kg_per_m2",
            symbol: "m2",
            unit: "kg/m^2",
            scale: 5.0,
            bounds: (-500.0, 500.0),
            plausible: (-30.0, 30.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.5, 0.0], &[0.0, 5.0]],
    memory: 0,
    physics: Physics::Both(&[
        Physics::Inertia(extra_mass),
        Physics::Force(|p, _, at| carried(p, at)),
    ]),
    regressors: &[Regressor::Acceleration, Regressor::Position],
    signals: Signal::DRIVE,
    excitation: "accelerations at many positions along the axis, with the torque recorded",
    experiment: "random_walk",
    confused_with: &["drive.friction.position", "gantry.inertia"],
    reference: "Lagrange's equations; Khalil and Dombre 2002, Modeling, Identification and Control of Robots",
};

fn extra_mass(p: &[f64], motion: &Motion) -> f64 {
    let extra = (p[0] + p[1] * motion.position) * motion.position;
    if 0.0 < motion.mass { extra.max((LEAST_FRACTION - 1.0) * motion.mass) } else { extra }
}

/// Force of the change of mass along the axis (N): -1/2 dM/dq v^2.
fn carried(p: &[f64], motion: &Motion) -> f64 {
    let growth = p[0] + 2.0 * p[1] * motion.position;
    -0.5 * growth * motion.velocity * motion.velocity
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without any other force M(q) v^2 / 2 is constant.
    #[test]
    fn a_mass_that_grows_slows_down_at_constant_energy() {
        let p = [0.8, -1.5];
        let (dt, mut q, mut v) = (1e-5, -0.2, 1.5_f64);
        let at = |q: f64, v: f64| Motion { position: q, velocity: v, ..Motion::default() };
        let mass = |q: f64| 2.0 + extra_mass(&p, &at(q, 0.0));
        let energy = |q: f64, v: f64| 0.5 * mass(q) * v * v;
        let before = energy(q, v);
        for _ in 0..20_000 {
            let middle = v + 0.5 * dt * carried(&p, &at(q, v)) / mass(q);
            let place = q + 0.5 * dt * v;
            v += dt * carried(&p, &at(place, middle)) / mass(place);
            q += dt * middle;
        }
        assert!(0.05 < q && (energy(q, v) / before - 1.0).abs() < 1e-6, "{q} {v}");
    }

    #[test]
    fn mass_grows_along_the_axis_and_never_vanishes() {
        let at =
            |p: &[f64]| extra_mass(p, &Motion { position: -0.1, mass: 1.0, ..Motion::default() });
        assert!((at(&[2.0, 5.0]) + 0.15).abs() < 1e-12);
        assert_eq!(at(MASS_POSITION.null), 0.0);
        assert!((at(&[50.0, 0.0]) + 0.8).abs() < 1e-12);
    }
}
