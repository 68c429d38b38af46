//! Recoil of a striker: its displacement by impacts from where its drive alone would have it.
//!
//! Without an impact the striker has the velocity `v_d`; with one it has `v_d + w`, and
//!
//! ```text
//! dw/dt = -w_n^2 r - 2 z w_n w - F/m (u(v_d + w) - u(v_d)),  dr/dt = w,  u(v) = v / |v|
//! ```
//!
//! with the spring and the damping of the magnet and the friction `F` of the board: the equation of
//! `coupling.striker_friction`, minus the same equation without the impact. A spring that softens is linearized at
//! zero displacement. Friction is taken at once for a whole piece. On a striker that its drive has at rest, friction stops the recoil and holds it
//! while the spring is weaker; a striker that slides already is not slowed further along its way.

use super::{
    body::{StrikerState, add, length, scale, subtract},
    settings::StrikerSettings,
};
use crate::effects::Oscillator;

/// Displacement (m) and velocity (m/s) below which a striker is back where its drive has it.
const BACK_HOME: f64 = 1e-9;

/// Speed of the striker by its drive alone below which it is at rest (m/s): above rounding, far below motion.
const AT_REST: f64 = 1e-9;

/// Law of the recoil over one piece of a control period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recoil {
    spring: Oscillator,
    /// Velocity that friction takes in one piece (m/s).
    friction: f64,
    /// Length of the piece (s).
    piece: f64,
}

impl Recoil {
    /// Law of `striker` over `piece` seconds.
    pub(super) fn new(striker: &StrikerSettings, piece: f64) -> Self {
        let StrikerSettings { mass, magnet_frequency, magnet_damping, friction } = *striker;
        Self {
            spring: Oscillator::new(magnet_frequency, magnet_damping, piece),
            friction: friction / mass * piece,
            piece,
        }
    }

    /// Advance the recoil of `striker` by one piece; `led_velocity` is its velocity by its drive alone (m/s).
    pub(super) fn advance(&self, striker: &mut StrikerState, led_velocity: [f64; 2]) {
        let StrikerState { recoil, recoil_velocity, .. } = striker;
        if *recoil == [0.0; 2] && *recoil_velocity == [0.0; 2] {
            return;
        }
        let was_at_rest = *recoil_velocity == [0.0; 2];
        let [x, y] = [0, 1].map(|axis| self.spring.step(recoil[axis], recoil_velocity[axis]));
        let (place, free) = ([x.0, y.0], [x.1, y.1]);
        let velocity = self.rub(led_velocity, free);
        if was_at_rest && velocity == [0.0; 2] && self.friction != 0.0 {
            return;
        }
        // Friction acts evenly over the piece.
        let held = scale(subtract(velocity, free), 0.5 * self.piece);
        (*recoil, *recoil_velocity) = (add(place, held), velocity);
        if [*recoil, *recoil_velocity].iter().flatten().map(|own| own.abs()).sum::<f64>()
            < BACK_HOME
        {
            (*recoil, *recoil_velocity) = ([0.0; 2], [0.0; 2]);
        }
    }

