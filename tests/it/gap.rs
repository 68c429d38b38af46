//! `calibrate` and `gap` on recordings whose makers share no code with the twin: the formulas below.

mod description;
mod options;
mod single_axis;
mod user_effects;

use crate::{
    schema,
    support::{START, klasktron, said, writer},
};
use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, Recording, RecordingWriter,
        message::{
            AxisInput, AxisOutput, CameraDetections, CarriageState, MotorState, Point, RunMarker,
            VelocityCommand, run_marker::Phase,
        },
        topic::{self, Motor, Player},
    },
    seed::Stream,
    twin::{self, Stage as _},
    units::Nanos,
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Samples per second of the axis.
const AXIS_HZ: u64 = 1000;

/// A ball-screw axis with Coulomb, viscous and, perhaps, direction-dependent friction. Its motion is
/// given in closed form, a sum of sines, and the force is what this motion takes.
struct Axis {
    split: &'static str,
    seconds: u64,
    /// Viscous coefficient forwards and backwards (N s/m).
    viscous: [f64; 2],
    /// Dry friction and viscous coefficient grow so much along the way (N/m, N s/m^2).
    by_place: [f64; 2],
    /// Somebody leans on the carriage from 6.0 to 6.2 s (N).
    knock: f64,
    /// A spring that hardens pulls it to the middle (N/m^3).
    hardening: f64,
    /// A force against the motion that grows with the cube of the speed, forwards only (N s^3/m^3).
    cubic_forwards: f64,
    /// It moves on besides (m/s).
    speed: f64,
    seed: u64,
    /// Units of the recording.
    units: Units,
}

/// Factors by which input, position and time are recorded.
#[derive(Debug, Clone, Copy)]
struct Units {
    input: f64,
    position: f64,
    time: u64,
}

impl Units {
    const SI: Self = Self { input: 1.0, position: 1.0, time: 1 };
}

impl Axis {
    const MASS_KG: f64 = 40.0;
    const COULOMB_N: f64 = 12.0;
    const NOISE_N: f64 = 1.0;

    fn motion(&self, t: f64) -> [f64; 3] {
        let mut sum = [self.speed * t, self.speed, 0.0];
        let lines = [(0.06, 1.3, 0.2), (0.03, 2.9, 1.1), (0.01, 7.3, self.seed as f64)];
        for (size, w, phase) in lines {
            let (sin, cos) = (w * t + phase).sin_cos();
            sum[0] += size * sin;
            sum[1] += size * w * cos;
            sum[2] -= size * w * w * sin;
        }
        sum
    }

    fn write(&self, dir: &Path, name: &str) -> PathBuf {
        let path = dir.join(name);
        let mut writer = writer(&path, "axis");
        let mut noise = Stream::new(self.seed, "force");
        let Units { input: by_input, position: by_position, time: by_time } = self.units;
        let at = |k: u64| Nanos(START.0 + by_time * k * 1_000_000_000 / AXIS_HZ);
        let marker = |phase: Phase| RunMarker {
            run: 0,
            pattern: "sines".into(),
            phase: phase.into(),
            split: self.split.into(),
        };
        writer.write(topic::RUN_MARKER, at(0), &marker(Phase::Start)).unwrap();
        for k in 0..self.seconds * AXIS_HZ {
            let [q, v, a] = self.motion(k as f64 / AXIS_HZ as f64);
            let viscous = if 0.0 < v { self.viscous[0] } else { self.viscous[1] };
            let normal: f32 = (0..12).map(|_| noise.uniform_f32(-0.5, 0.5)).sum();
            let force = Self::MASS_KG * a
                + (Self::COULOMB_N + self.by_place[0] * q) * (v / 1e-4).tanh()
                + (viscous + self.by_place[1] * q) * v
                + self.hardening * q.powi(3)
                + self.cubic_forwards * v.max(0.0).powi(3)
                + if (6.0..6.2).contains(&(k as f64 / AXIS_HZ as f64)) { self.knock } else { 0.0 }
                + Self::NOISE_N * f64::from(normal);
            let input = AxisInput { value: by_input * force, unit: "N".into() };
            let output = AxisOutput {
                position: Some(by_position * q),
                velocity: None,
                position_unit: "m".into(),
            };
            writer.write(&topic::axis_input("screw"), at(k), &input).unwrap();
            writer.write(&topic::axis_output("screw"), at(k), &output).unwrap();
        }
        let end = at(self.seconds * AXIS_HZ);
        writer.write(topic::RUN_MARKER, end, &marker(Phase::End)).unwrap();
        writer.finish().unwrap();
        path
    }

    /// A session to fit, of 20 s.
    fn session(viscous: [f64; 2]) -> Self {
        Axis {
            split: "train",
            seconds: 20,
            viscous,
            by_place: [0.0; 2],
            knock: 0.0,
            hardening: 0.0,
            cubic_forwards: 0.0,
            speed: 0.0,
            seed: 1,
            units: Units::SI,
        }
    }

