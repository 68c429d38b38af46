//! Batches of games for reinforcement learning, stepped on several threads into arrays that Python shares.

use crate::{
    arrays::{Length, singles},
    error::{raised, refused},
};
use klasktron::{
    game::{
        Ending, GameError, GameSettings, Games, MOST_PREVIOUS_COMMANDS, ObservationKind,
        ObservationLayout, ObservedGames,
    },
    opponent::{Moment, Scripted},
    ppo::Scratch,
    recording::{Recording, topic::Player},
    train::{
        Curriculum, RewardSettings, Step, StoredPolicy, game_with_actuator, read_policy, sensors_of,
    },
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::{prelude::*, types::PyDict};
use std::{
    ops::Range,
    path::{Path, PathBuf},
    thread,
};

/// Fewest environments for which a further thread pays.
const LEAST_PER_THREAD: usize = 64;

/// Settings of a batch.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Settings {
    actuator: PathBuf,
    sensors: Option<PathBuf>,
    observations: String,
    action_history: usize,
    reward: String,
    opponents: [Option<String>; 2],
    time_limit_s: f64,
    threads: usize,
}

/// Settings that the blocks share.
struct Rules {
    game: GameSettings,
    layout: ObservationLayout,
    reward: RewardSettings,
    scripted: [Option<Scripted>; 2],
}

/// Environments of one thread.
struct Block {
    first: usize,
    observed: ObservedGames,
    commands: Vec<[[f32; 2]; 2]>,
}

/// Arrays of one player, shared with Python.
struct Arrays {
    /// `[environments][values]`, twice: results of even and of odd steps.
    observations: [Py<PyArray2<f32>>; 2],
    /// Observations at the end of an episode; other rows keep older values.
    last: Py<PyArray2<f32>>,
    /// Rewards of the step, `[environments]`.
    rewards: Py<PyArray1<f32>>,
}

/// Games that are stepped together.
#[pyclass(module = "klasktron._klasktron")]
pub(crate) struct GameBatch {
    rules: Rules,
    blocks: Vec<Block>,
    seed: u64,
    steps: u64,
    players: [Arrays; 2],
    /// 0 while the episode runs, 1 when it ends in this step.
    terminated: Py<PyArray1<bool>>,
    truncated: Py<PyArray1<bool>>,
    /// Result of left: 1 won, -1 lost, 0 no point.
    result: Py<PyArray1<i8>>,
}

/// Rows of one block in the arrays of one player.
struct Rows<'a> {
    observations: &'a mut [f32],
    last: &'a mut [f32],
    rewards: &'a mut [f32],
}

/// One block with its rows.
struct Task<'a> {
    block: &'a mut Block,
    players: [Rows<'a>; 2],
    terminated: &'a mut [bool],
    truncated: &'a mut [bool],
    result: &'a mut [i8],
}

#[pymethods]
impl GameBatch {
    #[new]
    fn new(py: Python<'_>, count: usize, seed: u64, settings: Settings) -> PyResult<Self> {
        let rules = Rules::of(&settings)?;
        let width = rules.layout.len();
        let matrix = || PyArray2::<f32>::zeros(py, (count, width), false).unbind();
        let arrays = || Arrays {
            observations: [matrix(), matrix()],
            last: matrix(),
            rewards: PyArray1::zeros(py, count, false).unbind(),
        };
        if count == 0 {
            return Err(refused("num_envs is 0; allowed are 1 and more".to_owned()));
        }
        let threads = settings.threads.clamp(1, count.div_ceil(LEAST_PER_THREAD));
        let each = count.div_ceil(threads);
        let ranges = (0..count).step_by(each).map(|first| first..(first + each).min(count));
        let blocks: Result<Vec<Block>, GameError> =
            ranges.map(|range| Block::new(range, &rules, seed)).collect();
        let batch = Self {
            blocks: blocks.map_err(raised)?,
            seed,
            steps: 0,
            players: [arrays(), arrays()],
            terminated: PyArray1::zeros(py, count, false).unbind(),
            truncated: PyArray1::zeros(py, count, false).unbind(),
            result: PyArray1::zeros(py, count, false).unbind(),
            rules,
        };
        Ok(batch)
    }

