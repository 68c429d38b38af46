"""Score of recorded matches."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from . import _klasktron
from ._warnings import warn_all

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Score:
    """Score of matches: the document `score.json`, and the events of each match as columns."""

    document: dict[str, Any]
    events: list[dict[str, NDArray[Any]]]

    @property
    def summary(self) -> dict[str, Any]:
        """Mean, 95 % interval and n of each metric."""
        summary: dict[str, Any] = self.document["summary"]
        return summary

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """Episodes of all matches in order; `match` is the index of the match."""
        matches = enumerate(self.document["matches"])
        return [{"match": index, **own} for index, match in matches for own in match["episodes"]]


class Referee:
    """Detector of the events of a match, with the rules of `klasktron eval`.

    Args:
        seed: Seed of the bootstrap intervals.
    """

    def __init__(self, seed: int = 0) -> None:
        self.seed = seed

    def score(self, matches: StrPath | Sequence[StrPath]) -> Score:
        """Score recordings with `/camera/detections` or `/board/state`.

        Events have the columns `time_s`, `kind`, `player`, `episode`, `position_m`, `velocity_in_m_per_s`,
        `velocity_out_m_per_s`, `goal_directed` and `confidence`.

        Raises:
            KlasktronError: If a recording cannot be scored.
        """
        paths = [matches] if isinstance(matches, str | os.PathLike) else list(matches)
        parts = _klasktron.score_matches(paths, self.seed)
        warn_all(parts["warnings"])
        return Score(parts["document"], parts["events"])
