//! One step of several plants side by side.

use super::{
    LEAST_MASS, MotionPart, MotorParts, Plant, PlantState, RailParts,
    estimator::{Estimators, Half, Lag},
};
use crate::{
    effects::{CarriageLanes, CrossMotion, Motion, StrikerLanes, StrikerStateLanes, Wave, both},
    gantry,
    lanes::{Lanes, Mask, belts, rails, select},
    twin::{
        contact::{BristleLanes, Contact, Free},
        transmission::{self, Answer, Bends, Rubbing, TieLanes, TwoMasses},
    },
};
use pulp::Simd;

/// Most sweeps over the friction on motors and guides, and the change of friction below which it
/// has converged (N).
const MOST_SWEEPS: usize = 6;
const FOUND: f64 = 1e-6;

/// A value of both coordinates, of each plant.
type Both<S> = [Lanes<S>; 2];

/// Everything that changes while plants step except the memories of their effects; see
/// [`PlantState`].
#[derive(Debug, Clone, Copy)]
pub(in crate::twin) struct StateLanes<S: Simd> {
    /// Time since the start (s).
    pub(in crate::twin) time: Lanes<S>,
    position: Both<S>,
    velocity: Both<S>,
    acceleration: Both<S>,
    force: Both<S>,
    setpoint: Both<S>,
    integral: Both<S>,
    first_lag: Both<S>,
    second_lag: Both<S>,
    friction: Both<S>,
    rubbed: Both<S>,
    ahead: Both<S>,
    gaining: Both<S>,
    bends: Bends<S>,
    striker: StrikerStateLanes<S>,
}

impl<S: Simd> StateLanes<S> {
    /// All at rest at the origin.
    #[inline(always)]
    pub(in crate::twin) fn new(simd: S) -> Self {
        let nothing = [Lanes::splat(simd, 0.0); 2];
        Self {
            time: nothing[0],
            position: nothing,
            velocity: nothing,
            acceleration: nothing,
            force: nothing,
            setpoint: nothing,
            integral: nothing,
            first_lag: nothing,
            second_lag: nothing,
            friction: nothing,
            rubbed: nothing,
            ahead: nothing,
            gaining: nothing,
            bends: Bends { motors: nothing, rails: nothing },
            striker: StrikerStateLanes::at_rest(simd),
        }
    }

    /// Puts `state` into `lane`, without the memory.
    #[inline(always)]
    pub(in crate::twin) fn put(&mut self, lane: usize, state: &PlantState) {
        let put = |to: &mut Both<S>, from: &[f64; 2]| {
            to[0].set(lane, from[0]);
            to[1].set(lane, from[1]);
        };
        put(&mut self.position, &state.position);
        put(&mut self.velocity, &state.velocity);
        put(&mut self.acceleration, &state.acceleration);
        put(&mut self.force, &state.force);
        put(&mut self.setpoint, &state.setpoint);
        put(&mut self.integral, &state.integral);
        put(&mut self.first_lag, &state.first_lag);
        put(&mut self.second_lag, &state.second_lag);
        put(&mut self.friction, &state.friction);
        put(&mut self.rubbed, &state.rubbed);
        put(&mut self.ahead, &state.ahead);
        put(&mut self.gaining, &state.gaining);
        self.time.set(lane, state.time);
    }

    /// Gets the state in `lane`, without the memory.
    #[inline(always)]
    pub(in crate::twin) fn get(&self, lane: usize, state: &mut PlantState) {
        let get = |from: &Both<S>| [from[0].get(lane), from[1].get(lane)];
        state.position = get(&self.position);
        state.velocity = get(&self.velocity);
        state.acceleration = get(&self.acceleration);
        state.force = get(&self.force);
        state.setpoint = get(&self.setpoint);
        state.integral = get(&self.integral);
        state.first_lag = get(&self.first_lag);
        state.second_lag = get(&self.second_lag);
        state.friction = get(&self.friction);
        state.rubbed = get(&self.rubbed);
        state.ahead = get(&self.ahead);
        state.gaining = get(&self.gaining);
        state.time = self.time.get(lane);
    }

    /// Puts the bends of bristles and the striker of `plant` into `lane`, from its `memory`.
    #[inline(always)]
    pub(in crate::twin) fn put_remembered(&mut self, lane: usize, plant: &Plant, memory: &[f64]) {
        for index in 0..plant.motors.len() {
            self.bends.motors[index].set(lane, plant.motors[index].rubs.bend(memory));
            self.bends.rails[index].set(lane, plant.rails[index].rubs.bend(memory));
        }
        if let Some(striker) = &plant.striker {
            self.striker.put(lane, striker.memory_in(memory));
        }
    }

    /// Gets them in `lane` back into the `memory` of `plant`.
    #[inline(always)]
    pub(in crate::twin) fn get_remembered(&self, lane: usize, plant: &Plant, memory: &mut [f64]) {
        for index in 0..plant.motors.len() {
            let motor = (&plant.motors[index].rubs, &self.bends.motors[index]);
            let rail = (&plant.rails[index].rubs, &self.bends.rails[index]);
            for (rubs, bend) in [motor, rail] {
                if let Some((_, place)) = rubs.bristles {
                    memory[place] = bend.get(lane);
                }
            }
        }
        if let Some(striker) = &plant.striker {
            self.striker.get(lane, striker.memory(memory));
        }
    }

