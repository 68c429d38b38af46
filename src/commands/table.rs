//! Arguments of every command that works on a table: its bus, camera and robot file, or the virtual rig.

use anyhow::{Context, bail};
use clap::ValueEnum;
use klasktron::{
    gantry::Robot,
    link::{
        BusLock, BusSpec, CameraSocket, CameraSpec, Link, LiveLink, Replay, ReplayLink,
        TransportSpec,
    },
    rig::{RigConfig, Speed, Truth, VirtualLink},
    units::Nanos,
};
use std::{
    fs,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

/// Recordings of the virtual rig at full speed begin at this time (2026-01-01, UTC), so that equal
/// settings give equal bytes.
const VIRTUAL_START: Nanos = Nanos(1_767_225_600_000_000_000);

#[derive(Debug, clap::Args)]
pub(crate) struct TableArgs {
    /// socketcan:can0, slcan:/dev/ttyACM0, socketcand:host:port, replay:FILE or virtual
    #[arg(long, value_name = "BUS", default_value = "virtual")]
    pub(crate) bus: BusSpec,
    /// Where pictures come in: udp:HOST:PORT or unix:PATH; the virtual rig brings its own
    #[arg(long, value_name = "CAMERA")]
    camera: Option<CameraSpec>,
    /// Robot file (JSON): drives, field, limits, time-outs [default: the KlaskTron table]
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Parameters and hidden effects of the virtual rig (JSON)
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// How fast the virtual rig runs
    #[arg(long, value_enum, default_value = "real")]
    speed: SpeedArg,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SpeedArg {
    /// As a real table
    Real,
    /// As fast as it can be computed
    Max,
}

/// The files that the arguments name, read.
pub(crate) struct TableFiles {
    pub(crate) robot: Robot,
    pub(crate) rig: RigConfig,
}

impl TableArgs {
    /// Reads robot and rig file; without a rig file the rig is `usual_rig`.
    pub(crate) fn read_files(&self, usual_rig: RigConfig) -> anyhow::Result<TableFiles> {
        let virtual_only = self.rig.is_some() || self.speed == SpeedArg::Max;
        if virtual_only && self.bus != BusSpec::Virtual {
            bail!("--rig and --speed max are for --bus virtual, but the bus is {}", self.bus);
        }
        Ok(TableFiles {
            robot: read_or_default(self.robot.as_deref(), |text| Ok(Robot::from_json(text)?))?,
            rig: match self.rig.as_deref() {
                Some(path) => read_json(path, |text| Ok(RigConfig::from_json(text)?))?,
                None => usual_rig,
            },
        })
    }

    /// Whether pictures come in.
    pub(crate) fn has_camera(&self) -> bool {
        self.camera.is_some() || self.bus == BusSpec::Virtual
    }

    /// `virtual` or `hardware`, as recordings say it.
    pub(crate) fn source(&self) -> &'static str {
        match self.bus {
            BusSpec::Virtual => "virtual",
            BusSpec::Replay(_) => "import",
            BusSpec::Live(_) => "hardware",
        }
    }

    /// Connects to the table. The lock is held for as long as the link is used.
    pub(crate) fn open(&self, files: &TableFiles) -> anyhow::Result<OpenTable> {
        match &self.bus {
            BusSpec::Virtual => {
                if self.camera.is_some() {
                    bail!("the virtual rig has its own camera; leave --camera out");
                }
                Ok(OpenTable::Virtual(Box::new(self.virtual_link(files)?)))
            }
            BusSpec::Replay(path) => {
                let link = ReplayLink::new(Replay::open(path, None)?)?;
                Ok(OpenTable::Other { link: Box::new(link), _lock: None })
            }
            BusSpec::Live(transport) => self.open_live(transport, &files.robot),
        }
    }

    fn virtual_link(&self, files: &TableFiles) -> anyhow::Result<VirtualLink> {
        let (speed, start) = match self.speed {
            SpeedArg::Max => (Speed::Maximum, VIRTUAL_START),
            SpeedArg::Real => (Speed::RealTime, system_time()),
        };
        Ok(VirtualLink::new(files.rig.clone(), speed, start)?)
    }

    fn open_live(&self, transport: &TransportSpec, robot: &Robot) -> anyhow::Result<OpenTable> {
        let lock = transport.lock()?;
        let bus = transport.open(robot.can.bitrate)?;
        let camera = self.camera.as_ref().map(CameraSocket::bind).transpose()?;
        let link = Box::new(LiveLink::start(bus, camera)?);
        Ok(OpenTable::Other { link, _lock: Some(lock) })
    }
}

/// A connection to a table.
pub(crate) enum OpenTable {
    /// The rig inside this program.
    Virtual(Box<VirtualLink>),
    /// Everything else, with the lock of its device.
    Other { link: Box<dyn Link>, _lock: Option<BusLock> },
}

impl OpenTable {
    /// Its link.
    pub(crate) fn link(&mut self) -> &mut dyn Link {
        match self {
            Self::Virtual(link) => &mut **link,
            Self::Other { link, .. } => &mut **link,
        }
    }

    /// What is really the case, where that is known.
    pub(crate) fn truth(&self) -> Option<Truth> {
        match self {
            Self::Virtual(link) => Some(link.truth()),
            Self::Other { .. } => None,
        }
    }
}

/// What a JSON file says; the default without a file.
pub(crate) fn read_or_default<T: Default>(
    path: Option<&Path>,
    parse: impl Fn(&str) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    path.map_or_else(|| Ok(T::default()), |path| read_json(path, parse))
}

fn read_json<T>(path: &Path, parse: impl Fn(&str) -> anyhow::Result<T>) -> anyhow::Result<T> {
    let file = path.display();
    let text = fs::read_to_string(path).with_context(|| format!("{file}: cannot read"))?;
    parse(&text).with_context(|| format!("{file}"))
}

/// A number within a range, for a flag.
pub(crate) fn parse_within(text: &str, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if low <= value && value <= high => Ok(value),
        _ => Err(format!("must be a number from {low} to {high} {unit}")),
    }
}

/// The system's time, since the Unix epoch.
fn system_time() -> Nanos {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Nanos(since.as_nanos() as u64)
}
