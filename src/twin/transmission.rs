//! Two masses with a spring between them, per motor: one step of a gantry whose belts are soft or have play.

use super::contact::Contact;
use crate::{
    effects::{Spring, both},
    gantry::{belts, rails},
};

/// Largest share of a rail's mass that is rotors.
const MOST_ROTOR: f64 = 0.95;

/// Longest part of a step that motor and load may cross a play in (s).
const LONGEST_WITH_PLAY: f64 = 2.5e-4;

/// How often the sides are sought on which springs with play touch over a step.
const MOST_SEARCHES: usize = 4;

/// A motor and what ties it to the load; without a spring the belt is rigid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tie {
    pub(super) spring: Option<Spring>,
    /// Mass that stays with the motor (kg of belt).
    pub(super) motor_mass: f64,
}

/// The ties of both motors where at least one belt is soft.
pub(super) fn ties(soft: [Option<Spring>; 2]) -> Option<[Tie; 2]> {
    let other = soft.iter().flatten().next()?.motor_mass;
    Some(soft.map(|spring| Tie { spring, motor_mass: spring.map_or(other, |own| own.motor_mass) }))
}

/// The ties with rotors that are no more than what moves on either rail, and the mass there that is no rotor (kg).
pub(super) fn parted(ties: &[Tie; 2], mass: [f64; 2]) -> ([Tie; 2], [f64; 2]) {
    let rotors = ties[0].motor_mass + ties[1].motor_mass;
    let share = (MOST_ROTOR * mass[0].min(mass[1]) / rotors).min(1.0);
    let ties = ties.map(|own| Tie { motor_mass: share * own.motor_mass, ..own });
    (ties, mass.map(|mass| mass - share * rotors))
}

/// Motors and load at the start of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct TwoMasses {
    pub(super) ties: [Tie; 2],
    /// Mass of the load on each rail (kg).
    pub(super) load_mass: [f64; 2],
    /// How far the load is ahead of the motors, in board coordinates (m).
    pub(super) ahead: [f64; 2],
    /// Velocity of the motors (m/s of belt).
    pub(super) motor: [f64; 2],
    /// Velocity of the load (m/s).
    pub(super) load: [f64; 2],
    /// Length of the step (s).
    pub(super) dt: f64,
}

/// What rubs on both sides of the springs.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rubbing {
    pub(super) motors: [Contact; 2],
    pub(super) rails: [Contact; 2],
}

impl Rubbing {
    /// Where the bends of all contacts are remembered.
    fn places(&self) -> [Option<usize>; 4] {
        let [a, b] = self.motors;
        let [x, y] = self.rails;
        [a, b, x, y].map(|contact| contact.bristles.map(|(_, place)| place))
    }

    pub(super) fn bends(&self, memory: &[f64]) -> [f64; 4] {
        self.places().map(|place| place.map_or(0.0, |place| memory[place]))
    }

    pub(super) fn put_back(&self, memory: &mut [f64], bends: [f64; 4]) {
        for (place, bend) in self.places().into_iter().zip(bends) {
            if let Some(place) = place {
                memory[place] = bend;
            }
        }
    }
}

/// Motors and load at the end of a step.
pub(super) struct Moved {
    /// Velocity of the motors (m/s of belt).
    pub(super) motor: [f64; 2],
    /// Velocity of the load (m/s).
    pub(super) load: [f64; 2],
    /// How far the load is ahead of the motors, in board coordinates (m).
    pub(super) ahead: [f64; 2],
    /// Friction, its mean over the step: on each rail (N), and at each motor (N of belt).
    pub(super) friction: [f64; 2],
    pub(super) rubbed: [f64; 2],
}

/// How the motors answer to forces over a step.
pub(super) struct Answer {
    /// Acceleration of each motor without forces of the motors (m/s^2 of belt).
    pub(super) drag: [f64; 2],
    /// What a force of each motor (columns) adds to that of each (rows; 1/kg).
    pub(super) gives: [[f64; 2]; 2],
}

impl Answer {
    /// The same where the motors are `rubbed` as well (N of belt).
    pub(super) fn rubbed(self, rubbed: [f64; 2]) -> Self {
        let slowed = |m: usize| self.gives[m][0] * rubbed[0] + self.gives[m][1] * rubbed[1];
        Self { drag: both(|m| self.drag[m] + slowed(m)), ..self }
    }