    /// Puts the carriage in `lane` to `position` (m).
    #[inline(always)]
    pub(in crate::twin) fn put_at(&mut self, lane: usize, position: [f64; 2]) {
        self.position[0].set(lane, position[0]);
        self.position[1].set(lane, position[1]);
    }

    /// Puts the carriage in `lane` to `position` (m) with `velocity` (m/s); all else stays, also the outputs of the
    /// filters in the estimators.
    #[inline(always)]
    pub(in crate::twin) fn stop_at(&mut self, lane: usize, position: [f64; 2], velocity: [f64; 2]) {
        self.put_at(lane, position);
        let before = [self.velocity[0].get(lane), self.velocity[1].get(lane)];
        let changed = gantry::belts([velocity[0] - before[0], velocity[1] - before[1]]);
        for (motor, lag) in self.first_lag.iter_mut().enumerate() {
            lag.set(lane, lag.get(lane) + changed[motor]);
        }
        self.velocity[0].set(lane, velocity[0]);
        self.velocity[1].set(lane, velocity[1]);
    }

    /// Lag of each filter of the estimators in `lane`: `[filter][motor]` (m/s of belt).
    #[inline(always)]
    pub(in crate::twin) fn lag(&self, lane: usize) -> [[f64; 2]; 2] {
        [&self.first_lag, &self.second_lag].map(|own| [own[0].get(lane), own[1].get(lane)])
    }

    /// Lag of the estimator of `motor`.
    #[inline(always)]
    fn lag_of(&self, motor: usize) -> Lag<S> {
        Lag { first: self.first_lag[motor], second: self.second_lag[motor] }
    }

    /// Position and velocity of the carriage by the motors, its acceleration, and the forces of the motors, in `lane`.
    #[inline(always)]
    pub(in crate::twin) fn motion(&self, lane: usize) -> [[f64; 2]; 4] {
        let all = [&self.position, &self.velocity, &self.acceleration, &self.force];
        all.map(|own| [own[0].get(lane), own[1].get(lane)])
    }

    /// Moves the carriages on by a step of [dt, 1/dt], at the end of which they have `velocity`.
    #[inline(always)]
    fn arrive(&mut self, velocity: Both<S>, [dt, per_dt]: [Lanes<S>; 2]) {
        let before = self.velocity;
        self.acceleration = both(
            #[inline(always)]
            |index| (velocity[index] - before[index]) * per_dt,
        );
        self.position = both(
            #[inline(always)]
            |index| self.position[index] + 0.5 * dt * (velocity[index] + before[index]),
        );
        self.velocity = velocity;
    }
}

/// Constant parameters of one motor, of each plant.
struct MotorLanes<S: Simd> {
    /// Fields of [`LoopGains`](crate::effects::LoopGains).
    proportional_per_s: Lanes<S>,
    integral_per_s2: Lanes<S>,
    feedback_delay_s: Lanes<S>,
    estimators: Estimators<S>,
    /// Viscous friction (N s/m), and the level of friction that is the same in every motion (N).
    damping: Lanes<S>,
    level: Lanes<S>,
    /// Plants with a slew limit, and the limit (m/s^2 of belt).
    is_slewed: Mask<S>,
    slew_limit: Lanes<S>,
}

/// Constant parameters of one axis, of each plant: the same in every motion.
struct RailLanes<S: Simd> {
    /// Mass (kg).
    mass: Lanes<S>,
    /// Viscous friction (N s/m).
    damping: Lanes<S>,
    /// Level of friction (N).
    level: Lanes<S>,
}

/// Kinds of functions that any of the plants has: the others need no call.
#[derive(Default)]
struct Called {
    encoders: bool,
    commands: bool,
    efforts: bool,
    motor_forces: bool,
    /// Largest number of waves on one motor.
    waves: usize,
    motor_levels: bool,
    windups: bool,
    masses: bool,
    rail_forces: bool,
    rail_levels: bool,
    /// Plants with a function of the motion of a belt, and of the motion along an axis.
    on_belts: LaneSet,
    on_rails: LaneSet,
}

/// Some of the lanes of a vector.
#[derive(Clone, Copy, Default)]
struct LaneSet(u32);

impl LaneSet {
    #[inline(always)]
    fn of(plants: &[&Plant], is_in: impl Fn(&Plant) -> bool) -> Self {
        let bits = plants.iter().enumerate().map(|(lane, plant)| u32::from(is_in(plant)) << lane);
        Self(bits.sum())
    }

    #[inline(always)]
    fn is_empty(self) -> bool {
        self.0 == 0
    }

    #[inline(always)]
    fn contains(self, lane: usize) -> bool {
        self.0 >> lane & 1 == 1
    }
}

