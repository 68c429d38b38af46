//! Random numbers of the bench: named streams, uniform and normal.

use klasktron::seed::Stream;
use std::f64::consts::TAU;

/// A named stream with the shapes that the rigs need.
#[derive(Debug, Clone)]
pub(crate) struct Draw {
    stream: Stream,
    spare: Option<f64>,
}

impl Draw {
    pub(crate) fn new(seed: u64, name: &str) -> Self {
        Self { stream: Stream::new(seed, name), spare: None }
    }

    /// From 0 (included) to 1 (excluded), 53 random bits.
    pub(crate) fn unit(&mut self) -> f64 {
        self.stream.below(1 << 53) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        self.stream.below(end)
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    pub(crate) fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }

    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        self.stream.shuffle(items);
    }

    /// Mean 0, variance 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        let (sin, cos) = (TAU * self.unit()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }
}

/// Noise of first order: standard deviation `sd`, correlation `rho` from draw to draw.
#[derive(Debug, Clone)]
pub(crate) struct Coloured {
    rho: f64,
    sd: f64,
    value: f64,
}

impl Coloured {
    pub(crate) fn new(sd: f64, rho: f64) -> Self {
        Self { rho, sd, value: 0.0 }
    }

    pub(crate) fn next(&mut self, draw: &mut Draw) -> f64 {
        if self.sd <= 0.0 {
            return 0.0;
        }
        self.value =
            self.rho * self.value + (1.0 - self.rho * self.rho).sqrt() * self.sd * draw.normal();
        self.value
    }
}
