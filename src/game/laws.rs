//! The catalogue's functions that act on the ball, prepared for calls in any environment.

use super::randomization::Surface;
use crate::{
    effects::{Ball, CATALOGUE, Change, Impact, Physics, Wall, spin_ratio},
    twin::Instance,
};

/// Maximum number of parameters of one effect.
const MOST_PARAMETERS: usize = 8;

/// Normal speed below which an impact does not bounce (m/s): far below the resolution of a camera;
/// it ends a sequence of ever smaller bounces.
const LEAST_BOUNCE: f64 = 2e-3;

type RollLaw = fn(&[f64], &Ball) -> [f64; 2];
type BallLaw = fn(&[f64], &Ball) -> f64;
type ImpactLaw = fn(&[f64], &Impact, Change) -> Change;
type WallLaw = fn(&[f64], Wall, f64) -> f64;

/// One function with its parameters.
#[derive(Debug, Clone, Copy)]
struct Law<F> {
    call: F,
    numbers: [f64; MOST_PARAMETERS],
    count: usize,
}

impl<F> Law<F> {
    fn new(call: F, instance: &Instance) -> Self {
        let mut numbers = [0.0; MOST_PARAMETERS];
        let count = instance.values.len().min(MOST_PARAMETERS);
        for (to, from) in numbers.iter_mut().zip(&instance.values) {
            *to = from.value;
        }
        Self { call, numbers, count }
    }

    fn p(&self) -> &[f64] {
        &self.numbers[..self.count]
    }
}

/// Everything that acts on the ball, in the order of the catalogue.
#[derive(Debug, Clone, Default)]
pub(super) struct BallLaws {
    roll: Vec<Law<RollLaw>>,
    resistance: Vec<Law<BallLaw>>,
    slide: Vec<Law<BallLaw>>,
    places: Vec<Law<WallLaw>>,
    /// Impacts on walls.
    pub(super) walls: Bounces,
    /// Impacts on strikers and biscuits.
    pub(super) strikers: Bounces,
}

/// Sort `instances` in the order of the catalogue, so that the order of discovery does not matter.
fn sorted(instances: &[Instance]) -> Vec<&Instance> {
    let place = |instance: &&Instance| {
        CATALOGUE.iter().position(|effect| effect.name == instance.effect.name)
    };
    let mut sorted: Vec<&Instance> = instances.iter().collect();
    sorted.sort_by_key(place);
    sorted
}

impl BallLaws {
    pub(super) fn new(effects: &[Instance], striker_effects: &[Instance]) -> Self {
        let mut laws = Self {
            walls: Bounces::new(effects),
            strikers: Bounces::new(striker_effects),
            ..Self::default()
        };
        for instance in sorted(effects) {
            for equation in instance.effect.physics.equations() {
                match *equation {
                    Physics::Roll(call) => laws.roll.push(Law::new(call, instance)),
                    Physics::Resistance(call) => laws.resistance.push(Law::new(call, instance)),
                    Physics::Slide(call) => laws.slide.push(Law::new(call, instance)),
                    Physics::Wall(call) => laws.places.push(Law::new(call, instance)),
                    _ => {}
                }
            }
        }
        laws
    }

    /// Return whether no effect can set a resting ball in motion.
    pub(super) fn rests(&self) -> bool {
        self.roll.is_empty()
    }

    /// Acceleration of the rolling ball (m/s^2).
    pub(super) fn push(&self, ball: &Ball) -> [f64; 2] {
        self.roll.iter().fold([0.0; 2], |[x, y], law| {
            let [ax, ay] = (law.call)(law.p(), ball);
            [x + ax, y + ay]
        })
    }

    /// Largest deceleration of the rolling ball (m/s^2).
    pub(super) fn resistance(&self, ball: &Ball) -> f64 {
        self.resistance.iter().map(|law| (law.call)(law.p(), ball)).sum()
    }

    /// Return whether the ball slides after an impact.
    pub(super) fn slides(&self) -> bool {
        !self.slide.is_empty()
    }

    /// Deceleration by friction while the ball slides (m/s^2).
    pub(super) fn sliding(&self, ball: &Ball) -> f64 {
        self.slide.iter().map(|law| (law.call)(law.p(), ball)).sum()
    }

    /// Return whether walls are displaced from the board's edges.
    pub(super) fn moves_walls(&self) -> bool {
        !self.places.is_empty()
    }

    /// Outward shift of `wall` at `along` metres from its middle (m).
    pub(super) fn shift(&self, wall: Wall, along: f64) -> f64 {
        self.places.iter().map(|law| (law.call)(law.p(), wall, along)).sum()
    }
}

/// Parameter of an environment that replaces the law's own one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Fixed,
    Restitution,
    Friction,
}

/// Impact response at a surface.
#[derive(Debug, Clone, Default)]
pub(super) struct Bounces {
    laws: Vec<(Role, Law<ImpactLaw>)>,
}

impl Bounces {
    fn new(instances: &[Instance]) -> Self {
        let law = |instance: &&Instance| {
            let Physics::Impact(call) = instance.effect.physics else { return None };
            let role = match instance.effect.name {
                "impact.wall_restitution" => Role::Restitution,
                "impact.wall_friction_spin" => Role::Friction,
                _ => Role::Fixed,
            };
            Some((role, Law::new(call, instance)))
        };
        Self { laws: sorted(instances).iter().filter_map(law).collect() }
    }

    /// Parameters of the laws themselves, with `ratio` of static to kinetic friction.
    pub(super) fn surface(&self, ratio: f64) -> Surface {
        let of = |role: Role, absent: f64| {
            let found = self.laws.iter().find(|(own, _)| *own == role);
            found.map_or(absent, |(_, law)| law.numbers[0])
        };
        let friction = of(Role::Friction, 0.0);
        Surface {
            restitution: of(Role::Restitution, 1.0),
            static_friction: ratio * friction,
            dynamic_friction: friction,
        }
    }

    /// Impact response, with the restitution and friction of `surface`.
    pub(super) fn act(&self, surface: &Surface, impact: &Impact) -> Change {
        let start = Change {
            restitution: 1.0,
            tangential_velocity: impact.tangential_velocity,
            spin: impact.spin,
        };
        let mut change = self.laws.iter().fold(start, |change, (role, law)| match role {
            Role::Fixed => (law.call)(law.p(), impact, change),
            Role::Restitution => (law.call)(&[surface.restitution], impact, change),
            Role::Friction => {
                let spin_loss = law.numbers[1];
                let coefficient = surface.friction(impact, &change, spin_loss);
                (law.call)(&[coefficient, spin_loss], impact, change)
            }
        });
        if impact.normal_speed < LEAST_BOUNCE {
            change.restitution = 0.0;
        }
        change
    }
}

impl Surface {
    /// Coulomb coefficient in force: static if it can end the sliding, otherwise kinetic.
    fn friction(&self, impact: &Impact, change: &Change, spin_loss: f64) -> f64 {
        let needed =
            (change.tangential_velocity - change.spin).abs() / (1.0 + spin_ratio(spin_loss));
        let most = self.static_friction * (1.0 + change.restitution) * impact.normal_speed;
        if needed <= most { self.static_friction } else { self.dynamic_friction }
    }
}
