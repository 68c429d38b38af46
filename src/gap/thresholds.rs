//! Decision thresholds of the search: every value that decides whether an effect is added, an answer refused or a
//! verdict given, each once.
//!
//! Tolerances of solvers, limits of work (iterations, lengths of lists, ranges and steps of grids) and preprocessing
//! constants of a stage are defined in the code that uses them.

use super::{
    evidence::{Amplitude, Blocks},
    options::OptionError,
};
use crate::twin::Machine;
use std::{fmt, ops::RangeInclusive, str::FromStr};
use strsim::jaro_winkler;

/// One entry of the table of thresholds.
#[derive(Debug, Clone)]
pub struct Threshold {
    /// Name, as in `--threshold NAME=VALUE`.
    pub name: &'static str,
    /// Default.
    pub default: f64,
    /// Allowed values.
    pub range: RangeInclusive<f64>,
    /// Unit; empty for a ratio, a fraction or a probability.
    pub unit: &'static str,
}

/// Declares [`Thresholds`] and its table.
macro_rules! thresholds {
    ($($(#[$doc:meta])* $name:ident = $default:literal, $low:literal..=$high:literal, $unit:literal;)*) => {
        /// Values of all thresholds.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Thresholds {
            $($(#[$doc])* pub $name: f64,)*
        }

        impl Thresholds {
            /// The defaults.
            pub const DEFAULT: Self = Self { $($name: $default,)* };

            /// Name, default, range and unit of each threshold, in the order of the fields.
            pub const TABLE: &'static [Threshold] = &[
                $(Threshold {
                    name: stringify!($name),
                    default: $default,
                    range: $low..=$high,
                    unit: $unit,
                },)*
            ];

            /// All values, in the order of the table.
            fn values(&mut self) -> Vec<&mut f64> {
                vec![$(&mut self.$name,)*]
            }
        }
    };
}

thresholds! {
    /// Family-wise error: probability of a false effect over all comparisons of one screen (Bonferroni), and of a changed
    /// parameter over all parameters (`--alpha`). The convention of screening. A larger value finds weaker effects and more
    /// false ones.
    family_error = 0.01, 1e-9..=0.5, "";
    /// One-sided level of each encompassing test: an effect against none on training and again on validation sessions, and
    /// the better of two rivals against the other. Three standard deviations. A larger value accepts weaker effects and
    /// lists fewer indistinguishable ones.
    confirmation_level = 1e-3, 1e-9..=0.5, "";
    /// Amplitude of the encompassing test above which the data follow a change: half-way from "no effect" (0) to the effect
    /// as fitted (1), so that the nearer one is right. Half of it shows that an effect is rather in proportion to the speed.
    min_amplitude = 0.5, 0.0..=1.0, "";
    /// Ratio of two magnitudes from which they differ clearly. It compares an effect on validation and on training
    /// sessions, an effect with its bias on the reference data, and a spring with the ends of a backlash. A larger
    /// value trusts differences of the sessions and small effects less.
    size_ratio = 3.0, 1.0..=1e9, "";
    /// Length of the whitened signature at the largest plausible magnitude, in standard deviations, below which the
    /// motion cannot show the effect. A test at a level of 1e-4 just detects this length.
    detectability = 5.0, 0.0..=1e9, "";
    /// Squared distance of two predictions, as a fraction of the squared change, below which they are equal: a hundredth of
    /// an effect is beyond what a simulator follows. A larger value calls more effects indistinguishable.
    equal_prediction = 1e-4, 0.0..=1.0, "";
    /// Fraction that is most of a quantity. It applies to the squared cosine of two changes that
    /// explain the same, the residual of one-off disturbances or measurement noise, and the samples
    /// that a twin predicts. It also applies to the gain that a rival has in common, and to the
    /// residual that an effect above the floor, one more effect of a single axis below it, another
    /// distribution of lags or a refit explains.
    majority = 0.5, 0.0..=1.0, "";
    /// Ratio of the closed fractions of the plain residual from which another effect precedes the most significant one.
    stronger_ratio = 1.5, 1.0..=1e9, "";
    /// Ratio of the gain in one signal to that in all signals that counts the same: most signals do not show most effects.
    single_signal_ratio = 4.0, 1.0..=1e9, "";
    /// Gain (fraction of the squared validation residual) within the model error of the simulation. It is also a fraction of
    /// what the effects of a table removed that were added before, and the decrease of the squared training residual by a
    /// multistart near the reference. A larger value rejects small effects, prefers simple ones, and keeps more first fits.
    min_gain = 0.02, 0.0..=1.0, "";
    /// The same where the model error is larger. The residual is at its reference (of the squared reference), the
    /// effect is smaller than plausible, or a multistart or a split replaces a fit.
    clear_gain = 0.1, 0.0..=1.0, "";
    /// The same of an effect that maps positions and simulates nothing, so that only noise limits it.
    min_gain_map = 0.005, 0.0..=1.0, "";
    /// Fraction by which a squared residual may differ from its reference on the same motion: sampling. An unexplained
    /// dependence must hold as much, and an effect of a single axis at its floor as much of the squared floor.
    reference_excess = 0.05, 0.0..=1e9, "";
    /// Fraction of the squared reference residual that another motion moves from one signal to another at most.
    moved_residual = 0.15, 0.0..=1.0, "";
    /// Fraction by which a squared residual is far above its reference: a disturbance that depends on no measured
    /// quantity, a multistart, a change of the measurement noise. Least gain of an effect on
    /// a single axis that is at its floor.
    large_excess = 0.3, 0.0..=1e9, "";
    /// Ratio of residual and noise floor up to which a residual is at its floor. Floors contain white noise
    /// alone and are low where the noise is coloured. A larger value answers `none` with a larger residual.
    floor_ratio = 1.5, 1.0..=1e9, "";
    /// Relative change of a fitted parameter that indicates another machine.
    machine_change = 0.25, 0.0..=1e9, "";
    /// Parameters that change so much together in another machine.
    machine_changes = 4.0, 0.0..=1e9, "";
    /// Relative standard error of every change due to the simulation (type B, JCGM 100, section 4.3): errors of 234
    /// blind cases of another simulator beyond their standard errors (`reports/2026-11-23-gap-unseen`). As a fraction of the
    /// input, part of the noise floor of a single axis.
    model_error = 0.025, 0.0..=1.0, "";
    /// Ratio from which a value is an outlier: a sample over the usual distance of neighbours, a one-off disturbance over the
    /// largest residual elsewhere.
    outlier_ratio = 10.0, 1.0..=1e9, "";
    /// Longest one-off disturbance.
    disturbed_time = 1.5, 0.0..=1e9, "s";
    /// Time of all runs of a table below which nothing is compared.
    min_time = 4.0, 0.0..=1e9, "s";
    /// Samples in motion of a single axis below which nothing is compared.
    min_samples = 40.0, 0.0..=1e9, "";
    /// Least fraction of the motion in each direction, of the commanded speed that a motor moves,
    /// and of the variance that input or motion explain. Also the least fraction of the input's RMS
    /// that varies.
    min_fraction = 0.05, 0.0..=0.5, "";
    /// Change of the latency within 50 s, or within a shorter session, from which the clocks drift. Other motion
    /// changes it by some hundredths, and the worst crystals by a quarter of this.
    clock_drift = 0.1, 0.0..=1e9, "s";
}

/// Number of similar names that an error lists.
const SIMILAR: usize = 3;

/// Threshold with the value that it gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThresholdValue {
    /// Index in the table.
    index: usize,
    value: f64,
}

impl FromStr for ThresholdValue {
    type Err = OptionError;

    fn from_str(text: &str) -> Result<Self, OptionError> {
        let syntax = || OptionError::ThresholdSyntax { text: text.to_owned() };
        let (name, value) = text.split_once('=').ok_or_else(syntax)?;
        let (name, value) = (name.trim(), value.trim().parse::<f64>().map_err(|_| syntax())?);
        let index = Thresholds::TABLE.iter().position(|own| own.name == name);
        let index = index.ok_or_else(|| OptionError::UnknownThreshold {
            name: name.to_owned(),
            similar: similar(name),
        })?;
        let Threshold { range, unit, .. } = &Thresholds::TABLE[index];
        match range.contains(&value) {
            true => Ok(Self { index, value }),
            false => Err(OptionError::OutOfBounds {
                name: name.to_owned(),
                value,
                bounds: (*range.start(), *range.end()),
                unit,
            }),
        }
    }
}

impl fmt::Display for ThresholdValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", Thresholds::TABLE[self.index].name, self.value)
    }
}