    /// A pair of sessions with the given friction.
    fn pair(dir: &Path, viscous: [f64; 2]) -> [String; 2] {
        Self::session(viscous).written_twice(dir)
    }

    /// The same with friction that changes with the place.
    fn worn(dir: &Path, viscous: [f64; 2], by_place: [f64; 2]) -> [String; 2] {
        Axis { by_place, ..Self::session(viscous) }.written_twice(dir)
    }

    /// This session, and one that judges, in which nobody leans on anything.
    fn written_twice(self, dir: &Path) -> [String; 2] {
        let text = |path: PathBuf| path.display().to_string();
        let first = text(self.write(dir, "one.mcap"));
        let second = Axis { split: "validation", knock: 0.0, seed: 2, ..self };
        [first, text(second.write(dir, "two.mcap"))]
    }
}

/// The document that `gap` prints, and its exit status.
fn gap(recordings: &[String], twin: Option<&str>, out: &Path) -> (serde_json::Value, i32) {
    gap_with(recordings, twin.map_or(vec![], |twin| vec!["--twin", twin]), out)
}

/// The same with more `options`.
fn gap_with(recordings: &[String], options: Vec<&str>, out: &Path) -> (serde_json::Value, i32) {
    let out = out.display().to_string();
    let mut args = vec!["gap", "--json", "--output", &out];
    args.extend(recordings.iter().map(String::as_str));
    args.extend(options);
    let (text, errors, status) = said(&klasktron(&args));
    let document = serde_json::from_str(&text);
    let document = document.unwrap_or_else(|_| panic!("no document: {text} {errors}"));
    schema::assert_valid("gap", &document);
    let twin = Path::new(&out).join("twin.json");
    assert_eq!(twin.exists(), status == 0, "{document:#}");
    if twin.exists() {
        let twin = serde_json::from_str(&fs::read_to_string(twin).unwrap()).unwrap();
        schema::assert_valid("twin", &twin);
    }
    (document, status)
}

fn names(document: &serde_json::Value) -> Vec<&str> {
    document["effects"].as_array().unwrap().iter().map(|e| e["name"].as_str().unwrap()).collect()
}

#[test]
fn direction_dependent_friction_is_named_and_measured() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [80.0, 140.0]);
    let (document, status) = gap(&recordings, None, &dir.path().join("out"));
    assert_eq!(status, 0);
    assert_eq!(document["verdict"], "named", "{document:#}");
    assert_eq!(names(&document), ["drive.friction.asymmetric"], "{document:#}");
    let difference = &document["effects"][0]["parameters"][0];
    let value = difference["value"].as_f64().unwrap();
    assert!((value + 60.0).abs() < 0.05 * 60.0, "{difference}");
    let numbers = document["effects"][0]["estimates_after_step"].as_array().unwrap();
    for (name, truth) in
        [("viscous_forwards_n_s_per_m", 80.0), ("viscous_backwards_n_s_per_m", 140.0)]
    {
        let name = format!("drive.friction.asymmetric.{name}");
        let own = numbers.iter().find(|own| own["name"] == name.as_str()).unwrap();
        assert!((own["value"].as_f64().unwrap() - truth).abs() < 0.03 * truth, "{own}");
    }
    let residual = &document["residuals"][0];
    assert!(residual["validation_after"].as_f64() < residual["validation_before"].as_f64());
    for file in ["gap.json", "twin.json", "index.html", "gap.mcap", "residuals.svg"] {
        assert!(dir.path().join("out").join(file).exists(), "{file}");
    }
}

/// Relative difference of an estimate from the same one in other units: the search takes the same steps but for rounding.
const UNIT_TOLERANCE: f64 = 1e-3;

#[test]
fn the_answer_does_not_depend_on_the_units_of_an_axis() {
    let dir = tempfile::tempdir().unwrap();
    let answer = |units: Units, name: &str| {
        let folder = dir.path().join(name);
        fs::create_dir(&folder).unwrap();
        let axis = Axis { units, ..Axis::session([80.0, 140.0]) };
        gap(&axis.written_twice(&folder), None, &folder.join("out")).0
    };
    let plain = answer(Units::SI, "si");
    for (name, units) in [
        ("millinewtons", Units { input: 1e3, ..Units::SI }),
        ("kilometres", Units { position: 1e-3, ..Units::SI }),
        ("slow", Units { time: 20, ..Units::SI }),
        ("all", Units { input: 1e-3, position: 1e3, time: 7 }),
    ] {
        let other = answer(units, name);
        assert_eq!(other["verdict"], plain["verdict"], "{name}: {other:#}");
        assert_eq!(names(&other), names(&plain), "{name}");
        let slope = |document: &serde_json::Value| {
            document["effects"][0]["parameters"][0]["value"].as_f64().unwrap()
        };
        let factor = units.input * units.time as f64 / units.position;
        let ratio = slope(&other) / (factor * slope(&plain));
        assert!((ratio - 1.0).abs() < UNIT_TOLERANCE, "{name}: {ratio}");
    }
}

