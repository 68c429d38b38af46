//! What players see of a board: camera frames, the state estimator, and what it makes of them.
//!
//! [`Estimator`] is the one definition of an observed state. A match at a table feeds it with the
//! frames of the camera; training feeds it with frames of a camera model ([`Sensors`]). It runs the
//! filter of `ekf.json` and predicts its estimates to the time of the decision.
//!
//! The camera model captures at a constant rate, adds white noise of the filter's measurement
//! standard deviation, loses frames at random, and delivers the others after a constant latency.
//! Positions between control periods are interpolated, so a frame next to an impact is up to half a
//! period's path off.

use super::{
    error::{GameError, within},
    games::{Games, Snapshot},
    observation::Observation,
    settings::CONTROL_PERIOD,
};
use crate::{
    board::{CUP_DISTANCE, CUP_RADIUS},
    ekf::{BoardFilter, Detections, FilterSettings, LastFrame, Object},
    recording::topic::Player,
    seed::{SPLITMIX64_INCREMENT, Stream, splitmix64},
    units::Nanos,
};
use serde::{Deserialize, Serialize};
use std::{collections::VecDeque, f64::consts::TAU};

/// Time over a cup after which the ball is out of play (s); upstream ends a game after 30 frames.
pub const IN_CUP_SECONDS: f64 = 0.25;

/// Frames before an episode begins, by which the filter has settled.
const RUN_IN_FRAMES: i64 = 24;
/// Time of the beginning of an episode on the estimator's clock; the run-in lies before it.
const EPISODE_START: Nanos = Nanos(10_000_000_000);

/// Camera and estimator between the game and its players.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSettings {
    /// Frame rate of the camera (Hz), 10 to 1000; 120, that of the table.
    pub camera_rate_hz: f64,
    /// Latency from capture to the decision that uses a frame (s), 0 to 0.2.
    pub latency_s: f64,
    /// Fraction of the frames that are lost, 0 to 0.9.
    pub lost_fraction: f64,
    /// Settings of the filter, as in `ekf.json`. Its measurement standard deviations are the noise
    /// of the detections.
    pub filter: FilterSettings,
}

impl SensorSettings {
    /// The table's camera, with the latency and the noise of `filter`.
    #[must_use]
    pub fn of(filter: FilterSettings) -> Self {
        let latency_s = filter.latency_s;
        Self { camera_rate_hz: 120.0, latency_s, lost_fraction: 0.0, filter }
    }

    /// Check that every value is in its range.
    ///
    /// # Errors
    /// The first value outside its range.
    pub fn check(&self) -> Result<(), GameError> {
        within("sensors.camera_rate_hz", self.camera_rate_hz, 10.0, 1000.0)?;
        within("sensors.latency_s", self.latency_s, 0.0, 0.2)?;
        within("sensors.lost_fraction", self.lost_fraction, 0.0, 0.9)
    }
}

/// State of the board as a decision uses it, in the board frame: position and velocity (m, m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Estimates of the filter at this time, by [`Object::index`]; `None` without a track.
    pub estimates: [Option<[f64; 4]>; 3],
    /// Strikers, left first.
    pub strikers: [[f64; 4]; 2],
    /// Ball in play; `None` where it is not detected, or has been in a cup for
    /// [`IN_CUP_SECONDS`].
    pub ball: Option<[f64; 4]>,
}

/// Estimator of the observed state, fed with camera frames.
#[derive(Debug, Clone)]
pub struct Estimator {
    filter: BoardFilter,
    /// Last known state of each striker (m, m/s).
    strikers: [[f64; 4]; 2],
    in_cup_since: Option<Nanos>,
}

impl Estimator {
    /// Estimator without any frame; `strikers` are their positions until they are detected (m).
    #[must_use]
    pub fn new(filter: &FilterSettings, strikers: [[f64; 2]; 2]) -> Self {
        let strikers = strikers.map(|[x, y]| [x, y, 0.0, 0.0]);
        Self { filter: BoardFilter::new(filter), strikers, in_cup_since: None }
    }

    /// Take a frame.
    pub fn see(&mut self, seen: &Detections) {
        self.filter.observe(seen);
    }