/// Names of the thresholds most similar to `name`.
fn similar(name: &str) -> Vec<&'static str> {
    let mut names: Vec<&'static str> = Thresholds::TABLE.iter().map(|own| own.name).collect();
    names.sort_by(|a, b| jaro_winkler(name, b).total_cmp(&jaro_winkler(name, a)));
    names.truncate(SIMILAR);
    names
}

impl Thresholds {
    /// The same with `values`.
    #[must_use]
    pub fn with(mut self, values: &[ThresholdValue]) -> Self {
        for own in values {
            *self.values()[own.index] = own.value;
        }
        self
    }

    /// Values other than the default.
    pub(super) fn changes(mut self) -> Vec<ThresholdValue> {
        let all = self.values().into_iter().zip(Self::TABLE).enumerate();
        all.filter(|(_, (value, own))| **value != own.default)
            .map(|(index, (value, _))| ThresholdValue { index, value: *value })
            .collect()
    }

    /// Fraction of a squared change by which the simulation of `machine` may err. A table is simulated; on a single
    /// axis, the input follows from the measured motion.
    pub(super) fn model_error_of(&self, machine: Machine) -> f64 {
        match machine {
            Machine::Table => self.min_gain,
            Machine::Axis => self.model_error.powi(2),
        }
    }