    /// Arrays that steps write to, for `player` 0 (left) or 1 (right).
    fn arrays<'py>(&self, py: Python<'py>, player: usize) -> PyResult<Bound<'py, PyDict>> {
        let own = &self.players[player];
        let arrays = PyDict::new(py);
        arrays.set_item("observations", (&own.observations[0], &own.observations[1]))?;
        arrays.set_item("last", &own.last)?;
        arrays.set_item("rewards", &own.rewards)?;
        arrays.set_item("terminated", &self.terminated)?;
        arrays.set_item("truncated", &self.truncated)?;
        arrays.set_item("result", &self.result)?;
        Ok(arrays)
    }

    /// Number of values of an observation.
    #[getter]
    fn width(&self) -> usize {
        self.rules.layout.len()
    }

    /// Speed of a full action (m/s).
    #[getter]
    fn speed_m_per_s(&self) -> f64 {
        self.rules.game.limits.speed
    }

    /// Begin all environments anew with `seed`.
    fn reset(&mut self, py: Python<'_>, seed: u64) -> PyResult<()> {
        self.seed = seed;
        self.steps = 0;
        for block in &mut self.blocks {
            let range = block.first..block.first + block.commands.len();
            *block = Block::new(range, &self.rules, self.seed).map_err(raised)?;
        }
        let observations: Vec<_> =
            self.players.iter().map(|own| own.observations[0].bind(py).readwrite()).collect();
        let width = self.rules.layout.len();
        for (player, mut rows) in observations.into_iter().enumerate() {
            let rows = rows.as_slice_mut()?;
            for block in &self.blocks {
                let own = block.first * width..(block.first + block.commands.len()) * width;
                block.observe(player, self.rules.layout, &mut rows[own]);
            }
        }
        Ok(())
    }

    /// Step all environments with the actions of left and right, `[environments][2]` from -1 to 1; `None` for a
    /// scripted player. Returns the index of the observations that were written.
    fn step(
        &mut self,
        py: Python<'_>,
        left: Option<&Bound<'_, PyAny>>,
        right: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let count: usize = self.blocks.iter().map(|block| block.commands.len()).sum();
        let shape = [Length::Exactly(count), Length::Exactly(2)];
        let given = [
            left.map(|own| singles(own, "actions", &shape)).transpose()?,
            right.map(|own| singles(own, "actions", &shape)).transpose()?,
        ];
        for (player, own) in Player::BOTH.iter().zip(&given) {
            if own.is_none() && self.rules.scripted[*player as usize].is_none() {
                return Err(refused(format!("no actions of {player:?}, which is not scripted")));
            }
        }
        let [left_actions, right_actions] = &given;
        let actions: [Option<&[f32]>; 2] = [
            left_actions.as_ref().map(|own| own.as_slice()).transpose()?,
            right_actions.as_ref().map(|own| own.as_slice()).transpose()?,
        ];
        self.steps += 1;
        let buffer = (self.steps % 2) as usize;
        let width = self.rules.layout.len();
        let borrow = |own: &Arrays| {
            (
                own.observations[buffer].bind(py).readwrite(),
                own.last.bind(py).readwrite(),
                own.rewards.bind(py).readwrite(),
            )
        };
        let [mut left, mut right] = [borrow(&self.players[0]), borrow(&self.players[1])];
        let mut terminated = self.terminated.bind(py).readwrite();
        let mut truncated = self.truncated.bind(py).readwrite();
        let mut result = self.result.bind(py).readwrite();
        let mut rest = (
            (left.0.as_slice_mut()?, left.1.as_slice_mut()?, left.2.as_slice_mut()?),
            (right.0.as_slice_mut()?, right.1.as_slice_mut()?, right.2.as_slice_mut()?),
            (terminated.as_slice_mut()?, truncated.as_slice_mut()?, result.as_slice_mut()?),
        );
        let mut tasks = Vec::with_capacity(self.blocks.len());
        for block in &mut self.blocks {
            let (boards, values) = (block.commands.len(), block.commands.len() * width);
            let (l, r, flags) = &mut rest;
            let rows = |own: &mut (_, _, _)| Rows {
                observations: cut(&mut own.0, values),
                last: cut(&mut own.1, values),
                rewards: cut(&mut own.2, boards),
            };
            tasks.push(Task {
                block,
                players: [rows(l), rows(r)],
                terminated: cut(&mut flags.0, boards),
                truncated: cut(&mut flags.1, boards),
                result: cut(&mut flags.2, boards),
            });
        }
        let (rules, now) = (&self.rules, (self.seed, self.steps));
        py.detach(|| step_all(tasks, rules, &actions, now)).map_err(raised)?;
        Ok(buffer)
    }
}

