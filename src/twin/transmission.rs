//! Two masses with a spring between them, per motor: one step of a gantry whose belts have
//! compliance or backlash.

use super::contact::{Contact, Free};
use crate::{
    effects::{Spring, both},
    lanes::{Lanes, Mask, belts, rails, select},
};
use pulp::Simd;

/// Largest fraction of the mass on an axis that is rotors, where that mass changes along the axis.
const MOST_ROTOR: f64 = 0.998;

/// Longest part of a step in which motor and load may cross the backlash (s).
const LONGEST_WITH_PLAY: f64 = 2.5e-4;

/// Most searches for the sides on which springs with backlash touch over a step.
const MOST_SEARCHES: usize = 4;

/// Motor and its tie to the load; without a spring the belt is rigid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tie {
    spring: Option<Spring>,
    /// Damping of the spring (N s/m).
    damping: f64,
    /// Mass that stays with the motor (kg of belt).
    pub(super) motor_mass: f64,
}

/// The ties of both motors where at least one belt is soft, with `mass` on the axes (kg).
pub(super) fn ties(soft: [Option<Spring>; 2], mass: [f64; 2]) -> Option<[Tie; 2]> {
    let any = *soft.iter().flatten().next()?;
    let per_belt = 0.5 * mass[0].min(mass[1]);
    Some(soft.map(|spring| {
        let Spring { stiffness, damping_ratio, load_fraction, .. } = spring.unwrap_or(any);
        Tie {
            spring,
            damping: 2.0 * damping_ratio * (stiffness * load_fraction * per_belt).sqrt(),
            motor_mass: (1.0 - load_fraction) * per_belt,
        }
    }))
}

/// One motor and its tie to the load, of each simulation.
#[derive(Debug, Clone, Copy)]
pub(super) struct TieLanes<S: Simd> {
    /// True for a soft belt.
    pub(super) is_soft: Mask<S>,
    /// Stiffness and damping of the spring (N/m, N s/m).
    stiffness: Lanes<S>,
    damping: Lanes<S>,
    /// Width within which no force passes (m).
    backlash: Lanes<S>,
    /// Mass that stays with the motor (kg of belt), and its reciprocal (1/kg).
    pub(super) motor_mass: Lanes<S>,
    per_motor_mass: Lanes<S>,
}

impl<S: Simd> TieLanes<S> {
    /// The tie `of` each simulation.
    #[inline(always)]
    pub(super) fn new(simd: S, of: impl Fn(usize) -> Tie) -> Self {
        let number = |get: fn(&Spring) -> f64| {
            Lanes::from_fn(simd, |lane| of(lane).spring.as_ref().map_or(0.0, get))
        };
        let motor_mass = Lanes::from_fn(simd, |lane| of(lane).motor_mass);
        Self {
            is_soft: Mask::from_fn(simd, |lane| of(lane).spring.is_some()),
            stiffness: number(|spring| spring.stiffness),
            damping: Lanes::from_fn(simd, |lane| of(lane).damping),
            backlash: number(|spring| spring.backlash),
            motor_mass,
            per_motor_mass: 1.0 / motor_mass,
        }
    }

    /// The same with this fraction of the mass.
    #[inline(always)]
    fn with_share(&self, share: Lanes<S>) -> Self {
        let motor_mass = share * self.motor_mass;
        Self { motor_mass, per_motor_mass: 1.0 / motor_mass, ..*self }
    }
}

/// Ties whose rotors are no more than the mass on either axis, and the mass there without rotors
/// (kg).
#[inline(always)]
pub(super) fn parted<S: Simd>(
    simd: S,
    [a, b]: &[TieLanes<S>; 2],
    mass: [Lanes<S>; 2],
) -> ([TieLanes<S>; 2], [Lanes<S>; 2]) {
    let rotors = a.motor_mass + b.motor_mass;
    let most = MOST_ROTOR * mass[0].min(mass[1]);
    let share = (most / rotors).min(Lanes::splat(simd, 1.0));
    (
        [a.with_share(share), b.with_share(share)],
        [mass[0] - share * rotors, mass[1] - share * rotors],
    )
}

