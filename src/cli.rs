//! Command line: one variant per subcommand; the module of each command holds its arguments and its `run`.
//!
//! `global` holds the options of every subcommand, `groups` the order of the help, and `expand` adds the settings
//! of `klasktron.toml` (`settings_file`).

mod expand;
mod global;
mod groups;
mod log_output;
mod settings_file;
#[cfg(test)]
mod tests;

use crate::commands::{
    self, EXIT_USAGE, Outcome, interrupt,
    terminal::{self, Talk, tell},
};
use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand};
use expand::{Expanded, expand};
use global::{GlobalArgs, color_of};
use klasktron::provenance::VERSION_LINE;
use std::{env, ffi::OsString, process::ExitCode, time::Instant};

/// System identification and sim-to-real for the KlaskTron table and any driven axis
#[derive(Debug, Parser)]
#[command(
    name = "klasktron",
    version = VERSION_LINE.as_str(),
    max_term_width = 100,
    help_template = groups::help_template(<Command as Subcommand>::augment_subcommands(
        clap::Command::new("klasktron")
    )),
    after_help = AFTER_HELP
)]
pub(crate) struct Cli {
    #[command(flatten)]
    global: GlobalArgs,
    #[command(subcommand)]
    command: Command,
}

/// Exit statuses, environment and examples: the end of the help of the whole program.
const AFTER_HELP: &str = "\
Exit status:
  0    success
  1    failure: one sentence on stderr gives the reason; no result is half written
  2    usage error: an option, a value or a line of the settings file is wrong
  3    finished, but data were lost or a check failed: a damaged input, a refused
       verdict, a session that ended early
  130  ended by Ctrl-C (or SIGTERM) before the work was complete; stderr says what
       was written and how to continue. A session of `collect` or `play` saves its
       recording and ends with status 3

Results go to stdout and to files, everything else to stderr. Existing results are
replaced only with --overwrite.

Settings, in order of precedence:
  1. options on the command line
  2. KLASKTRON_BUS, KLASKTRON_CAMERA, KLASKTRON_ROBOT for --bus, --camera, --robot
  3. klasktron.toml in the working folder, one table for each subcommand
  4. the defaults that the help shows