#[test]
fn what_happens_once_is_told_and_hides_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let leant_on = Axis { knock: 400.0, ..Axis::session([80.0, 140.0]) };
    let recordings = leant_on.written_twice(dir.path());
    let (document, status) = gap(&recordings, None, &dir.path().join("out"));
    assert_eq!(status, 0);
    assert_eq!(names(&document), ["drive.friction.asymmetric"], "{document:#}");
    let value = document["effects"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((value + 60.0).abs() < 0.05 * 60.0, "{document:#}");
    let warnings = document["warnings"].as_array().unwrap();
    let told =
        warnings.iter().map(|own| own.as_str().unwrap()).find(|own| own.contains("left out"));
    let told = told.unwrap_or_else(|| panic!("{warnings:?}"));
    assert!(told.starts_with("s1: a one-off disturbance of axis.screw.force by up to 4"), "{told}");
    assert!(told.contains("from 5.9 to 6.4 s"), "{told}");
    let beside = tempfile::tempdir().unwrap();
    let untouched = Axis::pair(beside.path(), [80.0, 140.0]);
    let (document, _) = gap(&untouched, None, &beside.path().join("out"));
    assert!(!document["warnings"].to_string().contains("left out"), "{document:#}");
}

#[test]
fn nothing_is_named_where_nothing_is_missing_and_equal_inputs_give_equal_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [100.0, 100.0]);
    let (document, _) = gap(&recordings, None, &dir.path().join("one"));
    assert!(names(&document).is_empty(), "{document:#}");
    let twin = dir.path().join("one/twin.json").display().to_string();
    let (again, _) = gap(&recordings, Some(&twin), &dir.path().join("two"));
    assert_eq!(again["verdict"], "none", "{again:#}");
    gap(&recordings, None, &dir.path().join("three"));
    for file in ["gap.json", "twin.json", "index.html", "gap.mcap"] {
        let bytes = |folder: &str| fs::read(dir.path().join(folder).join(file)).unwrap();
        assert!(bytes("one") == bytes("three"), "{file} differs");
    }
}

#[test]
fn friction_that_changes_with_the_place_is_named_and_a_drag_that_does_is_not_called_by_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let found = |name: &str, by_place: [f64; 2]| {
        let folder = dir.path().join(name);
        fs::create_dir(&folder).unwrap();
        let base = Axis::pair(&folder, [100.0; 2]);
        gap(&base, None, &folder.join("base"));
        let worn = folder.join("worn");
        fs::create_dir(&worn).unwrap();
        let recordings = Axis::worn(&worn, [100.0; 2], by_place);
        let twin = folder.join("base/twin.json").display().to_string();
        gap(&recordings, Some(&twin), &folder.join("out")).0
    };
    let dry = found("dry", [20.0, 0.0]);
    assert_eq!(names(&dry), ["drive.friction.position"], "{dry:#}");
    let drag = found("drag", [0.0, 150.0]);
    assert!(names(&drag).is_empty(), "{drag:#}");
    assert_eq!(drag["verdict"], "unexplained", "{drag:#}");
}

#[test]
fn a_calibrated_twin_states_the_truth_within_its_intervals() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [100.0, 100.0]);
    let twin = dir.path().join("twin.json").display().to_string();
    let (text, errors, status) =
        said(&klasktron(&["calibrate", &recordings[0], &recordings[1], "--output", &twin]));
    assert_eq!(status, 0, "{text} {errors}");
    let document: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&twin).unwrap()).unwrap();
    let value = |effect: &str| {
        let found = document["effects"].as_array().unwrap();
        let own = found.iter().find(|own| own["name"] == effect).unwrap();
        own["parameters"][0]["value"].as_f64().unwrap()
    };
    assert!((value("gantry.inertia") - Axis::MASS_KG).abs() < 0.01 * Axis::MASS_KG);
    assert!((value("drive.friction.viscous") - 100.0).abs() < 3.0);
    assert!((value("drive.friction.coulomb") - Axis::COULOMB_N).abs() < 0.03 * Axis::COULOMB_N);
    let page = fs::read_to_string(dir.path().join("twin.html")).unwrap();
    for section in ["Parameters", "Correlations", "Residuals", "Localization", "Provenance"] {
        assert!(page.contains(&format!("<h2>{section}</h2>")), "{section}");
    }
    assert!(page.contains("klasktron calibrate ") && page.contains("drive.friction.viscous"));
}

/// A table: its command at a time (s), and what the carriage makes of it.
#[derive(Clone, Copy)]
struct Machine {
    command: fn(f64) -> f64,
    respond: fn(f64, f64) -> f64,
}

