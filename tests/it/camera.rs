//! `calibrate-camera`, `tune-detector`, `detect` and `--camera virtual`. The images of `tests/data/camera` were rendered
//! by MuJoCo (`scripts/render_frames.py`), which knows nothing of this program; `truth.json` says where the pieces are.

use crate::support::{klasktron, said};
use klasktron::{
    board::BoardSize,
    camera::{
        CameraDocument, DetectingCamera, Detector, DetectorDocument, DetectorError, Frame,
        FrameSource, FrameWarning, ImageFolder, Next, PoseCheck, PoseFeatures, PoseWarning,
        Predictions, SourceError,
    },
    link::{CameraSocket, parse_detections},
    recording::{Recording, message, topic},
    rig::{Artist, Scene, draw},
    units::Nanos,
};
use serde_json::Value;
use std::{fs, path::Path, time::Duration};

const DATA: &str = "tests/data/camera";

fn data(name: &str) -> String {
    format!("{DATA}/{name}")
}

fn json_of(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn truth() -> Vec<Value> {
    json_of(Path::new(&data("truth.json"))).as_array().unwrap().clone()
}

/// Place of a piece (m) in a line of the truth.
fn place(truth: &Value, name: &str) -> [f64; 2] {
    ["x_m", "y_m"].map(|key| truth[name][key].as_f64().unwrap())
}

/// Position of a piece in a line of `detect --json`.
fn position(found: &Value) -> [f64; 2] {
    [0, 1].map(|axis: usize| found["position"][axis].as_f64().unwrap())
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn detect(images: &str, more: &[&str]) -> (Vec<Value>, String, i32) {
    let (source, calibration, detector) =
        (format!("images:{images}"), data("camera.json"), data("detector.json"));
    let words =
        ["detect", "--camera", &source, "--calibration", &calibration, "--detector", &detector];
    let (stdout, stderr, status) = said(&klasktron(&[&words, more].concat()));
    (stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect(), stderr, status)
}

#[test]
fn pieces_are_found_within_half_a_millimetre_with_their_covariances() {
    let (lines, stderr, status) = detect(&data("table"), &["--json"]);
    assert_eq!(status, 0, "{stderr}");
    for (found, truth) in lines.iter().zip(truth()) {
        for name in ["ball", "left", "right"] {
            let error = distance(position(&found[name]), place(&truth, name));
            assert!(error < 0.0006, "{name}: {error} m");
            let variance = found[name]["covariance"][0][0].as_f64().unwrap();
            // Between 0.03 mm and 0.5 mm.
            assert!((1e-9..2.5e-7).contains(&variance), "{name}: {variance}");
        }
        for biscuit in truth["biscuits"].as_array().unwrap() {
            let true_place = [0, 1].map(|axis: usize| biscuit[axis].as_f64().unwrap());
            let all = found["biscuits"].as_array().unwrap();
            let nearest = all.iter().map(|own| distance(position(own), true_place));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.001, "{nearest} m");
        }
    }
    assert_eq!(lines.last().unwrap()["ball_found"], 2);
}

#[test]
fn a_frame_without_a_ball_says_so() {
    let (lines, stderr, status) = detect(&data("empty"), &["--json"]);
    assert_eq!(status, 0, "{stderr}");
    assert_eq!(lines[0]["ball"], Value::Null);
    assert!(lines[0]["left"].is_object() && lines[0]["right"].is_object());
    assert!(stderr.starts_with("1 frames: ball in 0.0 %, left striker in 100.0 %"), "{stderr}");
}

#[test]
fn the_lens_and_the_board_are_calibrated() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let images = format!("images:{}", data("checker"));
    let lens = path("lens.json");
    let words = ["calibrate-camera", "--images", &images, "--square-mm", "22", "-o", &lens];
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 0, "{stderr}");
    let fitted = json_of(Path::new(&lens));
    let error = fitted["lens_fit"]["reprojection_rms_px"].as_f64().unwrap();
    assert!(error < 0.3, "{error}");
    let true_lens = json_of(Path::new(&data("camera.json")));
    for axis in 0..2 {
        let value = |document: &Value, key: &str| document[key][axis].as_f64().unwrap();
        let half = fitted["lens_fit"]["ci95_half_width"][axis].as_f64().unwrap();
        let off = (value(&fitted, "focal_px") - value(&true_lens, "focal_px")).abs();
        assert!(off < 2.0 * half && half < 10.0, "{off} {half}");
        let off =
            (value(&fitted, "principal_point_px") - value(&true_lens, "principal_point_px")).abs();
        assert!(off < 5.0, "{off}");
    }
    let (images, camera) = (format!("images:{}", data("board")), path("camera.json"));
    let mut words = vec!["calibrate-camera", "--lens", &lens, "--board", &images, "-o", &camera];
    for tag in ["2:-0.140,-0.238", "3:0.140,-0.238", "4:0.140,0.238", "5:-0.140,0.238"] {
        words.extend(["--tag", tag]);
    }
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 0, "{stderr}");
    let camera_of = |path: &str| {
        CameraDocument::from_json(&fs::read_to_string(path).unwrap()).unwrap().camera().unwrap()
    };
    let page = fs::read_to_string(path("lens.html")).unwrap();
    for section in ["Reprojection errors", "Image with the largest error", "Coverage of the image"]
    {
        assert!(page.contains(&format!("<h2>{section}</h2>")), "{section}");
    }
    let page = fs::read_to_string(path("camera.html")).unwrap();
    assert!(page.contains("<h2>Pose of the table</h2>") && page.contains("<td>tag 5</td>"));
    assert!(page.contains("data:image/jpeg;base64,/9j/"));
    let (found, expected) = (camera_of(&camera), camera_of(&data("camera.json")));
    for corner in [[-0.16, -0.21], [0.16, -0.21], [0.16, 0.21], [-0.16, 0.21], [0.0, 0.0]] {
        let pixel = expected.project([corner[0], corner[1], 0.0]).unwrap();
        let error = distance(found.locate(pixel, 0.0).unwrap(), corner);
        assert!(error < 0.0005, "{corner:?}: {error} m");
    }
}

