//! Elastic contact at the ends of the travel.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};
use std::ops::Range;

const END: Parameter = Parameter {
    name: "low_m",
    symbol: "q_low",
    unit: "m",
    scale: 0.005,
    bounds: (-10.0, 10.0),
    plausible: (-2.5, 2.5),
    per_session: false,
};

/// `gantry.endstop`: elastic contact at the ends of the travel.
///
/// There is no force between the two ends. The positions are in the board frame. Without contact on
/// one side its end lies beyond the travel. The probes are one end, or both, for a carriage that
/// works in the middle of the board or in one half of it.
pub(crate) static ENDSTOP: Effect = Effect {
    name: "gantry.endstop",
    summary: "near the end of its travel the carriage meets an elastic stop",
    domain: Domain::Gantry,
    site: Site::OneGuide,
    equation: "F = k · max(q_low − q, 0) − k · max(q − q_high, 0)",
    parameters: &[
        Parameter {
            name: "stiffness_n_per_m",
            symbol: "k",
            unit: "N/m",
            scale: 1000.0,
            bounds: (0.0, 2e5),
            plausible: (1e3, 1e5),
            per_session: false,
        },
        END,
        Parameter { name: "high_m", symbol: "q_high", ..END },
    ],
    null: &[0.0, -0.15, 0.15],
    probes: &[
        &[1000.0, -0.15, 2.0],
        &[1000.0, -0.13, 2.0],
        &[1000.0, -0.1, 2.0],
        &[1000.0, -0.18, 2.0],
        &[1000.0, -2.0, 0.15],
        &[1000.0, -2.0, 0.13],
        &[1000.0, -2.0, 0.1],
        &[1000.0, -2.0, 0.18],
        &[1000.0, -2.0, -0.03],
        &[1000.0, -2.0, -0.06],
        &[1000.0, 0.03, 2.0],
        &[1000.0, 0.06, 2.0],
        &[1000.0, -0.15, 0.15],
        &[1000.0, -0.147, 0.147],
        &[1000.0, -0.12, 0.12],
        &[1000.0, -0.09, 0.09],
        &[1000.0, -0.18, -0.03],
        &[1000.0, -0.17, -0.06],
        &[1000.0, -0.15, -0.08],
        &[1000.0, 0.03, 0.18],
        &[1000.0, 0.06, 0.17],
        &[1000.0, 0.08, 0.15],
    ],
    memory: 0,
    physics: Physics::Force(|p, _, motion| {
        // Ends that have passed each other are no ends.
        if p[2] <= p[1] {
            return 0.0;
        }
        p[0] * ((p[1] - motion.position).max(0.0) - (motion.position - p[2]).max(0.0))
    }),
    regressors: &[Regressor::Position],
    signals: Signal::DRIVE,
    excitation: "approaches to the ends of the travel at several speeds",
    experiment: "y_line",
    confused_with: &["drive.friction.position", "gantry.stiffness"],
    reference: "penalty model of a unilateral contact: Brogliato 2016, Nonsmooth Mechanics",
};

/// Positions between both ends, where no end pushes; `None` for another effect.
pub(crate) fn free_range(effect: &Effect, values: &[f64]) -> Option<Range<f64>> {
    (effect.name == ENDSTOP.name).then(|| values[1]..values[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_ends_push_back_and_the_middle_is_free() {
        let Physics::Force(force) = ENDSTOP.physics else { panic!("a force") };
        let at = |position| {
            force(&[2000.0, -0.1, 0.12], &mut [], &Motion { position, ..Motion::default() })
        };
        assert!((at(-0.102) - 4.0).abs() < 1e-9);
        assert!((at(0.125) + 10.0).abs() < 1e-9);
        assert_eq!((at(-0.1), at(0.0), at(0.12)), (0.0, 0.0, 0.0));
    }
}
