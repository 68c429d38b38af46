//! `klasktron simulate`: open-loop simulation of a twin.

use super::{
    Outcome, loss_sentence, note,
    results::{OverwriteArgs, refuse_existing_file, write_file},
    tell,
};
use anyhow::{Context as _, bail};
use klasktron::{
    import::{column_names, read_columns},
    provenance::Provenance,
    recording::{ExistingFile, Recording, sha256_of_file, topic::Player, write_bytes},
    twin::{
        self, Machine, Twin,
        simulation::{
            AxisInputs, INPUT_COLUMNS, RecordInfo, SimulationError, TableCommands, axis_csv,
            simulate_axis, simulate_table, table_csv, write_axis_recording, write_table_recording,
        },
    },
};
use std::path::{Path, PathBuf};

/// Farthest initial position (m or rad).
const FARTHEST: f64 = 100.0;
/// Column of the time in a CSV file of commands (s).
const TIME: &str = "time_s";
/// Columns of the velocity commands of a table.
const VELOCITIES: [&str; 2] = ["command_vx_m_per_s", "command_vy_m_per_s"];

/// Arguments of `klasktron simulate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Commands in CSV:
  table        time_s, command_vx_m_per_s, command_vy_m_per_s (board frame, held until the next row)
  single axis  time_s and one of force_n, torque_nm, current_a, voltage_v, setpoint_m_per_s, setpoint_rad_per_s
               (linear between rows)

Examples:
  klasktron simulate gap/twin.json --commands validation.mcap -o simulation.mcap
  klasktron simulate twin.json --commands circle.csv --start 0.05,-0.1 -o circle.mcap")]
pub(crate) struct Args {
    /// The twin to simulate
    twin: PathBuf,
    /// Commands: a recording (MCAP), or a CSV table
    #[arg(long, value_name = "FILE")]
    commands: PathBuf,
    /// Recording to write; the same motion is written as CSV next to it
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "simulation.mcap")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Player whose commands are simulated [default: the one with more commands, left for CSV]
    #[arg(long, value_name = "PLAYER")]
    player: Option<PlayerArg>,
    /// Axis whose inputs are simulated [default: the only one]
    #[arg(long, value_name = "NAME")]
    axis: Option<String>,
    /// Initial position X,Y of the carriage (m), or of a single axis (m or rad) [default: the first
    /// measured one, 0 for CSV]
    #[arg(
        long,
        value_name = "X,Y",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        value_parser = parse_position
    )]
    start: Vec<f64>,
    /// Rate of motors and carriage (Hz)
    #[arg(long, value_name = "HZ", default_value = "200", value_parser = parse_rate)]
    rate: f64,
    /// Rate of the camera frames (Hz)
    #[arg(long, value_name = "HZ", default_value = "120", value_parser = parse_rate)]
    frame_rate: f64,
}

/// Player of the commands.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PlayerArg {
    Left,
    Right,
}

fn parse_position(text: &str) -> Result<f64, String> {
    let position = text.parse::<f64>().map_err(|error| error.to_string())?;
    if position.abs() <= FARTHEST {
        Ok(position)
    } else {
        Err(format!("allowed are -{FARTHEST} to {FARTHEST}"))
    }
}

fn parse_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().map_err(|error| error.to_string())?;
    if (1.0..=1000.0).contains(&rate) {
        Ok(rate)
    } else {
        Err("allowed are 1 to 1000 Hz".to_owned())
    }
}

/// File with commands, opened.
enum Source {
    Recording(Box<Recording>),
    Csv(PathBuf),
}

/// Run `klasktron simulate`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let csv_path = args.output.with_extension("csv");
    if csv_path == args.output {
        bail!(
            "{}: the output is a recording; name it *.mcap, the CSV is written next to it",
            args.output.display()
        );
    }
    for path in [&args.output, &csv_path] {
        if [&args.commands, &args.twin].iter().any(|input| is_same_file(input, path)) {
            bail!("{}: is an input; give another --output", path.display());
        }
        refuse_existing_file(path, args.overwrite)?;
    }
    let twin = twin::read_twin(&args.twin)?;
    let source = Source::open(&args.commands)?;
    let mut info = args.record_info()?;
    let mut outcome = Outcome::Done;
    if let Source::Recording(recording) = &source {
        info = info.like(recording)?;
        if !recording.loss.is_none() {
            tell(&format!("warning: {}", loss_sentence(recording)));
            outcome = Outcome::Lossy;
        }
    }
    let (csv, seconds) = write_file(&args.output, args.overwrite, |existing| {
        let to = (args.output.as_path(), existing);
        match twin.machine {
            Machine::Table => simulated_table(args, &twin, &source, &info, to),
            Machine::Axis => simulated_axis(args, &twin, &source, &info, to),
        }
    })?;
    write_file(&csv_path, args.overwrite, |existing| {
        Ok(write_bytes(&csv_path, existing, csv.as_bytes())?)
    })?;
    note(&format!(
        "simulated {seconds:.1} s; wrote {} and {}",
        args.output.display(),
        csv_path.display()
    ));
    Ok(outcome)
}

