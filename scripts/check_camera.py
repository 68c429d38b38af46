#!/usr/bin/env python3
"""Checks `klasktron detect` and `calibrate-camera` against rendered frames and OpenCV, in one run.

    check_camera.py FOLDER --program target/release/klasktron [--output DIR]

FOLDER holds what scripts/render_frames.py wrote, one folder per kind: tune, rest, fast, match, hand, empty, dark,
overexposed, board, checker (render_camera_sets of this script's folder makes them with --render). Printed and written
as metrics.json and errors.csv: position errors, detection rate, false detections, consistency of the covariances,
times, and the same for the recipe of the KlaskTron stack in OpenCV (undistort, fit the board's outline, warp, JPEG and
back, HSV thresholds, centroid in whole pixels). The HSV ranges are those of the rendered colours, from the tune images.

Needs: numpy, scipy, opencv-python-headless, mcap; mujoco for --render.
"""

import argparse
import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np

cv2.setNumThreads(1)
SHORT, LONG = 0.32, 0.42
BALL_HEIGHT, STRIKER_HEIGHT, BISCUIT_HEIGHT = 0.007, 0.025, 0.005
FALSE_BEYOND_MM = 5.0
WARP = (530, 404)  # columns along y, rows along x
SETS = {
    "tune": ("match", 12, 1, 100, "png"),
    "rest": ("rest", 80, 2, 1, "mcap"),
    "board": ("board", 4, 1, 2, "png"),
    "checker": ("checker", 24, 1, 3, "png"),
    "fast": ("fast", 30, 6, 4, "mcap"),
    "hand": ("hand", 30, 2, 5, "mcap"),
    "empty": ("empty", 40, 2, 6, "mcap"),
    "dark": ("dark", 4, 1, 7, "mcap"),
    "overexposed": ("overexposed", 4, 1, 8, "mcap"),
    "match": ("match", 80, 6, 9, "mcap"),
}
TAGS = {2: (-0.140, -0.238), 3: (0.140, -0.238), 4: (0.140, 0.238), 5: (-0.140, 0.238)}
CHECKER = (9, 6, 22.0)


def render(folder):
    script = Path(__file__).with_name("render_frames.py")
    for name, (kind, scenes, frames, seed, form) in SETS.items():
        if (folder / name / "truth.jsonl").exists():
            continue
        print(f"rendering {name}", file=sys.stderr)
        line = [sys.executable, script, folder / name, "--kind", kind, "--format", form]
        line += ["--scenes", scenes, "--frames", frames, "--seed", seed]
        subprocess.run([str(word) for word in line], check=True)


def truths(folder):
    return [json.loads(line) for line in open(folder / "truth.jsonl")]


class Lens:
    def __init__(self, path):
        own = json.loads(path.read_text())
        fx, fy = own["focal_px"]
        cx, cy = own["principal_point_px"]
        self.matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        self.distortion = np.array([own["distortion"][key] for key in ("k1", "k2", "p1", "p2", "k3")])
        self.rotation = np.array(own["rotation_rad"])
        self.translation = np.array(own["translation_m"])

    def project(self, point):
        points = np.array([point], float)
        seen, _ = cv2.projectPoints(points, self.rotation, self.translation, self.matrix, self.distortion)
        return seen[0, 0]


def frames_of(folder):
    """Frames as UYVY, and as BGR for OpenCV."""
    if (folder / "frames.mcap").exists():
        from mcap.reader import make_reader

        with open(folder / "frames.mcap", "rb") as file:
            for _, _, message in make_reader(file).iter_messages():
                data = np.frombuffer(message.data[-1280 * 720 * 2 :], np.uint8)
                yield cv2.cvtColor(data.reshape(720, 1280, 2), cv2.COLOR_YUV2BGR_UYVY)
    else:
        for path in sorted(folder.glob("*.png")):
            yield cv2.imread(str(path))


def run(program, *words):
    result = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if result.returncode not in (0, 3):
        raise SystemExit(f"{words}: {result.stderr}")
    return result