/// Commands both ways (m/s).
fn both_ways(t: f64) -> f64 {
    0.2 * (1.7 * t).sin()
}

/// A table recording of `machine`.
fn table(dir: &Path, name: &str, seconds: u64, machine: Machine) -> String {
    let path = dir.join(name);
    let mut writer = writer(&path, "klasktron");
    let at = |k: u64| Nanos(START.0 + k * 20_000_000);
    let mut x = 0.0;
    for k in 0..seconds * 50 {
        let t = k as f64 / 50.0;
        let vx = (machine.command)(t);
        let moved = (machine.respond)(vx, t);
        x += moved / 50.0;
        let state = CarriageState { x, y: 0.0, vx: moved, vy: 0.0 };
        let left = Player::Left;
        writer.write(&topic::command(left), at(k), &VelocityCommand { vx, vy: 0.0 }).unwrap();
        writer.write(&topic::carriage(left), at(k), &state).unwrap();
    }
    writer.finish().unwrap();
    path.display().to_string()
}

/// Velocity commands that jump both ways on x and y (m/s), at 50 Hz.
fn jumps(t: f64, session: f64) -> [f64; 2] {
    let at = (t * 50.0).floor() / 50.0;
    let square = |w: f64, size: f64| size * (w * at + session).sin().signum();
    [square(5.1, 0.25) + 0.1 * (1.3 * at).sin(), square(6.7, 0.2) + 0.08 * (0.9 * at).cos()]
}

/// Sum and difference, scaled so that the map is its own inverse: from the rails to the motors and back.
fn turned([a, b]: [f64; 2]) -> [f64; 2] {
    [(a + b) * 0.5_f64.sqrt(), (a - b) * 0.5_f64.sqrt()]
}

/// How a camera at 100 Hz scatters, and the share of its frames that are lost: every other one comes not at all, the
/// rest as the frame before.
#[derive(Clone, Copy)]
struct Camera {
    place_m: f64,
    stamp_s: f64,
    lost: f64,
    /// Its pictures grow so much older per second.
    skew: f64,
}

/// A standard normal number, nearly: the sum of twelve uniform ones.
fn normal(stream: &mut Stream) -> f64 {
    f64::from((0..12).map(|_| stream.uniform_f32(-0.5, 0.5)).sum::<f32>())
}

/// How each motor of a table follows its command: so late (s), with ramps so steep (m/s^2).
#[derive(Clone, Copy)]
struct Follows {
    late_s: [f64; 2],
    ramps: [f64; 2],
}

/// At once, and alike.
const ALIKE: Follows = Follows { late_s: [0.0; 2], ramps: [8.0; 2] };

/// Two sessions of a table whose motors ramp to their commands and follow the ramp with a time constant of 4 ms, by
/// small explicit steps; velocities are read with 0.5 mm/s of noise. A camera sees the striker on the carriage.
fn followed(dir: &Path, name: &str, motors: Follows, camera: Option<Camera>) -> [String; 2] {
    [1.0, 2.0].map(|session| {
        let path = dir.join(format!("{name}-{session}.mcap"));
        let mut writer = writer(&path, "klasktron");
        let mut noise = Stream::new(session as u64, name);
        let mut scatter = Stream::new(session as u64, "camera");
        let mut losses = Stream::new(session as u64, "losses");
        let (mut lost, mut last) = (0, None);
        let (mut place, mut ramp, mut motor) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for step in 0..120_000_u64 {
            let t = step as f64 * 1e-4;
            let at = Nanos(START.0 + step * 100_000);
            let left = Player::Left;
            if step % 200 == 0 {
                let [vx, vy] = jumps(t, session);
                writer.write(&topic::command(left), at, &VelocityCommand { vx, vy }).unwrap();
            }
            if step % 50 == 0 {
                let mut read = |v: f64| v + 5e-4 * normal(&mut noise);
                let [vx, vy] = turned(motor).map(&mut read);
                let state = CarriageState { x: place[0], y: place[1], vx, vy };
                writer.write(&topic::carriage(left), at, &state).unwrap();
            }
            if let Some(camera) = camera
                && step % 100 == 30
            {
                let late_ns = 5e6 + 1e9 * (camera.stamp_s * normal(&mut scatter) + camera.skew * t);
                let mut seen = |place: f64| place + camera.place_m * normal(&mut scatter);
                let [x, y] = place.map(&mut seen);
                let mut left = Some(Point { x, y });
                if f64::from(losses.uniform_f32(0.0, 1.0)) < camera.lost {
                    lost += 1;
                    left = last.filter(|_| lost % 2 == 0);
                }
                if left.is_some() {
                    last = left;
                    let frame = CameraDetections { left, ..CameraDetections::default() };
                    let at = Nanos(at.0 + late_ns.max(0.0) as u64);
                    writer.write(topic::CAMERA_DETECTIONS, at, &frame).unwrap();
                }
            }
            for index in 0..2 {
                let most = 1e-4 * motors.ramps[index];
                let wanted = turned(jumps((t - motors.late_s[index]).max(0.0), session))[index];
                ramp[index] += (wanted - ramp[index]).clamp(-most, most);
                motor[index] += 1e-4 * (ramp[index] - motor[index]) / 0.004;
                place[index] += 1e-4 * turned(motor)[index];
            }
        }
        writer.finish().unwrap();
        path.display().to_string()
    })
}

