#!/usr/bin/env python3
"""Camera frames of a KLASK table with known truth, rendered by MuJoCo, which shares no code with klasktron.

    render_frames.py OUTPUT [--scenes N] [--frames N] [--seed N] [--kind KIND] [--format mcap|png]
                     [--tags] [--shift-mm X,Y] [--turn-deg X,Y,Z]

--shift-mm (board frame) and --turn-deg (camera frame) move the camera from its usual place; --tags shows the tags in
every kind of scene.

Kinds of scenes:
  match     ball at 0 to 1 m/s, strikers up to 0.4 m/s, three biscuits, light and noise drawn for each scene
  rest      the same at rest
  fast      the ball at 1 m/s
  hand      a hand over the table
  empty     no ball
  dark, overexposed   wrong exposure
  board     an empty board with AprilTags 36h11 (ids 2 to 5) at its corners
  checker   a checkerboard in many poses, for the calibration of the lens

OUTPUT receives frames.mcap (sensor_msgs/Image, uyvy) or NNNN.png, truth.jsonl (one line per frame, in metres,
seconds and pixels) and camera.json (true camera). The lens is that of Brown and Conrady in OpenCV's convention:
pixel centres have integer coordinates.

Needs: mujoco, numpy, opencv-python-headless, mcap, zstandard; the library libosmesa6; MUJOCO_GL=osmesa.
"""

import argparse
import json
import os
import struct
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "osmesa")
import cv2  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402

WIDTH, HEIGHT = 1280, 720
FOCAL_PX = 1150.0
CENTRE_PX = (648.3, 352.7)
DISTORTION = (-0.118, 0.062, 0.0007, -0.0004, 0.0)  # k1, k2, p1, p2, k3
RATE_HZ = 120.0
BALL_RADIUS, STRIKER_RADIUS, STRIKER_HEIGHT = 0.007, 0.0075, 0.025
BISCUIT_RADIUS, BISCUIT_HEIGHT = 0.006, 0.005
SHORT, LONG = 0.32, 0.42
TAG_SIDE = 0.020  # outer edge of the black border (m)
# Centres of the tags 2 to 5: on the surround behind the short walls, at the height of the field.
TAGS = {2: (-0.140, -0.238), 3: (0.140, -0.238), 4: (0.140, 0.238), 5: (-0.140, 0.238)}
SURROUND = (0.60, 0.84)  # plane with the board's picture: x, y (m)
TEXELS_PER_METRE = 3500
# Pinhole of the renderer, wider than the lens.
RENDER = (1920, 1080)
RENDER_FOCAL_PX = 1550.0
CHECKER = (9, 6, 0.022)  # inner corners along x and y, and the side of a square (m)


def board_texture(rng, tags):
    """Picture of the table seen from above: columns along +y, rows along +x."""
    scale = TEXELS_PER_METRE
    size = (int(SURROUND[1] * scale), int(SURROUND[0] * scale))  # columns, rows
    wood = np.array(rng.uniform([95, 70, 45], [150, 115, 80]))
    image = np.ones((size[1], size[0], 3)) * wood
    grain = cv2.GaussianBlur(rng.normal(0, 1, (size[1], size[0])), (0, 0), sigmaX=60, sigmaY=2)
    image += (grain / grain.std() * 7)[..., None]

    def at(x, y):
        return int(round((y + SURROUND[1] / 2) * scale)), int(round((x + SURROUND[0] / 2) * scale))

    blue = rng.uniform([15, 50, 95], [45, 85, 150])
    cv2.rectangle(image, at(-SHORT / 2, -LONG / 2), at(SHORT / 2, LONG / 2), blue.tolist(), -1)
    white = rng.uniform([190, 190, 190], [235, 235, 235]).tolist()
    line = max(1, int(0.0025 * scale))
    cv2.line(image, at(-SHORT / 2, 0), at(SHORT / 2, 0), white, line)
    cv2.circle(image, at(0, 0), int(0.045 * scale), white, line)
    for side in (-1, 1):
        cv2.circle(image, at(0, side * 0.17), int(0.0225 * scale), white, line)
        cv2.circle(image, at(0, side * 0.17), int(0.01905 * scale), (18, 18, 20), -1)
        for x in (-1, 1):
            cv2.circle(image, at(x * SHORT / 2, side * LONG / 2), int(0.04 * scale), white, line)
    # The corner arcs end at the field.
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.rectangle(mask, at(-SHORT / 2, -LONG / 2), at(SHORT / 2, LONG / 2), 255, -1)
    outside = mask == 0
    image[outside] = (np.ones_like(image) * wood + (grain / grain.std() * 7)[..., None])[outside]
    blot = cv2.GaussianBlur(rng.normal(0, 1, image.shape[:2]), (0, 0), 40)
    image += (blot / blot.std() * 4)[..., None]
    for _ in range(12):  # scratches
        a = rng.uniform([-0.15, -0.2], [0.15, 0.2])
        b = a + rng.uniform(-0.06, 0.06, 2)
        cv2.line(image, at(*a), at(*b), (blue + rng.uniform(-18, 30)).tolist(), 1, cv2.LINE_AA)
    if tags:
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        side = int(TAG_SIDE * scale)
        margin = side // 5
        for number, (x, y) in TAGS.items():
            tag = cv2.aruco.generateImageMarker(family, number, side)
            padded = np.pad(tag, margin, constant_values=255)
            column, row = at(x, y)
            half = padded.shape[0] // 2
            rows = slice(row - half, row - half + padded.shape[0])
            columns = slice(column - half, column - half + padded.shape[1])
            image[rows, columns] = np.clip(padded, 15, 225)[..., None]
    return np.clip(image, 0, 255).astype(np.uint8)