impl Called {
    #[inline(always)]
    fn by(plants: &[&Plant]) -> Self {
        let any =
            |has: fn(&MotorParts) -> bool| plants.iter().any(|plant| plant.motors.iter().any(has));
        let any_rail =
            |has: fn(&RailParts) -> bool| plants.iter().any(|plant| plant.rails.iter().any(has));
        Self {
            encoders: any(|motor| !motor.encoders.is_empty()),
            commands: any(|motor| !motor.commands.is_empty()),
            efforts: any(|motor| !motor.efforts.is_empty()),
            motor_forces: any(|motor| !motor.forces.is_empty()),
            waves: plants
                .iter()
                .flat_map(|plant| &plant.motors)
                .map(|motor| motor.waves.len())
                .max()
                .unwrap_or(0),
            motor_levels: any(|motor| !motor.rubs.levels.is_empty()),
            windups: any(|motor| !motor.windups.is_empty()),
            masses: any_rail(|rail| !rail.masses.is_empty()),
            rail_forces: any_rail(|rail| !rail.forces.is_empty()),
            rail_levels: any_rail(|rail| !rail.rubs.levels.is_empty()),
            on_belts: LaneSet::of(plants, |plant| {
                plant.motors.iter().any(MotorParts::has_functions)
            }),
            on_rails: LaneSet::of(plants, |plant| plant.rails.iter().any(RailParts::has_functions)),
        }
    }
}

/// Data of plants outside of their lanes; one of each for every plant.
pub(in crate::twin) struct Aside<'m> {
    /// Memories of their effects.
    pub(in crate::twin) memories: &'m mut [Vec<f64>],
    /// Storage for the motions of axes and belts.
    pub(in crate::twin) rails: &'m mut [[Motion; 2]],
    pub(in crate::twin) belts: &'m mut [[Motion; 2]],
}

impl Aside<'_> {
    /// Give the effects of the plant in `lane` the distance of each measured motor ahead of the
    /// simulated one (m of belt).
    pub(in crate::twin) fn tell_measured(&mut self, lane: usize, ahead: [f64; 2]) {
        for (motion, ahead) in self.belts[lane].iter_mut().zip(ahead) {
            motion.measured_ahead = ahead;
        }
    }

    /// Give the effects of the plant in `lane` the start time of its run (s).
    pub(in crate::twin) fn tell_run_start(&mut self, lane: usize, time: f64) {
        for motion in self.rails[lane].iter_mut().chain(&mut self.belts[lane]) {
            motion.run_start_time = time;
        }
    }
}

/// Plants side by side, one in each lane.
pub(in crate::twin) struct PlantLanes<'p, S: Simd> {
    simd: S,
    /// As many as there are lanes, or fewer; the other lanes step too, without any effect, and
    /// their results are ignored.
    plants: &'p [&'p Plant],
    called: Called,
    motors: [MotorLanes<S>; 2],
    rails: [RailLanes<S>; 2],
    motor_bristles: [Option<BristleLanes<S>>; 2],
    rail_bristles: [Option<BristleLanes<S>>; 2],
    /// Ties between motors and load, with soft belts.
    ties: Option<[TieLanes<S>; 2]>,
    /// Strikers that hold their carriages back.
    strikers: Option<StrikerLanes<S>>,
    gain_mass: Lanes<S>,
}