    /// Return whether the data follow a change of the residual from `before` to `after` beyond chance, and are
    /// predicted better with it.
    pub(super) fn is_in(&self, before: &[f64], after: &[f64], blocks: &Blocks) -> bool {
        let amplitude = Amplitude::of(before, after, blocks);
        self.min_amplitude < amplitude.value && amplitude.is_above(0.0, self.confirmation_level)
    }
}

impl Default for Thresholds {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<ThresholdValue, String> {
        text.parse().map_err(|error: OptionError| error.to_string())
    }

    #[test]
    fn a_threshold_is_set_by_name_and_only_changes_are_listed() {
        let value = parsed("min_gain = 0.04").unwrap();
        assert_eq!(value.to_string(), "min_gain=0.04");
        let thresholds = Thresholds::DEFAULT.with(&[value]);
        assert_eq!(thresholds, Thresholds { min_gain: 0.04, ..Thresholds::DEFAULT });
        assert_eq!(thresholds.changes(), [value]);
        assert_eq!(Thresholds::DEFAULT.with(&[parsed("min_gain=0.02").unwrap()]).changes(), []);
    }

    #[test]
    fn a_wrong_threshold_is_refused_in_one_sentence() {
        let said = |text: &str| parsed(text).unwrap_err();
        assert_eq!(
            said("min_gian=1"),
            "'min_gian' is no threshold; similar: min_gain, min_gain_map, min_fraction"
        );
        assert_eq!(said("min_gain=2"), "min_gain is 2; allowed are 0 to 1");
        assert!(said("min_gain=NaN").starts_with("min_gain is NaN; allowed are"));
        for text in ["min_gain", "min_gain=", "min_gain=x"] {
            assert!(said(text).contains("write NAME=VALUE"), "{text}");
        }
    }

    #[test]
    fn there_are_at_most_25_thresholds() {
        assert!(Thresholds::TABLE.len() <= 25, "{}", Thresholds::TABLE.len());
    }

    #[test]
    fn the_documentation_lists_every_threshold_with_its_default() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/gap.md");
        let page = std::fs::read_to_string(path).unwrap();
        let section = page.split("## Thresholds").nth(1).unwrap().split("\n## ").next().unwrap();
        let rows = section.lines().filter(|line| line.starts_with("| `"));
        let listed: Vec<String> =
            rows.map(|row| row.split('|').take(3).collect::<Vec<_>>().join("|")).collect();
        let own = |own: &Threshold| {
            let unit = if own.unit.is_empty() { String::new() } else { format!(" {}", own.unit) };
            format!("| `{}` | {}{unit} ", own.name, own.default)
        };
        assert_eq!(listed, Thresholds::TABLE.iter().map(own).collect::<Vec<_>>());
    }

    #[test]
    fn every_default_is_in_its_range_and_every_name_is_unique() {
        for (index, own) in Thresholds::TABLE.iter().enumerate() {
            assert!(own.range.contains(&own.default), "{}", own.name);
            assert!(Thresholds::TABLE[..index].iter().all(|other| other.name != own.name));
        }
    }
}
