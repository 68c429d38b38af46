//! Dry friction over one step of a simulation.

use crate::effects::Bristles;

/// What rubs on one coordinate during a step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Contact {
    /// Largest friction (N).
    pub(super) level: f64,
    /// The part of it that bends before it slides, and where its bend is remembered.
    pub(super) bristles: Option<(Bristles, usize)>,
}

impl Contact {
    /// Friction (N) over a step of `dt` seconds in which a coordinate of `mass` would come from `velocity` to
    /// `free` without it; moves the bend in `memory` on.
    ///
    /// Rigid friction is the impulse that would stop the motion, held within its level (Coulomb's law without
    /// chatter). Bristles follow the velocity at the end of the step (implicit Euler): stable however stiff they
    /// are, and still a quadratic equation in that velocity.
    pub(super) fn force(
        self,
        memory: &mut [f64],
        mass: f64,
        [velocity, free]: [f64; 2],
        dt: f64,
    ) -> f64 {
        let inertia = mass / dt;
        let Some((bristles, place)) = self.bristles.filter(|_| 0.0 < self.level) else {
            return -(inertia * free).clamp(-self.level, self.level);
        };
        let bend = &mut memory[place];
        let bristles = bristles.held_to(self.level);
        let rigid = self.level - bristles.force;
        let per_speed = dt / bristles.distance;
        let relaxed = 1.0 + per_speed * (bristles.pace(velocity) - velocity.abs());
        let damped = bristles.damping * bristles.distance / dt;
        let elastic = bristles.force + damped;
        let pull = inertia * free - elastic * *bend / relaxed + damped * *bend;
        if pull.abs() <= rigid {
            *bend /= relaxed;
            return -inertia * free;
        }
        // (inertia (u - w) + rigid - damped s) (relaxed + per_speed u) + elastic (s + per_speed u) = 0 for the
        // speed u > 0 in the direction of the pull, with w and s the free velocity and the bend along it.
        let (w, s) = (pull.signum() * free, pull.signum() * *bend);
        let still = rigid - inertia * w - damped * s;
        let square = inertia * per_speed;
        let linear = inertia * relaxed + per_speed * (still + elastic);
        let constant = relaxed * still + elastic * s;
        let root = (linear * linear - 4.0 * square * constant).sqrt();
        let speed = if linear < 0.0 {
            0.5 * (root - linear) / square
        } else {
            -2.0 * constant / (linear + root)
        };
        *bend = pull.signum() * (s + per_speed * speed) / (relaxed + per_speed * speed);
        inertia * (pull.signum() * speed - free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-4;

    /// Drives 2 kg with `force(time)` for `seconds`: place, velocity and bend at the end.
    fn driven(
        level: f64,
        bristles: Bristles,
        seconds: f64,
        force: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        let (mut place, mut velocity, mut bend) = (0.0, 0.0, [0.0]);
        for step in 0..(seconds / DT).round() as usize {
            let free = velocity + DT * force(step as f64 * DT) / 2.0;
            let contact = Contact { level, bristles: Some((bristles, 0)) };
            let friction = contact.force(&mut bend, 2.0, [velocity, free], DT);
            velocity = free + DT * friction / 2.0;
            place += DT * velocity;
        }
        [place, velocity, bend[0]]
    }

    #[test]
    fn rigid_friction_holds_up_to_its_level() {
        let of =
            |free| Contact { level: 3.0, bristles: None }.force(&mut [], 2.0, [0.0, free], 1e-3);
        assert!((of(1e-3) + 2.0).abs() < 1e-12);
        assert_eq!(of(1.0), -3.0);
    }

    #[test]
    fn below_the_level_bristles_are_a_spring() {
        let own = Bristles { force: 10.0, distance: 1e-3, velocity: 1e-7, damping: 283.0 };
        // 0.1 N on 1e4 N/m: a hundredth of the way over which they bend.
        let [place, velocity, bend] = driven(10.0, own, 2.0, |_| 0.1);
        assert!((place - 1e-5).abs() < 2e-7 && velocity.abs() < 1e-4, "{place} {velocity}");
        assert!((bend - 0.01).abs() < 1e-4, "{bend}");
    }

    #[test]
    fn in_motion_all_of_it_slides() {
        let own = Bristles { force: 4.0, distance: 1e-5, velocity: 1e-6, damping: 0.0 };
        let [_, velocity, bend] = driven(6.0, own, 0.5, |_| 8.0);
        assert!((bend - 1.0).abs() < 1e-6);
        // 8 N less 6 N on 2 kg for 0.5 s, and a little for the way over which they bent.
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
        let mut bend = [1.0];
        let mut velocity = -0.05;
        for _ in 0..100 {
            let contact = Contact { level: 4.0, bristles: Some((own, 0)) };
            let friction = contact.force(&mut bend, 1e6, [velocity, velocity], DT);
            velocity += DT * friction / 1e6;
        }
        assert!((bend[0] - own.bent(1.0, -0.05, 100.0 * DT)).abs() < 5e-3, "{bend:?}");
    }
}
