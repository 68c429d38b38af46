//! Alignment of sessions in time: commands wait on the bus, by another time in every session and for every motor.
//!
//! Drives send their cyclic messages with phases of their own since they were switched on. A command waits for those in
//! front of it, up to some milliseconds. The wait is the same at every command, as long as the periods of commands and messages
//! are multiples of each other. `drive.delay` contains the wait in the first training session. Without alignment, the difference
//! would be most of the validation residual, and no small effect could be confirmed.

use super::Search;
use crate::{
    effects::{Physics, both},
    gap::{
        fit,
        journal::MoveKind,
        numerics::normal::Normal,
        problem::{Part, Problem},
        whiten::{self, Filters},
    },
    twin::{Instance, Slot, StageKind, Twin},
};
use std::mem;

/// Longest difference of the wait that is explained by a bus (s): a period of the cyclic messages.
const LONGEST: f64 = 0.01;

/// Shortest one that matters (s): the least plausible delay.
const SHORTEST: f64 = 2e-4;

/// Iterations of the estimate, and the step (s) that ends them.
const MOST_ITERATIONS: usize = 6;
const SMALL_STEP: f64 = 1e-5;

/// Difference of the wait by which derivatives are computed (s).
const NUDGE: f64 = 1e-4;

/// Return whether an effect delays commands.
fn delays_commands(own: &Instance) -> bool {
    let is_delay = |own: &Physics| matches!(own, Physics::CommandDelay(_));
    own.effect.physics.equations().iter().any(is_delay)
}

impl Problem<'_> {
    /// Mean change of the parameter `slot` of `twin` with the alignment of these sessions: the wait on the bus, of a delay of
    /// the commands; zero of others.
    pub(in crate::gap) fn lateness(&self, twin: &Twin, slot: Slot) -> f64 {
        let own = &twin.instances[slot.instance];
        if !delays_commands(own) || self.parts.is_empty() {
            return 0.0;
        }
        let motors: Vec<usize> = (0..2).filter(|motor| own.axis.covers(*motor)).collect();
        let all = self.parts.iter().flat_map(|part| motors.iter().map(|motor| part.late[*motor]));
        all.sum::<f64>() / (self.parts.len() * motors.len().max(1)) as f64
    }
}

impl Search<'_> {
    /// Align all sessions with the first training session, if the twin has a delay and the sessions prefer it beyond chance.
    pub(super) fn align_sessions(&mut self) {
        if self.kind != StageKind::Drive
            || !self.best.point.twin.instances.iter().any(delays_commands)
        {
            return;
        }
        let twin = &self.best.point.twin;
        let Some(first) = self.train.parts.first() else { return };
        let Some(reference) = estimated_lateness(first, twin, &self.filters) else { return };
        let reference = (&self.filters, reference);
        let mut is_new = align(&mut self.held_out, twin, reference);
        // The first training session is the reference.
        if 1 < self.train.parts.len() {
            is_new |= align(&mut self.train, twin, reference);
        }
        if !is_new {
            return;
        }
        if self.train.parts.iter().any(|part| part.late != [0.0; 2]) {
            let (point, slots) = (self.best.point.clone(), self.best.slots.clone());
            (self.best, self.filters) = fit::converge(&self.train, point, &slots, 8);
        }
        self.note(
            MoveKind::Refit,
            "Commands wait on the bus by another time than in the first training session: the other sessions are aligned with it",
        );
    }
}

/// Align the sessions of `problem` with one in which commands are late by `reference` (s). Return whether any was not.
fn align(
    problem: &mut Problem<'_>,
    twin: &Twin,
    (filters, reference): (&Filters, [f64; 2]),
) -> bool {
    let rows = |problem: &Problem<'_>| problem.whitened(&problem.start(twin.clone()), filters);
    let wait = |part: &Part<'_>| {
        let late = estimated_lateness(part, twin, filters)?;
        Some(both(|motor| late[motor] - reference[motor])).filter(is_wait)
    };
    let waits: Vec<Option<[f64; 2]>> = problem.parts.iter().map(wait).collect();
    let mut was_aligned = false;
    for part in &mut problem.parts {
        was_aligned |= mem::take(&mut part.late) != [0.0; 2];
    }
    let without = rows(problem);
    for (part, wait) in problem.parts.iter_mut().zip(waits) {
        part.late = wait.unwrap_or_default();
    }
    let is_preferred = problem.thresholds().is_in(&without, &rows(problem), &problem.blocks());
    if !is_preferred {
        problem.parts.iter_mut().for_each(|part| part.late = [0.0; 2]);
    }
    is_preferred && !was_aligned
}

/// Return whether these differences (s) may be the wait on a bus.
fn is_wait(late: &[f64; 2]) -> bool {
    late.iter().all(|late| late.abs() <= LONGEST) && late.iter().any(|late| SHORTEST <= late.abs())
}