impl<'p, S: Simd> PlantLanes<'p, S> {
    /// Lanes of the `plants`, at most one for each lane, all with soft belts or all without.
    #[inline(always)]
    pub(in crate::twin) fn new(simd: S, plants: &'p [&'p Plant]) -> Self {
        let plant = |lane: usize| plants[lane.min(plants.len() - 1)];
        let motor = |index: usize| {
            let number = |get: fn(&MotorParts) -> f64| {
                Lanes::from_fn(simd, |lane| plant(lane).motors.get(index).map_or(0.0, get))
            };
            let slew_limit = |lane: usize| plant(lane).motors.get(index)?.slew_limit;
            MotorLanes {
                proportional_per_s: number(|motor| motor.gains.proportional_per_s),
                integral_per_s2: number(|motor| motor.gains.integral_per_s2),
                feedback_delay_s: number(|motor| motor.gains.feedback_delay_s),
                estimators: Estimators::new(number(|motor| motor.gains.estimator_time_constant_s)),
                damping: number(|motor| motor.damping),
                level: number(|motor| motor.rubs.constant),
                is_slewed: Mask::from_fn(simd, |lane| slew_limit(lane).is_some()),
                slew_limit: Lanes::from_fn(simd, |lane| slew_limit(lane).unwrap_or_default()),
            }
        };
        let rail = |index: usize| {
            let number = |get: fn(&RailParts) -> f64| {
                Lanes::from_fn(simd, |lane| plant(lane).rails.get(index).map_or(0.0, get))
            };
            RailLanes {
                mass: number(|rail| rail.constant_mass),
                damping: number(|rail| rail.damping),
                level: number(|rail| rail.rubs.constant),
            }
        };
        let at_motor = |index: usize| {
            let of = |lane: usize| plant(lane).motors.get(index)?.rubs.bristles;
            BristleLanes::new(simd, |lane| of(lane).map(|(own, _)| own))
        };
        let on_rail = |index: usize| {
            let of = |lane: usize| plant(lane).rails.get(index)?.rubs.bristles;
            BristleLanes::new(simd, |lane| of(lane).map(|(own, _)| own))
        };
        let tie = |m: usize, first: transmission::Tie| {
            TieLanes::new(simd, |lane| plant(lane).ties.map_or(first, |ties| ties[m]))
        };
        Self {
            simd,
            plants,
            called: Called::by(plants),
            motors: [motor(0), motor(1)],
            rails: [rail(0), rail(1)],
            motor_bristles: [at_motor(0), at_motor(1)],
            rail_bristles: [on_rail(0), on_rail(1)],
            ties: plants[0].ties.map(|[a, b]| [tie(0, a), tie(1, b)]),
            strikers: StrikerLanes::new(simd, |lane| {
                let own = plants.get(lane)?;
                Some((own.striker.as_ref()?.call, own.striker_mass))
            }),
            gain_mass: Lanes::from_fn(simd, |lane| plant(lane).gain_mass),
        }
    }

    /// One step of `dt` seconds with each motor's `command` (m/s of belt).
    #[inline(always)]
    pub(in crate::twin) fn step(
        &self,
        state: &mut StateLanes<S>,
        aside: &mut Aside<'_>,
        command: Both<S>,
        dt: Lanes<S>,
    ) {
        self.step_gantry(state, aside, command, dt);
        state.time = state.time + dt;
    }

    #[inline(always)]
    fn step_gantry(
        &self,
        state: &mut StateLanes<S>,
        aside: &mut Aside<'_>,
        command: Both<S>,
        dt: Lanes<S>,
    ) {
        let step = GantryStep::new(self, state, aside, dt);
        let seen = self.reported(state);
        // Loads on the axes, with the motors' forces of the step before where one depends on them.
        let load = self.loads(&step, state.force, &mut state.striker, aside);
        let setpoint = self.setpoints(command, state.setpoint, aside.memories, dt);
        let resisted = [load[0] + state.friction[0], load[1] + state.friction[1]];
        let answer = step.answer(resisted).rubbed(state.rubbed);
        let loops = self.loops(state, setpoint, seen, (&answer, dt));
        let demand = answer.demand(loops.asked, loops.gives_way);
        let force = self.efforts(demand, aside);
        let forces = [self.driven(&step, force, aside), load];
        let rubs = self.rubs(force, aside);
        let slid = match &step.belting {
            Belting::Soft(two) => {
                let moved = two.step(forces, &rubs, &mut state.bends);
                let velocity = rails(moved.motor);
                state.gaining = [moved.load[0] - velocity[0], moved.load[1] - velocity[1]];
                state.ahead = moved.ahead;
                Slid { velocity, friction: moved.friction, rubbed: moved.rubbed }
            }
            Belting::Rigid(belts) => {
                let step = RigidStep { step: &step, belts };
                step.slide(forces, &rubs, state.friction, &mut state.bends)
            }
        };
        state.arrive(slid.velocity, [dt, step.per_dt]);
        let seen_after = self.reported(state);
        for index in 0..2 {
            let motor = &self.motors[index];
            let error = loops.middle[index] - 0.5 * (seen[index] + seen_after[index]);
            let changed = seen_after[index] - seen[index];
            let before = state.lag_of(index);
            let lag = motor.estimators.after(&loops.half[index], &before, changed);
            let estimate_changed = changed - (lag.whole() - before.whole());
            let travelled = error * dt
                + motor.estimators.travelled([&before, &lag], changed)
                + motor.feedback_delay_s * estimate_changed;
            let gained = self.gain_mass * motor.integral_per_s2 * travelled;
            let taken = self.taken(index, gained, demand[index]);
            state.integral[index] = state.integral[index] + taken;
            (state.first_lag[index], state.second_lag[index]) = (lag.first, lag.second);
        }
        (state.friction, state.rubbed) = (slid.friction, slid.rubbed);
        (state.force, state.setpoint) = (force, setpoint);
    }

    /// Mass on each axis (kg) in its motion; any but 0 in lanes without a plant.
    #[inline(always)]
    fn masses(&self, motions: &[[Motion; 2]]) -> Both<S> {
        let least = Lanes::splat(self.simd, LEAST_MASS);
        let mut masses = [self.rails[0].mass.max(least), self.rails[1].mass.max(least)];
        if self.called.masses {
            put_masses(self.plants, motions, &mut masses);
        }
        masses
    }

    /// Velocity of each motor (m/s of belt) as its encoder reports it.
    #[inline(always)]
    fn reported(&self, state: &StateLanes<S>) -> Both<S> {
        let mut reported = belts(state.velocity);
        if self.called.encoders {
            let position = belts(state.position);
            for (lane, plant) in self.plants.iter().enumerate() {
                for (index, motor) in plant.motors.iter().enumerate() {
                    let velocity = reported[index].get(lane);
                    let seen = motor.reported(position[index].get(lane), velocity);
                    reported[index].set(lane, seen);
                }
            }
        }
        reported
    }

    /// Setpoints of the loops (m/s of belt) after a step with this `command`.
    #[inline(always)]
    fn setpoints(
        &self,
        mut command: Both<S>,
        before: Both<S>,
        memories: &mut [Vec<f64>],
        dt: Lanes<S>,
    ) -> Both<S> {
        if self.called.commands {
            put_commands(self.plants, memories, &dt, &mut command);
        }
        both(
            #[inline(always)]
            |index| {
                let MotorLanes { is_slewed, slew_limit, .. } = self.motors[index];
                let most = slew_limit * dt;
                let change = (command[index] - before[index]).clamp(-most, most);
                is_slewed.select(before[index] + change, command[index])
            },
        )
    }

    /// Demands of the loops over a step, as if their own forces moved nothing until its middle.
    #[inline(always)]
    fn loops(
        &self,
        state: &StateLanes<S>,
        setpoint: Both<S>,
        seen: Both<S>,
        (answer, dt): (&Answer<S>, Lanes<S>),
    ) -> Loops<S> {
        let mass = self.gain_mass;
        let half = both(
            #[inline(always)]
            |index| self.motors[index].estimators.half(dt),
        );
        let mut loops = Loops { half, middle: setpoint, asked: setpoint, gives_way: setpoint };
        for index in 0..2 {
            let motor = &self.motors[index];
            let before = state.setpoint[index];
            // A ramp is half-way in the middle of the step, a jump has happened at its start.
            let half_way = 0.5 * (before + setpoint[index]);
            let middle = motor.is_slewed.select(half_way, setpoint[index]);
            let lag = state.lag_of(index);
            let expected = motor.estimators.expected(&half[index], &lag);
            // The loop acts on the estimate of the velocity a delay earlier.
            let ahead = expected.ahead - motor.feedback_delay_s * expected.rate_ahead;
            let output = expected.output - motor.feedback_delay_s * expected.rate;
            let now = before - (seen[index] - lag.whole());
            let error = middle - (seen[index] + output) - ahead * answer.drag[index];
            let halfway = state.integral[index] + 0.5 * dt * mass * motor.integral_per_s2 * now;
            loops.middle[index] = middle;
            loops.asked[index] = mass * motor.proportional_per_s * error + halfway;
            loops.gives_way[index] = ahead * mass * motor.proportional_per_s;
        }
        loops
    }

    /// Increment of the integral of loop `index` for the `gained` force at this `demand` (N of
    /// belt).
    #[inline(always)]
    fn taken(&self, index: usize, gained: Lanes<S>, demand: Lanes<S>) -> Lanes<S> {
        let mut taken = gained;
        if self.called.windups {
            for (lane, plant) in self.plants.iter().enumerate() {
                let own = plant.motors[index].taken(gained.get(lane), demand.get(lane));
                taken.set(lane, own);
            }
        }
        taken
    }

    /// The motors' `force` with all other forces on them except dry friction (N of belt).
    #[inline(always)]
    fn driven(&self, step: &GantryStep<S>, force: Both<S>, aside: &mut Aside<'_>) -> Both<S> {
        let velocity = step.belts.velocity;
        let mut driven = both(
            #[inline(always)]
            |m| force[m] - self.motors[m].damping * velocity[m],
        );
        for wave in 0..self.called.waves {
            driven = both(
                #[inline(always)]
                |m| driven[m] + self.wave(wave, m, step.belts.position[m], aside),
            );
        }
        if !self.called.motor_forces {
            return driven;
        }
        let motions = (&mut *aside.belts, force);
        let other = self.sums(aside.memories, motions, |plant, index| &plant.motors[index].forces);
        [driven[0] + other[0], driven[1] + other[1]]
    }

    /// Force (N of belt) of one `wave` on `motor` with its belt at `position` (m).
    #[inline(always)]
    fn wave(&self, wave: usize, motor: usize, position: Lanes<S>, aside: &Aside<'_>) -> Lanes<S> {
        let mut own = [Lanes::splat(self.simd, 0.0); 3];
        let mut phase = position;
        for (lane, plant) in self.plants.iter().enumerate() {
            let Some(Wave { sine, cosine, per_metre }) = plant.motors[motor].waves.get(wave) else {
                continue;
            };
            own[0].set(lane, *sine);
            own[1].set(lane, *cosine);
            own[2].set(lane, *per_metre);
            phase.set(lane, position.get(lane) + aside.belts[lane][motor].measured_ahead);
        }
        let (sine, cosine) = (own[2] * phase).sin_cos();
        own[0] * sine + own[1] * cosine
    }

    /// Friction on motors and guides under the motors' `force`.
    #[inline(always)]
    fn rubs(&self, force: Both<S>, aside: &mut Aside<'_>) -> Rubbing<S> {
        let nothing = Lanes::splat(self.simd, 0.0);
        let mut at_motors = [self.motors[0].level, self.motors[1].level];
        if self.called.motor_levels {
            let motions = (&mut *aside.belts, force);
            let others =
                self.sums(aside.memories, motions, |plant, index| &plant.motors[index].rubs.levels);
            at_motors = [at_motors[0] + others[0], at_motors[1] + others[1]];
        }
        let mut on_rails = [self.rails[0].level, self.rails[1].level];
        if self.called.rail_levels {
            let motions = (&mut *aside.rails, belts(force));
            let others =
                self.sums(aside.memories, motions, |plant, index| &plant.rails[index].rubs.levels);
            on_rails = [on_rails[0] + others[0], on_rails[1] + others[1]];
        }
        let contact = |level: Lanes<S>, bristles| Contact { level: level.max(nothing), bristles };
        Rubbing {
            motors: [
                contact(at_motors[0], self.motor_bristles[0]),
                contact(at_motors[1], self.motor_bristles[1]),
            ],
            rails: [
                contact(on_rails[0], self.rail_bristles[0]),
                contact(on_rails[1], self.rail_bristles[1]),
            ],
        }
    }

    /// Force on each axis, without motors and dry friction.
    #[inline(always)]
    fn loads(
        &self,
        step: &GantryStep<S>,
        force: Both<S>,
        striker: &mut StrikerStateLanes<S>,
        aside: &mut Aside<'_>,
    ) -> Both<S> {
        let velocity = step.rails.velocity;
        let nothing = Lanes::splat(self.simd, 0.0);
        let mut loads = both(
            #[inline(always)]
            |rail| nothing - self.rails[rail].damping * velocity[rail],
        );
        if self.called.rail_forces {
            let motions = (&mut *aside.rails, belts(force));
            let others =
                self.sums(aside.memories, motions, |plant, index| &plant.rails[index].forces);
            loads = [loads[0] + others[0], loads[1] + others[1]];
        }
        if let Some(strikers) = &self.strikers {
            let carriage = step.rails.carriage();
            strikers.step(striker, &carriage);
            let held = strikers.hold_back(striker, &carriage);
            loads = [loads[0] + held[0], loads[1] + held[1]];
        }
        loads
    }

    /// Force of each motor for the demand of its loop.
    #[inline(always)]
    fn efforts(&self, mut demand: Both<S>, aside: &mut Aside<'_>) -> Both<S> {
        if self.called.efforts {
            set_force(aside.belts, &demand);
            put_efforts(self.plants, aside.memories, aside.belts, &mut demand);
        }
        demand
    }

    /// Sum of the parts `of` each plant and coordinate, for its motion under `force`.
    #[inline(always)]
    fn sums(
        &self,
        memories: &mut [Vec<f64>],
        (motions, force): (&mut [[Motion; 2]], Both<S>),
        of: impl Fn(&Plant, usize) -> &[MotionPart],
    ) -> Both<S> {
        let mut sums = [Lanes::splat(self.simd, 0.0); 2];
        set_force(motions, &force);
        add_parts(self.plants, memories, motions, of, &mut sums);
        sums
    }
}

