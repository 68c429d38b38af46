//! Independent named random streams from one user seed.
//!
//! A stream is ChaCha with 8 rounds, keyed by SHA-256 of the seed and the stream's name. A draw
//! added in one part of a program never changes the numbers of another part. The same seed gives
//! the same numbers on every machine.

use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};
use sha2::{Digest, Sha256};

/// Named stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// Create the stream called `name` of the user's `seed`.
    #[must_use]
    pub fn new(seed: u64, name: &str) -> Self {
        let key = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(name).finalize();
        Self(ChaCha8Rng::from_seed(key.into()))
    }

    /// Create the stream called `name` of the user's `seed` for one of many items, identified by
    /// `numbers` (for example an episode of a board). Nothing is allocated.
    #[must_use]
    pub fn numbered(seed: u64, name: &str, numbers: &[u64]) -> Self {
        // No name contains 0xff, so that no name ends where another's numbers start.
        let start = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(name);
        let hash = numbers.iter().fold(start.chain_update([0xff]), |hash, number| {
            hash.chain_update(number.to_le_bytes())
        });
        Self(ChaCha8Rng::from_seed(hash.finalize().into()))
    }

    /// Draw a number from `low` (included) to `high` (excluded), from 24 random bits.
    pub fn uniform_f32(&mut self, low: f32, high: f32) -> f32 {
        let unit = (self.0.next_u32() >> 8) as f32 / (1u32 << 24) as f32;
        low + (high - low) * unit
    }

    /// Draw an integer below `end`, which is at least 1; the bias is below 2^-32 * `end`.
    pub fn below(&mut self, end: usize) -> usize {
        ((u128::from(self.0.next_u64()) * end as u128) >> 64) as usize
    }

    /// Shuffle `items` (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

/// SplitMix64's increment, the golden ratio of 2^64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number
/// Generators", 2014).
pub(crate) const SPLITMIX64_INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's output function.
pub(crate) fn splitmix64(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ_by_seed_and_name() {
        let draw = |seed, name| Stream::new(seed, name).below(1 << 40);
        assert_eq!(draw(7, "order"), draw(7, "order"));
        assert_ne!(draw(7, "order"), draw(8, "order"));
        assert_ne!(draw(7, "order"), draw(7, "weights"));
    }

    #[test]
    fn numbered_streams_repeat_and_differ_by_every_number() {
        let draw = |name, numbers: &[u64]| Stream::numbered(7, name, numbers).below(1 << 40);
        assert_eq!(draw("episode", &[3, 5]), draw("episode", &[3, 5]));
        for numbers in [&[3, 6][..], &[4, 5], &[5, 3], &[3], &[]] {
            assert_ne!(draw("episode", &[3, 5]), draw("episode", numbers));
        }
        assert_ne!(draw("episode", &[]), Stream::new(7, "episode").below(1 << 40));
    }

    #[test]
    fn a_shuffle_is_a_permutation() {
        let mut items: Vec<usize> = (0..1000).collect();
        Stream::new(1, "order").shuffle(&mut items);
        assert_ne!(items[..10], (0..10).collect::<Vec<_>>());
        items.sort_unstable();
        assert_eq!(items, (0..1000).collect::<Vec<_>>());
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let mut stream = Stream::new(3, "weights");
        let draws: Vec<f32> = (0..10_000).map(|_| stream.uniform_f32(-2.0, 6.0)).collect();
        let mean = draws.iter().sum::<f32>() / draws.len() as f32;
        assert!(draws.iter().all(|x| (-2.0..6.0).contains(x)));
        // The mean of 10,000 draws has standard deviation 8 / sqrt(12 * 10,000) = 0.023.
        assert!((mean - 2.0).abs() < 0.1, "{mean}");
    }
}
