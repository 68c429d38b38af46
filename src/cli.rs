//! What can be typed: one variant per subcommand, each with its arguments beside its `run`. Options of every
//! subcommand are in `global`; `expand` adds what `klasktron.toml` says (`settings_file`).

mod expand;
mod global;
mod log_output;
mod settings_file;
#[cfg(test)]
mod tests;

use crate::commands::{
    self, EXIT_USAGE, Outcome,
    terminal::{self, Talk, tell},
};
use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand};
use expand::{Expanded, expand};
use global::{GlobalArgs, color_of};
use klasktron::provenance::VERSION_LINE;
use std::{env, ffi::OsString, process::ExitCode, time::Instant};

/// System identification and sim-to-real for the KlaskTron table and any driven axis.
///
/// Exit status: 0 done; 1 failed; 2 wrong usage; 3 done, but something was lost or a gate was not
/// met. Data goes to stdout or files, everything else to stderr. Options may also stand in klasktron.toml
/// in the working folder, in a table for each subcommand.
#[derive(Debug, Parser)]
#[command(
    name = "klasktron",
    version = VERSION_LINE.as_str(),
    max_term_width = 100,
    after_help = "Examples:\n  klasktron demo --quick\n  klasktron train --help"
)]
pub(crate) struct Cli {
    #[command(flatten)]
    global: GlobalArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Drive carriages through scripted trajectories and record everything
    ///
    /// The plan is proven before anything is armed. The first Ctrl-C ramps to zero and switches off,
    /// the second is an emergency stop of every drive. Without a table, --bus virtual (the default)
    /// is one.
    Collect(commands::collect::Args),
    /// Run the virtual rig as a table of its own on a real bus
    Rig(commands::rig::Args),
    /// Say what is in recordings, and what is doubtful about them
    Info(commands::info::Args),
    /// Save what a cut-off or damaged recording still holds
    Recover(commands::recover::Args),
    /// Turn bags, npz, CSV and candump logs into recordings
    Import(commands::import::Args),
    /// Fit the actuator network and judge it beside simpler models
    ///
    /// Runs whose recording or run marker says split=validation judge and are never fitted; where
    /// nothing says so, every fifth run of each pattern is held out. Finished fits are kept in
    /// OUT/fits, so the same command continues where an interrupted one stopped.
    FitActuator(commands::fit_actuator::Args),
    /// Fit the parameters that the twin already has, with intervals that hold under correlated noise
    Calibrate(commands::gap::CalibrateArgs),
    /// Find where twin and recordings disagree, name what is missing, add it, measure again
    ///
    /// Runs whose recording or run marker says split=validation judge and are never fitted; where
    /// nothing says so, the last of several recordings is held out, or every third run of one. OUT
    /// receives gap.json, twin.json (with the effects in it), index.html and gap.mcap.
    Gap(commands::gap::Args),
    /// Tune the filter of ball and strikers by its innovations, and judge it on other runs
    ///
    /// Runs whose recording or run marker says split=validation judge and are never fitted; where
    /// nothing says so, the last of several recordings is held out, or every third run of one. OUT
    /// receives ekf.json (which `play` loads), index.html and ekf.mcap with estimate beside detection.
    TuneEkf(commands::tune_ekf::Args),
    /// Judge recorded matches: contacts, bounces, goals, and the score with its intervals
    ///
    /// OUT receives score.json, events.mcap, episodes.csv, episodes.parquet and index.html with a
    /// replay. A file that cannot be read is reported and does not stop the others (status 3).
    Eval(commands::eval::Args),
    /// Let a policy learn KLASK against earlier versions of itself
    ///
    /// OUT receives policy.mcap (learning curve, ratings, sample games, weights as safetensors and ONNX, and a
    /// checkpoint from which --resume goes on) and index.html. Ctrl-C ends after the update (status 3). The
    /// same seed gives the same bytes whatever the number of threads.
    Train(commands::train::Args),
    /// Let policies and scripted players play on a table and record the match
    ///
    /// Pictures become estimates, estimates decisions, decisions commands, 50 times a second, with the safety of
    /// `collect`: the first Ctrl-C ramps to zero and switches off, the second is an emergency stop. Without a
    /// table, --bus virtual (the default) is one, on which the ball is put back after goals and when it lies
    /// still. `klasktron eval` scores the recording.
    Play(commands::play::Args),
    /// Run a command for every combination of options and seeds, on this machine or on Slurm
    ///
    /// OUT receives a folder for every finished point, table.csv, table.parquet, sweep.json and index.html. A
    /// finished point is never run again: the same command goes on after Ctrl-C, a kill or a power cut, and on
    /// Slurm it comes back to the jobs that it has submitted.
    Sweep(commands::sweep::Args),
    /// Run one point of a sweep, as a task of Slurm does
    #[command(hide = true)]
    SweepTask(commands::sweep::TaskArgs),
    /// The whole pipeline on the virtual rig, from a table that nobody has measured to a scored match
    ///
    /// OUT receives every recording and result and index.html, which tells the story. The commands are those
    /// that anyone can type; what is finished is kept, so the same command goes on after Ctrl-C.
    Demo(commands::demo::Args),
    /// Write weights or tables for other software
    Export(commands::export::Args),
    /// Print the script that completes commands and options in a shell
    Completions(commands::completions::Args),
    /// Print the manual page, or write one for every subcommand
    Man(commands::man::Args),
}