    /// Velocity of the recoil after friction, which opposes the whole motion and is in `led` already. `free` is the
    /// velocity without it.
    fn rub(&self, led: [f64; 2], free: [f64; 2]) -> [f64; 2] {
        if self.friction == 0.0 {
            return free;
        }
        let speed = length(led);
        let (led, before) = if speed < AT_REST {
            ([0.0; 2], [0.0; 2])
        } else {
            (led, scale(led, 1.0 + self.friction / speed))
        };
        let whole = add(before, free);
        let kept = 1.0 - self.friction / length(whole).max(self.friction);
        subtract(scale(whole, kept), led)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIECE: f64 = 0.005;
    const STRIKER: StrikerSettings = StrikerSettings {
        mass: 0.012,
        magnet_frequency: 115.0,
        magnet_damping: 0.2,
        friction: 0.6,
    };

    /// Recoil of a striker that is hit to `hit` (m/s), after each of `pieces` in `parts`.
    fn after(
        (striker, parts): (&StrikerSettings, usize),
        [led, hit]: [[f64; 2]; 2],
        pieces: usize,
    ) -> Vec<StrikerState> {
        let law = Recoil::new(striker, PIECE / parts as f64);
        let mut state = StrikerState { recoil_velocity: hit, ..StrikerState::at([0.0; 2]) };
        let mut states = Vec::new();
        for _ in 0..pieces {
            (0..parts).for_each(|_| law.advance(&mut state, led));
            states.push(state);
        }
        states
    }

    /// The same by small steps of the equation, with friction that is smooth near rest.
    fn by_small_steps([led, hit]: [[f64; 2]; 2], pieces: usize) -> Vec<[f64; 2]> {
        const H: f64 = 1e-6;
        let direction = |v: [f64; 2]| scale(v, (length(v) / 1e-4).tanh() / length(v).max(1e-12));
        let (mut place, mut velocity) = ([0.0; 2], hit);
        let mut places = Vec::new();
        for _ in 0..pieces {
            for _ in 0..(PIECE / H).round() as usize {
                let StrikerSettings { mass, magnet_frequency, magnet_damping, friction } = STRIKER;
                let rubbed = subtract(direction(add(led, velocity)), direction(led));
                for axis in 0..2 {
                    let spring = magnet_frequency * magnet_frequency * place[axis];
                    let damping = 2.0 * magnet_damping * magnet_frequency * velocity[axis];
                    velocity[axis] -= H * (spring + damping + friction / mass * rubbed[axis]);
                    place[axis] += H * velocity[axis];
                }
            }
            places.push(place);
        }
        places
    }

    #[test]
    fn it_converges_to_the_difference_that_an_impact_makes_to_the_equation_of_striker_friction() {
        // Most displacement that a piece, and a tenth of one, may be off (m). The hits displace the striker by 1 to 2 mm.
        const MOST_OFF_M: [(usize, f64); 2] = [(1, 5e-4), (10, 5e-5)];
        for motion in [
            [[0.0, 0.0], [0.2, -0.1]],
            [[0.3, 0.0], [-0.15, 0.05]],
            [[0.3, 0.2], [0.1, 0.2]],
            [[0.05, 0.0], [-0.25, 0.0]],
        ] {
            let wanted = by_small_steps(motion, 12);
            for (parts, most_off) in MOST_OFF_M {
                let found = after((&STRIKER, parts), motion, 12);
                for (piece, (found, want)) in found.iter().zip(&wanted).enumerate() {
                    let off = length(subtract(found.recoil, *want));
                    assert!(off < most_off, "{motion:?}, {parts} parts, piece {piece}: {off} m");
                }
            }
        }
    }

    #[test]
    fn friction_holds_a_striker_at_rest_and_releases_it_when_its_drive_moves() {
        let held = *after((&STRIKER, 1), [[0.0; 2], [0.2, 0.0]], 40).last().unwrap();
        assert_eq!(held.recoil_velocity, [0.0; 2]);
        assert!(1e-4 < held.recoil[0] && held.recoil[0] < 2e-3, "{held:?}");
        let mut moved = held;
        let law = Recoil::new(&STRIKER, PIECE);
        (0..400).for_each(|_| law.advance(&mut moved, [0.1, 0.0]));
        assert_eq!((moved.recoil, moved.recoil_velocity), ([0.0; 2], [0.0; 2]));
    }

    #[test]
    fn without_friction_it_is_an_oscillator() {
        let striker = StrikerSettings { friction: 0.0, ..STRIKER };
        let spring = Oscillator::new(115.0, 0.2, 10.0 * PIECE);
        let (place, velocity) = spring.step(0.0, 0.2);
        for led in [[0.0; 2], [0.3, -0.1]] {
            let found = after((&striker, 1), [led, [0.2, 0.0]], 10)[9];
            assert!((found.recoil[0] - place).abs() < 1e-12);
            assert!((found.recoil_velocity[0] - velocity).abs() < 1e-10);
        }
    }
}
