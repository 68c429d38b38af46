#!/usr/bin/env python3
"""Checks inputs of the camera commands that OpenCV and ffmpeg make: ChArUco boards and AVI files.

    check_camera_inputs.py PROGRAM [--draw FOLDER]

- Boards of three dictionaries, drawn by OpenCV and seen through a known lens, many of them only in part. The lens of
  `calibrate-camera --charuco` is compared with the truth and with that of OpenCV's detector and `calibrateCamera`.
- The images of tests/data/camera/table as AVI by OpenCV's writer and, with imageio-ffmpeg, by ffmpeg as MJPEG and PNG.
--draw writes the images of tests/data/camera/charuco instead.

Needs: opencv-python-headless, numpy; imageio-ffmpeg for the files of ffmpeg.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

DATA = Path(__file__).resolve().parent.parent / "tests/data/camera"
SIZE = (1280, 720)
MATRIX = np.array([[1150.0, 0, 648.3], [0, 1150.0, 352.7], [0, 0, 1]])
DISTORTION = np.array([-0.118, 0.062, 0.0007, -0.0004, 0.0])
SQUARES = (8, 6)
SQUARE, MARKER = 0.025, 0.018
PIXELS_PER_SQUARE = 200
DICTIONARIES = {
    "4x4": cv2.aruco.DICT_4X4_50,
    "5x5": cv2.aruco.DICT_5X5_100,
    "6x6": cv2.aruco.DICT_6X6_250,
}


def board_of(dictionary):
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE, MARKER, cv2.aruco.getPredefinedDictionary(dictionary))


def see(picture, rotation, translation, rng):
    """The picture of a board through the lens: four rays per pixel, blur and noise."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    total = 0
    turn, _ = cv2.Rodrigues(rotation)
    # Pixel of the plane: homography from rays.
    inverse = np.linalg.inv(np.column_stack([turn[:, 0], turn[:, 1], translation]))
    scale = PIXELS_PER_SQUARE / SQUARE
    for dx in (-0.25, 0.25):
        for dy in (-0.25, 0.25):
            points = np.stack([columns + dx, rows + dy], -1).reshape(-1, 1, 2).astype(float)
            criteria = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 30, 1e-10)
            rays = cv2.undistortPoints(points, MATRIX, DISTORTION, criteria=criteria).reshape(-1, 2)
            place = np.column_stack([rays, np.ones(len(rays))]) @ inverse.T
            place = place[:, :2] / place[:, 2:]
            # Pixel centres of the drawn picture lie at half squares of its grid; the margin is one square.
            x = (place[:, 0] * scale + PIXELS_PER_SQUARE - 0.5).reshape(SIZE[::-1]).astype(np.float32)
            y = (place[:, 1] * scale + PIXELS_PER_SQUARE - 0.5).reshape(SIZE[::-1]).astype(np.float32)
            total = total + cv2.remap(picture, x, y, cv2.INTER_AREA, borderValue=120).astype(float) / 4
    seen = cv2.GaussianBlur(total, (0, 0), 0.7) * rng.uniform(0.7, 0.95) + rng.normal(0, 1, SIZE[::-1])
    return np.clip(seen, 0, 255).astype(np.uint8)


