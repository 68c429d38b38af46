//! Scale on which values of a parameter are compared: the parameter itself, or the reciprocal of a limit
//! ([`Effect::is_limit`]).

use crate::{effects::Effect, twin::Value};

/// Scale of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Scale {
    /// The parameter itself.
    Linear,
    /// The reciprocal of a limit, which does nothing at `unlimited`.
    Reciprocal {
        /// Value without a limit.
        unlimited: f64,
    },
}

impl Scale {
    /// Scale of `parameter` of `effect`.
    pub(super) fn of(effect: &Effect, parameter: usize) -> Self {
        match effect.is_limit(parameter) {
            true => Self::Reciprocal { unlimited: effect.null[parameter] },
            false => Self::Linear,
        }
    }

    fn apply(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Reciprocal { .. } => 1.0 / value,
        }
    }

    /// Magnitude of the derivative at `value`.
    pub(super) fn slope(self, value: f64) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Reciprocal { .. } => 1.0 / (value * value),
        }
    }

    /// Difference of two values on this scale, in the unit of the parameter at `value`.
    pub(super) fn difference(self, value: f64, before: f64) -> f64 {
        (self.apply(value) - self.apply(before)).abs() / self.slope(value)
    }

    /// Interval of a parameter about `value`, symmetric on this scale, with half its linearized width.
    pub(super) fn interval(self, value: f64, half: f64) -> [f64; 2] {
        match self {
            Self::Linear => [value - half, value + half],
            Self::Reciprocal { unlimited } => {
                let (reciprocal, half) = (1.0 / value, half * self.slope(value));
                [1.0 / (reciprocal + half), 1.0 / (reciprocal - half).max(1.0 / unlimited)]
            }
        }
    }
}

/// Value of a parameter on its scale, half of its interval there (zero without one), and the slope of the scale.
#[derive(Debug, Clone, Copy)]
pub(super) struct Magnitude {
    pub(super) value: f64,
    pub(super) half: f64,
    pub(super) slope: f64,
}

impl Magnitude {
    pub(super) fn of(scale: Scale, own: &Value) -> Self {
        let (value, slope) = (scale.apply(own.value), scale.slope(own.value));
        let [low, high] = own.ci95.unwrap_or([own.value; 2]);
        let half = match scale {
            // The upper end of a limit may be at the bound. Earlier twins have a lower end below zero.
            Scale::Reciprocal { .. } if own.ci95.is_some() && 0.0 < low => 1.0 / low - value,
            _ => 0.5 * (high - low) * slope,
        };
        Self { value, half, slope }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{effects, twin::Source};

    const UNLIMITED: Scale = Scale::Reciprocal { unlimited: 500.0 };

    #[test]
    fn the_interval_of_a_limit_is_symmetric_in_its_reciprocal_and_ends_without_a_limit() {
        let slew = Scale::of(effects::find("drive.saturation.slew").unwrap(), 0);
        assert_eq!(slew, UNLIMITED);
        let [low, high] = slew.interval(4.0, 0.4);
        assert!((1.0 / low + 1.0 / high - 0.5).abs() < 1e-12 && (low - 4.0 / 1.1).abs() < 1e-12);
        // Far above what the commands reach: any limit from 200 m/s^2 on is in it.
        let [low, high] = slew.interval(500.0, 750.0);
        assert!((low - 200.0).abs() < 1e-9 && high == 500.0, "{low} {high}");
        let coulomb = Scale::of(effects::find("drive.friction.coulomb").unwrap(), 0);
        assert_eq!(coulomb.interval(1.0, 0.25), [0.75, 1.25]);
    }

    #[test]
    fn a_limit_that_was_never_reached_differs_from_one_that_is() {
        let of = |value: f64, ci95: [f64; 2]| {
            Magnitude::of(UNLIMITED, &Value { value, ci95: Some(ci95), source: Source::Fitted })
        };
        let (never, now) = (of(500.0, [200.0, 500.0]), of(4.0, [3.8, 4.2]));
        assert!((never.half - 0.003).abs() < 1e-12, "{}", never.half);
        assert!(10.0 * never.half.hypot(now.half) < now.value - never.value);
        // A twin of an earlier version has an interval that is symmetric about the value.
        let earlier = of(500.0, [-250.0, 1250.0]);
        assert!((earlier.half - 0.003).abs() < 1e-12, "{}", earlier.half);
    }
}
