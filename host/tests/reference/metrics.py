"""Reference for host/math/src/metrics: statsmodels' autocorrelation, scipy's chi-squared quantiles.

python3 -m venv V && V/bin/pip install statsmodels==0.15.0 scipy==1.17.1
V/bin/python metrics.py > metrics.json
"""

import json

import numpy as np
import scipy
import statsmodels
from scipy.stats import chi2
from statsmodels.tsa.stattools import acf

# First-order autoregression on a large mean, driven by a linear congruential generator that the
# test repeats.
x, state, value = [], 12345, 0.0
for _ in range(400):
    state = (1664525 * state + 1013904223) % 2**32
    value = 0.6 * value + state / 2**32
    x.append(value + 100.0)
x = np.array(x)
gaps = x.copy()
gaps[50:70] = np.nan
gaps[133] = np.nan

json.dump(
    {
        "statsmodels": statsmodels.__version__,
        "scipy": scipy.__version__,
        "whole": acf(x, nlags=25, adjusted=True, fft=False).tolist(),
        "gaps": acf(gaps, nlags=25, adjusted=True, fft=False, missing="conservative").tolist(),
        "chi_squared": [
            [p, k, float(chi2.ppf(p, k))]
            for p in (0.005, 0.025, 0.5, 0.975, 0.995)
            for k in (1, 2, 4, 15, 400, 1000, 5e6)
        ],
    },
    open(1, "w"),
    indent=1,
)
