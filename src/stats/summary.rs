//! Location and spread of a sample. Every function ignores non-finite values and returns `None`
//! when too few finite values are left.

/// Fraction of a normal distribution below its mean plus one standard deviation.
const ONE_SIGMA_QUANTILE: f64 = 0.841_344_746_068_542_9;

fn finite(values: &[f64]) -> Vec<f64> {
    values.iter().copied().filter(|value| value.is_finite()).collect()
}

/// Return the arithmetic mean; `None` without a finite value.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    let (sum, count) = values
        .iter()
        .filter(|value| value.is_finite())
        .fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (0 < count).then(|| sum / count as f64)
}

/// Return the sample standard deviation (divided by n - 1); `None` below two finite values.
#[must_use]
pub fn standard_deviation(values: &[f64]) -> Option<f64> {
    let kept = finite(values);
    let centre = mean(&kept)?;
    let squares: f64 = kept.iter().map(|value| (value - centre).powi(2)).sum();
    (1 < kept.len()).then(|| (squares / (kept.len() - 1) as f64).sqrt())
}

/// Return the median; the mean of the two middle values for an even count. `None` without a finite
/// value.
#[must_use]
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Return the quantile at `probability` (0 to 1, clamped), linear between order statistics:
/// definition 7 of Hyndman and Fan, The American Statistician 50, 1996, as in numpy. `None` without
/// a finite value.
#[must_use]
pub fn quantile(values: &[f64], probability: f64) -> Option<f64> {
    let mut kept = finite(values);
    let last = kept.len().checked_sub(1)?;
    let place = probability.clamp(0.0, 1.0) * last as f64;
    let below = (place.floor() as usize).min(last);
    let (_, &mut low, above) = kept.select_nth_unstable_by(below, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    Some(low + (place - below as f64) * (high - low))
}

/// Return half the width of the central 68 % of the sample: a robust standard deviation, equal to it
/// for a normal sample. `None` without a finite value.
#[must_use]
pub fn half_central_spread(values: &[f64]) -> Option<f64> {
    let high = quantile(values, ONE_SIGMA_QUANTILE)?;
    let low = quantile(values, 1.0 - ONE_SIGMA_QUANTILE)?;
    Some((high - low) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile([7, 1, 3, 12, 5], [0, 0.1, 0.5, 0.9, 1])
        let sample = [7.0, 1.0, 3.0, 12.0, 5.0];
        for (probability, expected) in
            [(0.0, 1.0), (0.1, 1.8), (0.5, 5.0), (0.9, 10.0), (1.0, 12.0)]
        {
            let found = quantile(&sample, probability).unwrap();
            assert!((found - expected).abs() < 1e-12, "{probability}: {found}");
        }
        assert_eq!(median(&[4.0, 1.0]), Some(2.5));
    }

    #[test]
    fn non_finite_values_are_passed_over() {
        assert_eq!(mean(&[f64::NAN, 2.0, 4.0, f64::INFINITY]), Some(3.0));
        assert_eq!(median(&[f64::NAN]), None);
        assert_eq!(standard_deviation(&[1.0]), None);
        assert_eq!(standard_deviation(&[1.0, 3.0]), Some(2.0_f64.sqrt()));
    }

    #[test]
    fn the_central_spread_ignores_one_wild_value() {
        let mut sample: Vec<f64> = (0..1001).map(f64::from).collect();
        let calm = half_central_spread(&sample).unwrap();
        sample[1000] = 1e9;
        assert!((half_central_spread(&sample).unwrap() - calm).abs() < 1.0);
        assert!((calm - 341.34).abs() < 0.1, "{calm}");
    }
}
