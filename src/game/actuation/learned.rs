//! A fitted network as actuator: histories of all carriages as arrays, one matrix product per layer
//! and chunk of environments.
//!
//! `v[k+1] = f(u[k], ...; v[k], ...)` as in [`crate::actuator`]. At a restart all commands and
//! velocities of the history are zero (upstream: commands 0, the current velocity repeated).

use super::{Leading, turned};
use crate::{
    actuator::{ActuatorNetwork, Coverage, CoverageMask, Layout},
    game::{
        games::{ActuatorQueries, CHUNK},
        settings::LimiterPlace,
    },
    gantry::PerPlayer,
    nn::{Stack, Tape},
};

/// Speed below which a velocity is set to zero (m/s): far below the resolution of the network, and
/// far above denormal numbers, which would slow it down.
const STANDSTILL: f64 = 1e-9;

/// The network and the histories of all carriages.
#[derive(Debug, Clone)]
pub(in crate::game) struct Learned {
    layout: Layout,
    stack: Stack,
    /// Inputs of the network for each chunk of environments, `[board][player][inputs]`.
    histories: Vec<Vec<f32>>,
    tape: Tape,
    /// Coverage of the training data, if extrapolating queries are counted.
    covered: Option<CoverageMask>,
    queries: ActuatorQueries,
}

impl Learned {
    pub(super) fn new(model: &ActuatorNetwork, coverage: Option<&Coverage>, count: usize) -> Self {
        let inputs = model.layout.inputs();
        let chunk = |first: usize| vec![0.0; 2 * CHUNK.min(count - first) * inputs];
        let mut learned = Self {
            layout: model.layout,
            stack: Stack::new(&model.network),
            histories: (0..count).step_by(CHUNK).map(chunk).collect(),
            tape: Tape::default(),
            covered: coverage.map(CoverageMask::new),
            queries: ActuatorQueries::default(),
        };
        // The largest chunk sizes the tape, so that no step allocates.
        learned.tape.x = vec![0.0; 2 * CHUNK.min(count) * inputs];
        learned.stack.forward(&mut learned.tape);
        learned
    }

    pub(super) fn restart(&mut self, board: usize) {
        let length = 2 * self.layout.inputs();
        let row = (board % CHUNK) * length;
        self.histories[board / CHUNK][row..row + length].fill(0.0);
    }

    pub(super) fn queries(&self) -> ActuatorQueries {
        self.queries
    }

    /// Call `visit` with every number of the state.
    pub(in crate::game) fn each_number(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        for value in self.histories.iter_mut().flatten() {
            let mut number = f64::from(*value);
            visit(&mut number);
            *value = number as f32;
        }
    }

    pub(super) fn lead(&mut self, leading: &mut Leading<'_>) {
        let Leading { first, commands, strikers, ways, travel } = leading;
        let chunk = *first / CHUNK;
        let layout = self.layout;
        std::mem::swap(&mut self.tape.x, &mut self.histories[chunk]);
        let pairs = strikers.iter().zip(commands.iter());
        let rows = self.tape.x.chunks_exact_mut(2 * layout.inputs());
        for ((strikers, commands), rows) in pairs.zip(rows) {
            for (player, row) in rows.chunks_exact_mut(layout.inputs()).enumerate() {
                let single = |v: [f64; 2]| turned(player, v).map(|v| v as f32);
                let velocity = single(strikers[player].led_velocity);
                let command = single(commands[player]);
                layout.advance(row, command, velocity);
                if let Some(covered) = &self.covered {
                    self.queries.total += 1;
                    self.queries.extrapolated += u64::from(!covered.contains(command, velocity));
                }
            }
        }
        self.stack.forward(&mut self.tape);
        let stride = travel.pieces + 1;
        let PerPlayer { left, right } = travel.limits.field;
        let answers = self.tape.y.chunks_exact(2).zip(ways.chunks_exact_mut(stride));
        for (index, (answer, way)) in answers.enumerate() {
            let (board, player) = (index / 2, index % 2);
            let striker = &mut strikers[board][player];
            let awake = |v: f32| if f64::from(v).abs() < STANDSTILL { 0.0 } else { f64::from(v) };
            let mut next = turned(player, [awake(answer[0]), awake(answer[1])]);
            if travel.limits.limiter == LimiterPlace::Motion {
                next = travel.limits.before_walls([&left, &right][player], striker.carriage, next);
            }
            travel.roll(player, striker, [striker.led_velocity, next], way);
        }
        std::mem::swap(&mut self.tape.x, &mut self.histories[chunk]);
    }
}
