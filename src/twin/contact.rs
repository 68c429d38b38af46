//! Dry friction over one step of a simulation.

use crate::{
    effects::Bristles,
    lanes::{Lanes, Mask},
};
use pulp::Simd;

/// Ratio of speed to creep speed below which it is rest.
const CREEPING: f64 = 1e-6;

/// Ratio of speed to creep speed from which its hyperbolic tangent is 1 to the last bit.
const SATURATED: f64 = 22.0;

/// Bristles of one coordinate, of each simulation.
#[derive(Debug, Clone, Copy)]
pub(super) struct BristleLanes<S: Simd> {
    /// Simulations with bristles.
    exist: Mask<S>,
    /// Fields of [`Bristles`].
    force: Lanes<S>,
    distance: Lanes<S>,
    velocity: Lanes<S>,
    damping: Lanes<S>,
    /// Reciprocals of distance (1/m) and velocity (s/m).
    per_distance: Lanes<S>,
    per_velocity: Lanes<S>,
}

impl<S: Simd> BristleLanes<S> {
    /// The bristles `of` each simulation; `None` where none has any.
    #[inline(always)]
    pub(super) fn new(simd: S, of: impl Fn(usize) -> Option<Bristles>) -> Option<Self> {
        if (0..S::F64_LANES).all(|lane| of(lane).is_none()) {
            return None;
        }
        let number =
            |get: fn(Bristles) -> f64| Lanes::from_fn(simd, |lane| of(lane).map_or(1.0, get));
        let (distance, velocity) = (number(|own| own.distance), number(|own| own.velocity));
        Some(Self {
            exist: Mask::from_fn(simd, |lane| of(lane).is_some()),
            force: number(|own| own.force),
            distance,
            velocity,
            damping: number(|own| own.damping),
            per_distance: 1.0 / distance,
            per_velocity: 1.0 / velocity,
        })
    }

    /// Relaxation speed of the deflection (m/s) at a `speed`; see [`Bristles::pace`].
    #[inline(always)]
    fn pace(&self, simd: S, speed: Lanes<S>) -> Lanes<S> {
        let ratio = speed * self.per_velocity;
        let creeps = ratio.less_than(Lanes::splat(simd, CREEPING));
        let saturates = Lanes::splat(simd, SATURATED).less_than(ratio);
        let mut tanh = Lanes::splat(simd, 1.0);
        if !creeps.or(saturates).all() {
            for lane in 0..S::F64_LANES {
                let ratio = ratio.get(lane);
                if (CREEPING..=SATURATED).contains(&ratio) {
                    tanh.set(lane, ratio.tanh());
                }
            }
        }
        creeps.select(self.velocity, speed / tanh)
    }
}

/// Friction of one coordinate during a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact<S: Simd> {
    /// Largest friction (N).
    pub(super) level: Lanes<S>,
    /// Part of it that bends before it slides.
    pub(super) bristles: Option<BristleLanes<S>>,
}

/// Motion of a coordinate over a step without friction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Free<S: Simd> {
    /// Its inertia over the step (kg/s): the force per velocity that it loses.
    pub(super) inertia: Lanes<S>,
    /// Its velocity before and after the step (m/s).
    pub(super) velocity: [Lanes<S>; 2],
    /// Length of the step (s), and its reciprocal (1/s).
    pub(super) dt: Lanes<S>,
    pub(super) per_dt: Lanes<S>,
}