// Calls of effects, in functions of their own: around each call in the midst of vector code all
// vectors would be spilled.

#[inline(never)]
fn add_parts<S: Simd>(
    plants: &[&Plant],
    memories: &mut [Vec<f64>],
    motions: &[[Motion; 2]],
    of: impl Fn(&Plant, usize) -> &[MotionPart],
    sums: &mut Both<S>,
) {
    for (lane, ((plant, motions), memory)) in plants.iter().zip(motions).zip(memories).enumerate() {
        for (index, (sum, motion)) in sums.iter_mut().zip(motions).enumerate() {
            let parts = of(plant, index);
            if !parts.is_empty() {
                let all = parts.iter();
                let all = all.map(|part| part.call.at(part.p(), part.memory(memory), motion));
                sum.set(lane, all.sum());
            }
        }
    }
}

#[inline(never)]
fn put_masses<S: Simd>(plants: &[&Plant], motions: &[[Motion; 2]], masses: &mut Both<S>) {
    for (lane, (plant, motions)) in plants.iter().zip(motions).enumerate() {
        for ((mass, rail), motion) in masses.iter_mut().zip(&plant.rails).zip(motions) {
            mass.set(lane, rail.mass(motion));
        }
    }
}

#[inline(never)]
fn put_commands<S: Simd>(
    plants: &[&Plant],
    memories: &mut [Vec<f64>],
    dt: &Lanes<S>,
    command: &mut Both<S>,
) {
    for (lane, (plant, memory)) in plants.iter().zip(memories).enumerate() {
        for (command, motor) in command.iter_mut().zip(&plant.motors) {
            let taken_in = motor.taken_in(command.get(lane), memory, dt.get(lane));
            command.set(lane, taken_in);
        }
    }
}

