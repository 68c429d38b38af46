//! Chain from the carriage to the striker: encoders, backlash, geometry of the gantry, magnet.

use super::{
    Instance, Twin,
    belt_gaps::{self, BeltGaps},
    plant::Part,
    transmission,
};
use crate::{
    effects::{
        Axis, Carriage, Gap, Law, Motion, Physics, Place, Spring, Striker, StrikerLanes, both,
    },
    gantry::{belts, rails},
};
use pulp::Scalar;

type StretchPart = Part<fn(&[f64], &Motion) -> f64>;
type LevelPart = Part<fn(&[f64], &mut [f64], &Motion) -> f64>;
type EncoderPart = Part<Law<fn(&[f64], f64, f64) -> f64>>;
type FramePart = Part<fn(&[f64], &Carriage) -> [f64; 2]>;
type CouplingPart = Part<Coupling>;

/// Distance over which friction on a guide builds up after a reversal (m). Contacts bend by some
/// micrometres before they slide (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica
/// 30(7), section 2.1).
const PRESLIDING_M: f64 = 1e-5;

/// Coupling of magnet and striker.
#[derive(Debug, Clone, Copy)]
enum Coupling {
    Function(fn(&[f64], &mut [f64], &Carriage) -> [f64; 2]),
    /// Striker on a spring, and the same in the only lane of a vector.
    Striker(Striker, StrikerLanes<Scalar>),
}

impl Coupling {
    /// The striker, if it is on a spring.
    fn striker(&self) -> Option<Striker> {
        match self {
            Self::Striker(striker, _) => Some(*striker),
            Self::Function(_) => None,
        }
    }
}

/// Striker on a spring that was taken out of a linkage.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TakenStriker {
    part: Part<Striker>,
    /// Mass (kg).
    mass: f64,
}

impl TakenStriker {
    /// The striker with its mass (kg).
    pub(crate) fn on_spring(&self) -> (Striker, f64) {
        (self.part.call, self.mass)
    }

    /// Its states in the memory of the linkage.
    pub(crate) fn states<'m>(&self, memory: &'m mut [f64]) -> &'m mut [f64] {
        self.part.memory(memory)
    }
}

/// Kind of the positions of a carriage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Places {
    /// Positions that the encoders report; the errors of the encoders are subtracted.
    Reported,
    /// True positions of its motors, as in a [`super::Plant`].
    True,
}

/// The functions between carriage and striker, in their order.
#[derive(Debug, Clone)]
pub struct Linkage {
    encoders: [Vec<EncoderPart>; 2],
    /// Backlash of the belts, and the index of its load in the memory.
    belt_gaps: Option<(BeltGaps, usize)>,
    rail_gaps: [Vec<Part<Gap>>; 2],
    belt_stretches: [Vec<StretchPart>; 2],
    rail_stretches: [Vec<StretchPart>; 2],
    frames: Vec<FramePart>,
    couplings: Vec<CouplingPart>,
    mass: [f64; 2],
    striker_mass: f64,
    rubs: [Rub; 2],
    turns_per_metre: f64,
    memory: usize,
}

/// Friction on one guide. Belts transmit the force that overcomes it, as they do that of the moving
/// mass.
#[derive(Debug, Clone, Default)]
struct Rub {
    /// Coulomb friction (N).
    level: f64,
    /// Viscous friction (N s/m).
    damping: f64,
    /// Friction whose level depends on the motion.
    levels: Vec<LevelPart>,
    /// Index in the memory of the Coulomb friction over the last step (N).
    slot: usize,
}

impl Rub {
    /// Force (N) that overcomes the friction over one step: elastic within [`PRESLIDING_M`] after a reversal, then at its
    /// level (Prandtl's model), so that at rest the last friction stays.
    fn force(&self, memory: &mut [f64], motion: &Motion) -> f64 {
        let of_parts = |part: &LevelPart| (part.call)(part.p(), part.memory(memory), motion);
        let level = (self.level + self.levels.iter().map(of_parts).sum::<f64>()).max(0.0);
        let bent = memory[self.slot] + level * motion.velocity * motion.dt / PRESLIDING_M;
        memory[self.slot] = bent.clamp(-level, level);
        memory[self.slot] + self.damping * motion.velocity
    }
}

