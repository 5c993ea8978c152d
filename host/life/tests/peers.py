"""Counts load cycles by the peers: rainflow, fatpack, pylife and py-fatigue.

Reads sequences of levels, one JSON array a line. Prints for each a JSON object: for each peer the
half cycles of each range, the residue where it has one, and the equivalent load of one cycle for exponents
3, 4, 6.6, 9 and 12.
"""

import json
import sys
import warnings

import fatpack
import numpy as np
import pylife.stress.rainflow as pylife
import rainflow
from py_fatigue.cycle_count.rainflow import rainflow as py_fatigue

EXPONENTS = (3.0, 4.0, 6.6, 9.0, 12.0)


def result(ranges, counts, residue=None):
    """Of cycles and, where there is a residue, its ranges as half cycles."""
    ranges, counts = list(map(float, ranges)), list(map(float, counts))
    if residue is not None:
        steps = np.abs(np.diff(residue))
        ranges += list(steps)
        counts += [0.5] * len(steps)
    ranges, counts = np.array(ranges), np.array(counts)
    half = np.zeros(128)
    np.add.at(half, np.rint(ranges).astype(int), 2 * counts)
    return {
        "half_cycles": half.tolist(),
        "residue": None if residue is None else [float(x) for x in residue],
        "equivalent": [float((counts @ ranges**m) ** (1 / m)) for m in EXPONENTS],
    }


def by_rainflow(x):
    cycles = [(rng, count) for rng, _, count, _, _ in rainflow.extract_cycles(x)]
    return result(*zip(*cycles))


def by_fatpack(x):
    # Its classes are finer than the levels by 64: rounding gives the levels back.
    reversals, _ = fatpack.find_reversals(x, k=64 * 128)
    cycles, residue = fatpack.find_rainflow_cycles(np.rint(reversals))
    ranges = np.abs(cycles[:, 1] - cycles[:, 0]) if len(cycles) else []
    return result(ranges, np.ones(len(ranges)), residue)


def by_pylife(x):
    recorder = pylife.LoopValueRecorder()
    detector = pylife.FourPointDetector(recorder=recorder).process(x)
    ranges = np.abs(np.array(recorder.values_to) - np.array(recorder.values_from))
    return result(ranges, np.ones(len(ranges)), detector.residuals)


def by_py_fatigue(x):
    # Columns: half range, mean, count, and where it is.
    cycles = py_fatigue(x, method="astm", extended_output=False)
    return result(2 * cycles[:, 0], cycles[:, 2])


PEERS = {
    "rainflow": by_rainflow,
    "fatpack": by_fatpack,
    "pylife": by_pylife,
    "py-fatigue": by_py_fatigue,
}

warnings.simplefilter("ignore")
for line in sys.stdin:
    levels = np.array(json.loads(line), dtype=float)
    print(json.dumps({name: count(levels) for name, count in PEERS.items()}))
