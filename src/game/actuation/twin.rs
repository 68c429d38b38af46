//! Drives, gantry and coupling of a twin as actuator: one plant for all carriages, with the state
//! of each in an array.
//!
//! Command, dead time, slew limit, velocity loop, forces and friction are the twin's [`Plant`], which
//! moves several carriages side by side ([`Fleet`]); backlash, geometry and magnet are its [`Linkage`].
//! A carriage stops at the ends of its travel.

use super::{Leading, Travel, turned};
use crate::{
    effects::{Carriage, CarriageLanes, StrikerLanes, StrikerStateLanes, both},
    game::{body::StrikerState, settings::CONTROL_PERIOD},
    gantry::belts,
    lanes::Lanes,
    twin::{Course, Fleet, Linkage, MOST_LANES, Moved, Places, Plant, TakenStriker, Twin},
};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// One integration step of the plant within a control period.
#[derive(Debug, Clone, Copy)]
struct PlantStep {
    /// Length (s).
    dt: f64,
    /// Age of the command in force of each motor (control periods).
    ages: [usize; 2],
    /// Number of the piece that ends with this step, from 1.
    ends_piece: Option<usize>,
}

/// Drives of all environments.
#[derive(Debug, Clone)]
pub(in crate::game) struct TwinDrives {
    /// Carriages by `[board][player]`, each in the player's own frame.
    fleet: Fleet,
    /// All between carriage and striker except the `striker` on its spring.
    linkage: Linkage,
    striker: Option<TakenStriker>,
    striker_mass: f64,
    travel: Travel,
    schedule: Vec<PlantStep>,
    /// Number of stored commands per carriage, the newest first.
    depth: usize,
    /// Commands by `[board][player][depth]`, in belt coordinates (m/s).
    commands: Vec<[f64; 2]>,
    /// State of the linkage by `[board][player][memory]`.
    memories: Vec<f64>,
    /// Magnets of one group of carriages by `[step][carriage]`, where there is a striker on a spring.
    magnets: Vec<Carriage>,
}

impl TwinDrives {
    pub(super) fn new(twin: &Twin, step: f64, travel: &Travel, count: usize) -> Self {
        let plant = Plant::new(twin);
        let mut linkage = Linkage::new(twin, Places::True);
        let memory = linkage.memory();
        let striker = linkage.take_striker();
        let schedule = schedule(plant.delays(), step, travel.pieces);
        let followed = if striker.is_some() { schedule.len() * MOST_LANES } else { 0 };
        let depth = schedule.iter().flat_map(|step| step.ages).max().unwrap_or(0) + 1;
        Self {
            commands: vec![[0.0; 2]; 2 * count * depth],
            memories: vec![0.0; 2 * count * memory],
            magnets: vec![Carriage::default(); followed],
            striker,
            striker_mass: twin.striker_mass,
            travel: travel.clone(),
            schedule,
            depth,
            fleet: Fleet::new(plant, 2 * count),
            linkage,
        }
    }

    pub(super) fn restart(&mut self, board: usize, strikers: &mut [StrikerState; 2]) {
        for (player, striker) in strikers.iter_mut().enumerate() {
            let index = 2 * board + player;
            let position = turned(player, striker.carriage);
            self.fleet.restart(index, position);
            let length = self.linkage.memory();
            let memory = &mut self.memories[index * length..(index + 1) * length];
            memory.fill(0.0);
            let carriage = Carriage {
                dt: CONTROL_PERIOD,
                position,
                velocity: [0.0; 2],
                acceleration: [0.0; 2],
                striker_mass: self.striker_mass,
            };
            striker.led = turned(player, self.linkage.striker(memory, carriage));
            memory.fill(0.0);
            self.commands[index * self.depth..(index + 1) * self.depth].fill([0.0; 2]);
        }
    }

    /// Call `visit` with every number of the state.
    pub(in crate::game) fn each_number(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        self.fleet.numbers().for_each(&mut *visit);
        self.commands.iter_mut().flatten().for_each(&mut *visit);
        self.memories.iter_mut().for_each(visit);
    }

