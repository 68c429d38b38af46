//! Normal random numbers for actions, keyed by their use.
//!
//! Each number is a function of step and environment, not of a position in a sequence. It is
//! therefore independent of order and threads, and there is no state to store. The bits are
//! SplitMix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", 2014),
//! whose outputs can be computed at any position; the normal numbers use the Box-Muller transform
//! (1958).

use crate::seed::{SPLITMIX64_INCREMENT, Stream, splitmix64};
use std::f32::consts::TAU;

/// A source of normal random numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Noise {
    key: u64,
}

impl Noise {
    /// Source called `name` of the user's `seed`.
    pub(super) fn new(seed: u64, name: &str) -> Self {
        let mut stream = Stream::new(seed, name);
        let half = |stream: &mut Stream| stream.below(1 << 32) as u64;
        Self { key: half(&mut stream) << 32 | half(&mut stream) }
    }

    /// Numbers of one step.
    pub(super) fn at(self, step: u64) -> StepNoise {
        StepNoise {
            key: splitmix64(self.key.wrapping_add(step.wrapping_mul(SPLITMIX64_INCREMENT))),
        }
    }
}

/// Normal random numbers of one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepNoise {
    key: u64,
}

impl StepNoise {
    /// Two independent normal numbers, pair `index`.
    pub(super) fn pair(self, index: u64) -> [f32; 2] {
        const UNIT: f32 = 1.0 / (1u64 << 24) as f32;
        let bits = splitmix64(
            self.key.wrapping_add(index.wrapping_add(1).wrapping_mul(SPLITMIX64_INCREMENT)),
        );
        // 24 bits each: above 0 and up to 1, so that the logarithm exists; 0 up to below 1.
        let radius_bits = (bits >> 40) as f32 + 1.0;
        let angle_bits = (bits & 0xff_ffff) as f32;
        let radius = (-2.0 * (radius_bits * UNIT).ln()).sqrt();
        let (sine, cosine) = (TAU * angle_bits * UNIT).sin_cos();
        [radius * cosine, radius * sine]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_function_is_that_of_splitmix64() {
        // First outputs of the reference code (Vigna, splitmix64.c) from state 1234567.
        let outputs = [1u64, 2, 3]
            .map(|i| splitmix64(1_234_567u64.wrapping_add(i.wrapping_mul(SPLITMIX64_INCREMENT))));
        let expected =
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!(outputs, expected);
    }

    #[test]
    fn numbers_are_normal_and_uncorrelated() {
        const STEPS: u64 = 100;
        const ROWS: u64 = 2000;
        let noise = Noise::new(3, "actions");
        let pair = |step, row| noise.at(step).pair(row).map(f64::from);
        let check = |name: &str, expected: f64, bound: f64, f: &dyn Fn(u64, u64) -> f64| {
            let rows = |step| (0..ROWS).map(move |row| (step, row));
            let sum: f64 = (0..STEPS).flat_map(rows).map(|(step, row)| f(step, row)).sum();
            let found = sum / (STEPS * ROWS) as f64;
            assert!((found - expected).abs() < bound, "{name}: {found}");
        };
        // 200,000 draws: a mean of unit variance has deviation 0.0022, that of the fourth power
        // sqrt(96 / 200,000) = 0.022; each bound is more than four of them.
        check("mean", 0.0, 0.01, &|s, r| pair(s, r)[0]);
        check("mean of the second", 0.0, 0.01, &|s, r| pair(s, r)[1]);
        check("variance", 1.0, 0.015, &|s, r| pair(s, r)[0].powi(2));
        check("fourth moment", 3.0, 0.1, &|s, r| pair(s, r)[1].powi(4));
        check("within a pair", 0.0, 0.01, &|s, r| pair(s, r)[0] * pair(s, r)[1]);
        check("between rows", 0.0, 0.01, &|s, r| pair(s, r)[0] * pair(s, r + 1)[0]);
        check("between steps", 0.0, 0.01, &|s, r| pair(s, r)[0] * pair(s + 1, r)[0]);
    }
}