/// Motors and load at the start of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct TwoMasses<S: Simd> {
    pub(super) simd: S,
    pub(super) ties: [TieLanes<S>; 2],
    /// Mass of the load on each axis (kg).
    pub(super) load_mass: [Lanes<S>; 2],
    /// Displacement of the load ahead of the motors, in board coordinates (m).
    pub(super) ahead: [Lanes<S>; 2],
    /// Velocity of the motors (m/s of belt).
    pub(super) motor: [Lanes<S>; 2],
    /// Velocity of the load (m/s).
    pub(super) load: [Lanes<S>; 2],
    /// Length of the step (s), and its reciprocal (1/s).
    pub(super) dt: Lanes<S>,
    pub(super) per_dt: Lanes<S>,
}

/// Friction on both sides of the springs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rubbing<S: Simd> {
    pub(super) motors: [Contact<S>; 2],
    pub(super) rails: [Contact<S>; 2],
}

/// Bends of all contacts: those at the motors, those on the guides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bends<S: Simd> {
    pub(super) motors: [Lanes<S>; 2],
    pub(super) rails: [Lanes<S>; 2],
}

impl<S: Simd> Bends<S> {
    /// These in the lanes in which `is_ours`, the `other` ones elsewhere.
    #[inline(always)]
    pub(super) fn or(self, is_ours: Mask<S>, other: Self) -> Self {
        Self {
            motors: select(is_ours, self.motors, other.motors),
            rails: select(is_ours, self.rails, other.rails),
        }
    }
}

/// Motors and load at the end of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moved<S: Simd> {
    /// Velocity of the motors (m/s of belt).
    pub(super) motor: [Lanes<S>; 2],
    /// Velocity of the load (m/s).
    pub(super) load: [Lanes<S>; 2],
    /// Displacement of the load ahead of the motors, in board coordinates (m).
    pub(super) ahead: [Lanes<S>; 2],
    /// Friction, its mean over the step: on each guide (N), and at each motor (N of belt).
    pub(super) friction: [Lanes<S>; 2],
    pub(super) rubbed: [Lanes<S>; 2],
}

impl<S: Simd> Moved<S> {
    /// This in the lanes in which `is_ours`, the `other` elsewhere.
    #[inline(always)]
    fn or(self, is_ours: Mask<S>, other: Self) -> Self {
        Self {
            motor: select(is_ours, self.motor, other.motor),
            load: select(is_ours, self.load, other.load),
            ahead: select(is_ours, self.ahead, other.ahead),
            friction: select(is_ours, self.friction, other.friction),
            rubbed: select(is_ours, self.rubbed, other.rubbed),
        }
    }
}

/// Response of the motors to forces over a step.
pub(super) struct Answer<S: Simd> {
    /// Acceleration of each motor without forces of the motors (m/s^2 of belt).
    pub(super) drag: [Lanes<S>; 2],
    /// Contribution of a force of each motor (columns) to the acceleration of each (rows; 1/kg).
    pub(super) gives: [[Lanes<S>; 2]; 2],
}

impl<S: Simd> Answer<S> {
    /// The same with friction `rubbed` at the motors (N of belt).
    #[inline(always)]
    pub(super) fn rubbed(self, rubbed: [Lanes<S>; 2]) -> Self {
        let [own, other] = self.gives;
        let drag = [
            self.drag[0] + (own[0] * rubbed[0] + own[1] * rubbed[1]),
            self.drag[1] + (other[0] * rubbed[0] + other[1] * rubbed[1]),
        ];
        Self { drag, ..self }
    }

