//! Friction that differs by direction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.asymmetric`: friction that differs by direction.
///
/// With the Coulomb and viscous terms of the twin the friction is Fc+- = Fc +- d_c/2 and Fv+- = Fv
/// +- d_v/2 ([`by_direction`]). At rest the effect changes nothing.
pub(crate) static ASYMMETRIC: Effect = Effect {
    name: "drive.friction.asymmetric",
    summary: "friction differs between the two directions",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "Δ|F_f| = ½ · (d_v · v + d_c · sign(v))",
    parameters: &[
        Parameter {
            name: "viscous_difference_n_s_per_m",
            symbol: "d_v",
            unit: "N s/m",
            scale: 2.0,
            bounds: (-5000.0, 5000.0),
            plausible: (-40.0, 40.0),
            per_session: false,
        },
        Parameter {
            name: "coulomb_difference_n",
            symbol: "d_c",
            unit: "N",
            scale: 0.5,
            bounds: (-500.0, 500.0),
            plausible: (-10.0, 10.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[2.0, 0.0], &[0.0, 0.5]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| level(p, motion.velocity)),
    regressors: &[Regressor::Direction, Regressor::Velocity],
    signals: Signal::DRIVE,
    excitation: "both directions at equal speeds, three or more of them",
    experiment: "ramp",
    confused_with: &["drive.offset", "gantry.tilt", "drive.friction.position"],
    reference: "Janot, Gautier and Brunot 2019, Data Set and Reference Models of EMPS",
};

fn level(p: &[f64], velocity: f64) -> f64 {
    if velocity == 0.0 { 0.0 } else { 0.5 * (p[0] * velocity + p[1] * velocity.signum()) }
}

/// Friction in one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Directed {
    /// Coulomb friction (N).
    pub coulomb_n: f64,
    /// Viscous coefficient (N s/m).
    pub viscous_n_s_per_m: f64,
}

/// Friction by direction, forwards then backwards, as publications state it: Fc+, Fv+ and Fc-, Fv-.
///
/// `coulomb_n` and `viscous_n_s_per_m` are the symmetric terms of the twin on the same axis, `p` the
/// parameters of `drive.friction.asymmetric`. `constant_n` is the constant force on the axis
/// (`drive.offset`, `gantry.tilt`). On a moving axis it is confounded with d_c/2: only the sums that
/// this function returns are identifiable.
///
/// ```
/// use klasktron::effects::by_direction;
/// let [forwards, backwards] = by_direction(20.4, 203.5, 1.71, &[-73.6, 2.93]);
/// assert!((forwards.viscous_n_s_per_m - 166.7).abs() < 1e-9);
/// assert!((backwards.coulomb_n - 20.645).abs() < 1e-9);
/// ```
#[must_use]
pub fn by_direction(
    coulomb_n: f64,
    viscous_n_s_per_m: f64,
    constant_n: f64,
    p: &[f64],
) -> [Directed; 2] {
    [1.0, -1.0].map(|direction| Directed {
        coulomb_n: coulomb_n + direction * (0.5 * p[1] - constant_n),
        viscous_n_s_per_m: viscous_n_s_per_m + direction * 0.5 * p[0],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_is_shared_between_the_directions() {
        let p = [-8.0, 2.0];
        let [forwards, backwards] = by_direction(5.0, 20.0, 0.0, &p);
        assert_eq!((forwards.coulomb_n, forwards.viscous_n_s_per_m), (6.0, 16.0));
        assert_eq!((backwards.coulomb_n, backwards.viscous_n_s_per_m), (4.0, 24.0));
        for (velocity, side) in [(0.5, forwards), (-0.5, backwards)] {
            let symmetric = 5.0 + 20.0 * 0.5;
            let expected = side.coulomb_n + side.viscous_n_s_per_m * 0.5;
            assert!((symmetric + level(&p, velocity) - expected).abs() < 1e-12);
        }
        assert_eq!(level(&p, 0.0), 0.0);
        assert_eq!(level(ASYMMETRIC.null, -0.5), 0.0);
    }
}
