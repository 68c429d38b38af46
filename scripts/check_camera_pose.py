#!/usr/bin/env python3
"""Checks the check of the camera's pose on frames of a moved camera that MuJoCo renders.

    check_camera_pose.py FOLDER [--program target/release/klasktron]

FOLDER receives one folder of frames per motion (scripts/render_frames.py), unless it has them. Each frame is given to
`detect` alone, with the calibration of the camera before its motion: with its four tags where the frames show tags,
by the edges of the field otherwise. Printed: the true displacement and the measured one, the frames with a warning.

Needs: mujoco, numpy, opencv-python-headless; libosmesa6, MUJOCO_GL=osmesa.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "tests/data/camera"
TAGS = {2: (-0.140, -0.238), 3: (0.140, -0.238), 4: (0.140, 0.238), 5: (-0.140, 0.238)}
SHIFTS_MM = ["1,0", "2,1", "4,-3", "-6,5", "8,8"]
TURNS_DEG = ["0.2,0,0", "0,-0.4,0", "0,0,0.5", "0.3,0.3,-0.5"]
PLACES = [[x, y, 0.0] for x in (-0.16, 0.16) for y in (-0.21, 0.21)] + [[0.0, 0.0, 0.0]]


def sets():
    """Name, kind, scenes, seed and further options of each folder."""
    yield "still", "match", 25, 21, []
    yield "still_tags", "match", 10, 22, ["--tags"]
    yield "hand", "hand", 15, 23, []
    for name, option, values, seed in (("shift", "--shift-mm", SHIFTS_MM, 30), ("turn", "--turn-deg", TURNS_DEG, 50)):
        for number, value in enumerate(values, 1):
            moved = [f"{option}={value}"]
            yield f"{name}{number}", "match", 5, seed + number, moved
            yield f"{name}_tags{number}", "match", 5, seed + 10 + number, ["--tags", *moved]
    yield "board", "board", 2, 2, []


def render(folder):
    for name, kind, scenes, seed, options in sets():
        if (folder / name / "truth.jsonl").exists():
            continue
        print(f"rendering {name}", file=sys.stderr)
        line = [sys.executable, Path(__file__).with_name("render_frames.py"), folder / name, "--kind", kind]
        line += ["--format", "png", "--scenes", scenes, "--frames", 1, "--seed", seed, *options]
        subprocess.run([str(word) for word in line], check=True)


class Camera:
    def __init__(self, path):
        own = json.loads(path.read_text())
        (fx, fy), (cx, cy) = own["focal_px"], own["principal_point_px"]
        self.matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        self.distortion = np.array([own["distortion"][key] for key in ("k1", "k2", "p1", "p2", "k3")])
        self.rotation, self.translation = np.array(own["rotation_rad"]), np.array(own["translation_m"])

    def project(self, places):
        seen, _ = cv2.projectPoints(np.array(places), self.rotation, self.translation, self.matrix, self.distortion)
        return seen[:, 0]

    def locate(self, pixel):
        turn, _ = cv2.Rodrigues(self.rotation)
        ray = cv2.undistortPoints(np.array([[pixel]]), self.matrix, self.distortion)[0, 0]
        direction, eye = turn.T @ [*ray, 1], -turn.T @ self.translation
        return (eye - direction * eye[2] / direction[2])[:2]


def displacement_mm(before, after):
    pixels = after.project(PLACES)
    return max(1e3 * np.linalg.norm(before.locate(own) - place[:2]) for own, place in zip(pixels, PLACES))


def measure(program, frame, calibration):
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(frame, folder)
        line = [program, "detect", "--camera", f"images:{folder}", "--calibration", calibration]
        line += ["--detector", DATA / "detector.json", "--json"]
        result = subprocess.run([str(word) for word in line], capture_output=True, text=True)
    summary = json.loads(result.stdout.splitlines()[-1])
    return summary.get("pose_shift_mm"), "has moved since" in result.stderr


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--program", default=ROOT / "target/release/klasktron", type=Path)
    args = parser.parse_args()
    render(args.folder)
    program, plain = args.program.resolve(), DATA / "camera.json"
    with_tags = args.folder / "with-tags.json"
    line = [program, "calibrate-camera", "--lens", plain, "--board", f"images:{args.folder / 'board'}"]
    line += [f"--tag={number}:{x},{y}" for number, (x, y) in TAGS.items()] + ["-o", with_tags, "--overwrite"]
    subprocess.run([str(word) for word in line], check=True, capture_output=True)
    print("frames         true (mm)   measured (mm): median [min, max]   largest error   warnings")
    for name, *_ in sets():
        if name == "board":
            continue
        truth = displacement_mm(Camera(plain), Camera(args.folder / name / "camera.json"))
        calibration = with_tags if "tags" in name else plain
        frames = sorted((args.folder / name).glob("*.png"))
        results = [measure(program, frame, calibration) for frame in frames]
        found = np.array([shift for shift, _ in results if shift is not None])
        warned = sum(warning for _, warning in results)
        print(f"{name:14} {truth:9.2f}   {np.median(found):9.2f} [{found.min():.2f}, {found.max():.2f}]   "
              f"{np.abs(found - truth).max():9.2f}   {warned} of {len(frames)}, measured {len(found)}")


if __name__ == "__main__":
    main()
