"""System identification and sim-to-real for single axes and the KlaskTron table.

| call | result |
|---|---|
| `read` | topics of a recording or ROS 2 bag as NumPy arrays, runs, metadata |
| `Twin` | identified simulator: parameters, open-loop simulation, residuals |
| `calibrate`, `gap` | fit of a twin; search for the effects that it lacks |
| `ActuatorNet` | fitted actuator network: one step ahead or free-running |
| `Ekf` | state estimator, frame by frame or in batches |
| `Referee` | events and score of recorded matches |
| `Policy` | trained policy: observations to actions |
| `klasktron.envs` | batched game for Gymnasium and PettingZoo |

Quantities are in SI units and radians; names of columns and arguments end with their unit. Every error is a
`KlasktronError` with the sentence that the program `klasktron` prints. Long calls release the global interpreter lock.
"""

from ._klasktron import (
    GIT_HASH,
    ActuatorNet,
    Ekf,
    KlasktronError,
    Policy,
    __version__,
)
from ._recording import Recording, Run, Topic, read
from ._referee import Referee, Score
from ._search import Calibration, GapResult, calibrate, gap
from ._twin import Residual, Twin

__all__ = [
    "GIT_HASH",
    "ActuatorNet",
    "Calibration",
    "Ekf",
    "GapResult",
    "KlasktronError",
    "Policy",
    "Recording",
    "Referee",
    "Residual",
    "Run",
    "Score",
    "Topic",
    "Twin",
    "__version__",
    "calibrate",
    "gap",
    "read",
]