#[test]
fn a_long_delay_is_named_from_the_twin_that_was_calibrated_without_it() {
    let dir = tempfile::tempdir().unwrap();
    gap(&followed(dir.path(), "base", ALIKE, None), None, &dir.path().join("base"));
    let twin = dir.path().join("base/twin.json").display().to_string();
    let same = followed(dir.path(), "same", ALIKE, None);
    let (same, _) = gap(&same, Some(&twin), &dir.path().join("same"));
    assert!(names(&same).is_empty(), "{same:#}");
    // What only a camera shows is said to be untested, and the next recording asks for one.
    let rejected = same["rejected"].as_array().unwrap();
    let magnet = rejected.iter().find(|own| own["name"] == "coupling.magnet_spring").unwrap();
    assert!(magnet["reason"].as_str().unwrap().contains("not testable without"), "{magnet}");
    assert!(same["next_experiment"]["command"].as_str().unwrap().contains("--camera"), "{same:#}");
    let late = followed(dir.path(), "late", Follows { late_s: [0.018; 2], ..ALIKE }, None);
    let (document, _) = gap(&late, Some(&twin), &dir.path().join("late"));
    let delay = document["effects"].as_array().unwrap().iter().find(|e| e["name"] == "drive.delay");
    let parameter = &delay.unwrap_or_else(|| panic!("{document:#}"))["parameters"][0];
    assert!((parameter["value"].as_f64().unwrap() - 0.018).abs() < 0.001, "{parameter}");
}

#[test]
fn two_motors_that_are_late_by_different_times_have_each_its_own() {
    let dir = tempfile::tempdir().unwrap();
    gap(&followed(dir.path(), "base", ALIKE, None), None, &dir.path().join("base"));
    let twin = dir.path().join("base/twin.json").display().to_string();
    let truth = [("a", 0.018), ("b", 0.014)];
    let late =
        followed(dir.path(), "late", Follows { late_s: truth.map(|own| own.1), ..ALIKE }, None);
    let (document, _) = gap(&late, Some(&twin), &dir.path().join("late"));
    assert_eq!(names(&document), ["drive.delay"; 2], "{document:#}");
    for (own, (axis, late_s)) in document["effects"].as_array().unwrap().iter().zip(truth) {
        let value = own["parameters"][0]["value"].as_f64().unwrap();
        assert!(own["location"] == axis && (value - late_s).abs() < 0.001, "{own}");
    }
}

#[test]
fn a_ramp_that_became_slower_on_one_motor_is_refitted_there_and_nothing_is_named() {
    let dir = tempfile::tempdir().unwrap();
    gap(&followed(dir.path(), "base", ALIKE, None), None, &dir.path().join("base"));
    let twin = dir.path().join("base/twin.json").display().to_string();
    let slower = Follows { ramps: [6.0, 8.0], ..ALIKE };
    let worn = followed(dir.path(), "worn", slower, None);
    let (document, _) = gap(&worn, Some(&twin), &dir.path().join("worn"));
    assert!(names(&document).is_empty(), "{document:#}");
    let refits = document["parameter_changes"].as_array().unwrap();
    let ramp = |axis: &str| {
        refits.iter().find(|own| {
            own["name"] == "drive.saturation.slew.limit_m_per_s2" && own["location"] == axis
        })
    };
    let own = ramp("a").unwrap_or_else(|| panic!("{document:#}"));
    // In metres of belt.
    let truth = 6.0 * 2.0_f64.sqrt();
    assert!((own["after"].as_f64().unwrap() - truth).abs() < 0.02 * truth, "{own}");
    assert!(ramp("b").is_none(), "{document:#}");
}