/// The images were drawn by OpenCV (`scripts/check_camera_inputs.py --draw`) with the lens of `camera.json`; the board
/// reaches beyond some of them.
#[test]
fn the_lens_is_calibrated_from_parts_of_a_charuco_board() {
    let dir = tempfile::tempdir().unwrap();
    let lens = dir.path().join("lens.json");
    let images = format!("images:{}", data("charuco"));
    let board = ["--columns", "7", "--rows", "5", "--square-mm", "25"];
    let run = |dictionary: &str, marker_mm: &str| {
        let words = ["calibrate-camera", "--images", &images, "--charuco", dictionary];
        let more = ["--marker-mm", marker_mm, "-o", lens.to_str().unwrap()];
        said(&klasktron(&[&words[..], &board, &more].concat()))
    };
    let (_, stderr, status) = run("5x5", "18");
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.starts_with("5 of 5 images show the board"), "{stderr}");
    let fitted = json_of(&lens);
    let fit = &fitted["lens_fit"];
    let corners = fit["corners"].as_u64().unwrap();
    assert!((100..175).contains(&corners), "a part of 5 x 35 corners is visible: {corners}");
    let error = fit["reprojection_rms_px"].as_f64().unwrap();
    assert!(error < 0.3, "{error}");
    let truth = json_of(Path::new(&data("camera.json")));
    for (key, at) in [("focal_px", 0), ("focal_px", 1)] {
        let off = (fitted[key][at].as_f64().unwrap() - truth[key][at].as_f64().unwrap()).abs();
        let half = fit["ci95_half_width"][at].as_f64().unwrap();
        assert!(off < 2.0 * half && half < 15.0, "{off} {half}");
    }
    let (_, stderr, status) = run("4x4", "18");
    assert!(status == 1 && stderr.contains("lens.json"), "existing results stay: {stderr}");
    fs::remove_file(&lens).unwrap();
    fs::remove_file(lens.with_extension("html")).unwrap();
    let (_, stderr, status) = run("4x4", "18");
    assert!(
        status == 1 && stderr.contains("0 of 5 images show the board, needed are 3"),
        "{stderr}"
    );
    let (_, stderr, status) = run("5x5", "26");
    assert!(
        status == 1
            && stderr
                .contains("--marker-mm is 26 mm; it must be less than the side of a square, 25 mm"),
        "{stderr}"
    );
    let (_, stderr, status) = run("7x7", "18");
    assert!(status == 2 && stderr.contains("must be 4x4, 5x5 or 6x6"), "{stderr}");
}