    /// State at `now`. An undetected striker is at its carriage by the encoders (position and
    /// velocity, left first); without a carriage it rests at its last position.
    pub fn look(&mut self, now: Nanos, carriages: [Option<[f64; 4]>; 2]) -> Seen {
        let estimates =
            Object::ALL.map(|object| self.filter.estimate_at(object, now).map(|own| own.mean));
        for player in Player::BOTH {
            let index = player as usize;
            let object = [Object::Left, Object::Right][index];
            let [x, y, ..] = self.strikers[index];
            self.strikers[index] =
                estimates[object.index()].or(carriages[index]).unwrap_or([x, y, 0.0, 0.0]);
        }
        let ball = self.in_play(estimates[Object::Ball.index()], now);
        Seen { estimates, strikers: self.strikers, ball }
    }

    /// The ball, unless it has been in a cup for [`IN_CUP_SECONDS`].
    fn in_play(&mut self, ball: Option<[f64; 4]>, now: Nanos) -> Option<[f64; 4]> {
        let [x, y, ..] = ball?;
        if x.hypot(y.abs() - CUP_DISTANCE) < CUP_RADIUS {
            let since = *self.in_cup_since.get_or_insert(now);
            return ball.filter(|_| now.seconds_since(since) < IN_CUP_SECONDS);
        }
        self.in_cup_since = None;
        ball
    }
}

/// Camera and estimator of one environment.
#[derive(Debug, Clone)]
struct Watch {
    estimator: Estimator,
    /// Number of the next frame; 0 is captured at the beginning of the episode.
    next_frame: i64,
    /// Captured frames that have not arrived.
    waiting: VecDeque<Detections>,
    /// Positions of ball, left and right striker at the last look (m).
    before: [[f64; 2]; 3],
    seen: Seen,
    /// Last ball in play.
    ball: [f64; 4],
}

/// State of a [`Watch`] for a checkpoint.
#[derive(Serialize, Deserialize)]
struct WatchState {
    last: Option<LastFrame>,
    strikers: [[f64; 4]; 2],
    in_cup_since: Option<u64>,
    next_frame: i64,
    waiting: Vec<Detections>,
    before: [[f64; 2]; 3],
    ball: [f64; 4],
}

/// Camera model of a range of environments.
#[derive(Debug, Clone, Copy)]
struct Camera {
    settings: SensorSettings,
    /// Key of the noise.
    key: u64,
    /// Number of the first environment.
    first: usize,
}

/// Sensors of a range of environments.
#[derive(Debug, Clone)]
pub struct Sensors {
    camera: Camera,
    boards: Vec<Watch>,
}

impl Sensors {
    /// Sensors of the environments of `games`, the first of which has the number `first`; their
    /// noise is that of `seed`.
    #[must_use]
    pub fn new(settings: &SensorSettings, games: &Games, (first, seed): (usize, u64)) -> Self {
        let key = Stream::new(seed, "game.sensors").below(1 << 62) as u64;
        let camera = Camera { settings: *settings, key, first };
        let begun = |board| camera.begun(board, &games.snapshot(board));
        Self { boards: (0..games.len()).map(begun).collect(), camera }
    }

    /// Observe every environment after a step; `games` are not yet in their next episodes.
    pub fn advance(&mut self, games: &Games) {
        for (board, watch) in self.boards.iter_mut().enumerate() {
            self.camera.follow(watch, (board, &games.snapshot(board)));
        }
    }

    /// Observe the beginning of an episode in the environment `board`.
    pub fn begin(&mut self, board: usize, games: &Games) {
        self.boards[board] = self.camera.begun(board, &games.snapshot(board));
    }

    /// Observation of `player` in the environment `board`. A ball that is not in play is where it
    /// was last.
    #[must_use]
    pub fn observation(&self, board: usize, player: Player) -> Observation {
        let watch = &self.boards[board];
        Observation::of_board(player, &watch.seen.strikers, watch.ball)
    }

    /// Return whether the ball of `board` is seen and in play; a match stops both players if not.
    #[must_use]
    pub fn is_in_play(&self, board: usize) -> bool {
        self.boards[board].seen.ball.is_some()
    }