#[test]
fn a_camera_that_scatters_otherwise_is_named_by_what_scatters() {
    let dir = tempfile::tempdir().unwrap();
    let camera = |place_m, stamp_s| Some(Camera { place_m, stamp_s, lost: 0.0, skew: 0.0 });
    let base = followed(dir.path(), "base", ALIKE, camera(2.5e-4, 0.0));
    gap(&base, None, &dir.path().join("base"));
    let twin = dir.path().join("base/twin.json").display().to_string();
    let changed = followed(dir.path(), "changed", ALIKE, camera(4e-4, 1.5e-3));
    let (document, _) = gap(&changed, Some(&twin), &dir.path().join("changed"));
    assert_eq!(names(&document), ["sensor.frame_jitter", "sensor.noise_model"], "{document:#}");
    for (index, truth) in [(0, 1.5e-3), (1, 1.6)] {
        let parameter = &document["effects"][index]["parameters"][0];
        let value = parameter["value"].as_f64().unwrap();
        assert!((value - truth).abs() < 0.25 * truth, "{parameter}");
    }
    // A twin that states no scatter has nothing to compare with.
    let (first, _) = gap(&changed, None, &dir.path().join("first"));
    assert_eq!(names(&first), ["sensor.camera_latency"], "{first:#}");
    // The twin states it from then on.
    let twin = dir.path().join("changed/twin.json").display().to_string();
    let (again, _) = gap(&changed, Some(&twin), &dir.path().join("again"));
    assert!(names(&again).is_empty(), "{again:#}");
}

#[test]
fn a_camera_that_loses_frames_is_named_by_the_share_it_loses() {
    let dir = tempfile::tempdir().unwrap();
    let camera = |lost| Some(Camera { place_m: 2.5e-4, stamp_s: 0.0, lost, skew: 0.0 });
    gap(&followed(dir.path(), "base", ALIKE, camera(0.0)), None, &dir.path().join("base"));
    let twin = dir.path().join("base/twin.json").display().to_string();
    let (same, _) = gap(
        &followed(dir.path(), "same", ALIKE, camera(0.0)),
        Some(&twin),
        &dir.path().join("same"),
    );
    assert!(names(&same).is_empty(), "{same:#}");
    let lossy = followed(dir.path(), "lossy", ALIKE, camera(0.06));
    let (document, _) = gap(&lossy, Some(&twin), &dir.path().join("lossy"));
    assert_eq!(names(&document), ["sensor.frame_drop"], "{document:#}");
    let share = document["effects"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((share - 0.06).abs() < 0.02, "{share}");
    // The twin states it from then on.
    let twin = dir.path().join("lossy/twin.json").display().to_string();
    let (again, _) = gap(&lossy, Some(&twin), &dir.path().join("again"));
    assert!(names(&again).is_empty(), "{again:#}");
}

#[test]
fn what_cannot_be_judged_has_its_verdict_and_no_name() {
    let dir = tempfile::tempdir().unwrap();
    let follow = Machine { command: both_ways, respond: |v, _| v };
    let cases = [
        ("off", 20, Machine { respond: |_, _| 0.0, ..follow }, "input_not_connected"),
        (
            "hand",
            20,
            Machine { respond: |_, t| 0.2 * (t * 0.93 + 1.0).cos(), ..follow },
            "input_not_connected",
        ),
        ("short", 2, follow, "not_testable"),
        ("one-way", 20, Machine { command: |t| both_ways(t).abs(), ..follow }, "not_testable"),
        (
            "one-way and shaken",
            20,
            Machine {
                command: |t| both_ways(t).abs(),
                respond: |v, t| 0.3 * v + 0.4 * (t * 9.1).sin(),
            },
            "not_testable",
        ),
    ];
    for (name, seconds, machine, verdict) in cases {
        let file = table(dir.path(), &format!("{name}.mcap"), seconds, machine);
        let (document, status) = gap(std::slice::from_ref(&file), None, &dir.path().join(name));
        assert_eq!(document["verdict"], verdict, "{name}: {document:#}");
        assert_eq!(calibrated(dir.path(), &[file]).1, 3, "{name}");
        assert!(names(&document).is_empty());
        assert!(!document["next_experiment"].is_null(), "{name}");
        assert_eq!(status, 3, "{name}");
    }
}

#[test]
fn nothing_is_said_where_the_cameras_clock_runs_away() {
    let dir = tempfile::tempdir().unwrap();
    let said = |name: &str, skew| {
        let camera = Some(Camera { place_m: 2.5e-4, stamp_s: 0.0, lost: 0.0, skew });
        gap(&followed(dir.path(), name, ALIKE, camera), None, &dir.path().join(name))
    };
    let (document, status) = said("away", 0.02);
    assert_eq!((document["verdict"].as_str(), status), (Some("not_testable"), 3), "{document:#}");
    assert!(names(&document).is_empty());
    assert!(document["warnings"][0].as_str().unwrap().contains("clocks drift"), "{document:#}");
    // What crystals are apart is an effect like any other.
    let (document, _) = said("skewed", 1e-3);
    assert!(names(&document).contains(&"sensor.clock_skew"), "{document:#}");
}

#[test]
fn of_an_axis_that_went_one_way_only_nothing_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let one_way = Axis { speed: 0.3, ..Axis::session([80.0, 140.0]) };
    let (document, status) = gap(&one_way.written_twice(dir.path()), None, &dir.path().join("out"));
    assert_eq!((document["verdict"].as_str(), status), (Some("not_testable"), 3), "{document:#}");
    assert!(names(&document).is_empty());
    assert!(document["warnings"][0].as_str().unwrap().contains("m down"), "{document:#}");
}

