"""Draws the hero picture from gap.json: make_hero_picture.py GAP_JSON OUT.png

`scripts/make_hero_picture` makes the data, runs `klasktron gap` and calls this script. The true sizes come from
`make_example_axis.TRUTH`; this script computes nothing but ratios to the noise floor and the amplitude of a wave.
"""

import json
import math
import sys

import matplotlib as mpl
import matplotlib.pyplot as plt
from make_example_axis import TRUTH

WIDTH_PX, HEIGHT_PX, DENSITY = 900, 390, 2
# Pixels to the inch; matplotlib has 72 points to the inch.
PX_PER_INCH = 100
TEXT_PX, HEADING_PX = 13, 16
INK, MUTED, FLOOR = "#1d2733", "#56616d", "#2f8f4e"
GIVEN, EFFECT = "#b9c2cc", "#1f69b4"
LABELS = {
    "drive.delay": "command delay",
    "drive.friction.load": "load-dependent friction",
    "drive.friction.presliding": "presliding friction",
    "drive.ripple.motor": "motor ripple",
}


def points(pixels):
    """Return the size in points of a length in pixels."""
    return pixels * 72 / PX_PER_INCH


def size(effect):
    """Return the identified size with its interval and the true size, as text."""
    name, parameters = effect["name"], effect["parameters"]
    truth = TRUTH[name][0]
    first = parameters[0]
    if name == "drive.ripple.motor":
        amplitude = math.hypot(*(parameter["value"] for parameter in parameters[:2]))
        return f"{amplitude:.2f} N amplitude, true {truth:.2f} N"
    factor, unit, digits = {
        "drive.delay": (1e3, " ms", 2),
        "drive.friction.presliding": (1e6, " µm deflection", 1),
    }.get(name, (1, "", 3))
    if name == "drive.friction.presliding":
        first, truth = parameters[1], TRUTH[name][1]
    low, high = (factor * bound for bound in first["ci95"])
    value = f"{factor * first['value']:.{digits}f} ({low:.{digits}f} to {high:.{digits}f}){unit}"
    return f"{value}, true {factor * truth:.{digits}f}"


def steps(document):
    """Return label, RMS on validation data in multiples of the noise floor, and remark of each step."""
    residual, effects = document["residuals"][0], document["effects"]
    names = sorted(effect["name"] for effect in effects)
    if names != sorted(TRUTH):
        sys.exit(f"gap found {names}, hidden are {sorted(TRUTH)}: no picture")
    # The model is fitted again after each addition, so the RMS before the next one is the RMS after this one.
    after = [effect["rmse_before"] for effect in effects] + [residual["validation_after"]]
    rows = [
        ("nominal model", residual["validation_before"], ""),
        ("parameters calibrated", after[0], "mass, viscous and Coulomb friction"),
    ]
    for effect, rms in zip(effects, after[1:]):
        rows.append(("+ " + LABELS[effect["name"]], rms, size(effect)))
    return [(label, rms / residual["noise_floor"], remark) for label, rms, remark in rows]


def draw(rows, path):
    """Write the picture: bars from the noise floor, on a logarithmic axis."""
    mpl.rcParams.update({"font.family": "DejaVu Sans", "font.size": points(TEXT_PX), "text.color": INK})
    figure = plt.figure(figsize=(WIDTH_PX / PX_PER_INCH, HEIGHT_PX / PX_PER_INCH))
    axes = figure.add_axes((0.205, 0.135, 0.395, 0.62))
    heights = range(len(rows))
    colours = [GIVEN, GIVEN] + [EFFECT] * (len(rows) - 2)
    axes.barh(heights, [level - 1.0 for _, level, _ in rows], left=1.0, color=colours, height=0.6)
    axes.set_xscale("log")
    axes.set_xlim(0.5, 130)
    axes.set_ylim(len(rows) - 0.45, -0.6)
    axes.set_yticks(heights, [label for label, _, _ in rows], color=INK)
    axes.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"], color=MUTED)
    axes.xaxis.set_minor_locator(mpl.ticker.NullLocator())
    axes.tick_params(length=0)
    axes.set_axisbelow(True)
    axes.grid(axis="x", color="#e6eaee", linewidth=0.8)
    axes.spines[:].set_visible(False)
    axes.axvline(1.0, color=FLOOR, linewidth=1.8)
    axes.set_xlabel("residual RMS, in multiples of the noise floor", color=MUTED)
    for height, (_, level, remark) in zip(heights, rows):
        shown = f"{level:.0f}×" if level >= 20 else f"{level:.1f}×"
        beside = {"textcoords": "offset points", "va": "center_baseline", "weight": "bold"}
        axes.annotate(shown, (max(level, 1.0), height), (5, 0), **beside)
        place = {"xycoords": ("axes fraction", "data"), "va": "center_baseline", "color": MUTED}
        axes.annotate(remark, (1.04, height), **place)
    at_noise = {"textcoords": "offset points", "ha": "center", "va": "bottom", "color": FLOOR}
    axes.annotate("noise floor", (1.0, -0.6), (0, 3), **at_noise)
    figure.text(0.02, 0.925, "gap adds the effects that the model is missing", size=points(HEADING_PX), weight="bold")
    figure.text(0.02, 0.86, "validation session of a simulated axis with four hidden effects", color=MUTED)
    figure.text(0.62, 0.775, "identified (95 % interval) and true size", color=INK)
    figure.savefig(path, dpi=DENSITY * PX_PER_INCH, facecolor="white", pil_kwargs={"optimize": True})


def main():
    """Read gap.json and draw."""
    source, target = sys.argv[1:3]
    with open(source) as file:
        rows = steps(json.load(file))
    for label, level, remark in rows:
        print(f"{label:28} {level:6.2f}  {remark}")
    draw(rows, target)


if __name__ == "__main__":
    main()