#[inline(never)]
fn put_efforts<S: Simd>(
    plants: &[&Plant],
    memories: &mut [Vec<f64>],
    motions: &[[Motion; 2]],
    force: &mut Both<S>,
) {
    for (lane, ((plant, motions), memory)) in plants.iter().zip(motions).zip(memories).enumerate() {
        for ((force, motor), motion) in force.iter_mut().zip(&plant.motors).zip(motions) {
            let mut motion = *motion;
            for part in &motor.efforts {
                motion.force = part.call.at(part.p(), part.memory(memory), &motion);
            }
            force.set(lane, motion.force);
        }
    }
}

/// Demands of the velocity loops over a step.
struct Loops<S: Simd> {
    /// The first half of the step, of the estimators.
    half: [Half<S>; 2],
    /// Setpoint in its middle (m/s of belt).
    middle: Both<S>,
    /// Force (N of belt).
    asked: Both<S>,
    /// Decrease of that force with the acceleration of the belt (N s^2/m).
    gives_way: Both<S>,
}

/// The carriage after a step.
#[derive(Clone, Copy)]
struct Slid<S: Simd> {
    /// Velocity of the carriage along its axes (m/s).
    velocity: Both<S>,
    /// Friction over the step: on each guide (N), and at each motor (N of belt).
    friction: Both<S>,
    rubbed: Both<S>,
}

/// Motion of two coordinates, both axes or both belts, at the start of a step.
#[derive(Clone, Copy)]
struct Frame<S: Simd> {
    time: Lanes<S>,
    dt: Lanes<S>,
    position: Both<S>,
    velocity: Both<S>,
    acceleration: Both<S>,
}

