//! Distribution functions and quantiles of the statistical tests.

/// Largest number of terms of the continued fraction; it converges in far fewer for the sizes of
/// tests.
const MOST_TERMS: usize = 500;

/// Return the natural logarithm of the gamma function for x > 0 (Lanczos, g = 7, nine terms;
/// relative error below 1e-13).
#[must_use]
pub fn ln_gamma(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 8] = [
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let shifted = x - 1.0;
    let base = shifted + 7.5;
    let series: f64 = COEFFICIENTS
        .iter()
        .enumerate()
        .map(|(k, coefficient)| coefficient / (shifted + k as f64 + 1.0))
        .sum::<f64>()
        + 0.999_999_999_999_809_9;
    0.5 * std::f64::consts::TAU.ln() + (shifted + 0.5) * base.ln() - base + series.ln()
}

/// Return the regularised incomplete beta function I_x(a, b) by Lentz's continued fraction (Press
/// et al., "Numerical Recipes", 3rd ed., section 6.4).
#[must_use]
pub fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if 1.0 <= x {
        return 1.0;
    }
    let front =
        (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (1.0 - x).ln()).exp();
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(a, b, x) / a
    } else {
        1.0 - front * beta_fraction(b, a, 1.0 - x) / b
    }
}

fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let tiny = 1e-300;
    let guard = |value: f64| if value.abs() < tiny { tiny } else { value };
    let mut c = 1.0;
    let mut d = 1.0 / guard(1.0 - (a + b) * x / (a + 1.0));
    let mut fraction = d;
    for term in 1..MOST_TERMS {
        let m = term as f64;
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / guard(1.0 + even * d);
        c = guard(1.0 + even / c);
        fraction *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / guard(1.0 + odd * d);
        c = guard(1.0 + odd / c);
        let change = d * c;
        fraction *= change;
        if (change - 1.0).abs() < 1e-14 {
            break;
        }
    }
    fraction
}

/// Return the probability that Fisher's F with `k` and `n` degrees of freedom exceeds `f`.
#[must_use]
pub fn f_tail(f: f64, k: f64, n: f64) -> f64 {
    if !f.is_finite() || f <= 0.0 || n <= 0.0 || k <= 0.0 {
        return 1.0;
    }
    incomplete_beta(0.5 * n, 0.5 * k, n / (n + k * f))
}

/// Return the quantile `probability` (above one half) of Student's t with `n` degrees of freedom,
/// by bisection.
#[must_use]
pub fn t_quantile(probability: f64, n: f64) -> f64 {
    let tail = |t: f64| 0.5 * f_tail(t * t, 1.0, n);
    let (mut low, mut high) = (0.0, 1e3);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if 1.0 - probability < tail(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Return the density of the standard normal distribution.
#[must_use]
pub fn normal_density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
}

/// Return the probability that a standard normal variable is below `x` (Press et al., "Numerical
/// Recipes", 2nd ed., section 6.2, `erfcc`; relative error below 1.2e-7 in the lower tail).
#[must_use]
pub fn normal_cdf(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let z = x.abs() * std::f64::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    let series = COEFFICIENTS.iter().rev().fold(0.0, |sum, coefficient| sum * t + coefficient);
    let tail = 0.5 * t * (series - z * z).exp();
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// Return the quantile of chi-square with `n` degrees of freedom, given the quantile `z` of the
/// standard normal distribution for the same probability. Approximation of Wilson and Hilferty
/// (PNAS 17, 1931); for a 95 % band the error is below 0.4 % of its width from n = 4.
#[must_use]
pub fn chi_square_quantile(z: f64, n: f64) -> f64 {
    let part = 2.0 / (9.0 * n);
    n * (1.0 - part + z * part.sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        // scipy.stats.f.sf and t.ppf
        for (f, k, n, expected) in [
            (4.0, 1.0, 10.0, 0.073_388_034_771),
            (2.5, 3.0, 60.0, 0.068_021_852_180),
            (30.0, 2.0, 78.0, 2.169_727_209_4e-10),
        ] {
            let found = f_tail(f, k, n);
            assert!((found / expected - 1.0).abs() < 1e-8, "{f} {k} {n}: {found}");
        }
        assert!((t_quantile(0.975, 10.0) - 2.228_139).abs() < 1e-5);
        assert!((t_quantile(0.975, 1e6) - 1.959_966).abs() < 1e-4);
    }

    #[test]
    fn normal_and_chi_square_are_those_of_scipy() {
        // scipy.stats.norm.cdf
        for (x, expected) in [
            (-4.0, 3.167_124_183_311_986e-5),
            (-1.0, 0.158_655_253_931_457_05),
            (0.5, 0.691_462_461_274_013_1),
            (3.0, 0.998_650_101_968_369_9),
        ] {
            assert!((normal_cdf(x) / expected - 1.0).abs() < 2e-7, "{x}: {}", normal_cdf(x));
        }
        assert!((normal_density(1.0) - 0.241_970_724_519_143_37).abs() < 1e-15);
        // scipy.stats.chi2.ppf([0.025, 0.975], [4, 400])
        for (n, expected) in
            [(4.0, [0.484_418_557, 11.143_286_78]), (400.0, [346.481_765_4, 457.305_482])]
        {
            for (z, expected) in [-1.959_964, 1.959_964].into_iter().zip(expected) {
                let found = chi_square_quantile(z, n);
                let width = 2.0 * 1.96 * (2.0 * n).sqrt();
                assert!((found - expected).abs() < 4e-3 * width, "{n}: {found}");
            }
        }
    }

    #[test]
    fn the_gamma_function_is_a_factorial() {
        assert!((ln_gamma(6.0) - 120.0_f64.ln()).abs() < 1e-12);
        assert!((ln_gamma(0.5) - std::f64::consts::PI.sqrt().ln()).abs() < 1e-12);
    }
}
