//! The commands that can be swept, and what an engine must know of each.

use super::Metric;
use serde_json::Value;
use strsim::levenshtein;

/// A command whose points can be run.
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

/// Which of two figures is the better one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// An error, a gap.
    Smaller,
    /// A share of games, a rate.
    Larger,
}

impl Better {
    /// As it is typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Smaller => "smaller",
            Self::Larger => "larger",
        }
    }
}

/// What an option of a command takes, as the command line defines it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionKind {
    /// Nothing: it is there or not.
    Flag,
    /// One value.
    One,
    /// Several values in one word, with this character between them.
    Delimited(char),
    /// So many words.
    Words(usize),
}

/// An option of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionSpec {
    /// Its name without dashes.
    pub name: String,
    /// What it takes.
    pub kind: OptionKind,
}

/// Options that belong to the engine, or that make no sense for one point among many.
const RESERVED: [(&str, &str); 19] = [
    ("output", "the sweep decides the output folder"),
    ("out", "the sweep decides the output folder"),
    ("json", "the sweep asks for it itself"),
    ("without-times", "the sweep asks for it itself"),
    ("threads", "its result does not depend on them; use --workers, or --cores on Slurm"),
    ("seed", "write `seeds = 5` or `seeds = [1, 2]` above the first table"),
    ("resume", "an interrupted point is continued by itself"),
    ("overwrite", "a finished point is never run again"),
    ("tensorboard", "all points would write into one folder"),
    ("print-settings", "it does no work"),
    ("ablate", "name history and width in [grid]"),
    ("help", "it does no work"),
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
    /// Every one.
    pub const ALL: [Self; 5] =
        [Self::FitActuator, Self::TuneEkf, Self::Gap, Self::Train, Self::Eval];

    /// As it is typed after `klasktron`.
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

    /// Whether it draws random numbers from `--seed`.
    #[must_use]
    pub fn has_seed(self) -> bool {
        matches!(self, Self::FitActuator | Self::Train | Self::Eval)
    }

    /// Whether it has `--threads`.
    #[must_use]
    pub fn has_threads(self) -> bool {
        self.has_seed()
    }

    /// Why `option` cannot be swept or fixed; `None` when it can.
    #[must_use]
    pub fn reserved(self, option: &str) -> Option<&'static str> {
        if self == Self::Train && option == "seeds" {
            return Some("write `seeds = 5` above the first table");
        }
        RESERVED.iter().find(|(name, _)| *name == option).map(|(_, why)| *why)
    }

    /// Whether `value` of `option` names a file or folder, whose content then belongs to the point.
    #[must_use]
    pub fn is_file(self, option: &str, value: &str) -> bool {
        match (self, option) {
            (Self::Train, "actuator") => value != "ideal",
            (Self::Train, "settings") | (Self::Gap, "twin") | (Self::Eval, "compare") => true,
            _ => false,
        }
    }

    /// Words for one seed, beside `--seed`.
    #[must_use]
    pub fn words_of_one_seed(self) -> &'static [&'static str] {
        match self {
            Self::FitActuator => &["--seeds", "1"],
            _ => &[],
        }
    }

    /// Words that decide no result: how it is printed.
    #[must_use]
    pub fn printing_words(self) -> &'static [&'static str] {
        match self {
            Self::Train => &["--json", "--without-times"],
            _ => &["--json"],
        }
    }

    /// How it goes on with what an interrupted run has left in its folder: the file that must be there,
    /// and the word to add. `None` where every run starts anew.
    #[must_use]
    pub fn continues(self) -> Option<(&'static str, Option<&'static str>)> {
        match self {
            Self::FitActuator => Some(("fits", None)),
            Self::Train => Some(("policy.mcap", Some("--resume"))),
            _ => None,
        }
    }

    /// Whether `result`, the printed document, is of a run that came to its end: Ctrl-C leaves status 3
    /// as well.
    #[must_use]
    pub fn is_complete(self, result: &Value) -> bool {
        match self {
            Self::FitActuator => result["fits_requested"] == result["fits_finished"],
            Self::Train => result["finished"] == true,
            _ => result.is_object(),
        }
    }

    /// The figure that is compared when nobody names one.
    #[must_use]
    pub fn metric(self) -> Metric {
        let (path, title, better) = match self {
            Self::FitActuator => (
                "free_running_rmse_m_per_s.2.median",
                "free-running error over 2 s on held-out runs (m/s)",
                Better::Smaller,
            ),
            Self::TuneEkf => (
                "evaluation.0.velocity_rmse_m_per_s",
                "error of the ball's velocity on held-out runs (m/s)",
                Better::Smaller,
            ),
            Self::Gap => (
                "residuals.*.validation_after/noise_floor",
                "final residual on the validation sessions over the noise floor, mean over signals",
                Better::Smaller,
            ),
            Self::Train => (
                "evaluation.opponents.*.win_rate",
                "share of decided games won, mean over opponents",
                Better::Larger,
            ),
            Self::Eval => {
                ("summary.scoring_rate_per_min.mean", "points per minute of play", Better::Larger)
            }
        };
        Metric { path: path.to_owned(), title: title.to_owned(), better }
    }
}

/// The name among `names` that is nearest to `typed`, when it is near enough to be meant.
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
