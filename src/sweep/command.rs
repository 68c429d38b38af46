//! Commands that support sweeps, with the properties that an engine needs.

use super::Metric;
use serde_json::Value;
use strsim::levenshtein;

/// A command that supports sweeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweptCommand {
    /// `klasktron fit-actuator`
    FitActuator,
    /// `klasktron tune-ekf`
    TuneEkf,
    /// `klasktron gap`
    Gap,
    /// `klasktron train`
    Train,
    /// `klasktron eval`
    Eval,
}

/// Direction of a metric.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// Smaller is better: an error.
    Smaller,
    /// Larger is better: a rate.
    Larger,
}

impl Better {
    /// Name as typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Smaller => "smaller",
            Self::Larger => "larger",
        }
    }
}

/// Arguments of an option, as defined by the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionKind {
    /// No argument: a flag.
    Flag,
    /// One value.
    One,
    /// Several values in one word, separated by this character.
    Delimited(char),
    /// This number of words.
    Words(usize),
}

/// An option of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionSpec {
    /// Name without dashes.
    pub name: String,
    /// Arguments.
    pub kind: OptionKind,
}

/// Options that belong to the engine, or that make no sense for a point of a sweep.
const RESERVED: [(&str, &str); 19] = [
    ("output", "the sweep sets the output folder"),
    ("out", "the sweep sets the output folder"),
    ("json", "the sweep sets it"),
    ("without-times", "the sweep sets it"),
    ("threads", "results do not depend on it; use --workers, or --cores on Slurm"),
    ("seed", "write `seeds = 5` or `seeds = [1, 2]` above the first table"),
    ("resume", "an interrupted point is resumed automatically"),
    ("overwrite", "a finished point is never run again"),
    ("tensorboard", "all points would write into one folder"),
    ("print-settings", "it runs nothing"),
    ("ablate", "list history and width in [grid]"),
    ("help", "it runs nothing"),
    ("engine", SWEEPS_OWN),
    ("partition", SWEEPS_OWN),
    ("time", SWEEPS_OWN),
    ("cores", SWEEPS_OWN),
    ("mem", SWEEPS_OWN),
    ("sbatch-line", SWEEPS_OWN),
    ("retry", SWEEPS_OWN),
];

const SWEEPS_OWN: &str = "it is an option of the sweep itself";

impl SweptCommand {
    /// All commands.
    pub const ALL: [Self; 5] =
        [Self::FitActuator, Self::TuneEkf, Self::Gap, Self::Train, Self::Eval];

    /// Name as typed after `klasktron`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FitActuator => "fit-actuator",
            Self::TuneEkf => "tune-ekf",
            Self::Gap => "gap",
            Self::Train => "train",
            Self::Eval => "eval",
        }
    }

    /// The command called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|command| command.name() == name)
    }

    /// Return whether the command draws random numbers from `--seed`.
    #[must_use]
    pub fn has_seed(self) -> bool {
        matches!(self, Self::FitActuator | Self::Train | Self::Eval)
    }

    /// Return whether the command has `--threads`.
    #[must_use]
    pub fn has_threads(self) -> bool {
        self.has_seed() || self == Self::Gap
    }

    /// Reason why `option` cannot be swept or fixed; `None` if it can.
    #[must_use]
    pub fn reserved(self, option: &str) -> Option<&'static str> {
        if self == Self::Train && option == "seeds" {
            return Some("write `seeds = 5` above the first table");
        }
        RESERVED.iter().find(|(name, _)| *name == option).map(|(_, why)| *why)
    }

    /// Return whether `value` of `option` is a file or folder, whose content then belongs to the
    /// point.
    #[must_use]
    pub fn is_file(self, option: &str, value: &str) -> bool {
        match (self, option) {
            (Self::Train, "actuator") => value != "ideal",
            (Self::Train, "settings") | (Self::Gap, "twin") | (Self::Eval, "compare") => true,
            _ => false,
        }
    }

    /// Words for a single seed, in addition to `--seed`.
    #[must_use]
    pub fn words_of_one_seed(self) -> &'static [&'static str] {
        match self {
            Self::FitActuator => &["--seeds", "1"],
            _ => &[],
        }
    }

    /// Words that affect only the output format.
    #[must_use]
    pub fn printing_words(self) -> &'static [&'static str] {
        match self {
            Self::Train => &["--json", "--without-times"],
            _ => &["--json"],
        }
    }

    /// Required file and additional word for resuming an interrupted run in its folder; `None` for a
    /// command that starts anew.
    #[must_use]
    pub fn continues(self) -> Option<(&'static str, Option<&'static str>)> {
        match self {
            Self::FitActuator => Some(("fits", None)),
            Self::Train => Some(("policy.mcap", Some("--resume"))),
            _ => None,
        }
    }

    /// Return whether `result`, the printed document, is that of a complete run; Ctrl-C also gives
    /// status 3.
    #[must_use]
    pub fn is_complete(self, result: &Value) -> bool {
        match self {
            Self::FitActuator => result["fits_requested"] == result["fits_finished"],
            Self::Train => result["finished"] == true,
            _ => result.is_object(),
        }
    }

    /// Default metric.
    #[must_use]
    pub fn metric(self) -> Metric {
        let (path, title, better) = match self {
            Self::FitActuator => (
                "free_running_rmse_m_per_s.2.median",
                "free-running error over 2 s on validation runs (m/s)",
                Better::Smaller,
            ),
            Self::TuneEkf => (
                "evaluation.0.velocity_rmse_m_per_s",
                "RMS error of the ball's velocity on validation runs (m/s)",
                Better::Smaller,
            ),
            Self::Gap => (
                "residuals.*.validation_after/noise_floor",
                "final residual on the validation sessions over the noise floor, mean over signals",
                Better::Smaller,
            ),
            Self::Train => (
                "evaluation.opponents.*.win_rate",
                "win rate of decided games, mean over opponents",
                Better::Larger,
            ),
            Self::Eval => {
                ("summary.scoring_rate_per_min.mean", "goals per minute of play", Better::Larger)
            }
        };
        Metric { path: path.to_owned(), title: title.to_owned(), better }
    }
}

/// Element of `names` that is nearest to `typed`, if near enough to be meant.
#[must_use]
pub fn nearest<'a>(typed: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let near = |name: &&str| levenshtein(typed, name) <= 1 + typed.chars().count() / 4;
    names.filter(near).min_by_key(|name| levenshtein(typed, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_finds_its_word_and_nonsense_finds_none() {
        let names = || SweptCommand::ALL.into_iter().map(SweptCommand::name);
        assert_eq!(nearest("fit-actuater", names()), Some("fit-actuator"));
        assert_eq!(nearest("trian", names()), Some("train"));
        assert_eq!(nearest("collect", names()), None);
    }

    #[test]
    fn an_interrupted_run_is_not_whole() {
        let fit = serde_json::json!({"fits_requested": 2, "fits_finished": 1});
        assert!(!SweptCommand::FitActuator.is_complete(&fit));
        assert!(!SweptCommand::Train.is_complete(&serde_json::json!({"finished": false})));
        assert!(SweptCommand::Eval.is_complete(&serde_json::json!({})));
    }
}
