//! `klasktron rig`: the virtual rig as a process of its own, on a bus that others open from their side.

use super::{Outcome, interrupt, note, print, table::read_or_default};
use anyhow::bail;
use klasktron::{
    link::{BusSpec, CameraSender, CameraSpec, Slcan, Transport, TransportSpec},
    rig::{DriveReport, RigConfig, serve},
};
use std::{path::PathBuf, sync::Arc};

/// What can be typed after `klasktron rig`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: a table on a pair of pseudo-terminals
  socat pty,raw,echo=0,link=/tmp/table pty,raw,echo=0,link=/tmp/host &
  klasktron rig --bus slcan:/tmp/table --camera udp:127.0.0.1:9870 &
  klasktron collect --bus slcan:/tmp/host --camera udp:127.0.0.1:9870 --pattern circle -o circle.mcap")]
pub(crate) struct Args {
    /// slcan:DEVICE (the adapter's side), socketcan:INTERFACE or socketcand:HOST:PORT
    #[arg(long, value_name = "BUS", required_unless_present = "print_config")]
    bus: Option<BusSpec>,
    /// Where pictures are sent: udp:HOST:PORT or unix:PATH
    #[arg(long, value_name = "CAMERA")]
    camera: Option<CameraSpec>,
    /// Parameters and hidden effects (JSON)
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Print every parameter with its value as JSON, and end
    #[arg(long)]
    print_config: bool,
}

/// Runs the rig until Ctrl-C.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = read_or_default(args.rig.as_deref(), |text| Ok(RigConfig::from_json(text)?))?;
    if args.print_config {
        print(&serde_json::to_string_pretty(&config)?)?;
        return Ok(Outcome::Done);
    }
    let bus = open_bus(args.bus.as_ref(), config.bus.bitrate)?;
    let camera = args.camera.as_ref().map(CameraSender::connect).transpose()?;
    let stop = interrupt::raised_by_ctrl_c("ending the rig")?;
    note("the rig runs; Ctrl-C ends it");
    let mut send_picture = |datagram: &[u8]| {
        if let Some(camera) = &camera {
            camera.send(datagram);
        }
    };
    let report = serve(&*bus, &mut send_picture, config, stop, print_change)?;
    note(&format!(
        "{} frames received, {} sent, {} given up because the bus was full",
        report.received, report.sent, report.given_up
    ));
    Ok(Outcome::Done)
}

/// Each change of a drive is a line of JSON on stdout.
fn print_change(report: DriveReport) {
    let line = serde_json::json!({
        "elapsed_s": report.elapsed,
        "node": report.node,
        "state": report.state.to_string(),
        "errors": report.errors.to_string(),
        "velocity_turns_per_s": report.velocity_turns_per_s,
    });
    // A reader that has gone away does not stop the rig.
    print(&line.to_string()).ok();
}

fn open_bus(bus: Option<&BusSpec>, bitrate: u32) -> anyhow::Result<Arc<dyn Transport>> {
    match bus {
        Some(BusSpec::Live(TransportSpec::Slcan { port })) => Ok(Arc::new(Slcan::serve(port)?)),
        Some(BusSpec::Live(transport)) => Ok(transport.open(bitrate)?),
        Some(other) => bail!("the rig needs a bus that others can open too, not {other}"),
        None => bail!("give --bus"),
    }
}
