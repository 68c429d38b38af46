//! `klasktron fit-actuator`: fit the actuator network with several seeds and write the result.

use super::{
    Outcome,
    engine::{EngineArgs, Sweep},
    interrupt::{self, Interrupted},
    print,
    reported_command::ReportedCommand,
    tell, terminal,
};
use anyhow::{Context as _, bail};
use clap::{ValueEnum, builder::PossibleValue};
use indicatif::ProgressBar;
use klasktron::{
    actuator::{
        self, Fit, FitConfig, FitObserver, FitsObserver, LayoutKind, PlayerChoice, ResampleConfig,
        Schedule, Store, Study, StudyKind, Summary, Target,
    },
    parallel,
    provenance::Provenance,
    recording::{ExistingFile, topic::Player, write_bytes},
    sweep::{InputHashes, Plan, Point, SlurmRequest, Store as PointStore, SweptCommand},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `klasktron fit-actuator`.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron fit-actuator train.mcap validation.mcap --seeds 8 -o actuator"
)]
pub(crate) struct Args {
    /// Recordings with /striker/*/command and /striker/*/carriage (or /camera/detections)
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Folder for actuator.mcap, index.html and the finished fits
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "actuator")]
    output: PathBuf,
    /// Predicted velocity: carriage (encoders) or striker (camera)
    #[arg(long, value_enum, default_value_t = Target::Carriage)]
    target: Target,
    /// Gantry to fit [default: the one with commands and motion; left when both have]
    #[arg(long, value_enum)]
    player: Option<PlayerArg>,
    /// Input order and activation: 40 inputs with ReLU, or upstream's 38 with softsign
    #[arg(long, value_enum, default_value_t = LayoutKind::Klasktron)]
    layout: LayoutKind,
    /// Past samples in the input
    #[arg(long, value_name = "STEPS", default_value = "10", value_parser = parse_count)]
    history: usize,
    /// Units per hidden layer
    #[arg(long, value_name = "UNITS", default_value = "64", value_parser = parse_count)]
    width: usize,
    /// Number of hidden layers
    #[arg(long, value_name = "LAYERS", default_value = "3", value_parser = parse_count)]
    hidden_layers: usize,
    /// Training epochs
    #[arg(long, default_value = "1000", value_parser = parse_count)]
    epochs: usize,
    /// Batch size (windows per Adam step)
    #[arg(long, value_name = "WINDOWS", default_value = "256", value_parser = parse_count)]
    batch: usize,
    /// Initial learning rate of Adam
    #[arg(long, default_value = "0.001", value_parser = parse_positive, allow_negative_numbers = true)]
    learning_rate: f64,
    /// Learning-rate schedule
    #[arg(long, value_enum, default_value_t = Schedule::Cosine)]
    schedule: Schedule,
    /// Prediction horizon of the training loss (1: one step ahead)
    #[arg(long, value_name = "STEPS", default_value = "1", value_parser = parse_count)]
    horizon: usize,
    /// Rate to which the recordings are resampled (Hz)
    #[arg(long, value_name = "HZ", default_value = "50", value_parser = parse_positive, allow_negative_numbers = true)]
    rate_hz: f64,
    /// First seed
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of seeds, fitted in parallel
    #[arg(long, value_name = "COUNT", default_value = "8", value_parser = parse_count)]
    seeds: usize,
    /// Fit history {1, 5, 10} x width {32, 64, 128} with --seeds seeds each, and select one
    #[arg(long)]
    ablate: bool,
    /// Threads; the result does not depend on their number [default: one per core]
    #[arg(long, value_name = "COUNT", value_parser = parse_count)]
    threads: Option<usize>,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
    /// Write the fits without validation: a point of an ablation
    #[arg(long, hide = true)]
    fits_only: bool,
    /// Fewest samples of a run
    #[arg(long, value_name = "SAMPLES", hide = true)]
    shortest_run: Option<usize>,
    #[command(flatten)]
    engine: EngineArgs,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PlayerArg {
    Left,
    Right,
}

/// Largest count of any option: guards against typing errors that would exhaust memory or time.
const LARGEST_COUNT: usize = 1_000_000;

fn parse_count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=LARGEST_COUNT).contains(&count) => Ok(count),
        _ => Err(format!("must be a whole number from 1 to {LARGEST_COUNT}")),
    }
}

fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && 0.0 < value => Ok(value),
        _ => Err("must be a number above 0".to_owned()),
    }
}

