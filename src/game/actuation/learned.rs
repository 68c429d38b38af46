//! A fitted network as actuator: the histories of all carriages in arrays, one matrix product per layer
//! and chunk of boards.
//!
//! `v[k+1] = f(u[k], ...; v[k], ...)` as in the `actuator` room; at a restart all commands and velocities
//! of the history are zero (upstream: commands 0, the current velocity repeated).

use super::{Leading, turned};
use crate::{
    actuator::{ActuatorNetwork, Layout},
    game::{games::CHUNK, settings::LimiterPlace},
    gantry::PerPlayer,
    nn::{Stack, Tape},
};

/// Velocities below this count as none (m/s): far below what the network can tell, and far above the
/// denormal numbers that would slow it.
const STANDSTILL: f64 = 1e-9;

/// The network and the histories of all carriages.
#[derive(Debug, Clone)]
pub(in crate::game) struct Learned {
    layout: Layout,
    stack: Stack,
    /// For each chunk of boards the inputs of the network, `[board][player][inputs]`.
    histories: Vec<Vec<f32>>,
    tape: Tape,
}

impl Learned {
    pub(super) fn new(model: &ActuatorNetwork, count: usize) -> Self {
        let inputs = model.layout.inputs();
        let chunk = |first: usize| vec![0.0; 2 * CHUNK.min(count - first) * inputs];
        let mut learned = Self {
            layout: model.layout,
            stack: Stack::new(&model.network),
            histories: (0..count).step_by(CHUNK).map(chunk).collect(),
            tape: Tape::default(),
        };
        // The largest chunk sizes the tape, so that no step has to.
        learned.tape.x = vec![0.0; 2 * CHUNK.min(count) * inputs];
        learned.stack.forward(&mut learned.tape);
        learned
    }

    pub(super) fn restart(&mut self, board: usize) {
        let length = 2 * self.layout.inputs();
        let row = (board % CHUNK) * length;
        self.histories[board / CHUNK][row..row + length].fill(0.0);
    }

    /// Calls `visit` with every number that is remembered.
    pub(in crate::game) fn each_number(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        for value in self.histories.iter_mut().flatten() {
            let mut number = f64::from(*value);
            visit(&mut number);
            *value = number as f32;
        }
    }

    pub(super) fn lead(&mut self, leading: &mut Leading<'_>) {
        let Leading { first, commands, strikers, ways, rails } = leading;
        let chunk = *first / CHUNK;
        let layout = self.layout;
        std::mem::swap(&mut self.tape.x, &mut self.histories[chunk]);
        let pairs = strikers.iter().zip(commands.iter());
        let rows = self.tape.x.chunks_exact_mut(2 * layout.inputs());
        for ((strikers, commands), rows) in pairs.zip(rows) {
            for (player, row) in rows.chunks_exact_mut(layout.inputs()).enumerate() {
                let single = |v: [f64; 2]| turned(player, v).map(|v| v as f32);
                let velocity = single(strikers[player].led_velocity);
                layout.advance(row, single(commands[player]), velocity);
            }
        }
        self.stack.forward(&mut self.tape);
        let stride = rails.pieces + 1;
        let PerPlayer { left, right } = rails.limits.field;
        let answers = self.tape.y.chunks_exact(2).zip(ways.chunks_exact_mut(stride));
        for (index, (answer, way)) in answers.enumerate() {
            let (board, player) = (index / 2, index % 2);
            let striker = &mut strikers[board][player];
            let awake = |v: f32| if f64::from(v).abs() < STANDSTILL { 0.0 } else { f64::from(v) };
            let mut next = turned(player, [awake(answer[0]), awake(answer[1])]);
            if rails.limits.limiter == LimiterPlace::Motion {
                next = rails.limits.before_walls([&left, &right][player], striker.carriage, next);
            }
            rails.roll(player, striker, [striker.led_velocity, next], way);
        }
        std::mem::swap(&mut self.tape.x, &mut self.histories[chunk]);
    }
}