    /// Forces of two loops (N of belt): the `asked` ones, less the decrease `gives_way` with the
    /// acceleration of the motor (N s^2/m), to which both forces contribute.
    #[inline(always)]
    pub(super) fn demand(&self, asked: [Lanes<S>; 2], gives_way: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        let falls = both(
            #[inline(always)]
            |m| [gives_way[m] * self.gives[m][0], gives_way[m] * self.gives[m][1]],
        );
        let own = [1.0 + falls[0][0], 1.0 + falls[1][1]];
        let other = [falls[0][1], falls[1][0]];
        let per_determinant = 1.0 / (own[0] * own[1] - other[0] * other[1]);
        [
            (own[1] * asked[0] - other[0] * asked[1]) * per_determinant,
            (own[0] * asked[1] - other[1] * asked[0]) * per_determinant,
        ]
    }
}

/// End of the backlash that each tie touches (m from its middle, positive where the motor is
/// ahead), and whether it touches one.
#[derive(Debug, Clone, Copy)]
struct Ends<S: Simd> {
    touch: [Mask<S>; 2],
    at: [Lanes<S>; 2],
}

impl<S: Simd> Ends<S> {
    /// Lanes in which both are the same.
    #[inline(always)]
    fn are(&self, other: &Self) -> Mask<S> {
        let same = both(
            #[inline(always)]
            |m| {
                let at_one = self.touch[m] & other.touch[m] & self.at[m].equals(other.at[m]);
                at_one.or(self.touch[m].or(other.touch[m]).not())
            },
        );
        same[0] & same[1]
    }
}

/// Tie over one step. At its end, the velocity of the motor is a weighted mean. The weight of the
/// load's velocity is `share`; the rest belongs to the velocity that the motor would have alone.
#[derive(Debug, Clone, Copy)]
struct Link<S: Simd> {
    /// Inertia of the rotor (kg/s), and its reciprocal (s/kg).
    inertia: Lanes<S>,
    per_inertia: Lanes<S>,
    /// Inertia of the rotor on its spring (kg/s).
    sprung_inertia: Lanes<S>,
    /// 1 for a rigid tie, less for a soft one, 0 inside the backlash.
    share: Lanes<S>,
    /// Pull of the tie at its motor if motor and load were equally fast (N of belt).
    still: Lanes<S>,
    /// Contribution of the motor to the inertia of the load (kg/s).
    drag: Lanes<S>,
}

/// Resistance of the load to a change of its velocity over a step (kg/s). It has a value along each
/// axis, and one across the axes if one motor is tied to the load more firmly.
#[derive(Debug, Clone, Copy)]
struct Resistance<S: Simd> {
    own: [Lanes<S>; 2],
    across: Lanes<S>,
    determinant: Lanes<S>,
    per_determinant: Lanes<S>,
    /// Inertia of the load alone (kg/s).
    load: [Lanes<S>; 2],
}

impl<S: Simd> Resistance<S> {
    /// Velocity along the axes (m/s) under a `push` over the step (N).
    #[inline(always)]
    fn yields(&self, push: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        let Self { own, across, per_determinant, .. } = *self;
        [
            (own[1] * push[0] - across * push[1]) * per_determinant,
            (own[0] * push[1] - across * push[0]) * per_determinant,
        ]
    }

    /// Resistance to a push along each axis (kg/s).
    #[inline(always)]
    fn along_rails(&self) -> [Lanes<S>; 2] {
        let Self { own, determinant, .. } = *self;
        [determinant / own[1], determinant / own[0]]
    }

    /// Resistance to a push of each belt (kg/s).
    #[inline(always)]
    fn along_belts(&self) -> [Lanes<S>; 2] {
        let Self { own, across, determinant, .. } = *self;
        let (sum, twice) = (own[0] + own[1], 2.0 * across);
        [determinant / (sum - twice), determinant / (sum + twice)]
    }
}