impl Linkage {
    /// The linkage of the instances in `twin` that act between carriage and striker.
    #[must_use]
    pub fn new(twin: &Twin, places: Places) -> Self {
        let mut linkage = Self {
            encoders: [Vec::new(), Vec::new()],
            belt_gaps: None,
            rail_gaps: [Vec::new(), Vec::new()],
            belt_stretches: [Vec::new(), Vec::new()],
            rail_stretches: [Vec::new(), Vec::new()],
            frames: Vec::new(),
            couplings: Vec::new(),
            mass: [0.0; 2],
            striker_mass: twin.striker_mass,
            rubs: Default::default(),
            turns_per_metre: twin.belt_metres_per_turn.recip(),
            memory: 0,
        };
        for instance in &twin.instances {
            for equation in instance.effect.physics.equations() {
                linkage.add(instance, *equation);
            }
        }
        linkage.leave_rotors_out(twin);
        if let Some((gaps, _)) = &mut linkage.belt_gaps {
            gaps.decelerate_by(both(|k| linkage.rubs[k].level), linkage.mass);
        }
        // Only compliance needs the force.
        if linkage.has_stretches() {
            for rub in &mut linkage.rubs {
                rub.slot = linkage.memory;
                linkage.memory += 1;
            }
        }
        if places == Places::True {
            linkage.encoders = [Vec::new(), Vec::new()];
        }
        linkage
    }

    /// Rotors are on the motors' side of soft belts: no belt transmits the force that moves them.
    fn leave_rotors_out(&mut self, twin: &Twin) {
        let springs = both(|motor| {
            let own =
                twin.instances.iter().filter(|own| own.axis.is_motor() && own.axis.covers(motor));
            own.filter_map(Instance::spring).reduce(Spring::in_series)
        });
        if let Some([a, b]) = transmission::ties(springs, self.mass) {
            self.mass = self.mass.map(|mass| mass - (a.motor_mass + b.motor_mass));
        }
    }

    fn add(&mut self, instance: &Instance, equation: Physics) {
        let memory = &mut self.memory;
        let axis = instance.axis;
        let covered = (0..2).filter(|index| axis.covers(*index));
        match equation {
            Physics::Encoder(call) => {
                let call = Law::Function(call);
                covered.for_each(|k| self.encoders[k].push(Part::new(call, instance, memory)));
            }
            Physics::Expression(Place::Output, own) => {
                let call = Law::Expression(own);
                covered.for_each(|k| self.encoders[k].push(Part::new(call, instance, memory)));
            }
            Physics::Gap(call) if axis.is_motor() => {
                self.add_belt_gaps(axis, call(&instance.numbers()));
            }
            Physics::Gap(call) => {
                let gap = call(&instance.numbers());
                covered.for_each(|k| self.rail_gaps[k].push(Part::new(gap, instance, memory)));
            }
            Physics::Stretch(call) => {
                let at_motor = axis.is_motor();
                let stretches =
                    if at_motor { &mut self.belt_stretches } else { &mut self.rail_stretches };
                covered.for_each(|k| stretches[k].push(Part::new(call, instance, memory)));
            }
            Physics::Frame(call) => self.frames.push(Part::new(call, instance, memory)),
            Physics::Coupling(call) => {
                self.couplings.push(Part::new(Coupling::Function(call), instance, memory));
            }
            Physics::Striker(call) => {
                let striker = call(&instance.numbers());
                let lanes = StrikerLanes::alone(striker, self.striker_mass);
                let own = Coupling::Striker(striker, lanes);
                self.couplings.push(Part::new(own, instance, memory));
            }
            Physics::Mass(call) => {
                let mass = call(&instance.numbers());
                covered.for_each(|k| self.mass[k] += mass);
            }
            Physics::Inertia(call) => {
                let mass = call(&instance.numbers(), &Motion::default());
                covered.for_each(|k| self.mass[k] += mass);
            }
            // Friction at the motors acts before the belts.
            Physics::Coulomb(call) if !axis.is_motor() => {
                let level = call(&instance.numbers());
                covered.for_each(|k| self.rubs[k].level += level);
            }
            Physics::Damping(call) if !axis.is_motor() => {
                let damping = call(&instance.numbers());
                covered.for_each(|k| self.rubs[k].damping += damping);
            }
            Physics::Friction(call) if !axis.is_motor() => {
                covered.for_each(|k| self.rubs[k].levels.push(Part::new(call, instance, memory)));
            }
            _ => {}
        }
    }

