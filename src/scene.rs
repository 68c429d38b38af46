//! Scene of a recording for three-dimensional viewers: `foxglove.SceneUpdate` on `/scene`.
//!
//! [`Scene`] takes the messages of a session in order, and returns a [`SceneUpdate`] at most 50
//! times per second. Its frame of reference is the board frame.
//!
//! | entity | source |
//! |---|---|
//! | `board` | size of the board; repeated every second for viewers that connect late |
//! | `ball`, `left`, `right` | detections of the camera; without a camera the carriages |
//! | `carriage_left`, `carriage_right` | carriages under the board by their encoders |
//! | `estimate_ball`, `estimate_left`, `estimate_right` | filter of `tune-ekf`: 95 % ellipse of the position, motion in the next 0.1 s |
//! | `state` | `/board/state`: the estimates that the players use |
//! | `truth` | `/truth/board/state`: the true positions, from a simulator |
//! | `path_left`, `path_right` | planned path of the current run |
//!
//! An entity that is not renewed for a quarter of a second disappears.
//!
//! ```
//! use klasktron::{
//!     recording::message::{CameraDetections, Point}, scene::{Scene, SceneSettings, Sight}, units::Nanos,
//! };
//! let mut scene = Scene::new(SceneSettings::default());
//! let ball = Some(Point { x: 0.1, y: -0.05 });
//! let seen = Sight::Camera(CameraDetections { ball, ..CameraDetections::default() });
//! let update = scene.see([Nanos(5), Nanos(0)], &seen).unwrap();
//! assert!(update.entities.iter().any(|entity| entity.id == "ball"));
//! ```

mod draw;
mod message;

pub use message::{
    Color, CubePrimitive, CylinderPrimitive, DESCRIPTOR, LinePrimitive, LineType, Point3, Pose,
    Quaternion, SCHEMA, SceneEntity, SceneUpdate, SpherePrimitive, Vector3,
};

use crate::{
    board::BoardSize,
    ekf::{BoardFilter, Detections, FilterSettings, Object},
    recording::{
        RawSchema, RecordingError, RecordingWriter,
        message::{BoardState, CameraDetections, CarriageState, RunMarker, run_marker::Phase},
        topic::{self, Player},
    },
    units::{NANOS_PER_SECOND, Nanos},
};
use prost::Message;
use std::collections::BTreeMap;

/// Shortest interval between two updates (ns).
const INTERVAL: u64 = NANOS_PER_SECOND / 50;
/// Interval at which unchanged entities are repeated (ns).
const REPEAT: u64 = NANOS_PER_SECOND;
/// Age at which a position is no longer shown (ns).
const STALE: u64 = NANOS_PER_SECOND / 4;
/// Largest number of points of a planned path.
const MOST_POINTS: usize = 300;

/// Planned path of one player in one run (m, board frame).
pub type PlannedPath = (Player, Vec<[f64; 2]>);

/// Content of a scene that is not in the messages.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneSettings {
    /// Size of the board.
    pub board: BoardSize,
    /// Filter of the estimates.
    pub filter: FilterSettings,
    /// Planned paths by the number of the run.
    pub paths: BTreeMap<u32, Vec<PlannedPath>>,
}

/// Message that a scene shows.
#[derive(Debug, Clone, PartialEq)]
pub enum Sight {
    /// `/camera/detections`.
    Camera(CameraDetections),
    /// `/striker/{left,right}/carriage`.
    Carriage(Player, CarriageState),
    /// `/board/state`.
    Board(BoardState),
    /// `/truth/board/state`.
    Truth(BoardState),
    /// `/run/marker`.
    Marker(RunMarker),
}

impl Sight {
    /// Decode a message of `topic`; `None` for topics that a scene does not show.
    #[must_use]
    pub fn decode(topic: &str, data: &[u8]) -> Option<Self> {
        match topic {
            topic::CAMERA_DETECTIONS => Message::decode(data).ok().map(Self::Camera),
            topic::BOARD_STATE => Message::decode(data).ok().map(Self::Board),
            topic::TRUE_BOARD_STATE => Message::decode(data).ok().map(Self::Truth),
            topic::RUN_MARKER => Message::decode(data).ok().map(Self::Marker),
            _ => {
                let of = |player: &Player| topic::carriage(*player) == topic;
                let player = Player::BOTH.into_iter().find(of)?;
                Message::decode(data).ok().map(|state| Self::Carriage(player, state))
            }
        }
    }
}

