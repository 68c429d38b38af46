use super::*;
use crate::recording::{
    ExistingFile, FlushPolicy, RecordingWriter,
    message::{CameraDetections, CanFrame, MatchEvent, MotorState, Point},
    topic::{CAMERA_DETECTIONS, CAN_FRAMES, MATCH_EVENT, Motor, Player, motor},
};
use arrow::array::{Array, PrimitiveArray, Utf8ViewArray};
use polars_parquet::read::{
    BasicDecompressor, PageReader, column_iter_to_arrays, infer_schema, read_metadata,
};
use std::{
    fs::{self, File},
    io::Cursor,
};

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
    CameraDetections {
        capture_time_ns,
        ball,
        right: Some(Point { x: 0.0, y: 0.1 }),
        ..CameraDetections::default()
    }
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
log_time_ns,publish_time_ns,capture_time_ns,ball.x,ball.y,left.x,left.y,right.x,right.y,\
ball_covariance.xx,ball_covariance.xy,ball_covariance.yy,\
left_covariance.xx,left_covariance.xy,left_covariance.yy,\
right_covariance.xx,right_covariance.xy,right_covariance.yy
10,9,9,0.0,-0.125,,,0.0,0.1,,,,,,,,,
20,19,19,,,,,0.0,0.1,,,,,,,,,
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
log_time_ns,publish_time_ns,position_turns,velocity_turns_per_s,torque_target_nm,torque_estimate_nm,torque_age_s
1,1,1.5,0.0,0.0,,
";
    let path = exported(&made, &a, TableFormat::Csv);
    assert_eq!(fs::read_to_string(path).unwrap(), golden);
}

/// Every column of a Parquet file, by name, its row groups in order.
fn parquet_columns(bytes: &[u8]) -> Vec<(String, Vec<Box<dyn Array>>)> {
    let metadata = read_metadata(&mut Cursor::new(bytes)).unwrap();
    let schema = infer_schema(&metadata).unwrap();
    let mut columns: Vec<(String, Vec<Box<dyn Array>>)> =
        schema.iter_names().map(|name| (name.to_string(), Vec::new())).collect();
    for group in &metadata.row_groups {
        for ((name, arrays), field) in columns.iter_mut().zip(schema.iter_values()) {
            let chunk = group.columns_under_root_iter(name).unwrap().next().unwrap();
            let range = chunk.byte_range();
            let page = bytes[range.start as usize..range.end as usize].to_vec();
            let reader = PageReader::new(Cursor::new(page.into()), chunk, vec![], usize::MAX);
            let pages = vec![BasicDecompressor::new(reader, vec![])];
            let types = vec![&chunk.descriptor().descriptor.primitive_type];
            arrays.extend(column_iter_to_arrays(pages, types, field.clone(), None).unwrap().0);
        }
    }
    columns
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
    let columns = parquet_columns(&fs::read(path).unwrap());
    assert_eq!(columns.len(), 12);
    let find = |name: &str| {
        let (_, arrays) = columns.iter().find(|(own, _)| own == name).unwrap();
        assert_eq!(arrays.len(), 1);
        arrays[0].as_any()
    };
    let times = find("log_time_ns").downcast_ref::<PrimitiveArray<u64>>().unwrap();
    assert!(times.iter().flatten().copied().eq(0..100));
    let kinds = find("kind").downcast_ref::<Utf8ViewArray>().unwrap();
    let expected = (0..100).map(|k| format!("kind {k}"));
    assert!(kinds.iter().flatten().map(ToOwned::to_owned).eq(expected));
}

#[test]
fn parquet_keeps_every_type_null_and_row_group() {
    // More rows than one row group holds.
    let rows = (1 << 18) + 7;
    let at = |row: usize| (!row.is_multiple_of(3)).then_some(row);
    let column = |name: &str, values| Column { name: name.to_owned(), values };
    let columns = [
        column(
            "f64",
            Values::F64((0..rows).map(|row| at(row).map(|row| 0.5 * row as f64)).collect()),
        ),
        column("i64", Values::Int((0..rows).map(|row| at(row).map(|row| -(row as i64))).collect())),
        column(
            "bool",
            Values::Bool((0..rows).map(|row| at(row).map(|row| row % 2 == 0)).collect()),
        ),
    ];
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("table.parquet");
    write_columns(&columns, rows, &path, ColumnFormat::Parquet, ExistingFile::Refuse).unwrap();
    let read = parquet_columns(&fs::read(&path).unwrap());
    let found: Vec<Option<f64>> = read[0]
        .1
        .iter()
        .flat_map(|array| {
            let array = array.as_any().downcast_ref::<PrimitiveArray<f64>>().unwrap();
            array.iter().map(|value| value.copied()).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(Values::F64(found), columns[0].values);
    assert_eq!(read[0].1.len(), 2);
    let nulls: usize = read[2].1.iter().map(|array| array.null_count()).sum();
    assert_eq!(nulls, rows.div_ceil(3));
}

#[test]
fn columns_of_one_name_or_of_other_lengths_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("table");
    let column = |name: &str, rows| Column {
        name: name.to_owned(),
        values: Values::Int(vec![Some(1); rows]),
    };
    for format in [ColumnFormat::Parquet, ColumnFormat::Csv] {
        for (columns, reason) in [
            ([column("a", 2), column("a", 2)], "two columns are called 'a'"),
            ([column("a", 2), column("b", 3)], "column 'b' has 3 rows, the table has 2"),
        ] {
            let error =
                write_columns(&columns, 2, &path, format, ExistingFile::Refuse).unwrap_err();
            assert!(error.to_string().ends_with(reason), "{error}");
            assert!(!path.exists());
        }
    }
}

#[test]
fn text_with_commas_quotes_and_lines_is_quoted_in_csv() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("table.csv");
    let values = Values::Text(vec![Some("a,b".into()), Some("say \"x\"".into()), None]);
    let columns = [
        Column { name: "text".to_owned(), values },
        Column { name: "n".to_owned(), values: Values::F32(vec![Some(0.1), None, Some(1e-7)]) },
    ];
    write_columns(&columns, 3, &path, ColumnFormat::Csv, ExistingFile::Refuse).unwrap();
    let golden = "text,n\n\"a,b\",0.1\n\"say \"\"x\"\"\",\n,1e-7\n";
    assert_eq!(fs::read_to_string(path).unwrap(), golden);
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
