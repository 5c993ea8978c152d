"""Rates of `calibrate` and `diagnose` on benches that share no code with loadtwin.

    tests/foreign/benchmark.py LOADTWIN BENCHES SEED

Of each bench, calibrated on three recordings without an effect: one recording without an effect, two with one, one with
two or one outside the library. Prints each result and the rates with their 95 % intervals (Wilson), and of the
recordings without an effect how many errors the stated standard deviation holds.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import plant


def run(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    return done.stdout


def calibrated(loadtwin, bench, seed, folder):
    """The description after `calibrate` on recordings without an effect."""
    machine = bench.describe(folder)
    recordings = []
    for i, profile in enumerate(["constant", "cycle", "staircase"]):
        recordings.append(folder / f"calibration_{i}.parquet")
        plant.record(bench, profile, {}, seed + i, recordings[-1])
    run(loadtwin, "calibrate", machine, *recordings, "--error-bands", "-o", folder / "calibrated.toml")
    return folder / "calibrated.toml"


def diagnosed(loadtwin, machine, bench, effects, seed, folder):
    """Verdict and names of the effects."""
    profile = ["cycle", "staircase"][seed % 2]
    plant.record(bench, profile, effects, seed, folder / "recording.parquet")
    found = json.loads(run(loadtwin, "diagnose", machine, folder / "recording.parquet", "--json"))
    return found["verdict"], [effect["name"] for effect in found["effects"]]


def coverage(loadtwin, machine, folder):
    """Valid samples within two stated standard deviations [%], of each load with each set of sensors."""
    replayed = json.loads(run(loadtwin, "replay", machine, folder / "recording.parquet", "--all-sensors", "--json"))
    bands = [load["band"] for found in replayed["sets"] for load in found["loads"].values()]
    return [band["inside_percent"][1] for band in bands if band]


def interval(right, of):
    """Wilson's 95 % interval [%]."""
    if of == 0:
        return "-"
    z, p = 1.96, right / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return f"{100 * max(middle - half, 0):.0f} to {100 * min(middle + half, 1):.0f} %"


def main(loadtwin, benches, seed):
    kinds = [kind for kind in plant.NAMES if kind != "bursts"]
    rates, inside = {}, []

    def count(what, right):
        of = rates.setdefault(what, [0, 0])
        of[0] += bool(right)
        of[1] += 1

    for number in range(benches):
        rng = np.random.default_rng([seed, number])
        bench = plant.Bench([seed, number])
        own = 10_000 * seed + 100 * number
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            machine = calibrated(loadtwin, bench, own, folder)
            last = rng.choice(kinds, 2, replace=False) if number % 2 else ["bursts"]
            for i, drawn in enumerate([[], [rng.choice(kinds)], [rng.choice(kinds)], last]):
                effects = {str(kind): plant.draw(str(kind), rng) for kind in drawn}
                verdict, names = diagnosed(loadtwin, machine, bench, effects, own + 10 + i, folder)
                print(number, " ".join(effects) or "none", "->", verdict, " ".join(names), flush=True)
                fits = [plant.NAMES[kind] for kind in effects]
                exact = bool(names) and all(any(n in f for f in fits) for n in names)
                exact = exact and all(f & set(names) for f in fits)
                if not effects:
                    inside.extend(coverage(loadtwin, machine, folder))
                    count("no effect, given one or `unknown`", verdict != "none")
                elif "bursts" in effects:
                    count("outside the library, `unknown`", verdict == "unknown")
                elif len(effects) == 1:
                    count("one effect, named first", names and names[0] in fits[0])
                    count("one effect, named alone", exact)
                else:
                    count("two effects, exactly these", exact)
    print()
    rates["two-sigma band of a load holds 90 to 98 %"] = [sum(90 <= share <= 98 for share in inside), len(inside)]
    print("two-sigma band holds, median:", round(float(np.median(inside)), 1), "%")
    for what, (right, of) in rates.items():
        print(f"{what:40}{right:4} of {of:3}   {interval(right, of)}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
