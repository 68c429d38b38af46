//! `klasktron train`: train a policy with given settings and a model of the actuator.

use super::{
    Outcome,
    engine::{EngineArgs, Finished, PrintKind, Sweep, conclude},
    interrupt, note, print,
    results::OverwriteArgs,
    table::read_rig,
    tell, terminal,
};
use anyhow::{Context as _, bail};
use indicatif::ProgressBar;
use klasktron::{
    ekf::FilterSettings,
    game::{GameSettings, ObservationKind, SensorSettings},
    gantry::Robot,
    opponent::Scripted,
    parallel::cores,
    play::TrainingRig,
    provenance::Provenance,
    recording::{
        ExistingFile, Recording,
        table::{TableFormat, read_table, write_table},
        write_bytes,
    },
    rig::RigConfig,
    sweep::{InputHashes, Plan, Point, SlurmRequest, Store, SweptCommand},
    train::{
        ActuatorSource, Choice, Curriculum, CurvePoint, EventFile, Machine, Opponent, OpponentMode,
        Preset, RandomizationKind, RewardSettings, Run, SeedRun, Summary, TimeShares, TrainError,
        TrainSettings, UPDATE_TOPIC, evaluate, game_with_actuator, page, play_samples,
        read_checkpoint, read_curve, read_policy, seeds_page, sensors_of, write_policy,
    },
};
use serde::Serialize;
use std::{
    fs,
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::{
        OnceLock,
        atomic::{AtomicBool, Ordering},
    },
    time::{Instant, SystemTime, UNIX_EPOCH},
};

/// Arguments of `klasktron train`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron train --steps 20e6 -o policy\n  klasktron train --actuator actuator/actuator.mcap --hidden 256,128,64 -o policy\n  klasktron train --steps 20e6 -o policy --resume\n  klasktron train --steps 20e6 --seeds 5 -o policies"
)]
pub(crate) struct Args {
    /// Transitions of all environments, such as 20e6 [default: 20e6]
    #[arg(long, value_name = "COUNT", value_parser = parse_steps)]
    steps: Option<u64>,
    /// Parallel environments [default: from the preset]
    #[arg(long, value_name = "COUNT")]
    envs: Option<usize>,
    /// Widths of the hidden layers, such as 256,128,64 [default: from the preset]
    #[arg(long, value_name = "UNITS", value_delimiter = ',')]
    hidden: Vec<usize>,
    /// Recipe: the strongest known, table II of the paper, or upstream's rl_games configuration
    #[arg(long, value_enum, default_value_t = Preset::Tuned)]
    preset: Preset,
    /// Settings file (JSON from --print-settings) instead of a preset; options take precedence
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    settings: Option<PathBuf>,
    /// Reward shaping [default: from the preset]
    #[arg(long, value_enum)]
    curriculum: Option<Curriculum>,
    /// Opponents: earlier policies (enhanced self-play, uniform, best) or a script [default: enhanced]
    #[arg(long, value_enum)]
    opponents: Option<OpponentsArg>,
    /// Actuator model: ideal, a twin.json or an actuator.mcap
    #[arg(long, value_name = "ideal|FILE", default_value = "ideal")]
    actuator: PathBuf,
    /// Train on this virtual rig (JSON, as for `play --rig`) instead of a simulation, through its camera and the
    /// state estimator; --actuator is then the simulation of the evaluation
    #[arg(long, value_name = "FILE", conflicts_with_all = ["no_sensors", "randomize", "biscuits", "seeds"])]
    rig: Option<PathBuf>,
    /// Train through the camera and the state estimator of an ekf.json, as `play --ekf` uses them
    /// [default: untuned for a twin, none for other actuators]
    #[arg(long, value_name = "FILE")]
    ekf: Option<PathBuf>,
    /// Train with exact, current positions instead of the camera and the state estimator
    #[arg(long, conflicts_with = "ekf")]
    no_sensors: bool,
    /// Domain randomization: draw the physics of every episode from table III of the paper
    #[arg(long)]
    randomize: bool,
    /// Play with three magnets, which stick to strikers; two of them lose the point
    #[arg(long)]
    biscuits: bool,
    /// Observation: 12 standard values, 20 with angles and distances, 29 with the geometry of a shot, 31 with the command of the scripted shooter [default: from the preset]
    #[arg(long, value_enum)]
    observations: Option<ObservationsArg>,
    /// Own previous commands in the observation, 0 to 8, for delayed actuators [default: from the preset]
    #[arg(long, value_name = "COUNT")]
    action_history: Option<usize>,
    /// Evaluation games against each scripted player, an even number; 0: none [default: 1000]
    #[arg(long, value_name = "COUNT")]
    games: Option<usize>,
    /// Seed of all random numbers [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// Train this many seeds from --seed on, each in OUTPUT/seed-N, with one page and table
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=1000),
        conflicts_with_all = ["resume", "overwrite", "tensorboard", "print_settings"])]
    seeds: Option<u64>,
    /// Folder for policy.mcap and index.html, or the path of an .mcap file
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "policy")]
    output: PathBuf,
    /// Continue from the newest checkpoint in OUTPUT, with the bytes of an uninterrupted run
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Folder for TensorBoard event files
    #[arg(long, value_name = "DIR")]
    tensorboard: Option<PathBuf>,
    /// Threads; the result does not depend on their number [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Print the settings as JSON and exit
    #[arg(long)]
    print_settings: bool,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
    /// Omit times from the document, so that equal results are equal bytes
    #[arg(long, requires = "json")]
    without_times: bool,
    #[command(flatten)]
    engine: EngineArgs,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum OpponentsArg {
    Enhanced,
    Uniform,
    Best,
    Stationary,
    Random,
    Goalkeeper,
    Chaser,
    Shooter,
}

