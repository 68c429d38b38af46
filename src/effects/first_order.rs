//! Exact step of a first-order lag.

/// One step of `dt` seconds of `tau y' + y = u` to the input `u`, exact for an input that is linear between
/// steps.
///
/// The forced solution lags by `tau u'`, and the deviation from it decays. `memory` holds the previous
/// input and the output. Smooth in `tau` down to zero.
pub(crate) fn follow(tau: f64, memory: &mut [f64], u: f64, dt: f64) -> f64 {
    let before = std::mem::replace(&mut memory[0], u);
    if dt <= 0.0 {
        return memory[1];
    }
    let behind = tau * (u - before) / dt;
    let decay = (-dt / tau).exp();
    memory[1] = u - behind + (memory[1] - before + behind) * decay;
    memory[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_step_it_decays_with_the_time_constant_whatever_the_step() {
        for dt in [1e-5, 1e-3, 5e-3] {
            let mut memory = [1.0, 0.0];
            let steps = (0.01_f64 / dt).round() as usize;
            let reached = (0..steps).fold(0.0, |_, _| follow(0.01, &mut memory, 1.0, dt));
            assert!((reached - (1.0 - (-1.0_f64).exp())).abs() < 1e-12, "{reached} at {dt}");
        }
    }

    #[test]
    fn a_ramp_is_late_by_the_time_constant_whatever_the_step() {
        for (tau, dt) in [(0.0004, 1e-3), (0.003, 1e-3), (0.003, 1e-4)] {
            let mut memory = [0.0; 2];
            let late = (1..1000).fold(0.0, |_, step| {
                let u = 2.0 * f64::from(step) * dt;
                u - follow(tau, &mut memory, u, dt)
            });
            assert!((late - 2.0 * tau).abs() < 1e-9, "{late}");
        }
        assert_eq!(follow(0.0, &mut [0.0; 2], 1.0, 1e-3), 1.0);
    }
}
