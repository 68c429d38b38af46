//! The live view of the program, with a WebSocket client.

use crate::support::{klasktron, said};
use klasktron::{
    recording::{Recording, topic},
    scene::SceneUpdate,
};
use prost::Message as _;
use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};
use tungstenite::{Message, WebSocket, client::IntoClientRequest};

const MATCH: &str = "tests/data/example-match.mcap";

/// Log times and contents by topic.
type Messages = BTreeMap<String, Vec<(u64, Vec<u8>)>>;

/// The program with a live view on a free port.
struct Program {
    child: Child,
    address: String,
}

impl Program {
    fn start(words: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
        command.args(words).args(["--live", "foxglove:0"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let found = lines.find_map(|line| {
            let line = line.unwrap();
            let (_, after) = line.split_once("ws://")?;
            Some(after.split(' ').next().unwrap().to_owned())
        });
        // The pipe must not fill.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, address: found.unwrap() }
    }

    /// Messages by topic until the program ends.
    fn watch(mut self) -> (Messages, i32) {
        let mut socket = connect(&self.address);
        let mut topics = BTreeMap::new();
        let mut messages = Messages::new();
        loop {
            match socket.read() {
                Ok(Message::Text(text)) => subscribe(&mut socket, &text, &mut topics),
                Ok(Message::Binary(bytes)) => {
                    let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                    let time = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                    let topic: &String = &topics[&id];
                    let own = messages.entry(topic.clone()).or_default();
                    own.push((time, bytes[13..].to_vec()));
                }
                Ok(_) => {}
                Err(_) => return (messages, self.child.wait().unwrap().code().unwrap()),
            }
        }
    }
}

fn connect(address: &str) -> WebSocket<TcpStream> {
    let mut request = format!("ws://{address}").into_client_request().unwrap();
    let subprotocol = "foxglove.sdk.v1".parse().unwrap();
    request.headers_mut().insert("Sec-WebSocket-Protocol", subprotocol);
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    tungstenite::client(request, stream).unwrap().0
}

/// Subscribe to every advertised channel.
fn subscribe(socket: &mut WebSocket<TcpStream>, text: &str, topics: &mut BTreeMap<u32, String>) {
    let message: serde_json::Value = serde_json::from_str(text).unwrap();
    let Some(channels) = message["channels"].as_array() else { return };
    let mut entries = Vec::new();
    for channel in channels {
        let id = topics.len() as u32;
        topics.insert(id, channel["topic"].as_str().unwrap().to_owned());
        entries.push(serde_json::json!({"id": id, "channelId": channel["id"]}));
    }
    let request = serde_json::json!({"op": "subscribe", "subscriptions": entries});
    socket.send(Message::text(request.to_string())).unwrap();
}

#[test]
fn a_replay_sends_the_recording_and_its_scene() {
    let (messages, status) = Program::start(&["replay", MATCH, "--rate", "20"]).watch();
    assert_eq!(status, 0);
    let recording = Recording::open(Path::new(MATCH)).unwrap();
    for channel in &recording.channels {
        let sent = &messages[&channel.topic];
        let written: Vec<(u64, &[u8])> =
            channel.raw().map(|(index, data)| (index.log_time.0, data)).collect();
        // The first messages may come before the subscription to their topic.
        let sent: Vec<(u64, &[u8])> =
            sent.iter().map(|(time, data)| (*time, data.as_slice())).collect();
        let missing = written.len() - sent.len();
        assert!(missing <= written.len() / 10 + 2, "{}: {missing} missing", channel.topic);
        assert!(sent.iter().all(|own| written.contains(own)), "{}", channel.topic);
    }
    let scenes = &messages[topic::SCENE];
    let update = SceneUpdate::decode(scenes.last().unwrap().1.as_slice()).unwrap();
    let ids: Vec<&str> = update.entities.iter().map(|entity| entity.id.as_str()).collect();
    for id in ["ball", "left", "right"] {
        assert!(ids.contains(&id), "{id} is not in {ids:?}");
    }
}

#[test]
fn a_session_shows_what_it_records_and_records_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run.mcap");
    let path = out.to_str().unwrap();
    let words =
        ["collect", "--pattern", "circle", "--seconds", "2", "--player", "left", "-o", path];
    let (messages, status) = Program::start(&words).watch();
    // A loaded host may miss deadlines of the control loop, which is status 3.
    assert!([0, 3].contains(&status), "{status}");
    let recording = Recording::open(&out).unwrap();
    for name in ["/striker/left/carriage", "/motor/left/a", "/collect/tick", topic::SCENE] {
        let written = recording.channels_of(name).flat_map(|channel| channel.raw());
        let written: Vec<(u64, &[u8])> =
            written.map(|(index, data)| (index.log_time.0, data)).collect();
        let sent = &messages[name];
        assert!(written.len() / 2 < sent.len(), "{name}: {} of {}", sent.len(), written.len());
        assert!(sent.iter().all(|(time, data)| written.contains(&(*time, data.as_slice()))));
    }
    let updates = recording.channels_of(topic::SCENE).flat_map(|channel| channel.raw());
    let entities = updates.flat_map(|(_, data)| SceneUpdate::decode(data).unwrap().entities);
    let ids: std::collections::BTreeSet<String> = entities.map(|entity| entity.id).collect();
    for id in ["board", "carriage_left", "estimate_left", "left", "path_left"] {
        assert!(ids.contains(id), "{id} is not in {ids:?}");
    }
}

#[test]
fn mistakes_end_with_one_sentence_before_anything_is_driven() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let live = format!("foxglove:{port}");
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run.mcap");
    let out = out.to_str().unwrap();
    let collect = ["collect", "--pattern", "circle", "-o", out];
    let play =
        ["play", "--left", "chaser", "--right", "chaser", "--simulation", "ideal", "-o", out];
    let cases: [(&[&str], &str, i32, &str); 5] = [
        (&collect, &live, 1, "another program uses port"),
        (&["replay", MATCH], &live, 1, "another program uses port"),
        (&collect, "rviz", 2, "'rviz' is no live view; write foxglove"),
        (&play, "foxglove:0", 1, "--simulation runs faster than real time"),
        (&["replay", MATCH, "--start-offset-s", "1e6"], "foxglove:0", 1, "no message at or after"),
    ];
    for (words, live, expected, sentence) in cases {
        let (stdout, stderr, status) = said(&klasktron(&[words, &["--live", live]].concat()));
        assert_eq!(status, expected, "{words:?}: {stderr}");
        assert!(stdout.is_empty() && stderr.contains(sentence), "{words:?}: {stderr}");
        assert!(expected == 2 || stderr.trim_end().lines().count() == 1, "{stderr}");
        assert!(std::fs::read_dir(dir.path()).unwrap().next().is_none());
    }
}