def checker_texture():
    columns, rows, square = CHECKER
    cell = int(square * TEXELS_PER_METRE)
    image = np.full(((rows + 3) * cell, (columns + 3) * cell, 3), 230, np.uint8)
    for row in range(rows + 1):
        for column in range(columns + 1):
            if (row + column) % 2 == 0:
                image[(row + 1) * cell : (row + 2) * cell, (column + 1) * cell : (column + 2) * cell] = 22
    return image


def camera_pose(shift_mm=(0, 0), turn_deg=(0, 0, 0)):
    """Position of the camera (m) and rotation camera_from_board, in OpenCV's axes (x right, y down, z forward)."""
    position = np.array([0.004 + 1e-3 * shift_mm[0], -0.008 + 1e-3 * shift_mm[1], 0.65])
    # Image right is +y of the board, image down is +x.
    base = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    tilt, _ = cv2.Rodrigues(np.array([0.017, -0.023, 0.009]))
    turn, _ = cv2.Rodrigues(np.radians(np.array(turn_deg, float)))
    return position, turn @ tilt @ base


def scene_xml(texture, checker):
    lights = """
      <light name="sun" pos="0.3 -0.4 1.6" dir="-0.2 0.25 -1" directional="false" castshadow="true"
             diffuse="0.55 0.55 0.55" specular="0.3 0.3 0.3" attenuation="1 0 0" cutoff="80" exponent="0"/>
      <light name="fill" pos="-0.5 0.5 1.8" dir="0.25 -0.25 -1" castshadow="false" diffuse="0.3 0.3 0.3"
             specular="0 0 0" cutoff="80" exponent="0"/>"""
    wall = 'type="box" rgba="0.42 0.3 0.2 1"'
    pieces = f"""
      <geom name="plane" type="box" size="{SURROUND[0] / 2} {SURROUND[1] / 2} 0.01" pos="0 0 -0.01" material="board"/>
      <geom name="w1" {wall} size="0.004 {LONG / 2 + 0.008} 0.006" pos="{SHORT / 2 + 0.0045} 0 0.006"/>
      <geom name="w2" {wall} size="0.004 {LONG / 2 + 0.008} 0.006" pos="{-SHORT / 2 - 0.0045} 0 0.006"/>
      <geom name="w3" {wall} size="{SHORT / 2} 0.004 0.006" pos="0 {LONG / 2 + 0.0045} 0.006"/>
      <geom name="w4" {wall} size="{SHORT / 2} 0.004 0.006" pos="0 {-LONG / 2 - 0.0045} 0.006"/>
      <body name="ball" mocap="true" pos="0 0 1"><geom name="ball" type="sphere" size="{BALL_RADIUS}" material="ball"/></body>
    """
    for name in ("left", "right"):
        pieces += f"""<body name="{name}" mocap="true" pos="0 0 1">
          <geom name="{name}" type="cylinder" size="{STRIKER_RADIUS} {STRIKER_HEIGHT / 2}" material="striker"/></body>"""
    for number in range(3):
        pieces += f"""<body name="biscuit{number}" mocap="true" pos="0 0 1">
          <geom type="cylinder" size="{BISCUIT_RADIUS} {BISCUIT_HEIGHT / 2}" material="biscuit"/></body>"""
    pieces += '<body name="hand" mocap="true" pos="0 0 2">'
    pieces += '<geom type="ellipsoid" size="0.045 0.05 0.018" material="skin"/>'
    for finger in range(4):
        x = -0.033 + 0.022 * finger
        pieces += f'<geom type="capsule" fromto="{x} 0.04 0 {1.2 * x} 0.12 -0.012" size="0.009" material="skin"/>'
    pieces += '<geom type="capsule" fromto="0 -0.04 0 0 -0.4 0.03" size="0.03" material="skin"/></body>'
    if checker:
        columns, rows, square = CHECKER
        half = ((columns + 3) * square / 2, (rows + 3) * square / 2)
        pieces += f"""<body name="checker" mocap="true" pos="0 0 0.1">
          <geom type="box" size="{half[0]} {half[1]} 0.002" material="checker"/></body>"""
    return f"""<mujoco>
    <compiler texturedir="."/>
    <visual><global offwidth="{RENDER[0]}" offheight="{RENDER[1]}"/>
      <quality offsamples="8" shadowsize="4096"/><map znear="0.02" zfar="20"/>
      <headlight ambient="0.35 0.35 0.35" diffuse="0 0 0" specular="0 0 0"/></visual>
    <asset>
      <texture name="board" type="2d" builtin="flat" width="{texture[1]}" height="{texture[0]}" rgb1="1 1 1"/>
      <texture name="checker" type="2d" builtin="flat" width="{checker[1] if checker else 8}"
               height="{checker[0] if checker else 8}" rgb1="1 1 1"/>
      <material name="board" texture="board" texuniform="false" specular="0.08" shininess="0.2"/>
      <material name="checker" texture="checker" texuniform="false" specular="0" shininess="0"/>
      <material name="ball" rgba="0.93 0.62 0.10 1" specular="0.6" shininess="0.6"/>
      <material name="striker" rgba="0.035 0.035 0.04 1" specular="0.3" shininess="0.5"/>
      <material name="biscuit" rgba="0.93 0.93 0.9 1" specular="0.2" shininess="0.3"/>
      <material name="skin" rgba="0.80 0.58 0.46 1" specular="0.1" shininess="0.1"/>
    </asset>
    <worldbody>{lights}{pieces}
      <camera name="eye" pos="0 0 0.6" fovy="{np.degrees(2 * np.arctan(RENDER[1] / 2 / RENDER_FOCAL_PX))}"/>
    </worldbody></mujoco>"""