/// Scene of one session; see the module.
pub struct Scene {
    settings: SceneSettings,
    filter: BoardFilter,
    /// Last detection of each object, by [`Object::index`], with the time at which it was logged.
    detected: [Option<(Nanos, [f64; 2])>; 3],
    carriages: [Option<(Nanos, CarriageState)>; 2],
    board: Option<(Nanos, BoardState)>,
    truth: Option<(Nanos, BoardState)>,
    /// Capture time of the newest frame, and the time at which it was logged.
    newest: Option<(Nanos, Nanos)>,
    run: Option<u32>,
    updated: Option<Nanos>,
    repeated: Option<Nanos>,
}

impl Scene {
    /// Create a scene without any message.
    #[must_use]
    pub fn new(settings: SceneSettings) -> Self {
        Self {
            filter: BoardFilter::new(&settings.filter),
            settings,
            detected: [None; 3],
            carriages: [None; 2],
            board: None,
            truth: None,
            newest: None,
            run: None,
            updated: None,
            repeated: None,
        }
    }

    /// Take one message with its log and publish time; return an update when one is due.
    pub fn see(&mut self, [log, publish]: [Nanos; 2], sight: &Sight) -> Option<SceneUpdate> {
        match sight {
            Sight::Camera(detections) => self.see_frame([log, publish], detections),
            Sight::Carriage(player, state) => {
                self.carriages[*player as usize] = Some((log, *state))
            }
            Sight::Board(state) => self.board = Some((log, *state)),
            Sight::Truth(state) => self.truth = Some((log, *state)),
            Sight::Marker(marker) => {
                self.run = (marker.phase() == Phase::Start).then_some(marker.run);
                self.repeated = None;
            }
        }
        let is_due = |last: Option<Nanos>, interval| {
            last.is_none_or(|last| last.0.saturating_add(interval) <= log.0 || log < last)
        };
        if !is_due(self.updated, INTERVAL) {
            return None;
        }
        self.updated = Some(log);
        let mut entities = Vec::new();
        if is_due(self.repeated, REPEAT) {
            self.repeated = Some(log);
            entities.push(draw::board(log, self.settings.board));
            self.draw_paths(log, &mut entities);
        }
        self.draw_pieces(log, &mut entities);
        self.draw_estimates(log, &mut entities);
        self.draw_states(log, &mut entities);
        Some(SceneUpdate { entities })
    }

    fn see_frame(&mut self, [log, shown]: [Nanos; 2], detections: &CameraDetections) {
        let seen = Detections::of(shown, detections);
        for (last, position) in self.detected.iter_mut().zip(seen.positions) {
            if let Some(position) = position {
                *last = Some((log, position));
            }
        }
        self.filter.observe(&seen);
        self.newest = Some((shown, log));
    }

    fn draw_paths(&self, log: Nanos, entities: &mut Vec<SceneEntity>) {
        let Some(paths) = self.run.and_then(|run| self.settings.paths.get(&run)) else { return };
        for (player, points) in paths {
            let step = points.len().div_ceil(MOST_POINTS).max(1);
            entities.push(draw::path(log, *player, points.iter().step_by(step)));
        }
    }

    fn draw_pieces(&self, log: Nanos, entities: &mut Vec<SceneEntity>) {
        for player in Player::BOTH {
            let carriage = recent(self.carriages[player as usize], log);
            if let Some(state) = carriage {
                entities.push(draw::carriage(log, player, [state.x, state.y]));
            }
            let detected = recent(self.detected[object_of(player).index()], log);
            let at = detected.or_else(|| carriage.map(|state| [state.x, state.y]));
            entities.extend(at.map(|at| draw::striker(log, player, at)));
        }
        let ball = recent(self.detected[Object::Ball.index()], log);
        entities.extend(ball.map(|at| draw::ball(log, at)));
    }

    /// Estimates at the capture time of the newest frame.
    fn draw_estimates(&self, log: Nanos, entities: &mut Vec<SceneEntity>) {
        let Some((shown, logged)) = self.newest else { return };
        if recent(Some((logged, ())), log).is_none() {
            return;
        }
        for object in Object::ALL {
            let estimate = self.filter.estimate_at(object, shown);
            entities.extend(estimate.map(|own| draw::estimate(log, object, &own)));
        }
    }

    fn draw_states(&self, log: Nanos, entities: &mut Vec<SceneEntity>) {
        for (name, state, color) in
            [("state", self.board, draw::STATE), ("truth", self.truth, draw::TRUTH)]
        {
            let state = recent(state, log);
            entities.extend(state.map(|own| draw::state(log, name, &own, color)));
        }
    }
}

/// Value that is not stale at `now`.
fn recent<T>(value: Option<(Nanos, T)>, now: Nanos) -> Option<T> {
    value.filter(|(at, _)| now.0.saturating_sub(at.0) < STALE).map(|(_, own)| own)
}

