//! Shapes of the entities.

use super::message::{
    Color, CubePrimitive, CylinderPrimitive, LinePrimitive, LineType, Point3, Pose, Quaternion,
    SceneEntity, SpherePrimitive, Vector3,
};
use crate::{
    board::{BALL_RADIUS, BoardSize, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    ekf::{Estimate, Object},
    recording::{
        message::{BoardState, ObjectState},
        topic::Player,
    },
    units::Nanos,
};
use std::f64::consts::TAU;

/// Frame of reference of every entity.
const FRAME: &str = "board";
/// Thickness of the board in the picture (m).
const BOARD_THICKNESS: f64 = 0.006;
/// Height of a striker in the picture (m).
const STRIKER_HEIGHT: f64 = 0.025;
/// Radius of a carriage's ring (m).
const CARRIAGE_RADIUS: f64 = 0.014;
/// Height of lines above the board, so that both do not flicker (m).
const LINE_HEIGHT: f64 = 0.001;
/// Radius of the 95 % region of a normal distribution in two dimensions, in standard deviations.
const RADIUS_95: f64 = 2.447_746_830_680_816;
/// Time of motion that an estimate's line shows (s).
const AHEAD_S: f64 = 0.1;
/// Corners of an ellipse or a ring.
const CORNERS: usize = 24;
/// Time until a moving entity disappears (ns).
const LIFETIME_NS: i32 = 250_000_000;

const FIELD: Color = Color { r: 0.16, g: 0.42, b: 0.72, a: 1.0 };
const MARKING: Color = Color { r: 0.95, g: 0.95, b: 0.95, a: 1.0 };
const CUP: Color = Color { r: 0.05, g: 0.05, b: 0.08, a: 1.0 };
const BALL: Color = Color { r: 1.0, g: 0.55, b: 0.0, a: 1.0 };
const ESTIMATE: Color = Color { r: 1.0, g: 0.9, b: 0.2, a: 1.0 };
const SIDES: [Color; 2] =
    [Color { r: 0.1, g: 0.1, b: 0.1, a: 1.0 }, Color { r: 0.55, g: 0.1, b: 0.15, a: 1.0 }];
const PATHS: [Color; 2] =
    [Color { r: 0.3, g: 0.9, b: 0.4, a: 0.8 }, Color { r: 0.9, g: 0.4, b: 0.9, a: 0.8 }];
/// Colour of `/board/state`.
pub(super) const STATE: Color = Color { r: 1.0, g: 0.9, b: 0.2, a: 0.5 };
/// Colour of true positions.
pub(super) const TRUTH: Color = Color { r: 0.2, g: 1.0, b: 1.0, a: 0.5 };

fn entity(time: Nanos, id: impl Into<String>, lifetime_ns: i32) -> SceneEntity {
    SceneEntity {
        timestamp: Some(time.timestamp()),
        frame_id: FRAME.to_owned(),
        id: id.into(),
        lifetime: Some(prost_types::Duration { seconds: 0, nanos: lifetime_ns }),
        ..SceneEntity::default()
    }
}

fn pose([x, y]: [f64; 2], z: f64) -> Option<Pose> {
    let orientation = Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    Some(Pose { position: Some(Vector3 { x, y, z }), orientation })
}

fn line(kind: LineType, points: Vec<Point3>, thickness: f64, color: Color) -> LinePrimitive {
    let pose = pose([0.0; 2], 0.0);
    let (r#type, scale_invariant) = (kind.into(), false);
    LinePrimitive { r#type, pose, thickness, scale_invariant, points, color: Some(color) }
}

fn point([x, y]: [f64; 2], z: f64) -> Point3 {
    Point3 { x, y, z }
}

/// Upright cylinder on the height `z` of its bottom.
fn cylinder(at: [f64; 2], z: f64, [radius, height]: [f64; 2], color: Color) -> CylinderPrimitive {
    CylinderPrimitive {
        pose: pose(at, z + height / 2.0),
        size: Some(Vector3 { x: 2.0 * radius, y: 2.0 * radius, z: height }),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(color),
    }
}

/// Field with its border, centre line and goal cups.
pub(super) fn board(time: Nanos, BoardSize { short_side, long_side }: BoardSize) -> SceneEntity {
    let mut board = entity(time, "board", 0);
    board.cubes = vec![CubePrimitive {
        pose: pose([0.0; 2], -BOARD_THICKNESS / 2.0),
        size: Some(Vector3 { x: short_side, y: long_side, z: BOARD_THICKNESS }),
        color: Some(FIELD),
    }];
    let (x, y) = (short_side / 2.0, long_side / 2.0);
    let border = [[-x, -y], [x, -y], [x, y], [-x, y]].map(|at| point(at, LINE_HEIGHT));
    let middle = [[-x, 0.0], [x, 0.0]].map(|at| point(at, LINE_HEIGHT));
    board.lines = vec![
        line(LineType::Loop, border.to_vec(), 0.003, MARKING),
        line(LineType::Strip, middle.to_vec(), 0.001, MARKING),
    ];
    let cup = |y| cylinder([0.0, y], -BOARD_THICKNESS, [CUP_RADIUS, BOARD_THICKNESS + 5e-4], CUP);
    board.cylinders = vec![cup(-CUP_DISTANCE), cup(CUP_DISTANCE)];
    board
}

/// Planned path.
pub(super) fn path<'a>(
    time: Nanos,
    player: Player,
    points: impl Iterator<Item = &'a [f64; 2]>,
) -> SceneEntity {
    let mut path = entity(time, format!("path_{player}"), 0);
    // It disappears soon after the end of its run.
    path.lifetime = Some(prost_types::Duration { seconds: 1, nanos: LIFETIME_NS });
    let points = points.map(|at| point(*at, LINE_HEIGHT)).collect();
    path.lines = vec![line(LineType::Strip, points, 0.001, PATHS[player as usize])];
    path
}

/// Ring at the carriage under the board.
pub(super) fn carriage(time: Nanos, player: Player, at: [f64; 2]) -> SceneEntity {
    let mut carriage = entity(time, format!("carriage_{player}"), LIFETIME_NS);
    let ring = (0..CORNERS).map(|k| {
        let (sine, cosine) = (TAU * k as f64 / CORNERS as f64).sin_cos();
        point([at[0] + CARRIAGE_RADIUS * cosine, at[1] + CARRIAGE_RADIUS * sine], LINE_HEIGHT)
    });
    carriage.lines = vec![line(LineType::Loop, ring.collect(), 0.0015, SIDES[player as usize])];
    carriage
}

/// Striker.
pub(super) fn striker(time: Nanos, player: Player, at: [f64; 2]) -> SceneEntity {
    let mut striker = entity(time, player.name(), LIFETIME_NS);
    let size = [STRIKER_RADIUS, STRIKER_HEIGHT];
    striker.cylinders = vec![cylinder(at, 0.0, size, SIDES[player as usize])];
    striker
}

/// Ball.
pub(super) fn ball(time: Nanos, at: [f64; 2]) -> SceneEntity {
    let mut ball = entity(time, "ball", LIFETIME_NS);
    ball.spheres = vec![sphere(at, BALL_RADIUS, BALL)];
    ball
}

fn sphere(at: [f64; 2], radius: f64, color: Color) -> SpherePrimitive {
    let size = Some(Vector3 { x: 2.0 * radius, y: 2.0 * radius, z: 2.0 * radius });
    SpherePrimitive { pose: pose(at, radius), size, color: Some(color) }
}

/// 95 % ellipse of a position, and the motion of the next 0.1 s.
pub(super) fn estimate(time: Nanos, object: Object, estimate: &Estimate) -> SceneEntity {
    let mut drawn = entity(time, format!("estimate_{}", object.name()), LIFETIME_NS);
    let [x, y, vx, vy] = estimate.mean;
    let height = 2.0 * LINE_HEIGHT;
    let ellipse = ellipse([x, y], &estimate.covariance);
    let ellipse = ellipse.map(|at| point(at, height)).collect();
    let ahead = [[x, y], [x + AHEAD_S * vx, y + AHEAD_S * vy]].map(|at| point(at, height));
    drawn.lines = vec![
        line(LineType::Loop, ellipse, 0.0005, ESTIMATE),
        line(LineType::Strip, ahead.to_vec(), 0.001, ESTIMATE),
    ];
    drawn
}

/// Corners of the 95 % ellipse: the unit circle times the Cholesky factor of the covariance.
fn ellipse([x, y]: [f64; 2], covariance: &[[f64; 4]; 4]) -> impl Iterator<Item = [f64; 2]> {
    let [[xx, xy, ..], [_, yy, ..], ..] = *covariance;
    let a = xx.max(0.0).sqrt();
    let b = if 0.0 < a { xy / a } else { 0.0 };
    let c = (yy - b * b).max(0.0).sqrt();
    (0..CORNERS).map(move |k| {
        let (sine, cosine) = (TAU * k as f64 / CORNERS as f64).sin_cos();
        let [u, v] = [RADIUS_95 * cosine, RADIUS_95 * sine];
        [x + a * u, y + b * u + c * v]
    })
}

/// Positions of a board state.
pub(super) fn state(time: Nanos, name: &str, state: &BoardState, color: Color) -> SceneEntity {
    let mut drawn = entity(time, name, LIFETIME_NS);
    let objects =
        [(state.ball, BALL_RADIUS), (state.left, STRIKER_RADIUS), (state.right, STRIKER_RADIUS)];
    // A little larger than the pieces, so that both can be seen.
    let spheres = objects.into_iter().filter_map(|(own, radius)| {
        let ObjectState { x, y, .. } = own?;
        Some(sphere([x, y], 1.15 * radius, color))
    });
    drawn.spheres = spheres.collect();
    drawn
}