impl<S: Simd> TwoMasses<S> {
    /// Response of the motors over the step with `pull` on the axes (N), while the contact of each
    /// tie stays as it is now.
    #[inline(always)]
    pub(super) fn answer(&self, pull: [Lanes<S>; 2]) -> Answer<S> {
        let nothing = Lanes::splat(self.simd, 0.0);
        let links = self.links(self.ends([nothing; 2]));
        let resistance = self.resistance(&links);
        let free = belts(self.free(&resistance, &links, [nothing; 2], pull));
        let drag = both(
            #[inline(always)]
            |m| (self.motor(m, &links[m], nothing, free[m]) - self.motor[m]) * self.per_dt,
        );
        let [a, b] = [links[0].share, links[1].share];
        let moved = [belts(resistance.yields([a, a])), belts(resistance.yields([b, -b]))];
        let gives = both(
            #[inline(always)]
            |m| {
                both(
                    #[inline(always)]
                    |of| {
                        let alone = if m == of { links[m].per_inertia } else { nothing };
                        (alone + links[m].share * (moved[of][m] - alone)) * self.per_dt
                    },
                )
            },
        );
        Answer { drag, gives }
    }

    /// Ends that the ties touch when each motor has `gained` this distance on the load (m of belt).
    #[inline(always)]
    fn ends(&self, gained: [Lanes<S>; 2]) -> Ends<S> {
        let ahead = belts(self.ahead);
        let nothing = Lanes::splat(self.simd, 0.0);
        let half = [0.5 * self.ties[0].backlash, 0.5 * self.ties[1].backlash];
        let stretch = [gained[0] - ahead[0], gained[1] - ahead[1]];
        Ends {
            touch: both(
                #[inline(always)]
                |m| half[m].equals(nothing).or(half[m].less_than(stretch[m].abs())),
            ),
            at: [half[0].copysign(stretch[0]), half[1].copysign(stretch[1])],
        }
    }

    /// Distance that each motor gains on the load over a step at whose end they move with `motor`
    /// and `load` (m of belt).
    #[inline(always)]
    fn gained(&self, motor: [Lanes<S>; 2], load: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        let (before, load) = (self.rates(), belts(load));
        both(
            #[inline(always)]
            |m| 0.5 * self.dt * (before[m] + motor[m] - load[m]),
        )
    }

    /// Velocity of each motor relative to the load (m/s of belt).
    #[inline(always)]
    fn rates(&self) -> [Lanes<S>; 2] {
        let load = belts(self.load);
        [self.motor[0] - load[0], self.motor[1] - load[1]]
    }

    /// Links of the ties, which touch at `ends`, over the step. Springs follow the motion through
    /// the step (the implicit midpoint rule), which neither damps nor feeds the oscillation.
    #[inline(always)]
    fn links(&self, ends: Ends<S>) -> [Link<S>; 2] {
        let (ahead, rate, dt) = (belts(self.ahead), self.rates(), self.dt);
        let nothing = Lanes::splat(self.simd, 0.0);
        let one = Lanes::splat(self.simd, 1.0);
        both(
            #[inline(always)]
            |m| {
                let tie = &self.ties[m];
                let inertia = tie.motor_mass * self.per_dt;
                let pulls = ends.touch[m] & tie.is_soft;
                let follow = 0.25 * tie.stiffness * dt + 0.5 * tie.damping;
                let still = follow * rate[m] - tie.stiffness * (ahead[m] + ends.at[m]);
                let (follow, still) = (pulls.select(follow, nothing), pulls.select(still, nothing));
                let sprung_inertia = inertia + follow;
                let share = tie.is_soft.select(follow / sprung_inertia, one);
                let per_inertia = dt * tie.per_motor_mass;
                Link { inertia, per_inertia, sprung_inertia, share, still, drag: share * inertia }
            },
        )
    }

    /// Force of the ties on the load under `force` of the motors, with the motors eliminated:
    /// `given - drag load` (N of belt).
    #[inline(always)]
    fn given(&self, links: &[Link<S>; 2], force: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        both(
            #[inline(always)]
            |m| {
                let Link { inertia, share, still, .. } = links[m];
                let driven = inertia * self.motor[m] + force[m];
                let soft = still + share * (driven - still);
                self.ties[m].is_soft.select(soft, driven)
            },
        )
    }

    /// Resistance of the load to a change of its velocity, with the contribution of the ties.
    #[inline(always)]
    fn resistance(&self, links: &[Link<S>; 2]) -> Resistance<S> {
        let along = links[0].drag + links[1].drag;
        let across = links[0].drag - links[1].drag;
        let load = [self.load_mass[0] * self.per_dt, self.load_mass[1] * self.per_dt];
        let own = [load[0] + along, load[1] + along];
        let determinant = own[0] * own[1] - across * across;
        Resistance { own, across, determinant, per_determinant: 1.0 / determinant, load }
    }