impl OpponentsArg {
    fn mode(self) -> OpponentMode {
        match self {
            Self::Enhanced => OpponentMode::Enhanced,
            Self::Uniform => OpponentMode::Uniform,
            Self::Best => OpponentMode::Best,
            Self::Stationary => OpponentMode::Scripted(Scripted::Stationary),
            Self::Random => OpponentMode::Scripted(Scripted::Random),
            Self::Goalkeeper => OpponentMode::Scripted(Scripted::Goalkeeper),
            Self::Chaser => OpponentMode::Scripted(Scripted::Chaser),
            Self::Shooter => OpponentMode::Scripted(Scripted::Shooter),
        }
    }
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ObservationsArg {
    #[value(name = "12")]
    Standard,
    #[value(name = "20")]
    Augmented,
    #[value(name = "29")]
    Aiming,
    #[value(name = "31")]
    Shooting,
}

fn parse_steps(text: &str) -> Result<u64, String> {
    let most = 1e15;
    match text.parse::<f64>() {
        Ok(steps) if (1.0..=most).contains(&steps) && steps.fract() == 0.0 => Ok(steps as u64),
        _ => Err(format!("must be a whole number from 1 to {most:e}, such as 20e6")),
    }
}

/// Paths of the results.
struct Places {
    policy: PathBuf,
    page: PathBuf,
    /// Table of the updates.
    curve: PathBuf,
}

/// One training run.
struct Task {
    settings: TrainSettings,
    game: GameSettings,
    /// Rig to train on; `None` for a simulation.
    rig: Option<RigConfig>,
    actuator: ActuatorSource,
    places: Places,
    provenance: Provenance,
    threads: NonZeroUsize,
}

/// Result document with times, which no file holds.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    transitions_per_s: f64,
    time_shares: serde_json::Map<String, serde_json::Value>,
    times: TimeShares,
}