#[test]
fn a_video_that_is_none_is_refused_with_the_command_that_converts_it() {
    let dir = tempfile::tempdir().unwrap();
    let video = dir.path().join("match.mp4");
    fs::write(&video, b"\0\0\0\x18ftypmp42\0\0\0\0").unwrap();
    let (calibration, detector) = (data("camera.json"), data("detector.json"));
    let words = ["detect", "--calibration", &calibration, "--detector", &detector, "--camera"];
    let source = format!("video:{}", video.display());
    let (_, stderr, status) = said(&klasktron(&[&words[..], &[&source]].concat()));
    assert_eq!(status, 1);
    assert!(
        stderr.contains("this is no AVI file; convert it with `ffmpeg -i ")
            && stderr.lines().count() == 1,
        "{stderr}"
    );
}

#[test]
fn marked_corners_give_the_board_too() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("camera.json");
    let text = fs::read_to_string(data("camera.json")).unwrap();
    let camera = CameraDocument::from_json(&text).unwrap().camera().unwrap();
    let corners = [[-0.16, -0.21], [0.16, -0.21], [0.16, 0.21], [-0.16, 0.21]].map(|[x, y]| {
        let [column, row] = camera.project([x, y, 0.0]).unwrap();
        // Whole pixels, as a person reads them.
        format!("{column:.0},{row:.0}")
    });
    let lens = data("camera.json");
    let mut words = vec!["calibrate-camera", "--lens", &lens, "-o", output.to_str().unwrap()];
    corners.iter().for_each(|corner| words.extend(["--corner", corner]));
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("positions on the field to"), "{stderr}");
    words.truncate(words.len() - 2);
    let (_, stderr, status) = said(&klasktron(&[&words[..], &["--overwrite"]].concat()));
    assert_eq!(status, 1);
    assert!(
        stderr.contains("--corner is given 3 times; give the four corners of the field"),
        "{stderr}"
    );
}

#[test]
fn colours_are_fitted_from_marks() {
    let dir = tempfile::tempdir().unwrap();
    let (marks, output) = (dir.path().join("marks.csv"), dir.path().join("detector.json"));
    let text = fs::read_to_string(data("camera.json")).unwrap();
    let camera = CameraDocument::from_json(&text).unwrap().camera().unwrap();
    let mut rows = "image,kind,column_px,row_px\n".to_owned();
    for (image, truth) in truth().iter().enumerate() {
        let mut mark = |kind: &str, [x, y]: [f64; 2], height: f64| {
            let [column, row] = camera.project([x, y, height]).unwrap();
            rows += &format!("{image},{kind},{column:.0},{row:.0}\n");
        };
        mark("ball", place(truth, "ball"), 0.007);
        mark("striker", place(truth, "left"), 0.0125);
        mark("striker", place(truth, "right"), 0.0125);
        for biscuit in truth["biscuits"].as_array().unwrap() {
            mark("biscuit", [0, 1].map(|axis: usize| biscuit[axis].as_f64().unwrap()), 0.005);
        }
    }
    fs::write(&marks, &rows).unwrap();
    let (images, calibration) = (format!("images:{}", data("table")), data("camera.json"));
    let words = |marks: &str| {
        let output = output.to_str().unwrap();
        let words = [
            "tune-detector",
            &images,
            "--calibration",
            &calibration,
            "--marks",
            marks,
            "-o",
            output,
            "--json",
        ];
        said(&klasktron(&words))
    };
    let (stdout, stderr, status) = words(marks.to_str().unwrap());
    assert_eq!(status, 0, "{stderr}");
    let report: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((&report["marks"], &report["found"]), (&12.into(), &12.into()), "{stderr}");
    let page = fs::read_to_string(output.with_extension("html")).unwrap();
    assert!(page.contains("12 of 12 marked pieces found"));
    assert_eq!(page.matches("<figure class=\"picture\">").count(), 4);
    // Existing results stay.
    fs::remove_file(&output).unwrap();
    let (_, stderr, status) = words(marks.to_str().unwrap());
    assert!(status == 1 && stderr.contains("detector.html") && stderr.contains("--overwrite"));
    fs::remove_file(output.with_extension("html")).unwrap();
    fs::write(&marks, rows.replace("striker", "biscuit")).unwrap();
    let (_, stderr, status) = words(marks.to_str().unwrap());
    assert_eq!(status, 1);
    assert!(
        stderr.contains("striker has 0 pixels, needed are 50; mark it in more images"),
        "{stderr}"
    );
}