    /// Velocity of the load after the step without friction, under `force` of the motors (N of
    /// belt) and `pull` on the axes (N).
    #[inline(always)]
    fn free(
        &self,
        resistance: &Resistance<S>,
        links: &[Link<S>; 2],
        force: [Lanes<S>; 2],
        pull: [Lanes<S>; 2],
    ) -> [Lanes<S>; 2] {
        let given = belts(self.given(links, force));
        resistance.yields(both(
            #[inline(always)]
            |rail| resistance.load[rail] * self.load[rail] + given[rail] + pull[rail],
        ))
    }

    /// Velocity of motor `m` after the step, for a load that then moves with `load` (m/s of belt)
    /// there.
    #[inline(always)]
    fn motor(&self, m: usize, link: &Link<S>, force: Lanes<S>, load: Lanes<S>) -> Lanes<S> {
        let alone = self.motor[m] + (force - link.still) * link.per_inertia;
        alone + link.share * (load - alone)
    }

    /// Motors and load after a step in which they `moved`.
    #[inline(always)]
    fn after(&self, moved: &Moved<S>) -> Self {
        Self { ahead: moved.ahead, motor: moved.motor, load: moved.load, ..*self }
    }

    /// Step under `forces` of the motors (N of belt) and on the axes (N), with the friction of
    /// `rubs` on motors and guides and its current `bends`.
    #[inline(always)]
    pub(super) fn step(
        &self,
        forces: [[Lanes<S>; 2]; 2],
        rubs: &Rubbing<S>,
        bends: &mut Bends<S>,
    ) -> Moved<S> {
        let simd = self.simd;
        let nothing = Lanes::splat(simd, 0.0);
        let [a, b] = &self.ties;
        let has_backlash = nothing.less_than(a.backlash).or(nothing.less_than(b.backlash));
        if !has_backlash.any() {
            let links = self.links(self.ends([nothing; 2]));
            return self.touching(forces, links, rubs, bends);
        }
        let parts =
            Lanes::from_fn(simd, |lane| (self.dt.get(lane) / LONGEST_WITH_PLAY).ceil().max(1.0));
        let parts = has_backlash.select(parts, Lanes::splat(simd, 1.0));
        self.in_parts(parts, forces, rubs, bends)
    }

    /// The same step in `parts` of equal length.
    #[inline(always)]
    fn in_parts(
        &self,
        parts: Lanes<S>,
        forces: [[Lanes<S>; 2]; 2],
        rubs: &Rubbing<S>,
        bends: &mut Bends<S>,
    ) -> Moved<S> {
        let nothing = Lanes::splat(self.simd, 0.0);
        let share = 1.0 / parts;
        let mut now = Self { dt: self.dt * share, per_dt: self.per_dt * parts, ..*self };
        let mut total = Moved {
            motor: now.motor,
            load: now.load,
            ahead: now.ahead,
            friction: [nothing; 2],
            rubbed: [nothing; 2],
        };
        let mut part = nothing;
        loop {
            let goes_on = part.less_than(parts);
            if !goes_on.any() {
                return total;
            }
            let mut bent = *bends;
            let moved = now.part(forces, rubs, &mut bent);
            *bends = bent.or(goes_on, *bends);
            let next = Moved {
                friction: both(
                    #[inline(always)]
                    |rail| total.friction[rail] + moved.friction[rail] * share,
                ),
                rubbed: both(
                    #[inline(always)]
                    |m| total.rubbed[m] + moved.rubbed[m] * share,
                ),
                ..moved
            };
            total = next.or(goes_on, total);
            now = now.after(&total);
            part = 1.0 + part;
        }
    }

