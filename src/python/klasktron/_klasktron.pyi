"""Rust part of the package `klasktron`."""

import os
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "GIT_HASH",
    "ActuatorNet",
    "Ekf",
    "GameBatch",
    "KlasktronError",
    "Policy",
    "Twin",
    "__version__",
    "read_columns",
    "score_matches",
    "search",
]

_StrPath = str | os.PathLike[str]

__version__: str
GIT_HASH: str

class KlasktronError(ValueError):
    """Error of klasktron: one sentence that says what happened, where, the value, the allowed range and the way out."""

def read_columns(path: _StrPath, topics: list[str] | None = None) -> dict[str, Any]:
    """Read a recording or a ROS 2 bag: a dictionary of its parts, for `klasktron.Recording`."""

def search(
    task: str,
    recordings: list[_StrPath],
    start: Twin | None,
    options: dict[str, Any],
) -> dict[str, Any]:
    """Task `gap` or `calibrate`: the document, the twin, and warnings."""

def score_matches(matches: list[_StrPath], seed: int) -> dict[str, Any]:
    """Score of `matches`: the document `score.json`, the events of each match, and warnings."""

@final
class Twin:
    """Simulator of a machine; `klasktron.Twin` is for users."""

    @staticmethod
    def load(path: _StrPath) -> Twin: ...
    @staticmethod
    def from_json(text: str) -> Twin: ...
    @staticmethod
    def nominal(machine: str) -> Twin: ...
    def to_json(self) -> str: ...
    def save(self, path: _StrPath, *, overwrite: bool = False) -> None: ...
    def export(self, target: str) -> tuple[str, list[str]]: ...
    @property
    def machine(self) -> str: ...
    @property
    def document(self) -> dict[str, Any]: ...
    @property
    def parameters(self) -> list[dict[str, Any]]: ...
    def value(self, name: str, axis: str | None = None) -> float: ...
    def with_value(self, name: str, value: float, axis: str | None = None) -> Twin: ...
    def simulate(
        self, commands: ArrayLike | _StrPath, options: dict[str, Any]
    ) -> dict[str, NDArray[np.float64]]: ...
    def step_plant(self, commands: ArrayLike, dt_s: float) -> NDArray[np.float64]: ...
    def compare(self, recordings: list[_StrPath]) -> list[dict[str, Any]]: ...

@final
class ActuatorNet:
    """Network of an `actuator.mcap`: past commands and velocities to the next velocity (m/s)."""

    @staticmethod
    def load(path: _StrPath) -> ActuatorNet:
        """Read an `actuator.mcap` of `klasktron fit-actuator`."""

    @property
    def history_steps(self) -> int:
        """Samples of command and velocity history that the network takes."""

    @property
    def layout(self) -> str:
        """Order of the inputs: `"klasktron"` or `"klask-rl"`."""

    @property
    def metadata(self) -> dict[str, str]:
        """Settings of its fit; `rate_hz` is the rate of its samples."""

    @property
    def onnx(self) -> bytes:
        """The network as ONNX."""

    def predict(self, commands: ArrayLike, velocities: ArrayLike) -> NDArray[np.float64]:
        """Predict one step ahead from measured velocities.

        `commands` and `velocities` are `[n][2]` (m/s) at the network's rate. Row `k` of the result, of
        `n - history_steps` rows, is the velocity at sample `history_steps + k`.
        """

    def simulate(self, commands: ArrayLike, velocities: ArrayLike) -> NDArray[np.float64]:
        """Simulate free-running from known initial velocities.

        `commands` is `[n][2]`, `velocities` `[history_steps][2]` (m/s): those of the first samples. The result is
        `[n - history_steps][2]`: the velocities that follow.
        """

@final
class Ekf:
    """Extended Kalman filter of ball and strikers behind a camera.

    Objects are in the order ball, left, right. States are (x, y, vx, vy) in the board frame (m, m/s). Frames may arrive
    late: a late frame is inserted in order of time.
    """

    def __new__(cls, settings: _StrPath | None = None) -> Ekf:
        """Filter with the settings of an `ekf.json`, or with the built-in ones."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings, the object `filter` of `ekf.json`."""

    def reset(self) -> None:
        """Forget all tracks."""

    def step(self, time_s: float, detections: ArrayLike) -> dict[str, NDArray[Any]]:
        """Process the frame at `time_s` (s, not negative) with `detections` `[3][2]` (m), NaN where not detected.

        Returns `mean` `[3][4]`, `covariance` `[3][4][4]`, `nis` `[3]` (normalized innovation squared) and `accepted`
        `[3]` (false where the gate rejected a detection or there was none). Values are NaN without a track.
        """

    def run(self, times_s: ArrayLike, detections: ArrayLike) -> dict[str, NDArray[Any]]:
        """Process frames at `times_s` `[n]` with `detections` `[n][3][2]`: results of `step` with `[n]` in front."""

    def estimate_at(self, object: str, time_s: float) -> NDArray[np.float64] | None:
        """State `[4]` of `"ball"`, `"left"` or `"right"` at `time_s`, predicted from the last frame before it."""

@final
class Policy:
    """Policy of a `policy.mcap` of `klasktron train`."""

    @staticmethod
    def load(path: _StrPath) -> Policy:
        """Read a `policy.mcap`."""

    @property
    def observation_size(self) -> int:
        """Number of observed values that it takes."""

    @property
    def observations(self) -> str:
        """Its set of state values, as `observations` of the environments."""

    @property
    def action_history(self) -> int:
        """Number of its own previous commands that it observes after them."""

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Mean actions `[n][2]`, from -1 to 1, of observations `[n][observation_size]`."""

@final
class GameBatch:
    """Games that are stepped together; `klasktron.envs` is for users."""

    def __new__(cls, count: int, seed: int, settings: dict[str, Any]) -> GameBatch: ...
    def arrays(self, player: int) -> dict[str, Any]: ...
    @property
    def width(self) -> int: ...
    @property
    def speed_m_per_s(self) -> float: ...
    def reset(self, seed: int) -> None: ...
    def step(self, left: ArrayLike | None, right: ArrayLike | None) -> int: ...
