//! Motor and load of a single axis on an elastic transmission.

use super::{Motion, Oscillator};

/// Integration steps of the load in one sample period. The highest frequency of a load is 0.04 cycles per sample, so that
/// a step is at most 0.13 rad long.
const SUBSTEPS: u32 = 2;

/// First and last forces of a recording that are uncertain: central differences of the position end there.
const UNCERTAIN: usize = 4;

/// Load on a spring behind a motor whose position q is measured: x'' = w^2 (q - x) + 2 z w (q' - x').
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticLoad {
    /// Mass of the load over the whole moving mass.
    pub fraction: f64,
    /// Angular frequency of the load while the motor stands, w (rad/s).
    pub angular_frequency: f64,
    /// Its damping ratio, z.
    pub damping_ratio: f64,
}

/// State of an [`ElasticLoad`]: position and velocity of the load, and last position of the motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticState {
    load: f64,
    velocity: f64,
    motor: f64,
}

impl ElasticState {
    /// The same with another position and velocity of the load, by these differences.
    #[must_use]
    pub fn with_load_moved(self, [position, velocity]: [f64; 2]) -> Self {
        Self { load: self.load + position, velocity: self.velocity + velocity, ..self }
    }

    /// Move motor and load together, to where the motor is in `motion`.
    pub fn move_to(&mut self, motion: &Motion) {
        self.load += motion.position - self.motor;
        self.motor = motion.position;
    }
}

impl ElasticLoad {
    /// State in which the load follows a motor in `motion`.
    #[must_use]
    pub fn following(&self, motion: &Motion) -> ElasticState {
        let stretch = motion.acceleration / self.angular_frequency.powi(2);
        ElasticState {
            load: motion.position - stretch,
            velocity: motion.velocity,
            motor: motion.position,
        }
    }

    /// Let the load follow the motor to `motion` for its time step. Return the acceleration that the spring gives the load
    /// (position/s^2).
    pub fn follow(&self, state: &mut ElasticState, motion: &Motion) -> f64 {
        let step = motion.dt / f64::from(SUBSTEPS);
        let speed = (motion.position - state.motor) / motion.dt;
        // Damping acts on the mean velocity of the step.
        let damped_step = step / (1.0 + step * self.damping_ratio * self.angular_frequency);
        for index in 0..SUBSTEPS {
            // Half of the way, the velocity, half of the way (leapfrog).
            state.load += 0.5 * step * state.velocity;
            let stretch = state.motor + (f64::from(index) + 0.5) * step * speed - state.load;
            state.velocity += damped_step * self.push(stretch, speed - state.velocity);
            state.load += 0.5 * step * state.velocity;
        }
        state.motor = motion.position;
        self.push(state.motor - state.load, motion.velocity - state.velocity)
    }

    /// Acceleration of the load by the spring at the `stretch` and its `rate` (per second).
    fn push(&self, stretch: f64, rate: f64) -> f64 {
        let omega = self.angular_frequency;
        omega * omega * stretch + 2.0 * self.damping_ratio * omega * rate
    }
}

/// Resonance of motor and load where the position of the load is measured: the force F_load on the load side follows from
/// that of the motor by a second-order lag, F = F_load + 2 z p F_load' + p^2 F_load''.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// Period divided by 2 pi, p (s); zero for a rigid axis.
    pub angular_period: f64,
    /// Damping ratio, z.
    pub damping_ratio: f64,
}

impl Resonance {
    /// Force on the load side at steps of `dt` seconds, for the motor's `forces`. Before them, the first one acted for long.
    #[must_use]
    pub fn forwards(&self, forces: &[f64], dt: f64) -> Vec<f64> {
        if self.angular_period <= 0.0 {
            return forces.to_vec();
        }
        let step = Oscillator::new(1.0 / self.angular_period, self.damping_ratio, dt);
        let (mut force, mut rate) = (forces.first().copied().unwrap_or(0.0), 0.0);
        let mut before = force;
        let follow = |motor: &f64| {
            // Between two steps their mean acts.
            let middle = 0.5 * (before + motor);
            let (distance, after) = step.step(force - middle, rate);
            (force, rate, before) = (middle + distance, after, *motor);
            force
        };
        forces.iter().map(follow).collect()
    }