impl<S: Simd> Frame<S> {
    /// Motions of both coordinates of each plant in `lanes`, without force and mass.
    #[inline(never)]
    fn put_into(&self, motions: &mut [[Motion; 2]], lanes: LaneSet) {
        for (lane, both) in motions.iter_mut().enumerate() {
            if !lanes.contains(lane) {
                continue;
            }
            let (time, dt) = (self.time.get(lane), self.dt.get(lane));
            let own = [0, 1].map(|index: usize| CrossMotion {
                position: self.position[index].get(lane),
                velocity: self.velocity[index].get(lane),
                acceleration: self.acceleration[index].get(lane),
                force: 0.0,
            });
            for (index, motion) in both.iter_mut().enumerate() {
                let CrossMotion { position, velocity, acceleration, force } = own[index];
                let other = own[1 - index];
                *motion = Motion {
                    index,
                    time,
                    run_start_time: motion.run_start_time,
                    measured_ahead: motion.measured_ahead,
                    position_origin: 0.0,
                    turns_per_metre: motion.turns_per_metre,
                    dt,
                    position,
                    velocity,
                    acceleration,
                    force,
                    mass: 0.0,
                    other,
                };
            }
        }
    }

    /// Motion of the carriages.
    #[inline(always)]
    fn carriage(&self) -> CarriageLanes<S> {
        let Self { dt, velocity, acceleration, .. } = *self;
        CarriageLanes { dt, velocity, acceleration }
    }
}

/// State of gantries at the start of a step.
struct GantryStep<S: Simd> {
    simd: S,
    rails: Frame<S>,
    belts: Frame<S>,
    /// Reciprocal of the length of the step (1/s).
    per_dt: Lanes<S>,
    belting: Belting<S>,
}

/// What the belts connect.
enum Belting<S: Simd> {
    Rigid(RigidBelts<S>),
    Soft(TwoMasses<S>),
}

impl<S: Simd> Belting<S> {
    /// Mass that the force of each belt moves (kg).
    #[inline(always)]
    fn belt_mass(&self) -> Both<S> {
        match self {
            Self::Rigid(rigid) => [rigid.belt_mass; 2],
            Self::Soft(two) => soft_belt_mass(&two.ties, two.load_mass),
        }
    }
}

/// Carriage that follows its motors exactly.
struct RigidBelts<S: Simd> {
    /// Mass on each axis (kg), and its reciprocal (1/kg).
    mass: Both<S>,
    per_mass: Both<S>,
    /// Mass that the force of each belt moves (kg).
    belt_mass: Lanes<S>,
}

impl<S: Simd> GantryStep<S> {
    /// Step of `dt` seconds; the motions of axes and belts are put `aside`.
    #[inline(always)]
    fn new(
        lanes: &PlantLanes<'_, S>,
        state: &StateLanes<S>,
        aside: &mut Aside<'_>,
        dt: Lanes<S>,
    ) -> Self {
        let StateLanes { time, position, velocity, acceleration, ahead, gaining, .. } = *state;
        let simd = lanes.simd;
        let mut rails = Frame { time, dt, position, velocity, acceleration };
        let belts = Frame {
            time,
            dt,
            position: belts(position),
            velocity: belts(velocity),
            acceleration: belts(acceleration),
        };
        let Called { on_belts, on_rails, .. } = lanes.called;
        if !on_rails.is_empty() {
            rails.put_into(aside.rails, on_rails);
        }
        let mass = lanes.masses(aside.rails);
        let per_dt = 1.0 / dt;
        let (belting, mass) = if let Some(ties) = &lanes.ties {
            rails.position = [position[0] + ahead[0], position[1] + ahead[1]];
            rails.velocity = [velocity[0] + gaining[0], velocity[1] + gaining[1]];
            if !on_rails.is_empty() {
                rails.put_into(aside.rails, on_rails);
            }
            let (ties, load_mass) = transmission::parted(simd, ties, mass);
            let (motor, load) = (belts.velocity, rails.velocity);
            let two = TwoMasses { simd, ties, load_mass, ahead, motor, load, dt, per_dt };
            (Belting::Soft(two), load_mass)
        } else {
            let per_mass = [1.0 / mass[0], 1.0 / mass[1]];
            let belt_mass = 1.0 / (per_mass[0] + per_mass[1]);
            (Belting::Rigid(RigidBelts { mass, per_mass, belt_mass }), mass)
        };
        if !on_rails.is_empty() {
            set_mass(aside.rails, &mass);
        }
        if !on_belts.is_empty() {
            belts.put_into(aside.belts, on_belts);
            set_mass(aside.belts, &belting.belt_mass());
        }
        Self { simd, rails, belts, per_dt, belting }
    }

    /// Response of the motors to forces over the step, with `load` on the axes (N).
    #[inline(always)]
    fn answer(&self, load: Both<S>) -> Answer<S> {
        match &self.belting {
            Belting::Soft(two) => two.answer(load),
            Belting::Rigid(RigidBelts { per_mass: [along_x, along_y], .. }) => {
                let (own, other) = (*along_x + *along_y, *along_x - *along_y);
                let drag = belts([load[0] * *along_x, load[1] * *along_y]);
                Answer { drag, gives: [[own, other], [other, own]] }
            }
        }
    }
}

/// Step of carriages on rigid belts.
struct RigidStep<'s, S: Simd> {
    step: &'s GantryStep<S>,
    belts: &'s RigidBelts<S>,
}