    pub(super) fn lead(&mut self, leading: &mut Leading<'_>) {
        let Leading { first, commands, strikers, ways, .. } = leading;
        let carriages = 2 * *first..2 * *first + 2 * commands.len();
        let stride = self.travel.pieces + 1;
        let orders = commands.iter().flatten();
        let starts = strikers.iter().flatten().zip(ways.chunks_exact_mut(stride));
        for ((index, command), (striker, way)) in carriages.clone().zip(orders).zip(starts) {
            let sent = &mut self.commands[index * self.depth..(index + 1) * self.depth];
            sent.copy_within(..self.depth - 1, 1);
            sent[0] = belts(turned(index % 2, *command));
            way[0] = striker.led;
        }
        let lengths = self.schedule.iter().map(|step| step.dt);
        for first in carriages.clone().step_by(MOST_LANES) {
            let group = first..(first + MOST_LANES).min(carriages.end);
            let mut period = LedPeriod {
                schedule: &self.schedule,
                linkage: &self.linkage,
                travel: &self.travel,
                striker_mass: self.striker_mass,
                depth: self.depth,
                commands: &self.commands,
                memories: &mut self.memories,
                group: group.clone(),
                magnets: &mut self.magnets,
                ways: &mut ways[(first - carriages.start) * stride..],
            };
            self.fleet.march(group, lengths.clone(), &mut period);
            if let Some(striker) = self.striker {
                Arch::new().dispatch(StrikerMarch { striker, period });
            }
        }
        let length = self.linkage.memory();
        for value in &mut self.memories[carriages.start * length..carriages.end * length] {
            if value.abs() < f64::from(f32::MIN_POSITIVE) {
                *value = 0.0;
            }
        }
        let h = self.travel.piece();
        let ends = strikers.iter_mut().flatten().zip(ways.chunks_exact(stride));
        for (index, (striker, way)) in carriages.zip(ends) {
            let [last, before] = [way[self.travel.pieces], way[self.travel.pieces - 1]];
            striker.led_velocity = [(last[0] - before[0]) / h, (last[1] - before[1]) / h];
            striker.led = last;
            striker.carriage = turned(index % 2, self.fleet.state(index).position);
        }
    }
}

/// One control period of a group of carriages: their commands, and the paths of their magnets.
struct LedPeriod<'a> {
    schedule: &'a [PlantStep],
    linkage: &'a Linkage,
    travel: &'a Travel,
    striker_mass: f64,
    depth: usize,
    commands: &'a [[f64; 2]],
    memories: &'a mut [f64],
    /// Carriages of the group, at most [`MOST_LANES`]; `ways` are theirs.
    group: Range<usize>,
    magnets: &'a mut [Carriage],
    ways: &'a mut [[f64; 2]],
}

impl LedPeriod<'_> {
    /// State of the linkage of `carriage`.
    fn memory(&mut self, carriage: usize) -> &mut [f64] {
        let length = self.linkage.memory();
        &mut self.memories[carriage * length..(carriage + 1) * length]
    }

    /// Enter the striker of `carriage` at the end of a piece.
    fn arrive(&mut self, carriage: usize, piece: usize, led: [f64; 2]) {
        let (place, stride) = (carriage - self.group.start, self.travel.pieces + 1);
        let player = carriage % 2;
        self.ways[place * stride + piece] = self.travel.clamp(player, turned(player, led));
    }
}

impl Course for LedPeriod<'_> {
    fn command(&self, carriage: usize, step: usize) -> [f64; 2] {
        let sent = &self.commands[carriage * self.depth..(carriage + 1) * self.depth];
        let [a, b] = self.schedule[step].ages;
        [sent[a][0], sent[b][1]]
    }

    fn follow(&mut self, carriage: usize, step: usize, moved: &mut Moved) {
        let PlantStep { dt, ends_piece, .. } = self.schedule[step];
        let player = carriage % 2;
        stop_at_ends(moved, player, self.travel);
        if self.magnets.is_empty() && !self.linkage.is_dynamic() && ends_piece.is_none() {
            return;
        }
        let linkage = self.linkage;
        let Moved { position, velocity, acceleration } = *moved;
        let striker_mass = self.striker_mass;
        let memory = self.memory(carriage);
        let mut magnet =
            linkage.magnet(memory, Carriage { dt, position, velocity, acceleration, striker_mass });
        let away = linkage.away(memory, &magnet);
        magnet.position = both(|axis| magnet.position[axis] + away[axis]);
        if !self.magnets.is_empty() {
            self.magnets[step * MOST_LANES + carriage - self.group.start] = magnet;
        } else if let Some(piece) = ends_piece {
            self.arrive(carriage, piece, magnet.position);
        }
    }
}

/// The strikers on their springs, behind the magnets of a period.
struct StrikerMarch<'a> {
    striker: TakenStriker,
    period: LedPeriod<'a>,
}