class Table:
    """The rendered table with its lens."""

    def __init__(self, rng, kind, table_seed, tags=False, moved=((0, 0), (0, 0, 0))):
        self.rng = rng
        # The top of a box shows a texture's columns along x and its rows along -y.
        board = board_texture(np.random.default_rng(table_seed), tags or kind == "board").transpose(1, 0, 2)[::-1].copy()
        checker = checker_texture() if kind == "checker" else None
        xml = scene_xml(board.shape, checker.shape if checker is not None else None)
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.fill("board", board)
        if checker is not None:
            self.fill("checker", checker)
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, RENDER[1], RENDER[0])
        self.position, self.rotation = camera_pose(*moved)
        self.model.camera("eye").pos = self.position
        # MuJoCo looks along -z with y up: its axes are OpenCV's with y and z turned around.
        axes = self.rotation.T @ np.diag([1, -1, -1])
        mujoco.mju_mat2Quat(self.model.camera("eye").quat, axes.flatten())
        self.set_lens()

    def fill(self, name, picture):
        """Write a picture into a texture of the same size, so that the model needs no file."""
        number = self.model.texture(name).id
        start = self.model.tex_adr[number]
        self.model.tex_data[start : start + picture.size] = picture.flatten()

    def set_lens(self):
        matrix = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])
        columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        points = np.stack([columns, rows], -1).reshape(-1, 1, 2).astype(np.float64)
        criteria = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        rays = cv2.undistortPoints(points, matrix, np.array(DISTORTION), criteria=criteria)
        rays = rays.reshape(HEIGHT, WIDTH, 2)
        self.map_x = (rays[..., 0] * RENDER_FOCAL_PX + RENDER[0] / 2 - 0.5).astype(np.float32)
        self.map_y = (rays[..., 1] * RENDER_FOCAL_PX + RENDER[1] / 2 - 0.5).astype(np.float32)

    def set_light(self, gain, warmth):
        for name, strength in (("sun", 0.55), ("fill", 0.3)):
            colour = np.array([1 + warmth, 1, 1 - warmth]) * strength * gain
            self.model.light(name).diffuse = colour
        self.model.vis.headlight.ambient[:] = np.array([1 + warmth, 1, 1 - warmth]) * 0.35 * gain

    def place(self, name, position, quaternion=(1, 0, 0, 0)):
        body = self.model.body(name).mocapid[0]
        self.data.mocap_pos[body] = position
        self.data.mocap_quat[body] = quaternion

    def pinhole(self):
        mujoco.mj_forward(self.model, self.data)
        self.renderer.update_scene(self.data, camera="eye")
        return self.renderer.render().astype(np.float32)

    def visible_pixels(self, geom):
        """Pixels of a geometry that nothing hides, in the pinhole's picture."""
        mujoco.mj_forward(self.model, self.data)
        self.renderer.enable_segmentation_rendering()
        self.renderer.update_scene(self.data, camera="eye")
        seen = self.renderer.render()
        self.renderer.disable_segmentation_rendering()
        return int((seen[..., 0] == self.model.geom(geom).id).sum())

    def through_lens(self, linear):
        return cv2.remap(linear, self.map_x, self.map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    def project(self, point):
        rotation, _ = cv2.Rodrigues(self.rotation)
        translation = -self.rotation @ self.position
        matrix = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])
        seen, _ = cv2.projectPoints(np.array([point], float), rotation, translation, matrix, np.array(DISTORTION))
        return seen[0, 0].tolist()


