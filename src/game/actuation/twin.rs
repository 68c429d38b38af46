//! Drives, gantry and coupling of a twin as actuator: one plant for all carriages, with the state
//! of each in an array.
//!
//! Command, dead time, slew limit, velocity loop, forces and friction are the twin's [`Plant`];
//! backlash, geometry and magnet are its [`Linkage`]. A carriage stops at the ends of its travel.

use super::{Leading, Travel, turned};
use crate::{
    effects::Carriage,
    game::{body::StrikerState, settings::CONTROL_PERIOD},
    gantry::belts,
    twin::{Linkage, Places, Plant, PlantState, Twin},
};

/// One integration step of the plant within a control period.
#[derive(Debug, Clone, Copy)]
struct PlantStep {
    /// Length (s).
    dt: f64,
    /// Age of the command in force of each motor (control periods).
    ages: [usize; 2],
    /// True if a piece ends with this step.
    ends_piece: bool,
}

/// Drives of all environments.
#[derive(Debug, Clone)]
pub(in crate::game) struct TwinDrives {
    plant: Plant,
    linkage: Linkage,
    striker_mass: f64,
    travel: Travel,
    schedule: Vec<PlantStep>,
    /// Number of stored commands per carriage, the newest first.
    depth: usize,
    /// State by `[board][player]`, each in the player's own frame.
    states: Vec<PlantState>,
    /// Commands by `[board][player][depth]`, in belt coordinates (m/s).
    commands: Vec<[f64; 2]>,
    /// State of the linkage by `[board][player][memory]`.
    memories: Vec<f64>,
}

impl TwinDrives {
    pub(super) fn new(twin: &Twin, step: f64, travel: &Travel, count: usize) -> Self {
        let plant = Plant::new(twin);
        let linkage = Linkage::new(twin, Places::True);
        let schedule = schedule(plant.delays(), step, travel.pieces);
        let depth = schedule.iter().flat_map(|step| step.ages).max().unwrap_or(0) + 1;
        Self {
            states: vec![plant.start(); 2 * count],
            commands: vec![[0.0; 2]; 2 * count * depth],
            memories: vec![0.0; 2 * count * linkage.memory()],
            striker_mass: twin.striker_mass,
            travel: travel.clone(),
            schedule,
            depth,
            plant,
            linkage,
        }
    }

    pub(super) fn restart(&mut self, board: usize, strikers: &mut [StrikerState; 2]) {
        for (player, striker) in strikers.iter_mut().enumerate() {
            let index = 2 * board + player;
            let state = &mut self.states[index];
            self.plant.restart(state, turned(player, striker.carriage));
            let length = self.linkage.memory();
            let memory = &mut self.memories[index * length..(index + 1) * length];
            memory.fill(0.0);
            let carriage = carriage(state, CONTROL_PERIOD, self.striker_mass);
            striker.led = turned(player, self.linkage.striker(memory, carriage));
            memory.fill(0.0);
            self.commands[index * self.depth..(index + 1) * self.depth].fill([0.0; 2]);
        }
    }

    /// Call `visit` with every number of the state.
    pub(in crate::game) fn each_number(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        self.states.iter_mut().flat_map(PlantState::numbers).for_each(&mut *visit);
        self.commands.iter_mut().flatten().for_each(&mut *visit);
        self.memories.iter_mut().for_each(visit);
    }

    pub(super) fn lead(&mut self, leading: &mut Leading<'_>) {
        let Leading { first, commands, strikers, ways, travel } = leading;
        let ways = ways.chunks_exact_mut(travel.pieces + 1);
        let strikers = strikers.iter_mut().flatten().zip(commands.iter().flatten());
        for (index, ((striker, command), way)) in strikers.zip(ways).enumerate() {
            self.lead_one(2 * *first + index, striker, *command, way);
        }
    }

    /// Move one carriage through one control period; `index` counts players over all environments.
    fn lead_one(
        &mut self,
        index: usize,
        striker: &mut StrikerState,
        command: [f64; 2],
        way: &mut [[f64; 2]],
    ) {
        let travel = &self.travel;
        let player = index % 2;
        let sent = &mut self.commands[index * self.depth..(index + 1) * self.depth];
        sent.copy_within(..self.depth - 1, 1);
        sent[0] = belts(turned(player, command));
        let state = &mut self.states[index];
        let length = self.linkage.memory();
        let memory = &mut self.memories[index * length..(index + 1) * length];
        way[0] = striker.led;
        let mut piece = 0;
        for step in &self.schedule {
            let PlantStep { dt, ages: [a, b], ends_piece } = *step;
            self.plant.step(state, [sent[a][0], sent[b][1]], dt);
            stop_at_ends(state, player, travel);
            if self.linkage.is_dynamic() || ends_piece {
                let carriage = carriage(state, dt, self.striker_mass);
                let place = self.linkage.striker(memory, carriage);
                if ends_piece {
                    piece += 1;
                    way[piece] = travel.clamp(player, turned(player, place));
                }
            }
        }
        state.flush();
        for value in memory {
            if value.abs() < f64::from(f32::MIN_POSITIVE) {
                *value = 0.0;
            }
        }
        let [last, before] = [way[travel.pieces], way[travel.pieces - 1]];
        let h = travel.piece();
        striker.led_velocity = [(last[0] - before[0]) / h, (last[1] - before[1]) / h];
        striker.led = last;
        striker.carriage = turned(player, state.position);
    }
}

fn carriage(state: &PlantState, dt: f64, striker_mass: f64) -> Carriage {
    let PlantState { position, velocity, acceleration, .. } = *state;
    Carriage { dt, position, velocity, acceleration, striker_mass }
}

/// Set the velocity of a carriage at the end of its travel to zero.
fn stop_at_ends(state: &mut PlantState, player: usize, travel: &Travel) {
    let free = turned(player, state.position);
    let inside = travel.clamp(player, free);
    if inside == free {
        return;
    }
    for axis in 0..2 {
        if inside[axis] != free[axis] {
            state.velocity[axis] = 0.0;
        }
    }
    state.position = turned(player, inside);
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
    let mut start = 0.0;
    for (end, ends_piece) in ends {
        let count = ((end - start) / longest - SAME).ceil().max(1.0) as usize;
        let dt = (end - start) / count as f64;
        let age = |k: usize| periods[k] as usize + usize::from(start + SAME < rests[k]);
        for step in 1..=count {
            let ends_piece = ends_piece && step == count;
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
        assert_eq!(steps.iter().filter(|step| step.ends_piece).count(), 4);
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
