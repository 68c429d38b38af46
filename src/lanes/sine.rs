//! Sine and cosine of several values side by side.
//!
//! Reduction to a quarter turn with pi/2 in two parts (Cody and Waite 1980), then the minimax polynomials of fdlibm
//! (`k_sin.c`, `k_cos.c`; Sun Microsystems 1993).

use super::{Lanes, Mask};
use pulp::Simd;
use std::f64::consts::FRAC_2_PI;

/// Largest angle (rad) that is reduced here: number of quarter turns times [`QUARTER_TURN`] is exact below 2^20 quarters.
const LARGEST_ANGLE: f64 = 1e6;

/// First 33 bits of pi/2, and the rest.
const QUARTER_TURN: f64 = 1.570_796_326_734_125_6;
const QUARTER_TURN_REST: f64 = 6.077_100_506_506_192e-11;

/// Number whose last bit is one: a sum with it is rounded to a whole number.
const WHOLE: f64 = 1.5 * (1_u64 << 52) as f64;

/// Coefficients of (sin r / r - 1) / r^2 and of (cos r - 1 + r^2/2) / r^4 in powers of r^2, the highest first.
const SINE: [f64; 6] = [
    1.589_690_995_211_55e-10,
    -2.505_076_025_340_686_3e-8,
    2.755_731_370_707_006_8e-6,
    -1.984_126_982_985_795e-4,
    8.333_333_333_322_49e-3,
    -1.666_666_666_666_663_2e-1,
];
const COSINE: [f64; 6] = [
    -1.135_964_755_778_819_5e-11,
    2.087_572_321_298_175e-9,
    -2.755_731_435_139_066_3e-7,
    2.480_158_728_947_673e-5,
    -1.388_888_888_887_411e-3,
    4.166_666_666_666_66e-2,
];

impl<S: Simd> Lanes<S> {
    /// Sine and cosine of this angle (rad), within two units in the last place of 1.
    #[inline(always)]
    pub(crate) fn sin_cos(self) -> (Self, Self) {
        let quarters = (FRAC_2_PI * self).round();
        let rest =
            (self - quarters * self.like(QUARTER_TURN)) - quarters * self.like(QUARTER_TURN_REST);
        let square = rest * rest;
        let sine = rest + rest * square * square.polynomial(SINE);
        let cosine = 1.0 - (0.5 * square - square * square * square.polynomial(COSINE));
        // -2 to 2.
        let turned = quarters - 4.0 * (0.25 * quarters).round();
        let is_odd = turned.abs().equals(self.like(1.0));
        let is_half = self.like(1.0).less_than(turned.abs());
        let backward = turned.less_than(self.like(0.0)) & is_odd;
        let forward = self.like(0.0).less_than(turned) & is_odd;
        let mut sines = is_odd.select(cosine, sine).negated(is_half.or(backward));
        let mut cosines = is_odd.select(sine, cosine).negated(is_half.or(forward));
        if !self.abs().at_most(self.like(LARGEST_ANGLE)).all() {
            for lane in 0..S::F64_LANES {
                let angle = self.get(lane);
                if LARGEST_ANGLE < angle.abs() || !angle.is_finite() {
                    sines.set(lane, angle.sin());
                    cosines.set(lane, angle.cos());
                }
            }
        }
        (sines, cosines)
    }

    /// The negative in the lanes in which `is_negated`, this in the others.
    #[inline(always)]
    fn negated(self, is_negated: Mask<S>) -> Self {
        is_negated.select(-self, self)
    }

    /// The nearest whole number; magnitudes are below 2^50.
    #[inline(always)]
    fn round(self) -> Self {
        (self + self.like(WHOLE)) - self.like(WHOLE)
    }

    /// Value of the polynomial with these `coefficients`, the highest power first (Horner's scheme).
    #[inline(always)]
    fn polynomial<const N: usize>(self, coefficients: [f64; N]) -> Self {
        let mut sum = self.like(0.0);
        for coefficient in coefficients {
            sum = self.like(coefficient) + self * sum;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    /// Two units in the last place of 1.
    const CLOSE: f64 = 2.0 * f64::EPSILON;

    fn is_close(angle: f64) {
        let (sine, cosine) = Lanes::splat(Scalar, angle).sin_cos();
        let (sine, cosine) = (sine.get(0), cosine.get(0));
        let error = (sine - angle.sin()).abs().max((cosine - angle.cos()).abs());
        assert!(error <= CLOSE, "{angle}: {sine}, {cosine}, {error}");
    }

    #[test]
    fn they_are_sine_and_cosine_in_all_quadrants() {
        for k in -4000..4000 {
            is_close(0.01 * f64::from(k));
            is_close(std::f64::consts::FRAC_PI_4 * f64::from(k));
            is_close(249.7 * f64::from(k));
        }
    }

    #[test]
    fn large_angles_and_those_that_are_no_numbers_are_handled() {
        for angle in [1e6, -1e6, 1e6 + 0.1, 3e9, -1e18, 1e300] {
            is_close(angle);
        }
        for angle in [f64::NAN, f64::INFINITY] {
            let (sine, cosine) = Lanes::splat(Scalar, angle).sin_cos();
            assert!(sine.get(0).is_nan() && cosine.get(0).is_nan());
        }
    }
}
