"""Writes tests/data/ekf_reference.json: what the PyPI package filterpy makes of a linear track.

    pip install filterpy numpy
    python scripts/make_ekf_reference.py tests/data/ekf_reference.json

Constant velocity in two axes, white acceleration of density q, uneven time steps, one missing
detection, no gate. States are (x, y, vx, vy) in m and m/s.
"""

import json
import sys

import filterpy
import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

SIGMA_M = 5e-4
START_SPEED_SIGMA_M_PER_S = 0.4
PSD_M2_PER_S3 = 2.0
STEPS = 40


def main(path):
    kf = KalmanFilter(dim_x=4, dim_z=2)
    kf.H = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0]])
    kf.R = SIGMA_M**2 * np.eye(2)
    rng = np.random.default_rng(7)
    steps = []
    time_ns = 0
    for k in range(STEPS):
        place = [0.05 * np.sin(0.2 * k), -0.1 + 0.03 * np.cos(0.15 * k)] + SIGMA_M * rng.normal(size=2)
        # Steps of at most 20 ms, the longest that is not divided.
        dt_ns = int(rng.integers(4_000_000, 20_000_001)) if k else 0
        time_ns += dt_ns
        seen = k != 17
        if k == 0:
            kf.x = np.array([place[0], place[1], 0.0, 0.0])
            kf.P = np.diag([SIGMA_M**2] * 2 + [START_SPEED_SIGMA_M_PER_S**2] * 2)
        else:
            dt = dt_ns * 1e-9
            kf.F = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            # filterpy orders each axis as (place, velocity).
            one = Q_continuous_white_noise(2, dt=dt, spectral_density=PSD_M2_PER_S3)
            kf.Q = np.kron(one, np.eye(2))
            kf.predict()
            if seen:
                kf.update(place)
        steps.append(
            {
                "time_ns": time_ns,
                "place_m": list(map(float, place)) if seen else None,
                "mean": kf.x.tolist(),
                "covariance": kf.P.tolist(),
            }
        )
    document = {
        "made_by": f"scripts/make_ekf_reference.py, filterpy {filterpy.__version__}",
        "measurement_sigma_m": SIGMA_M,
        "start_speed_sigma_m_per_s": START_SPEED_SIGMA_M_PER_S,
        "psd_m2_per_s3": PSD_M2_PER_S3,
        "steps": steps,
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(document, file)
        file.write("\n")


if __name__ == "__main__":
    main(sys.argv[1])
