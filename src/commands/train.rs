//! `klasktron train`: settings and an actuator to a policy.

use super::{
    Outcome,
    engine::{EngineArgs, Finished, PrintKind, Sweep, conclude},
    interrupt, note, print, tell, terminal,
};
use anyhow::{Context as _, bail};
use indicatif::ProgressBar;
use klasktron::{
    game::{GameSettings, ObservationKind},
    opponent::Scripted,
    parallel::cores,
    provenance::Provenance,
    recording::{ExistingFile, Recording, write_bytes},
    sweep::{InputHashes, Plan, Point, SlurmRequest, Store, SweptCommand},
    train::{
        ActuatorSource, Choice, Curriculum, CurvePoint, EventFile, Machine, Opponent, OpponentMode,
        Preset, RandomizationKind, RewardSettings, Run, SeedRun, Summary, TimeShares, TrainError,
        TrainSettings, evaluate, game_with_actuator, page, play_samples, read_checkpoint,
        read_curve, seeds_page, write_policy,
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

/// What can be typed after `klasktron train`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron train --steps 20e6 --out policy\n  klasktron train --actuator actuator/actuator.mcap --hidden 256,128,64 --out policy\n  klasktron train --steps 20e6 --out policy --resume\n  klasktron train --steps 20e6 --seeds 5 --out policies"
)]
pub(crate) struct Args {
    /// Transitions of all boards together, such as 20e6 [default: 20e6]
    #[arg(long, value_name = "COUNT", value_parser = parse_steps)]
    steps: Option<u64>,
    /// Boards that are played at once [default: 4096]
    #[arg(long, value_name = "COUNT")]
    envs: Option<usize>,
    /// Widths of the hidden layers, such as 256,128,64 [default: that of the preset]
    #[arg(long, value_name = "UNITS", value_delimiter = ',')]
    hidden: Vec<usize>,
    /// Recipe: the paper's table II, or upstream's for rl_games
    #[arg(long, value_enum, default_value_t = Preset::Paper)]
    preset: Preset,
    /// Settings as JSON, as --print-settings prints them, instead of a preset; flags still win
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    settings: Option<PathBuf>,
    /// What is paid for besides results [default: dense-ball-to-goal]
    #[arg(long, value_enum)]
    curriculum: Option<Curriculum>,
    /// Earlier policies (enhanced self-play, uniformly, the newest) or a script [default: enhanced]
    #[arg(long, value_enum)]
    opponents: Option<OpponentsArg>,
    /// How commands become motion: ideal, a twin.json or an actuator.mcap
    #[arg(long, value_name = "ideal|FILE", default_value = "ideal")]
    actuator: PathBuf,
    /// Draw the physics of every episode from the paper's table III
    #[arg(long)]
    randomize: bool,
    /// Lay three magnets on the board that stick to strikers; two lose the point
    #[arg(long)]
    biscuits: bool,
    /// What players see: 12 standard values, or with 8 angles and distances [default: 20]
    #[arg(long, value_enum)]
    observations: Option<ObservationsArg>,
    /// Games against each scripted player at the end, even; 0 for no judgement [default: 1000]
    #[arg(long, value_name = "COUNT")]
    games: Option<usize>,
    /// Everything random comes from it [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// Train this many seeds from --seed on, each in OUT/seed-N, with one page and table of all
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=1000),
        conflicts_with_all = ["resume", "overwrite", "tensorboard", "print_settings"])]
    seeds: Option<u64>,
    /// Folder for policy.mcap and index.html, or the name of an .mcap file
    #[arg(short, long, value_name = "DIR", default_value = "policy")]
    out: PathBuf,
    /// Go on from the newest checkpoint in OUT, with the bytes of a run that was never interrupted
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    /// Replace a policy that exists already
    #[arg(long)]
    overwrite: bool,
    /// Folder for TensorBoard event files
    #[arg(long, value_name = "DIR")]
    tensorboard: Option<PathBuf>,
    /// Threads; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Print the settings as JSON and end
    #[arg(long)]
    print_settings: bool,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
    /// Leave times out of the document, so that equal results are equal bytes
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
        }
    }
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ObservationsArg {
    #[value(name = "12")]
    Standard,
    #[value(name = "20")]
    Augmented,
}