/// Take `count` values from the front of `rest`.
fn cut<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (own, others) = std::mem::take(rest).split_at_mut(count);
    *rest = others;
    own
}

/// Step every block, the first on this thread and the others on threads of their own.
fn step_all(
    tasks: Vec<Task<'_>>,
    rules: &Rules,
    actions: &[Option<&[f32]>; 2],
    now: (u64, u64),
) -> Result<(), GameError> {
    thread::scope(|scope| {
        let mut tasks = tasks.into_iter();
        let own = tasks.next();
        let others: Vec<_> =
            tasks.map(|task| scope.spawn(move || task.step(rules, actions, now))).collect();
        let mut outcome = own.map_or(Ok(()), |task| task.step(rules, actions, now));
        for other in others {
            let stepped = other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            outcome = outcome.and(stepped);
        }
        outcome
    })
}

impl Task<'_> {
    fn step(
        mut self,
        rules: &Rules,
        actions: &[Option<&[f32]>; 2],
        (seed, step): (u64, u64),
    ) -> Result<(), GameError> {
        let block = &mut *self.block;
        for player in [0, 1] {
            block.decide(player, (rules, actions[player]), (seed, step));
        }
        block.observed.advance(&mut block.commands)?;
        for (player, rows) in self.players.iter_mut().enumerate() {
            block.reward(player, &rules.reward, rows.rewards);
        }
        let width = rules.layout.len();
        for (board, ended) in block.observed.outcomes().ended.iter().enumerate() {
            self.truncated[board] = *ended == Some(Ending::TimeLimit);
            self.terminated[board] = ended.is_some() && !self.truncated[board];
            self.result[board] = match ended.and_then(Ending::winner) {
                None => 0,
                Some(Player::Left) => 1,
                Some(Player::Right) => -1,
            };
            if ended.is_some() {
                for (player, rows) in self.players.iter_mut().enumerate() {
                    let own = &mut rows.last[board * width..(board + 1) * width];
                    block.observed.observe(board, Player::BOTH[player], rules.layout, own);
                }
            }
        }
        block.observed.begin_ended()?;
        for (player, rows) in self.players.iter_mut().enumerate() {
            block.observe(player, rules.layout, rows.observations);
        }
        Ok(())
    }
}

impl Block {
    fn new(range: Range<usize>, rules: &Rules, seed: u64) -> Result<Self, GameError> {
        let (first, count) = (range.start, range.len());
        let observed = ObservedGames::new(Games::range(range, &rules.game, seed)?);
        Ok(Self { first, observed, commands: vec![[[0.0; 2]; 2]; count] })
    }

    /// Commands of `player` from its actions, or from its script.
    fn decide(
        &mut self,
        player: usize,
        (rules, actions): (&Rules, Option<&[f32]>),
        (seed, step): (u64, u64),
    ) {
        let speed = rules.game.limits.speed as f32;
        if let Some(actions) = actions {
            let own = &actions[2 * self.first..2 * (self.first + self.commands.len())];
            for (command, action) in self.commands.iter_mut().zip(own.chunks_exact(2)) {
                command[player] = [action[0], action[1]].map(|own| speed * own.clamp(-1.0, 1.0));
            }
            return;
        }
        let Some(script) = rules.scripted[player] else { return };
        for board in 0..self.commands.len() {
            let seen = self.observed.observation(board, Player::BOTH[player]).0;
            let moment = Moment { seed, board: (self.first + board) as u64, step };
            self.commands[board][player] = script.velocity(&seen, moment, speed);
        }
    }

    fn reward(&self, player: usize, settings: &RewardSettings, rewards: &mut [f32]) {
        let outcomes = self.observed.outcomes();
        for (board, reward) in rewards.iter_mut().enumerate() {
            let step = Step {
                seen: &self.observed.games().observation(board, Player::BOTH[player]).0,
                ended: outcomes.ended[board],
                player: Player::BOTH[player],
                hit_speed: outcomes.hit_speeds[board][player],
                potential: (0.0, 1.0),
            };
            *reward = settings.of_step(&step, 1.0);
        }
    }

