#!/usr/bin/env python3
"""Draws docs/signatures.svg: what each effect changes in a recording. docs/signatures.py [LOADTWIN]

Each machine is simulated with and without the effect, with the same individual and the same noise: the difference of
the two recordings is the effect alone, here of the channel that differs most.
"""

import csv
import math
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOADTWIN = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/release/loadtwin").resolve()
POINTS = 240
COLUMNS, WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 3, 250, 168, 52, 24, 34
# Effect, machine, scenario, channels that may differ, horizontal axis, from when to when [s].
BALANCE, GAUGES, ENCODER = ("Nm",), ("µm/m",), ("counts",)
SIGNATURES = [
    ("coulomb-friction", "bench", "reversals", BALANCE, "speed", 0, 30),
    ("stribeck-friction", "bench", "reversals", BALANCE, "speed", 0, 30),
    ("viscous-friction", "bench", "reversals", BALANCE, "speed", 0, 30),
    ("presliding-hysteresis", "bench", "reversals", BALANCE, "speed", 0, 30),
    ("load-friction", "gearbox", "torque-ramps", BALANCE, "torque", 0, 60),
    ("torque-ripple", "gearbox", "constant", BALANCE, "time", 40, 41),
    ("gain-error", "bench", "torque-ramps", GAUGES, "torque", 0, 60),
    ("strain-nonlinearity", "bench", "torque-ramps", GAUGES, "torque", 0, 60),
    ("gauge-debonding", "bench", "torque-ramps", GAUGES, "torque", 0, 60),
    ("carrier-order", "gearbox", "constant", GAUGES, "angle", 30, 60),
    ("gauge-position", "gearbox", "constant", GAUGES, "angle", 30, 60),
    ("planet-sharing", "gearbox", "constant", GAUGES, "angle", 30, 60),
    ("peak-overestimated", "gearbox", "constant", GAUGES, "angle", 30, 60),
    ("encoder-eccentricity", "gearbox", "constant", ENCODER, "angle", 30, 60),
    ("gauge-creep", "bench", "steps", GAUGES, "time", 0, 60),
    ("thermal-drift", "bench", "constant", GAUGES, "time", 0, 60),
    ("gauge-offset", "bench", "constant", GAUGES, "time", 0, 60),
    ("gauge-step", "bench", "constant", GAUGES, "time", 0, 60),
    ("bending-load", "bench", "constant", GAUGES, "time", 0, 60),
    ("channel-delay", "bench", "reversals", GAUGES, "time", 0, 30),
    ("bursts", "bench", "constant", GAUGES, "time", 0, 60),
    ("mains-pick-up", "bench", "constant", GAUGES, "time", 20, 20.1),
    ("dropped-bits", "bench", "constant", GAUGES, "time", 20, 30),
    ("stuck-values", "bench", "reversals", GAUGES, "time", 0, 60),
]
AXES = {"speed": "speed [rad/s]", "torque": "torque [Nm]", "angle": "angle [°]", "time": "time [s]"}
STYLE = """
text{font:11px system-ui,sans-serif;fill:#24292f}.name{font-weight:600}.frame{stroke:#8c959f;stroke-width:.7;fill:none}
.points{stroke:#0969da;stroke-width:2;stroke-linecap:round;fill:none}.zero{stroke:#8c959f;stroke-dasharray:3 3}
@media(prefers-color-scheme:dark){text{fill:#e6edf3}.frame,.zero{stroke:#656c76}.points{stroke:#58a6ff}}
"""


def recording(folder, machine, scenario, seconds, effect=None):
    """Columns by name and unit."""
    path = Path(folder) / "recording.csv"
    added = ["--effect", effect] if effect else []
    subprocess.run(
        [LOADTWIN, "simulate", ROOT / "examples" / machine / "machine.toml", "--scenario", scenario, "--seed", "1",
         "--individual", "1", "--duration-s", str(seconds), "-o", path, "--force", *added],
        check=True, stdout=subprocess.DEVNULL,
    )
    with open(path, newline="") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        names = [tuple(name.rstrip("]").split(" [")) for name in next(rows)]
        table = {name: [float(cell or "nan") for cell in column] for name, column in zip(names, zip(*rows))}
    return {
        (name, "µm/m" if unit == "m/m" else unit): [1e6 * v for v in column] if unit == "m/m" else column
        for (name, unit), column in table.items()
    }


