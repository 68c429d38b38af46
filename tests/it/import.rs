//! `klasktron import` on small bags built here byte by byte, in the layouts of recorded ones.

use klasktron::recording::{
    Recording,
    message::{
        AxisInput, AxisOutput, BoardState, CanFrame, CarriageState, DriveStatus, MotorState,
        VelocityCommand,
    },
    topic::{self, Motor, Player},
};
use rusqlite::Connection;
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

const MS: u64 = 1_000_000;
const START: u64 = 1_700_000_000_000_000_000;

/// A CDR message under construction, little endian.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(mut self, size: usize) -> Self {
        while !(self.0.len() - 4).is_multiple_of(size) {
            self.0.push(0xAA); // what stands in padding must not matter
        }
        self
    }

    fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    fn u32(self, value: u32) -> Self {
        self.align(4).bytes(&value.to_le_bytes())
    }

    fn f32(self, value: f32) -> Self {
        self.align(4).bytes(&value.to_le_bytes())
    }

    fn f64s(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.align(8).bytes(&value.to_le_bytes()))
    }

    fn header(self, frame_id: &str) -> Self {
        let length = frame_id.len() as u32 + 1;
        self.u32(1_700_000_000).u32(7).u32(length).bytes(frame_id.as_bytes()).bytes(&[0])
    }
}

#[derive(Clone, Copy)]
enum Status {
    Wide,
    Narrow,
}

/// Left peg at (0.11, 0.18) moving by (0.3, 0.2) in the image; ball and right peg at the centre.
fn state(status: Status, frame_id: &str) -> Vec<u8> {
    let centre = [0.21, 0.16, 0.0, 0.0, 0.0, 0.0];
    let cdr = Cdr::new().header(frame_id).f64s(&centre);
    let cdr = cdr.f64s(&[0.11, 0.18, 0.0, 0.3, 0.2, 0.0]).f64s(&centre);
    let cdr = cdr.f64s(&[0.04, 0.16, 0.0, 0.38, 0.16, 0.0]);
    match status {
        Status::Wide => cdr.align(8).bytes(&9_u64.to_le_bytes()),
        Status::Narrow => cdr.bytes(&[9]),
    }
    .0
}

fn twist(x: f64, y: f64) -> Vec<u8> {
    Cdr::new().f64s(&[x, y, 0.0, 0.0, 0.0, 0.0]).0
}

fn controller_status(position: f32, velocity: f32, torque: f32) -> Vec<u8> {
    [position, velocity, torque, f32::NAN, 0.0, 0.0]
        .into_iter()
        .fold(Cdr::new(), Cdr::f32)
        .u32(0)
        .bytes(&[8, 0, 0])
        .0
}

/// Name, type, and messages with their times.
type Topic<'a> = (&'a str, &'a str, Vec<(u64, Vec<u8>)>);

/// Writes a bag as ROS 2 Humble does: no definitions.
fn write_bag(path: &Path, topics: &[Topic<'_>]) {
    let database = Connection::open(path).unwrap();
    database
        .execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
             serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL); \
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
             timestamp INTEGER NOT NULL, data BLOB NOT NULL);",
        )
        .unwrap();
    for (id, (name, type_name, messages)) in (1_i64..).zip(topics) {
        let topic = (id, name, type_name);
        database.execute("INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr', '')", topic).unwrap();
        for (time, data) in messages {
            let row = (id, *time as i64, data);
            let insert = "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
            database.execute(insert, row).unwrap();
        }
    }
}

