"""The twin, with the options of its calls as keyword arguments."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._klasktron import KlasktronError
from ._klasktron import Twin as _Twin
from ._warnings import warn_all

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Residual:
    """Measured minus simulated signal of one session.

    `stage` is the step of the measured chain (`drive`, `camera`, `ball`, `whole_rolls`, `axis`, `estimator`), `split` the
    purpose of the session. Values are in `unit`, NaN where nothing was measured; `rms` covers the finite ones.
    """

    session: str
    split: str
    stage: str
    signal: str
    unit: str
    rms: float | None
    time_s: NDArray[np.float64]
    measured: NDArray[np.float64]
    residual: NDArray[np.float64]

    @property
    def simulated(self) -> NDArray[np.float64]:
        """The simulated signal, in `unit`."""
        return self.measured - self.residual


class Twin:
    """Simulator of a machine: effects of the catalogue with their parameters.

    Immutable; equal documents compare equal, and it can be pickled.
    """

    __slots__ = ("_inner",)

    def __init__(self, inner: _Twin) -> None:
        self._inner = inner

    @classmethod
    def load(cls, path: StrPath) -> Twin:
        """Read a `twin.json`.

        Raises:
            KlasktronError: If it cannot be read, has an unknown effect, or a value outside its bounds.
        """
        return cls(_Twin.load(path))

    @classmethod
    def from_json(cls, text: str) -> Twin:
        """Read the text of a `twin.json`; raises as `load`."""
        return cls(_Twin.from_json(text))

    @classmethod
    def nominal(cls, machine: str) -> Twin:
        """Return the plain twin of `"table"` or `"axis"`, before anything was measured."""
        return cls(_Twin.nominal(machine))

    def save(self, path: StrPath, *, overwrite: bool = False) -> None:
        """Write `twin.json`; an existing file is refused without `overwrite`."""
        self._inner.save(path, overwrite=overwrite)

    def to_json(self) -> str:
        """Return the text of its `twin.json`."""
        return self._inner.to_json()

    def to_mjcf(self, *, strict: bool = False) -> str:
        """Return a MuJoCo model of drives and gantry of one player, or of the single axis.

        An effect that MJCF cannot express gives a `UserWarning`; with `strict`, a `KlasktronError`.
        """
        text, missing = self._inner.export("mjcf")
        if strict and missing:
            raise KlasktronError("; ".join(missing))
        warn_all(missing)
        return text

    def to_isaaclab(self, *, strict: bool = False) -> str:
        """Return a Python file in plain torch: the drives of a table as an explicit actuator for Isaac Lab.

        Missing effects are reported as by `to_mjcf`.
        """
        text, missing = self._inner.export("isaaclab")
        if strict and missing:
            raise KlasktronError("; ".join(missing))
        warn_all(missing)
        return text

    @property
    def machine(self) -> str:
        """`"table"` or `"axis"`."""
        return self._inner.machine

    @property
    def document(self) -> dict[str, Any]:
        """Content of its `twin.json`."""
        return self._inner.document

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """Every parameter: `effect`, `axis`, `name` (with its unit), `value`, `unit`, `ci95`, `source`, `bounds`.

        `pandas.DataFrame(twin.parameters)` is a table of them.
        """
        return self._inner.parameters

    def value(self, name: str, axis: str | None = None) -> float:
        """Return the parameter `EFFECT.PARAMETER`, such as `drive.delay.delay_s`, on `axis` or on the only one."""
        return self._inner.value(name, axis)

    def with_value(self, name: str, value: float, axis: str | None = None) -> Twin:
        """Return a copy with another value of one parameter, within its bounds."""
        return Twin(self._inner.with_value(name, value, axis))

    def simulate(
        self,
        commands: ArrayLike | StrPath,
        *,
        times_s: ArrayLike | None = None,
        dt_s: float | None = None,
        start: ArrayLike | None = None,
        rate_hz: float = 200.0,
        frame_rate_hz: float = 120.0,
        unit: str | None = None,
        player: str | None = None,
        axis: str | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Simulate open loop, without noise, as `klasktron simulate` does.

        Args:
            commands: For a table, velocities `[n][2]` in the board frame (m/s), held until the next. For a single axis,
                inputs `[n]` in `unit`, linear between samples. Or the path of a recording with commands.
            times_s: Time of each command `[n]`, increasing (s).
            dt_s: Period of the commands (s) where `times_s` is not given; 0.02 by default.
            start: Initial position `[2]` of the carriage (m); position and velocity `[2]` of a single axis. The first
                measured state for a recording, zero otherwise.
            rate_hz: Rate of the samples of a table, 1 to 1000 Hz.
            frame_rate_hz: Rate of the camera frames of a table, 1 to 1000 Hz.
            unit: Unit of the inputs of a single axis: N, N m, A or V; that of the twin's recordings by default.
            player: `"left"` or `"right"`, whose commands of a recording are simulated.
            axis: Name of the axis of a recording with several.

        Returns:
            Columns by name. Table: `time_s`, `command_m_per_s`, `carriage_m`, `carriage_m_per_s` (x, y), `motor_m`,
            `motor_m_per_s` (belt), `motor_torque_nm` (a, b), `striker_m` as the camera sees it, and `frame_time_s` with
            `frame_striker_m`. Velocities and torques are those that the drives report. Single axis: `time_s`, the input,
            position and velocity, with the unit in the name.

        Raises:
            KlasktronError: If a shape, dtype, rate or time is wrong, or the commands are those of another machine.
        """
        options = {
            "times_s": times_s,
            "dt_s": dt_s,
            "start": start,
            "rate_hz": rate_hz,
            "frame_rate_hz": frame_rate_hz,
            "unit": unit,
            "player": player,
            "axis": axis,
        }
        return self._inner.simulate(commands, options)

    def residuals(self, recordings: StrPath | Sequence[StrPath]) -> list[Residual]:
        """Compare with recordings, stage by stage; nothing of the twin is fitted.

        Only nuisance parameters are fitted: initial states of rolls, offsets of the camera, phases of ripples.

        Returns:
            One `Residual` per session and signal. A session is a recording, or the part of it for one purpose.
        """
        paths = [recordings] if isinstance(recordings, str | os.PathLike) else list(recordings)
        return [Residual(**own) for own in self._inner.compare(paths)]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Twin) and self._inner == other._inner

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return Twin.from_json, (self.to_json(),)

    def __repr__(self) -> str:
        return repr(self._inner)