def draw(folder, dictionary, count, seed):
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    size = tuple(PIXELS_PER_SQUARE * (own + 2) for own in SQUARES)
    picture = board_of(dictionary).generateImage(size, None, PIXELS_PER_SQUARE, 1)
    # Coarser by area, so that squares of 30 pixels have no aliases.
    picture = cv2.GaussianBlur(picture, (0, 0), 2.0)
    middle = np.array([SQUARES[0] * SQUARE / 2, SQUARES[1] * SQUARE / 2, 0])
    for number in range(count):
        rotation = rng.uniform(-0.6, 0.6, 3) * [1, 1, 2.0]
        turn, _ = cv2.Rodrigues(rotation)
        # Some reach beyond the image.
        place = np.array([rng.uniform(-0.11, 0.11), rng.uniform(-0.05, 0.05), rng.uniform(0.28, 0.4)])
        image = see(picture, rotation, place - turn @ middle, rng)
        cv2.imwrite(str(folder / f"{number:02}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 75])


def opencv_lens(folder, dictionary):
    board = board_of(dictionary)
    detector = cv2.aruco.CharucoDetector(board)
    objects, pixels = [], []
    for path in sorted(folder.glob("*.jpg")):
        corners, ids, *_ = detector.detectBoard(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        if ids is not None and 12 <= len(ids):
            found, image = board.matchImagePoints(corners, ids)
            objects.append(found)
            pixels.append(image)
    rms, matrix, distortion, *_ = cv2.calibrateCamera(objects, pixels, SIZE, None, None, flags=cv2.CALIB_FIX_K3)
    corners = sum(map(len, pixels))
    return rms, [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()[:4]], corners


def run(program, *words):
    result = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if result.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}: {result.stderr}")
    return result


def check_boards(program, folder):
    truth = [MATRIX[0, 0], MATRIX[1, 1], MATRIX[0, 2], MATRIX[1, 2], *DISTORTION[:4]]
    for name, dictionary in DICTIONARIES.items():
        images = folder / name
        draw(images, dictionary, 20, 7)
        lens = folder / f"{name}.json"
        run(program, "calibrate-camera", "--images", f"images:{images}", "--charuco", name, "--columns", SQUARES[0] - 1,
            "--rows", SQUARES[1] - 1, "--square-mm", 1e3 * SQUARE, "--marker-mm", 1e3 * MARKER, "-o", lens)
        own = json.loads(lens.read_text())
        d = own["distortion"]
        ours = [*own["focal_px"], *own["principal_point_px"], d["k1"], d["k2"], d["p1"], d["p2"]]
        fit = own["lens_fit"]
        rms, theirs, corners = opencv_lens(images, dictionary)
        print(f"ChArUco {name}: {fit['images']} images, {fit['corners']} corners (OpenCV {corners}), reprojection "
              f"{fit['reprojection_rms_px']:.3f} px (OpenCV {rms:.3f})")
        for label, a, h, b, c in zip(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), ours, fit["ci95_half_width"], theirs, truth):
            print(f"  {label}: {a:.5g} +- {h:.2g}, OpenCV {b:.5g}, truth {c:.5g}")
            # Two half widths: eight parameters of three boards may leave a 95 % interval by chance.
            assert abs(a - c) < 2 * h, f"{name}: {label} is off by {abs(a - c)}, interval {h}"
            assert abs(a - b) < 2 * h, f"{name}: {label} differs from OpenCV by {abs(a - b)}, interval {h}"
        assert fit["reprojection_rms_px"] < 0.3 and 0.9 * corners < fit["corners"]


def positions(program, source):
    result = run(program, "detect", "--camera", source, "--calibration", DATA / "camera.json", "--detector",
                 DATA / "detector.json", "--json")
    *frames, summary = map(json.loads, result.stdout.splitlines())
    return frames, summary


def check_videos(program, folder):
    images = sorted((DATA / "table").glob("*.jpg"))
    expected, _ = positions(program, f"images:{DATA / 'table'}")
    files = {"OpenCV, MJPEG": folder / "opencv.avi"}
    writer = cv2.VideoWriter(str(files["OpenCV, MJPEG"]), cv2.VideoWriter_fourcc(*"MJPG"), 120, SIZE)
    for path in images:
        writer.write(cv2.imread(str(path)))
    writer.release()
    try:
        import imageio_ffmpeg

        for codec, options in (("mjpeg", ["-q:v", "2", "-pix_fmt", "yuvj422p"]), ("png", [])):
            name = f"ffmpeg, {codec}"
            files[name] = folder / f"{codec}.avi"
            line = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-y", "-framerate", "120"]
            line += ["-i", DATA / "table/%d.jpg", "-c:v", codec, *options, "-an", files[name]]
            subprocess.run(list(map(str, line)), check=True)
    except ImportError:
        print("skipped: files of ffmpeg: imageio-ffmpeg is missing")
    for name, path in files.items():
        found, summary = positions(program, f"video:{path}")
        assert summary["frames"] == len(images), (name, summary)
        worst = 0.0
        for own, other in zip(found, expected):
            for piece in ("ball", "left", "right"):
                pair = [np.array(frame[piece]["position"]) for frame in (own, other)]
                worst = max(worst, 1e3 * np.linalg.norm(pair[0] - pair[1]))
        assert abs(found[1]["capture_time"] - 1e9 / 120) < 2, found[1]["capture_time"]
        print(f"video, {name}: {len(images)} frames, positions within {worst:.3f} mm of those of the images")
        assert worst < 0.3, name


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", nargs="?", default="target/release/klasktron")
    parser.add_argument("--draw", type=Path)
    args = parser.parse_args()
    if args.draw:
        draw(args.draw, DICTIONARIES["5x5"], 5, 3)
        return
    with tempfile.TemporaryDirectory() as folder:
        check_boards(args.program, Path(folder))
        check_videos(args.program, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