def expose(rng, picture, gain, noise):
    """Sensor: gain, photon and read-out noise, blur of the lens, 8 bits."""
    picture = cv2.GaussianBlur(picture, (0, 0), 0.6) * gain
    sigma = np.sqrt(noise**2 + 0.012 * noise * np.clip(picture, 0, 255))
    return np.clip(picture + rng.normal(0, 1, picture.shape) * sigma, 0, 255).astype(np.uint8)


def to_uyvy(rgb):
    """4:2:2 of BT.601, full range, as MJPEG and most USB cameras mean it."""
    r, g, b = (rgb[..., k].astype(np.float32) for k in range(3))
    y = 0.299 * r + 0.587 * g + 0.114 * b
    u = 128 - 0.168736 * r - 0.331264 * g + 0.5 * b
    v = 128 + 0.5 * r - 0.418688 * g - 0.081312 * b
    out = np.empty((*rgb.shape[:2], 2), np.uint8)
    out[..., 1] = np.clip(np.rint(y), 0, 255)
    out[:, 0::2, 0] = np.clip(np.rint((u[:, 0::2] + u[:, 1::2]) / 2), 0, 255)
    out[:, 1::2, 0] = np.clip(np.rint((v[:, 0::2] + v[:, 1::2]) / 2), 0, 255)
    return out


