"""Frames of every CANSimple message, made by cantools from the DBC of PyPI's odrive-can.

    python scripts/make_dbc_frames.py OUT.json

Each entry holds a frame and the values that cantools put into it and reads out of it again. The test
`codec` compares them with our codec: KLASKTRON_DBC_FRAMES=OUT.json cargo test --release --test it codec
"""

import json
import pathlib
import random
import struct
import sys

import cantools
import odrive_can

FRAMES_PER_MESSAGE = 20
NODES = range(8)  # those of the DBC


def random_value(signal, rng):
    """A value that the signal's bits can hold exactly."""
    if signal.is_float:
        return struct.unpack("<f", struct.pack("<f", rng.uniform(-1e4, 1e4)))[0]
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    raw = rng.randint(low, low + (1 << signal.length) - 1)
    return raw * signal.scale


def frames():
    """Entries for every message of every node."""
    folder = pathlib.Path(odrive_can.__file__).parent
    database = cantools.database.load_file(folder / "dbc" / "odrive-cansimple-0.6.10.dbc")
    rng = random.Random(6)
    for message in sorted(database.messages, key=lambda m: m.frame_id):
        axis, name = message.name.split("_", 1)
        fields = [s for s in message.signals if not s.name.startswith("Reserved")]
        for _ in range(FRAMES_PER_MESSAGE if message.signals else 1):
            values = {s.name: 0 for s in message.signals}
            values.update({s.name: random_value(s, rng) for s in fields})
            data = message.encode(values, strict=False)
            decoded = message.decode(data, decode_choices=False)
            yield {
                "node": int(axis.removeprefix("Axis")),
                "name": name,
                "id": message.frame_id,
                "data": list(data),
                "values": [float(decoded[s.name]) for s in sorted(fields, key=lambda s: s.start)],
            }


def main():
    entries = list(frames())
    pathlib.Path(sys.argv[1]).write_text(json.dumps(entries))
    print(f"{len(entries)} frames of {len({e['name'] for e in entries})} messages, {len(NODES)} nodes")


if __name__ == "__main__":
    main()
