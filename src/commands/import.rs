//! `klasktron import`: bags, npz, CSV and candump logs become recordings.

use super::{Outcome, note, tell};
use anyhow::Result;
use clap::{Subcommand, ValueEnum};
use klasktron::{
    board::{BoardSize, Frame},
    gantry::CoreXy,
    import::{
        self, AxisColumns, ColumnError, ImportConfig, ImportError, ImportReport, PositionUnit,
        SourceKind, Table,
    },
    recording::{ExistingFile, Split},
};
use std::path::PathBuf;

/// Turn bags, npz, CSV and candump logs into recordings.
///
/// Without a kind, `klasktron import FILE -o OUT` guesses it from the name: a folder, .db3 or .mcap is
/// a bag, then .npz and .log (candump).
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  klasktron import bus.log --output bus.mcap\n  klasktron import csv axis.csv --time t_s --input force_n:N --position position_m -o axis.mcap"
)]
pub(crate) struct Args {
    #[command(subcommand)]
    kind: Option<Kind>,
    #[command(flatten)]
    guessed: GuessedArgs,
}

#[derive(Debug, Subcommand)]
enum Kind {
    /// ROS 2 bags of the KlaskTron table (.db3, .mcap or their folder), each as one run
    Bag(BagArgs),
    /// An npz file of the upstream actuator pipeline
    Npz(NpzArgs),
    /// A CSV table of any single axis
    Csv(CsvArgs),
    /// A `candump -L` log of the drives' bus
    Candump(CandumpArgs),
}

#[derive(Debug, clap::Args)]
struct GuessedArgs {
    /// The file or folder to import
    #[arg(required = true)]
    path: Option<PathBuf>,
    /// The recording to write
    #[arg(short, long, value_name = "OUT", required = true)]
    output: Option<PathBuf>,
    #[command(flatten)]
    labels: LabelArgs,
}

#[derive(Debug, clap::Args)]
struct OutputArgs {
    /// The recording to write
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    labels: LabelArgs,
}

#[derive(Debug, clap::Args)]
struct LabelArgs {
    /// Replace the recording if it is there already
    #[arg(long)]
    overwrite: bool,
    /// Session; by default the source's name
    #[arg(long)]
    session: Option<String>,
    /// What the recording is for; by default from the source's name, else train
    #[arg(long)]
    split: Option<SplitArg>,
    /// Robot; by default "unknown"
    #[arg(long)]
    robot: Option<String>,
}

#[derive(Debug, clap::Args)]
struct BoardArgs {
    /// Short side of the playing field (m)
    #[arg(long, value_name = "METRES", default_value = "0.32", value_parser = parse_side)]
    short_side: f64,
    /// Long side of the playing field (m); older software used 0.44
    #[arg(long, value_name = "METRES", default_value = "0.42", value_parser = parse_side)]
    long_side: f64,
}

