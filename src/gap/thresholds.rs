//! Decision thresholds of the search: every value that decides whether an effect is added, an answer refused or a verdict
//! given, each once.
//!
//! Tolerances of solvers, limits of work (iterations, lengths of lists, ranges and steps of grids) and preprocessing
//! constants of a stage stay beside the code that uses them.

use super::{
    evidence::{Amplitude, Blocks},
    options::OptionError,
};
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
    /// parameter over all parameters. The convention of screening. A larger value finds weaker effects and more false ones.
    family_error = 0.01, 1e-9..=0.5, "";
    /// One-sided level of each encompassing test against "no effect", on training and again on validation sessions. A
    /// larger value accepts weaker effects.
    confirmation_level = 1e-3, 1e-9..=0.5, "";
    /// One-sided level at which the better of two effects that explain the same is distinguished from the other. A larger
    /// value lists fewer indistinguishable effects.
    rival_level = 5e-3, 1e-9..=0.5, "";
    /// The same of an effect against itself in proportion to the speed.
    speed_level = 0.01, 1e-9..=0.5, "";
    /// Amplitude of the encompassing test above which the data follow the effect: half-way from "no effect" (0) to the
    /// effect as fitted (1).
    min_amplitude = 0.5, 0.0..=1.0, "";
    /// Amplitude on validation sessions above which the sessions disagree about the size.
    max_amplitude = 3.0, 1.0..=1e9, "";
    /// Amplitude towards "in proportion to the speed" above which an effect does not have its size at every speed; half
    /// of it in training and in validation sessions alone.
    speed_amplitude = 0.25, 0.0..=1e9, "";
    /// Length of the whitened signature at the largest plausible size, in standard deviations, below which the motion
    /// cannot show the effect: what a test at a level of 1e-4 just detects.
    detectability = 5.0, 0.0..=1e9, "";
    /// Fraction of the length of a signature that is left after projection onto the complement of the known parameters,
    /// below which the effect equals a change of them.
    min_independence = 0.02, 0.0..=1.0, "";
    /// Fraction of the best candidate's gain below which another candidate is not simulated.
    screen_gain = 0.1, 0.0..=1.0, "";
    /// Fraction of the best candidate's gain above which one that may be confused with it is fitted until convergence.
    rival_gain = 0.8, 0.0..=1.0, "";
    /// Difference of two squared whitened residuals below which two fits are equal: two standard deviations of one sample.
    equal_fit = 4.0, 0.0..=1e9, "";
    /// Squared distance of two predictions, as a fraction of the squared change, below which they are equal.
    equal_prediction = 1e-4, 0.0..=1.0, "";
    /// Fraction of the best candidate's gain that a simpler one must reach to go before it.
    simpler_gain = 0.98, 0.0..=1.0, "";
    /// Squared cosine of two changes of the prediction above which both explain the same.
    same_change = 0.5, 0.0..=1.0, "";
    /// Ratio of the closed fractions of the plain residual from which another effect goes before the most significant one.
    stronger_ratio = 1.5, 1.0..=1e9, "";
    /// Ratio of the gain in one signal to that in all signals that counts the same.
    single_signal_ratio = 4.0, 1.0..=1e9, "";
    /// Gain (fraction of the squared validation residual) below which an effect is within the model error of the simulation.
    min_gain = 0.02, 0.0..=1.0, "";
    /// The same of an effect whose bias on the reference data of a twin is known.
    min_gain_known = 0.03, 0.0..=1.0, "";
    /// The same where the residual is at its reference, or the effect is smaller than plausible.
    min_gain_at_reference = 0.1, 0.0..=1.0, "";
    /// The same of an effect that maps positions and simulates nothing.
    min_gain_map = 0.005, 0.0..=1.0, "";
    /// Multiple of the bias on reference data that an effect must exceed.
    bias_ratio = 3.0, 0.0..=1e9, "";
    /// Fraction of the gain of all effects added before that an effect must reach on a known machine.
    relative_gain = 0.1, 0.0..=1.0, "";
    /// Fraction by which a squared residual may exceed its reference and still be at it.
    reference_excess = 0.05, 0.0..=1e9, "";
    /// Fraction by which a squared residual may be below its reference on the motion of the reference.
    other_motion = 0.05, 0.0..=1.0, "";
    /// Fraction of the squared reference residual that another motion moves from one signal to another at most.
    moved_residual = 0.15, 0.0..=1.0, "";
    /// Fraction by which the squared residual must exceed its reference to be a disturbance that depends on nothing measured.
    disturbance_excess = 0.3, 0.0..=1e9, "";
    /// The same for a multistart of the known parameters.
    restart_excess = 0.44, 0.0..=1e9, "";
    /// Fraction of the loss below which the fit of another start replaces the first.
    restart_loss = 0.9, 0.0..=1.0, "";
    /// Fraction of the loss of the best candidate below which a split of a known parameter goes before it.
    split_loss = 0.9, 0.0..=1.0, "";
    /// Effects that are added to one stage of a machine with reference residuals.
    max_effects_known = 4.0, 0.0..=6.0, "";
    /// Fraction of the squared whitened residual that an unexplained dependence must hold.
    min_dependence = 0.05, 0.0..=1.0, "";
    /// Fraction of an unexplained dependence that validation sessions must repeat.
    repeated_dependence = 0.3, 0.0..=1.0, "";
    /// Ratio of residual and noise floor up to which a residual is at its floor. Floors come from the measured signal
    /// alone and are low where the noise is coloured. A larger value answers `none` where more is left.
    floor_ratio = 1.5, 1.0..=1e9, "";
    /// Relative change of a fitted parameter that indicates another machine.
    machine_change = 0.25, 0.0..=1e9, "";
    /// Parameters that change so much together in another machine.
    machine_changes = 4.0, 0.0..=1e9, "";
    /// Relative change of a known parameter below which it is not reported.
    min_change = 0.002, 0.0..=1.0, "";
    /// Relative standard error of every change that belongs to the simulation (type B, JCGM 100, section 4.3).
    model_error = 0.025, 0.0..=1.0, "";
    /// Distance of a sample from its neighbours, over the usual distance, above which it is an outlier of the sensor.
    outlier_ratio = 8.0, 1.0..=1e9, "";
    /// Fraction of the squared residual of all sessions that one-off disturbances must hold.
    disturbed_fraction = 0.5, 0.0..=2.0, "";
    /// Ratio of a one-off disturbance to the largest residual elsewhere.
    disturbed_ratio = 10.0, 1.0..=1e9, "";
    /// Ratio of the bins beside a one-off disturbance that belong to it to the median.
    disturbed_edge_ratio = 10.0, 1.0..=1e9, "";
    /// Longest one-off disturbance.
    disturbed_time = 1.5, 0.0..=1e9, "s";
    /// Ratio of two standard deviations of the camera from which its noise changed.
    noise_ratio = 1.15, 1.0..=1e9, "";
    /// Standard deviation of time stamps from which they jitter.
    min_jitter = 1e-4, 0.0..=1.0, "s";
    /// Change of the fraction of lost frames that counts.
    min_lost = 0.005, 0.0..=1.0, "";
    /// Fraction of the residual above its reference for which measurement noise must account.
    noise_fraction = 0.5, 0.0..=1.0, "";
    /// Stiffness of a spring, over that of the ends of a backlash beside it, below which it is none.
    end_stiffness_ratio = 2.0, 0.0..=1e9, "";
    /// Time of all runs below which nothing is compared.
    min_time = 4.0, 0.0..=1e9, "s";
    /// Samples in motion of a single axis below which nothing is compared.
    min_samples = 40.0, 0.0..=1e9, "";
    /// Fraction of the motion that each direction needs.
    min_direction = 0.05, 0.0..=0.5, "";
    /// Standard deviation of the input within the runs, over its RMS, below which it does not vary.
    min_variation = 0.02, 0.0..=1.0, "";
    /// Speed of a motor over the commanded speed (RMS) below which it does not follow.
    min_motion = 0.05, 0.0..=1.0, "";
    /// Fraction of the variance of the motion that the delayed command must explain.
    min_explained_motion = 0.1, 0.0..=1.0, "";
    /// Fraction of the variance of a single axis' input that the motion must explain.
    min_explained_input = 0.05, 0.0..=1.0, "";
    /// The same where the inertia would be negative.
    min_explained_reversed = 0.5, 0.0..=1.0, "";
    /// Fraction of the variance of the input that belongs to a negative inertia.
    min_inertia = 0.1, 0.0..=1.0, "";
    /// Fraction of the samples that a twin must predict.
    min_predicted = 0.5, 0.0..=1.0, "";
    /// Command below which a motor stands.
    standing_speed = 0.005, 0.0..=1.0, "m/s";
    /// Spread of the striker below which the latency of its frames is not estimated.
    min_spread = 0.005, 0.0..=1.0, "m";
    /// Change of the delay during a session from which the clocks drift.
    clock_drift = 0.1, 0.0..=1e9, "s";
    /// Rate of that change.
    clock_rate = 2e-3, 0.0..=1e9, "";
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

    /// Whether the data follow a change of the residual from `before` to `after` beyond chance, and are better off with
    /// it than without.
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
            "'min_gian' is no threshold; similar: min_gain, min_gain_map, min_change"
        );
        assert_eq!(said("min_gain=2"), "min_gain is 2; allowed are 0 to 1");
        assert!(said("min_gain=NaN").starts_with("min_gain is NaN; allowed are"));
        for text in ["min_gain", "min_gain=", "min_gain=x"] {
            assert!(said(text).contains("write NAME=VALUE"), "{text}");
        }
    }

    #[test]
    fn every_default_is_in_its_range_and_every_name_is_unique() {
        for (index, own) in Thresholds::TABLE.iter().enumerate() {
            assert!(own.range.contains(&own.default), "{}", own.name);
            assert!(Thresholds::TABLE[..index].iter().all(|other| other.name != own.name));
        }
    }
}
