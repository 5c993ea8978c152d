"""Reference for host/math/src/metrics/spectra.rs: scipy's spectral density and coherence by Welch's method.

python3 spectra.py > spectra.json, with the packages of tests/requirements.txt
"""

import json

import numpy as np
import scipy
from scipy.signal import coherence, welch


def noise(state, count):
    """Uniform numbers of a linear congruential generator that the test repeats."""
    for _ in range(count):
        state = (1664525 * state + 1013904223) % 2**32
        yield state / 2**32


x, other = list(noise(1, 5000)), list(noise(2, 5000))
output, level = [], 0.0
for value in x:
    level = 0.6 * level + value
    output.append(level + 100.0)
inputs = [a + b for a, b in zip(x, other)]
options = {"fs": 500.0, "window": "hann", "nperseg": 1024, "noverlap": 512, "detrend": "constant"}
f, density = welch(np.array(output), **options)
_, both = coherence(np.array(output), np.array(inputs), **options)
json.dump(
    {"scipy": scipy.__version__, "f": f.tolist(), "density": density.tolist(), "coherence": both.tolist()},
    open(1, "w"),
)