fn klasktron(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_klasktron")).arg("import").args(args).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Imports `source` and opens the result; the exit status must be `exit`.
fn import(args: &[&str], output: &Path, exit: i32) -> (Recording, String) {
    let run = klasktron(&[args, &["-o", output.to_str().unwrap()]].concat());
    let text = said(&run);
    assert_eq!(run.status.code(), Some(exit), "{text}");
    (Recording::open(output).unwrap(), text)
}

const TWIST: &str = "geometry_msgs/msg/Twist";
const STATE: &str = "klask_interfaces/msg/State";
const CONTROLLER: &str = "odrive_can/msg/ControllerStatus";

#[test]
fn both_states_come_out_alike_whatever_the_frame_id() {
    let folder = tempfile::tempdir().unwrap();
    for (index, (status, frame_id, size)) in [
        (Status::Wide, "", 220),
        (Status::Narrow, "", 213),
        (Status::Wide, "abc", 220),
        (Status::Narrow, "board_frame", 221),
    ]
    .into_iter()
    .enumerate()
    {
        let bytes = state(status, frame_id);
        assert_eq!(bytes.len(), size);
        let mut padded = bytes.clone();
        padded.resize(bytes.len().next_multiple_of(4), 0);
        let bag = folder.path().join(format!("{index}.db3"));
        let messages = vec![(START, bytes), (START + 20 * MS, padded)];
        write_bag(&bag, &[("/board_state", STATE, messages)]);
        let output = folder.path().join(format!("{index}.mcap"));
        let (recording, _) = import(&["bag", bag.to_str().unwrap()], &output, 0);
        let series = recording.series::<BoardState>(topic::BOARD_STATE).unwrap();
        assert_eq!(series.values.len(), 2);
        assert_eq!(series.values[0], series.values[1]);
        let [left, ball] = [series.values[0].left.unwrap(), series.values[0].ball.unwrap()];
        let close = |found: f64, expected: f64| (found - expected).abs() < 1e-12;
        assert!(close(left.x, 0.02) && close(left.y, -0.10), "{left:?}");
        assert!(close(left.vx, 0.2) && close(left.vy, 0.3), "{left:?}");
        assert!(close(ball.x, 0.0) && close(ball.y, 0.0));
        assert_eq!(series.values[0].status, 9);
        let stamp = recording.channels_of(topic::BOARD_STATE).next().unwrap().messages[0].clone();
        assert_eq!((stamp.log_time.0, stamp.publish_time.0), (START, 1_700_000_000_000_000_007));
    }
}

/// Turns per second of the right and the left motor by the upstream commander's formulas.
fn upstream_motors(sign: f64, image: [f64; 2]) -> [f32; 2] {
    [sign * (image[0] + image[1]) / 0.04, sign * (image[1] - image[0]) / 0.04].map(|v| v as f32)
}

/// A motion along +x or +y of the board keeps its direction by every way in.
#[test]
fn a_motion_keeps_its_direction_by_every_way_in() {
    let folder = tempfile::tempdir().unwrap();
    // +x of the board is +y of the image, +y of the board is +x of the image.
    for (name, image, board) in [("x", [0.0, 0.3], [0.3, 0.0]), ("y", [0.3, 0.0], [0.0, 0.3])] {
        for (player, sign, nodes) in [(Player::Right, 1.0, [0, 1]), (Player::Left, -1.0, [2, 3])] {
            let [right, left] = upstream_motors(sign, image);
            let bag = folder.path().join(format!("{name}-{player}.db3"));
            let [topic_right, topic_left] =
                nodes.map(|node| format!("/odrive_axis{node}/controller_status"));
            let command = format!("/cmd_vel/{player}_player");
            let status = |turns: f32| vec![(START, controller_status(turns, turns, 0.1 * turns))];
            write_bag(
                &bag,
                &[
                    (&command, TWIST, vec![(START, twist(image[0], image[1]))]),
                    (&topic_right, CONTROLLER, status(right)),
                    (&topic_left, CONTROLLER, status(left)),
                ],
            );
            let log = folder.path().join(format!("{name}-{player}.log"));
            let hex = |value: f32| klasktron::recording::hexadecimal(&value.to_le_bytes());
            let mut text = String::new();
            for (node, turns) in nodes.into_iter().zip([right, left]) {
                let (estimate, setpoint) = (node << 5 | 0x09, node << 5 | 0x0D);
                text += &format!("(1.000{node}00) can0 {setpoint:03X}#{}00000000 T\n", hex(turns));
                text += &format!("(1.000{node}00) can0 {estimate:03X}#{0}{0} R\n", hex(turns));
            }
            fs::write(&log, text).unwrap();
            for source in [&bag, &log] {
                let output = source.with_extension("mcap");
                let (recording, text) = import(&[source.to_str().unwrap()], &output, 0);
                let commands =
                    recording.series::<VelocityCommand>(&topic::command(player)).unwrap().values;
                let carriage =
                    recording.series::<CarriageState>(&topic::carriage(player)).unwrap().values;
                for found in [
                    [commands[0].vx, commands[0].vy],
                    [carriage[0].vx, carriage[0].vy],
                    // One second's motion: the encoders started at zero.
                    [carriage[0].x, carriage[0].y],
                ] {
                    for (found, expected) in found.into_iter().zip(board) {
                        assert!((found - expected).abs() < 1e-6, "{source:?}: {found} {expected}");
                    }
                }
                let a = recording.series::<MotorState>(&topic::motor(player, Motor::A)).unwrap();
                assert!(
                    (a.values[0].velocity_turns_per_s - 7.5).abs() < 1e-5,
                    "+x and +y turn a up"
                );
                if let Some(torque) = a.values[0].torque_target_nm {
                    assert!((torque - 0.75).abs() < 1e-5, "torques take the motor's sign");
                    assert_eq!(a.values[0].torque_estimate_nm, None, "NaN is nothing");
                }
                assert_eq!(recording.info("carriage_origin"), Some("unknown"));
                assert!(text.contains("the origin of the positions is unknown"), "{text}");
                fs::remove_file(output).unwrap();
            }
        }
    }
}

#[test]
fn messages_that_do_not_decode_are_counted_and_the_rest_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("a.db3");
    let messages = vec![
        (START, twist(0.1, 0.0)),
        (START + MS, vec![0, 1, 0, 0, 1]),
        (START + 2 * MS, twist(f64::NAN, 0.0)),
        (START + 3 * MS, twist(0.2, 0.0)),
    ];
    write_bag(
        &bag,
        &[
            ("/cmd_vel/left_player", TWIST, messages),
            (
                "/board_image/compressed",
                "sensor_msgs/msg/CompressedImage",
                vec![(START, vec![1; 99])],
            ),
        ],
    );
    let output = folder.path().join("a.mcap");
    let (recording, text) = import(&["bag", bag.to_str().unwrap()], &output, 3);
    assert_eq!(recording.count(&topic::command(Player::Left)), 2);
    assert!(
        text.contains(
            "lost: /cmd_vel/left_player, 2 messages cannot be decoded, the first is message 1"
        ),
        "{text}"
    );
    assert!(text.contains("skipped: /board_image/compressed"), "{text}");
    // The name is taken now.
    let run = klasktron(&["bag", bag.to_str().unwrap(), "-o", output.to_str().unwrap()]);
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("--overwrite"), "{}", said(&run));
    let run =
        klasktron(&["bag", bag.to_str().unwrap(), "--overwrite", "-o", output.to_str().unwrap()]);
    assert_eq!(run.status.code(), Some(3));
}