#[test]
fn detections_are_served_and_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("detections.mcap");
    let socket = CameraSocket::bind(&"udp:127.0.0.1:0".parse().unwrap()).unwrap();
    let address = format!("udp:{}", socket.udp_address().unwrap());
    let more = ["--send", &address, "-o", output.to_str().unwrap(), "--frames", "1"];
    let (_, stderr, status) = detect(&data("table"), &more);
    assert_eq!(status, 0, "{stderr}");
    let recording = Recording::open(&output).unwrap();
    let series = recording.series::<message::CameraDetections>(topic::CAMERA_DETECTIONS).unwrap();
    let recorded: Vec<_> = series.iter().map(|(_, own)| *own).collect();
    assert_eq!(recorded.len(), 2);
    for own in &recorded {
        assert!(own.ball_covariance.is_some_and(|own| 0.0 < own.xx && 0.0 < own.yy));
        let datagram = socket.receive(Duration::from_secs(5)).unwrap().unwrap();
        assert_eq!(parse_detections(&datagram).unwrap().ball.is_some(), own.ball.is_some());
    }
    let frames = recording.series::<message::CameraFrame>(topic::CAMERA_FRAME).unwrap();
    assert!(frames.iter().all(|(_, own)| own.biscuits.len() == 3 && own.balls == 1));
    // The recorded frames are a source again.
    let (source, calibration, detector) =
        (format!("mcap:{}", output.display()), data("camera.json"), data("detector.json"));
    let words =
        ["detect", "--camera", &source, "--calibration", &calibration, "--detector", &detector];
    let (_, stderr, status) = said(&klasktron(&words));
    assert!(status == 0 && stderr.starts_with("2 frames: ball in 100.0 %"), "{stderr}");
}

/// A frame of `images`, changed.
fn changed(images: &str, change: impl Fn([u8; 3]) -> [u8; 3]) -> Frame {
    let mut frame = Frame::default();
    ImageFolder::open(Path::new(&data(images))).unwrap().next_frame(&mut frame).unwrap();
    let size = [frame.width_px(), frame.height_px()];
    let rgb: Vec<u8> =
        frame.to_rgb().chunks_exact(3).flat_map(|own| change([own[0], own[1], own[2]])).collect();
    frame.set_triples(size, &rgb, klasktron::camera::yuv_of_rgb).unwrap();
    frame
}

fn detector() -> Detector {
    let read = |name: &str| fs::read_to_string(data(name)).unwrap();
    let camera = CameraDocument::from_json(&read("camera.json")).unwrap().camera().unwrap();
    Detector::new(&camera, &DetectorDocument::from_json(&read("detector.json")).unwrap()).unwrap()
}

#[test]
fn light_may_change_until_it_is_too_dark_or_too_bright() {
    let truth = truth();
    for gain in [0.6, 1.4] {
        let frame = changed("table", |own| own.map(|c| (f64::from(c) * gain).min(255.0) as u8));
        let found = detector().detect(&frame, &Predictions::default()).unwrap();
        let error = distance(found.ball.unwrap().position, place(&truth[0], "ball"));
        assert!(error < 0.0006, "gain {gain}: {error} m");
    }
    for (gain, words) in
        [(0.1, "the image is too dark: median brightness"), (6.0, "the image is overexposed: ")]
    {
        let frame = changed("table", |own| own.map(|c| (f64::from(c) * gain).min(255.0) as u8));
        let found = detector().detect(&frame, &Predictions::default()).unwrap();
        assert!(found.light.to_string().starts_with(words), "{}", found.light);
        assert_eq!((found.ball, found.left, found.right), (None, None, None));
    }
}