Examples:
  klasktron demo --quick
  klasktron train --help";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Drive the carriages along planned trajectories and record
    ///
    /// Every plan is checked against the workspace before a drive is armed. The first Ctrl-C ramps down and
    /// disarms (status 3), the second is an emergency stop of every drive. The default --bus virtual needs no
    /// hardware.
    Collect(commands::collect::Args),
    /// Run the virtual rig on a real bus, as a table of its own
    Rig(commands::rig::Args),
    /// Calibrate the lens of the camera and its pose above the table
    ///
    /// The lens is fitted to images of a checkerboard or read from a file of OpenCV or ROS. The pose comes from
    /// AprilTags 36h11 at known positions, or from the corners of the field. Without --board and --corner only the
    /// lens is written.
    CalibrateCamera(commands::calibrate_camera::Args),
    /// Fit the colours of ball, strikers and biscuits
    ///
    /// Pixels of marked pieces give the colours of each kind; every other pixel of the field is background. So every
    /// visible piece of a marked image must be marked. Five to ten images with hands and shadows are enough.
    TuneDetector(commands::tune_detector::Args),
    /// Detect the pieces in images; record and serve the positions
    ///
    /// Detections carry the covariance of each position. `collect` and `play` do the same with --camera v4l2:DEVICE.
    Detect(commands::detect::Args),
    /// Summarize recordings and check data quality
    Info(commands::info::Args),
    /// Copy the readable part of a truncated or damaged recording
    Recover(commands::recover::Args),
    /// Show a recording in Foxglove or Lichtblick, at its own pace
    ///
    /// The replay starts when a viewer subscribes to a topic. The scene (/scene) is computed where the recording
    /// has none.
    Replay(commands::replay::Args),
    /// Convert bags, npz, CSV and candump logs into recordings
    Import(commands::import::Args),
    /// Fit the actuator network and compare it with simpler models
    ///
    /// Runs whose recording or run marker says split=validation are held out. Without such a mark, every fifth
    /// run of each pattern is held out. Finished fits are kept in OUTPUT/fits, so the same command continues
    /// after an interruption.
    FitActuator(commands::fit_actuator::Args),
    /// Fit the parameters that a twin already has
    ///
    /// Confidence intervals account for correlated residuals. No effect is added: `klasktron gap` does that.
    /// Runs whose recording or run marker says split=validation are held out.
    Calibrate(commands::gap::CalibrateArgs),
    /// Find the effects that a twin lacks, add and validate them
    ///
    /// Runs whose recording or run marker says split=validation are held out. Without such a mark, the last of
    /// several recordings is held out, or every third run of a single one. OUTPUT receives gap.json, twin.json
    /// (with the effects), index.html and gap.mcap.
    Gap(commands::gap::Args),
    /// List the physical effects that `gap` can identify
    ///
    /// Each entry has the equation, the parameters with units and typical ranges, and the signals that show the
    /// effect. It also names the motion that excites the effect, and the effects that it is confused with.
    Effects(commands::effects::Args),
    /// Simulate a twin open loop from recorded or tabulated commands
    ///
    /// OUTPUT is a recording of the data contract, which `info`, `gap` and Foxglove read; the same motion is
    /// written as CSV next to it. The simulation is deterministic and free of noise.
    Simulate(commands::simulate::Args),
    /// Compare the effects and parameters of two twins
    ///
    /// Effects are compared by name and location, parameters by value and 95 % confidence interval.
    Diff(commands::diff::Args),
    /// Tune the Kalman filter by its innovations and validate it
    ///
    /// Runs whose recording or run marker says split=validation are held out. Without such a mark, the last of
    /// several recordings is held out, or every third run of a single one. OUTPUT receives ekf.json (which
    /// `play` loads), index.html and ekf.mcap with the estimates and the detections.
    TuneEkf(commands::tune_ekf::Args),
    /// Score recorded matches: contacts, bounces, goals, intervals
    ///
    /// OUTPUT receives score.json, events.mcap, episodes.csv, episodes.parquet and index.html with a replay. A
    /// file that cannot be read is reported and does not stop the others (status 3).
    Eval(commands::eval::Args),
    /// Train a policy by self-play in the identified simulation
    ///
    /// OUTPUT receives policy.mcap (learning curve, ratings, sample games, weights as safetensors and ONNX, and
    /// a checkpoint for --resume) and index.html. Ctrl-C ends training after the current update (status 130).
    /// The same seed gives the same bytes for any number of threads.
    Train(commands::train::Args),
    /// Let policies or scripted players play a match and record it
    ///
    /// Detections become estimates, estimates become actions and actions become commands, 50 times a second. The
    /// safety functions of `collect` apply: the first Ctrl-C ramps down and disarms (status 3), the second is an
    /// emergency stop. The default --bus virtual needs no hardware; its rig serves the ball after a goal and
    /// when the ball rests. `klasktron eval` scores the recording.
    Play(commands::play::Args),
    /// Run a command for every combination of options and seeds
    ///
    /// Points run on this machine or on Slurm. OUTPUT receives a folder for every finished point, table.csv,
    /// table.parquet, sweep.json and index.html. A finished point is never run again: the same command continues
    /// after Ctrl-C, a kill or a power failure, and on Slurm it finds the jobs that it has submitted.
    Sweep(commands::sweep::Args),
    /// Run one point of a sweep as a Slurm task
    #[command(hide = true)]
    SweepTask(commands::sweep::TaskArgs),
    /// Run the whole pipeline on the virtual rig, data to match
    ///
    /// OUTPUT receives every recording and result, and index.html with the whole story. All steps are ordinary
    /// commands. Finished steps are kept, so the same command continues after Ctrl-C.
    Demo(commands::demo::Args),
    /// Export weights or tables for other software
    Export(commands::export::Args),
    /// Print the JSON Schema of a result document
    Schema(commands::schema::Args),
    /// Print a completion script for a shell
    Completions(commands::completions::Args),
    /// Print the manual page, or write one for every subcommand
    Man(commands::man::Args),
}

