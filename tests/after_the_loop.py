#!/usr/bin/env python3
"""The filter's error before and after the loop, a row for each effect.

usage: tests/after_the_loop.py INDIVIDUAL [EFFECT ...]

One simulated gearbox with one effect that no description declares: diagnosed on `reversals`,
tuned on a start-stop cycle, evaluated on another one. Writes a row of Markdown for each effect: what was
named, and for three gauges on each part of the housing the NMAE of the main shaft's torque [% of nominal]
as described; with what was found; tuned as well; and tuned only.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOADTWIN = ROOT / "target/release/loadtwin"
MACHINE = ROOT / "examples/gearbox/machine.toml"

SETS = {"torque-arm-3": "ta2", "ring-gear-3": "rg2", "high-speed-housing-3": "hsh2"}
OF_THE_MACHINE = [
    "gain-error", "gauge-position", "planet-sharing", "carrier-order", "viscous-friction",
    "coulomb-friction", "stribeck-friction", "presliding-hysteresis", "strain-nonlinearity",
    "gauge-creep", "thermal-drift", "thermal-gain", "load-friction", "bending-load", "backlash",
    "torsional-resonance", "torque-ripple", "encoder-eccentricity", "mains-pick-up",
]  # fmt: skip
OF_A_GAUGE = ["channel-delay", "gauge-step", "gauge-debonding", "dropped-bits", "stuck-values"]


def loadtwin(*arguments):
    said = subprocess.run(
        [LOADTWIN, "--json", *map(str, arguments)], check=True, capture_output=True, text=True
    )
    return json.loads(said.stdout) if said.stdout else {}


def errors(machine, recording, load):
    """NMAE of the load, for each set of three gauges."""
    nmae = {}
    for name in SETS:
        said = loadtwin("replay", machine, recording, "--sensors", name)
        nmae[name] = said["loads"][load]["nmae_percent"]["full"]
    return nmae


def tune(machine, recording, to):
    """The tuned description, or that as it is where tuning is not shown to be no worse."""
    try:
        loadtwin("tune", machine, recording, "--method", "likelihood", "-o", to)
    except subprocess.CalledProcessError:
        return machine
    return to


def loop(individual, effect, load, folder):
    """What was named, and the errors at each of the four stages."""

    def recorded(scenario, seed):
        path = folder / f"{seed}.parquet"
        effects = ["--effect", effect] if effect else []
        loadtwin(
            "simulate", MACHINE, "--scenario", scenario, "--seed", seed, "--individual", individual,
            "--duration-s", 90, *effects, "-o", path,
        )  # fmt: skip
        return path

    fitted = recorded("reversals", 100 + individual)
    tuning = recorded("start-stop", 200 + individual)
    unseen = recorded("start-stop", 300 + individual)
    found, tuned, only = folder / "found.toml", folder / "tuned.toml", folder / "only.toml"
    named = loadtwin("diagnose", MACHINE, fitted, "--out", found)
    if not found.exists():
        found = MACHINE
    tuned, only = (tune(machine, tuning, to) for machine, to in [(found, tuned), (MACHINE, only)])
    names = ", ".join(e["name"] for e in named["effects"]) or named["verdict"]
    stages = [errors(machine, unseen, load) for machine in (MACHINE, found, tuned, only)]
    return names, stages


def row(individual, effect):
    load = "main_shaft"
    name, _, shaft = effect.partition(" of ")
    if shaft:
        load = shaft
    named, cells, only = set(), [], []
    one = name in OF_A_GAUGE
    result = None
    for sensors, gauge in SETS.items():
        if one or result is None:
            given = f"{name}@{gauge}=1" if one else f"{name}=1" if name != "none" else ""
            with tempfile.TemporaryDirectory() as folder:
                result = loop(individual, given, load, Path(folder))
        names, stages = result
        named.add(names)
        *looped, alone = [stage[sensors] for stage in stages]
        cells.append("; ".join(f"{e:.2f}" for e in looped))
        only.append(f"{alone:.2f}")
    title = f"{name}, one gauge" if one else effect
    return f"| {title} | {' / '.join(sorted(named))} | {' | '.join(cells)} | {', '.join(only)} |"


def main():
    if len(sys.argv) < 2 or not sys.argv[1].isdigit():
        sys.exit(__doc__)
    subprocess.run(["cargo", "build", "--release", "--bins", "-q"], cwd=ROOT, check=True)
    individual = int(sys.argv[1])
    every = [*OF_THE_MACHINE, "load-friction of high_speed_shaft", *OF_A_GAUGE, "none"]
    for effect in sys.argv[2:] or every:
        print(row(individual, effect), flush=True)


if __name__ == "__main__":
    main()
