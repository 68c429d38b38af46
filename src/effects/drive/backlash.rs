//! Play between motor and load.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.backlash`: the load stays where it is until the motor has crossed the play: the play
/// operator load = clamp(load, motor - b/2, motor + b/2), for a load that friction holds. It begins
/// in the middle. Source: Nordin and Gutman 2002, Automatica 38(10).
pub(crate) static BACKLASH: Effect = Effect {
    name: "drive.backlash",
    says: "after a reversal the motor turns a little before the load follows",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[Parameter {
        name: "width_m",
        unit: "m",
        scale: 0.0002,
        bounds: (0.0, 0.02),
        plausible: (2e-05, 0.002),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.0002], &[0.001], &[0.003]],
    memory: 2,
    physics: Physics::Play(|p, memory, position, _| follow(p, memory, position)),
    regressors: &[Regressor::Direction, Regressor::SinceReversal],
    excitation: "reversals at several speeds, with encoder and camera",
    experiment: "creep",
    confused_with: &[
        "drive.input_deadband",
        "drive.friction.presliding",
        "estimator.velocity_deadzone",
        "coupling.striker_friction",
        "coupling.magnet_spring",
    ],
};

/// Memory: place of the load, and 1 once there is one.
fn follow(p: &[f64], memory: &mut [f64], position: f64) -> f64 {
    if memory[1] == 0.0 {
        (memory[0], memory[1]) = (position, 1.0);
    }
    memory[0] = memory[0].max(position - 0.5 * p[0]).min(position + 0.5 * p[0]);
    memory[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_load_follows_behind_the_play() {
        let p = [0.002];
        let mut memory = [0.0; 2];
        assert_eq!(follow(&p, &mut memory, 0.1), 0.1);
        assert!((follow(&p, &mut memory, 0.11) - 0.109).abs() < 1e-12);
        assert!((follow(&p, &mut memory, 0.1085) - 0.109).abs() < 1e-12);
        assert!((follow(&p, &mut memory, 0.1) - 0.101).abs() < 1e-12);
        assert_eq!(follow(BACKLASH.null, &mut [0.3, 1.0], 0.1), 0.1);
    }
}