#[test]
fn two_balls_are_counted() {
    let mut frame = changed("table", |own| own);
    let [column, row] =
        [0, 1].map(|k: usize| truth()[0]["ball"]["px"][k].as_f64().unwrap() as usize & !1);
    // The ball again, 120 pixels to the left.
    let (width, mut bytes) = (frame.width_px(), frame.bytes().to_vec());
    for r in row - 18..row + 18 {
        let at = |column: usize| (r * width + column) * 2;
        bytes.copy_within(at(column - 20)..at(column + 20), at(column - 140));
    }
    let (size, format) = ([width, frame.height_px()], frame.format());
    frame.set_packed(size, format, &bytes).unwrap();
    let found = detector().detect(&frame, &Predictions::default()).unwrap();
    assert_eq!(found.balls, 2);
}

#[test]
fn wrong_inputs_are_named_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(data("camera.json")).unwrap();
    let small = text.replace("1280", "640");
    let camera = dir.path().join("camera.json");
    fs::write(&camera, small.replace("648.3", "320")).unwrap();
    let (images, detector) = (format!("images:{}", data("table")), data("detector.json"));
    let words = [
        "detect",
        "--camera",
        &images,
        "--calibration",
        camera.to_str().unwrap(),
        "--detector",
        &detector,
    ];
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 1);
    assert!(
        stderr.contains("the calibration is for 640 x 720 pixels, but the images have 1280 x 720;"),
        "{stderr}"
    );
    let (_, stderr, status) =
        said(&klasktron(&["detect", "--camera", &images, "--calibration", "absent.json"]));
    assert!(status == 1 && stderr.contains("absent.json: cannot read"), "{stderr}");
    // A damaged image is left out, the others are read, and the status says it.
    let folder = dir.path().join("images");
    fs::create_dir(&folder).unwrap();
    let whole = fs::read(data("table/0.jpg")).unwrap();
    fs::write(folder.join("0.jpg"), &whole[..whole.len() / 2]).unwrap();
    fs::write(folder.join("1.jpg"), &whole).unwrap();
    let (_, stderr, status) = detect(folder.to_str().unwrap(), &[]);
    assert_eq!(status, 3, "{stderr}");
    assert!(stderr.contains("0.jpg: ") && stderr.contains("the image is left out"), "{stderr}");
    let (_, stderr, status) = said(&klasktron(&[
        "detect",
        "--camera",
        "v4l2:/dev/absent",
        "--calibration",
        &data("camera.json"),
        "--detector",
        &detector,
    ]));
    assert!(status == 1 && stderr.contains("v4l2:/dev/absent: "), "{stderr}");
    let mut frame = Frame::default();
    frame.set_grey([64, 48], &[0; 64 * 48]).unwrap();
    let refused = self::detector().detect(&frame, &Predictions::default()).unwrap_err();
    assert!(matches!(refused, DetectorError::Calibration(_)));
}

/// From pixels to motors on the virtual rig, whose frames are drawn and detected.
#[test]
fn a_match_is_played_on_drawn_frames() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("match.mcap");
    let words = [
        "play",
        "--camera",
        "virtual",
        "--speed",
        "max",
        "--left",
        "goalkeeper",
        "--right",
        "chaser",
    ];
    let more = ["--seconds", "2", "-o", output.to_str().unwrap()];
    let (_, stderr, status) = said(&klasktron(&[&words[..], &more].concat()));
    assert_eq!(status, 0, "{stderr}");
    let recording = Recording::open(&output).unwrap();
    let seen = recording.series::<message::CameraDetections>(topic::CAMERA_DETECTIONS).unwrap();
    let true_states = recording.series::<message::BoardState>(topic::TRUE_BOARD_STATE).unwrap();
    let states: Vec<_> = true_states.iter().collect();
    let mut errors = Vec::new();
    let mut frames = 0;
    for (_, own) in seen.iter() {
        frames += 1;
        let Some(left) = own.left else { continue };
        assert!(own.left_covariance.is_some());
        let nearest =
            states.iter().min_by_key(|(at, _)| at.0.abs_diff(own.capture_time_ns)).unwrap();
        let truth = nearest.1.left.unwrap();
        errors.push(distance([left.x, left.y], [truth.x, truth.y]));
    }
    errors.sort_by(f64::total_cmp);
    assert!(frames < errors.len() * 100 / 95, "{} of {frames}", errors.len());
    // The strikers move at up to 0.4 m/s between the instants of the truth.
    assert!(errors[errors.len() / 2] < 0.003, "{}", errors[errors.len() / 2]);
}