impl Cli {
    /// Parse the command line with the settings file, and set up colours, log and Ctrl-C.
    ///
    /// # Errors
    /// The exit status, where help, version or a usage error has been printed already.
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
        interrupt::listen();
        log::debug!("klasktron {}", VERSION_LINE.as_str());
        for setting in &expanded.settings {
            log::info!("{}: {}", setting.place, setting.as_typed());
        }
        Ok(cli)
    }

    /// Run the command.
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

/// Value of `--color` before anything is parsed, for help and usage errors.
fn typed_color(typed: &[OsString]) -> ColorChoice {
    let words: Vec<&str> = typed.iter().map(|word| word.to_str().unwrap_or_default()).collect();
    let value = words.iter().enumerate().find_map(|(index, word)| match *word {
        "--color" => words.get(index + 1).copied(),
        word => word.strip_prefix("--color="),
    });
    value.and_then(|value| value.parse().ok()).unwrap_or_default()
}

/// Print help, version or a usage error, with the settings that the file and the environment added.
fn answer(error: &clap::Error, expanded: &Expanded) -> ExitCode {
    // Nobody is left to answer when the terminal is closed.
    error.print().ok();
    if !error.use_stderr() {
        return ExitCode::SUCCESS;
    }
    let added = expanded.settings.iter().filter(|setting| !setting.arguments.is_empty());
    let added: Vec<String> =
        added.map(|setting| format!("{} ({})", setting.as_typed(), setting.place)).collect();
    if !added.is_empty() {
        tell(&format!(
            "the settings file has added {}; --no-config ignores the file",
            added.join(", ")
        ));
    }
    if !expanded.environment.is_empty() {
        tell(&format!(
            "the environment has set {}; an option on the command line takes precedence",
            expanded.environment.join(", ")
        ));
    }
    ExitCode::from(EXIT_USAGE)
}

impl Command {
    pub(crate) fn run(self) -> anyhow::Result<Outcome> {
        match self {
            Self::Collect(args) => commands::collect::run(&args),
            Self::Rig(args) => commands::rig::run(&args),
            Self::CalibrateCamera(args) => commands::calibrate_camera::run(&args),
            Self::TuneDetector(args) => commands::tune_detector::run(&args),
            Self::Detect(args) => commands::detect::run(&args),
            Self::Info(args) => commands::info::run(&args),
            Self::Recover(args) => commands::recover::run(&args),
            Self::Replay(args) => commands::replay::run(&args),
            Self::Import(args) => commands::import::run(&args),
            Self::FitActuator(args) => commands::fit_actuator::run(&args),
            Self::Calibrate(args) => commands::gap::calibrate(&args),
            Self::Gap(args) => commands::gap::run(&args),
            Self::Effects(args) => commands::effects::run(&args),
            Self::Simulate(args) => commands::simulate::run(&args),
            Self::Diff(args) => commands::diff::run(&args),
            Self::TuneEkf(args) => commands::tune_ekf::run(&args),
            Self::Eval(args) => commands::eval::run(&args),
            Self::Train(args) => commands::train::run(&args),
            Self::Play(args) => commands::play::run(&args),
            Self::Sweep(args) => commands::sweep::run(&args),
            Self::SweepTask(args) => commands::sweep::run_task(&args),
            Self::Demo(args) => commands::demo::run(&args),
            Self::Export(args) => commands::export::run(&args),
            Self::Schema(args) => commands::schema::run(&args),
            Self::Completions(args) => commands::completions::run(&args),
            Self::Man(args) => commands::man::run(&args),
        }
    }
}
