//! Search of `gap` and `calibrate`: its options and its progress.

use super::{note, terminal};
use indicatif::{ProgressBar, ProgressStyle};
use klasktron::{
    effects::{Effect, EffectsFileError, read_effects},
    gap::{
        Context, FixedParameter, OptionError, SearchObserver, SearchOptions, SearchStep,
        ThresholdValue, Thresholds,
    },
    parallel,
    twin::{Mask, Session, SessionOptions, StageKind, Twin},
};
use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Duration,
};

/// Time between two redraws of the elapsed time.
const TICK: Duration = Duration::from_millis(250);

/// Options of the search.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Search")]
pub(crate) struct SearchArgs {
    /// Search the effects that this TOML file defines as well, and before the options that name them (repeatable)
    #[arg(long, value_name = "FILE", value_parser = parse_effects)]
    effects: Vec<EffectsFile>,
    /// Search only this effect or group, such as drive.friction (repeatable); `calibrate` fits only these
    #[arg(long, value_name = "EFFECT", value_parser = parse_effect)]
    only: Vec<String>,
    /// Leave this effect or group out of the search (repeatable)
    #[arg(long, value_name = "EFFECT", value_parser = parse_effect)]
    exclude: Vec<String>,
    /// Use a known value, which is never fitted (repeatable)
    #[arg(long, value_name = "EFFECT.PARAMETER=VALUE")]
    fix: Vec<FixedParameter>,
    /// Family-wise error of the search: probability of a false effect per screen
    #[arg(long, value_name = "PROBABILITY", default_value_t = Thresholds::DEFAULT.family_error, value_parser = parse_alpha)]
    alpha: f64,
    /// Set a threshold of the search, for ablation studies (repeatable)
    #[arg(long, value_name = "NAME=VALUE", hide = true)]
    threshold: Vec<ThresholdValue>,
    /// Exclude a time (s) of one session or of all from fits and metrics (repeatable)
    #[arg(long, value_name = "[SESSION:]FROM..TO")]
    mask: Vec<Mask>,
    /// Hold out this session for validation, by name or file; a file that is not among the recordings is read as well
    /// (repeatable)
    #[arg(long, value_name = "SESSION")]
    validation: Vec<String>,
    /// Threads; the result does not depend on their number [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
}

/// File of effects that the user defined.
#[derive(Debug, Clone)]
struct EffectsFile {
    path: String,
    effects: Vec<&'static Effect>,
}

fn parse_effects(text: &str) -> Result<EffectsFile, EffectsFileError> {
    Ok(EffectsFile { path: text.to_owned(), effects: read_effects(Path::new(text))? })
}

fn parse_effect(text: &str) -> Result<String, OptionError> {
    SearchOptions::check_name(text).map(|()| text.to_owned())
}

fn parse_alpha(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(alpha) if 0.0 < alpha && alpha <= 0.5 => Ok(alpha),
        _ => Err("must be a probability above 0 and at most 0.5".to_owned()),
    }
}

impl SearchArgs {
    /// The `recordings`, and the files that only `--validation` names.
    pub(super) fn all_of(&self, recordings: &[PathBuf]) -> Vec<PathBuf> {
        let named = self.validation.iter().map(PathBuf::from);
        let others = named.filter(|path| path.is_file() && !recordings.contains(path));
        recordings.iter().cloned().chain(others).collect()
    }

    /// Options of the sessions.
    pub(super) fn of_sessions(&self) -> SessionOptions {
        SessionOptions { validation: self.validation.clone(), masks: self.mask.clone() }
    }

    /// Options of the search on the machine of `sessions`; limits the threads as well.
    pub(super) fn of_search(&self, sessions: &[Session]) -> Result<SearchOptions, OptionError> {
        if let Some(threads) = self.threads {
            parallel::limit_threads(threads);
        }
        let defined = self.effects.iter().flat_map(|file| file.effects.iter().copied()).collect();
        let options =
            SearchOptions::default().with_effects(defined).select(&self.only, &self.exclude)?;
        let machine = Twin::nominal_of(sessions).framed(sessions);
        let options = options.fix(&self.fix, &machine)?.with_family_error(self.alpha);
        Ok(options.with_thresholds(&self.threshold))
    }