impl<S: Simd> Contact<S> {
    /// Friction (N) over a step of a coordinate whose frictionless motion is `motion`; advances the
    /// `bend`.
    ///
    /// Rigid friction is the impulse that would stop the motion, held within its level (Coulomb's law without
    /// chatter). Bristles follow the velocity at the end of the step (implicit Euler): stable however stiff they
    /// are, and still a quadratic equation in that velocity.
    #[inline(always)]
    pub(super) fn force(&self, simd: S, bend: &mut Lanes<S>, motion: Free<S>) -> Lanes<S> {
        let Free { inertia, velocity: [velocity, free], dt, per_dt } = motion;
        let stopping = inertia * free;
        let rigid_force = -stopping.clamp(-self.level, self.level);
        let Some(own) = &self.bristles else { return rigid_force };
        let acts = own.exist & Lanes::splat(simd, 0.0).less_than(self.level);
        if !acts.any() {
            return rigid_force;
        }
        // At most the level is dry friction: see `Bristles::held_to`.
        let fits = own.force.at_most(self.level);
        let (mut force, mut distance, mut per_distance) =
            (own.force, own.distance, own.per_distance);
        if !fits.all() {
            let shorter =
                (own.distance * self.level / own.force).max(Lanes::splat(simd, f64::MIN_POSITIVE));
            force = fits.select(force, self.level);
            distance = fits.select(distance, shorter);
            per_distance = fits.select(per_distance, 1.0 / shorter);
        }
        let rigid = self.level - force;
        let per_speed = dt * per_distance;
        let relaxed = 1.0 + per_speed * (own.pace(simd, velocity.abs()) - velocity.abs());
        let damped = own.damping * distance * per_dt;
        let elastic = force + damped;
        let relaxed_bend = *bend / relaxed;
        let pull = stopping - elastic * relaxed_bend + damped * *bend;
        let holds = pull.abs().at_most(rigid);
        let mut found = (-stopping, relaxed_bend);
        if !holds.all() {
            // (inertia (u - w) + rigid - damped s) (relaxed + per_speed u) + elastic (s + per_speed u) = 0 for the
            // speed u > 0 in the direction of the pull, with w and s the free velocity and the bend along it.
            let sign = Lanes::splat(simd, 1.0).copysign(pull);
            let (w, s) = (sign * free, sign * *bend);
            let still = rigid - inertia * w - damped * s;
            let square = inertia * per_speed;
            let linear = inertia * relaxed + per_speed * (still + elastic);
            let constant = relaxed * still + elastic * s;
            let root = (linear * linear - 4.0 * square * constant).sqrt();
            let falls = linear.less_than(Lanes::splat(simd, 0.0));
            let numerator = falls.select(0.5 * (root - linear), -2.0 * constant);
            let speed = numerator / falls.select(square, linear + root);
            let slid_bend = sign * (s + per_speed * speed) / (relaxed + per_speed * speed);
            let slid = inertia * (sign * speed - free);
            found = (holds.select(found.0, slid), holds.select(found.1, slid_bend));
        }
        *bend = acts.select(found.1, *bend);
        acts.select(found.0, rigid_force)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use pulp::Scalar;

    const DT: f64 = 1e-4;

    /// Friction over a step of `dt` seconds in one simulation.
    fn friction(
        (level, bristles): (f64, Option<Bristles>),
        bend: &mut f64,
        (mass, velocity): (f64, [f64; 2]),
        dt: f64,
    ) -> f64 {
        let of = |value| Lanes::splat(Scalar, value);
        let contact =
            Contact { level: of(level), bristles: BristleLanes::new(Scalar, |_| bristles) };
        let (inertia, per_dt) = (of(mass / dt), of(1.0 / dt));
        let free = Free { inertia, velocity: velocity.map(of), dt: of(dt), per_dt };
        let mut bent = of(*bend);
        let friction = contact.force(Scalar, &mut bent, free);
        *bend = bent.get(0);
        friction.get(0)
    }

    /// Drives 2 kg with `force(time)` for `seconds`: position, velocity and bend at the end.
    fn driven(
        level: f64,
        bristles: Bristles,
        seconds: f64,
        force: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        let (mut place, mut velocity, mut bend) = (0.0, 0.0, 0.0);
        for step in 0..(seconds / DT).round() as usize {
            let free = velocity + DT * force(step as f64 * DT) / 2.0;
            let friction =
                friction((level, Some(bristles)), &mut bend, (2.0, [velocity, free]), DT);
            velocity = free + DT * friction / 2.0;
            place += DT * velocity;
        }
        [place, velocity, bend]
    }

    #[test]
    fn rigid_friction_holds_up_to_its_level() {
        let of = |free| friction((3.0, None), &mut 0.0, (2.0, [0.0, free]), 1e-3);
        assert!((of(1e-3) + 2.0).abs() < 1e-12);
        assert_eq!(of(1.0), -3.0);
    }

    #[test]
    fn below_the_level_bristles_are_a_spring() {
        let own = Bristles { force: 10.0, distance: 1e-3, velocity: 1e-7, damping: 283.0 };
        // 0.1 N on 1e4 N/m: a hundredth of the distance over which they bend.
        let [place, velocity, bend] = driven(10.0, own, 2.0, |_| 0.1);
        assert!((place - 1e-5).abs() < 2e-7 && velocity.abs() < 1e-4, "{place} {velocity}");
        assert!((bend - 0.01).abs() < 1e-4, "{bend}");
    }

    #[test]
    fn in_motion_all_of_it_slides() {
        let own = Bristles { force: 4.0, distance: 1e-5, velocity: 1e-6, damping: 0.0 };
        let [_, velocity, bend] = driven(6.0, own, 0.5, |_| 8.0);
        assert!((bend - 1.0).abs() < 1e-6);
        // 8 N less 6 N on 2 kg for 0.5 s, and a little for the distance over which they bent.
        assert!((0.5..0.51).contains(&velocity), "{velocity}");
    }

    #[test]
    fn damping_takes_the_ringing_out() {
        // 2 kg on 1e4 N/m ring at 71 rad/s; 283 N s/m is critical.
        let rings = |damping| {
            let own = Bristles { force: 100.0, distance: 1e-2, velocity: 1e-7, damping };
            driven(100.0, own, 0.03, |_| 1.0)[0]
        };
        let closed = |time: f64| 1e-4 * (1.0 - (1.0 + 70.71 * time) * (-70.71 * time).exp());
        assert!((rings(282.8) - closed(0.03)).abs() < 1e-6, "{}", rings(282.8));
        assert!(1.3e-4 < rings(0.0));
    }

    #[test]
    fn after_a_reversal_at_speed_the_bend_follows_dahls_law() {
        let own = Bristles { force: 4.0, distance: 1e-3, velocity: 1e-6, damping: 0.0 };
        let mut bend = 1.0;
        let mut velocity = -0.05;
        for _ in 0..100 {
            let friction = friction((4.0, Some(own)), &mut bend, (1e6, [velocity; 2]), DT);
            velocity += DT * friction / 1e6;
        }
        assert!((bend - own.bent(1.0, -0.05, 100.0 * DT)).abs() < 5e-3, "{bend:?}");
    }
}