/// Run `klasktron train`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let settings = args.settings()?;
    settings.check()?;
    if args.print_settings {
        print(&settings.to_json())?;
        return Ok(Outcome::Done);
    }
    let (game, simulated) = game_with_actuator(&args.actuator)?;
    let rig = args.rig.as_deref().map(read_rig).transpose()?;
    let actuator = match &args.rig {
        Some(path) => ActuatorSource::of_rig(path)?,
        None => simulated,
    };
    if let Some(seeds) = args.seeds {
        return run_seeds(args, &settings, seeds);
    }
    if args.engine.is_given() {
        bail!("options of an engine need --seeds; a single run is made in this process");
    }
    let provenance = Provenance::new(args.command_line(&settings));
    let threads = args.threads.or_else(|| NonZeroUsize::new(cores()));
    let threads = threads.unwrap_or(NonZeroUsize::MIN);
    let places = args.places();
    let settings = args.continued(settings, &places.policy)?;
    let task = Task { settings, game, rig, actuator, places, provenance, threads };
    let mut run = task.begin(args)?;
    let stop = interrupt::raised_by_ctrl_c("finishing the current update")?;
    let mut events = args
        .tensorboard
        .as_ref()
        .map(|folder| {
            let first = run.curve().len() as u64;
            EventFile::create(folder, first, wall_time())
                .with_context(|| format!("{}: cannot write event files", folder.display()))
        })
        .transpose()?;
    task.train(&mut run, stop, events.as_mut())?;
    let summary = task.finish(&run)?;
    for warning in &summary.warnings {
        tell(&format!("warning: {warning}"));
    }
    let text = match (args.json, args.without_times) {
        (true, true) => serde_json::to_string_pretty(&summary)?,
        (true, false) => json(&summary, run.times())?,
        (false, _) => table(&summary, &run, &task),
    };
    print(&text)?;
    Ok(match (summary.finished, interrupt::is_raised()) {
        (true, _) => Outcome::Done,
        (false, true) => Outcome::Interrupted,
        (false, false) => Outcome::Lossy,
    })
}

/// Train several seeds as points of a sweep.
fn run_seeds(args: &Args, settings: &TrainSettings, seeds: u64) -> anyhow::Result<Outcome> {
    if args.output.extension().is_some_and(|extension| extension == "mcap") {
        bail!("{}: several seeds need a folder as --output, not a file", args.output.display());
    }
    let last = settings.seed.checked_add(seeds - 1);
    let last =
        last.with_context(|| format!("--seed {} is too large for {seeds} seeds", settings.seed))?;
    let file = args.output.join("settings.json");
    let plan = seeds_plan(args, settings, (&file, last))?;
    let threads = args.threads.map_or_else(cores, NonZeroUsize::get);
    let workers = plan.points.len().min(threads);
    let sweep = Sweep { plan: &plan, out: args.output.clone(), workers };
    if args.engine.is_dry_run() {
        print(&args.engine.dry_run(&sweep)?)?;
        return Ok(Outcome::Done);
    }
    // Refuse a folder with other settings before anything is written into it.
    Store::open(&args.output)?.finished(&plan.points)?;
    write_bytes(&file, ExistingFile::Replace, settings.to_json().as_bytes())?;
    let finished = args.engine.run(&sweep)?;
    let provenance = Provenance::new(format!("{} --seeds {seeds}", args.command_line(settings)));
    let html = seeds_page(&seed_runs(&sweep, &finished)?, &provenance);
    conclude(&sweep, &finished, (&provenance, &html), PrintKind::of_flag(&args.json))
}

/// Plan with a point in `seed-N` for every seed up to `last`; `file` holds the settings.
fn seeds_plan(
    args: &Args,
    settings: &TrainSettings,
    (file, last): (&Path, u64),
) -> anyhow::Result<Plan> {
    let mut inputs = vec![settings.to_json()];
    let actuator = args.actuator.display().to_string();
    if SweptCommand::Train.is_file("actuator", &actuator) {
        inputs.push(InputHashes::default().of(&args.actuator)?);
    }
    let point = |seed: u64| {
        let words = |settings: String| {
            let seed = seed.to_string();
            ["train", "--settings", &settings, "--actuator", &actuator, "--seed", &seed]
                .map(str::to_owned)
                .to_vec()
        };
        let mut point = Point::new(words("settings.json".to_owned()), &inputs);
        point.words = words(file.display().to_string());
        point.folder = format!("seed-{seed}").into();
        point.seed = Some(seed);
        point
    };
    Ok(Plan {
        command: SweptCommand::Train,
        working_folder: std::env::current_dir().context("cannot find the working folder")?,
        axes: Vec::new(),
        points: (settings.seed..=last).map(point).collect(),
        metric: SweptCommand::Train.metric(),
        slurm: SlurmRequest::default(),
    })
}