/// Run `klasktron fit-actuator`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let base = args.fit_config()?;
    let kind = if args.ablate { StudyKind::Ablation } else { StudyKind::Seeds };
    let configs = match kind {
        StudyKind::Ablation => actuator::ablation_configs(&base, args.seeds as u64),
        StudyKind::Seeds => {
            (0..args.seeds as u64).map(|k| FitConfig { seed: base.seed + k, ..base }).collect()
        }
    };
    // In an ablation the longest history decides which runs are long enough for every fit.
    let longest_history = configs.iter().map(|config| config.history_steps).max().unwrap_or(0);
    let needed = (longest_history + base.horizon + 1).max(args.shortest_run.unwrap_or(0));
    let config = ResampleConfig { target: args.target, rate_hz: args.rate_hz };
    let dataset = actuator::load(&args.recordings, args.player_choice(), config, needed)?;
    if args.engine.is_given() && !args.ablate {
        bail!(
            "options of an engine need --ablate; or name them in a sweep file for `klasktron sweep`"
        );
    }
    if args.engine.is_dry_run() {
        let plan = args.plan(&configs, needed)?;
        print(&args.engine.dry_run(&args.sweep(&plan))?)?;
        return Ok(Outcome::Done);
    }
    let (train, held_out) = (dataset.train().len(), dataset.held_out().len());
    log::info!("{train} training runs, {held_out} validation runs, {} fits", configs.len());
    let store = Store::open(&args.output.join("fits"), &dataset)?;
    let fits = match kind {
        StudyKind::Seeds => args.fit_here(&configs, &dataset, &store)?,
        StudyKind::Ablation => args.fit_by_engine(&configs, &store, needed)?,
    };
    if args.fits_only {
        let (asked, finished) = (configs.len(), fits.len());
        let document = serde_json::json!({"fits_requested": asked, "fits_finished": finished});
        print(&document.to_string())?;
        return Ok(outcome(asked - finished));
    }
    let Some(study) = Study::new(dataset, fits, configs.len(), kind) else {
        return Err(Interrupted(
            "interrupted before the first fit was finished; nothing was written".to_owned(),
        )
        .into());
    };
    log::info!("validating the fits");
    let summary = study.summary(Provenance::new(args.command_line()));
    write_outcome(&study, &summary, &args.output)?;
    for warning in &summary.warnings {
        tell(&format!("warning: {warning}"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(&summary)?)?;
    } else {
        print(&table(&summary, &args.output))?;
    }
    let damaged = usize::from(study.dataset.is_damaged());
    Ok(outcome(study.requested - study.finished + damaged))
}

/// Outcome where this number of fits or inputs is `lost`, for example because Ctrl-C has ended the fitting.
fn outcome(lost: usize) -> Outcome {
    match (lost, interrupt::is_raised()) {
        (0, _) => Outcome::Done,
        (_, true) => Outcome::Interrupted,
        (_, false) => Outcome::Lossy,
    }
}

/// Folder of the points of an ablation, until their fits are in the store.
const SWEEP_FOLDER: &str = "sweep";

impl Args {
    /// Fit `configs` in this process.
    fn fit_here(
        &self,
        configs: &[FitConfig],
        dataset: &actuator::Dataset,
        store: &Store,
    ) -> anyhow::Result<Vec<Fit>> {
        let stop = interrupt::raised_by_ctrl_c("the result is made of the finished fits")?;
        let progress = Progress::new(configs);
        let threads = self.threads.unwrap_or_else(parallel::cores);
        let fits = actuator::fit_all(configs, dataset, store, (threads, stop), &progress)?;
        progress.bar.finish_and_clear();
        Ok(fits)
    }

    /// Fit each of `configs` that is not in the store as a point of a sweep.
    fn fit_by_engine(
        &self,
        configs: &[FitConfig],
        store: &Store,
        needed: usize,
    ) -> anyhow::Result<Vec<Fit>> {
        let missing: Vec<FitConfig> =
            configs.iter().filter(|config| store.get(config).is_none()).copied().collect();
        if !missing.is_empty() {
            let plan = self.plan(&missing, needed)?;
            let sweep = self.sweep(&plan);
            let finished = self.engine.run(&sweep)?;
            self.gather(&plan)?;
            if let Some(open) = finished.open {
                tell(&open);
            }
            if let Some(failed) = finished.merged.failures.first() {
                bail!(
                    "{} of {} fits failed, the first ({}) with: {}; see {}; run them again with --retry",
                    finished.merged.failures.len(),
                    configs.len(),
                    failed.title,
                    failed.reason,
                    failed.log.display()
                );
            }
        }
        let fits: Vec<Fit> = configs.iter().filter_map(|config| store.get(config)).collect();
        if fits.len() == configs.len() {
            // Every fit is in the store now.
            fs::remove_dir_all(self.output.join(SWEEP_FOLDER)).ok();
        }
        Ok(fits)
    }

