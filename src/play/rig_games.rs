//! Virtual rigs as environments of training: the upper bound for every simulation of the rig.
//!
//! Each environment is a session as in a match, with referencing, arming and guards, on a thread of
//! its own. Its pilot asks the training for the commands of both players, and waits for them. What
//! the players see comes from the camera and the estimator; rewards and results come from the true
//! state of the rig.
//!
//! | event on the rig | end of the episode |
//! |---|---|
//! | ball in a cup | goal; the next episode begins when the returned ball is seen |
//! | striker over its own cup | own goal; the players go on |
//! | ball at rest, returned | time limit |
//! | time limit of the game | time limit; the players go on |
//! | a guard ends the session | time limit; a new session begins |
//!
//! Results do not depend on threads. A rig cannot be saved, so a resumed training begins new
//! episodes.

use super::{
    PlayError, label,
    pilot::{HOLD_GAIN_PER_S, check_speed_of},
    table_state::TableState,
};
use crate::{
    collect::{
        Decision, FreeStretch, HomingPolicy, Moment, Pilot, RawFrames, SessionConfig,
        SessionOutput, WatchdogPolicy, Work, run_session,
    },
    ekf::{Detections, FilterSettings},
    game::{
        ActuatorQueries, CONTROL_PERIOD, ClockFn, Ending, GameError, GameSettings, Observation,
        ObservationLayout, ObservedState, Outcomes, PreviousCommands, StepTimes, turned,
    },
    gantry::Robot,
    link::{Capabilities, Event, Link, LinkError},
    recording::{message::CameraDetections, topic::Player},
    rig::{Body, Hits, RigConfig, Speed, Truth, VIRTUAL_START, VirtualLink},
    seed::Stream,
    train::{EnvironmentSource, Environments, seat},
    units::Nanos,
};
use std::{
    cell::RefCell,
    collections::BTreeMap,
    ops::Range,
    rc::Rc,
    sync::{
        Arc,
        atomic::AtomicUsize,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread,
};

/// Length of a session (s): longer than any training.
const SESSION_SECONDS: f64 = 1e9;
/// Stack of the thread of one environment (bytes).
const STACK_BYTES: usize = 1 << 20;

/// Commands of left and right player (m/s, own frame).
type Commands = [[f32; 2]; 2];

/// A rig to train on.
#[derive(Debug, Clone)]
pub struct TrainingRig {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    rig: RigConfig,
    robot: Robot,
    filter: FilterSettings,
    game: GameSettings,
    seed: u64,
}

/// One control period of an environment.
#[derive(Debug, Clone, Copy)]
struct Scene {
    /// Observations of left and right player, by the estimator.
    seen: [Observation; 2],
    /// Exact observations.
    exact: [Observation; 2],
    previous: [PreviousCommands; 2],
    ended: Option<Ending>,
    hits: [u8; 2],
    hit_speeds: [f32; 2],
}

/// The trainer's end of an environment.
#[derive(Debug)]
struct Table {
    commands: SyncSender<Commands>,
    scenes: Receiver<Result<Scene, String>>,
}

/// Virtual rigs that are stepped together.
#[derive(Debug)]
pub struct RigGames {
    first: usize,
    tables: Vec<Table>,
    scenes: Vec<Scene>,
    outcomes: Outcomes,
    cup_distance: f32,
    clock: ClockFn,
    /// Time in which the rigs were stepped (s).
    spent_s: f64,
}

impl TrainingRig {
    /// Rigs like `rig`, each with a seed of its own, driven as `robot`. `game` has the limits of
    /// commands and the time limit of episodes. The ball starts as in the rig's file, turned by
    /// 180 degrees where the learner plays on the right.
    ///
    /// # Errors
    /// When the rig never returns the ball, or the robot is slower than the commands.
    pub fn new(
        rig: RigConfig,
        robot: Robot,
        filter: FilterSettings,
        game: GameSettings,
        seed: u64,
    ) -> Result<Self, PlayError> {
        if rig.ball.start.is_none() {
            return Err(PlayError::NoServe);
        }
        for (name, wait_s) in [
            ("put_back_after_s", rig.ball.put_back_after_s),
            ("put_back_still_after_s", rig.ball.put_back_still_after_s),
        ] {
            if wait_s <= 0.0 {
                return Err(PlayError::BallNotReturned { name });
            }
        }
        check_speed_of("the training", game.limits.speed, &robot)?;
        Ok(Self { shared: Arc::new(Shared { rig, robot, filter, game, seed }) })
    }
}

impl EnvironmentSource for TrainingRig {
    fn build(
        &self,
        range: Range<usize>,
        clock: ClockFn,
    ) -> Result<Box<dyn Environments>, GameError> {
        Ok(Box::new(RigGames::new(&self.shared, range, clock)?))
    }
}

impl RigGames {
    fn new(shared: &Arc<Shared>, range: Range<usize>, clock: ClockFn) -> Result<Self, GameError> {
        let first = range.start;
        let tables = range.map(|number| Table::open(shared, number));
        let tables = tables.collect::<Result<Vec<_>, _>>()?;
        let mut games = Self {
            first,
            outcomes: Outcomes::new(tables.len()),
            scenes: Vec::with_capacity(tables.len()),
            cup_distance: shared.game.cup.distance as f32,
            clock,
            spent_s: 0.0,
            tables,
        };
        for board in 0..games.tables.len() {
            let scene = games.next_scene(board)?;
            games.scenes.push(scene);
        }
        Ok(games)
    }

    fn next_scene(&self, board: usize) -> Result<Scene, GameError> {
        let failed = |reason| GameError::Rig { environment: self.first + board, reason };
        match self.tables[board].scenes.recv() {
            Ok(scene) => scene.map_err(failed),
            Err(_gone) => Err(failed("its thread has ended".to_owned())),
        }
    }
}

impl Environments for RigGames {
    fn advance(&mut self, commands: &mut [Commands]) -> Result<(), GameError> {
        let begun = (self.clock)();
        for (table, commands) in self.tables.iter().zip(commands) {
            // A thread that has ended has sent the reason.
            let _gone = table.commands.send(*commands);
        }
        for board in 0..self.tables.len() {
            let scene = self.next_scene(board)?;
            self.outcomes.ended[board] = scene.ended;
            self.outcomes.hits[board] = scene.hits;
            self.outcomes.hit_speeds[board] = scene.hit_speeds;
            self.scenes[board] = scene;
        }
        self.spent_s += (self.clock)() - begun;
        Ok(())
    }

    fn begin_ended(&mut self) -> Result<(), GameError> {
        let begun = (self.clock)();
        for board in 0..self.tables.len() {
            if self.outcomes.ended[board].is_some() {
                self.scenes[board] = self.next_scene(board)?;
            }
        }
        self.spent_s += (self.clock)() - begun;
        Ok(())
    }

    fn outcomes(&self) -> &Outcomes {
        &self.outcomes
    }

    fn observe(&self, board: usize, player: Player, layout: ObservationLayout, row: &mut [f32]) {
        let Scene { seen, previous, .. } = &self.scenes[board];
        let index = player as usize;
        layout.write(&seen[index], &previous[index], self.cup_distance, row);
    }

    fn exact(&self, board: usize, player: Player) -> Observation {
        self.scenes[board].exact[player as usize]
    }

    fn save(&self) -> Option<ObservedState> {
        None
    }

    fn restore(&mut self, _saved: &ObservedState) -> Result<(), GameError> {
        let reason = "a rig cannot be restored".to_owned();
        Err(GameError::Rig { environment: self.first, reason })
    }

    fn queries(&self) -> ActuatorQueries {
        ActuatorQueries::default()
    }

    fn spent(&self) -> StepTimes {
        StepTimes { actuators: 0.0, physics: self.spent_s }
    }
}

impl Table {
    fn open(shared: &Arc<Shared>, number: usize) -> Result<Self, GameError> {
        let (to_rig, commands) = sync_channel(1);
        let (scenes, from_rig) = sync_channel(1);
        let shared = Arc::clone(shared);
        let run = move || shared.play(number, &Trainer { commands, scenes });
        let spawned =
            thread::Builder::new().name(format!("rig {number}")).stack_size(STACK_BYTES).spawn(run);
        match spawned {
            Ok(_detached) => Ok(Self { commands: to_rig, scenes: from_rig }),
            Err(error) => Err(GameError::Rig { environment: number, reason: error.to_string() }),
        }
    }
}

impl Shared {
    /// Play on one rig, session after session, until the trainer has gone.
    fn play(&self, number: usize, trainer: &Trainer) {
        let mut seeds = Stream::new(self.seed, &format!("train.rig.{number}"));
        loop {
            let rig = self.rig_of(number, seeds.below(1 << 62) as u64);
            let link = match VirtualLink::new(rig, Speed::Maximum, VIRTUAL_START) {
                Ok(link) => Rc::new(RefCell::new(link)),
                Err(error) => return trainer.fail(error.to_string()),
            };
            let mut pilot = Trainee::new(self, trainer, Rc::clone(&link));
            let ended = self.run_session(&mut SharedLink(link), &mut pilot);
            match (pilot.phase, pilot.decisions) {
                (Phase::Left, _) => return,
                (_, 0) => return trainer.fail(ended),
                (Phase::Between, _) => {}
                (Phase::Playing, _) => {
                    log::debug!("rig {number}: {ended}; a new session begins");
                    let last = Scene { ended: Some(Ending::TimeLimit), ..pilot.last };
                    if trainer.scenes.send(Ok(last)).is_err() {
                        return;
                    }
                }
            }
        }
    }

    /// The rig of the environment `number`.
    fn rig_of(&self, number: usize, seed: u64) -> RigConfig {
        let mut rig = RigConfig { seed, ..self.rig.clone() };
        if let Some(start) = &mut rig.ball.start {
            let turn = |pair| turned(seat(number), pair);
            [start.x_m, start.y_m] = turn([start.x_m, start.y_m]);
            [start.vx_m_per_s, start.vy_m_per_s] = turn([start.vx_m_per_s, start.vy_m_per_s]);
        }
        rig
    }

    /// Run one session; return why it ended.
    fn run_session(&self, link: &mut SharedLink, pilot: &mut Trainee<'_>) -> String {
        let config = session_config();
        let presses = AtomicUsize::new(0);
        let output = SessionOutput { writer: None, presses: &presses, show: &mut |_progress| {} };
        let stretch = FreeStretch { pilot, seconds: SESSION_SECONDS, label: label() };
        match run_session(link, &self.robot, &config, Work::Free(stretch), output) {
            Ok(report) => report.stop_text,
            Err(error) => error.to_string(),
        }
    }
}

/// Configuration of a session that nobody records.
fn session_config() -> SessionConfig {
    SessionConfig {
        players: Player::BOTH.to_vec(),
        rate_hz: CONTROL_PERIOD.recip(),
        homing: HomingPolicy::Camera,
        watchdog: WatchdogPolicy::Trust,
        raw: RawFrames::Omit,
        accepted_firmware: Vec::new(),
        hold_gain_per_s: HOLD_GAIN_PER_S,
        scene: None,
        metadata: BTreeMap::new(),
    }
}

/// The environment's end.
struct Trainer {
    commands: Receiver<Commands>,
    scenes: SyncSender<Result<Scene, String>>,
}

impl Trainer {
    fn fail(&self, reason: String) {
        // Without a trainer nobody needs the reason.
        let _gone = self.scenes.send(Err(reason));
    }
}

/// The rig, shared by the session and by its pilot, which reads the true state between two events.
struct SharedLink(Rc<RefCell<VirtualLink>>);

impl Link for SharedLink {
    fn now(&self) -> Nanos {
        self.0.borrow().now()
    }

    fn send(&mut self, frame: &crate::can::Frame) -> Result<(), LinkError> {
        self.0.borrow_mut().send(frame)
    }

    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError> {
        self.0.borrow_mut().next_event(until)
    }

    fn capabilities(&self) -> Capabilities {
        self.0.borrow().capabilities()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The trainer waits for the result of its commands.
    Playing,
    /// The trainer waits for the first scene of an episode.
    Between,
    /// The trainer has gone.
    Left,
}

/// Counters of the rig at the last decision.
#[derive(Debug, Clone, Copy)]
struct Counted {
    goals: [u32; 2],
    serves: u32,
    hits: [Hits; 2],
    /// Strikers over their own cups.
    over_cup: [bool; 2],
}

/// Pilot of an environment.
struct Trainee<'a> {
    shared: &'a Shared,
    trainer: &'a Trainer,
    link: Rc<RefCell<VirtualLink>>,
    table: TableState,
    phase: Phase,
    /// Number of decisions of the trainer in this session.
    decisions: u64,
    /// Length of the current episode (control periods).
    steps: u32,
    counted: Option<Counted>,
    /// Number of serves after which the next episode begins.
    serves_at_begin: u32,
    /// Last estimate of a ball in play.
    ball: [f64; 4],
    last: Scene,
}

impl<'a> Trainee<'a> {
    fn new(shared: &'a Shared, trainer: &'a Trainer, link: Rc<RefCell<VirtualLink>>) -> Self {
        let nothing = Observation([0.0; 12]);
        Self {
            table: TableState::new(&shared.robot, &shared.filter),
            shared,
            trainer,
            link,
            phase: Phase::Between,
            decisions: 0,
            steps: 0,
            counted: None,
            serves_at_begin: 0,
            ball: [0.0; 4],
            last: Scene {
                seen: [nothing; 2],
                exact: [nothing; 2],
                previous: [PreviousCommands::default(); 2],
                ended: None,
                hits: [0; 2],
                hit_speeds: [0.0; 2],
            },
        }
    }

    /// The present scene, with the impacts since the last decision.
    fn scene(&self, strikers: &[[f64; 4]; 2], truth: &Truth, before: &Counted) -> Scene {
        let state = |body: Body| [body.x, body.y, body.vx, body.vy];
        let true_strikers = [truth.left.peg, truth.right.peg].map(state);
        let true_ball = truth.ball.map_or(self.ball, state);
        let new_hits =
            [0, 1].map(|index| truth.hits[index].count.saturating_sub(before.hits[index].count));
        Scene {
            seen: Player::BOTH.map(|player| Observation::of_board(player, strikers, self.ball)),
            exact: Player::BOTH
                .map(|player| Observation::of_board(player, &true_strikers, true_ball)),
            previous: self.table.previous,
            ended: None,
            hits: new_hits.map(|count| u8::try_from(count).unwrap_or(u8::MAX)),
            hit_speeds: [0, 1].map(|index| match new_hits[index] {
                0 => 0.0,
                _ => truth.hits[index].newest_m_per_s as f32,
            }),
        }
    }

    /// Strikers over their own cups.
    fn over_cup(&self, truth: &Truth) -> [bool; 2] {
        let cup = &self.shared.game.cup;
        Player::BOTH.map(|player| {
            let peg = truth.player(player).peg;
            let [x, y] = turned(player, [peg.x, peg.y]);
            x.hypot(y + cup.distance) < cup.radius
        })
    }

    /// End of the episode since the last decision.
    fn ending(&self, now: &Counted, before: &Counted) -> Option<Ending> {
        let rose = |index: usize| before.goals[index] < now.goals[index];
        let entered = |index: usize| now.over_cup[index] && !before.over_cup[index];
        if rose(0) {
            Some(Ending::Goal { scorer: Player::Right })
        } else if rose(1) {
            Some(Ending::Goal { scorer: Player::Left })
        } else if entered(0) {
            Some(Ending::OwnGoal { loser: Player::Left })
        } else if entered(1) {
            Some(Ending::OwnGoal { loser: Player::Right })
        } else if before.serves < now.serves {
            let [.., y, _, _] = self.last.exact[Player::Left as usize].0;
            Some(Ending::at_rest(f64::from(y)))
        } else if self.shared.game.most_steps() <= self.steps {
            Some(Ending::TimeLimit)
        } else {
            None
        }
    }

    /// Hand a scene to the trainer.
    fn show(&mut self, scene: Scene) {
        self.last = scene;
        if self.trainer.scenes.send(Ok(scene)).is_err() {
            self.phase = Phase::Left;
        }
    }

    /// Report the result of the last commands.
    fn report(&mut self, scene: Scene, now: &Counted, before: &Counted) {
        self.steps += 1;
        let ended = self.ending(now, before);
        self.show(Scene { ended, ..scene });
        if ended.is_some() && self.phase == Phase::Playing {
            self.phase = Phase::Between;
            let waits_for_ball = matches!(ended, Some(Ending::Goal { .. }));
            self.serves_at_begin = now.serves + u32::from(waits_for_ball);
        }
    }

    /// Commands of the trainer (m/s, board frame); zero while nobody plays.
    fn commands(&mut self) -> [[f64; 2]; 2] {
        if self.phase != Phase::Playing {
            return [[0.0; 2]; 2];
        }
        self.decisions += 1;
        match self.trainer.commands.recv() {
            Ok(commands) => {
                Player::BOTH.map(|player| turned(player, commands[player as usize].map(f64::from)))
            }
            Err(_gone) => {
                self.phase = Phase::Left;
                [[0.0; 2]; 2]
            }
        }
    }
}

impl Pilot for Trainee<'_> {
    fn see(&mut self, shown: Nanos, picture: &CameraDetections) {
        self.table.see(&Detections::of(shown, picture));
    }

    fn decide(&mut self, moment: &Moment) -> Decision {
        let seen = self.table.look(moment);
        self.ball = seen.ball.unwrap_or(self.ball);
        let truth = self.link.borrow().truth();
        let Truth { goals, serves, hits, .. } = truth;
        let now = Counted { goals, serves, hits, over_cup: self.over_cup(&truth) };
        let before = self.counted.replace(now).unwrap_or(now);
        let scene = self.scene(&seen.strikers, &truth, &before);
        if self.phase == Phase::Playing {
            self.report(scene, &now, &before);
        }
        if self.phase == Phase::Between && seen.ball.is_some() && self.serves_at_begin <= serves {
            (self.phase, self.steps) = (Phase::Playing, 0);
            self.show(scene);
        }
        let wanted = self.commands();
        let wanted = if seen.ball.is_some() { wanted } else { [[0.0; 2]; 2] };
        Decision {
            velocities: self.table.limited(moment, wanted),
            stop: self.table.without_ball(&seen, moment.now),
            complete: self.phase == Phase::Left,
            ..Decision::default()
        }
    }
}

#[cfg(test)]
mod tests;