    /// Add a `gap` of the belts that `axis` covers.
    fn add_belt_gaps(&mut self, axis: Axis, gap: Gap) {
        let memory = &mut self.memory;
        let (gaps, _) = self.belt_gaps.get_or_insert_with(|| {
            let slot = *memory;
            *memory += belt_gaps::MEMORY;
            (BeltGaps::none(gap.deceleration), slot)
        });
        (0..2).filter(|belt| axis.covers(*belt)).for_each(|belt| gaps.widen(belt, gap.width));
    }

    /// Number of values that it remembers for one carriage.
    #[must_use]
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// Return whether anything in it has a memory or depends on motion.
    #[must_use]
    pub fn is_dynamic(&self) -> bool {
        self.has_plays() || self.couples() || !self.frames.is_empty()
    }

    /// Return whether anything between motors and carriage has compliance or backlash.
    fn has_plays(&self) -> bool {
        self.has_stretches()
            || self.belt_gaps.is_some()
            || self.rail_gaps.iter().any(|parts| !parts.is_empty())
    }

    /// Return whether anything between motors and carriage has compliance.
    fn has_stretches(&self) -> bool {
        self.belt_stretches.iter().chain(&self.rail_stretches).any(|parts| !parts.is_empty())
    }

    /// Return whether the striker may move relative to its magnet.
    #[must_use]
    pub fn couples(&self) -> bool {
        !self.couplings.is_empty()
    }

    /// Displacement of the striker from its magnet (m); the magnet is at the position of the
    /// `carriage`.
    #[must_use]
    pub fn away(&self, memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        let magnet = carriage.position;
        self.couplings.iter().fold([0.0; 2], |away, part| {
            let memory = part.memory(memory);
            let moved = match part.call {
                Coupling::Function(call) => call(part.p(), memory, carriage),
                Coupling::Striker(_, own) => own.striker(memory, carriage),
            };
            both(|k| away[k] + moved[k] - magnet[k])
        })
    }

    /// Position of the striker (m) for a carriage at one time. `memory` is that of this carriage:
    /// [`memory`](Self::memory) values, all zero after a long rest.
    #[must_use]
    pub fn striker(&self, memory: &mut [f64], carriage: Carriage) -> [f64; 2] {
        let magnet = self.magnet(memory, carriage);
        let away = self.away(memory, &magnet);
        both(|k| magnet.position[k] + away[k])
    }

    /// State of the magnet for a carriage at one time, with the same `memory`.
    #[must_use]
    pub(crate) fn magnet(&self, memory: &mut [f64], mut carriage: Carriage) -> Carriage {
        let has_encoders = self.encoders.iter().any(|parts| !parts.is_empty());
        if !has_encoders && self.frames.is_empty() && !self.has_plays() {
            return carriage;
        }
        let mut belt = belts(carriage.position);
        for (k, parts) in self.encoders.iter().enumerate() {
            for part in parts {
                // The path holds the reported position: subtract the error of the encoder.
                belt[k] -= part.call.at(part.p(), belt[k], self.turns_per_metre) - belt[k];
            }
        }
        if let Some((gaps, slot)) = &self.belt_gaps {
            let motors = Carriage { position: rails(belt), ..carriage };
            belt = belts(gaps.load(&mut memory[*slot..], self.mass, &motors));
        }
        let force = if self.has_stretches() { self.force(memory, &carriage) } else { [0.0; 2] };
        let belt_force = belts(force).map(|sum| 0.5 * sum);
        for (k, parts) in self.belt_stretches.iter().enumerate() {
            belt[k] = stretched(parts, belt[k], belt_force[k]);
        }
        let mut place = rails(belt);
        for (k, parts) in self.rail_gaps.iter().enumerate() {
            for part in parts {
                let motion = Motion { position: place[k], ..Self::motion(&carriage, k) };
                place[k] = part.call.load(part.memory(memory), &motion);
            }
        }
        for (k, parts) in self.rail_stretches.iter().enumerate() {
            place[k] = stretched(parts, place[k], force[k]);
        }
        carriage.position = place;
        for part in &self.frames {
            carriage.position = (part.call)(part.p(), &carriage);
        }
        carriage
    }

