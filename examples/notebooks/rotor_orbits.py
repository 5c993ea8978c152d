# %% [markdown]
# # A rotor's orbits
#
# Displacement sensors at two nodes near the bearings give the forces of unbalance at the discs and the displacement
# at every node, also in the middle, where no sensor is.

# %%
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import loadtwin
import loadtwin.plot

folder = Path(tempfile.mkdtemp())
machine = loadtwin.Machine("examples/rotor/machine.toml")
machine.simulate(folder / "rotor.parquet", duration_s=3, seed=1)

# %%
figures = machine.evaluate(folder / "rotor.parquet", estimates=folder / "estimates.parquet", nodes="12,18,23")
{load: of["nmae_percent"] for load, of in figures["loads"].items()}

# %%
table = pq.read_table(folder / "estimates.parquet")
loadtwin.plot.orbits(table, [12, 18, 23], turns_from_s=2.5)

# %% [markdown]
# The radius of the orbit at the middle, and its standard deviation by the filter.

# %%
settled = table["t"].to_numpy() > 2.5
x, y, std = (1e6 * table[f"node18_{name}"].to_numpy()[settled] for name in ("x", "y", "x_std"))
radius, deviation = float(np.hypot(x, y).mean()), float(std.mean())
radius, deviation

# %%
assert all(of["nmae_percent"]["full"] < 1.0 for of in figures["loads"].values()), figures["loads"]
assert 1.0 < radius < 1000.0 and deviation < 0.05 * radius, (radius, deviation)
