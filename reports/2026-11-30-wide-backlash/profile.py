"""Residual of the motor torques over the width of a backlash: profile.py PROGRAM RECORDING TWIN."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

WIDTHS_M = [0, 1e-4, 2e-4, 5e-4, 8e-4, 1e-3, 1.2e-3, 1.33e-3, 1.5e-3, 2e-3]


def torques(recording):
    """Times (s) from the first sample, and measured torques (N m), one array per motor of the left player."""
    samples = {"a": [], "b": []}
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for motor in samples:
            for _, _, message, state in reader.iter_decoded_messages(topics=[f"/motor/left/{motor}"]):
                samples[motor].append((message.log_time, state.torque_estimate_nm))
    first = min(times[0][0] for times in samples.values())
    return {motor: np.array([((time - first) * 1e-9, torque) for time, torque in own]).T for motor, own in samples.items()}


def with_backlash(twin, width_m):
    """The twin with a backlash of both motors; the drives do not show the deceleration of the load."""
    values = {"width_m": (width_m, "m", [5e-6, 0.02]), "load_deceleration_m_per_s2": (2.0, "m/s^2", [0, 1000])}
    parameters = [
        {"name": name, "value": value, "unit": unit, "bounds": bounds, "source": "fitted", "ci95": None}
        for name, (value, unit, bounds) in values.items()
    ]
    return twin | {"effects": twin["effects"] + [{"name": "drive.backlash", "location": "a+b", "parameters": parameters}]}


def main():
    program, recording, twin = sys.argv[1:]
    given, measured = json.loads(Path(twin).read_text()), torques(recording)
    with tempfile.TemporaryDirectory() as folder:
        changed, simulated = Path(folder, "twin.json"), Path(folder, "simulated.mcap")
        for width_m in WIDTHS_M:
            changed.write_text(json.dumps(with_backlash(given, width_m) if width_m else given))
            command = [program, "simulate", changed, "--commands", recording, "--output", simulated, "--overwrite", "--rate", "1000"]
            subprocess.run(command, check=True, capture_output=True)
            table = np.genfromtxt(simulated.with_suffix(".csv"), delimiter=",", names=True)
            rms = [
                np.sqrt(np.mean((torque - np.interp(time, table["time_s"], table[f"motor_{motor}_torque_nm"])) ** 2))
                for motor, (time, torque) in measured.items()
            ]
            print(f"{width_m * 1e3:5.2f} mm  " + "  ".join(f"{own * 1e3:5.1f}" for own in rms) + " mN m RMS", flush=True)


if __name__ == "__main__":
    main()