    /// Options that decide the result, as typed.
    pub(super) fn words(&self) -> String {
        let mut words = Vec::new();
        words.extend(self.effects.iter().map(|file| format!("--effects {}", file.path)));
        words.extend(self.only.iter().map(|name| format!("--only {name}")));
        words.extend(self.exclude.iter().map(|name| format!("--exclude {name}")));
        words.extend(self.fix.iter().map(|fixed| format!("--fix {fixed}")));
        if self.alpha != Thresholds::DEFAULT.family_error {
            words.push(format!("--alpha {}", self.alpha));
        }
        words.extend(self.threshold.iter().map(|own| format!("--threshold {own}")));
        words.extend(self.mask.iter().map(|mask| format!("--mask {mask}")));
        words.extend(self.validation.iter().map(|name| format!("--validation {name}")));
        words.iter().map(|word| format!(" {word}")).collect()
    }
}

/// Progress of a search: a bar on a terminal, a line for each stage elsewhere.
pub(super) struct SearchView {
    bar: ProgressBar,
    stage: Mutex<String>,
}

impl SearchView {
    /// Begin the progress.
    pub(super) fn new() -> Self {
        let bar = terminal::bar(None, "{msg} {elapsed} elapsed");
        bar.enable_steady_tick(TICK);
        Self { bar, stage: Mutex::default() }
    }

    /// Context of a search with `options`.
    pub(super) fn context<'a>(&'a self, options: &'a SearchOptions) -> Context<'a> {
        Context { options, observer: self }
    }

    /// Remove the bar.
    pub(super) fn close(&self) {
        self.bar.finish_and_clear();
    }
}

impl SearchObserver for SearchView {
    fn stage_begun(&self, kind: StageKind, done: usize, count: usize) {
        let text = format!("stage {} of {count} ({})", done + 1, stage_name(kind));
        if self.bar.is_hidden() {
            note(&text);
        }
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }

    fn step_begun(&self, step: SearchStep, candidates: usize) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let template = match candidates {
            0 => "{msg}, {elapsed} elapsed",
            _ => "{msg} {pos}/{len}, {elapsed} elapsed, {eta} left",
        };
        self.bar.set_length(candidates as u64);
        self.bar.set_position(0);
        self.bar.reset_eta();
        self.bar.set_message(format!("{stage}: {step}"));
        if let Ok(style) = ProgressStyle::with_template(template) {
            self.bar.set_style(style);
        }
    }

    fn candidate_done(&self) {
        self.bar.inc(1);
    }
}

/// Stage of the chain in words.
fn stage_name(kind: StageKind) -> &'static str {
    match kind {
        StageKind::Drive => "drives",
        StageKind::Camera => "camera",
        StageKind::Ball => "ball, segments",
        StageKind::WholeRolls => "ball, rolls",
        StageKind::Axis => "axis",
        StageKind::Estimator => "estimator",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        search: SearchArgs,
    }

    #[test]
    fn options_that_decide_the_result_are_part_of_the_command_line() {
        let typed = "x --only drive.friction --fix drive.delay.delay_s=0.01 --threshold min_gain=0.04 --mask a:1..2 \
             --threads 2";
        let line = Line::parse_from(typed.split(' '));
        assert_eq!(
            line.search.words(),
            " --only drive.friction --fix drive.delay.delay_s=0.01 --threshold min_gain=0.04 --mask a:1..2"
        );
        assert_eq!(Line::parse_from(["x"]).search.words(), "");
        let wrong = Line::try_parse_from(["x", "--only", "drive.dealy"]).err().unwrap();
        assert!(wrong.to_string().contains("did you mean 'drive.delay'?"), "{wrong}");
        for alpha in ["0", "1", "NaN", "-0.1"] {
            assert!(Line::try_parse_from(["x", "--alpha", alpha]).is_err(), "{alpha}");
        }
    }
}
