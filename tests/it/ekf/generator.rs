//! Games on a board whose physics shares no code with the filter: small explicit steps of 1/4800 s,
//! contacts found by overlap, impacts with heavy strikers on given paths. What is known of it
//! stands in [`Game`], so a test can ask whether it is found again.

use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingWriter,
        message::{
            BoardState, CameraDetections, Covariance, ObjectState, Point, RunMarker,
            run_marker::Phase,
        },
        topic,
    },
    seed::Stream,
    units::Nanos,
};
use std::{collections::BTreeMap, f64::consts::TAU, path::Path};

/// Steps of the world in a picture.
const STEPS: u32 = 40;
/// Pictures per second.
pub(crate) const CAMERA_HZ: f64 = 120.0;
/// First capture.
const START: Nanos = Nanos(1_700_000_000_000_000_000);
/// Half of the board less the ball's radius of 7 mm (m).
const REACH: [f64; 2] = [0.153, 0.203];
/// Ball and striker touch (m).
const TOUCH: f64 = 0.0145;
/// Centre and radius of the goals (m).
const GOAL: (f64, f64) = (0.17, 0.01905);

/// What is played, and how it is seen.
#[derive(Debug, Clone)]
pub(crate) struct Game {
    pub(crate) seed: u64,
    /// Rolls; every third one is marked `validation`.
    pub(crate) runs: u32,
    /// Length of each (s).
    pub(crate) run_s: f64,
    /// White acceleration of the ball everywhere (m2/s3).
    pub(crate) psd: f64,
    /// Rolling: c (m/s2) and b (1/s).
    pub(crate) rolling: [f64; 2],
    /// Walls: restitution, its scatter, scatter along the wall per speed.
    pub(crate) walls: [f64; 3],
    /// Whether strikers move into the ball's way.
    pub(crate) strikers: Players,
    /// Camera: standard deviation in each axis (m).
    pub(crate) sigma: f64,
    /// Factor of it in every second frame.
    pub(crate) uneven: f64,
    /// Reported variance relative to the true one; `None`: detections without covariances.
    pub(crate) reported: Option<f64>,
    /// Share of detections that are lost.
    pub(crate) lost: f64,
    /// From capture to arrival (s).
    pub(crate) latency: f64,
}

/// What the strikers do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Players {
    /// None are there.
    Absent,
    /// They swing in front of their goals.
    Swinging,
}

impl Default for Game {
    fn default() -> Self {
        Self {
            seed: 1,
            runs: 24,
            run_s: 2.5,
            psd: 0.004,
            rolling: [0.12, 0.15],
            walls: [0.8, 0.04, 0.05],
            strikers: Players::Swinging,
            sigma: 5e-4,
            uneven: 1.0,
            reported: None,
            lost: 0.02,
            latency: 0.012,
        }
    }
}

/// One picture.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) time_s: f64,
    pub(crate) seen: [Option<[f64; 2]>; 3],
    pub(crate) truth: [Option<[f64; 4]>; 3],
    /// Standard deviation of these detections (m).
    pub(crate) sigma: f64,
}

struct World {
    ball: [f64; 4],
    /// Whether the ball lies in a goal, where nobody sees it.
    in_goal: bool,
    phases: [f64; 4],
    draw: Draw,
}

/// Normal and uniform numbers.
pub(crate) struct Draw(Stream);

impl Draw {
    pub(crate) fn new(seed: u64, name: &str) -> Self {
        Self(Stream::new(seed, name))
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.0.below(1 << 40) as f64 / (1_u64 << 40) as f64
    }

    /// Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }
}

