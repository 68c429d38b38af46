"""The batched game for reinforcement learning: Gymnasium and PettingZoo.

| class | interface | players |
|---|---|---|
| `KlaskVectorEnv` | `gymnasium.vector.VectorEnv` | one learner in each of many games, against `opponent` |
| `KlaskEnv` | `gymnasium.Env` | the same in one game |
| `KlaskParallelEnv` | `pettingzoo.ParallelEnv` | both players of one game |

All three share the game of `klasktron train`: one control period (20 ms) per step, an actuator model, and, with
`sensors`, a camera with its latency, noise and lost frames behind the state estimator.

Observations are single precision, in the player's own frame (m, m/s, rad): own striker, other striker and ball, each
position and velocity (`standard12`), then angles and distances (`augmented20`), then the geometry of a shot
(`aiming29`), then the command of the scripted shooter (`shooting31`). Actions are velocities of the striker, `[2]`
from -1 to 1 of 0.4 m/s along x and y of the own frame.

Episodes end with a goal, an own goal or a ball at rest (terminated), or at the time limit (truncated). A vector
environment begins the next episode in the same step (`AutoresetMode.SAME_STEP`): the last observation is in
`infos["final_obs"]`.

Gymnasium knows the first two as `klasktron/Klask-v0` after `import klasktron.envs`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from . import _klasktron

__all__ = ["KlaskEnv", "KlaskParallelEnv", "KlaskVectorEnv"]

StrPath = str | os.PathLike[str]
# Observations [n][values] to actions [n][2].
Player = Callable[[NDArray[np.float32]], ArrayLike]

SIDES = ("left", "right")
CONTROL_PERIOD_S = 0.02
TIME_LIMIT_S = 10.0


def _settings(
    actuator: StrPath,
    sensors: StrPath | None,
    observations: str,
    action_history: int,
    reward: str,
    time_limit_s: float,
    threads: int | None,
) -> dict[str, Any]:
    return {
        "actuator": actuator,
        "sensors": sensors,
        "observations": observations,
        "action_history": action_history,
        "reward": reward,
        "time_limit_s": time_limit_s,
        "threads": threads or os.cpu_count() or 1,
    }


def _drawn(generator: np.random.Generator) -> int:
    return int(generator.integers(1 << 62))


def _spaces(batch: _klasktron.GameBatch) -> tuple[spaces.Box, spaces.Box]:
    """Spaces of one player's observation and action."""
    return (
        spaces.Box(-np.inf, np.inf, (batch.width,), np.float32),
        spaces.Box(-1.0, 1.0, (2,), np.float32),
    )