/// Return whether two paths lead to the same existing file.
fn is_same_file(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Simulate a table and write the recording; the CSV and the duration (s).
fn simulated_table(
    args: &Args,
    twin: &Twin,
    source: &Source,
    info: &RecordInfo,
    to: (&Path, ExistingFile),
) -> anyhow::Result<(String, f64)> {
    let mut commands = source.table_commands(args.player.map(PlayerArg::player))?;
    match args.start[..] {
        [] => {}
        [x, y] => commands.start = [x, y],
        _ => bail!("--start has {} values; a table needs X,Y", args.start.len()),
    }
    let motion = simulate_table(twin, &commands, args.rate, args.frame_rate);
    write_table_recording(twin, &commands, &motion, info, to)?;
    Ok((table_csv(&commands, &motion), commands.end))
}

/// Simulate a single axis and write the recording; the CSV and the duration (s).
fn simulated_axis(
    args: &Args,
    twin: &Twin,
    source: &Source,
    info: &RecordInfo,
    to: (&Path, ExistingFile),
) -> anyhow::Result<(String, f64)> {
    let mut inputs = source.axis_inputs(args.axis.as_deref())?.for_twin(twin)?;
    match args.start[..] {
        [] => {}
        [position] => inputs.start = [position, 0.0],
        _ => bail!("--start has {} values; a single axis needs one", args.start.len()),
    }
    let motion = simulate_axis(twin, &inputs);
    write_axis_recording(twin, &inputs, &motion, info, to)?;
    let seconds = motion.times.last().copied().unwrap_or(0.0) - motion.times[0];
    Ok((axis_csv(&inputs, &motion), seconds))
}

impl Args {
    /// Origin of the result: inputs with their hashes, and the command without the output path.
    fn record_info(&self) -> anyhow::Result<RecordInfo> {
        let identity = |path: &Path| -> anyhow::Result<(String, String)> {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Ok((name, sha256_of_file(path).with_context(|| path.display().to_string())?))
        };
        let inputs = vec![identity(&self.twin)?, identity(&self.commands)?];
        let line = format!(
            "klasktron simulate {} --commands {}",
            self.twin.display(),
            self.commands.display()
        );
        let stem = self.commands.file_stem().unwrap_or_default().to_string_lossy();
        Ok(RecordInfo::new(format!("{stem}-simulation"), inputs, Provenance::new(line)))
    }
}

impl PlayerArg {
    fn player(self) -> Player {
        match self {
            Self::Left => Player::Left,
            Self::Right => Player::Right,
        }
    }
}

impl Source {
    /// Open the file by its ending.
    fn open(path: &Path) -> anyhow::Result<Self> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match ending.as_str() {
            "mcap" => Ok(Self::Recording(Box::new(Recording::open(path)?))),
            "csv" | "tsv" | "txt" => Ok(Self::Csv(path.to_owned())),
            _ => bail!("{}: commands are a recording (.mcap) or a table (.csv)", path.display()),
        }
    }

    fn table_commands(&self, player: Option<Player>) -> anyhow::Result<TableCommands> {
        let path = match self {
            Self::Recording(recording) => {
                return Ok(TableCommands::from_recording(recording, player)?);
            }
            Self::Csv(path) => path,
        };
        let names = column_names(path)?;
        if !VELOCITIES.iter().any(|column| names.iter().any(|name| name == column))
            && input_column(&names).is_some()
        {
            let (commands, twin) = (Machine::Axis, Machine::Table);
            return Err(SimulationError::OtherMachine { path: path.clone(), commands, twin }.into());
        }
        let rows = read_columns(path, &[TIME, VELOCITIES[0], VELOCITIES[1]])?;
        let origin = rows.first().map_or(0.0, |row| row[0]);
        let times = rows.iter().map(|row| row[0] - origin).collect();
        let velocities = rows.iter().map(|row| [row[1], row[2]]).collect();
        let player = player.unwrap_or(Player::Left);
        Ok(TableCommands::new(path, player, times, velocities)?)
    }

    fn axis_inputs(&self, axis: Option<&str>) -> anyhow::Result<AxisInputs> {
        let path = match self {
            Self::Recording(recording) => return Ok(AxisInputs::from_recording(recording, axis)?),
            Self::Csv(path) => path,
        };
        let names = column_names(path)?;
        let Some((column, unit)) = input_column(&names) else {
            if names.iter().any(|name| VELOCITIES.contains(&name.as_str())) {
                let (commands, twin) = (Machine::Table, Machine::Axis);
                return Err(
                    SimulationError::OtherMachine { path: path.clone(), commands, twin }.into()
                );
            }
            bail!(
                "{}: no input column; expected one of {}; the columns are {}",
                path.display(),
                INPUT_COLUMNS.map(|(column, _)| column).join(", "),
                names.join(", ")
            );
        };
        let rows = read_columns(path, &[TIME, column])?;
        let origin = rows.first().map_or(0.0, |row| row[0]);
        let samples: Vec<(f64, f64)> = rows.iter().map(|row| (row[0] - origin, row[1])).collect();
        Ok(AxisInputs::new(path, axis.unwrap_or("axis"), unit, &samples)?)
    }
}

/// Column and unit of the input of a single axis.
fn input_column(names: &[String]) -> Option<(&'static str, &'static str)> {
    INPUT_COLUMNS.into_iter().find(|(column, _)| names.iter().any(|name| name == column))
}
