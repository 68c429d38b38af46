//! Camera of the virtual rig with drawn frames: its calibration, and the colours from frames with known pieces.

use super::tell;
use klasktron::{
    board::BoardSize,
    camera::{
        CameraDocument, CameraModel, ColorFit, DetectingFrames, Detector, Distortion, Frame, Kind,
        Lens, Mark, Pieces, PixelFormat, Pose, PoseCheck, PoseChecks, write_datagram,
    },
    rig::{Artist, RigConfig, Scene, VirtualLink, draw},
    units::Nanos,
};

/// Places (m) of ball, left and right striker in the frames that the colours are fitted to.
const PLACES: [[[f64; 2]; 3]; 4] = [
    [[0.0, 0.06], [-0.05, -0.1], [0.05, 0.1]],
    [[0.11, -0.15], [0.1, -0.05], [-0.1, 0.15]],
    [[-0.12, 0.18], [-0.12, -0.18], [0.13, 0.04]],
    [[0.06, 0.02], [0.02, -0.06], [-0.04, 0.07]],
];

/// Let a detector see the drawn frames of the rig.
pub(super) fn with_vision(link: VirtualLink, config: &RigConfig) -> anyhow::Result<VirtualLink> {
    let board = BoardSize::new(config.board.short_side_m, config.board.long_side_m)?;
    let calibration = calibration();
    let detector = fitted(&calibration.camera()?, board, config.seed)?;
    let mut pose = PoseCheck::new(&calibration, board).map(PoseChecks::here);
    let mut frames = DetectingFrames::new(detector);
    let mut frame = Frame::default();
    let size = [draw::WIDTH_PX, draw::HEIGHT_PX];
    Ok(link.with_vision(Box::new(move |bytes: &[u8], capture_time: Nanos| {
        frame.set_packed(size, PixelFormat::Yuyv, bytes).ok()?;
        frame.capture_time = capture_time;
        if let Some(warning) = pose.as_mut().and_then(|own| own.take(&frame)) {
            tell(&format!("warning: {warning}"));
        }
        Some(write_datagram(&frames.detect(&frame).ok()?))
    })))
}

/// Calibration of the drawn camera, from the numbers that the rig publishes.
fn calibration() -> CameraDocument {
    let lens = Lens {
        focal_px: [draw::FOCAL_PX; 2],
        principal_point_px: draw::PRINCIPAL_POINT_PX,
        distortion: Distortion { k1: draw::K1, ..Distortion::default() },
    };
    let pose = Pose {
        rotation: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
        translation: [0.0, 0.0, draw::CAMERA_HEIGHT],
    };
    CameraDocument::new([draw::WIDTH_PX, draw::HEIGHT_PX], &lens, Some(&pose))
}

/// Detector with the colours of drawn frames. The rig draws no biscuits; white of the lines is theirs.
fn fitted(camera: &CameraModel, board: BoardSize, seed: u64) -> anyhow::Result<Detector> {
    let pieces = Pieces { striker_height_m: draw::STRIKER_HEIGHT, ..Pieces::default() };
    let mut artist = Artist::new([board.short_side / 2.0, board.long_side / 2.0], seed);
    let mut fit = ColorFit::new(camera, &pieces, board);
    let mut frame = Frame::default();
    for [ball, left, right] in PLACES {
        let scene = Scene {
            capture_time: Nanos(0),
            exposure_s: 0.0,
            camera_shift: [0.0; 2],
            ball: Some((ball, [0.0; 2])),
            strikers: [(left, [0.0; 2]), (right, [0.0; 2])],
        };
        frame.set_packed(
            [draw::WIDTH_PX, draw::HEIGHT_PX],
            PixelFormat::Yuyv,
            artist.draw(&scene),
        )?;
        let mark = |kind: Kind, [x, y]: [f64; 2]| {
            Some(Mark { kind, pixel: camera.project([x, y, pieces.middle(kind)])? })
        };
        let marks = [mark(Kind::Ball, ball), mark(Kind::Striker, left), mark(Kind::Striker, right)];
        let marks: Vec<Mark> = marks.into_iter().flatten().collect();
        fit.add(&frame, &marks)?;
    }
    Ok(Detector::new(camera, &fit.finish()?)?)
}