class KlaskVectorEnv(VectorEnv):
    """Many games, with one learner in each.

    Args:
        num_envs: Number of games.
        actuator: `"ideal"`, a `twin.json` of `gap` or `calibrate`, or an `actuator.mcap` of `fit-actuator`.
        sensors: An `ekf.json` of `tune-ekf` for camera and state estimator; exact observations by default.
        observations: `"standard12"`, `"augmented20"`, `"aiming29"` or `"shooting31"`.
        action_history: Number of previous commands of the own striker (m/s) after these values, newest first, 0 to 8.
        opponent: `"stationary"`, `"random"`, `"goalkeeper"`, `"chaser"`, `"shooter"`, or a function from
            observations `[num_envs][values]` to actions `[num_envs][2]`, such as a `klasktron.Policy` or the learner itself.
        player: Side of the learner, `"left"` or `"right"`.
        reward: `"sparse"` (1 for a goal, -1 against), or with shaping that does not decay: `"dense_ball_to_goal"`,
            `"collision_only"`, `"motion"`.
        time_limit_s: Longest episode (s).
        threads: Threads of a step; one per core by default. The games do not depend on it.
        copy: Whether a step returns new arrays. Without, observations are views of two buffers in turn: those of a step
            are overwritten by the second step after it; rewards and flags by the next one.

    Raises:
        KlasktronError: If a file or a setting is wrong.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        *,
        actuator: StrPath = "ideal",
        sensors: StrPath | None = None,
        observations: str = "standard12",
        action_history: int = 0,
        opponent: str | Player = "goalkeeper",
        player: str = "left",
        reward: str = "dense_ball_to_goal",
        time_limit_s: float = TIME_LIMIT_S,
        threads: int | None = None,
        copy: bool = True,
        render_mode: None = None,
    ) -> None:
        if player not in SIDES:
            raise _klasktron.KlasktronError(f"player is '{player}'; known are 'left' and 'right'")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.copy = copy
        self.opponent = None if isinstance(opponent, str) else opponent
        self._side = SIDES.index(player)
        scripted: list[str | None] = [None, None]
        scripted[1 - self._side] = opponent if isinstance(opponent, str) else None
        settings = _settings(actuator, sensors, observations, action_history, reward, time_limit_s, threads)
        self._batch = _klasktron.GameBatch(num_envs, 0, {**settings, "opponents": scripted})
        self._own = self._batch.arrays(self._side)
        self._other = self._batch.arrays(1 - self._side)
        self._buffer = 0
        self.single_observation_space, self.single_action_space = _spaces(self._batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin all games anew; without a seed, with one drawn from `np_random`."""
        super().reset(seed=seed)
        self._batch.reset(_drawn(self.np_random) if seed is None else seed)
        self._buffer = 0
        return self._given(self._own["observations"][0]), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float32],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Step all games by 20 ms with `actions` `[num_envs][2]`.

        `infos` is empty while no episode ends. Otherwise `final_obs` and `final_info` are arrays of objects, None where no
        episode ended, with the masks `_final_obs` and `_final_info`. `result` is 1 (won), -1 (lost) or 0.
        """
        pair: list[ArrayLike | None] = [None, None]
        pair[self._side] = actions
        if self.opponent is not None:
            pair[1 - self._side] = self.opponent(self._other["observations"][self._buffer])
        self._buffer = self._batch.step(*pair)
        own = self._own
        terminated, truncated = own["terminated"], own["truncated"]
        ended = terminated | truncated
        infos = self._final(ended) if ended.any() else {}
        return (
            self._given(own["observations"][self._buffer]),
            self._given(own["rewards"]),
            self._given(terminated),
            self._given(truncated),
            infos,
        )

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        last = np.full(self.num_envs, None, dtype=object)
        info = np.full(self.num_envs, None, dtype=object)
        sign = 1 if self._side == 0 else -1
        results = sign * self._own["result"].astype(np.int64)
        for index in np.flatnonzero(ended):
            last[index] = self._own["last"][index].copy()
            info[index] = {"result": int(results[index])}
        return {
            "final_obs": last,
            "_final_obs": ended,
            "final_info": info,
            "_final_info": ended,
            "result": results,
            "_result": ended,
        }

    def _given(self, array: NDArray[Any]) -> NDArray[Any]:
        return array.copy() if self.copy else array


class KlaskEnv(gymnasium.Env):
    """One game with one learner; the arguments are those of `KlaskVectorEnv`."""

    metadata = {"render_modes": []}

    def __init__(self, render_mode: None = None, **settings: Any) -> None:
        self.render_mode = render_mode
        self._games = KlaskVectorEnv(1, **settings)
        self.observation_space = self._games.single_observation_space
        self.action_space = self._games.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a game; without a seed, with one drawn from `np_random`."""
        super().reset(seed=seed)
        own = _drawn(self.np_random) if seed is None else seed
        observations, infos = self._games.reset(seed=own, options=options)
        return observations[0], infos

    def step(
        self, action: ArrayLike
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Step the game by 20 ms; `info` has `result` at the end of an episode."""
        games = self._games
        observations, rewards, terminated, truncated, infos = games.step(
            np.asarray(action, np.float32)[None]
        )
        has_ended = bool(terminated[0] or truncated[0])
        observation = infos["final_obs"][0] if has_ended else observations[0]
        info = infos["final_info"][0] if has_ended else {}
        return observation, float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info


def _parallel_base() -> type:
    try:
        from pettingzoo import ParallelEnv  # type: ignore[import-untyped]
    except ImportError:
        # Without PettingZoo the class has the same interface but is none of its own.
        return object
    base: type = ParallelEnv
    return base


class KlaskParallelEnv(_parallel_base()):  # type: ignore[misc]
    """One game with the agents `left` and `right`; arguments as `KlaskVectorEnv`, without opponent and player."""

    metadata = {"name": "klask_v0", "render_modes": []}

    def __init__(
        self,
        *,
        actuator: StrPath = "ideal",
        sensors: StrPath | None = None,
        observations: str = "standard12",
        action_history: int = 0,
        reward: str = "dense_ball_to_goal",
        time_limit_s: float = TIME_LIMIT_S,
        render_mode: None = None,
    ) -> None:
        self.render_mode = render_mode
        settings = _settings(actuator, sensors, observations, action_history, reward, time_limit_s, 1)
        self._batch = _klasktron.GameBatch(1, 0, {**settings, "opponents": [None, None]})
        self._arrays = {side: self._batch.arrays(index) for index, side in enumerate(SIDES)}
        self.possible_agents = list(SIDES)
        self.agents: list[str] = []
        self._generator: np.random.Generator | None = None
        self._space = _spaces(self._batch)

    @lru_cache(maxsize=None)  # noqa: B019
    def observation_space(self, agent: str) -> spaces.Box:
        """Space of the observations of `agent`."""
        return spaces.Box(-np.inf, np.inf, self._space[0].shape, np.float32)

    @lru_cache(maxsize=None)  # noqa: B019
    def action_space(self, agent: str) -> spaces.Box:
        """Space of the actions of `agent`."""
        return spaces.Box(-1.0, 1.0, self._space[1].shape, np.float32)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Begin a game; without a seed, with one that follows from the last seed given."""
        if seed is not None or self._generator is None:
            self._generator = np.random.default_rng(seed)
        self._batch.reset(_drawn(self._generator) if seed is None else seed)
        self.agents = list(SIDES)
        return self._seen(0), {side: {} for side in SIDES}

    def step(
        self, actions: dict[str, ArrayLike]
    ) -> tuple[
        dict[str, NDArray[np.float32]],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Step the game by 20 ms with the actions `[2]` of both agents."""
        left, right = (np.asarray(actions[side], np.float32)[None] for side in SIDES)
        buffer = self._batch.step(left, right)
        own = self._arrays["left"]
        terminated, truncated = bool(own["terminated"][0]), bool(own["truncated"][0])
        has_ended = terminated or truncated
        if has_ended:
            seen = {side: self._arrays[side]["last"][0].copy() for side in SIDES}
            self.agents = []
        else:
            seen = self._seen(buffer)
        result = int(own["result"][0])
        infos = {
            side: {"result": sign * result} if has_ended else {}
            for side, sign in zip(SIDES, (1, -1), strict=True)
        }
        return (
            seen,
            {side: float(self._arrays[side]["rewards"][0]) for side in SIDES},
            dict.fromkeys(SIDES, terminated),
            dict.fromkeys(SIDES, truncated),
            infos,
        )

    def render(self) -> None:
        """Nothing: there is no render mode."""

    def close(self) -> None:
        """Nothing is open."""

    def _seen(self, buffer: int) -> dict[str, NDArray[np.float32]]:
        return {side: self._arrays[side]["observations"][buffer][0].copy() for side in SIDES}


gymnasium.register(
    "klasktron/Klask-v0",
    entry_point="klasktron.envs:KlaskEnv",
    vector_entry_point="klasktron.envs:KlaskVectorEnv",
)