class McapSink:
    """frames.mcap with sensor_msgs/Image in CDR."""

    SCHEMA = (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data\n" + "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )

    def __init__(self, path):
        from mcap.writer import CompressionType, Writer

        self.file = open(path, "wb")
        self.writer = Writer(self.file, compression=CompressionType.NONE)
        self.writer.start(profile="ros2", library="render_frames.py")
        schema = self.writer.register_schema("sensor_msgs/msg/Image", "ros2msg", self.SCHEMA.encode())
        self.channel = self.writer.register_channel("/camera/image", "cdr", schema)

    def write(self, number, stamp_ns, rgb):
        data = to_uyvy(rgb).tobytes()
        body = struct.pack("<iI", stamp_ns // 10**9, stamp_ns % 10**9)

        def string(body, text):
            body += b"\0" * (-len(body) % 4)
            return body + struct.pack("<I", len(text) + 1) + text.encode() + b"\0"

        body = string(body, "camera")
        body += b"\0" * (-len(body) % 4) + struct.pack("<II", rgb.shape[0], rgb.shape[1])
        body = string(body, "uyvy")
        body += b"\0"
        body += b"\0" * (-len(body) % 4) + struct.pack("<II", rgb.shape[1] * 2, len(data)) + data
        self.writer.add_message(self.channel, stamp_ns + 9_000_000, b"\0\1\0\0" + body, stamp_ns, number)

    def close(self):
        self.writer.finish()
        self.file.close()


class PngSink:
    def __init__(self, folder):
        self.folder = folder

    def write(self, number, stamp_ns, rgb):
        cv2.imwrite(str(self.folder / f"{number:05}.png"), rgb[..., ::-1])

    def close(self):
        pass


def draw_scene(rng, kind):
    """Positions and velocities of a scene: no two objects overlap at its start or its end."""
    speed = {"rest": 0.0, "fast": 1.0}.get(kind, rng.uniform(0, 1.0))
    while True:
        direction = rng.uniform(0, 2 * np.pi)
        ball = rng.uniform([-0.15, -0.2], [0.15, 0.2])
        velocity = speed * np.array([np.cos(direction), np.sin(direction)])
        end = ball + velocity * 0.1
        if not (abs(end[0]) < 0.15 and abs(end[1]) < 0.2):
            continue
        strikers = {
            "left": (rng.uniform([-0.14, -0.195], [0.14, -0.02]), rng.uniform(-0.28, 0.28, 2)),
            "right": (rng.uniform([-0.14, 0.02], [0.14, 0.195]), rng.uniform(-0.28, 0.28, 2)),
        }
        if kind == "rest":
            strikers = {name: (place, np.zeros(2)) for name, (place, _) in strikers.items()}
        biscuits = [rng.uniform([-0.15, -0.2], [0.15, 0.2]) for _ in range(3)]
        # Places of each object at the start and the end, and its radius.
        every = [((ball, end), BALL_RADIUS)]
        every += [((place, place + 0.1 * v), STRIKER_RADIUS) for place, v in strikers.values()]
        every += [((place,), BISCUIT_RADIUS) for place in biscuits]
        clear = all(
            np.linalg.norm(here - there) > first[1] + second[1]
            for number, first in enumerate(every)
            for second in every[:number]
            for here in first[0]
            for there in second[0]
        )
        pegs_in = all(abs((place + 0.1 * v)[0]) < 0.15 for place, v in strikers.values())
        cups = all(np.linalg.norm(p - [0, s * 0.17]) > 0.028 for p in (ball, end) for s in (-1, 1))
        if clear and pegs_in and cups:
            return ball, velocity, strikers, biscuits


def render_scene(table, kind, first, frames, sink, truth):
    rng = table.rng
    ball, velocity, strikers, biscuits = draw_scene(rng, kind)
    light = {"dark": 0.12, "overexposed": 3.2}.get(kind, rng.uniform(0.7, 1.15))
    table.set_light(light, rng.uniform(-0.08, 0.08))
    noise = rng.uniform(1.0, 3.0)
    exposure = rng.uniform(0.001, 0.004)
    hand = None
    if kind == "hand":
        angle = rng.choice([0, np.pi]) + rng.uniform(-0.5, 0.5)
        start = np.array([rng.uniform(-0.1, 0.1), -0.17 * np.cos(angle)]) + rng.uniform(-0.05, 0.05, 2)
        hand = (start, rng.uniform(-0.3, 0.3, 2), angle)
    for step in range(frames):
        stamp = round((first + step) / RATE_HZ * 1e9) + 1_700_000_000_000_000_000
        middle = step / RATE_HZ
        fastest = max(np.linalg.norm(velocity), *(np.linalg.norm(v) for _, v in strikers.values()))
        pieces = 1 if fastest < 0.02 else max(2, int(np.ceil(fastest * exposure / 0.0004)))
        picture = 0
        for piece in range(pieces):
            now = middle + exposure * ((piece + 0.5) / pieces - 0.5)
            put(table, kind, now, (ball, velocity, strikers, biscuits, hand))
            picture = picture + table.pinhole() / pieces
        put(table, kind, middle, (ball, velocity, strikers, biscuits, hand))
        shown = {} if kind in ("empty", "board") else {"ball": ball + velocity * middle}
        if kind != "board":
            shown |= {name: place + v * middle for name, (place, v) in strikers.items()}
        line = {
            "frame": first + step,
            "scene": first // frames,
            "kind": kind,
            "capture_time_ns": stamp,
            "exposure_s": exposure,
            "ball_speed_m_per_s": float(np.linalg.norm(velocity)),
            "biscuits": [] if kind == "board" else [list(map(float, place)) for place in biscuits],
        }
        for name in ("ball", "left", "right"):
            if name in shown:
                x, y = map(float, shown[name])
                height = {"ball": BALL_RADIUS}.get(name, STRIKER_HEIGHT)
                line[name] = {"x_m": x, "y_m": y, "px": table.project([x, y, height])}
                if kind == "hand":
                    line[name]["visible_px"] = table.visible_pixels(name)
            else:
                line[name] = None
        if kind == "hand":
            put(table, "match", middle, (ball, velocity, strikers, biscuits, None))
            for name in ("ball", "left", "right"):
                line[name]["whole_px"] = table.visible_pixels(name)
        rgb = expose(rng, table.through_lens(picture), 1.0, noise)
        sink.write(first + step, stamp, rgb)
        truth.write(json.dumps(line) + "\n")


def put(table, kind, now, scene):
    ball, velocity, strikers, biscuits, hand = scene
    away = kind == "board"
    table.place("ball", [0, 0, 5] if kind in ("empty", "board") else [*(ball + velocity * now), BALL_RADIUS])
    for name, (place, v) in strikers.items():
        table.place(name, [0, 0, 5] if away else [*(place + v * now), STRIKER_HEIGHT / 2])
    for number, place in enumerate(biscuits):
        table.place(f"biscuit{number}", [0, 0, 5] if away else [*place, BISCUIT_HEIGHT / 2])
    if hand is None:
        table.place("hand", [0, 0, 5])
    else:
        start, motion, angle = hand
        where = start + motion * now
        table.place("hand", [*where, 0.07], [np.cos(angle / 2), 0, 0, np.sin(angle / 2)])


def render_checker(table, count, sink, truth):
    rng = table.rng
    columns, rows, square = CHECKER
    for number in range(count):
        table.set_light(rng.uniform(0.8, 1.0), 0.0)
        for name in ("ball", "left", "right", "biscuit0", "biscuit1", "biscuit2", "hand"):
            table.place(name, [0, 0, 5])
        while True:
            centre = np.array([*rng.uniform([-0.13, -0.19], [0.13, 0.19]), rng.uniform(0.08, 0.22)])
            tilt = rng.uniform(-0.55, 0.55, 3)
            turn, _ = cv2.Rodrigues(tilt)
            corners = []
            for r in range(rows):
                for c in range(columns):
                    local = np.array([(c - (columns - 1) / 2) * square, ((rows - 1) / 2 - r) * square, 0.002])
                    corners.append(table.project(turn @ local + centre))
            seen = np.array(corners)
            if seen.min() > 25 and seen[:, 0].max() < WIDTH - 25 and seen[:, 1].max() < HEIGHT - 25:
                break
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, turn.flatten())
        table.place("checker", centre, quaternion)
        rgb = expose(rng, table.through_lens(table.pinhole()), 1.0, 1.5)
        stamp = number * 500_000_000 + 1_700_000_000_000_000_000
        sink.write(number, stamp, rgb)
        truth.write(json.dumps({"frame": number, "corners_px": corners}) + "\n")


