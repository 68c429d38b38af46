#!/usr/bin/env python3
"""Draws docs/pictures/simulate.svg from a simulated CSV: command, carriage and striker along x over time.

usage: make_simulation_picture.py SIMULATION.csv FROM TO OUT.svg   (FROM and TO in seconds)
"""

import csv
import sys

WIDTH, HEIGHT = 860, 470
LEFT, RIGHT, TOP, GAP, BOTTOM = 70, 24, 34, 56, 42
PLOT = (HEIGHT - TOP - GAP - BOTTOM) // 2
TEXT, GRID = "#24292f", "#d8dee4"
VELOCITY = [
    ("command_vx_m_per_s", "command", "#6e7781"),
    ("carriage_vx_m_per_s", "carriage (encoders)", "#0969da"),
]
POSITION = [
    ("carriage_x_m", "carriage (encoders)", "#0969da"),
    ("striker_x_m", "striker (camera)", "#bc4c00"),
]


def ticks(low, high):
    """Round values between low and high, about five of them."""
    step = 10.0 ** -6
    while True:
        for factor in (1, 2, 5):
            if (high - low) / (step * factor) <= 6:
                step *= factor
                first = -int(-low // step)
                count = int((high - step * first) / step + 1e-9) + 1
                return [step * (first + k) for k in range(count)]
        step *= 10


def panel(rows, columns, top, label, span):
    values = [row[name] for row in rows for name, _, _ in columns]
    low, high = min(values), max(values)
    margin = 0.08 * (high - low or 1.0)
    low, high = low - margin, high + margin
    x = lambda t: LEFT + (t - span[0]) / (span[1] - span[0]) * (WIDTH - LEFT - RIGHT)
    y = lambda v: top + PLOT - (v - low) / (high - low) * PLOT
    parts = []
    for value in ticks(low, high):
        parts.append(f'<path d="M{LEFT} {y(value):.1f}H{WIDTH - RIGHT}" stroke="{GRID}"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.6g}</text>')
    for value in ticks(*span):
        parts.append(f'<path d="M{x(value):.1f} {top}V{top + PLOT}" stroke="{GRID}"/>')
        parts.append(f'<text x="{x(value):.1f}" y="{top + PLOT + 18}" text-anchor="middle">{value:.6g}</text>')
    for name, _, color in columns:
        points = "L".join(f"{x(row['time_s']):.1f} {y(row[name]):.1f}" for row in rows)
        parts.append(f'<path d="M{points}" fill="none" stroke="{color}" stroke-width="1.8"/>')
    parts.append(f'<text x="{LEFT}" y="{top - 10}">{label}</text>')
    at = WIDTH - RIGHT
    for _, name, color in reversed(columns):
        at -= 7 * len(name) + 56
        parts.append(f'<path d="M{at} {top - 14}h22" stroke="{color}" stroke-width="3"/>')
        parts.append(f'<text x="{at + 28}" y="{top - 10}">{name}</text>')
    return parts


def main():
    path, start, end, out = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
    with open(path, newline="", encoding="utf-8") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    rows = [row for row in rows if start <= row["time_s"] <= end]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'role="img" font-family="system-ui, Helvetica, Arial, sans-serif" font-size="13" fill="{TEXT}">',
        "<title>Simulated velocity and position along x</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
    ]
    parts += panel(rows, VELOCITY, TOP, "velocity along x (m/s)", (start, end))
    parts += panel(rows, POSITION, TOP + PLOT + GAP, "position along x (m)", (start, end))
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) // 2}" y="{HEIGHT - 6}" text-anchor="middle">time (s)</text></svg>')
    with open(out, "w", encoding="utf-8") as file:
        file.write("\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