fn parse_steps(text: &str) -> Result<u64, String> {
    let most = 1e15;
    match text.parse::<f64>() {
        Ok(steps) if (1.0..=most).contains(&steps) && steps.fract() == 0.0 => Ok(steps as u64),
        _ => Err(format!("must be a whole number from 1 to {most:e}, such as 20e6")),
    }
}

/// Where the results go.
struct Places {
    policy: PathBuf,
    page: PathBuf,
}

/// What is trained, on what.
struct Task {
    settings: TrainSettings,
    game: GameSettings,
    actuator: ActuatorSource,
    places: Places,
    provenance: Provenance,
    threads: NonZeroUsize,
}

/// The result document with what no file may hold: times.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    transitions_per_s: f64,
    time_shares: serde_json::Map<String, serde_json::Value>,
    times: TimeShares,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let settings = args.settings()?;
    settings.check()?;
    if args.print_settings {
        print(&settings.to_json())?;
        return Ok(Outcome::Done);
    }
    let (game, actuator) = game_with_actuator(&args.actuator)?;
    if let Some(seeds) = args.seeds {
        return run_seeds(args, &settings, seeds);
    }
    if args.engine.is_given() {
        bail!("options of an engine need --seeds; a single run is made here");
    }
    let provenance = Provenance::new(args.command_line(&settings));
    let threads = args.threads.or_else(|| NonZeroUsize::new(cores()));
    let threads = threads.unwrap_or(NonZeroUsize::MIN);
    let places = args.places();
    let task = Task { settings, game, actuator, places, provenance, threads };
    let mut run = task.begin(args)?;
    let stop = interrupt::raised_by_ctrl_c("finishing the update")?;
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
    Ok(if summary.finished { Outcome::Done } else { Outcome::Lossy })
}

/// Several seeds as points of a sweep.
fn run_seeds(args: &Args, settings: &TrainSettings, seeds: u64) -> anyhow::Result<Outcome> {
    if args.out.extension().is_some_and(|extension| extension == "mcap") {
        bail!("{}: several seeds need a folder, not a file", args.out.display());
    }
    let last = settings.seed.checked_add(seeds - 1);
    let last = last.with_context(|| format!("--seed {} leaves no {seeds} seeds", settings.seed))?;
    let file = args.out.join("settings.json");
    let plan = seeds_plan(args, settings, (&file, last))?;
    let threads = args.threads.map_or_else(cores, NonZeroUsize::get);
    let workers = plan.points.len().min(threads);
    let sweep = Sweep { plan: &plan, out: args.out.clone(), workers };
    if args.engine.is_dry_run() {
        print(&args.engine.dry_run(&sweep)?)?;
        return Ok(Outcome::Done);
    }
    // Refuses the folder of other settings before anything in it is touched.
    Store::open(&args.out)?.finished(&plan.points)?;
    write_bytes(&file, ExistingFile::Replace, settings.to_json().as_bytes())?;
    let finished = args.engine.run(&sweep)?;
    let provenance = Provenance::new(format!("{} --seeds {seeds}", args.command_line(settings)));
    let html = seeds_page(&seed_runs(&sweep, &finished)?, &provenance);
    conclude(&sweep, &finished, (&provenance, &html), PrintKind::of_flag(&args.json))
}

/// A point in `seed-N` for every seed up to `last`; `file` will hold the settings.
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