    /// Forces of two loops (N of belt): what they `asked` for, less what each `gives_way` to the acceleration of its
    /// motor (N s^2/m), to which both forces add.
    pub(super) fn demand(&self, asked: [f64; 2], gives_way: [f64; 2]) -> [f64; 2] {
        let falls = |m: usize, of: usize| gives_way[m] * self.gives[m][of];
        let own = both(|m| 1.0 + falls(m, m));
        let other = both(|m| falls(m, 1 - m));
        let determinant = own[0] * own[1] - other[0] * other[1];
        both(|m| (own[1 - m] * asked[m] - other[m] * asked[1 - m]) / determinant)
    }
}

/// Where the play of each tie ends that it touches (m from its middle, where the motor is ahead); `None` inside it.
type Ends = [Option<f64>; 2];

/// What one tie makes of a step. With the velocities at its end, the motor's is that of the load for a `share`, and for
/// the rest what it would be alone; with the motor eliminated the load gets `given - drag load` (N of belt).
struct Link {
    /// Of the rotor (kg/s).
    inertia: f64,
    /// 1 of a rigid tie, less of a soft one, 0 inside a play.
    share: f64,
    /// What the tie pulls at its motor, were motor and load as fast (N of belt).
    still: f64,
    given: f64,
    drag: f64,
}

/// What the load resists a change of its velocity over a step (kg/s): on each rail, and on one of the velocity along
/// the other, where one motor is tied to it more firmly.
struct Resistance {
    own: [f64; 2],
    across: f64,
}

impl Resistance {
    /// Velocity along the rails (m/s) under a `push` over the step (N).
    fn yields(&self, push: [f64; 2]) -> [f64; 2] {
        let Self { own, across } = *self;
        let determinant = own[0] * own[1] - across * across;
        [
            (own[1] * push[0] - across * push[1]) / determinant,
            (own[0] * push[1] - across * push[0]) / determinant,
        ]
    }

    /// What a push along `direction` meets (kg/s).
    fn along(&self, direction: [f64; 2]) -> f64 {
        let moved = self.yields(direction);
        1.0 / (direction[0] * moved[0] + direction[1] * moved[1])
    }
}

/// One along the axis `index`.
fn unit(index: usize) -> [f64; 2] {
    both(|axis| if axis == index { 1.0 } else { 0.0 })
}

impl TwoMasses {
    /// How the motors answer over the step with `pull` on the rails (N), while every play touches what it touches now.
    pub(super) fn answer(&self, pull: [f64; 2]) -> Answer {
        let links = self.links([0.0; 2], self.ends([0.0; 2]));
        let resistance = self.resistance(&links);
        let free = belts(self.free(&resistance, &links, pull));
        let drag = both(|m| (self.motor(m, &links[m], 0.0, free[m]) - self.motor[m]) / self.dt);
        let moved = both(|of| {
            let arrives = belts(unit(of)).map(|own| links[of].share * own);
            belts(resistance.yields(arrives))
        });
        let gives = |m: usize, of: usize| {
            let alone = if m == of { 1.0 / links[m].inertia } else { 0.0 };
            (alone + links[m].share * (moved[of][m] - alone)) / self.dt
        };
        Answer { drag, gives: both(|m| both(|of| gives(m, of))) }
    }

    /// The ends that the ties touch when each motor has `gained` so much on the load (m of belt).
    fn ends(&self, gained: [f64; 2]) -> Ends {
        let ahead = belts(self.ahead);
        both(|m| {
            let half = 0.5 * self.ties[m].spring.map_or(0.0, |spring| spring.backlash);
            let stretch = gained[m] - ahead[m];
            (half == 0.0 || half < stretch.abs()).then(|| half.copysign(stretch))
        })
    }

    /// How far each motor gets ahead of the load over a step at whose end they move with `motor` and `load`
    /// (m of belt).
    fn gained(&self, motor: [f64; 2], load: [f64; 2]) -> [f64; 2] {
        let (before, load) = (self.rates(), belts(load));
        both(|m| 0.5 * self.dt * (before[m] + motor[m] - load[m]))
    }

    /// How fast each motor runs ahead of the load (m/s of belt).
    fn rates(&self) -> [f64; 2] {
        let load = belts(self.load);
        both(|m| self.motor[m] - load[m])
    }