impl WithSimd for StrikerMarch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { striker, mut period } = self;
        let Some(strikers) = StrikerLanes::new(simd, |_| Some(striker.on_spring())) else { return };
        let nothing = [Lanes::splat(simd, 0.0); 2];
        for first in period.group.clone().step_by(S::F64_LANES) {
            let count = S::F64_LANES.min(period.group.end - first);
            let mut state = StrikerStateLanes::at_rest(simd);
            for lane in 0..count {
                state.put(lane, striker.states(period.memory(first + lane)));
            }
            for (step, PlantStep { dt, ends_piece, .. }) in period.schedule.iter().enumerate() {
                let row = step * MOST_LANES + first - period.group.start;
                let dt = Lanes::splat(simd, *dt);
                let mut motion = CarriageLanes { dt, velocity: nothing, acceleration: nothing };
                for lane in 0..count {
                    motion.put(lane, &period.magnets[row + lane]);
                }
                strikers.step(&mut state, &motion);
                if let Some(piece) = ends_piece {
                    for lane in 0..count {
                        let [x, y] = period.magnets[row + lane].position;
                        let [by_x, by_y] = state.away.map(|away| away.get(lane));
                        period.arrive(first + lane, *piece, [x + by_x, y + by_y]);
                    }
                }
            }
            for lane in 0..count {
                state.get(lane, striker.states(period.memory(first + lane)));
            }
        }
    }
}

/// Set the velocity of a carriage at the end of its travel to zero.
fn stop_at_ends(moved: &mut Moved, player: usize, travel: &Travel) {
    let free = turned(player, moved.position);
    let inside = travel.clamp(player, free);
    if inside == free {
        return;
    }
    for axis in 0..2 {
        if inside[axis] != free[axis] {
            moved.velocity[axis] = 0.0;
        }
    }
    moved.position = turned(player, inside);
}

/// Integration steps of one period. Steps end at the ends of pieces and at the instants at which a
/// command takes effect on a motor, `delays` (s) after it was given.
fn schedule(delays: [f64; 2], longest: f64, pieces: usize) -> Vec<PlantStep> {
    const SAME: f64 = 1e-9;
    let delays = delays.map(|delay| delay.max(0.0));
    let periods = delays.map(|delay| ((delay + SAME) / CONTROL_PERIOD).floor());
    let rests = [0, 1].map(|k| (delays[k] - periods[k] * CONTROL_PERIOD).max(0.0));
    let mut ends: Vec<(f64, bool)> =
        (1..=pieces).map(|piece| (CONTROL_PERIOD * piece as f64 / pieces as f64, true)).collect();
    for rest in rests {
        if SAME < rest && ends.iter().all(|(end, _)| SAME < (end - rest).abs()) {
            ends.push((rest, false));
        }
    }
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut steps = Vec::new();
    let (mut start, mut piece) = (0.0, 0);
    for (end, ends_piece) in ends {
        piece += usize::from(ends_piece);
        let count = ((end - start) / longest - SAME).ceil().max(1.0) as usize;
        let dt = (end - start) / count as f64;
        let age = |k: usize| periods[k] as usize + usize::from(start + SAME < rests[k]);
        for step in 1..=count {
            let ends_piece = (ends_piece && step == count).then_some(piece);
            steps.push(PlantStep { dt, ages: [age(0), age(1)], ends_piece });
        }
        start = end;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schedule_fills_the_period_and_switches_commands_when_they_arrive() {
        let steps = schedule([0.005, 0.0275], 2e-3, 4);
        let total: f64 = steps.iter().map(|step| step.dt).sum();
        assert!((total - CONTROL_PERIOD).abs() < 1e-12);
        assert_eq!(
            steps.iter().filter_map(|step| step.ends_piece).collect::<Vec<_>>(),
            [1, 2, 3, 4]
        );
        assert!(steps.iter().all(|step| step.dt <= 2e-3 + 1e-12));
        let mut time = 0.0;
        for step in steps {
            let middle = time + step.dt / 2.0;
            let expected = [usize::from(middle < 0.005), 1 + usize::from(middle < 0.0075)];
            assert_eq!(step.ages, expected, "at {middle} s");
            time += step.dt;
        }
    }

    #[test]
    fn without_delay_the_newest_command_is_in_force() {
        assert!(schedule([0.0; 2], 5e-3, 1).iter().all(|step| step.ages == [0, 0]));
        assert!(schedule([0.02; 2], 5e-3, 1).iter().all(|step| step.ages == [1, 1]));
    }
}