def abscissa(columns, machine, axis):
    """Values of the horizontal axis: by the first encoder, and by the first reference load."""
    t = columns["t", "s"]
    if axis == "time":
        return t
    if axis == "torque":
        return columns[next(key for key in columns if key[1] in BALANCE)]
    encoder = tomllib.loads((ROOT / "examples" / machine / "machine.toml").read_text())["encoder"][0]
    lines = encoder["counts_per_turn"]
    counts = next(column for key, column in columns.items() if key[1] == "counts")
    turns, last = [0.0], counts[0]
    for count in counts[1:]:
        step = (count - last + lines / 2) % lines - lines / 2
        turns.append(turns[-1] + step / lines)
        last = count
    if axis == "angle":
        return [360 * (turn % 1) for turn in turns]
    reach = 20
    rate = lambda i, k: 2 * math.pi * (turns[k] - turns[i]) / (t[k] - t[i])
    return [rate(max(i - reach, 0), min(i + reach, len(t) - 1)) for i in range(len(t))]


def largest(before, after, units):
    """Unit and difference of the channel of these units that differs most."""
    found = []
    for key, column in before.items():
        if key[1] in units:
            difference = [b - a for a, b in zip(column, after[key])]
            found.append((sum(d * d for d in difference if d == d), key[1], difference))
    return max(found)[1:]


def number(value):
    thousands = abs(value) >= 5000
    text = f"{value / 1000:.0f}k" if thousands else f"{value:.3g}"
    return text.replace("-", "−")


def panel(k, name, x, y, axis, unit):
    left, top = WIDTH * (k % COLUMNS) + LEFT, HEIGHT * (k // COLUMNS) + TOP
    wide, high = WIDTH - LEFT - 12, HEIGHT - TOP - BOTTOM
    # Of a difference that is 0 at times the others say what it is.
    pairs = [(a, b) for a, b in zip(x, y) if b == b]
    pairs = pairs[:: max(1, len(pairs) // POINTS)] + sorted(pairs, key=lambda p: -abs(p[1]))[:20]
    low, high_x = min(p[0] for p in pairs), max(p[0] for p in pairs)
    least, most = min(0, min(p[1] for p in pairs)), max(0, max(p[1] for p in pairs))
    across = lambda a: left + wide * (a - low) / (high_x - low)
    up = lambda b: top + high * (most - b) / (most - least)
    points = "".join(f"M{across(a):.0f} {up(b):.0f}h0" for a, b in dict.fromkeys((a, b) for a, b in pairs))
    texts = [
        (left, top - 8, "start", name, ' class="name"'), (left - 4, top + 9, "end", number(most), ""),
        (left - 4, top + high, "end", number(least), ""), (left - 4, top + high / 2 + 4, "end", unit, ""),
        (left, top + high + 14, "start", number(low), ""), (left + wide, top + high + 14, "end", number(high_x), ""),
        (left + wide / 2, top + high + 14, "middle", AXES[axis], ""),
    ]
    drawn = "".join(f'<text x="{a:.0f}" y="{b:.0f}" text-anchor="{c}"{e}>{d}</text>' for a, b, c, d, e in texts)
    return (f'<rect class="frame" x="{left}" y="{top}" width="{wide}" height="{high}"/>'
            f'<path class="zero" d="M{left} {up(0):.0f}h{wide}"/><path class="points" d="{points}"/>{drawn}\n')


def main():
    drawn, without = "", {}
    with tempfile.TemporaryDirectory() as folder:
        for k, (name, machine, scenario, units, axis, start, end) in enumerate(SIGNATURES):
            case = machine, scenario, max(math.ceil(end), 30)
            if case not in without:
                without[case] = recording(folder, *case)
            before, after = without[case], recording(folder, *case, name)
            unit, difference = largest(before, after, units)
            rows = zip(before["t", "s"], abscissa(before, machine, axis), difference)
            kept = [(x, y) for t, x, y in rows if start <= t <= end and x == x]
            drawn += panel(k, name, *zip(*kept), axis, unit)
    height = HEIGHT * math.ceil(len(SIGNATURES) / COLUMNS)
    (ROOT / "docs/signatures.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {COLUMNS * WIDTH} {height}"><title>What each effect '
        f"changes in a recording</title><style>{STYLE}</style>\n{drawn}</svg>\n"
    )


main()
