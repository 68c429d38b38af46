use super::*;
use crate::recording::{
    ExistingFile, FlushPolicy, RecordingWriter,
    message::{CameraDetections, CanFrame, MatchEvent, MotorState, Point},
    topic::{CAMERA_DETECTIONS, CAN_FRAMES, MATCH_EVENT, Motor, Player, motor},
};
use polars::prelude::{ParquetReader, SerReader};
use std::{fs, fs::File};

fn recording(dir: &tempfile::TempDir, write: impl Fn(&mut RecordingWriter)) -> Recording {
    let path = dir.path().join("made.mcap");
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
    write(&mut writer);
    writer.finish().unwrap();
    Recording::open(&path).unwrap()
}

fn exported(recording: &Recording, topic: &str, format: TableFormat) -> std::path::PathBuf {
    let table = read_table(recording, topic).unwrap();
    let path = recording.path.with_file_name("table");
    write_table(&table, &path, format, ExistingFile::Refuse).unwrap();
    path
}

fn detections(capture_time_ns: u64, ball: Option<(f64, f64)>) -> CameraDetections {
    let ball = ball.map(|(x, y)| Point { x, y });
    CameraDetections { capture_time_ns, ball, left: None, right: Some(Point { x: 0.0, y: 0.1 }) }
}

#[test]
fn nested_messages_are_flattened_and_absent_ones_are_null() {
    let dir = tempfile::tempdir().unwrap();
    let made = recording(&dir, |writer| {
        // The second message was received first.
        for (time, message) in
            [(20, detections(19, None)), (10, detections(9, Some((0.0, -0.125))))]
        {
            writer
                .write_published(CAMERA_DETECTIONS, Nanos(time), Nanos(time - 1), &message)
                .unwrap();
        }
    });
    let csv = fs::read_to_string(exported(&made, CAMERA_DETECTIONS, TableFormat::Csv)).unwrap();
    let golden = "\
log_time_ns,publish_time_ns,capture_time_ns,ball.x,ball.y,left.x,left.y,right.x,right.y
10,9,9,0.0,-0.125,,,0.0,0.1
20,19,19,,,,,0.0,0.1
";
    assert_eq!(csv, golden);
}

#[test]
fn bytes_are_hexadecimal_enumerations_numbers_and_optional_fields_null() {
    let dir = tempfile::tempdir().unwrap();
    let state =
        MotorState { position_turns: 1.5, torque_target_nm: Some(0.0), ..Default::default() };
    let frame = CanFrame { id: 9, data: vec![0, 255], direction: 1, ..Default::default() };
    let a = motor(Player::Left, Motor::A);
    let made = recording(&dir, |writer| {
        writer.write(CAN_FRAMES, Nanos(1), &frame).unwrap();
        writer.write(&a, Nanos(1), &state).unwrap();
    });
    let path = exported(&made, CAN_FRAMES, TableFormat::Csv);
    let golden = "\
log_time_ns,publish_time_ns,id,extended,remote,error,data,direction
1,1,9,false,false,false,00ff,1
";
    assert_eq!(fs::read_to_string(&path).unwrap(), golden);
    fs::remove_file(path).unwrap();
    let golden = "\
log_time_ns,publish_time_ns,position_turns,velocity_turns_per_s,torque_target_nm,torque_estimate_nm
1,1,1.5,0.0,0.0,
";
    let path = exported(&made, &a, TableFormat::Csv);
    assert_eq!(fs::read_to_string(path).unwrap(), golden);
}

#[test]
fn parquet_reads_back_equal() {
    let dir = tempfile::tempdir().unwrap();
    let made = recording(&dir, |writer| {
        for k in 0..100_u32 {
            let event = MatchEvent { kind: format!("kind {k}"), episode: k, ..Default::default() };
            writer.write(MATCH_EVENT, Nanos(k.into()), &event).unwrap();
        }
    });
    let path = exported(&made, MATCH_EVENT, TableFormat::Parquet);
    let read = ParquetReader::new(File::open(path).unwrap()).finish().unwrap();
    let written = data_frame(&read_table(&made, MATCH_EVENT).unwrap()).unwrap();
    assert!(read.equals_missing(&written), "{read} {written}");
    assert_eq!(read.shape(), (100, 12));
}

