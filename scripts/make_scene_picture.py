#!/usr/bin/env python3
"""Draws a scene (`/scene`, foxglove.SceneUpdate) of a recording from above: make_scene_picture.py FILE SECONDS SVG

FILE has a scene: `klasktron export match.mcap --to foxglove -o FILE`. Needs PyPI's mcap and mcap-protobuf-support.
"""

import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

PIXELS_PER_M = 1600
MARGIN_M = 0.015


def entities_at(path, seconds):
    """The entities that a viewer shows so long after the first update."""
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        shown, first = {}, None
        for _, _, message, update in reader.iter_decoded_messages(topics=["/scene"]):
            first = first or message.log_time
            if first + seconds * 1e9 < message.log_time:
                break
            now = message.log_time
            shown.update({own.id: (now, own) for own in update.entities})
    lifetime = lambda own: own.lifetime.seconds * 1e9 + own.lifetime.nanos
    return [own for at, own in shown.values() if lifetime(own) == 0 or now - at < lifetime(own)]


def color(own):
    return f"rgb({own.r * 255:.0f},{own.g * 255:.0f},{own.b * 255:.0f})\" opacity=\"{own.a:.2g}"


def place(x, y, width):
    """Pixels of a point: y of the board to the right, x down."""
    return (y + width[1] / 2 + MARGIN_M) * PIXELS_PER_M, (x + width[0] / 2 + MARGIN_M) * PIXELS_PER_M


def shapes(entity, width):
    for cube in entity.cubes:
        x, y = place(cube.pose.position.x - cube.size.x / 2, cube.pose.position.y - cube.size.y / 2, width)
        yield (f'<rect x="{x:.1f}" y="{y:.1f}" width="{cube.size.y * PIXELS_PER_M:.1f}" '
               f'height="{cube.size.x * PIXELS_PER_M:.1f}" fill="{color(cube.color)}"/>')
    for own in [*entity.cylinders, *entity.spheres]:
        x, y = place(own.pose.position.x, own.pose.position.y, width)
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{own.size.x / 2 * PIXELS_PER_M:.1f}" fill="{color(own.color)}"/>'
    for line in entity.lines:
        points = " ".join("{:.1f},{:.1f}".format(*place(own.x, own.y, width)) for own in line.points)
        kind = "polygon" if line.type == 1 else "polyline"
        yield (f'<{kind} points="{points}" fill="none" stroke="{color(line.color)}" '
               f'stroke-width="{max(line.thickness * PIXELS_PER_M, 1):.1f}"/>')


def main():
    path, seconds, output = sys.argv[1], float(sys.argv[2]), sys.argv[3]
    entities = entities_at(path, seconds)
    board = next(own for own in entities if own.id == "board").cubes[0].size
    order = {"board": 0, "path_left": 1, "path_right": 1}
    entities.sort(key=lambda own: (order.get(own.id, 3 if own.id.startswith("estimate") else 2), own.id))
    size = [(side + 2 * MARGIN_M) * PIXELS_PER_M for side in (board.y, board.x)]
    drawn = "\n".join(f"<g><title>{own.id}</title>{''.join(shapes(own, (board.x, board.y)))}</g>" for own in entities)
    with open(output, "w", encoding="utf-8") as stream:
        stream.write(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:.0f} {size[1]:.0f}" '
                     f'role="img">\n<title>Scene from above</title>\n{drawn}\n</svg>\n')


main()
