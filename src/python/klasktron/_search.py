"""`gap` and `calibrate`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from . import _klasktron
from ._twin import Twin
from ._warnings import warn_all

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Calibration:
    """Fitted twin, and the document that `klasktron calibrate --json` prints.

    `twin` is None where the data were refused; `summary` says why.
    """

    twin: Twin | None
    document: dict[str, Any]

    @property
    def verdict(self) -> str:
        """Verdict, such as `named`, `none` or `not_testable`."""
        return str(self.document["verdict"])

    @property
    def summary(self) -> str:
        """Result in one or two sentences."""
        return str(self.document["summary"])

    @property
    def residuals(self) -> list[dict[str, Any]]:
        """Residual RMS of each signal before and after, with its noise floor."""
        residuals: list[dict[str, Any]] = self.document["residuals"]
        return residuals


@dataclass(frozen=True)
class GapResult(Calibration):
    """Twin with the missing effects, and the document `gap.json`."""

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Effects that the initial twin lacks, the strongest first."""
        effects: list[dict[str, Any]] = self.document["effects"]
        return effects


def calibrate(
    recordings: StrPath | Sequence[StrPath],
    twin: Twin | StrPath | None = None,
    *,
    only: Sequence[str] = (),
    exclude: Sequence[str] = (),
    fix: Sequence[str] = (),
    mask: Sequence[str] = (),
    validation: Sequence[str] = (),
) -> Calibration:
    """Fit the parameters of a twin to recordings; no effect is added.

    Args:
        recordings: Recordings; those marked `validation` are held out.
        twin: Initial twin; the built-in nominal twin by default.
        only: Effects or groups that are fitted, such as `"drive.friction"`.
        exclude: Effects or groups that are left out.
        fix: Known values `EFFECT.PARAMETER=VALUE`, never fitted.
        mask: Times that are excluded, `[SESSION:]FROM..TO` (s).
        validation: Sessions that are held out, by name or file.

    Ctrl-C raises `KeyboardInterrupt` at once; the threads of the search end within their current step.

    Raises:
        KlasktronError: If a recording, an option or the machine does not fit.
    """
    parts = _search("calibrate", recordings, twin, (only, exclude, fix, mask, validation), 0.01)
    return Calibration(parts["twin"], parts["document"])


def gap(
    recordings: StrPath | Sequence[StrPath],
    twin: Twin | StrPath | None = None,
    *,
    only: Sequence[str] = (),
    exclude: Sequence[str] = (),
    fix: Sequence[str] = (),
    alpha: float = 0.01,
    mask: Sequence[str] = (),
    validation: Sequence[str] = (),
) -> GapResult:
    """Find the effects that a twin lacks, add them, and validate on held-out data.

    Args:
        recordings: Recordings of at least two sessions; those marked `validation` are held out.
        alpha: Family-wise error of the search: probability of a false effect per screen, above 0 and at most 0.5.

    The other arguments and the errors are those of `calibrate`.
    """
    if not 0.0 < alpha <= 0.5:
        raise _klasktron.KlasktronError(
            f"alpha is {alpha}; allowed are probabilities above 0 and at most 0.5"
        )
    parts = _search("gap", recordings, twin, (only, exclude, fix, mask, validation), alpha)
    return GapResult(parts["twin"], parts["document"])


def _search(
    task: str,
    recordings: StrPath | Sequence[StrPath],
    twin: Twin | StrPath | None,
    options: tuple[Sequence[str], ...],
    alpha: float,
) -> dict[str, Any]:
    paths = [recordings] if isinstance(recordings, str | os.PathLike) else list(recordings)
    if twin is not None and not isinstance(twin, Twin):
        twin = Twin.load(twin)
    names = ("only", "exclude", "fix", "mask", "validation")
    listed = {
        name: [own] if isinstance(own, str) else list(own)
        for name, own in zip(names, options, strict=True)
    }
    start = None if twin is None else twin._inner
    parts = _klasktron.search(task, paths, start, {**listed, "alpha": alpha})
    parts["twin"] = None if parts["twin"] is None else Twin(parts["twin"])
    warn_all(parts["warnings"])
    return parts