#[test]
fn npz_reads_back_with_nan_for_null() {
    let dir = tempfile::tempdir().unwrap();
    let made = recording(&dir, |writer| {
        writer.write(CAMERA_DETECTIONS, Nanos(5), &detections(4, None)).unwrap();
    });
    let path = exported(&made, CAMERA_DETECTIONS, TableFormat::Npz);
    let mut npz = ndarray_npy::NpzReader::new(File::open(path).unwrap()).unwrap();
    let times: ndarray::Array1<u64> = npz.by_name("log_time_ns").unwrap();
    let ball: ndarray::Array1<f64> = npz.by_name("ball.x").unwrap();
    let right: ndarray::Array1<f64> = npz.by_name("right.y").unwrap();
    assert_eq!((times[0], right[0]), (5, 0.1));
    assert!(ball[0].is_nan());
}

#[test]
fn an_existing_table_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let made = recording(&dir, |writer| {
        writer.write(MATCH_EVENT, Nanos(1), &MatchEvent::default()).unwrap();
    });
    let path = exported(&made, MATCH_EVENT, TableFormat::Csv);
    let table = read_table(&made, MATCH_EVENT).unwrap();
    let again = write_table(&table, &path, TableFormat::Csv, ExistingFile::Refuse);
    assert!(matches!(again, Err(RecordingError::Exists { .. })));
    let error = read_table(&made, "/nowhere").unwrap_err().to_string();
    assert!(error.ends_with("no topic /nowhere; it has /match/event"), "{error}");
}

mod foreign_schemas {
    use super::*;
    use crate::recording::{PROTOBUF, RawSchema};
    use prost::Message as _;
    use prost_types::{
        DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
        field_descriptor_proto::{Label, Type},
    };
    use std::collections::BTreeMap;

    fn field(name: &str, number: i32, kind: Type, label: Label) -> FieldDescriptorProto {
        FieldDescriptorProto {
            name: Some(name.into()),
            number: Some(number),
            r#type: Some(kind.into()),
            label: Some(label.into()),
            type_name: (kind == Type::Message).then(|| ".Tree".to_owned()),
            ..Default::default()
        }
    }

    /// A message with a packed list, a zigzag number and itself inside.
    fn tree() -> Vec<u8> {
        let message = DescriptorProto {
            name: Some("Tree".into()),
            field: vec![
                field("list", 1, Type::Uint32, Label::Repeated),
                field("zigzag", 200, Type::Sint64, Label::Optional),
                field("inner", 3, Type::Message, Label::Optional),
                field("names", 4, Type::String, Label::Repeated),
            ],
            ..Default::default()
        };
        let file = FileDescriptorProto {
            message_type: vec![message],
            syntax: Some("proto3".into()),
            ..Default::default()
        };
        FileDescriptorSet { file: vec![file] }.encode_to_vec()
    }

    #[test]
    fn lists_are_text_and_a_message_within_itself_stays_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let descriptors = tree();
        let schema = RawSchema {
            name: "Tree",
            encoding: PROTOBUF,
            data: &descriptors,
            message_encoding: PROTOBUF,
            channel_metadata: &BTreeMap::new(),
        };
        let bytes = [
            &[0x0a, 3, 1, 0xac, 0x02][..], // list: 1, 300, packed
            &[0x08, 7],                    // list: 7, not packed
            &[0xc0, 0x0c, 3],              // zigzag: -2
            &[0x1a, 2, 0x08, 1],           // inner: list: 1
            &[0x22, 1, b'a', 0x22, 1, b'b'],
            &[0x7d, 0, 0, 0, 0], // an unknown field 15
        ]
        .concat();
        let made = recording(&dir, |writer| {
            writer.write_raw("/tree", &schema, [Nanos(1); 2], &bytes).unwrap();
            writer.write_raw("/tree", &schema, [Nanos(2); 2], &[]).unwrap();
        });
        let table = read_table(&made, "/tree").unwrap();
        let text = |name: &str| match &table.column(name).unwrap().values {
            Values::Text(values) => values.clone(),
            other => panic!("{other:?}"),
        };
        assert_eq!(text("list"), [Some("[1, 300, 7]".into()), Some("[]".into())]);
        assert_eq!(text("names"), [Some(r#"["a", "b"]"#.into()), Some("[]".into())]);
        assert_eq!(text("inner"), [Some("0801".into()), None]);
        assert_eq!(table.column("zigzag").unwrap().values, Values::Int(vec![Some(-2), Some(0)]));
    }
}