/// Strings below `value` that are paths of messages.
fn message_paths(value: &serde_json::Value, found: &mut Vec<String>) {
    match value {
        serde_json::Value::Object(entries) => {
            let paths = ["value", "topicPath"].iter().filter_map(|key| entries.get(*key)?.as_str());
            found.extend(paths.map(str::to_owned));
            entries.values().for_each(|own| message_paths(own, found));
        }
        serde_json::Value::Array(entries) => {
            entries.iter().for_each(|own| message_paths(own, found));
        }
        _ => {}
    }
}

#[test]
fn the_layout_shows_topics_of_the_contract_and_every_panel_has_settings() {
    let text = include_str!("../../docs/foxglove/klasktron.json");
    let layout: serde_json::Value = serde_json::from_str(text).unwrap();
    let mut paths = Vec::new();
    message_paths(&layout["configById"], &mut paths);
    assert!(15 < paths.len(), "{paths:?}");
    for path in paths {
        let name = path.split('.').next().unwrap();
        assert!(topic::schema_of(name).is_some(), "{path} is of no topic");
    }
    let panels = layout["configById"].as_object().unwrap();
    let arranged = layout["layout"].to_string();
    for panel in panels.keys() {
        assert!(arranged.contains(&format!("\"{panel}\"")), "{panel} is not in the layout");
    }
    assert!(layout["configById"]["3D!scene"]["topics"][topic::SCENE].is_object());
}