impl Cli {
    /// What was typed and what the settings file adds, with voice and log as they say. What cannot be run has
    /// been answered then, and the exit status is given.
    pub(crate) fn start(begun: Instant) -> Result<Self, ExitCode> {
        let typed: Vec<OsString> = env::args_os().collect();
        let color = typed_color(&typed);
        terminal::set_color(color_of(color));
        let command = Self::command().color(color);
        let expanded = expand(&command, typed).map_err(|error| {
            tell(&format!("error: {error}"));
            ExitCode::from(EXIT_USAGE)
        })?;
        let matches = command.try_get_matches_from(&expanded.arguments);
        let cli = matches
            .and_then(|matches| Self::from_arg_matches(&matches))
            .map_err(|error| answer(&error, &expanded))?;
        cli.global.begin(begun);
        log::debug!("klasktron {}", VERSION_LINE.as_str());
        for setting in &expanded.settings {
            log::info!("{}: {}", setting.place, setting.says());
        }
        Ok(cli)
    }

    /// Runs the command.
    pub(crate) fn run(self) -> anyhow::Result<Outcome> {
        self.command.run()
    }
}

impl GlobalArgs {
    fn begin(&self, begun: Instant) {
        let color = color_of(self.color);
        terminal::set_color(color);
        log_output::start(self.verbose, color, begun);
        terminal::set_talk(match (self.quiet, log_output::is_on()) {
            (true, _) => Talk::Quiet,
            (false, true) => Talk::Log,
            (false, false) => Talk::Usual,
        });
    }
}

/// `--color` before anything is parsed, for the help and for mistakes.
fn typed_color(typed: &[OsString]) -> ColorChoice {
    let words: Vec<&str> = typed.iter().map(|word| word.to_str().unwrap_or_default()).collect();
    let value = words.iter().enumerate().find_map(|(index, word)| match *word {
        "--color" => words.get(index + 1).copied(),
        word => word.strip_prefix("--color="),
    });
    value.and_then(|value| value.parse().ok()).unwrap_or_default()
}

/// Prints help, version or a mistake, with what the settings file has to do with it.
fn answer(error: &clap::Error, expanded: &Expanded) -> ExitCode {
    // Nobody is left to answer when the terminal is closed.
    error.print().ok();
    if !error.use_stderr() {
        return ExitCode::SUCCESS;
    }
    let added = expanded.settings.iter().filter(|setting| !setting.arguments.is_empty());
    let added: Vec<String> =
        added.map(|setting| format!("{} ({})", setting.says(), setting.place)).collect();
    if !added.is_empty() {
        tell(&format!(
            "the settings file has added {}; --no-config goes without",
            added.join(", ")
        ));
    }
    ExitCode::from(EXIT_USAGE)
}

impl Command {
    pub(crate) fn run(self) -> anyhow::Result<Outcome> {
        match self {
            Self::Collect(args) => commands::collect::run(&args),
            Self::Rig(args) => commands::rig::run(&args),
            Self::Info(args) => commands::info::run(&args),
            Self::Recover(args) => commands::recover::run(&args),
            Self::Import(args) => commands::import::run(&args),
            Self::FitActuator(args) => commands::fit_actuator::run(&args),
            Self::Calibrate(args) => commands::gap::calibrate(&args),
            Self::Gap(args) => commands::gap::run(&args),
            Self::TuneEkf(args) => commands::tune_ekf::run(&args),
            Self::Eval(args) => commands::eval::run(&args),
            Self::Train(args) => commands::train::run(&args),
            Self::Play(args) => commands::play::run(&args),
            Self::Sweep(args) => commands::sweep::run(&args),
            Self::SweepTask(args) => commands::sweep::run_task(&args),
            Self::Demo(args) => commands::demo::run(&args),
            Self::Export(args) => commands::export::run(&args),
            Self::Completions(args) => commands::completions::run(&args),
            Self::Man(args) => commands::man::run(&args),
        }
    }
}