#[test]
fn a_damaged_bag_gives_what_it_holds_or_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("a.db3");
    let messages = |step: u64| (START + 20 * MS * step, state(Status::Wide, ""));
    write_bag(&bag, &[("/board_state", STATE, (0..500).map(messages).collect())]);
    let bytes = fs::read(&bag).unwrap();
    for tenths in [1, 3, 5, 7, 9] {
        let cut = folder.path().join(format!("cut{tenths}.db3"));
        fs::write(&cut, &bytes[..bytes.len() * tenths / 10]).unwrap();
        let output = cut.with_extension("mcap");
        let run = klasktron(&["bag", cut.to_str().unwrap(), "-o", output.to_str().unwrap()]);
        let code = run.status.code();
        assert!(code == Some(1) || code == Some(3), "{tenths}: {}", said(&run));
        assert!(said(&run).contains("cut"), "names the file: {}", said(&run));
        assert_eq!(output.exists(), code == Some(3));
    }
    let nothing = folder.path().join("noise.db3");
    fs::write(&nothing, b"neither").unwrap();
    let run = klasktron(&["bag", nothing.to_str().unwrap(), "-o", "never.mcap"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("neither SQLite nor MCAP"), "{}", said(&run));
}

#[test]
fn bags_are_runs_and_must_not_overlap() {
    let folder = tempfile::tempdir().unwrap();
    let bag = |name: &str, start: u64| {
        let path = folder.path().join(name);
        write_bag(
            &path,
            &[(
                "/cmd_vel/left_player",
                TWIST,
                vec![(start, twist(0.1, 0.0)), (start + 20 * MS, twist(0.1, 0.0))],
            )],
        );
        path.to_str().unwrap().to_owned()
    };
    let [first, second, third] =
        [bag("1.db3", START), bag("2.db3", START + 1000 * MS), bag("3.db3", START + 10 * MS)];
    let output = folder.path().join("both.mcap");
    let (recording, _) = import(&["bag", &first, &second], &output, 0);
    let markers = recording.markers().unwrap();
    assert_eq!(markers.values.iter().map(|m| m.run).collect::<Vec<_>>(), [0, 0, 1, 1]);
    assert_eq!(recording.info("original_file"), Some("1.db3, 2.db3"));
    let run = klasktron(&["bag", &first, &third, "-o", "never.mcap"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("overlap in time"), "{}", said(&run));
}

#[test]
fn a_bus_log_keeps_every_frame_and_the_drives_health() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("bus.log");
    let text = "\
(1.000000) can0 017#0000C0410000803F
(1.001000) can0 001#0000000108010000
(1.002000) can0 7E2#
(1.003000) can0 037#R8
(1.004000) can0 20000080#0000000000000000
";
    fs::write(&log, text).unwrap();
    let output = folder.path().join("bus.mcap");
    let (recording, _) = import(&["candump", log.to_str().unwrap()], &output, 0);
    let frames = recording.series::<CanFrame>(topic::CAN_FRAMES).unwrap().values;
    assert_eq!(frames.len(), 5);
    assert!(frames[3].remote && frames[4].error && frames[2].data.is_empty());
    let drive = recording.series::<DriveStatus>(&topic::drive(Player::Right, Motor::A)).unwrap();
    assert_eq!(drive.values[0].bus_voltage_v, Some(24.0));
    assert_eq!((drive.values[0].axis_state, drive.values[0].active_errors), (8, 0x0100_0000));
    let two = text.to_owned() + "(1.005000) can1 7E2#\nnot a line\n";
    fs::write(&log, two).unwrap();
    let args = ["candump", log.to_str().unwrap(), "--overwrite"];
    let run = klasktron(&[&args[..], &["-o", output.to_str().unwrap()]].concat());
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("can0, can1; choose one with --interface"), "{}", said(&run));
    let (recording, text) = import(&[&args[..], &["--interface", "can1"]].concat(), &output, 3);
    assert_eq!(recording.count(topic::CAN_FRAMES), 1);
    assert!(text.contains("1 lines that are not frames, the first in line 7"), "{text}");
}