#[test]
fn a_broken_twin_is_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let recording =
        table(dir.path(), "run.mcap", 10, Machine { command: both_ways, respond: |v, _| v });
    let twin = dir.path().join("twin.json").display().to_string();
    let head = r#"{"schema_version":2,"machine":"table","striker_mass_kg":0.012,"belt_metres_per_turn":0.04,"#;
    let effect = |name: &str, value: f64| {
        format!(
            r#"{head}"effects":[{{"name":"{name}","location":"a+b","parameters":[{{"name":"delay_s","value":{value},"source":"fitted"}}]}}]}}"#
        )
    };
    for (text, expected) in [
        ("{".to_owned(), "is no twin.json"),
        (effect("drive.delay", 0.01).replace(":2,", ":1,"), "has schema_version 1; this program"),
        (
            effect("drive.delay", 0.01).replace("0.012", "0"),
            "striker_mass_kg is 0; allowed are numbers above 0 kg",
        ),
        (
            effect("drive.delay", 0.01).replace(":0.04", ":0.05"),
            "has 0.05 m: these are different machines",
        ),
        (effect("drive.dealy", 0.01), "'drive.dealy', which is not in the catalogue"),
        (effect("drive.delay", 7.0), "drive.delay.delay_s is 7; allowed are -0.02 to 0.2 s"),
    ] {
        fs::write(&twin, text).unwrap();
        let (_, errors, status) =
            said(&klasktron(&["gap", &recording, "--twin", &twin, "--output", "nowhere"]));
        assert_eq!(status, 1);
        assert!(errors.contains(expected), "{errors}");
        assert_eq!(errors.trim().lines().count(), 1, "{errors}");
    }
    assert!(!Path::new("nowhere").exists());
}

/// What `calibrate` says of `recordings`, and its status; nothing may be written where it refuses.
fn calibrated(dir: &Path, recordings: &[String]) -> (String, i32) {
    let twin = dir.join("calibrated.json").display().to_string();
    let mut args = vec!["calibrate", "-o", &twin];
    args.extend(recordings.iter().map(String::as_str));
    let (_, errors, status) = said(&klasktron(&args));
    assert_eq!(Path::new(&twin).exists(), status == 0, "{errors}");
    fs::remove_file(twin).ok();
    (errors, status)
}

#[test]
fn without_a_training_session_nothing_is_answered_and_no_twin_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let held_out = Axis { split: "validation", ..Axis::session([80.0, 140.0]) };
    let recordings = [held_out.write(dir.path(), "one.mcap").display().to_string()];
    let (document, status) = gap(&recordings, None, &dir.path().join("out"));
    assert_eq!((document["verdict"].as_str(), status), (Some("not_testable"), 3), "{document:#}");
    assert!(document["summary"].as_str().unwrap().contains("split=validation"), "{document:#}");
    let (errors, status) = calibrated(dir.path(), &recordings);
    assert!(status == 3 && errors.contains("split=validation"), "{errors}");
}

/// A session of 20 s of an axis whose input and position (m) are those of `motion` at a time (s), in N.
fn free_axis(dir: &Path, name: &str, split: &str, motion: impl Fn(f64) -> [f64; 2]) -> String {
    let path = dir.join(name);
    let mut writer = writer(&path, "axis");
    let at = |k: u64| Nanos(START.0 + k * 2_000_000);
    let marker = |phase: Phase| RunMarker {
        run: 0,
        pattern: "free".into(),
        phase: phase.into(),
        split: split.into(),
    };
    writer.write(topic::RUN_MARKER, at(0), &marker(Phase::Start)).unwrap();
    for k in 0..10_000 {
        let [force, position] = motion(k as f64 * 0.002);
        let input = AxisInput { value: force, unit: "N".into() };
        let output =
            AxisOutput { position: Some(position), velocity: None, position_unit: "m".into() };
        writer.write(&topic::axis_input("slide"), at(k), &input).unwrap();
        writer.write(&topic::axis_output("slide"), at(k), &output).unwrap();
    }
    writer.write(topic::RUN_MARKER, at(10_000), &marker(Phase::End)).unwrap();
    writer.finish().unwrap();
    path.display().to_string()
}