    /// What the ties, which touch at `ends`, make of the step under `force` of the motors (N of belt). Springs follow
    /// the motion through the step (the implicit midpoint rule), which neither damps nor feeds the swinging.
    fn links(&self, force: [f64; 2], ends: Ends) -> [Link; 2] {
        let (ahead, rate, dt) = (belts(self.ahead), self.rates(), self.dt);
        let link = |m: usize| {
            let inertia = self.ties[m].motor_mass / dt;
            let driven = inertia * self.motor[m] + force[m];
            let Some(spring) = self.ties[m].spring else {
                return Link { inertia, share: 1.0, still: 0.0, given: driven, drag: inertia };
            };
            let (follow, still) = ends[m].map_or((0.0, 0.0), |end| {
                let follow = 0.25 * spring.stiffness * dt + 0.5 * spring.damping();
                (follow, follow * rate[m] - spring.stiffness * (ahead[m] + end))
            });
            let share = follow / (inertia + follow);
            let given = still + share * (driven - still);
            Link { inertia, share, still, given, drag: share * inertia }
        };
        [link(0), link(1)]
    }

    /// What the load, with what the ties add to it, resists a change of its velocity.
    fn resistance(&self, links: &[Link; 2]) -> Resistance {
        let along = links[0].drag + links[1].drag;
        Resistance {
            own: self.load_mass.map(|mass| mass / self.dt + along),
            across: links[0].drag - links[1].drag,
        }
    }

    /// Velocity of the load after the step without friction, under `pull` on the rails (N).
    fn free(&self, resistance: &Resistance, links: &[Link; 2], pull: [f64; 2]) -> [f64; 2] {
        let given = belts([links[0].given, links[1].given]);
        resistance.yields(both(|rail| {
            self.load_mass[rail] / self.dt * self.load[rail] + given[rail] + pull[rail]
        }))
    }

    /// Velocity of motor `m` after the step, of a load that then moves with `load` (m/s of belt) there.
    fn motor(&self, m: usize, link: &Link, force: f64, load: f64) -> f64 {
        let alone = self.motor[m] + (force - link.still) / link.inertia;
        alone + link.share * (load - alone)
    }

    /// Motors and load after a step in which they `moved`.
    fn after(&self, moved: &Moved) -> Self {
        Self { ahead: moved.ahead, motor: moved.motor, load: moved.load, ..*self }
    }

    /// The step under `forces` of the motors (N of belt) and on the rails (N), with what `rubs` on motors and rails,
    /// whose bends are in `memory`.
    pub(super) fn step(&self, forces: [[f64; 2]; 2], rubs: &Rubbing, memory: &mut [f64]) -> Moved {
        let has_backlash = |tie: &Tie| tie.spring.is_some_and(|spring| 0.0 < spring.backlash);
        if !self.ties.iter().any(has_backlash) {
            return self.touching(forces, [Some(0.0); 2], rubs, memory);
        }
        let parts = (self.dt / LONGEST_WITH_PLAY).ceil().max(1.0);
        let mut now = Self { dt: self.dt / parts, ..*self };
        let (mut friction, mut rubbed) = ([0.0; 2], [0.0; 2]);
        for _ in 0..parts as usize {
            let moved = now.part(forces, rubs, memory);
            now = now.after(&moved);
            friction = both(|rail| friction[rail] + moved.friction[rail] / parts);
            rubbed = both(|m| rubbed[m] + moved.rubbed[m] / parts);
        }
        Moved { motor: now.motor, load: now.load, ahead: now.ahead, friction, rubbed }
    }

    /// A part of the step, over which every play touches one end or none.
    fn part(&self, forces: [[f64; 2]; 2], rubs: &Rubbing, memory: &mut [f64]) -> Moved {
        let mut ends = self.ends(self.rates().map(|rate| 0.5 * self.dt * rate));
        let bends = rubs.bends(memory);
        let mut moved = self.touching(forces, ends, rubs, memory);
        for _ in 0..MOST_SEARCHES {
            let touched =
                self.ends(self.gained(moved.motor, moved.load).map(|gained| 0.5 * gained));
            if touched == ends {
                break;
            }
            ends = touched;
            rubs.put_back(memory, bends);
            moved = self.touching(forces, ends, rubs, memory);
        }
        moved
    }

