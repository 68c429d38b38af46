//! `klasktron replay`: show a recording in a viewer, at the pace of its log times.

use super::{Outcome, live, loss_sentence, note, table::parse_within, tell};
use anyhow::bail;
use klasktron::{
    board::BoardSize,
    collect::{Leg, Plan, check_plan, planned_paths},
    gantry::Robot,
    live::{LiveAddress, LiveServer, Playback, Publisher},
    recording::{Recording, topic},
    scene::{self, PlannedPath, Scene, SceneSettings, Sight},
};
use prost::Message as _;
use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// Interval at which the command looks for viewers.
const PATIENCE: Duration = Duration::from_millis(20);
/// Time for the last messages to leave.
const FAREWELL: Duration = Duration::from_millis(300);

/// Arguments of `klasktron replay`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron replay match.mcap --live foxglove
  klasktron replay match.mcap --live foxglove:9000 --rate 0.25 --start-offset-s 12")]
pub(crate) struct Args {
    /// Recording, or any MCAP file
    file: PathBuf,
    /// Viewer: foxglove, foxglove:PORT or foxglove:HOST:PORT
    #[arg(long, value_name = "foxglove[:PORT]", default_value = "foxglove")]
    live: LiveAddress,
    /// Speed, in multiples of real time
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = parse_rate)]
    rate: f64,
    /// Skip the beginning (s)
    #[arg(long, value_name = "SECONDS", default_value = "0", value_parser = parse_offset)]
    start_offset_s: f64,
}

fn parse_rate(text: &str) -> Result<f64, String> {
    parse_within(text, 0.01, 100.0, "times real time")
}

fn parse_offset(text: &str) -> Result<f64, String> {
    parse_within(text, 0.0, 1e9, "s")
}

/// Run `klasktron replay`: wait for a viewer, then play the recording once.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.file)?;
    let playback = Playback::new(&recording, args.start_offset_s);
    if playback.messages().is_empty() {
        bail!(
            "{}: no message at or after {} s; give a smaller --start-offset-s",
            args.file.display(),
            args.start_offset_s
        );
    }
    let stop = super::interrupt::raised_by_ctrl_c("ending the replay")?;
    let server = live::start(&args.live)?;
    let mut publisher = server.publisher();
    advertise(&playback, &mut publisher);
    wait_for_viewer(&server, stop);
    let mut scene = has_no_scene(&recording).then(|| Scene::new(scene_settings(&recording)));
    let count = playback.run(args.rate, stop, |message| {
        let topic = &message.channel.topic;
        let (log, publish) = (message.index.log_time, message.index.publish_time);
        publisher.publish(topic, &message.channel.raw_schema(), log, message.data);
        let Some(scene) = &mut scene else { return };
        let sight = Sight::decode(topic, message.data);
        if let Some(update) = sight.and_then(|sight| scene.see([log, publish], &sight)) {
            publisher.publish(topic::SCENE, &scene::schema(), log, &update.encode_to_vec());
        }
    });
    thread::sleep(FAREWELL);
    note(&format!("{count} messages sent, {:.1} s of the recording", playback.duration_s()));
    live::tell_dropped(Some(&server));
    if recording.loss.is_none() {
        return Ok(Outcome::Done);
    }
    tell(&loss_sentence(&recording));
    Ok(Outcome::Lossy)
}

/// Advertise every channel, so that a viewer can subscribe before the first message.
fn advertise(playback: &Playback<'_>, publisher: &mut Publisher) {
    for message in playback.messages() {
        publisher.advertise(&message.channel.topic, &message.channel.raw_schema());
    }
    publisher.advertise(topic::SCENE, &scene::schema());
}

fn wait_for_viewer(server: &LiveServer, stop: &AtomicBool) {
    note("the replay starts when a viewer subscribes; press Ctrl-C to end it");
    while server.subscriptions() == 0 && !stop.load(Ordering::Relaxed) {
        thread::sleep(PATIENCE);
    }
}

/// Return whether a scene must be computed.
pub(crate) fn has_no_scene(recording: &Recording) -> bool {
    recording.count(topic::SCENE) == 0
}

/// Size of the board, filter and planned paths, as far as the metadata of a recording has them.
pub(crate) fn scene_settings(recording: &Recording) -> SceneSettings {
    let mut settings = SceneSettings::default();
    let metres = |key: &str| recording.info(key).and_then(|text| text.parse().ok());
    if let (Some(short), Some(long)) = (metres("board_short_side_m"), metres("board_long_side_m"))
        && let Ok(board) = BoardSize::new(short, long)
    {
        settings.board = board;
    }
    let filter = recording.info("filter_json").and_then(|text| serde_json::from_str(text).ok());
    settings.filter = filter.unwrap_or_default();
    settings.paths = paths(recording).unwrap_or_default();
    settings
}

/// Planned paths; `None` for a recording without a plan.
fn paths(recording: &Recording) -> Option<BTreeMap<u32, Vec<PlannedPath>>> {
    let plan = Plan::from_json(recording.info("plan_json")?).ok()?;
    let robot = Robot::from_json(recording.info("robot_json")?).ok()?;
    let driven = |player: &topic::Player| 0 < recording.count(&topic::command(*player));
    let players: Vec<topic::Player> = robot.players().into_iter().filter(driven).collect();
    let checked = check_plan(&plan, &robot, &players).ok()?;
    Some(planned_paths(&Leg::of_plan(&checked)))
}
