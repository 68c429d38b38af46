#!/usr/bin/env python3
"""Pictures of docs/calibrate-camera.md, docs/tune-detector.md and docs/detect.md from the images of tests/data/camera.

    make_camera_pictures.py [--program target/release/klasktron]

Needs: opencv-python-headless, numpy.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "tests/data/camera"
PICTURES = ROOT / "docs/pictures"
GREEN, RED, WHITE = (60, 230, 60), (60, 60, 250), (255, 255, 255)


def save(name, image):
    """PNG with 32 levels per colour, which is half of the size."""
    image = cv2.resize(image, (960, 540), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURES / name), image // 8 * 8 + 4, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def label(image, text, place):
    place = tuple(int(own) for own in place)
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.62, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.62, WHITE, 1, cv2.LINE_AA)


def detections(program):
    words = [program, "detect", "--camera", f"images:{DATA / 'table'}", "--calibration", DATA / "camera.json"]
    words += ["--detector", DATA / "detector.json", "--json"]
    output = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=True).stdout
    return json.loads(output.splitlines()[0])


def draw_detections(program):
    image = cv2.imread(str(DATA / "table/0.jpg"))
    found = detections(program)
    pieces = [(name, found[name]) for name in ("ball", "left", "right") if found[name]]
    pieces += [("biscuit", own) for own in found["biscuits"] if own]
    for name, own in pieces:
        column, row = own["pixel"]
        cv2.circle(image, (round(column), round(row)), 17, GREEN, 2, cv2.LINE_AA)
        x, y = own["position"]
        sigma = 1e3 * np.sqrt(own["covariance"][0][0])
        label(image, f"{name} {1e3 * x:+.1f}, {1e3 * y:+.1f} mm (sd {sigma:.2f})", (column - 130, row - 24))
    save("detect.png", image)


def draw_marks():
    image = cv2.imread(str(DATA / "table/1.jpg"))
    truth = json.loads((DATA / "truth.json").read_text())[1]
    for name in ("ball", "left", "right"):
        column, row = (round(own) for own in truth[name]["px"])
        cv2.drawMarker(image, (column, row), RED, cv2.MARKER_CROSS, 26, 2)
        label(image, "ball" if name == "ball" else "striker", (column + 16, row - 12))
    save("tune-detector.png", image)


def draw_calibration(program):
    checker = cv2.imread(str(DATA / "checker/0.jpg"))
    with tempfile.TemporaryDirectory() as folder:
        words = [program, "calibrate-camera", "--images", f"images:{DATA / 'checker'}", "--square-mm", "22"]
        words += ["-o", Path(folder) / "lens.json", "--json"]
        output = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=True).stdout
    fit = json.loads(output)["lens_fit"]
    grey = cv2.cvtColor(checker, cv2.COLOR_BGR2GRAY)
    ok, corners = cv2.findChessboardCorners(grey, (9, 6))
    if ok:
        cv2.drawChessboardCorners(checker, (9, 6), corners, ok)
    text = f"{fit['corners']} corners of {fit['images']} images: reprojection error {fit['reprojection_rms_px']:.3f} px (RMS)"
    label(checker, text, (130, 690))
    board = cv2.imread(str(DATA / "board/0.jpg"))
    family = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    tags, numbers, _ = family.detectMarkers(board)
    cv2.aruco.drawDetectedMarkers(board, tags, numbers)
    save("calibrate-camera.png", np.hstack([checker[:, 100:740], board[:, :640]]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/klasktron")
    args = parser.parse_args()
    draw_detections(args.program)
    draw_marks()
    draw_calibration(args.program)


if __name__ == "__main__":
    main()