    /// Save the state of all environments, for [`restore`](Self::restore).
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        let state = |watch: &Watch| WatchState {
            last: watch.estimator.filter.last_frame(),
            strikers: watch.estimator.strikers,
            in_cup_since: watch.estimator.in_cup_since.map(|time| time.0),
            next_frame: watch.next_frame,
            waiting: watch.waiting.iter().copied().collect(),
            before: watch.before,
            ball: watch.ball,
        };
        let states: Vec<WatchState> = self.boards.iter().map(state).collect();
        serde_json::to_vec(&states).unwrap_or_else(|_plain| unreachable!("plain data"))
    }

    /// Restore a state that sensors of the same settings and environments have saved; they continue
    /// with identical results. `games` are restored already.
    ///
    /// # Errors
    /// When `saved` is of another kind or has another number of environments.
    pub fn restore(&mut self, saved: &[u8], games: &Games) -> Result<(), GameError> {
        let states: Vec<WatchState> = serde_json::from_slice(saved).unwrap_or_default();
        let (what, expected) = ("the saved state of the sensors", self.boards.len());
        if states.len() != expected {
            return Err(GameError::Shape { what, found: states.len(), expected });
        }
        for (board, (watch, state)) in self.boards.iter_mut().zip(states).enumerate() {
            watch.estimator.filter = BoardFilter::resume(&self.camera.settings.filter, state.last);
            watch.estimator.strikers = state.strikers;
            watch.estimator.in_cup_since = state.in_cup_since.map(Nanos);
            watch.next_frame = state.next_frame;
            watch.waiting = state.waiting.into();
            watch.before = state.before;
            watch.ball = state.ball;
            let snapshot = games.snapshot(board);
            self.camera.look(watch, snapshot.step, &snapshot);
        }
        Ok(())
    }
}

impl Camera {
    fn begun(&self, board: usize, state: &Snapshot) -> Watch {
        let positions = positions(state);
        let mut watch = Watch {
            estimator: Estimator::new(&self.settings.filter, [positions[1], positions[2]]),
            next_frame: -RUN_IN_FRAMES,
            waiting: VecDeque::new(),
            before: positions,
            seen: Seen { estimates: [None; 3], strikers: [[0.0; 4]; 2], ball: None },
            ball: [positions[0][0], positions[0][1], 0.0, 0.0],
        };
        // Before the start everything moves as it does then.
        let velocities =
            [state.ball_velocity, state.striker_velocities[0], state.striker_velocities[1]];
        let at = |time: f64| {
            let moved = |k: usize, axis: usize| positions[k][axis] + time * velocities[k][axis];
            std::array::from_fn(|k| [moved(k, 0), moved(k, 1)])
        };
        self.capture(&mut watch, (board, state), 0.0, at);
        self.look(&mut watch, 0, state);
        watch
    }

    fn follow(&self, watch: &mut Watch, (board, state): (usize, &Snapshot)) {
        let end = CONTROL_PERIOD * f64::from(state.step);
        let (before, after) = (watch.before, positions(state));
        let at = |time: f64| {
            let left = (end - time) / CONTROL_PERIOD;
            let between =
                |k: usize, axis: usize| after[k][axis] + left * (before[k][axis] - after[k][axis]);
            std::array::from_fn(|k| [between(k, 0), between(k, 1)])
        };
        self.capture(watch, (board, state), end, at);
        watch.before = after;
        self.look(watch, state.step, state);
    }

    /// Capture the frames up to `end` (s since the episode began); `at` gives the positions.
    fn capture(
        &self,
        watch: &mut Watch,
        (board, state): (usize, &Snapshot),
        end: f64,
        at: impl Fn(f64) -> [[f64; 2]; 3],
    ) {
        let SensorSettings { camera_rate_hz, lost_fraction, filter, .. } = &self.settings;
        loop {
            let time = watch.next_frame as f64 / camera_rate_hz;
            if end < time {
                return;
            }
            let numbers = [(self.first + board) as u64, state.episode, watch.next_frame as u64];
            let mut draws = Draws::of(self.key, numbers);
            watch.next_frame += 1;
            if draws.uniform() < *lost_fraction {
                continue;
            }
            let mut positions = at(time);
            for (object, position) in Object::ALL.into_iter().zip(&mut positions) {
                let sigma = filter.object(object).measurement_sigma_m;
                let noise = draws.normal_pair();
                position.iter_mut().zip(noise).for_each(|(x, noise)| *x += sigma * noise);
            }
            let time = EPISODE_START.after_seconds(time);
            watch.waiting.push_back(Detections::new(time, positions.map(Some)));
        }
    }

    /// Deliver the frames that have arrived and estimate the state at control period `step`.
    fn look(&self, watch: &mut Watch, step: u32, state: &Snapshot) {
        let now = EPISODE_START.after_seconds(CONTROL_PERIOD * f64::from(step));
        let newest = now.after_seconds(-self.settings.latency_s);
        while let Some(frame) = watch.waiting.pop_front_if(|frame| frame.time <= newest) {
            watch.estimator.see(&frame);
        }
        let carriages = [0, 1].map(|player| {
            let ([x, y], [vx, vy]) =
                (state.striker_positions[player], state.striker_velocities[player]);
            Some([x, y, vx, vy])
        });
        watch.seen = watch.estimator.look(now, carriages);
        watch.ball = watch.seen.ball.unwrap_or(watch.ball);
    }
}