/// Rows of a servo in a test bench: time, angle and current in units of the given sizes (s, rad, A).
fn bench(second: f64, radian: f64, ampere: f64) -> String {
    let row = |k: i32| {
        let phase = 0.1 * f64::from(k);
        let (time, angle, current) = (1.0 + 0.002 * f64::from(k), phase.sin(), 2.0 + phase.cos());
        format!("{},{},{}\n", time / second, angle / radian, current / ampere)
    };
    "time,angle,current\n".to_owned() + &(0..200).map(row).collect::<String>()
}

#[test]
fn a_table_in_other_units_is_the_same_axis() {
    let folder = tempfile::tempdir().unwrap();
    let axis = |name: &str, table: &str, options: &[&str]| {
        let source = folder.path().join(name);
        fs::write(&source, table).unwrap();
        let args = [&["csv", source.to_str().unwrap()][..], options].concat();
        let (recording, text) = import(&args, &source.with_extension("mcap"), 0);
        assert!(!text.contains("note:"), "{text}");
        assert_eq!(recording.info("time_origin_s"), Some("1"), "{name}");
        let inputs = recording.series::<AxisInput>(&topic::axis_input("axis")).unwrap();
        let outputs = recording.series::<AxisOutput>(&topic::axis_output("axis")).unwrap();
        assert_eq!(inputs.times, outputs.times);
        (inputs, outputs)
    };
    let plain = ["--time", "time", "--input", "current:A", "--position", "angle"];
    let plain = [&plain[..], &["--position-unit", "rad"]].concat();
    let (plain_inputs, plain_outputs) = axis("plain.csv", &bench(1.0, 1.0, 1.0), &plain);
    let degree = std::f64::consts::PI / 180.0;
    let table = "# servo 3\n".to_owned() + &bench(1e-3, degree, -1e-3);
    let units = ["--time", "time:ms", "--input", "current:mA", "--position", "angle:deg"];
    let units = [&units[..], &["--input-scale", "-1"]].concat();
    let (inputs, outputs) = axis("units.csv", &table, &units);
    assert_eq!((inputs.times.len(), &inputs.times), (200, &plain_inputs.times));
    let close = |found: f64, expected: f64| (found - expected).abs() <= 1e-12 * expected.abs();
    for (found, expected) in inputs.values.iter().zip(&plain_inputs.values) {
        assert!(close(found.value, expected.value), "{found:?} {expected:?}");
        assert_eq!((found.unit.as_str(), expected.unit.as_str()), ("A", "A"));
    }
    for (found, expected) in outputs.values.iter().zip(&plain_outputs.values) {
        assert!(close(found.position.unwrap(), expected.position.unwrap()), "{found:?}");
        let units = (found.position_unit.as_str(), expected.position_unit.as_str());
        assert_eq!(units, ("rad", "rad"));
    }
}