#[derive(Debug, clap::Args)]
struct BeltArgs {
    /// Belt per motor turn (m)
    #[arg(long, value_name = "METRES", default_value = "0.04", value_parser = parse_belt)]
    belt_metres_per_turn: CoreXy,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron import bag rosbag2_monday rosbag2_tuesday -o bags.mcap"
)]
struct BagArgs {
    /// Bags: folders, .db3 or .mcap files
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    board: BoardArgs,
    #[command(flatten)]
    belt: BeltArgs,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron import npz run.npz --frame sim-mirrored -o run.mcap")]
struct NpzArgs {
    /// The npz file
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// Frame of its values
    #[arg(long, default_value = "sim-mirrored")]
    frame: FrameArg,
    #[command(flatten)]
    board: BoardArgs,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron import csv axis.csv --time t_s --input force_n:N --position position_m -o axis.mcap"
)]
struct CsvArgs {
    /// The table; its first row holds the column names
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// Column of the time (s)
    #[arg(long, value_name = "COLUMN")]
    time: String,
    /// Column of the input and its unit: m/s, m, N, N m (or Nm), V or A
    #[arg(long, value_name = "COLUMN:UNIT", value_parser = parse_input)]
    input: String,
    /// Column of the position
    #[arg(long, value_name = "COLUMN", required_unless_present = "velocity")]
    position: Option<String>,
    /// Column of the velocity
    #[arg(long, value_name = "COLUMN")]
    velocity: Option<String>,
    /// Unit of the position, and per second of the velocity
    #[arg(long, default_value = "m")]
    position_unit: PositionUnitArg,
    /// Name of the axis in the topics
    #[arg(long, value_name = "NAME", default_value = "axis", value_parser = parse_axis)]
    axis: String,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron import candump bus.log -o bus.mcap")]
struct CandumpArgs {
    /// The log
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// The drives' bus, when the log holds several interfaces
    #[arg(long, value_name = "NAME")]
    interface: Option<String>,
    #[command(flatten)]
    belt: BeltArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SplitArg {
    Train,
    Validation,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrameArg {
    /// ROS topics: origin top left, x right, y down
    Image,
    /// The board frame
    Sim,
    /// The board frame with x mirrored (newer upstream dataset builder)
    SimMirrored,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PositionUnitArg {
    M,
    Rad,
}

/// Runs the import and says what came of it.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    let report = match &args.kind {
        Some(Kind::Bag(bag)) => {
            let table = Table { board: bag.board.size(), gantry: bag.belt.belt_metres_per_turn };
            import::import_bags(&bag.paths, &table, &bag.output.config())?
        }
        Some(Kind::Npz(npz)) => {
            let frame = npz.frame.frame();
            import::import_npz(&npz.path, frame, npz.board.size(), &npz.output.config())?
        }
        Some(Kind::Csv(csv)) => {
            import::import_csv(&csv.path, &csv.columns(), &csv.output.config())?
        }
        Some(Kind::Candump(log)) => {
            let table = Table { gantry: log.belt.belt_metres_per_turn, ..Table::default() };
            let interface = log.interface.as_deref();
            import::import_candump(&log.path, interface, &table, &log.output.config())?
        }
        None => run_guessed(&args.guessed)?,
    };
    Ok(tell_report(&report))
}

fn run_guessed(args: &GuessedArgs) -> Result<ImportReport, ImportError> {
    let path = args.path.clone().unwrap_or_default();
    let config = args.labels.config(args.output.clone().unwrap_or_default());
    let table = Table::default();
    match SourceKind::guess(&path)? {
        SourceKind::Bag => import::import_bags(&[path], &table, &config),
        SourceKind::Npz => import::import_npz(&path, Frame::SimMirrored, table.board, &config),
        SourceKind::Candump => import::import_candump(&path, None, &table, &config),
    }
}

fn tell_report(report: &ImportReport) -> Outcome {
    for count in &report.written {
        note(&format!("imported: {}, {} messages", count.topic, count.messages));
    }
    for notice in &report.notices {
        let say = if notice.is_loss() { tell } else { note };
        say(&notice.to_string());
    }
    if report.is_lossy() { Outcome::Lossy } else { Outcome::Done }
}

impl OutputArgs {
    fn config(&self) -> ImportConfig {
        self.labels.config(self.output.clone())
    }
}

impl LabelArgs {
    fn config(&self, output: PathBuf) -> ImportConfig {
        ImportConfig {
            output,
            existing: if self.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse },
            session: self.session.clone(),
            split: self.split.map(|split| match split {
                SplitArg::Train => Split::Train,
                SplitArg::Validation => Split::Validation,
            }),
            robot: self.robot.clone(),
        }
    }
}

impl BoardArgs {
    fn size(&self) -> BoardSize {
        BoardSize { short_side: self.short_side, long_side: self.long_side }
    }
}

fn parse_side(text: &str) -> Result<f64> {
    let side = text.parse()?;
    BoardSize::new(side, side)?;
    Ok(side)
}

fn parse_belt(text: &str) -> Result<CoreXy> {
    Ok(CoreXy::new(text.parse()?)?)
}

fn parse_input(text: &str) -> Result<String, ColumnError> {
    AxisColumns::new("time", text).position("position").checked_input()?;
    Ok(text.to_owned())
}

fn parse_axis(text: &str) -> Result<String, ColumnError> {
    let columns = AxisColumns::new("time", "input:V").position("position");
    AxisColumns { axis: text.to_owned(), ..columns }.checked_input()?;
    Ok(text.to_owned())
}

impl FrameArg {
    fn frame(self) -> Frame {
        match self {
            Self::Image => Frame::Image,
            Self::Sim => Frame::Sim,
            Self::SimMirrored => Frame::SimMirrored,
        }
    }
}

impl CsvArgs {
    fn columns(&self) -> AxisColumns {
        AxisColumns {
            time: self.time.clone(),
            input: self.input.clone(),
            position: self.position.clone(),
            velocity: self.velocity.clone(),
            position_unit: match self.position_unit {
                PositionUnitArg::M => PositionUnit::Metre,
                PositionUnitArg::Rad => PositionUnit::Radian,
            },
            axis: self.axis.clone(),
        }
    }
}
