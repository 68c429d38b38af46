//! Friction that differs by direction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.asymmetric`: the level of friction changes by (dv |v| + dc)/2 sign v, so that
/// with the Coulomb and viscous terms of the twin Fc+- = Fc +- dc/2 and Fv+- = Fv +- dv/2
/// ([`by_direction`]). At rest it changes nothing. Source: Janot, Gautier and Brunot 2019 (EMPS).
pub(crate) static ASYMMETRIC: Effect = Effect {
    name: "drive.friction.asymmetric",
    says: "friction is not the same in the two directions",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[
        Parameter {
            name: "viscous_difference_n_s_per_m",
            unit: "N s/m",
            scale: 2.0,
            bounds: (-5000.0, 5000.0),
            plausible: (-40.0, 40.0),
            per_session: false,
        },
        Parameter {
            name: "coulomb_difference_n",
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
    excitation: "both directions at equal speeds, three or more of them",
    experiment: "ramp",
    confused_with: &["drive.offset", "gantry.tilt", "drive.friction.position"],
};

fn level(p: &[f64], velocity: f64) -> f64 {
    if velocity == 0.0 { 0.0 } else { 0.5 * (p[0] * velocity + p[1] * velocity.signum()) }
}

/// Friction in one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Directed {
    /// Dry part (N).
    pub coulomb_n: f64,
    /// Viscous part (N s/m).
    pub viscous_n_s_per_m: f64,
}

/// Friction forwards and backwards, as people print it: Fc+, Fv+ and Fc-, Fv-.
///
/// `coulomb_n` and `viscous_n_s_per_m` are the twin's symmetric terms on the same axis, `p` the
/// numbers of `drive.friction.asymmetric`. `constant_n` is the constant force beside them
/// (`drive.offset`, `gantry.tilt`), which a moving axis cannot tell from dc/2: only the sums
/// returned here are certain.
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
