//! `klasktron rig`: the virtual rig in its own process, on a bus that other programs open from their side.

use super::{
    Outcome, interrupt, note, print,
    table::{BUS_VARIABLE, CAMERA_VARIABLE, read_or_default},
};
use anyhow::bail;
use klasktron::{
    link::{BusSpec, CameraSender, CameraSpec, Slcan, Transport, TransportSpec},
    rig::{DriveReport, RigConfig, serve},
};
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
    let stop = interrupt::raised_by_ctrl_c("stopping the rig")?;
    note("the rig is running; press Ctrl-C to stop it");
    let mut send_picture = |datagram: &[u8]| {
        if let Some(camera) = &camera {
            camera.send(datagram);
        }
    };
    let report = serve(&*bus, &mut send_picture, config, stop, print_change)?;
    note(&format!(
        "{} frames received, {} sent, {} dropped because the bus was full",
        report.received, report.sent, report.given_up
    ));
    Ok(Outcome::Done)
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