fn object_of(player: Player) -> Object {
    match player {
        Player::Left => Object::Left,
        Player::Right => Object::Right,
    }
}

/// Schema of `/scene`, for [`RecordingWriter::write_raw`] and the live view.
#[must_use]
pub fn schema() -> RawSchema<'static> {
    RawSchema::protobuf(SCHEMA, DESCRIPTOR)
}

impl SceneUpdate {
    /// Write the update on `/scene`.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn write(&self, writer: &mut RecordingWriter, time: Nanos) -> Result<(), RecordingError> {
        writer.write_raw(topic::SCENE, &schema(), [time; 2], &self.encode_to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::message::Point;
    use prost_types::FileDescriptorSet;

    fn ids(update: &SceneUpdate) -> Vec<&str> {
        update.entities.iter().map(|entity| entity.id.as_str()).collect()
    }

    fn camera(x: f64) -> Sight {
        let ball = Some(Point { x, y: 0.02 });
        Sight::Camera(CameraDetections { ball, ..CameraDetections::default() })
    }

    fn marker(phase: Phase) -> Sight {
        let pattern = "circle".to_owned();
        let split = String::new();
        Sight::Marker(RunMarker { run: 3, pattern, phase: phase.into(), split })
    }

    fn at(ms: u64) -> [Nanos; 2] {
        [Nanos(1_000_000_000 + ms * 1_000_000); 2]
    }

    #[test]
    fn updates_come_at_50_hz_and_the_board_every_second() {
        let mut scene = Scene::new(SceneSettings::default());
        let updates: Vec<SceneUpdate> =
            (0..240).filter_map(|k| scene.see(at(k * 25 / 3), &camera(0.001 * k as f64))).collect();
        assert!((80..=100).contains(&updates.len()), "{}", updates.len());
        let boards = updates.iter().filter(|update| ids(update).contains(&"board")).count();
        assert_eq!(boards, 2);
        assert!(ids(&updates[0]).starts_with(&["board", "ball"]));
    }

    #[test]
    fn the_ellipse_has_the_95_percent_radius_of_the_position() {
        let mut scene = Scene::new(SceneSettings::default());
        let mut last = SceneUpdate::default();
        for k in 0..240 {
            last = scene.see(at(10 * k), &camera(0.05)).unwrap_or(last);
        }
        let estimate = last.entities.iter().find(|entity| entity.id == "estimate_ball").unwrap();
        let points = &estimate.lines[0].points;
        let sigma = FilterSettings::default().ball.measurement_sigma_m;
        for point in points {
            let radius = (point.x - 0.05).hypot(point.y - 0.02);
            assert!(0.0 < radius && radius < 2.448 * sigma, "{radius} m");
        }
    }

    #[test]
    fn the_path_is_there_during_its_run_and_stale_positions_are_not() {
        let path: Vec<[f64; 2]> = (0..1000).map(|k| [0.0001 * f64::from(k), -0.1]).collect();
        let paths = BTreeMap::from([(3, vec![(Player::Left, path)])]);
        let mut scene = Scene::new(SceneSettings { paths, ..SceneSettings::default() });
        assert!(!ids(&scene.see(at(0), &camera(0.1)).unwrap()).contains(&"path_left"));
        let update = scene.see(at(100), &marker(Phase::Start)).unwrap();
        let drawn = update.entities.iter().find(|entity| entity.id == "path_left").unwrap();
        assert!((100..=MOST_POINTS).contains(&drawn.lines[0].points.len()));
        let update = scene.see(at(600), &marker(Phase::End)).unwrap();
        assert_eq!(ids(&update), ["board"]);
    }

    /// The descriptor that recordings carry defines every field that is written.
    #[test]
    fn the_descriptor_defines_the_message() {
        let set = FileDescriptorSet::decode(DESCRIPTOR).unwrap();
        let defined = |name: &str, field: &str, number: i32| {
            let messages = set.file.iter().flat_map(|file| &file.message_type);
            let message = messages.clone().find(|message| message.name() == name).unwrap();
            message.field.iter().any(|own| own.name() == field && own.number() == number)
        };
        for (message, field, number) in [
            ("SceneUpdate", "entities", 2),
            ("SceneEntity", "lifetime", 4),
            ("SceneEntity", "cubes", 8),
            ("SceneEntity", "spheres", 9),
            ("SceneEntity", "cylinders", 10),
            ("SceneEntity", "lines", 11),
            ("LinePrimitive", "points", 5),
            ("LinePrimitive", "color", 6),
            ("CylinderPrimitive", "top_scale", 4),
        ] {
            assert!(defined(message, field, number), "{message}.{field}");
        }
    }
}