/// Time (s) by which commands of a session reach each motor later than `twin` tells, by least squares.
fn estimated_lateness(part: &Part<'_>, twin: &Twin, filters: &Filters) -> Option<[f64; 2]> {
    let order = whiten::in_order(part.stage, filters);
    let rows = |late: [f64; 2]| {
        part.layout.whitened(&part.residual(&part.predict_late(twin, late)), &order)
    };
    let mut late = part.late;
    let mut residual = rows(late);
    for _ in 0..MOST_ITERATIONS {
        let columns: Vec<Vec<f64>> = (0..2)
            .map(|motor| {
                let mut moved = late;
                moved[motor] += NUDGE;
                let derivative = |(from, to): (&f64, &f64)| (from - to) / NUDGE;
                residual.iter().zip(&rows(moved)).map(derivative).collect()
            })
            .collect();
        let step = Normal::new(&columns, &residual).step(0.0);
        let next = both(|motor| late[motor] + step[motor].clamp(-LONGEST, LONGEST));
        let left = rows(next);
        let is_less = fit::squared(&left) < fit::squared(&residual);
        if !is_less {
            break;
        }
        (late, residual) = (next, left);
        if step.iter().all(|step| step.abs() < SMALL_STEP) {
            break;
        }
    }
    late.iter().all(|late| late.is_finite()).then_some(late)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Domain, Effect},
        seed::Stream,
        twin::{Channel, Stage},
    };

    const RATE: f64 = 100.0;
    const NOISE_RMS: f64 = 0.01;
    const RESOLUTION: f64 = 1e-4;

    /// Velocities of both motors, which follow a sum of two sines later than the commands.
    struct Bus {
        channels: Vec<Channel>,
    }

    fn motion(motor: usize, time: f64) -> f64 {
        let slow = 1.0 + 0.3 * motor as f64;
        (3.0 * slow * time).sin() + 0.5 * (11.0 * slow * time).cos()
    }

    impl Bus {
        /// 20 s in which commands are `late` (s), measured with noise.
        fn new(late: [f64; 2], seed: u64) -> Self {
            let mut random = Stream::new(seed, "bus");
            let bound = (3f64.sqrt() * NOISE_RMS) as f32;
            let times: Vec<f64> = (0..2000).map(|k| f64::from(k) / RATE).collect();
            let channels = (0..2).map(|motor| {
                let mut noisy = |time: &f64| {
                    motion(motor, time - late[motor]) + f64::from(random.uniform_f32(-bound, bound))
                };
                Channel {
                    signal: ["motor_a.velocity", "motor_b.velocity"][motor].into(),
                    unit: "m/s",
                    domain: Domain::Drive,
                    axis: ["a", "b"][motor],
                    rate_hz: RATE,
                    measured: times.iter().map(&mut noisy).collect(),
                    times: times.clone(),
                    runs: std::iter::once(0..times.len()).collect(),
                }
            });
            Self { channels: channels.collect() }
        }
    }

    impl Stage for Bus {
        fn kind(&self) -> StageKind {
            StageKind::Drive
        }

        fn channels(&self) -> &[Channel] {
            &self.channels
        }

        fn calls(&self, _effect: &Effect) -> bool {
            true
        }

        fn predict(&self, _twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
            for (motor, predicted) in predicted.iter_mut().enumerate() {
                let late = nuisance.first().map_or(0.0, |late| late[motor]);
                let times = self.channels[motor].times.iter();
                *predicted = times.map(|time| motion(motor, time - late)).collect();
            }
        }
    }

    /// Wait of a validation session with commands that are `late` (s) after alignment with one whose commands are late by
    /// `reference`, and whether the alignment was new.
    fn aligned(late: [f64; 2], reference: [f64; 2]) -> ([f64; 2], bool) {
        let twin = Twin::nominal(crate::twin::Machine::Table);
        let bus = Bus::new(late, 1);
        let mut problem = Problem::new(&[&bus as &dyn Stage], &twin);
        let filters = problem.filters(&problem.start(twin.clone()), whiten::scale_filters);
        let is_new = align(&mut problem, &twin, (&filters, reference));
        (problem.parts[0].late, is_new)
    }

    #[test]
    fn each_motor_of_a_session_is_aligned_with_the_first_session() {
        let (late, is_new) = aligned([2.3e-3, -1.1e-3], [0.4e-3, -0.4e-3]);
        assert!(is_new);
        let is_near = |own: f64, wanted: f64| (own - wanted).abs() < RESOLUTION;
        assert!(is_near(late[0], 1.9e-3) && is_near(late[1], -0.7e-3), "{late:?}");
    }

    #[test]
    fn noise_aligns_nothing_and_neither_does_more_than_a_bus() {
        assert_eq!(aligned([0.0; 2], [0.0; 2]), ([0.0; 2], false));
        assert_eq!(aligned([0.03, 0.03], [0.0; 2]), ([0.0; 2], false));
    }

    #[test]
    fn the_interval_of_a_delay_contains_the_wait_of_other_sessions() {
        let delay = ("drive.delay", crate::effects::Axis::A, &[0.02][..]);
        let twin = Twin::table_with(&[delay]);
        let bus = Bus::new([0.0; 2], 1);
        let mut problem = Problem::new(&[&bus as &dyn Stage], &twin);
        problem.parts[0].late = [2e-3, 5e-3];
        let last = Slot { instance: twin.instances.len() - 1, parameter: 0 };
        assert_eq!(problem.lateness(&twin, last), 2e-3);
        assert_eq!(problem.lateness(&twin, Slot { instance: 0, parameter: 0 }), 0.0);
    }
}
