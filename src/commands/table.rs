//! Arguments of every command that uses a table: bus, camera and robot file, or the virtual rig.

use super::tell;
use anyhow::{Context, bail};
use clap::ValueEnum;
use klasktron::{
    camera::{CameraDocument, DetectingCamera, Detector, DetectorDocument, PoseCheck, SourceSpec},
    gantry::Robot,
    link::{
        BusLock, BusSpec, CameraFeed, CameraSocket, CameraSpec, Link, LiveLink, Replay, ReplayLink,
        TransportSpec,
    },
    rig::{RigConfig, Speed, Truth, VIRTUAL_START, VirtualLink},
    units::Nanos,
};
use std::{
    env, fmt, fs,
    path::{Path, PathBuf},
    str::FromStr,
    time::{SystemTime, UNIX_EPOCH},
};

/// Environment variable for `--bus`.
pub(crate) const BUS_VARIABLE: &str = "KLASKTRON_BUS";
/// Environment variable for `--camera`.
pub(crate) const CAMERA_VARIABLE: &str = "KLASKTRON_CAMERA";
/// Environment variable for `--robot`.
pub(crate) const ROBOT_VARIABLE: &str = "KLASKTRON_ROBOT";

#[derive(Debug, clap::Args)]
pub(crate) struct TableArgs {
    /// CAN bus: socketcan:can0, slcan:/dev/ttyACM0, socketcand:host:port, replay:FILE or virtual
    #[arg(long, value_name = "BUS", env = BUS_VARIABLE, hide_env_values = true, default_value = "virtual")]
    pub(crate) bus: BusSpec,
    /// Camera: v4l2:DEVICE detects in this program, udp:HOST:PORT or unix:PATH receives detections of another one;
    /// virtual draws frames of the virtual rig and detects in them
    #[arg(long, value_name = "CAMERA", env = CAMERA_VARIABLE, hide_env_values = true)]
    camera: Option<CameraAddress>,
    #[command(flatten)]
    detector: DetectorArgs,
    /// Robot file (JSON): drives, workspace, limits, time-outs [default: the KlaskTron table]
    #[arg(long, value_name = "FILE", env = ROBOT_VARIABLE, hide_env_values = true)]
    robot: Option<PathBuf>,
    /// Parameters and hidden effects of the virtual rig (JSON)
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Speed of the virtual rig
    #[arg(long, value_enum, default_value = "real")]
    speed: SpeedArg,
}

/// Files of a camera that detects in this program.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct DetectorArgs {
    /// Calibration of a camera that detects in this program, from `klasktron calibrate-camera`
    #[arg(long, value_name = "FILE", default_value = "camera.json")]
    pub(crate) calibration: PathBuf,
    /// Colours of its detector, from `klasktron tune-detector`
    #[arg(long, value_name = "FILE", default_value = "detector.json")]
    detector: PathBuf,
}

impl DetectorArgs {
    /// Read both files, and combine a source of frames with the detector and the check of the camera's pose.
    pub(crate) fn camera(&self, source: &SourceSpec) -> anyhow::Result<DetectingCamera> {
        let calibration = read_json(&self.calibration, |text| {
            let document = CameraDocument::from_json(text)?;
            let camera = document.camera()?;
            Ok((document, camera))
        })?;
        let (calibration, camera) = calibration;
        let document = read_json(&self.detector, |text| Ok(DetectorDocument::from_json(text)?))?;
        let detector = Detector::new(&camera, &document)?;
        let check = PoseCheck::new(&calibration, document.board()?);
        Ok(DetectingCamera::new(source.open()?, detector, check))
    }
}

/// Value of `--camera`: detections of another program, or frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum CameraAddress {
    /// Socket for detections.
    Socket(CameraSpec),
    /// Frames, detected in this program.
    Frames(SourceSpec),
}

impl FromStr for CameraAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let socket = text.parse().map(Self::Socket);
        socket.or_else(|_no_socket| text.parse().map(Self::Frames)).map_err(|_no_source| {
            format!(
                "'{text}' names no camera; write v4l2:/dev/video0, virtual, udp:HOST:PORT or unix:PATH"
            )
        })
    }
}

impl fmt::Display for CameraAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(spec) => spec.fmt(f),
            Self::Frames(spec) => spec.fmt(f),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SpeedArg {
    /// Real time
    Real,
    /// As fast as the computer can simulate
    Max,
}

/// Contents of the robot and the rig file.
pub(crate) struct TableFiles {
    pub(crate) robot: Robot,
    pub(crate) rig: RigConfig,
}