    /// The same with ties that touch at `ends`.
    fn touching(
        &self,
        [mut force, pull]: [[f64; 2]; 2],
        ends: Ends,
        rubs: &Rubbing,
        memory: &mut [f64],
    ) -> Moved {
        let dt = self.dt;
        let mut links = self.links(force, ends);
        // Whatever the forces are.
        let resistance = self.resistance(&links);
        let mut free = self.free(&resistance, &links, pull);
        let mut rubbed = [0.0; 2];
        if rubs.motors.iter().any(|contact| 0.0 < contact.level) {
            let along = belts(free);
            for (m, contact) in rubs.motors.iter().enumerate() {
                let motor = self.motor(m, &links[m], force[m], along[m]);
                let held = match self.ties[m].spring {
                    Some(_) => links[m].inertia / (1.0 - links[m].share),
                    None => resistance.along(belts(unit(m))),
                };
                rubbed[m] = contact.force(memory, held * dt, [self.motor[m], motor], dt);
                force[m] += rubbed[m];
            }
            links = self.links(force, ends);
            free = self.free(&resistance, &links, pull);
        }
        let (mut load, mut friction) = (free, [0.0; 2]);
        for (rail, contact) in rubs.rails.iter().enumerate() {
            let mass = resistance.along(unit(rail)) * dt;
            let force = contact.force(memory, mass, [self.load[rail], load[rail]], dt);
            let slowed = resistance.yields(unit(rail).map(|own| own * force));
            load = both(|other| load[other] + slowed[other]);
            friction[rail] = force;
        }
        let along = belts(load);
        let motor = both(|m| self.motor(m, &links[m], force[m], along[m]));
        let gained = rails(self.gained(motor, load));
        let ahead = both(|rail| self.ahead[rail] - gained[rail]);
        Moved { motor, load, ahead, friction, rubbed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;
    /// As `drive.backlash` says of a millimetre.
    const BACKLASH_OF_A_MM: Spring =
        Spring { stiffness: 5e5, damping_ratio: 0.1, motor_mass: 0.98, backlash: 1e-3 };

    /// A step of 1 ms.
    fn stepped(two: &TwoMasses, force: [f64; 2]) -> Moved {
        two.step([force, [0.0; 2]], &Rubbing::default(), &mut [])
    }

    fn soft(stiffness: f64) -> Spring {
        Spring { stiffness, damping_ratio: 0.0, motor_mass: 1.0, backlash: 0.0 }
    }

    /// Velocity of motor a and of the load along x after `steps`, from motors that run at 0.1 m/s and a load at rest.
    fn swung(steps: usize, dt: f64) -> (f64, f64) {
        let ties = ties([Some(soft(2e4)); 2]).unwrap();
        let (ahead, motor, load) = ([0.0; 2], [0.1; 2], [0.0; 2]);
        let mut two = TwoMasses { ties, load_mass: [0.5; 2], ahead, motor, load, dt };
        for _ in 0..steps {
            let moved = stepped(&two, [0.0; 2]);
            two = two.after(&moved);
        }
        assert!((two.motor[0] - two.motor[1]).abs() < 1e-12);
        (two.motor[0], two.load[0])
    }

    #[test]
    fn momentum_and_energy_are_kept() {
        let (motor, load) = swung(500, DT);
        // Along x the two rotors move as one mass of 2 kg on 4e4 N/m.
        assert!((2.0 * motor + 0.5 * load - 0.2).abs() < 1e-9);
        let most = (0..200).map(|steps| swung(steps, DT).0).fold(0.0, f64::max);
        assert!((most - 0.1).abs() < 1e-3, "{most}");
    }

    #[test]
    fn it_swings_at_the_frequency_of_two_masses() {
        // 4e4 N/m between 2 and 0.5 kg: 316 rad/s. After a half period the load has all it can have.
        let half = std::f64::consts::PI / (4e4 * (1.0 / 2.0 + 1.0 / 0.5_f64)).sqrt();
        let (_, load) = swung(100, half / 100.0);
        assert!((load - 2.0 * 0.1 * 2.0 / 2.5).abs() < 1e-4, "{load}");
    }

    #[test]
    fn stiff_belts_answer_as_rigid_ones_and_inside_their_play_each_motor_for_itself() {
        let answer = |spring: Spring| {
            let ties = ties([Some(spring); 2]).unwrap();
            let (ahead, motor, load) = ([0.0; 2], [0.0; 2], [0.0; 2]);
            TwoMasses { ties, load_mass: [0.5, 1.0], ahead, motor, load, dt: DT }.answer([1.0, 2.0])
        };
        // Two rotors of 1 kg on each rail: 2.5 kg move along x and 3 kg along y.
        let [along_x, along_y] = [1.0 / 2.5, 1.0 / 3.0];
        let Answer { drag, gives } = answer(soft(1e12));
        let near = |own: [f64; 2], wanted: [f64; 2]| {
            assert!(
                own.iter().zip(wanted).all(|(own, wanted)| (own - wanted).abs() < 1e-5),
                "{own:?}"
            )
        };
        near(drag, [along_x + 2.0 * along_y, along_x - 2.0 * along_y]);
        near(gives[0], [along_x + along_y, along_x - along_y]);
        near(gives[1], [along_x - along_y, along_x + along_y]);
        let Answer { drag, gives } = answer(Spring { backlash: 1e-3, ..soft(1e12) });
        near(drag, [0.0; 2]);
        near(gives[0], [1.0, 0.0]);
        near(gives[1], [0.0, 1.0]);
    }

    #[test]
    fn loops_that_give_way_demand_what_is_left_of_what_they_asked() {
        let answer = Answer { drag: [0.0; 2], gives: [[0.7, 0.1], [0.1, 0.7]] };
        let (asked, gives_way) = ([3.0, -1.0], [0.5, 0.2]);
        let demand = answer.demand(asked, gives_way);
        for m in 0..2 {
            let along: f64 = (0..2).map(|of| answer.gives[m][of] * demand[of]).sum();
            assert!((demand[m] - (asked[m] - gives_way[m] * along)).abs() < 1e-12, "{demand:?}");
        }
    }

    #[test]
    fn inside_its_play_a_motor_moves_alone_and_then_takes_the_load_along() {
        let spring = Spring { stiffness: 5e5, damping_ratio: 0.5, motor_mass: 1.0, backlash: 2e-3 };
        let ties = ties([Some(spring); 2]).unwrap();
        let (ahead, motor, load) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut two = TwoMasses { ties, load_mass: [0.5; 2], ahead, motor, load, dt: DT };
        for step in 0..200 {
            // 1 N on each motor of 1 kg: it has crossed 1 mm after sqrt(2 mm / (1 m/s^2)), 45 ms.
            let moved = stepped(&two, [1.0; 2]);
            if step < 44 {
                assert_eq!(moved.load, [0.0; 2], "{step}");
            }
            two = two.after(&moved);
        }
        // All forces are inside: 2 N for 0.2 s on 2.5 kg, and the load is behind by half the play and a little more.
        let momentum = 0.5 * two.load[0] + two.motor[0] + two.motor[1];
        assert!((momentum - 0.4).abs() < 1e-9, "{momentum}");
        assert!((two.load[0] - 0.16).abs() < 1e-3, "{:?}", two.load);
        let behind = -two.ahead[0];
        assert!((0.99e-3..1.01e-3).contains(&behind), "{behind}");
    }

    #[test]
    fn at_the_end_of_a_play_half_of_the_speed_comes_back() {
        // On this table: a rotor of 0.98 kg against what each belt moves of the load.
        let ties = ties([BACKLASH_OF_A_MM; 2].map(Some)).unwrap();
        let (ahead, motor, load) = ([0.0; 2], [0.05; 2], [0.0; 2]);
        let mut two = TwoMasses { ties, load_mass: [0.48; 2], ahead, motor, load, dt: DT };
        for _ in 0..30 {
            let moved = stepped(&two, [0.0; 2]);
            two = two.after(&moved);
        }
        let apart = rails(two.motor)[0] - two.load[0];
        assert!((-0.04..-0.02).contains(&apart), "{apart}");
        let momentum = 2.0 * 0.98 * rails(two.motor)[0] + 0.48 * two.load[0];
        assert!((momentum - 2.0 * 0.98 * 0.05).abs() < 1e-9, "{momentum}");
    }

    #[test]
    fn rotors_are_never_more_than_all_that_moves() {
        let own = Tie { spring: None, motor_mass: 2.0 };
        let (ties, load) = parted(&[own; 2], [2.0, 3.0]);
        assert!((ties[0].motor_mass - 0.95).abs() < 1e-12);
        assert!((load[0] - 0.1).abs() < 1e-12 && (load[1] - 1.1).abs() < 1e-12);
    }

    #[test]
    fn beside_a_soft_belt_a_rigid_one_follows_at_once() {
        assert!(ties([None, None]).is_none());
        let ties = ties([None, Some(soft(1e5))]).unwrap();
        assert_eq!(ties[0].motor_mass, 1.0);
        let (ahead, motor, load) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut two = TwoMasses { ties, load_mass: [0.5, 0.7], ahead, motor, load, dt: DT };
        for _ in 0..100 {
            let moved = stepped(&two, [1.0; 2]);
            two = two.after(&moved);
            assert!((two.motor[0] - belts(two.load)[0]).abs() < 1e-12);
            assert!(belts(two.ahead)[0].abs() < 1e-12);
        }
        // All forces are inside: what 2 N along x give in 0.1 s.
        let momentum = 0.5 * two.load[0] + two.motor[0] + two.motor[1];
        assert!((momentum - 0.2).abs() < 1e-9, "{momentum}");
    }
}
