//! `klasktron import`: convert bags, npz, CSV and candump logs into recordings.

use super::{
    Outcome, note,
    results::{OverwriteArgs, write_file},
    tell,
};
use anyhow::Result;
use clap::{ArgMatches, Command, FromArgMatches, Subcommand, ValueEnum, error::ErrorKind};
use klasktron::{
    board::{BoardSize, Frame},
    gantry::CoreXy,
    import::{
        self, AxisColumns, ColumnError, ImportConfig, ImportError, ImportReport, PositionUnit,
        Quantity, SourceKind, Table,
    },
    recording::Split,
};
use std::path::{Path, PathBuf};

/// Convert bags, npz, CSV and candump logs into recordings
///
/// Without a format, `klasktron import FILE -o OUTPUT` takes the format from the name: a folder, .db3 or .mcap
/// is a bag; .npz and .log (candump) are themselves.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  klasktron import bus.log -o bus.mcap\n  klasktron import csv axis.csv --time t_s --input force_n:N --position position_m -o axis.mcap"
)]
pub(crate) struct Args {
    #[command(subcommand)]
    kind: Option<Kind>,
    #[command(flatten)]
    guessed: GuessedArgs,
}

#[derive(Debug, Subcommand)]
enum Kind {
    /// Convert ROS 2 bags of the KlaskTron table (.db3, .mcap or folders), one run each
    Bag(BagArgs),
    /// Convert an npz file of the upstream actuator pipeline
    Npz(NpzArgs),
    /// Convert a CSV table of any single axis
    Csv(CsvArgs),
    /// Convert a `candump -L` log of the drives' bus
    Candump(CandumpArgs),
    /// Convert a raw log of BAM's servo test bench (JSON): voltage to position
    Bam(BamArgs),
}

#[derive(Debug, clap::Args)]
struct GuessedArgs {
    /// File or folder to import
    #[arg(required = true)]
    path: Option<PathBuf>,
    /// Recording to write
    #[arg(short, long, alias = "out", value_name = "FILE", required = true)]
    output: Option<PathBuf>,
    #[command(flatten)]
    labels: LabelArgs,
}

#[derive(Debug, clap::Args)]
struct OutputArgs {
    /// Recording to write
    #[arg(short, long, alias = "out", value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    labels: LabelArgs,
}

#[derive(Debug, clap::Args)]
struct LabelArgs {
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Session name in the metadata [default: the name of the source]
    #[arg(long)]
    session: Option<String>,
    /// Purpose of the recording [default: from the name of the source, or train]
    #[arg(long)]
    split: Option<SplitArg>,
    /// Robot name in the metadata [default: unknown]
    #[arg(long)]
    robot: Option<String>,
}

#[derive(Debug, clap::Args)]
struct BoardArgs {
    /// Short side of the playing field (m)
    #[arg(long, value_name = "METRES", default_value = "0.32", value_parser = parse_side)]
    short_side: f64,
    /// Long side of the playing field (m); older upstream software has 0.44
    #[arg(long, value_name = "METRES", default_value = "0.42", value_parser = parse_side)]
    long_side: f64,
}

#[derive(Debug, clap::Args)]
struct BeltArgs {
    /// Belt travel per motor turn (m)
    #[arg(long, value_name = "METRES", default_value = "0.04", value_parser = parse_belt)]
    belt_metres_per_turn: CoreXy,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron import bag rosbag2_monday rosbag2_tuesday -o bags.mcap"
)]
struct BagArgs {
    /// Bags: folders, .db3 or .mcap files, in the order of the runs
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
    /// npz file
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// Coordinate frame of the values
    #[arg(long, default_value = "sim-mirrored")]
    frame: FrameArg,
    #[command(flatten)]
    board: BoardArgs,
}

/// Checked arguments of `klasktron import csv`.
#[derive(Debug)]
struct CsvArgs {
    paths: Vec<PathBuf>,
    output: OutputArgs,
    columns: AxisColumns,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron import csv axis.csv --time t_s --input force_n:N --position position_m -o axis.mcap\n  klasktron import csv bench.csv --time t:ms --input i:mA --position x:deg --run test -o b.mcap"
)]
struct CsvOptions {
    /// CSV tables with the column names in their first row, in the order of the runs
    ///
    /// Lines that begin with # are comments. Every table needs the same columns.
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    /// Column of the time and its unit: s (default), ms, us, ns or steps
    ///
    /// Sample numbers are steps, with the time step --step-s. A column whose name ends in ':s' or another unit
    /// is given with its unit again, such as t:s:s.
    #[arg(long, value_name = "COLUMN[:UNIT]")]
    time: String,
    /// Time step of the unit steps (s)
    #[arg(long, value_name = "SECONDS")]
    step_s: Option<f64>,
    /// Column of the input and its unit, such as current:mA
    #[arg(long, value_name = "COLUMN:UNIT", long_help = format!(
        "Column of the input and its unit, such as current:mA\n\nUnits: {}. A duty is from -1 to 1 and needs --supply-v.",
        Quantity::Input.unit_list()
    ))]
    input: String,
    /// Factor of the input before its unit applies; a negative one reverses the sign
    #[arg(long, value_name = "FACTOR", default_value = "1", allow_hyphen_values = true)]
    input_scale: f64,
    /// Supply voltage of the unit duty (V)
    #[arg(long, value_name = "VOLTS")]
    supply_v: Option<f64>,
    /// Column of the position and its unit
    #[arg(
        long,
        value_name = "COLUMN[:UNIT]",
        required_unless_present = "velocity",
        long_help = format!("Column of the position and its unit: {}", Quantity::Position.unit_list())
    )]
    position: Option<String>,
    /// Column of the velocity and its unit
    #[arg(
        long,
        value_name = "COLUMN[:UNIT]",
        long_help = format!("Column of the velocity and its unit: {}", Quantity::Velocity.unit_list())
    )]
    velocity: Option<String>,
    /// Unit of a position without its own unit; such a velocity has it per second
    #[arg(long, default_value = "m")]
    position_unit: PositionUnitArg,
    /// Encoder counts per turn, for the units counts and counts/s
    #[arg(long, value_name = "COUNT")]
    counts_per_turn: Option<f64>,
    /// Column whose value changes where a new run begins; the time may restart there
    #[arg(long, value_name = "COLUMN")]
    run: Option<String>,
    /// Name of the axis in the topics
    #[arg(long, value_name = "NAME", default_value = "axis")]
    axis: String,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron import candump bus.log -o bus.mcap")]