impl TableArgs {
    /// Read the robot and the rig file; without a rig file the rig is `usual_rig`.
    pub(crate) fn read_files(&self, usual_rig: RigConfig) -> anyhow::Result<TableFiles> {
        let virtual_only = self.rig.is_some() || self.speed == SpeedArg::Max;
        if virtual_only && self.bus != BusSpec::Virtual {
            bail!("--rig and --speed max are for --bus virtual, but the bus is {}", self.bus);
        }
        Ok(TableFiles {
            robot: read_or_default(self.robot.as_deref(), |text| Ok(Robot::from_json(text)?))?,
            rig: match self.rig.as_deref() {
                Some(path) => read_rig(path)?,
                None => usual_rig,
            },
        })
    }

    /// Return whether there is a camera.
    pub(crate) fn has_camera(&self) -> bool {
        self.camera.is_some() || self.bus == BusSpec::Virtual
    }

    /// Source for the recording's metadata: `virtual`, `import` or `hardware`.
    pub(crate) fn source(&self) -> &'static str {
        match self.bus {
            BusSpec::Virtual => "virtual",
            BusSpec::Replay(_) => "import",
            BusSpec::Live(_) => "hardware",
        }
    }

    /// Connect to the table. The lock of its device is held as long as the link.
    pub(crate) fn open(&self, files: &TableFiles) -> anyhow::Result<OpenTable> {
        match &self.bus {
            BusSpec::Virtual => {
                let link = self.virtual_link(files)?;
                let draws = self.camera == Some(CameraAddress::Frames(SourceSpec::Virtual));
                if self.camera.is_some() && !draws && !self.is_camera_of_environment() {
                    bail!(
                        "the virtual rig has its own camera; omit --camera, or give --camera virtual for drawn frames"
                    );
                }
                let link = if draws { super::drawn::with_vision(link, &files.rig)? } else { link };
                Ok(OpenTable::Virtual(Box::new(link)))
            }
            BusSpec::Replay(path) => {
                let link = ReplayLink::new(Replay::open(path, None)?)?;
                Ok(OpenTable::Other { link: Box::new(link), _lock: None })
            }
            BusSpec::Live(transport) => self.open_live(transport, &files.robot),
        }
    }

    /// Return whether the camera is the one of the environment, which is meant for the real table.
    fn is_camera_of_environment(&self) -> bool {
        let variable = env::var(CAMERA_VARIABLE).ok().and_then(|text| text.parse().ok());
        variable.is_some() && self.camera == variable
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
        let camera = self.camera.as_ref().map(|own| self.open_camera(own)).transpose()?;
        let link = Box::new(LiveLink::start(bus, camera)?);
        Ok(OpenTable::Other { link, _lock: Some(lock) })
    }
}

impl TableArgs {
    fn open_camera(&self, address: &CameraAddress) -> anyhow::Result<Box<dyn CameraFeed>> {
        match address {
            CameraAddress::Socket(spec) => Ok(Box::new(CameraSocket::bind(spec)?)),
            CameraAddress::Frames(spec) => {
                let camera = self.detector.camera(spec)?;
                Ok(Box::new(camera.with_report(|own| tell(&format!("warning: {own}")))))
            }
        }
    }
}

/// Connection to a table.
pub(crate) enum OpenTable {
    /// Rig in this process.
    Virtual(Box<VirtualLink>),
    /// Any other link, with the lock of its device.
    Other { link: Box<dyn Link>, _lock: Option<BusLock> },
}

impl OpenTable {
    /// Link to drives and camera.
    pub(crate) fn link(&mut self) -> &mut dyn Link {
        match self {
            Self::Virtual(link) => &mut **link,
            Self::Other { link, .. } => &mut **link,
        }
    }

    /// Ground truth of the virtual rig; `None` on a real table.
    pub(crate) fn truth(&self) -> Option<Truth> {
        match self {
            Self::Virtual(link) => Some(link.truth()),
            Self::Other { .. } => None,
        }
    }
}

/// Contents of a JSON file, or the default without a file.
pub(crate) fn read_or_default<T: Default>(
    path: Option<&Path>,
    parse: impl Fn(&str) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    path.map_or_else(|| Ok(T::default()), |path| read_json(path, parse))
}

/// Read the file of a virtual rig.
pub(crate) fn read_rig(path: &Path) -> anyhow::Result<RigConfig> {
    read_json(path, |text| Ok(RigConfig::from_json(text)?))
}

fn read_json<T>(path: &Path, parse: impl Fn(&str) -> anyhow::Result<T>) -> anyhow::Result<T> {
    let file = path.display();
    let text = fs::read_to_string(path).with_context(|| format!("{file}: cannot read"))?;
    parse(&text).with_context(|| format!("{file}"))
}

/// Parse a number within a range, for an option.
pub(crate) fn parse_within(text: &str, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if low <= value && value <= high => Ok(value),
        _ => Err(format!("must be a number from {low} to {high} {unit}")),
    }
}

/// System time since the Unix epoch.
pub(crate) fn system_time() -> Nanos {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Nanos(since.as_nanos() as u64)
}