    fn observe(&self, player: usize, layout: ObservationLayout, rows: &mut [f32]) {
        for (board, row) in rows.chunks_exact_mut(layout.len()).enumerate() {
            self.observed.observe(board, Player::BOTH[player], layout, row);
        }
    }
}

impl Rules {
    fn of(settings: &Settings) -> PyResult<Self> {
        let (mut game, _) = game_with_actuator(&settings.actuator).map_err(raised)?;
        if let Some(path) = &settings.sensors {
            game.sensors = sensors_of(Some(path), &settings.actuator).map_err(raised)?;
        }
        game.episode.time_limit = settings.time_limit_s;
        game.check().map_err(raised)?;
        let [left, right] = &settings.opponents;
        let script = |name: &Option<String>| name.as_deref().map(script_of).transpose();
        Ok(Self {
            game,
            layout: layout_of(settings)?,
            reward: RewardSettings::of(curriculum_of(&settings.reward)?),
            scripted: [script(left)?, script(right)?],
        })
    }
}

fn script_of(name: &str) -> PyResult<Scripted> {
    let known = Scripted::ALL.map(Scripted::name).join(", ");
    let found = Scripted::ALL.into_iter().find(|own| own.name() == name);
    found
        .ok_or_else(|| refused(format!("no scripted player is called '{name}'; known are {known}")))
}

fn layout_of(settings: &Settings) -> PyResult<ObservationLayout> {
    let (state, commands) = (kind_of(&settings.observations)?, settings.action_history);
    if MOST_PREVIOUS_COMMANDS < commands {
        return Err(refused(format!(
            "action_history is {commands}; allowed are 0 to {MOST_PREVIOUS_COMMANDS}"
        )));
    }
    Ok(ObservationLayout { state, commands })
}

fn kind_of(name: &str) -> PyResult<ObservationKind> {
    let known = ObservationKind::ALL.map(ObservationKind::name).join(", ");
    let found = ObservationKind::ALL.into_iter().find(|own| own.name() == name);
    found.ok_or_else(|| refused(format!("observations are '{name}'; known are {known}")))
}

fn curriculum_of(name: &str) -> PyResult<Curriculum> {
    match name {
        "dense_ball_to_goal" => Ok(Curriculum::DenseBallToGoal),
        "collision_only" => Ok(Curriculum::CollisionOnly),
        "sparse" => Ok(Curriculum::Sparse),
        "motion" => Ok(Curriculum::Motion),
        other => Err(refused(format!(
            "reward is '{other}'; known are dense_ball_to_goal, collision_only, sparse, motion"
        ))),
    }
}

/// A trained policy, as a player: observations to mean actions.
#[pyclass(module = "klasktron", frozen)]
pub(crate) struct Policy {
    stored: StoredPolicy,
}

#[pymethods]
impl Policy {
    /// Read a `policy.mcap` of `klasktron train`.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let recording = Recording::open(Path::new(&path)).map_err(raised)?;
        Ok(Self { stored: read_policy(&recording).map_err(raised)? })
    }

    /// Number of observed values that it takes.
    #[getter]
    fn observation_size(&self) -> usize {
        self.stored.observations.len()
    }

    /// Its set of state values, as `observations` of the environments.
    #[getter]
    fn observations(&self) -> &'static str {
        self.stored.observations.state.name()
    }

    /// Number of its own previous commands that it observes after them.
    #[getter]
    fn action_history(&self) -> usize {
        self.stored.observations.commands
    }

    /// Mean actions of observations `[rows][values]`: `[rows][2]`, single precision, from -1 to 1.
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        observations: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let width = self.stored.observations.len();
        let shape = [Length::Any("n"), Length::Exactly(width)];
        let rows = singles(observations, "observations", &shape)?;
        let rows = rows.as_slice()?;
        let mut actions = vec![[0.0_f32; 2]; rows.len() / width];
        py.detach(|| {
            let mut scratch = Scratch::default();
            self.stored.policy.act_mean(rows, actions.as_flattened_mut(), &mut scratch);
        });
        actions.iter_mut().flatten().for_each(|own| *own = own.clamp(-1.0, 1.0));
        crate::arrays::rows(py, &actions)
    }
}
