//! Arguments of the live view, for every command that has one.

use super::note;
use klasktron::live::{LiveAddress, LiveServer};

/// Argument of the live view.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct LiveArgs {
    /// Send every message to viewers while it is recorded: foxglove, foxglove:PORT or foxglove:HOST:PORT
    #[arg(long, value_name = "foxglove[:PORT]")]
    pub(crate) live: Option<LiveAddress>,
}

impl LiveArgs {
    /// Start the live view, if there is one.
    pub(crate) fn start(&self) -> anyhow::Result<Option<LiveServer>> {
        self.live.as_ref().map(start).transpose()
    }
}

/// Start the live view and print its address.
pub(crate) fn start(address: &LiveAddress) -> anyhow::Result<LiveServer> {
    let server = LiveServer::start(address)?;
    let own = server.address();
    note(&format!("live view: open ws://{own} in Foxglove or Lichtblick"));
    Ok(server)
}

/// Report messages that slow viewers have lost.
pub(crate) fn tell_dropped(server: Option<&LiveServer>) {
    if let Some(dropped) = server.map(LiveServer::dropped).filter(|dropped| 0 < *dropped) {
        note(&format!(
            "live view: {dropped} messages were dropped because a viewer was slow; the recording has them"
        ));
    }
}