impl<S: Simd> RigidStep<'_, S> {
    /// Velocity along the axes after the step under `pull` of the belts and `load` on the axes,
    /// without friction.
    #[inline(always)]
    fn free(&self, pull: Both<S>, load: Both<S>) -> Both<S> {
        let Frame { velocity, dt, .. } = self.step.rails;
        let per_mass = self.belts.per_mass;
        let along = belts(pull);
        both(
            #[inline(always)]
            |rail| velocity[rail] + dt * (along[rail] + load[rail]) * per_mass[rail],
        )
    }

    /// Step of rigid belts under `forces` of the motors (N of belt) and on the axes (N), with the
    /// friction of `rubs`. A coordinate may be held while another one slides: the frictions are
    /// solved in turn (projected Gauss-Seidel), from the `friction` of the guides a step ago.
    #[inline(always)]
    fn slide(
        &self,
        [driven, load]: [Both<S>; 2],
        rubs: &Rubbing<S>,
        friction: Both<S>,
        bends: &mut Bends<S>,
    ) -> Slid<S> {
        let nothing = Lanes::splat(self.step.simd, 0.0);
        let before = *bends;
        let mut slid = Slid { velocity: self.step.rails.velocity, friction, rubbed: [nothing; 2] };
        let mut is_sought = nothing.equals(nothing);
        for _ in 0..MOST_SWEEPS {
            let mut bent = before;
            let next = self.sweep([driven, load], rubs, &slid, &mut bent);
            let is_near = both(
                #[inline(always)]
                |rail| {
                    let change = (next.friction[rail] - slid.friction[rail]).abs();
                    change.less_than(Lanes::splat(self.step.simd, FOUND))
                },
            );
            let is_free = next.rubbed[0].equals(nothing) & next.rubbed[1].equals(nothing);
            slid = Slid {
                velocity: select(is_sought, next.velocity, slid.velocity),
                friction: select(is_sought, next.friction, slid.friction),
                rubbed: select(is_sought, next.rubbed, slid.rubbed),
            };
            *bends = bent.or(is_sought, *bends);
            is_sought = is_sought & (is_near[0] & is_near[1]).or(is_free).not();
            if !is_sought.any() {
                break;
            }
        }
        slid
    }

    /// One sweep over the frictions, from those of `last`.
    #[inline(always)]
    fn sweep(
        &self,
        [driven, load]: [Both<S>; 2],
        rubs: &Rubbing<S>,
        last: &Slid<S>,
        bends: &mut Bends<S>,
    ) -> Slid<S> {
        let GantryStep { simd, ref rails, per_dt, .. } = *self.step;
        let RigidBelts { mass, per_mass, belt_mass } = self.belts;
        let dt = rails.dt;
        let nothing = Lanes::splat(simd, 0.0);
        let mut rubbed = last.rubbed;
        for m in 0..2 {
            let contact = &rubs.motors[m];
            let acts = nothing.less_than(contact.level);
            if !acts.any() {
                continue;
            }
            let other = 1 - m;
            let mut pull = driven;
            pull[other] = driven[other] + rubbed[other];
            let held = [load[0] + last.friction[0], load[1] + last.friction[1]];
            let velocity = [self.step.belts.velocity[m], belts(self.free(pull, held))[m]];
            let motion = Free { inertia: *belt_mass * per_dt, velocity, dt, per_dt };
            let force = contact.force(simd, &mut bends.motors[m], motion);
            rubbed[m] = acts.select(force, rubbed[m]);
        }
        let pull = [driven[0] + rubbed[0], driven[1] + rubbed[1]];
        let free = self.free(pull, load);
        let friction = both(
            #[inline(always)]
            |rail| {
                let velocity = [rails.velocity[rail], free[rail]];
                let motion = Free { inertia: mass[rail] * per_dt, velocity, dt, per_dt };
                rubs.rails[rail].force(simd, &mut bends.rails[rail], motion)
            },
        );
        let velocity = both(
            #[inline(always)]
            |rail| free[rail] + dt * friction[rail] * per_mass[rail],
        );
        Slid { velocity, friction, rubbed }
    }
}

/// Set the `force` along both coordinates in all `motions`.
#[inline(always)]
fn set_force<S: Simd>(motions: &mut [[Motion; 2]], force: &Both<S>) {
    for (lane, [one, other]) in motions.iter_mut().enumerate() {
        let force = [force[0].get(lane), force[1].get(lane)];
        (one.force, one.other.force) = (force[0], force[1]);
        (other.force, other.other.force) = (force[1], force[0]);
    }
}

/// Set the `mass` of each coordinate in all `motions`.
#[inline(always)]
fn set_mass<S: Simd>(motions: &mut [[Motion; 2]], mass: &Both<S>) {
    for (lane, [one, other]) in motions.iter_mut().enumerate() {
        (one.mass, other.mass) = (mass[0].get(lane), mass[1].get(lane));
    }
}

/// Mass that the force of each belt moves if some belts are soft, with this `load` on the axes
/// (kg).
#[inline(always)]
fn soft_belt_mass<S: Simd>([a, b]: &[TieLanes<S>; 2], load: Both<S>) -> Both<S> {
    if (a.is_soft & b.is_soft).all() {
        return [a.motor_mass, b.motor_mass];
    }
    let rigid = rigid_belt_mass(load);
    [
        a.is_soft.select(a.motor_mass, a.motor_mass + rigid),
        b.is_soft.select(b.motor_mass, b.motor_mass + rigid),
    ]
}

/// Mass that the force of one belt moves with this `mass` on the axes (kg).
#[inline(always)]
fn rigid_belt_mass<S: Simd>(mass: Both<S>) -> Lanes<S> {
    1.0 / (1.0 / mass[0] + 1.0 / mass[1])
}