/// What the page tells of every finished seed.
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
        let mut settings = match &self.settings {
            Some(path) => TrainSettings::read(path)?,
            None => TrainSettings::preset(self.preset),
        };
        settings.steps = self.steps.unwrap_or(settings.steps);
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
        }
        if let Some(observations) = self.observations {
            settings.observations = match observations {
                ObservationsArg::Standard => ObservationKind::Standard12,
                ObservationsArg::Augmented => ObservationKind::Augmented20,
            };
        }
        if let Some(games) = self.games {
            settings.evaluation.games_per_opponent = games;
            if games == 0 {
                settings.evaluation.games_per_pair = 0;
            }
        }
        settings.biscuits |= self.biscuits;
        if self.randomize {
            settings.randomization = RandomizationKind::Paper;
        }
        Ok(settings)
    }

    /// The command with what decides the result, but for the settings, which stand beside it.
    fn command_line(&self, settings: &TrainSettings) -> String {
        let hidden: Vec<String> = settings.ppo.hidden.iter().map(ToString::to_string).collect();
        format!(
            "klasktron train --settings settings.json --steps {} --envs {} --hidden {} --seed {} --actuator {}",
            settings.steps,
            settings.environments,
            hidden.join(","),
            settings.seed,
            self.actuator.display()
        )
    }

    fn places(&self) -> Places {
        if self.out.extension().is_some_and(|extension| extension == "mcap") {
            let page = self.out.with_extension("html");
            return Places { policy: self.out.clone(), page };
        }
        Places { policy: self.out.join("policy.mcap"), page: self.out.join("index.html") }
    }
}

impl Task {
    /// A new run, or one that is taken up again.
    fn begin(&self, args: &Args) -> anyhow::Result<Run> {
        let policy = &self.places.policy;
        let machine = Machine { threads: self.threads, clock };
        if args.resume && policy.exists() {
            let recording = Recording::open(policy)?;
            let checkpoint = read_checkpoint(&recording, &self.settings, &self.actuator)?;
            return Ok(Run::resume(&self.settings, &self.game, machine, checkpoint)?);
        }
        if args.resume {
            note(&format!("{}: nothing to resume; starting anew", policy.display()));
        } else if policy.exists() && !args.overwrite {
            bail!(
                "{}: this policy exists; go on with --resume, replace it with --overwrite, or choose another \
                 --out",
                policy.display()
            );
        }
        if let Some(folder) = policy.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder)
                .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
        }
        Ok(Run::new(&self.settings, &self.game, machine)?)
    }

    /// Updates until all are done or Ctrl-C; the file is written at every checkpoint.
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
                return self.keep_what_is_good(run, error);
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

    /// After a number that is none: the run as it was before, then the error.
    fn keep_what_is_good(&self, run: &Run, error: TrainError) -> anyhow::Result<()> {
        self.write(run, &self.summary(run, None), &[])?;
        let kept = self.places.policy.display();
        Err(anyhow::Error::new(error)
            .context(format!("the newest checkpoint is kept in {kept}; try a lower learning_rate")))
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

    /// Judges the policy when training is done, and writes everything.
    fn finish(&self, run: &Run) -> anyhow::Result<Summary> {
        log::info!("trained after {:.1} s; judging", clock());
        let evaluation = if run.is_done() { Some(evaluate(run, self.threads)?) } else { None };
        let players = [
            Opponent::Policy(Box::new(run.policy()), Choice::Mean),
            Opponent::Scripted(Scripted::Chaser),
        ];
        let samples = play_samples(
            (&run.evaluation_game(), self.settings.observations),
            &players,
            (self.settings.evaluation.sample_games, self.settings.seed),
        )?;
        let summary = self.summary(run, evaluation);
        self.write(run, &summary, &samples)?;
        Ok(summary)
    }
}

/// Seconds since the program first asked.
fn clock() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Seconds since the Unix epoch.
fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

/// A bar of transitions.
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

/// The result for people.
fn table(summary: &Summary, run: &Run, task: &Task) -> String {
    let mut lines = Vec::new();
    if let Some(evaluation) = &summary.evaluation {
        lines.push(format!(
            "{:<14}{:>7}{:>7}{:>7}{:>18}{:>17}{:>16}",
            "against", "won", "drawn", "lost", "won of decided", "95 %", "points per min"
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
                "Elo {:.0}, place {place} of {} in the round robin",
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
    let Places { policy, page } = &task.places;
    lines.push(format!("wrote {} and {}", show(policy), show(page)));
    lines.join("\n")
}

fn show(path: &Path) -> String {
    path.display().to_string()
}
