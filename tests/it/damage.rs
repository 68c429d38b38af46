//! Damaged files: any byte string, any cut, any wrong byte. Nothing panics, and what lies before
//! the damage is recovered.

use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, Recording, RecordingWriter, inspect, message, recover, topic,
    },
    units::Nanos,
};
use mcap::{Compression, WriteOptions, records::MessageHeader};
use proptest::prelude::*;
use std::{collections::BTreeMap, fs, io::Cursor, path::PathBuf};

const MESSAGES: u64 = 24;
const COMPRESSIONS: [Option<Compression>; 3] =
    [None, Some(Compression::Zstd), Some(Compression::Lz4)];

/// A file of several chunks whose message `k` is the text `k`, written by the `mcap` crate.
fn chunked(compression: Option<Compression>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = WriteOptions::new()
        .compression(compression)
        .chunk_size(Some(200))
        .create(Cursor::new(&mut bytes))
        .unwrap();
    let channel = writer.add_channel(0, "/text", "text", &BTreeMap::new()).unwrap();
    for k in 0..MESSAGES {
        let header =
            MessageHeader { channel_id: channel, sequence: 0, log_time: k, publish_time: k };
        writer.write_to_known_channel(&header, k.to_string().as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

struct Scratch {
    dir: tempfile::TempDir,
}

impl Scratch {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn file(&self, bytes: &[u8]) -> PathBuf {
        let path = self.dir.path().join("file.mcap");
        fs::write(&path, bytes).unwrap();
        path
    }
}

/// The numbers that the file's messages hold, in file order.
fn numbers(recording: &Recording) -> Vec<u64> {
    let texts = recording.channels_of("/text").flat_map(|channel| channel.raw());
    texts.map(|(_, bytes)| String::from_utf8(bytes.to_vec()).unwrap().parse().unwrap()).collect()
}

#[test]
fn a_cut_at_any_byte_keeps_every_complete_message_before_it() {
    let scratch = Scratch::new();
    for compression in COMPRESSIONS {
        let bytes = chunked(compression);
        let mut before = 0;
        for cut in 8..bytes.len() {
            let recording = Recording::open(&scratch.file(&bytes[..cut])).unwrap();
            let found = numbers(&recording);
            assert_eq!(found, (0..found.len() as u64).collect::<Vec<_>>(), "cut at {cut}");
            assert!(before <= found.len(), "{compression:?}: fewer messages at {cut}");
            assert!(!recording.ends_whole);
            let complete = found.len() as u64 == MESSAGES;
            assert!(complete || !recording.loss.is_none(), "silent loss at {cut}");
            before = found.len();
        }
        assert_eq!(before as u64, MESSAGES);
        let whole = Recording::open(&scratch.file(&bytes)).unwrap();
        assert!(whole.loss.is_none() && whole.ends_whole);
    }
}

#[test]
fn an_uncompressed_cut_chunk_gives_its_complete_messages() {
    let scratch = Scratch::new();
    let bytes = chunked(None);
    // The end of message 5: its two time stamps and its text.
    let mut record = [5_u64.to_le_bytes(), 5_u64.to_le_bytes()].concat();
    record.push(b'5');
    let at = bytes.windows(record.len()).position(|window| window == record).unwrap();
    let end = at + record.len();
    let count = |cut: usize| numbers(&Recording::open(&scratch.file(&bytes[..cut])).unwrap()).len();
    assert_eq!((count(end - 1), count(end)), (5, 6));
}

#[test]
fn any_one_wrong_byte_costs_at_most_what_lies_behind_or_around_it() {
    let scratch = Scratch::new();
    let path = scratch.dir.path().join("copy.mcap");
    for compression in COMPRESSIONS {
        let bytes = chunked(compression);
        for at in 8..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x5a;
            let recording = Recording::open(&scratch.file(&wrong)).unwrap();
            inspect::inspect(&recording).unwrap();
            if at % 16 == 0 {
                recover::write_copy(&recording, &path, ExistingFile::Replace).unwrap();
                assert!(Recording::open(&path).unwrap().loss.is_none());
            }
        }
    }
}

#[test]
fn a_damaged_chunk_is_passed_over_and_counted() {
    let scratch = Scratch::new();
    let mut bytes = chunked(None);
    let at = bytes.windows(2).position(|window| window == b"10").unwrap();
    bytes[at] = b'7';
    let recording = Recording::open(&scratch.file(&bytes)).unwrap();
    assert_eq!((recording.loss.bad_chunks, recording.loss.cut_off_at), (1, None));
    let found = numbers(&recording);
    assert!(found.contains(&0) && found.contains(&(MESSAGES - 1)) && !found.contains(&10));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_bytes_are_read_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let scratch = Scratch::new();
        Recording::open(&scratch.file(&bytes)).ok();
        let mut magic = b"\x89MCAP0\r\n".to_vec();
        magic.extend(&bytes);
        let recording = Recording::open(&scratch.file(&magic));
        if let Ok(recording) = recording {
            inspect::inspect(&recording).ok();
        }
    }

    #[test]
    fn any_record_body_is_read_without_panic(
        opcode in 0_u8..16,
        body in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut bytes = b"\x89MCAP0\r\n".to_vec();
        bytes.push(opcode);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(&body);
        if let Ok(recording) = Recording::open(&Scratch::new().file(&bytes)) {
            inspect::inspect(&recording).ok();
        }
    }

    #[test]
    fn any_message_bytes_are_inspected_and_exported_without_panic(
        body in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        use klasktron::recording::{FILE_DESCRIPTOR_SET, PROTOBUF, RawSchema, table};
        let path = Scratch::new().dir.keep().join("file.mcap");
        let mut writer =
            RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
        let schema = RawSchema {
            name: "klasktron.BoardState",
            encoding: PROTOBUF,
            data: FILE_DESCRIPTOR_SET,
            message_encoding: PROTOBUF,
            channel_metadata: &BTreeMap::new(),
        };
        writer.write_raw(topic::BOARD_STATE, &schema, [Nanos(1); 2], &body).unwrap();
        writer.finish().unwrap();
        let recording = Recording::open(&path).unwrap();
        inspect::inspect(&recording).unwrap();
        table::read_table(&recording, topic::BOARD_STATE).ok();
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }
}

#[test]
fn every_message_type_comes_back_as_it_was_written() {
    use message::*;
    let scratch = Scratch::new();
    let path = scratch.dir.path().join("all.mcap");
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::EverySecond).unwrap();
    let object = Some(ObjectState { x: 0.1, y: -0.2, vx: f64::NAN, vy: f64::INFINITY });
    let point = Some(Point { x: -0.0, y: f64::MIN_POSITIVE });
    macro_rules! round_trip {
        ($($topic:expr => $message:expr),* $(,)?) => {
            $( writer.write_published($topic, Nanos(7), Nanos(5), &$message).unwrap(); )*
            writer.finish().unwrap();
            let recording = Recording::open(&path).unwrap();
            $( {
                fn same<M: prost::Message + prost::Name + Default>(r: &Recording, t: &str, m: &M) {
                    let series = r.series::<M>(t).unwrap();
                    assert_eq!(series.times, [Nanos(7)], "{t}");
                    assert_eq!(series.values[0].encode_to_vec(), m.encode_to_vec(), "{t}");
                    let channel = r.channels_of(t).next().unwrap();
                    assert_eq!(channel.messages[0].publish_time, Nanos(5));
                }
                same(&recording, $topic, &$message);
            } )*
        };
    }
    let drive = DriveStatus { axis_state: 8, bus_voltage_v: Some(23.9), ..Default::default() };
    let motor = MotorState { torque_target_nm: Some(0.0), ..Default::default() };
    round_trip! {
        "/striker/left/command" => VelocityCommand { vx: 0.1, vy: f64::NAN },
        "/striker/left/carriage" => CarriageState { x: 1e-9, y: 2.0, vx: 3.0, vy: -4.0 },
        "/motor/right/a" => motor,
        "/drive/right/b" => drive,
        "/can/frames" => CanFrame { id: 0x7ff, data: vec![0, 255], error: true, ..Default::default() },
        "/camera/detections" => CameraDetections {
            capture_time_ns: u64::MAX,
            ball: point,
            right: point,
            ..CameraDetections::default()
        },
        "/board/state" => BoardState { ball: object, left: None, right: object, status: 31 },
        "/run/marker" => RunMarker { run: 3, pattern: "circle".into(), phase: 1, split: "train".into() },
        "/match/event" => MatchEvent { kind: "goal".into(), confidence: 0.5, ..Default::default() },
        "/axis/slide/input" => AxisInput { value: -1.5, unit: "N".into() },
        "/axis/slide/output" => AxisOutput { position: Some(0.0), velocity: None, position_unit: "m".into() },
    }
}