#[test]
fn tables_and_values_of_a_column_are_runs() {
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let names = |recording: &Recording| {
        let runs = recording.marked_runs().unwrap().into_iter();
        runs.map(|run| (run.number, run.pattern)).collect::<Vec<_>>()
    };
    let columns = ["--time", "n:steps", "--step-s", "0.5", "--input", "u:V", "--velocity", "v:rpm"];
    let [slow, fast] = ["slow.csv", "fast.csv"].map(|name| table(name, "n,u,v\n0,1,2\n1,1,2\n"));
    let args = [&["csv", &slow, &fast][..], &columns].concat();
    let (recording, _) = import(&args, &folder.path().join("files.mcap"), 0);
    assert_eq!(names(&recording), [(0, "slow".to_owned()), (1, "fast".to_owned())]);
    let both = table("both.csv", "test,n,u,v\nup,0,1,2\nup,1,1,2\ndown,0,1,2\ndown,1,1,2\n");
    let args = [&["csv", &both][..], &columns, &["--run", "test"]].concat();
    let (recording, _) = import(&args, &folder.path().join("column.mcap"), 0);
    assert_eq!(names(&recording), [(0, "up".to_owned()), (1, "down".to_owned())]);
    let args = [&["csv", &both, "-o", "never.mcap"][..], &columns].concat();
    let run = klasktron(&args);
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("row 4, column 'n': time 0 steps"), "{}", said(&run));
    assert!(said(&run).contains("with --run"), "{}", said(&run));
}

/// No table is read: none exists.
#[test]
fn units_and_options_that_do_not_fit_are_usage_errors() {
    let csv = ["csv", "x.csv", "-o", "y.mcap"];
    let plain = ["--time", "t", "--input", "u:N", "--position", "x"];
    let duty = ["--time", "t", "--input", "u:duty", "--position", "x"];
    let counts = ["--time", "t", "--input", "u:N", "--position", "x:counts"];
    let steps = ["--time", "t:steps", "--input", "u:N", "--position", "x"];
    let cases: [(&[&str], &[&str], &str); 13] = [
        (&plain, &["--step-s", "0.1"], "--step-s applies to no column"),
        (&plain, &["--supply-v", "12"], "--supply-v applies to no column"),
        (&plain, &["--counts-per-turn", "10"], "--counts-per-turn applies to no column"),
        (&plain, &["--input-scale", "0"], "--input-scale is 0; it must be"),
        (&plain, &["--input-scale", "nan"], "--input-scale is NaN; it must be"),
        (&plain, &["--velocity", "v:rpm"], "the position is in m and the velocity in rpm"),
        (&duty, &[], "the unit duty of --input needs --supply-v VOLTS"),
        (&duty, &["--supply-v", "0"], "--supply-v is 0; it must be"),
        (&counts, &[], "the unit counts of --position needs --counts-per-turn COUNT"),
        (&counts, &["--counts-per-turn", "inf"], "--counts-per-turn is inf; it must be"),
        (&steps, &[], "the unit steps of --time needs --step-s SECONDS"),
        (&steps, &["--step-s", "0"], "--step-s is 0; it must be"),
        (&["--time", "t", "--input", "u:counts", "--position", "x"], &[], "--input-scale 0.001"),
    ];
    for (columns, options, expected) in cases {
        let run = klasktron(&[&csv[..], columns, options].concat());
        assert_eq!(run.status.code(), Some(2), "{columns:?} {options:?}: {}", said(&run));
        assert!(said(&run).contains(expected), "{columns:?} {options:?}: {}", said(&run));
    }
    // The same options with their units pass; then the table is missing.
    for (columns, options) in [
        (&duty, ["--supply-v", "12"]),
        (&counts, ["--counts-per-turn", "4096"]),
        (&steps, ["--step-s", "1e-3"]),
        (&plain, ["--input-scale", "-2.5e-3"]),
    ] {
        let run = klasktron(&[&csv[..], columns, &options].concat());
        assert_eq!(run.status.code(), Some(1), "{options:?}: {}", said(&run));
        assert!(said(&run).contains("x.csv: cannot read"), "{}", said(&run));
    }
}

#[test]
fn wrong_usage_is_told_from_failure() {
    let csv = ["csv", "x.csv", "-o", "y.mcap", "--time", "t"];
    for args in [
        &csv[..],
        &["x.db3"],
        &[],
        &[&csv[..], &["--input", "u:stone", "--position", "x"]].concat(),
        &[&csv[..], &["--input", "u:N"]].concat(),
        &[&csv[..], &["--input", "u:N", "--position", "x", "--axis", "a/b"]].concat(),
        &["candump", "x.log", "-o", "y.mcap", "--belt-metres-per-turn", "0"],
    ] {
        assert_eq!(klasktron(args).status.code(), Some(2), "{args:?}");
    }
    let run = klasktron(&["data.csv", "-o", "y.mcap"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(said(&run).contains("--time COLUMN"), "{}", said(&run));
}