impl Game {
    /// All pictures, run by run.
    pub(crate) fn play(&self) -> Vec<Vec<Picture>> {
        let mut camera = Draw::new(self.seed, "camera");
        let mut ball = Draw::new(self.seed, "ball");
        (0..self.runs)
            .map(|run| {
                let began = f64::from(run) * self.run_s;
                let draw = Draw::new(self.seed, &format!("world {run}"));
                let mut world = World::launch(&mut ball, draw);
                let pictures = (self.run_s * CAMERA_HZ) as u32;
                let picture = |k: u32| {
                    let time_s = began + f64::from(k) / CAMERA_HZ;
                    for step in 0..STEPS {
                        let ahead = f64::from(STEPS - 1 - step) / f64::from(STEPS) / CAMERA_HZ;
                        world.step(self, time_s - ahead);
                    }
                    self.take(&mut camera, &world, time_s)
                };
                (1..pictures).map(picture).collect()
            })
            .collect()
    }

    fn take(&self, camera: &mut Draw, world: &World, time_s: f64) -> Picture {
        let strikers = self.strikers_at(world.phases, time_s);
        let ball = (!world.in_goal).then_some(world.ball);
        let truth = [ball, strikers.map(|s| s[0]), strikers.map(|s| s[1])];
        let is_odd = (time_s * CAMERA_HZ).round() as u64 % 2 == 1;
        let sigma = if is_odd { self.uneven * self.sigma } else { self.sigma };
        let seen = truth.map(|state| {
            let noise = [camera.normal(), camera.normal()];
            let kept = self.lost <= camera.uniform();
            state.filter(|_| kept).map(|state| [0, 1].map(|k| state[k] + sigma * noise[k]))
        });
        Picture { time_s, seen, truth, sigma }
    }

    fn strikers_at(&self, phases: [f64; 4], t: f64) -> Option<[[f64; 4]; 2]> {
        let swing = |size: f64, w: f64, phase: f64| {
            let (sin, cos) = (w * t + phase).sin_cos();
            (size * sin, size * w * cos)
        };
        (self.strikers == Players::Swinging).then(|| {
            [0, 1].map(|player| {
                let side = if player == 0 { -1.0 } else { 1.0 };
                let (x, vx) = swing(0.09, 3.1 + side * 0.4, phases[player]);
                let (y, vy) = swing(0.05, 4.3 - side * 0.6, phases[player + 2]);
                [x, side * 0.10 + y, vx, vy]
            })
        })
    }

    /// Writes the game, with `/truth/board/state` at every capture.
    pub(crate) fn write(&self, path: &Path) {
        let mut writer =
            RecordingWriter::create(path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
        let metadata: BTreeMap<String, String> =
            [("schema_version", "1"), ("source", "simulation"), ("robot", "generator")]
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
                .into();
        writer.metadata(RECORDING_METADATA, metadata).unwrap();
        for (number, pictures) in (0..).zip(self.play()) {
            let at = |picture: &Picture| START.after_seconds(picture.time_s);
            let marker = |phase: Phase| RunMarker {
                run: number,
                pattern: "roll".into(),
                phase: phase.into(),
                split: if number % 3 == 2 { "validation" } else { "train" }.into(),
            };
            let ends = [&pictures[0], &pictures[pictures.len() - 1]].map(at);
            let late = self.latency + 0.002;
            writer.write(topic::RUN_MARKER, ends[0], &marker(Phase::Start)).unwrap();
            for picture in &pictures {
                self.write_picture(&mut writer, at(picture), picture);
            }
            let end = ends[1].after_seconds(late);
            writer.write(topic::RUN_MARKER, end, &marker(Phase::End)).unwrap();
        }
        writer.finish().unwrap();
    }

    fn write_picture(&self, writer: &mut RecordingWriter, at: Nanos, picture: &Picture) {
        let point = |place: [f64; 2]| Point { x: place[0], y: place[1] };
        let [ball, left, right] = picture.seen.map(|place| place.map(point));
        let covariance = self.reported.map(|factor| {
            let variance = factor * picture.sigma.powi(2);
            Covariance { xx: variance, xy: 0.0, yy: variance }
        });
        let seen = CameraDetections {
            capture_time_ns: at.0,
            ball,
            left,
            right,
            ball_covariance: covariance.filter(|_| ball.is_some()),
            left_covariance: covariance.filter(|_| left.is_some()),
            right_covariance: covariance.filter(|_| right.is_some()),
        };
        let [ball, left, right] =
            picture.truth.map(|state| state.map(|[x, y, vx, vy]| ObjectState { x, y, vx, vy }));
        let truth = BoardState { ball, left, right, status: 0 };
        writer.write("/truth/board/state", at, &truth).unwrap();
        let arrival = at.after_seconds(self.latency);
        writer.write_published(topic::CAMERA_DETECTIONS, arrival, at, &seen).unwrap();
    }
}

impl World {
    fn launch(ball: &mut Draw, mut draw: Draw) -> Self {
        let (speed, angle) = (0.4 + 1.2 * ball.uniform(), TAU * ball.uniform());
        let x = 0.14 * (2.0 * ball.uniform() - 1.0);
        let phases = [0; 4].map(|_| TAU * draw.uniform());
        let ball = [x, 0.0, speed * angle.cos(), speed * angle.sin()];
        Self { ball, in_goal: false, phases, draw }
    }

