#!/usr/bin/env python3
"""Draws docs/picture.svg from what the command prints: docs/picture.py [LOADTWIN]

The signal of a strain gauge becomes a torque with its 2-sigma band, before and after `diagnose` added the friction
that the model lacked. The recording is simulated; the reference is the torque of the simulated plant.
"""

import csv
import math
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOADTWIN = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/release/loadtwin").resolve()
POINTS = 220
# Fault code of a load that is valid (docs/wire-format.md).
NO_FAULT = 31
WIDTH, LEFT, RIGHT = 760, 58, 8
STYLE = """
text{font:12px system-ui,sans-serif;fill:#24292f}.axis{stroke:#8c959f;stroke-width:.7;fill:none}
.gauge{stroke:#57606a}.truth{stroke:#24292f;stroke-dasharray:5 4}.before{stroke:#bc4c00}.after{stroke:#0969da}
.line{fill:none;stroke-width:1.6}.band{stroke:none;opacity:.25}.band.before{fill:#bc4c00}.band.after{fill:#0969da}
text.truth{stroke:none}text.before{fill:#bc4c00;stroke:none}text.after{fill:#0969da;stroke:none}
@media(prefers-color-scheme:dark){text{fill:#e6edf3}.gauge{stroke:#9198a1}.truth{stroke:#e6edf3}.axis{stroke:#656c76}
.before{stroke:#f0883e}.after{stroke:#58a6ff}.band.before{fill:#f0883e}.band.after{fill:#58a6ff}
text.before{fill:#f0883e}text.after{fill:#58a6ff}}
"""


def columns(path):
    """Columns of a CSV file without their units, thinned out to the points drawn."""
    with open(path, newline="") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        names = [name.split(" [")[0] for name in next(rows)]
        table = list(rows)
    table = table[:: max(1, len(table) // POINTS)]
    return {name: [float(row[k] or "nan") for row in table] for k, name in enumerate(names)}


def recordings(folder):
    """The recording, and the estimates with the description as given and as improved."""
    def loadtwin(*arguments):
        subprocess.run([LOADTWIN, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)

    text = (ROOT / "examples/bench/machine.toml").read_text()
    (folder / "bench.toml").write_text(text.replace("rate_hz = 2000", "rate_hz = 500", 1))
    hidden = ["--effect", "coulomb-friction=5"]
    loadtwin("simulate", "bench.toml", "--scenario", "reversals", "--duration-s", "40", *hidden, "-o", "fit.csv")
    loadtwin("simulate", "bench.toml", "--seed", "2", *hidden, "-o", "test.csv")
    loadtwin("diagnose", "bench.toml", "fit.csv", "--output", "better.toml")
    loadtwin("replay", "bench.toml", "test.csv", "--estimates", "before.csv")
    loadtwin("replay", "better.toml", "test.csv", "--estimates", "after.csv")
    return [columns(folder / name) for name in ("test.csv", "before.csv", "after.csv")]


class Panel:
    """A plot with its own vertical scale, between two heights of the picture."""

    def __init__(self, top, bottom, time, low, high):
        self.top, self.bottom, self.time, self.low, self.high = top, bottom, time, low, high

    def x(self, t):
        return LEFT + (WIDTH - LEFT - RIGHT) * t / self.time[-1]

    def y(self, value):
        value = min(max(value, self.low), self.high)
        return self.bottom - (self.bottom - self.top) * (value - self.low) / (self.high - self.low)

    def points(self, times, values):
        return " ".join(f"{self.x(t):.1f},{self.y(v):.1f}" for t, v in zip(times, values) if v == v)

    def line(self, kind, values):
        return f'<polyline class="line {kind}" points="{self.points(self.time, values)}"/>'

    def band(self, kind, values, stds):
        upper = self.points(self.time, [v + 2 * s for v, s in zip(values, stds)])
        lower = self.points(self.time[::-1], [v - 2 * s for v, s in zip(values, stds)][::-1])
        return f'<polygon class="band {kind}" points="{upper} {lower}"/>'

    def axes(self, ticks, label):
        out = [f'<text x="0" y="{self.top - 8}">{label}</text>']
        for value in ticks:
            y = self.y(value)
            out.append(f'<path class="axis" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
            out.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value}</text>')
        return "".join(out)


def main():
    with tempfile.TemporaryDirectory() as folder:
        recording, before, after = recordings(Path(folder))
    time = recording["t"]
    gauge = Panel(24, 104, time, -100, 320)
    torque = Panel(140, 372, time, -400, 660)
    body = [gauge.axes((0, 300), "strain of a gauge [µm/m]"), gauge.line("gauge", recording["left_upper"])]
    body.append(torque.axes((-300, 0, 300, 600), "torque of the motor [Nm]"))
    for kind, estimate in (("before", before), ("after", after)):
        flagged = estimate["motor_torque_fault"]
        torques = [value if fault == NO_FAULT else math.nan for value, fault in zip(estimate["motor_torque"], flagged)]
        body.append(torque.band(kind, torques, estimate["motor_torque_std"]))
        body.append(torque.line(kind, torques))
    body.append(torque.line("truth", recording["motor_flange"]))
    for t in (0, 30, 60, 90):
        anchor = "end" if t == 90 else "middle"
        body.append(f'<text x="{min(torque.x(t), WIDTH):.0f}" y="390" text-anchor="{anchor}">{t} s</text>')
    legend = (("truth", "reference"), ("before", "estimate, 2 sigma, friction unknown"), ("after", "friction added"))
    for (kind, label), x in zip(legend, (190, 310, 590)):
        body.append(f'<path class="line {kind}" d="M{x} 128h24"/><text class="{kind}" x="{x + 30}" y="132">{label}</text>')
    title = "A strain signal becomes a torque with its 2-sigma band, before and after diagnose added a missing friction"
    (ROOT / "docs/picture.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 398" role="img" aria-label="{title}">'
        f"<title>{title}</title><style>{STYLE.strip()}</style>{''.join(body)}</svg>\n"
    )


if __name__ == "__main__":
    main()