/// Results of every finished seed for the page.
fn seed_runs(sweep: &Sweep<'_>, finished: &Finished) -> anyhow::Result<Vec<SeedRun>> {
    let store = Store::open(&sweep.out)?;
    let mut runs = Vec::new();
    for row in &finished.merged.rows {
        let point = &sweep.plan.points[row.index];
        let Some((_, result)) = store.read(point) else { continue };
        let policy = store.folder(point).join("policy.mcap");
        runs.push(SeedRun {
            seed: point.seed.unwrap_or_default(),
            evaluation: serde_json::from_value(result["evaluation"].clone()).ok(),
            curve: read_curve(&Recording::open(&policy)?)?,
        });
    }
    Ok(runs)
}

impl Args {
    fn settings(&self) -> anyhow::Result<TrainSettings> {
        let mut settings = if let Some(path) = &self.settings {
            let stored = TrainSettings::read(path)?;
            TrainSettings { steps: self.steps.unwrap_or(stored.steps), ..stored }
        } else {
            let preset = TrainSettings::preset(self.preset);
            let steps = self.steps.unwrap_or(preset.steps);
            preset.for_steps(steps)
        };
        settings.environments = self.envs.unwrap_or(settings.environments);
        settings.seed = self.seed.unwrap_or(settings.seed);
        if !self.hidden.is_empty() {
            settings.ppo.hidden.clone_from(&self.hidden);
        }
        if let Some(curriculum) = self.curriculum {
            settings.reward = RewardSettings::of(curriculum);
        }
        if let Some(opponents) = self.opponents {
            settings.opponents.mode = opponents.mode();
            if matches!(settings.opponents.mode, OpponentMode::Scripted(_)) {
                settings.opponents.scripted_fraction = 0.0;
            }
        }
        if let Some(observations) = self.observations {
            settings.observations = match observations {
                ObservationsArg::Standard => ObservationKind::Standard12,
                ObservationsArg::Augmented => ObservationKind::Augmented20,
                ObservationsArg::Aiming => ObservationKind::Aiming29,
                ObservationsArg::Shooting => ObservationKind::Shooting31,
            };
        }
        settings.action_history = self.action_history.unwrap_or(settings.action_history);
        if let Some(games) = self.games {
            settings.evaluation.games_per_opponent = games;
            if games == 0 {
                settings.evaluation.games_per_pair = 0;
            }
        }
        settings.biscuits |= self.biscuits;
        if self.no_sensors {
            settings.sensors = None;
        } else if self.ekf.is_some() || self.settings.is_none() {
            settings.sensors = sensors_of(self.ekf.as_deref(), &self.actuator)?;
        }
        if self.rig.is_some() {
            let untuned = SensorSettings::of(FilterSettings::default());
            settings.sensors = settings.sensors.or(Some(untuned));
        }
        if self.randomize {
            settings.randomization = RandomizationKind::Paper;
        }
        Ok(settings)
    }

    /// Settings of a run that may continue the one in `policy`: its learning rate goes on as planned
    /// there. With more steps than planned it decays to zero at the new end.
    fn continued(&self, settings: TrainSettings, policy: &Path) -> anyhow::Result<TrainSettings> {
        if !self.resume || self.settings.is_some() || !policy.exists() {
            return Ok(settings);
        }
        let stored = read_policy(&Recording::open(policy)?)?.settings;
        let anneal_transitions =
            stored.anneal_transitions.map(|planned| planned.max(settings.steps));
        Ok(TrainSettings { anneal_transitions, ..settings })
    }

    /// Command line with every option that decides the result; the settings are in their own file.
    fn command_line(&self, settings: &TrainSettings) -> String {
        let hidden: Vec<String> = settings.ppo.hidden.iter().map(ToString::to_string).collect();
        format!(
            "klasktron train --settings settings.json --steps {} --envs {} --hidden {} --seed {} --actuator {}",
            settings.steps,
            settings.environments,
            hidden.join(","),
            settings.seed,
            self.actuator.display()
        ) + &self.rig.as_ref().map_or_else(String::new, |rig| format!(" --rig {}", rig.display()))
    }

