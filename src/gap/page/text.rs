//! Numbers, labels and sentences of the page.

/// `value` with `count` significant digits, with a power of ten where that is shorter.
pub(in crate::gap) fn digits(value: f64, count: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    let count = count.max(1) as i32;
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.*e}", (count - 1) as usize);
    }
    let decimals = (count - 1 - size.log10().floor() as i32).max(0);
    format!("{value:.*}", decimals as usize)
}

/// `value` with three significant digits.
pub(in crate::gap) fn number(value: f64) -> String {
    digits(value, 3)
}

/// Probability.
pub(in crate::gap) fn probability(value: f64) -> String {
    if value.is_finite() && value < 1e-99 {
        "< 1e-99".to_owned()
    } else if (0.01..).contains(&value) {
        format!("{value:.2}")
    } else {
        digits(value, 2)
    }
}

/// Fraction as a percentage.
pub(in crate::gap) fn percent(fraction: f64) -> String {
    let value = 100.0 * fraction;
    if 9.95 < value.abs() || value == 0.0 {
        format!("{value:.0} %")
    } else {
        format!("{value:.1} %")
    }
}

/// Value and interval with as many digits as the interval supports.
pub(in crate::gap) fn with_interval(value: f64, interval: Option<[f64; 2]>) -> [String; 2] {
    let Some([low, high]) = interval else { return [number(value), "–".to_owned()] };
    let half = 0.5 * (high - low);
    if !(half.is_finite() && 0.0 < half) {
        return [number(value), "–".to_owned()];
    }
    // Two digits of the half width, and at least one of the value.
    let place = 1 - half.log10().floor() as i32;
    let written = |value: f64| {
        if (0..=5).contains(&place) {
            format!("{value:.*}", place as usize)
        } else {
            let before = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
            digits(value, (place + before + 1).clamp(1, 9) as usize)
        }
    };
    [written(value), format!("{} to {}", written(low), written(high))]
}

/// `sentence` with a capital at its start and a stop at its end.
pub(in crate::gap) fn sentence(text: &str) -> String {
    let mut characters = text.trim().chars();
    let first = characters.next().into_iter().flat_map(char::to_uppercase);
    let mut written: String = first.chain(characters).collect();
    if !written.is_empty() && !written.ends_with(['.', '!', '?']) {
        written.push('.');
    }
    written
}

/// Factor from `unit` to the unit of the page, and that unit.
pub(in crate::gap) fn shown_unit(unit: &str) -> (f64, String) {
    match unit {
        "m" | "m/s" | "rad" | "rad/s" => (1e3, format!("m{unit}")),
        "N m" => (1e3, "mN m".to_owned()),
        "" => (1.0, "1".to_owned()),
        other => (1.0, other.to_owned()),
    }
}

/// Units at the end of parameter names.
const UNITS: [&str; 16] = [
    "m", "s", "n", "kg", "hz", "rad", "deg", "per", "s2", "m2", "s3", "nm", "a", "v", "turn",
    "turns",
];

/// Name of a parameter or a regressor as text: `unknown.speed[above 1 m/s]` is `speed (above 1 m/s)`, and the unit at
/// the end of `delay_s` is left out.
pub(in crate::gap) fn label(name: &str) -> String {
    let (is_regressor, name) = match name.strip_prefix("unknown.") {
        Some(name) => (true, name),
        None => (false, name),
    };
    let (words, band) = name.split_once('[').unwrap_or((name, ""));
    let words: Vec<&str> = words.split('_').collect();
    let is_unit = |word: &&&str| UNITS.contains(*word);
    let units = words.iter().rev().take_while(is_unit).count().min(words.len() - 1);
    let words = match words[..words.len() - units] {
        [ref signal @ .., "own"] if is_regressor => signal.join(" "),
        [ref signal @ .., "size"] if is_regressor => format!("magnitude of {}", signal.join(" ")),
        [ref signal @ .., "slope"] if is_regressor => format!("rate of {}", signal.join(" ")),
        ref all => all.join(" "),
    };
    match band.trim_end_matches(']') {
        "" => words,
        band => format!("{words} ({band})"),
    }
}

/// Predicate of a residual that follows the regressor `name`: `depends on speed (above 1 m/s)`, or `lies at 2.00 Hz` for
/// a regressor of time.
pub(in crate::gap) fn dependence(name: &str) -> String {
    let Some(band) = name.strip_prefix("unknown.time[") else {
        return format!("depends on {}", label(name));
    };
    let band = band.trim_end_matches(']');
    let preposition = if band.contains(" to ") { "from" } else { "at" };
    format!("lies {preposition} {band}, and follows no measured quantity")
}

/// `1 run`, `2 runs`.
pub(in crate::gap) fn count(number: usize, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_as_many_digits_as_the_interval_supports() {
        let texts = [0.0, 12.345, 1234.5, -0.001_234, 1e-7, f64::NAN].map(number);
        assert_eq!(texts, ["0", "12.3", "1234", "-0.00123", "1.00e-7", "–"]);
        assert_eq!(with_interval(0.123_456, Some([0.12, 0.127])), ["0.1235", "0.1200 to 0.1270"]);
        assert_eq!(with_interval(2.5, None), ["2.50", "–"]);
        assert_eq!(with_interval(1234.0, Some([1000.0, 1500.0]))[0], "1234");
        assert_eq!([0.5, 2e-5, 0.0].map(probability), ["0.50", "2.0e-5", "< 1e-99"]);
        assert_eq!([0.123, 0.0123, 1.0].map(percent), ["12 %", "1.2 %", "100 %"]);
    }

    #[test]
    fn small_intervals_have_powers_of_ten() {
        let found = with_interval(4.24e-6, Some([1.24e-6, 7.24e-6]));
        assert_eq!(found, ["4.2e-6", "1.2e-6 to 7.2e-6"]);
    }

    #[test]
    fn a_residual_depends_on_a_quantity_or_lies_in_a_band() {
        assert_eq!(dependence("unknown.speed[above 1 m/s]"), "depends on speed (above 1 m/s)");
        let bands = ["unknown.time[2.00 Hz]", "unknown.time[0.3 to 2.0 Hz]"].map(dependence);
        let wanted = ["lies at 2.00 Hz", "lies from 0.3 to 2.0 Hz"];
        assert_eq!(bands, wanted.map(|own| format!("{own}, and follows no measured quantity")));
    }

    #[test]
    fn names_become_labels() {
        let names = ["delay_s", "limit_m_per_s2", "m", "unknown.speed[above 1 m/s]", "mass_kg"];
        let labels = ["delay", "limit", "m", "speed (above 1 m/s)", "mass"];
        assert_eq!(names.map(label), labels);
        let names = ["force_own[0 to 1]", "y_size[0 to 1]", "x_slope[0 to 1]"];
        let labels = ["force (0 to 1)", "magnitude of y (0 to 1)", "rate of x (0 to 1)"];
        assert_eq!(names.map(|name| label(&format!("unknown.{name}"))), labels);
    }

    #[test]
    fn sentences_begin_and_end() {
        assert_eq!(sentence("the data are short"), "The data are short.");
        assert_eq!(sentence("Done."), "Done.");
    }
}