def write_camera(path, table):
    rotation, _ = cv2.Rodrigues(table.rotation)
    translation = -table.rotation @ table.position
    camera = {
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "focal_px": [FOCAL_PX, FOCAL_PX],
        "principal_point_px": list(CENTRE_PX),
        "distortion": dict(zip(["k1", "k2", "p1", "p2", "k3"], DISTORTION)),
        "rotation_rad": rotation.flatten().tolist(),
        "translation_m": translation.tolist(),
    }
    path.write_text(json.dumps(camera, indent=2) + "\n")


def numbers(text):
    return tuple(float(own) for own in text.split(","))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--frames", type=int, default=6, help="frames of a scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--table-seed", type=int, default=0, help="seed of the table's picture")
    parser.add_argument("--kind", default="match")
    parser.add_argument("--format", choices=["mcap", "png"], default="mcap")
    parser.add_argument("--tags", action="store_true")
    parser.add_argument("--shift-mm", type=numbers, default=(0, 0), metavar="X,Y")
    parser.add_argument("--turn-deg", type=numbers, default=(0, 0, 0), metavar="X,Y,Z")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    sink = McapSink(args.output / "frames.mcap") if args.format == "mcap" else PngSink(args.output)
    rng = np.random.default_rng([args.seed, sum(map(ord, args.kind))])
    # One table: its camera does not move between scenes, its light does.
    table = Table(rng, args.kind, args.table_seed, args.tags, (args.shift_mm, args.turn_deg))
    write_camera(args.output / "camera.json", table)
    with open(args.output / "truth.jsonl", "w") as truth:
        if args.kind == "checker":
            render_checker(table, args.scenes, sink, truth)
        else:
            for scene in range(args.scenes):
                render_scene(table, args.kind, scene * args.frames, args.frames, sink, truth)
    sink.close()
    os._exit(0)  # OSMesa's context cannot be freed at the interpreter's end


if __name__ == "__main__":
    main()