#[test]
fn an_axis_that_does_not_answer_its_input_is_not_connected() {
    let dir = tempfile::tempdir().unwrap();
    let moved = |t: f64| 0.05 * (3.0 * t).sin() + 0.01 * (11.0 * t).sin();
    let other = |t: f64| 40.0 * (1.9 * t).sin() + 25.0 * (7.7 * t).cos();
    type Case<'a> = (&'a str, fn(f64, f64) -> [f64; 2], &'a str);
    let cases: [Case<'_>; 3] = [
        ("off", |force, _| [force, 0.2], "input_not_connected"),
        ("hand", |force, position| [force, position], "input_not_connected"),
        ("constant", |_, position| [5.0, position], "not_testable"),
    ];
    for (name, of, verdict) in cases {
        let recordings = ["train", "validation"].map(|split| {
            let file = format!("{name}-{split}.mcap");
            free_axis(dir.path(), &file, split, |t| of(other(t), moved(t)))
        });
        let (document, status) = gap(&recordings, None, &dir.path().join(name));
        assert_eq!((document["verdict"].as_str(), status), (Some(verdict), 3), "{document:#}");
        assert_eq!(calibrated(dir.path(), &recordings).1, 3, "{name}");
    }
}

#[test]
fn one_way_sessions_that_together_go_both_ways_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    let one_way = |direction: f64| {
        move |t: f64| {
            let (phase, speed) = (1.3 * t, 0.02);
            let position = speed * (t - phase.sin() / 1.3);
            let velocity = speed * (1.0 - phase.cos());
            let acceleration = speed * 1.3 * phase.sin();
            let force = 40.0 * acceleration + 90.0 * velocity + 12.0 * (velocity / 1e-4).tanh();
            let ripple = 0.5 * (37.0 * t).sin();
            [direction * (force + ripple), direction * position]
        }
    };
    let file = |name: &str, split: &str, direction: f64| {
        free_axis(dir.path(), name, split, one_way(direction))
    };
    let up = file("up.mcap", "train", 1.0);
    let down = file("down.mcap", "train", -1.0);
    let last = file("last.mcap", "validation", 1.0);
    let (document, status) = gap(&[up.clone(), last.clone()], None, &dir.path().join("up"));
    assert_eq!((document["verdict"].as_str(), status), (Some("not_testable"), 3), "{document:#}");
    let (document, status) = gap(&[up, down, last], None, &dir.path().join("both"));
    assert_eq!(status, 0, "{document:#}");
}

/// A recording of 20 s of both motors of the left gantry with so much belt per turn in the metadata (m), which the
/// carriage follows at the commanded velocity.
fn with_belt(dir: &Path, name: &str, belt: &str) -> PathBuf {
    let path = dir.join(name);
    let metadata = [("schema_version", "1"), ("split", "train"), ("belt_metres_per_turn", belt)];
    let metadata = metadata.map(|(key, value)| (key.to_owned(), value.to_owned()));
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
    writer.metadata(RECORDING_METADATA, metadata.into()).unwrap();
    let metres: f64 = belt.parse().unwrap_or(1.0);
    for k in 0..1000_u64 {
        let (t, at) = (k as f64 / 50.0, Nanos(START.0 + k * 20_000_000));
        let vx = both_ways(t);
        let command = VelocityCommand { vx, vy: 0.0 };
        writer.write(&topic::command(Player::Left), at, &command).unwrap();
        // Both belts move with the carriage along x.
        let state = MotorState {
            position_turns: 0.2 / 1.7 * (1.0 - (1.7 * t).cos()) / metres,
            velocity_turns_per_s: vx / metres,
            ..MotorState::default()
        };
        for motor in Motor::BOTH {
            writer.write(&topic::motor(Player::Left, motor), at, &state).unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

#[test]
fn the_belt_of_the_metadata_turns_turns_into_metres() {
    let dir = tempfile::tempdir().unwrap();
    for belt in ["0.04", "0.05"] {
        let path = with_belt(dir.path(), &format!("{belt}.mcap"), belt);
        let sessions = twin::sessions_of(&[Recording::open(&path).unwrap()]).unwrap();
        let drive = sessions[0].drive.as_ref().unwrap();
        let channel = &drive.channels()[0];
        let last = channel.times.len() - 1;
        for k in (0..last).step_by(50) {
            let expected = both_ways(channel.times[k]);
            assert!((channel.measured[k] - expected).abs() < 1e-9, "{belt}: {k}");
        }
        let metres: f64 = belt.parse().unwrap();
        assert_eq!(sessions[0].belt_metres_per_turn, metres);
        assert_eq!(twin::Twin::nominal_of(&sessions).belt_metres_per_turn, metres);
    }
    let name = |belt: &str| dir.path().join(format!("{belt}.mcap")).display().to_string();
    let (_, errors, status) =
        said(&klasktron(&["gap", &name("0.04"), &name("0.05"), "-o", "nowhere"]));
    assert!(status == 1 && errors.contains("these are different machines"), "{errors}");
    let wrong = with_belt(dir.path(), "wrong.mcap", "wide").display().to_string();
    let (_, errors, status) = said(&klasktron(&["calibrate", &wrong, "-o", "nowhere.json"]));
    assert!(status == 1 && errors.contains("belt_metres_per_turn = 'wide'"), "{errors}");
}