/// Calibration of the drawn camera, without tags.
fn drawn_calibration() -> CameraDocument {
    let text = serde_json::json!({
        "width_px": draw::WIDTH_PX, "height_px": draw::HEIGHT_PX,
        "focal_px": [draw::FOCAL_PX, draw::FOCAL_PX], "principal_point_px": draw::PRINCIPAL_POINT_PX,
        "distortion": {"k1": draw::K1, "k2": 0, "p1": 0, "p2": 0, "k3": 0},
        // Half a turn around the diagonal: columns run along y, rows along x.
        "rotation_rad": [std::f64::consts::PI / 2_f64.sqrt(), std::f64::consts::PI / 2_f64.sqrt(), 0],
        "translation_m": [0, 0, draw::CAMERA_HEIGHT],
    });
    CameraDocument::from_json(&text.to_string()).unwrap()
}

#[test]
fn a_camera_that_has_moved_is_measured_by_the_edges_of_drawn_frames() {
    let mut artist = Artist::new([0.16, 0.21], 3);
    let mut frame = Frame::default();
    for shift in [[0.0, 0.0], [0.003, -0.001], [-0.005, 0.006]] {
        let scene = Scene {
            capture_time: Nanos(0),
            exposure_s: 0.0,
            camera_shift: shift,
            ball: Some(([0.15, 0.1], [0.0; 2])),
            strikers: [([0.14, -0.19], [0.0; 2]), ([-0.14, 0.195], [0.0; 2])],
        };
        let size = [draw::WIDTH_PX, draw::HEIGHT_PX];
        frame.set_packed(size, klasktron::camera::PixelFormat::Yuyv, artist.draw(&scene)).unwrap();
        let mut check = PoseCheck::new(&drawn_calibration(), BoardSize::default()).unwrap();
        let found = check.shift(&frame).unwrap();
        let expected = distance(shift, [0.0; 2]);
        assert_eq!(found.features, PoseFeatures::Edges);
        assert!((found.shift_m - expected).abs() < 3e-4, "{found:?} {expected}");
        assert_eq!(found.is_moved(), 0.0 < expected, "{found:?}");
        // 0.65 m above the field a pixel is 0.57 mm.
        assert!((found.shift_px * 0.000_565 - expected).abs() < 3e-4, "{found:?}");
    }
}

/// Calibration of the rendered images, with the tags of `tests/data/camera/board`.
fn calibration_with_tags(folder: &Path) -> CameraDocument {
    let (images, camera) = (format!("images:{}", data("board")), folder.join("camera.json"));
    let (lens, output) = (data("camera.json"), camera.to_str().unwrap());
    let mut words = vec!["calibrate-camera", "--lens", &lens, "--board", &images, "-o", output];
    for tag in ["2:-0.140,-0.238", "3:0.140,-0.238", "4:0.140,0.238", "5:-0.140,0.238"] {
        words.extend(["--tag", tag]);
    }
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 0, "{stderr}");
    CameraDocument::from_json(&fs::read_to_string(&camera).unwrap()).unwrap()
}

#[test]
fn tags_of_the_calibration_are_compared_and_the_edges_without_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut document = calibration_with_tags(dir.path());
    assert_eq!(document.board_points.len(), 4);
    let board = changed("board", |own| own);
    let shift = |document: &CameraDocument, frame: &Frame| {
        PoseCheck::new(document, BoardSize::default()).unwrap().shift(frame).unwrap()
    };
    let still = shift(&document, &board);
    assert_eq!(still.features, PoseFeatures::Tags(4));
    assert!(still.shift_m < 2e-4, "{still:?}");
    // These images have no tags.
    let still = shift(&document, &changed("table", |own| own));
    assert_eq!(still.features, PoseFeatures::Edges);
    assert!(!still.is_moved(), "{still:?}");
    for point in &mut document.board_points {
        point.pixel_px[0] += 3.0;
        point.pixel_px[1] -= 4.0;
    }
    let moved = shift(&document, &board);
    assert!(moved.is_moved() && (moved.shift_px - 5.0).abs() < 0.3, "{moved:?}");
}