    /// Move the fits of finished points into the store.
    fn gather(&self, plan: &Plan) -> anyhow::Result<()> {
        let points = PointStore::open(&self.output.join(SWEEP_FOLDER))?;
        let finished = points.finished(&plan.points)?;
        for point in plan.points.iter().filter(|point| finished.contains(&point.hash)) {
            let folder = points.folder(point).join("fits");
            let read = || format!("{}: cannot read", folder.display());
            for entry in fs::read_dir(&folder).with_context(read)? {
                let fit = entry.with_context(read)?;
                let bytes = fs::read(fit.path()).with_context(read)?;
                let to = self.output.join("fits").join(fit.file_name());
                write_bytes(&to, ExistingFile::Replace, &bytes)?;
            }
        }
        Ok(())
    }

    fn sweep<'a>(&self, plan: &'a Plan) -> Sweep<'a> {
        let workers = self.threads.unwrap_or_else(parallel::cores);
        Sweep { plan, out: self.output.join(SWEEP_FOLDER), workers }
    }

    /// Plan with a point for each of `configs`, the largest network first, so that no long fit is left for the end.
    fn plan(&self, configs: &[FitConfig], needed: usize) -> anyhow::Result<Plan> {
        let mut hashes = InputHashes::default();
        let inputs: Vec<String> =
            self.recordings.iter().map(|path| hashes.of(path)).collect::<Result<_, _>>()?;
        let mut configs = configs.to_vec();
        configs.sort_by_key(|config| std::cmp::Reverse((config.width, config.history_steps)));
        let point = |config: &FitConfig| {
            let mut point = Point::new(self.words(config, needed), &inputs);
            point.seed = Some(config.seed);
            let settings = [("history", config.history_steps), ("width", config.width)];
            point.settings =
                settings.map(|(name, value)| (name.to_owned(), value.to_string())).into();
            point
        };
        Ok(Plan {
            command: SweptCommand::FitActuator,
            working_folder: std::env::current_dir().context("cannot find the working folder")?,
            axes: Vec::new(),
            points: configs.iter().map(point).collect(),
            metric: SweptCommand::FitActuator.metric(),
            slurm: SlurmRequest::default(),
        })
    }

    /// Command line of one fit.
    fn words(&self, config: &FitConfig, needed: usize) -> Vec<String> {
        let mut words = vec!["fit-actuator".to_owned()];
        words.extend(self.recordings.iter().map(|path| path.display().to_string()));
        let own =
            Self { seed: config.seed, seeds: 1, history: config.history_steps, ..self.clone() };
        let own = Self { width: config.width, ..own };
        words.extend(
            own.options().into_iter().flat_map(|(name, value)| [format!("--{name}"), value]),
        );
        words.push("--fits-only".to_owned());
        words.extend(["--shortest-run".to_owned(), needed.to_string()]);
        words
    }

    fn fit_config(&self) -> anyhow::Result<FitConfig> {
        if self.layout == LayoutKind::KlaskRl && self.history < 2 {
            bail!("--history {} is too short for --layout klask-rl, which needs 2", self.history);
        }
        Ok(FitConfig {
            layout: self.layout,
            history_steps: self.history,
            width: self.width,
            hidden_layers: self.hidden_layers,
            epochs: self.epochs,
            batch: self.batch,
            learning_rate: self.learning_rate,
            schedule: self.schedule,
            horizon: self.horizon,
            seed: self.seed,
        })
    }

    /// Command line with every option that decides the result. Output folder and threads are left out, so that equal
    /// results are equal files.
    fn command_line(&self) -> String {
        let line = ReportedCommand::new("fit-actuator")
            .words(self.recordings.iter().map(|path| path.display()));
        self.options()
            .into_iter()
            .fold(line, |line, (option, value)| line.option(option, value))
            .words(self.ablate.then_some("--ablate"))
            .into_string()
    }

    /// Options that decide the result, with their values.
    fn options(&self) -> Vec<(&'static str, String)> {
        let name = |value: &dyn Fn() -> Option<PossibleValue>| {
            value().map_or_else(String::new, |value| value.get_name().to_owned())
        };
        let mut options = vec![
            ("target", name(&|| self.target.to_possible_value())),
            ("layout", self.layout.to_string()),
            ("history", self.history.to_string()),
            ("width", self.width.to_string()),
            ("hidden-layers", self.hidden_layers.to_string()),
            ("epochs", self.epochs.to_string()),
            ("batch", self.batch.to_string()),
            ("learning-rate", self.learning_rate.to_string()),
            ("schedule", name(&|| self.schedule.to_possible_value())),
            ("horizon", self.horizon.to_string()),
            ("rate-hz", self.rate_hz.to_string()),
            ("seed", self.seed.to_string()),
            ("seeds", self.seeds.to_string()),
        ];
        if let Some(player) = self.player {
            options.push(("player", name(&|| player.to_possible_value())));
        }
        options
    }

    fn player_choice(&self) -> PlayerChoice {
        match self.player {
            None => PlayerChoice::Only,
            Some(PlayerArg::Left) => PlayerChoice::Given(Player::Left),
            Some(PlayerArg::Right) => PlayerChoice::Given(Player::Right),
        }
    }
}

