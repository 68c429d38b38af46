//! Friction and spin at the walls.

use crate::effects::{Change, Domain, Effect, Impact, Parameter, Physics, Regressor, Signal, Site};

/// `impact.wall_friction_spin`: friction and spin at the walls.
///
/// The rim of the ball slides along the wall with u = v_t - s, where s is its surface speed by spin
/// about the vertical. Coulomb friction limits the tangential impulse to mu times the normal one.
/// Friction also cannot do more than end the sliding: 2/7 of u from the velocity of a solid sphere, 5/7 of u to the
/// spin. The spin loss κ is the part of the spin that does not build up: 0.4 for a hollow ball, with its larger moment
/// of inertia, and 1 where the board holds the ball back from spinning.
pub(crate) static WALL_FRICTION_SPIN: Effect = Effect {
    name: "impact.wall_friction_spin",
    summary: "the walls decelerate the tangential motion and set the ball spinning",
    domain: Domain::Impact,
    site: Site::Whole,
    equation: "Δv_t = −clamp(u / (1 + k), ±μ · (1 + e) · v_n), Δs = −k · Δv_t, k = 5/2 · (1 − κ), u = v_t − s",
    parameters: &[
        Parameter {
            name: "coefficient",
            symbol: "μ",
            unit: "1",
            scale: 0.05,
            bounds: (0.0, 2.0),
            plausible: (0.05, 0.4),
            per_session: false,
        },
        Parameter {
            name: "spin_loss",
            symbol: "κ",
            unit: "1",
            scale: 0.3,
            bounds: (0.0, 1.0),
            plausible: (0.0, 1.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.03, 0.0], &[0.1, 0.0], &[0.3, 0.0], &[0.1, 1.0]],
    memory: 0,
    physics: Physics::Impact(rub),
    regressors: &[Regressor::ImpactSpeed, Regressor::Velocity],
    signals: Signal::BALL,
    excitation: "oblique impacts at many angles",
    experiment: "",
    confused_with: &["impact.wall_restitution", "impact.wall_restitution_speed"],
    reference: "Garwin 1969, Kinematics of an Ultraelastic Rough Ball, American Journal of Physics 37, 88-92",
};

/// Change of the surface speed by spin per change of the tangential velocity, for the spin loss `loss`: 5/2 for a solid
/// sphere.
pub(crate) fn spin_ratio(loss: f64) -> f64 {
    2.5 * (1.0 - loss)
}

fn rub(p: &[f64], impact: &Impact, change: Change) -> Change {
    let slide = change.tangential_velocity - change.spin;
    let most = p[0] * (1.0 + change.restitution) * impact.normal_speed;
    let ratio = spin_ratio(p[1]);
    let loss = (slide / (1.0 + ratio)).clamp(-most, most);
    Change {
        tangential_velocity: change.tangential_velocity - loss,
        spin: change.spin + ratio * loss,
        ..change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Wall;

    fn after([mu, spin_loss]: [f64; 2], tangential_velocity: f64) -> Change {
        let impact =
            Impact { wall: Wall::Right, normal_speed: 1.0, tangential_velocity, spin: 0.0 };
        rub(&[mu, spin_loss], &impact, Change { restitution: 0.5, tangential_velocity, spin: 0.0 })
    }

    #[test]
    fn sliding_loses_the_impulse_of_friction() {
        assert!((after([0.1, 0.0], 1.0).tangential_velocity - 0.85).abs() < 1e-12);
        assert!((after([0.1, 0.0], -1.0).tangential_velocity + 0.85).abs() < 1e-12);
        assert_eq!(after([0.0, 0.0], 1.0).tangential_velocity, 1.0);
    }

    #[test]
    fn enough_friction_ends_the_sliding() {
        let end = after([2.0, 0.0], 0.7);
        assert!((end.tangential_velocity - 0.5).abs() < 1e-12);
        assert!((end.spin - end.tangential_velocity).abs() < 1e-12);
    }

    #[test]
    fn a_hollow_ball_and_one_that_cannot_spin_lose_more_of_their_sliding() {
        // Of a thin shell with 2/3 m r^2, friction takes 2/5 of the sliding; of a body without spin all of it.
        let shell = after([2.0, 0.4], 0.5);
        assert!((shell.tangential_velocity - 0.3).abs() < 1e-12);
        assert!((shell.spin - shell.tangential_velocity).abs() < 1e-12);
        let held = after([2.0, 1.0], 0.5);
        assert!(held.tangential_velocity.abs() < 1e-12 && held.spin == 0.0);
    }
}