struct CandumpArgs {
    /// candump log
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// Interface of the drives' bus, where the log holds several
    #[arg(long, value_name = "NAME")]
    interface: Option<String>,
    #[command(flatten)]
    belt: BeltArgs,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron import bam 2026-01-15.json --full-load 885 -o servo.mcap"
)]
struct BamArgs {
    /// Raw log (JSON) with mass, length and entries
    path: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    /// Load at full duty, such as 885 for a Dynamixel XL330 [default: 1, for loads from -1 to 1]
    #[arg(long, value_name = "LOAD", value_parser = parse_full_load)]
    full_load: Option<f64>,
    /// Name of the axis in the topics
    #[arg(long, value_name = "NAME", default_value = "axis", value_parser = parse_axis)]
    axis: String,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SplitArg {
    Train,
    Validation,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrameArg {
    /// Image frame of the ROS topics: origin top left, x right, y down
    Image,
    /// Board frame
    Sim,
    /// Board frame with x mirrored (newer upstream dataset builder)
    SimMirrored,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PositionUnitArg {
    M,
    Rad,
}

/// Run `klasktron import`.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    let (output, overwrite) = args.output();
    let report = write_file(output, overwrite, |_| args.import())?;
    Ok(tell_report(&report))
}

impl Args {
    /// Path of the recording and the treatment of an existing one.
    fn output(&self) -> (&Path, OverwriteArgs) {
        let own = match &self.kind {
            Some(Kind::Bag(bag)) => &bag.output,
            Some(Kind::Npz(npz)) => &npz.output,
            Some(Kind::Csv(csv)) => &csv.output,
            Some(Kind::Candump(log)) => &log.output,
            Some(Kind::Bam(log)) => &log.output,
            None => {
                let path = self.guessed.output.as_deref().unwrap_or(Path::new(""));
                return (path, self.guessed.labels.overwrite);
            }
        };
        (&own.output, own.labels.overwrite)
    }

    fn import(&self) -> Result<ImportReport> {
        Ok(match &self.kind {
            Some(Kind::Bag(bag)) => {
                let gantry = bag.belt.belt_metres_per_turn;
                let table = Table { board: bag.board.size(), gantry };
                import::import_bags(&bag.paths, &table, &bag.output.config())?
            }
            Some(Kind::Npz(npz)) => {
                let frame = npz.frame.frame();
                import::import_npz(&npz.path, frame, npz.board.size(), &npz.output.config())?
            }
            Some(Kind::Csv(csv)) => {
                import::import_csv(&csv.paths, &csv.columns, &csv.output.config())?
            }
            Some(Kind::Candump(log)) => {
                let table = Table { gantry: log.belt.belt_metres_per_turn, ..Table::default() };
                let interface = log.interface.as_deref();
                import::import_candump(&log.path, interface, &table, &log.output.config())?
            }
            Some(Kind::Bam(log)) => {
                let config = log.output.config();
                import::import_bam(&log.path, &log.axis, log.full_load, &config)?
            }
            None => run_guessed(&self.guessed)?,
        })
    }
}

fn parse_full_load(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(load) if 0.0 < load && load.is_finite() => Ok(load),
        _ => Err("must be a number above 0".to_owned()),
    }
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
            existing: self.overwrite.existing(),
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

fn parse_axis(text: &str) -> Result<String, ColumnError> {
    let columns = AxisColumns::new("time", "input:V").position("position");
    AxisColumns { axis: text.to_owned(), ..columns }.check()?;
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

impl CsvOptions {
    fn columns(&self) -> AxisColumns {
        AxisColumns {
            time: self.time.clone(),
            step_s: self.step_s,
            input: self.input.clone(),
            input_scale: self.input_scale,
            supply_v: self.supply_v,
            position: self.position.clone(),
            velocity: self.velocity.clone(),
            position_unit: match self.position_unit {
                PositionUnitArg::M => PositionUnit::Metre,
                PositionUnitArg::Rad => PositionUnit::Radian,
            },
            counts_per_turn: self.counts_per_turn,
            run: self.run.clone(),
            axis: self.axis.clone(),
        }
    }
}

impl FromArgMatches for CsvArgs {
    /// Check the options together, so that a wrong combination is a usage error.
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let typed = CsvOptions::from_arg_matches(matches)?;
        let columns = typed.columns();
        columns.check().map_err(|error| {
            let command = Command::new("klasktron import csv");
            <CsvOptions as clap::Args>::augment_args(command)
                .error(ErrorKind::ArgumentConflict, error)
        })?;
        Ok(Self { paths: typed.paths, output: typed.output, columns })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Args for CsvArgs {
    fn augment_args(command: Command) -> Command {
        <CsvOptions as clap::Args>::augment_args(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        <CsvOptions as clap::Args>::augment_args_for_update(command)
    }
}