fn write_outcome(study: &Study, summary: &Summary, out: &Path) -> anyhow::Result<()> {
    actuator::write_actuator(study, summary, &out.join("actuator.mcap"))?;
    let page = actuator::page(study, summary);
    write_bytes(&out.join("index.html"), ExistingFile::Replace, page.as_bytes())?;
    Ok(())
}

/// Result as a table, with the paths of the files.
fn table(summary: &Summary, out: &Path) -> String {
    let mut lines = vec![format!(
        "{:<24}{:>12}{:>12}{:>12}{:>12}",
        "RMSE (mm/s), held out", "one step", "0.1 s", "0.5 s", "2 s"
    )];
    let figure = |value: f64| {
        if value.is_finite() {
            format!("{:>12.3}", 1e3 * value)
        } else {
            format!("{:>12}", "diverges")
        }
    };
    let median: String = std::iter::once(summary.one_step_rmse_m_per_s.median)
        .chain(summary.free_running_rmse_m_per_s.iter().map(|f| f.spread.median))
        .map(figure)
        .collect();
    let seeds = match summary.seeds.len() {
        1 => "1 seed".to_owned(),
        count => format!("{count} seeds"),
    };
    lines.push(format!("{:<24}{median}", format!("network, {seeds}")));
    for (model, title) in
        [("arx", "linear ARX"), ("fopdt", "first order + dead time"), ("ideal", "ideal")]
    {
        let rows = summary.errors.iter().filter(|row| {
            row.model == model && row.pattern == "all" && row.component == actuator::Component::Both
        });
        let figures: String = rows.map(|row| figure(row.rmse_m_per_s)).collect();
        lines.push(format!("{title:<24}{figures}"));
    }
    if let Some(ablation) = &summary.ablation {
        let cell = &ablation.cells[ablation.chosen];
        lines.push(format!(
            "selected by the one-standard-error rule: {} steps of history, {} units",
            cell.history_steps, cell.width
        ));
    }
    lines.push(format!("{}", summary.verdict));
    lines.push(format!(
        "wrote {} and {}",
        out.join("actuator.mcap").display(),
        out.join("index.html").display()
    ));
    lines.join("\n")
}

/// Progress bar of epochs.
struct Progress {
    bar: ProgressBar,
}

impl Progress {
    fn new(configs: &[FitConfig]) -> Self {
        let epochs: usize = configs.iter().map(|config| config.epochs).sum();
        let template = "{msg} {wide_bar} {pos}/{len} epochs, {eta} left";
        let bar = terminal::bar(Some(epochs as u64), template);
        bar.set_message(format!("{} fits", configs.len()));
        Self { bar }
    }
}

impl FitObserver for Progress {
    fn epoch_done(&self) {
        self.bar.inc(1);
    }
}

impl FitsObserver for Progress {
    fn fit_reused(&self, config: &FitConfig) {
        self.bar.inc(config.epochs as u64);
    }

    fn fit_done(&self, config: &FitConfig) {
        self.bar.set_message(format!(
            "history {} width {} seed {} done",
            config.history_steps, config.width, config.seed
        ));
    }
}