    /// Force of the motor at steps of `dt` seconds, for the `forces` on the load side, which go on linearly at both ends.
    #[must_use]
    pub fn backwards(&self, forces: &[f64], dt: f64) -> Vec<f64> {
        if forces.len() < 2 + 2 * UNCERTAIN {
            return forces.to_vec();
        }
        let last = forces.len() - 2 - UNCERTAIN;
        let at = |index: usize| {
            let inner = index.clamp(UNCERTAIN, last);
            let slope = forces[inner + 1] - forces[inner];
            forces[inner] + slope * (index as f64 - inner as f64)
        };
        let of_step = |index: usize| {
            let middle = index.clamp(1, forces.len() - 2);
            let [before, now, after] = [middle - 1, middle, middle + 1].map(at);
            let slope = 0.5 * (after - before) / dt;
            let curvature = (after - 2.0 * now + before) / (dt * dt);
            let period = self.angular_period;
            at(index) + 2.0 * self.damping_ratio * period * slope + period * period * curvature
        };
        (0..forces.len()).map(of_step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    /// Largest acceleration of `load` in the last second of ten, behind a motor on a sine of amplitude 1 at `rate` (rad/s).
    fn amplitude(load: ElasticLoad, rate: f64) -> f64 {
        let at = |time: f64| {
            let (sine, cosine) = (rate * time).sin_cos();
            let [position, velocity, acceleration] = [sine, rate * cosine, -rate * rate * sine];
            Motion { dt: DT, time, position, velocity, acceleration, ..Motion::default() }
        };
        let mut state = load.following(&at(0.0));
        let mut largest = 0.0_f64;
        for index in 1..=10_000 {
            let motion = at(f64::from(index) * DT);
            let acceleration = load.follow(&mut state, &motion);
            if 9.0 < motion.time {
                largest = largest.max(acceleration.abs());
            }
        }
        largest
    }

    fn load(angular_frequency: f64) -> ElasticLoad {
        ElasticLoad { fraction: 0.5, angular_frequency, damping_ratio: 0.1 }
    }

    /// Against the closed form: (1 + 2 z i u) / (1 - u^2 + 2 z i u) of the motor's acceleration, u = rate / omega.
    #[test]
    fn the_load_has_the_response_of_an_oscillator() {
        const OMEGA: f64 = 40.0;
        for ratio in [0.02_f64, 0.2, 0.7, 1.0, 1.5, 3.0] {
            let damped = (0.2 * ratio).powi(2);
            let expected = ((1.0 + damped) / ((1.0 - ratio * ratio).powi(2) + damped)).sqrt();
            let rate = ratio * OMEGA;
            let found = amplitude(load(OMEGA), rate) / (rate * rate);
            assert!((found / expected - 1.0).abs() < 0.01, "{ratio}: {found} of {expected}");
        }
    }

    #[test]
    fn forwards_inverts_backwards() {
        let resonance = Resonance { angular_period: 0.02, damping_ratio: 0.1 };
        let load: Vec<f64> = (0..4000).map(|k| (20.0 * DT * f64::from(k)).sin()).collect();
        let motor = resonance.backwards(&load, DT);
        // 1 - (w p)^2 + 2 i z w p at w p = 0.4
        let expected = (0.84_f64.powi(2) + 0.08_f64.powi(2)).sqrt();
        let largest = motor[1000..3000].iter().fold(0.0_f64, |largest, own| largest.max(own.abs()));
        assert!((largest / expected - 1.0).abs() < 1e-3, "{largest} of {expected}");
        let again = resonance.forwards(&motor, DT);
        let errors = again[2000..3000].iter().zip(&load[2000..]).map(|(a, b)| (a - b).abs());
        assert!(errors.fold(0.0, f64::max) < 2e-3);
        let rigid = Resonance { angular_period: 0.0, ..resonance };
        assert_eq!(rigid.forwards(&load, DT), load);
        assert_eq!(rigid.backwards(&load, DT)[10..3990], load[10..3990]);
    }
}