def write_marks(folder, lens, path):
    with open(path, "w") as file:
        file.write("image,kind,column_px,row_px\n")
        for number, truth in enumerate(truths(folder)):
            pieces = [("ball", truth["ball"], BALL_HEIGHT)]
            pieces += [("striker", truth[name], STRIKER_HEIGHT / 2) for name in ("left", "right")]
            pieces = [(kind, (own["x_m"], own["y_m"]), height) for kind, own, height in pieces if own]
            pieces += [("biscuit", own, BISCUIT_HEIGHT) for own in truth["biscuits"]]
            for kind, (x, y), height in pieces:
                column, row = lens.project([x, y, height])
                # Whole pixels, as a person clicks.
                file.write(f"{number},{kind},{round(column)},{round(row)}\n")


class Upstream:
    """The recipe of the KlaskTron stack, with the lens of the calibration."""

    def __init__(self, lens, tune, marks):
        self.maps = cv2.initUndistortRectifyMap(lens.matrix, lens.distortion, None, lens.matrix, (1280, 720), cv2.CV_16SC2)
        self.lens = lens
        self.ranges = None
        samples = {"ball": [], "striker": []}
        rows = list(csv.DictReader(open(marks)))
        for number, image in enumerate(frames_of(tune)):
            hsv = cv2.cvtColor(cv2.blur(image, (7, 7)), cv2.COLOR_BGR2HSV)
            for row in rows:
                if int(row["image"]) == number and row["kind"] in samples:
                    mask = np.zeros(hsv.shape[:2], np.uint8)
                    cv2.circle(mask, (int(row["column_px"]), int(row["row_px"])), 9, 255, -1)
                    samples[row["kind"]].append(hsv[mask > 0])
        self.ranges = {}
        for kind, values in samples.items():
            values = np.concatenate(values)
            low, high = np.percentile(values, 1, 0), np.percentile(values, 99, 0)
            # The hue and saturation of black mean nothing: brightness alone.
            self.ranges[kind] = (low, high) if kind == "ball" else (np.array([0, 0, 0]), np.array([180, 255, high[2]]))

    def outline(self, grey):
        """Corners of the field by four lines through the strongest edges of four strips."""
        corners = {}
        signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        ideal = []
        for sx, sy in signs:
            point = np.array([[sx * SHORT / 2, sy * LONG / 2, 0.0]])
            seen, _ = cv2.projectPoints(point, self.lens.rotation, self.lens.translation, self.lens.matrix, None)
            ideal.append(seen[0, 0])
        lines = []
        for side in range(4):
            a, b = ideal[side], ideal[(side + 1) % 4]
            normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            points = []
            for t in np.linspace(0.15, 0.85, 40):
                offsets = np.arange(-12, 13)
                line = (a + t * (b - a))[None] + offsets[:, None] * normal[None]
                columns = np.clip(np.rint(line[:, 0]).astype(int), 0, 1279)
                rows = np.clip(np.rint(line[:, 1]).astype(int), 0, 719)
                edge = np.abs(np.diff(grey[rows, columns].astype(int)))
                points.append(line[int(edge.argmax())])
            vx, vy, x, y = cv2.fitLine(np.array(points, np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
            lines.append(((-vy, vx), -vy * x + vx * y))
        for side in range(4):
            (n1, d1), (n2, d2) = lines[side - 1], lines[side]
            corners[side] = np.linalg.solve(np.array([n1, n2]), np.array([d1, d2]))
        return np.array([corners[k] for k in range(4)], np.float32)

    def detect(self, image):
        flat = cv2.remap(image, *self.maps, cv2.INTER_LINEAR)
        corners = self.outline(cv2.cvtColor(flat, cv2.COLOR_BGR2GRAY))
        # Corners in the order (x-, y-), (x+, y-), (x+, y+), (x-, y+); columns run along y, rows along x.
        target = np.array([[0, 0], [0, WARP[1]], [WARP[0], WARP[1]], [WARP[0], 0]], np.float32)
        warped = cv2.warpPerspective(flat, cv2.getPerspectiveTransform(corners, target), WARP)
        _, data = cv2.imencode(".jpg", warped)
        warped = cv2.imdecode(data, cv2.IMREAD_COLOR)
        hsv = cv2.cvtColor(cv2.blur(warped, (7, 7)), cv2.COLOR_BGR2HSV)
        half = WARP[0] // 2
        found = {"ball": self.largest(hsv, "ball", 0)}
        found["left"] = self.largest(hsv[:, :half], "striker", 0)
        found["right"] = self.largest(hsv[:, half:], "striker", half)
        return found

    def largest(self, hsv, kind, shift):
        mask = cv2.inRange(hsv, *(np.array(own, float) for own in self.ranges[kind]))
        if kind == "striker":
            # The cups are as dark as the strikers here: without this the recipe finds nothing but cups.
            for y in (-0.17, 0.17):
                middle = (round((y + LONG / 2) * WARP[0] / LONG) - shift, WARP[1] // 2)
                cv2.circle(mask, middle, round((0.01905 + 0.004) * WARP[0] / LONG), 0, -1)
            mask[:6] = mask[-6:] = 0
            mask[:, :6] = mask[:, -6:] = 0
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if not contours:
            return None
        moments = cv2.moments(max(contours, key=cv2.contourArea))
        if moments["m00"] == 0:
            return None
        column = round(moments["m10"] / moments["m00"]) + shift
        row = round(moments["m01"] / moments["m00"])
        return (row * SHORT / WARP[1] - SHORT / 2, column * LONG / WARP[0] - LONG / 2)


def in_cup(x, y):
    return np.hypot(x, abs(y) - 0.17) < 0.01905 + 0.0075


def score(found, truth_lines, kind, table):
    """Errors and counts of one detector on one set."""
    counts = {}
    for name in ("ball", "left", "right"):
        errors, missed, false, shown, hidden, nees = [], 0, 0, 0, 0, []
        for own, truth in zip(found, truth_lines):
            place, seen = truth.get(name), own.get(name)
            if place is None:
                false += seen is not None
                continue
            visible = place.get("visible_px", 1) / max(1, place.get("whole_px", 1))
            cup = name != "ball" and in_cup(place["x_m"], place["y_m"])
            counts_for_rate = visible > 0.7 and not cup
            shown += counts_for_rate
            hidden += not counts_for_rate
            if seen is None:
                missed += counts_for_rate
                continue
            position = seen["position"] if isinstance(seen, dict) else seen
            error = 1e3 * (np.array(position) - [place["x_m"], place["y_m"]])
            if np.linalg.norm(error) > FALSE_BEYOND_MM:
                false += 1
                missed += counts_for_rate
                continue
            errors.append(error)
            if isinstance(seen, dict):
                covariance = 1e6 * np.array(seen["covariance"])
                nees.append(float(error @ np.linalg.solve(covariance, error)))
            table.append([kind, truth["frame"], name, *np.round(error, 4), round(visible, 3)])
        errors = np.array(errors).reshape(-1, 2)
        length = np.linalg.norm(errors, axis=1)
        counts[name] = {
            "frames": len(truth_lines),
            "visible": int(shown),
            "hidden_or_in_cup": int(hidden),
            "missed_of_visible": int(missed),
            "false": int(false),
            "rms_mm": float(np.sqrt((length**2).mean())) if len(length) else None,
            "bias_mm": errors.mean(0).round(4).tolist() if len(length) else None,
            "p99_mm": float(np.percentile(length, 99)) if len(length) else None,
            "mean_nees_of_2": float(np.mean(nees)) if nees else None,
        }
    return counts


def bootstrap_rms(table, kinds, name):
    """95 % interval of the RMS error by resampling the scenes, whose frames share light and places."""
    rng = np.random.default_rng(0)
    frames = {}
    for kind, frame, own, dx, dy, _ in table:
        if kind in kinds and own == name:
            frames.setdefault((kind, frame // SETS[kind][2]), []).append(dx**2 + dy**2)
    scenes = list(frames.values())
    if not scenes:
        return None
    picks = rng.integers(0, len(scenes), (1000, len(scenes)))
    values = [np.sqrt(np.mean(np.concatenate([scenes[k] for k in pick]))) for pick in picks]
    return np.percentile(values, [2.5, 97.5]).round(4).tolist()


def check_calibration(program, folder, output):
    """Lens and pose by klasktron, and the lens by OpenCV from its own corners of the same images."""
    columns, rows, square = CHECKER
    lens_path, camera_path = output / "lens.json", output / "camera.json"
    run(program, "calibrate-camera", "--images", f"images:{folder / 'checker'}", "--columns", columns, "--rows", rows,
        "--square-mm", square, "-o", lens_path, "--overwrite")
    words = ["calibrate-camera", "--lens", lens_path, "--board", f"images:{folder / 'board'}"]
    for number, (x, y) in TAGS.items():
        words += ["--tag", f"{number}:{x},{y}"]
    run(program, *words, "-o", camera_path, "--overwrite")
    own = json.loads(camera_path.read_text())
    points = np.zeros((columns * rows, 3), np.float32)
    points[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * square * 1e-3
    objects, images = [], []
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    for image in frames_of(folder / "checker"):
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        found, corners = cv2.findChessboardCorners(grey, (columns, rows))
        if found:
            objects.append(points)
            images.append(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), criteria))
    rms, matrix, distortion, *_ = cv2.calibrateCamera(objects, images, (1280, 720), None, None, flags=cv2.CALIB_FIX_K3)
    theirs = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()[:4]]
    d = own["distortion"]
    ours = [*own["focal_px"], *own["principal_point_px"], d["k1"], d["k2"], d["p1"], d["p2"]]
    half = own["lens_fit"]["ci95_half_width"][:8]
    truth_file = json.loads((folder / "board" / "camera.json").read_text())
    t = truth_file["distortion"]
    true = [*truth_file["focal_px"], *truth_file["principal_point_px"], t["k1"], t["k2"], t["p1"], t["p2"]]
    true_lens, our_lens = Lens(folder / "board" / "camera.json"), Lens(camera_path)
    worst = 0.0
    for x in np.linspace(-SHORT / 2, SHORT / 2, 5):
        for y in np.linspace(-LONG / 2, LONG / 2, 5):
            pixel = true_lens.project([x, y, 0.0])
            worst = max(worst, 1e3 * np.linalg.norm(locate(our_lens, pixel, 0.0) - [x, y]))
    names = ["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2"]
    return {
        "images": own["lens_fit"]["images"],
        "images_opencv": len(images),
        "reprojection_rms_px": own["lens_fit"]["reprojection_rms_px"],
        "reprojection_rms_px_opencv": float(rms),
        "board_reprojection_rms_px": own["board_fit"]["reprojection_rms_px"],
        "board_worst_error_mm": float(worst),
        "parameters": {
            name: {"klasktron": a, "ci95_half_width": h, "opencv": float(b), "truth": c}
            for name, a, h, b, c in zip(names, ours, half, theirs, true)
        },
        "opencv_within_intervals": [bool(abs(a - b) <= h) for a, b, h in zip(ours, theirs, half)],
    }


def locate(lens, pixel, height):
    ray = cv2.undistortPoints(np.array([[pixel]], float), lens.matrix, lens.distortion)[0, 0]
    rotation, _ = cv2.Rodrigues(lens.rotation)
    eye = -rotation.T @ lens.translation
    direction = rotation.T @ np.array([*ray, 1.0])
    return (eye + (height - eye[2]) / direction[2] * direction)[:2]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--program", default="target/release/klasktron")
    parser.add_argument("--output", type=Path, default=Path("target/check-camera"))
    parser.add_argument("--render", action="store_true", help="render the sets that are missing (about 40 minutes)")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    if args.render:
        render(args.folder)
    metrics = {"calibration": check_calibration(args.program, args.folder, args.output)}
    camera, detector = args.output / "camera.json", args.output / "detector.json"
    lens = Lens(camera)
    marks = args.output / "marks.csv"
    write_marks(args.folder / "tune", Lens(args.folder / "tune" / "camera.json"), marks)
    tuned = run(args.program, "tune-detector", f"images:{args.folder / 'tune'}", "--calibration", camera, "--marks", marks,
                "-o", detector, "--overwrite", "--json")
    metrics["tune"] = json.loads(tuned.stdout)
    upstream = Upstream(lens, args.folder / "tune", marks)
    ours, theirs = [], []
    metrics["sets"], metrics["upstream"] = {}, {}
    for name in ("rest", "fast", "match", "hand", "empty", "dark", "overexposed"):
        folder = args.folder / name
        if not (folder / "truth.jsonl").exists():
            continue
        lines = truths(folder)
        source = f"mcap:{folder / 'frames.mcap'}"
        result = run(args.program, "detect", "--camera", source, "--calibration", camera, "--detector", detector, "--json")
        *found, summary = [json.loads(line) for line in result.stdout.splitlines()]
        metrics["sets"][name] = {"summary": summary, "pieces": score(found, lines, name, ours)}
        metrics["sets"][name]["warnings"] = [line for line in result.stderr.splitlines() if line.startswith("warning")][:3]
        biscuits = [score_biscuits(own, truth) for own, truth in zip(found, lines)]
        errors = np.concatenate([own[0] for own in biscuits]) if biscuits else np.zeros(0)
        metrics["sets"][name]["biscuits"] = {
            "shown": sum(own[1] for own in biscuits),
            "found": len(errors),
            "rms_mm": float(np.sqrt((errors**2).mean())) if len(errors) else None,
        }
        times, detected = [], []
        for image in frames_of(folder):
            begun = time.perf_counter()
            detected.append(upstream.detect(image))
            times.append(1e3 * (time.perf_counter() - begun))
        metrics["upstream"][name] = {
            "median_ms": float(np.median(times)),
            "p99_ms": float(np.percentile(times, 99)),
            "pieces": score(detected, lines, name, theirs),
        }
    for name in ("ball", "left", "right"):
        metrics[f"rms_mm_ci95_{name}"] = {
            kind: bootstrap_rms(ours, [kind], name) for kind in ("rest", "fast", "match") if kind in metrics["sets"]
        }
    (args.output / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
    with open(args.output / "errors.csv", "w") as file:
        writer = csv.writer(file)
        writer.writerow(["set", "frame", "piece", "error_x_mm", "error_y_mm", "visible_fraction"])
        writer.writerows(ours)
    show(metrics)


def score_biscuits(found, truth):
    places = [own["position"] for own in found["biscuits"] if own]
    errors = []
    for place in truth["biscuits"]:
        distances = [1e3 * np.linalg.norm(np.array(own) - place) for own in places]
        if distances and min(distances) < FALSE_BEYOND_MM:
            errors.append(min(distances))
    return np.array(errors), len(truth["biscuits"])


def show(metrics):
    own = metrics["calibration"]
    print(f"calibration: {own['images']} images, reprojection {own['reprojection_rms_px']:.3f} px (OpenCV "
          f"{own['reprojection_rms_px_opencv']:.3f}), field to {own['board_worst_error_mm']:.2f} mm, OpenCV within the "
          f"intervals: {own['opencv_within_intervals']}")
    for name, own in metrics["sets"].items():
        theirs = metrics["upstream"][name]
        summary = own["summary"]
        print(f"{name}: {summary['detection_median_ms']:.2f} ms (99 %: {summary['detection_p99_ms']:.2f}), whole field "
              f"{summary.get('full_search_median_ms', 0):.2f}, regions {summary.get('regions_median_ms', 0):.2f}; "
              f"OpenCV recipe {theirs['median_ms']:.2f} ms (99 %: {theirs['p99_ms']:.2f}); biscuits {own['biscuits']}")
        for piece in ("ball", "left", "right"):
            for who, counts in (("klasktron", own["pieces"][piece]), ("OpenCV", theirs["pieces"][piece])):
                rms = "-" if counts["rms_mm"] is None else f"{counts['rms_mm']:.3f}"
                nees = "" if counts["mean_nees_of_2"] is None else f", NEES {counts['mean_nees_of_2']:.2f} of 2"
                print(f"  {piece:5} {who:9}: RMS {rms} mm, missed {counts['missed_of_visible']} of {counts['visible']}, "
                      f"false {counts['false']} of {counts['frames']}{nees}")


if __name__ == "__main__":
    main()
