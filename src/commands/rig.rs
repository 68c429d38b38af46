//! `klasktron rig`: the virtual rig in its own process, on a bus that other programs open from their side.

use super::{
    Outcome, interrupt,
    live::{self, LiveArgs},
    note, print,
    table::{BUS_VARIABLE, CAMERA_VARIABLE, read_or_default, system_time},
};
use anyhow::bail;
use klasktron::{
    board::BoardSize,
    link::{BusSpec, CameraSender, CameraSpec, Slcan, Transport, TransportSpec, parse_detections},
    live::Publisher,
    recording::{
        message::CarriageState,
        topic::{self, Player},
    },
    rig::{Body, DriveReport, RigConfig, Shown, Truth, serve},
    scene::{self, Scene, SceneSettings, Sight},
    units::Nanos,
};
use prost::Message as _;
use std::{path::PathBuf, sync::Arc};

/// Arguments of `klasktron rig`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: a table on a pair of pseudo-terminals
  socat pty,raw,echo=0,link=/tmp/table pty,raw,echo=0,link=/tmp/host &
  klasktron rig --bus slcan:/tmp/table --camera udp:127.0.0.1:9870 &
  klasktron collect --bus slcan:/tmp/host --camera udp:127.0.0.1:9870 --pattern circle -o circle.mcap")]
pub(crate) struct Args {
    /// CAN bus: slcan:DEVICE (the adapter's side), socketcan:INTERFACE or socketcand:HOST:PORT
    #[arg(long, value_name = "BUS", env = BUS_VARIABLE, hide_env_values = true, required_unless_present = "print_config")]
    bus: Option<BusSpec>,
    /// Address to send camera detections to: udp:HOST:PORT or unix:PATH
    #[arg(long, value_name = "CAMERA", env = CAMERA_VARIABLE, hide_env_values = true)]
    camera: Option<CameraSpec>,
    /// Parameters and hidden effects (JSON)
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArgs,
    /// Print every parameter with its value as JSON and exit
    #[arg(long)]
    print_config: bool,
}

/// Run `klasktron rig` until Ctrl-C.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = read_or_default(args.rig.as_deref(), |text| Ok(RigConfig::from_json(text)?))?;
    if args.print_config {
        print(&serde_json::to_string_pretty(&config)?)?;
        return Ok(Outcome::Done);
    }
    let bus = open_bus(args.bus.as_ref(), config.bus.bitrate)?;
    let camera = args.camera.as_ref().map(CameraSender::connect).transpose()?;
    let server = args.live.start()?;
    let board = BoardSize::new(config.board.short_side_m, config.board.long_side_m)?;
    let mut watch = server.as_ref().map(|own| Watch::new(own.publisher(), board));
    let stop = interrupt::raised_by_ctrl_c("stopping the rig")?;
    note("the rig is running; press Ctrl-C to stop it");
    let report = serve(&*bus, config, stop, |shown| match shown {
        Shown::Frame(datagram) => {
            if let Some(camera) = &camera {
                camera.send(datagram);
            }
            watch.as_mut().into_iter().for_each(|own| own.see_frame(datagram));
        }
        Shown::Drive(report) => print_change(report),
        Shown::Truth(truth) => {
            watch.as_mut().into_iter().for_each(|own| own.see_truth(truth));
        }
    })?;
    live::tell_dropped(server.as_ref());
    note(&format!(
        "{} frames received, {} sent, {} dropped because the bus was full",
        report.received, report.sent, report.given_up
    ));
    Ok(Outcome::Done)
}

/// Live view of a rig: camera, truth and scene.
struct Watch {
    publisher: Publisher,
    scene: Scene,
}

impl Watch {
    fn new(publisher: Publisher, board: BoardSize) -> Self {
        let settings = SceneSettings { board, ..SceneSettings::default() };
        Self { publisher, scene: Scene::new(settings) }
    }

    fn see_frame(&mut self, datagram: &[u8]) {
        // The rig writes valid datagrams, except where a fault of the camera is configured.
        let Ok(detections) = parse_detections(datagram) else { return };
        let now = system_time();
        self.publisher.publish_message(topic::CAMERA_DETECTIONS, now, &detections);
        self.see([now, Nanos(detections.capture_time_ns)], &Sight::Camera(detections));
    }

    fn see_truth(&mut self, truth: &Truth) {
        let (now, state) = (system_time(), truth.board_state());
        self.publisher.publish_message(topic::TRUE_BOARD_STATE, now, &state);
        self.see([now; 2], &Sight::Truth(state));
        for player in Player::BOTH {
            let Body { x, y, vx, vy } = truth.player(player).carriage;
            let state = CarriageState { x, y, vx, vy };
            let topic = format!("/truth{}", topic::carriage(player));
            self.publisher.publish_message(&topic, now, &state);
            self.see([now; 2], &Sight::Carriage(player, state));
        }
    }

    fn see(&mut self, times: [Nanos; 2], sight: &Sight) {
        if let Some(update) = self.scene.see(times, sight) {
            let data = update.encode_to_vec();
            self.publisher.publish(topic::SCENE, &scene::schema(), times[0], &data);
        }
    }
}

/// Print each change of a drive as a line of JSON on stdout.
fn print_change(report: DriveReport) {
    let line = serde_json::json!({
        "elapsed_s": report.elapsed,
        "node": report.node,
        "state": report.state.to_string(),
        "errors": report.errors.to_string(),
        "velocity_turns_per_s": report.velocity_turns_per_s,
    });
    // A closed reader does not stop the rig.
    print(&line.to_string()).ok();
}

fn open_bus(bus: Option<&BusSpec>, bitrate: u32) -> anyhow::Result<Arc<dyn Transport>> {
    match bus {
        Some(BusSpec::Live(TransportSpec::Slcan { port })) => Ok(Arc::new(Slcan::serve(port)?)),
        Some(BusSpec::Live(transport)) => Ok(transport.open(bitrate)?),
        Some(other) => bail!("the rig needs a bus that another program can open, not {other}"),
        None => bail!("give --bus"),
    }
}