    /// Part of the step, over which every tie touches one end of its backlash, or is inside it.
    #[inline(always)]
    fn part(
        &self,
        forces: [[Lanes<S>; 2]; 2],
        rubs: &Rubbing<S>,
        bends: &mut Bends<S>,
    ) -> Moved<S> {
        let rates = self.rates();
        let mut ends = self.ends([0.5 * self.dt * rates[0], 0.5 * self.dt * rates[1]]);
        let before = *bends;
        let mut moved = self.touching(forces, self.links(ends), rubs, bends);
        for _ in 0..MOST_SEARCHES {
            let gained = self.gained(moved.motor, moved.load);
            let touched = self.ends([0.5 * gained[0], 0.5 * gained[1]]);
            let settled = touched.are(&ends);
            if settled.all() {
                break;
            }
            ends = touched;
            let mut bent = before;
            let again = self.touching(forces, self.links(ends), rubs, &mut bent);
            moved = moved.or(settled, again);
            *bends = bends.or(settled, bent);
        }
        moved
    }

    /// The same with ties that touch as in `links`.
    #[inline(always)]
    fn touching(
        &self,
        [mut force, pull]: [[Lanes<S>; 2]; 2],
        links: [Link<S>; 2],
        rubs: &Rubbing<S>,
        bends: &mut Bends<S>,
    ) -> Moved<S> {
        let (simd, dt, per_dt) = (self.simd, self.dt, self.per_dt);
        let nothing = Lanes::splat(simd, 0.0);
        // Independent of the forces.
        let resistance = self.resistance(&links);
        let mut free = self.free(&resistance, &links, force, pull);
        let mut rubbed = [nothing; 2];
        let [a, b] = &rubs.motors;
        if nothing.less_than(a.level).or(nothing.less_than(b.level)).any() {
            let (along, rigid) = (belts(free), resistance.along_belts());
            for m in 0..2 {
                let link = &links[m];
                let motor = self.motor(m, link, force[m], along[m]);
                let inertia = self.ties[m].is_soft.select(link.sprung_inertia, rigid[m]);
                let motion = Free { inertia, velocity: [self.motor[m], motor], dt, per_dt };
                rubbed[m] = rubs.motors[m].force(simd, &mut bends.motors[m], motion);
                force[m] = force[m] + rubbed[m];
            }
            free = self.free(&resistance, &links, force, pull);
        }
        let (mut load, mut friction) = (free, [nothing; 2]);
        let inertia = resistance.along_rails();
        for rail in 0..2 {
            let velocity = [self.load[rail], load[rail]];
            let motion = Free { inertia: inertia[rail], velocity, dt, per_dt };
            let held = rubs.rails[rail].force(simd, &mut bends.rails[rail], motion);
            let push = if rail == 0 { [held, nothing] } else { [nothing, held] };
            let slowed = resistance.yields(push);
            load = [load[0] + slowed[0], load[1] + slowed[1]];
            friction[rail] = held;
        }
        let along = belts(load);
        let motor = both(
            #[inline(always)]
            |m| self.motor(m, &links[m], force[m], along[m]),
        );
        let gained = rails(self.gained(motor, load));
        let ahead = [self.ahead[0] - gained[0], self.ahead[1] - gained[1]];
        Moved { motor, load, ahead, friction, rubbed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    const DT: f64 = 1e-3;
    /// Spring of `drive.backlash` for a millimetre.
    const BACKLASH_OF_A_MM: Spring =
        Spring { stiffness: 5e5, damping_ratio: 0.2, load_fraction: 0.2, backlash: 1e-3 };
    /// Mass on the lighter axis (kg): with a load of 0.5 kg, each rotor has 1 kg.
    const MASS: f64 = 2.5;

    /// One simulation alone.
    fn alone(values: [f64; 2]) -> [Lanes<Scalar>; 2] {
        values.map(|value| Lanes::splat(Scalar, value))
    }

    fn number(values: [Lanes<Scalar>; 2]) -> [f64; 2] {
        values.map(|value| value.get(0))
    }

    /// Motors and load at their rest distance.
    fn two_masses(
        soft: [Option<Spring>; 2],
        load_mass: [f64; 2],
        [motor, load]: [[f64; 2]; 2],
        dt: f64,
    ) -> TwoMasses<Scalar> {
        TwoMasses {
            simd: Scalar,
            ties: ties(soft, [MASS; 2]).unwrap().map(|tie| TieLanes::new(Scalar, |_| tie)),
            load_mass: alone(load_mass),
            ahead: alone([0.0; 2]),
            motor: alone(motor),
            load: alone(load),
            dt: Lanes::splat(Scalar, dt),
            per_dt: Lanes::splat(Scalar, 1.0 / dt),
        }
    }

    /// A step without friction.
    fn stepped(two: &TwoMasses<Scalar>, force: [f64; 2]) -> Moved<Scalar> {
        let nothing = alone([0.0; 2]);
        let contacts = nothing.map(|level| Contact { level, bristles: None });
        let rubs = Rubbing { motors: contacts, rails: contacts };
        let mut bends = Bends { motors: nothing, rails: nothing };
        two.step([alone(force), nothing], &rubs, &mut bends)
    }

    fn soft(stiffness: f64) -> Spring {
        Spring { stiffness, damping_ratio: 0.0, load_fraction: 0.2, backlash: 0.0 }
    }

    /// Velocity of motor a and of the load along x after `steps`, from motors that run at 0.1 m/s and a load at rest.
    fn swung(steps: usize, dt: f64) -> (f64, f64) {
        let mut two = two_masses([Some(soft(2e4)); 2], [0.5; 2], [[0.1; 2], [0.0; 2]], dt);
        for _ in 0..steps {
            let moved = stepped(&two, [0.0; 2]);
            two = two.after(&moved);
        }
        let (motor, load) = (number(two.motor), number(two.load));
        assert!((motor[0] - motor[1]).abs() < 1e-12);
        (motor[0], load[0])
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
        // 4e4 N/m between 2 and 0.5 kg: 316 rad/s. After a half period the load has its highest
        // velocity.
        let half = std::f64::consts::PI / (4e4 * (1.0 / 2.0 + 1.0 / 0.5_f64)).sqrt();
        let (_, load) = swung(100, half / 100.0);
        assert!((load - 2.0 * 0.1 * 2.0 / 2.5).abs() < 1e-4, "{load}");
    }

    #[test]
    fn stiff_belts_answer_as_rigid_ones_and_inside_their_play_each_motor_for_itself() {
        let answer = |spring: Spring| {
            let two = two_masses([Some(spring); 2], [0.5, 1.0], [[0.0; 2]; 2], DT);
            let Answer { drag, gives } = two.answer(alone([1.0, 2.0]));
            (number(drag), gives.map(number))
        };
        // Two rotors of 1 kg on each axis: 2.5 kg move along x and 3 kg along y.
        let [along_x, along_y] = [1.0 / 2.5, 1.0 / 3.0];
        let (drag, gives) = answer(soft(1e12));
        let near = |own: [f64; 2], wanted: [f64; 2]| {
            assert!(
                own.iter().zip(wanted).all(|(own, wanted)| (own - wanted).abs() < 1e-5),
                "{own:?}"
            )
        };
        near(drag, [along_x + 2.0 * along_y, along_x - 2.0 * along_y]);
        near(gives[0], [along_x + along_y, along_x - along_y]);
        near(gives[1], [along_x - along_y, along_x + along_y]);
        let (drag, gives) = answer(Spring { backlash: 1e-3, ..soft(1e12) });
        near(drag, [0.0; 2]);
        near(gives[0], [1.0, 0.0]);
        near(gives[1], [0.0, 1.0]);
    }

    #[test]
    fn loops_that_give_way_demand_what_is_left_of_what_they_asked() {
        let gives = [[0.7, 0.1], [0.1, 0.7]];
        let answer = Answer { drag: alone([0.0; 2]), gives: gives.map(alone) };
        let (asked, gives_way) = ([3.0, -1.0], [0.5, 0.2]);
        let demand = number(answer.demand(alone(asked), alone(gives_way)));
        for m in 0..2 {
            let along: f64 = (0..2).map(|of| gives[m][of] * demand[of]).sum();
            assert!((demand[m] - (asked[m] - gives_way[m] * along)).abs() < 1e-12, "{demand:?}");
        }
    }

    #[test]
    fn inside_its_play_a_motor_moves_alone_and_then_takes_the_load_along() {
        let spring =
            Spring { stiffness: 5e5, damping_ratio: 1.0, load_fraction: 0.2, backlash: 2e-3 };
        let mut two = two_masses([Some(spring); 2], [0.5; 2], [[0.0; 2]; 2], DT);
        for step in 0..200 {
            // 1 N on each motor of 1 kg: it has crossed 1 mm after sqrt(2 mm / (1 m/s^2)), 45 ms.
            let moved = stepped(&two, [1.0; 2]);
            if step < 44 {
                assert_eq!(number(moved.load), [0.0; 2], "{step}");
            }
            two = two.after(&moved);
        }
        // All other forces are internal: 2 N for 0.2 s on 2.5 kg, and the load is behind by half
        // the backlash and a little more.
        let (motor, load) = (number(two.motor), number(two.load));
        let momentum = 0.5 * load[0] + motor[0] + motor[1];
        assert!((momentum - 0.4).abs() < 1e-9, "{momentum}");
        assert!((load[0] - 0.16).abs() < 1e-3, "{load:?}");
        let behind = -number(two.ahead)[0];
        assert!((0.99e-3..1.01e-3).contains(&behind), "{behind}");
    }

    #[test]
    fn at_the_end_of_a_play_half_of_the_speed_comes_back() {
        // Nearly as on the table: a rotor of 1 kg against the part of the load that each belt moves.
        let soft = [Some(BACKLASH_OF_A_MM); 2];
        let mut two = two_masses(soft, [0.5; 2], [[0.05; 2], [0.0; 2]], DT);
        for _ in 0..30 {
            let moved = stepped(&two, [0.0; 2]);
            two = two.after(&moved);
        }
        let (motor, load) = (number(rails(two.motor))[0], number(two.load)[0]);
        let apart = motor - load;
        assert!((-0.04..-0.02).contains(&apart), "{apart}");
        let momentum = 2.0 * motor + 0.5 * load;
        assert!((momentum - 2.0 * 0.05).abs() < 1e-9, "{momentum}");
    }

    #[test]
    fn rotors_are_never_more_than_all_that_moves() {
        let own = TieLanes::new(Scalar, |_| Tie { spring: None, damping: 0.0, motor_mass: 2.0 });
        let (ties, load) = parted(Scalar, &[own; 2], alone([2.0, 3.0]));
        let load = number(load);
        assert!((ties[0].motor_mass.get(0) - MOST_ROTOR).abs() < 1e-12);
        let rotors = 2.0 * MOST_ROTOR;
        assert!(
            (load[0] - (2.0 - rotors)).abs() < 1e-12 && (load[1] - (3.0 - rotors)).abs() < 1e-12
        );
    }

    #[test]
    fn beside_a_soft_belt_a_rigid_one_follows_at_once() {
        assert!(ties([None, None], [MASS; 2]).is_none());
        let soft = [None, Some(soft(1e5))];
        assert_eq!(ties(soft, [MASS, 3.0]).unwrap()[0].motor_mass, 1.0);
        let mut two = two_masses(soft, [0.5, 0.7], [[0.0; 2]; 2], DT);
        for _ in 0..100 {
            let moved = stepped(&two, [1.0; 2]);
            two = two.after(&moved);
            let off = number(two.motor)[0] - number(belts(two.load))[0];
            assert!(off.abs() < 1e-12 && number(belts(two.ahead))[0].abs() < 1e-12);
        }
        // All other forces are internal: the momentum of 2 N along x after 0.1 s.
        let (motor, load) = (number(two.motor), number(two.load));
        let momentum = 0.5 * load[0] + motor[0] + motor[1];
        assert!((momentum - 0.2).abs() < 1e-9, "{momentum}");
    }
}