    fn step(&mut self, game: &Game, t: f64) {
        let h = 1.0 / (CAMERA_HZ * f64::from(STEPS));
        if self.in_goal {
            return;
        }
        let [x, y, vx, vy] = self.ball;
        let speed = vx.hypot(vy);
        let loss = h * (game.rolling[0] + game.rolling[1] * speed);
        let kept = if speed <= loss { 0.0 } else { 1.0 - loss / speed };
        let kick = (game.psd * h).sqrt();
        let (vx, vy) =
            (kept * vx + kick * self.draw.normal(), kept * vy + kick * self.draw.normal());
        self.ball = [x + h * vx, y + h * vy, vx, vy];
        self.walls(game);
        for striker in game.strikers_at(self.phases, t).iter().flatten() {
            self.touch(striker);
        }
        self.goals(h);
    }

    fn walls(&mut self, game: &Game) {
        for (axis, reach) in REACH.into_iter().enumerate() {
            let (place, speed) = (self.ball[axis], self.ball[axis + 2]);
            if reach < place.abs() && 0.0 < place * speed {
                let bounce = (game.walls[0] + game.walls[1] * self.draw.normal()).clamp(0.0, 1.0);
                self.ball[axis] = reach.copysign(place);
                self.ball[axis + 2] = -bounce * speed;
                self.ball[3 - axis] += game.walls[2] * speed * self.draw.normal();
            }
        }
    }

    /// A striker that nothing stops pushes the ball with three quarters of the relative speed.
    fn touch(&mut self, striker: &[f64; 4]) {
        let away = [self.ball[0] - striker[0], self.ball[1] - striker[1]];
        let distance = away[0].hypot(away[1]);
        if TOUCH <= distance || distance == 0.0 {
            return;
        }
        let n = away.map(|a| a / distance);
        let closing = -(n[0] * (self.ball[2] - striker[2]) + n[1] * (self.ball[3] - striker[3]));
        for axis in 0..2 {
            self.ball[axis] = striker[axis] + TOUCH * n[axis];
            self.ball[axis + 2] += 1.75 * closing.max(0.0) * n[axis];
        }
    }

    /// Over a goal the ball is shaken; a slow one falls in.
    fn goals(&mut self, h: f64) {
        let centre = [0.0, GOAL.0.copysign(self.ball[1])];
        if (self.ball[0] - centre[0]).hypot(self.ball[1] - centre[1]) < GOAL.1 {
            let kick = (3.0 * h).sqrt();
            self.ball[2] += kick * self.draw.normal();
            self.ball[3] += kick * self.draw.normal();
            if self.ball[2].hypot(self.ball[3]) < 0.3 {
                self.in_goal = true;
            }
        }
    }
}