    /// Take the last striker on a spring out, to simulate it next to others.
    pub(crate) fn take_striker(&mut self) -> Option<TakenStriker> {
        let parts = self.couplings.iter().enumerate().rev();
        let (index, striker) =
            parts.filter_map(|(k, part)| Some((k, part.call.striker()?))).next()?;
        let part = self.couplings.remove(index).with(striker);
        Some(TakenStriker { part, mass: self.striker_mass })
    }

    /// Motion of the `carriage` along axis `k`.
    fn motion(carriage: &Carriage, k: usize) -> Motion {
        Motion {
            dt: carriage.dt,
            position: carriage.position[k],
            velocity: carriage.velocity[k],
            acceleration: carriage.acceleration[k],
            ..Motion::default()
        }
    }

    /// Force (N) along each axis that moves the `carriage`.
    fn force(&self, memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        both(|k| {
            let friction = self.rubs[k].force(memory, &Self::motion(carriage, k));
            self.mass[k] * carriage.acceleration[k] + friction
        })
    }
}

/// Position of the load (m) behind all `parts`, which transmit `force` (N), with the motor side at `position` (m).
fn stretched(parts: &[StretchPart], position: f64, force: f64) -> f64 {
    parts.iter().fold(position, |position, part| {
        (part.call)(part.p(), &Motion { position, force, ..Motion::default() })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::find,
        twin::{Machine, Source},
    };

    /// Compliance of both belts (m/N), friction (N) and viscous friction (N s/m) of both guides.
    const COMPLIANCE: f64 = 1e-4;
    const LEVEL: f64 = 2.0;
    const DAMPING: f64 = 3.0;

    fn soft(axis: Axis) -> Linkage {
        let mut twin = Twin::nominal(Machine::Table);
        twin.instances.retain(|own| !own.effect.name.starts_with("drive.friction"));
        let mut add = |name, axis, values: &[f64]| {
            let effect = find(name).unwrap();
            twin.instances.push(Instance::new(effect, axis, values, Source::Known));
        };
        add("drive.compliance.belt", Axis::Motors, &[COMPLIANCE, 0.98, 0.05]);
        add("drive.friction.coulomb", axis, &[LEVEL]);
        add("drive.friction.viscous", axis, &[DAMPING]);
        Linkage::new(&twin, Places::Reported)
    }

    /// Distance (m) of the striker behind a motor that moves along x with `velocity` (m/s) for a
    /// while.
    fn behind(linkage: &Linkage, memory: &mut [f64], velocity: f64) -> f64 {
        let mut place = [0.0; 2];
        for _ in 0..10 {
            let carriage = Carriage { dt: 1e-3, velocity: [velocity, 0.0], ..Carriage::default() };
            place = linkage.striker(memory, carriage);
        }
        assert!(place[1].abs() < 1e-12);
        -place[0]
    }

    #[test]
    fn friction_on_the_rails_stretches_the_belts_and_stays_at_rest() {
        let linkage = soft(Axis::Guides);
        let mut memory = vec![0.0; linkage.memory()];
        // Two belts share the force, and both stretch.
        let stretch = |velocity: f64, level: f64| 0.5 * COMPLIANCE * (level + DAMPING * velocity);
        for (velocity, level) in [(0.2, LEVEL), (0.0, LEVEL), (-0.3, -LEVEL), (0.0, -LEVEL)] {
            let found = behind(&linkage, &mut memory, velocity);
            assert!((found - stretch(velocity, level)).abs() < 1e-12, "{velocity}: {found}");
        }
        let at_motors = soft(Axis::Motors);
        let mut memory = vec![0.0; at_motors.memory()];
        assert!(behind(&at_motors, &mut memory, 0.2).abs() < 1e-12);
    }
}