    fn places(&self) -> Places {
        if self.output.extension().is_some_and(|extension| extension == "mcap") {
            let page = self.output.with_extension("html");
            let curve = self.output.with_extension("parquet");
            return Places { policy: self.output.clone(), page, curve };
        }
        let place = |name: &str| self.output.join(name);
        Places {
            policy: place("policy.mcap"),
            page: place("index.html"),
            curve: place("curve.parquet"),
        }
    }
}

impl Task {
    /// Begin a new run, or continue one.
    fn begin(&self, args: &Args) -> anyhow::Result<Run> {
        let policy = &self.places.policy;
        let machine = Machine { threads: self.threads, clock };
        if args.resume && policy.exists() {
            let recording = Recording::open(policy)?;
            let checkpoint = read_checkpoint(&recording, &self.settings, &self.actuator)?;
            let run = Run::resume(&self.settings, &self.game, machine, checkpoint)?;
            return self.placed(run);
        }
        if args.resume {
            note(&format!(
                "{}: no checkpoint to continue from; a new run begins",
                policy.display()
            ));
        }
        for existing in [policy, &self.places.page, &self.places.curve] {
            if existing.exists() && !args.resume && !args.overwrite.overwrite {
                bail!(
                    "{}: exists already; continue with --resume, replace it with --overwrite, or give \
                     another --output",
                    existing.display()
                );
            }
        }
        if let Some(folder) = policy.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder)
                .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
        }
        self.placed(Run::new(&self.settings, &self.game, machine)?)
    }

    /// The run on the rig, if there is one.
    fn placed(&self, run: Run) -> anyhow::Result<Run> {
        let Some(rig) = &self.rig else { return Ok(run) };
        let filter = self.settings.sensors.map(|sensors| sensors.filter).unwrap_or_default();
        let game = run.game().clone();
        let seed = self.settings.seed;
        let rig = TrainingRig::new(rig.clone(), Robot::default(), filter, game, seed)?;
        Ok(run.in_environments(Box::new(rig)))
    }

    /// Update until training is complete or interrupted; every checkpoint writes the file.
    fn train(
        &self,
        run: &mut Run,
        stop: &AtomicBool,
        mut events: Option<&mut EventFile>,
    ) -> anyhow::Result<()> {
        let bar = progress(run);
        while !run.is_done() && !stop.load(Ordering::Relaxed) {
            let at_checkpoint = run.is_at_checkpoint();
            if let Err(error) = run.update() {
                bar.finish_and_clear();
                return self.keep_checkpoint(run, error);
            }
            if at_checkpoint {
                self.write(run, &self.summary(run, None), &[])?;
            }
            if let Some(point) = run.curve().last() {
                bar.set_position(point.transitions);
                bar.set_message(message(point, run.times()));
                if let Some(events) = events.as_deref_mut() {
                    events
                        .add(point, wall_time())
                        .with_context(|| format!("{}: cannot write", events.path().display()))?;
                }
            }
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Write the run before an error that ended it, and return the error.
    fn keep_checkpoint(&self, run: &Run, error: TrainError) -> anyhow::Result<()> {
        let advice = match error {
            TrainError::NotFinite { .. } => "; try a lower learning_rate",
            // The environments could not be built.
            _ if run.curve().is_empty() => return Err(error.into()),
            _ => "",
        };
        self.write(run, &self.summary(run, None), &[])?;
        let kept = self.places.policy.display();
        Err(anyhow::Error::new(error)
            .context(format!("{kept} keeps the newest checkpoint{advice}")))
    }

    fn summary(&self, run: &Run, evaluation: Option<klasktron::train::Evaluation>) -> Summary {
        Summary::new(run, self.actuator.clone(), evaluation, self.provenance.clone())
    }

    fn write(
        &self,
        run: &Run,
        summary: &Summary,
        samples: &[klasktron::train::SampleGame],
    ) -> anyhow::Result<()> {
        write_policy(run, summary, samples, &self.places.policy)?;
        let page = page(summary, run.curve());
        write_bytes(&self.places.page, ExistingFile::Replace, page.as_bytes())?;
        Ok(())
    }

    /// Write the updates of the policy file as a table.
    fn write_curve(&self) -> anyhow::Result<()> {
        let Places { policy, curve, .. } = &self.places;
        let updates = read_table(&Recording::open(policy)?, UPDATE_TOPIC)?;
        Ok(write_table(&updates, curve, TableFormat::Parquet, ExistingFile::Replace)?)
    }

    /// Evaluate the policy where training is complete, and write the results.
    fn finish(&self, run: &Run) -> anyhow::Result<Summary> {
        log::info!("trained after {:.1} s; evaluating", clock());
        let evaluation = if run.is_done() { Some(evaluate(run, self.threads)?) } else { None };
        let players = [
            Opponent::Policy(Box::new(run.policy()), Choice::Mean),
            Opponent::Scripted(Scripted::Chaser),
        ];
        let samples = play_samples(
            (&run.evaluation_game(), self.settings.layout()),
            &players,
            (self.settings.evaluation.sample_games, self.settings.seed),
        )?;
        let summary = self.summary(run, evaluation);
        self.write(run, &summary, &samples)?;
        if !run.curve().is_empty() {
            self.write_curve()?;
        }
        Ok(summary)
    }
}

/// Time since the first call (s).
fn clock() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Time since the Unix epoch (s).
fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

/// Progress bar of transitions.
fn progress(run: &Run) -> ProgressBar {
    let settings = run.settings();
    let transitions = settings.updates() * settings.transitions_per_update();
    let template = "{msg} {wide_bar} {human_pos}/{human_len} steps, {eta} left";
    terminal::bar(Some(transitions), template)
}

fn message(point: &CurvePoint, times: TimeShares) -> String {
    format!(
        "{:.0} steps/s, return {:+.3}, score {:+.2}, Elo {:.0}, pool {}",
        times.transitions_per_s(),
        point.mean_return,
        point.score().unwrap_or(0.0),
        point.elo,
        point.pool
    )
}

fn json(summary: &Summary, times: TimeShares) -> anyhow::Result<String> {
    let time_shares =
        times.shares().map(|(name, share)| (name.to_owned(), share.into())).into_iter().collect();
    let transitions_per_s = times.transitions_per_s();
    let document = Document { summary, transitions_per_s, time_shares, times };
    Ok(serde_json::to_string_pretty(&document)?)
}

/// Result as a table.
fn table(summary: &Summary, run: &Run, task: &Task) -> String {
    let mut lines = Vec::new();
    if let Some(evaluation) = &summary.evaluation {
        lines.push(format!(
            "{:<14}{:>7}{:>7}{:>7}{:>18}{:>17}{:>16}",
            "opponent", "won", "drawn", "lost", "win rate", "95 %", "goals per min"
        ));
        for judged in &evaluation.opponents {
            let both = judged.score.both();
            let share = |share: f64| format!("{:.1}", 100.0 * share);
            let interval = judged.win_rate_ci95.map_or_else(
                || "-".to_owned(),
                |ci| format!("{} to {}", share(ci.low), share(ci.high)),
            );
            lines.push(format!(
                "{:<14}{:>7}{:>7}{:>7}{:>16} %{:>17}{:>8.2} : {:<5.2}",
                judged.opponent,
                both.won,
                both.drawn,
                both.lost,
                judged.win_rate.map_or_else(|| "-".to_owned(), share),
                interval,
                judged.goals_per_min.mean,
                judged.conceded_goals_per_min.mean
            ));
        }
        let best = evaluation.elo.iter().find(|row| row.player == klasktron::train::LEARNER_NAME);
        if let Some(row) = best {
            let place = evaluation.elo.iter().position(|other| other == row).unwrap_or(0) + 1;
            lines.push(format!(
                "Elo {:.0}, rank {place} of {} in the round robin",
                row.rating,
                evaluation.elo.len()
            ));
        }
    }
    let times = run.times();
    if 0 < times.transitions {
        let shares: Vec<String> = times
            .shares()
            .iter()
            .map(|(name, share)| format!("{name} {:.0} %", 100.0 * share))
            .collect();
        lines.push(format!(
            "{:.0} steps per second: {}",
            times.transitions_per_s(),
            shares.join(", ")
        ));
    }
    let Places { policy, page, curve } = &task.places;
    lines.push(format!("wrote {}, {} and {}", show(policy), show(page), show(curve)));
    lines.join("\n")
}

fn show(path: &Path) -> String {
    path.display().to_string()
}