/// Positions of ball, left and right striker.
fn positions(state: &Snapshot) -> [[f64; 2]; 3] {
    let [left, right] = state.striker_positions;
    [state.ball_position, left, right]
}

/// Random numbers of one frame: SplitMix64 (Steele, Lea and Flood 2014), keyed by their use, so
/// that they have no state.
struct Draws(u64);

impl Draws {
    fn of(key: u64, numbers: [u64; 3]) -> Self {
        Self(numbers.into_iter().fold(key, |key, number| splitmix64(key ^ splitmix64(number))))
    }

    /// A number from 0 to below 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(SPLITMIX64_INCREMENT);
        (splitmix64(self.0) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Two independent standard normal numbers (Box-Muller).
    fn normal_pair(&mut self) -> [f64; 2] {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (sine, cosine) = (TAU * self.uniform()).sin_cos();
        [radius * cosine, radius * sine]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game::{GameSettings, Outcomes};

    const BOARDS: usize = 6;

    fn settings() -> SensorSettings {
        let filter = FilterSettings { latency_s: 0.02, ..FilterSettings::default() };
        SensorSettings { lost_fraction: 0.1, ..SensorSettings::of(filter) }
    }

    fn begun(settings: &SensorSettings) -> (Games, Sensors) {
        let mut game = GameSettings::default();
        (game.episode.moving_fraction, game.episode.ball_speed) = (1.0, 0.3);
        let games = Games::new(BOARDS, &game, 4).unwrap();
        let sensors = Sensors::new(settings, &games, (0, 4));
        (games, sensors)
    }

    /// Step with equal commands for all; episodes go on.
    fn play(games: &mut Games, sensors: &mut Sensors, steps: usize) {
        let mut outcomes = Outcomes::new(BOARDS);
        for _ in 0..steps {
            games.advance(&[[[0.1, 0.05]; 2]; BOARDS], &mut outcomes).unwrap();
            sensors.advance(games);
            games.restart_ended(&outcomes).unwrap();
            for board in (0..BOARDS).filter(|board| outcomes.ended[*board].is_some()) {
                sensors.begin(board, games);
            }
        }
    }

    fn seen(sensors: &Sensors) -> Vec<Observation> {
        (0..BOARDS).map(|board| sensors.observation(board, Player::Left)).collect()
    }

    #[test]
    fn estimates_are_near_the_state_and_latency_and_noise_make_them_worse() {
        // Root mean square error of the ball's position in the first 0.2 s (m).
        let error = |settings: &SensorSettings| {
            let (mut games, mut sensors) = begun(settings);
            let mut sum = 0.0;
            for _ in 0..10 {
                play(&mut games, &mut sensors, 1);
                for board in 0..BOARDS {
                    let [x, y] = games.snapshot(board).ball_position;
                    let Observation(values) = sensors.observation(board, Player::Left);
                    let [dx, dy] = [f64::from(values[8]) - x, f64::from(values[9]) - y];
                    sum += dx * dx + dy * dy;
                }
            }
            (sum / (10 * BOARDS) as f64).sqrt()
        };
        let exact = error(&SensorSettings::of(FilterSettings::default()));
        let mut late = settings();
        late.latency_s = 0.06;
        late.filter.ball.measurement_sigma_m = 3e-3;
        println!("{exact} {}", error(&late));
        assert!(exact < 1.5e-3, "{exact}");
        assert!(1.5 * exact < error(&late), "{exact} {}", error(&late));
    }

    #[test]
    fn restored_sensors_go_on_as_the_saved_ones() {
        let (mut games, mut sensors) = begun(&settings());
        play(&mut games, &mut sensors, 130);
        let (saved_games, saved) = (games.save(), sensors.save());
        let (mut other_games, mut other) = begun(&settings());
        other_games.restore(&saved_games).unwrap();
        other.restore(&saved, &other_games).unwrap();
        assert_eq!(seen(&sensors), seen(&other));
        play(&mut games, &mut sensors, 150);
        play(&mut other_games, &mut other, 150);
        assert_eq!(seen(&sensors), seen(&other));
        assert!(sensors.save() == other.save());
        assert!(other.restore(b"[]", &other_games).is_err());
    }

    #[test]
    fn normal_numbers_have_their_moments() {
        let draws: Vec<f64> =
            (0..20_000u64).flat_map(|frame| Draws::of(7, [3, 1, frame]).normal_pair()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
    }
}