#[test]
fn detect_reports_a_moved_camera_once_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let mut document = json_of(Path::new(&data("camera.json")));
    // 4 mm along the short side, which are 7 px.
    let along = document["translation_m"][1].as_f64().unwrap();
    document["translation_m"][1] = (along + 0.004).into();
    let camera = dir.path().join("camera.json");
    fs::write(&camera, document.to_string()).unwrap();
    let (images, detector) = (format!("images:{}", data("table")), data("detector.json"));
    let words = ["detect", "--camera", &images, "--detector", &detector, "--json"];
    let more = ["--calibration", camera.to_str().unwrap()];
    let (stdout, stderr, status) = said(&klasktron(&[&words[..], &more].concat()));
    assert_eq!(status, 3, "{stderr}");
    let words = "warning: the camera or the table has moved since the calibration: positions are off by up to";
    assert_eq!(stderr.matches(words).count(), 1, "{stderr}");
    assert!(stderr.contains("fit the board pose anew with `klasktron calibrate-camera`"));
    let summary: Value = serde_json::from_str(stdout.lines().last().unwrap()).unwrap();
    let shift = summary["pose_shift_mm"].as_f64().unwrap();
    assert!((shift - 4.0).abs() < 1.0, "{shift} mm");
    let (lines, stderr, _) = detect(&data("table"), &["--json"]);
    assert!(!stderr.contains("warning"), "{stderr}");
    assert!(lines.last().unwrap()["pose_shift_mm"].as_f64().unwrap() < 1.0);
}

/// One image again and again, as a live camera delivers it.
struct Still(Frame, u64);

impl FrameSource for Still {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError> {
        std::thread::sleep(Duration::from_millis(5));
        self.1 += 1;
        frame.copy_from(&self.0);
        frame.capture_time = Nanos(self.1 * 50_000_000);
        Ok(Next::Frame)
    }

    fn name(&self) -> String {
        "still".to_owned()
    }

    fn is_live(&self) -> bool {
        true
    }
}

#[test]
fn a_live_camera_is_checked_on_a_thread_and_a_covered_one_is_named() {
    let mut document = json_of(Path::new(&data("camera.json")));
    let along = document["translation_m"][0].as_f64().unwrap();
    document["translation_m"][0] = (along - 0.005).into();
    let document = CameraDocument::from_json(&document.to_string()).unwrap();
    let frames = [changed("table", |own| own), changed("table", |_| [90, 90, 90])];
    for (moved, frame) in [true, false].into_iter().zip(frames) {
        let check = PoseCheck::new(&document, BoardSize::default());
        let mut camera = DetectingCamera::new(Box::new(Still(frame, 0)), detector(), check);
        let mut warnings = Vec::new();
        for _ in 0..600 {
            camera.next_seen().unwrap();
            warnings.extend(camera.take_warnings());
        }
        match warnings[..] {
            [FrameWarning::Pose(PoseWarning::Moved(shift))] if moved => {
                // The foot of the wall and its shadow are 0.6 mm wide in these images.
                assert!((shift.shift_m - 0.005).abs() < 1e-3, "{shift:?}");
            }
            [FrameWarning::Pose(PoseWarning::Unchecked)] if !moved => {}
            _ => panic!("{moved}: {warnings:?}"),
        }
    }
}

#[test]
fn a_match_reports_that_the_camera_has_moved() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.json");
    let fault = r#"{"faults": [{"at_s": 2.0, "kind": "camera_shifts", "x_m": 0.003, "y_m": 0.0}]}"#;
    fs::write(&rig, fault).unwrap();
    let output = dir.path().join("match.mcap");
    let words = ["play", "--camera", "virtual", "--speed", "max", "--seconds", "4"];
    let more = ["--left", "goalkeeper", "--right", "chaser", "--rig", rig.to_str().unwrap(), "-o"];
    let (_, stderr, _) =
        said(&klasktron(&[&words[..], &more, &[output.to_str().unwrap()]].concat()));
    let warning = "warning: the camera or the table has moved since the first frames: positions are off by up to 3.";
    assert_eq!(stderr.matches(warning).count(), 1, "{stderr}");
}
