# %% [markdown]
# # A torque from four gauges
#
# Four bridges on the torque arms of a test drive and one encoder give the torque of motor and brake. The bench is
# simulated: another plant than the estimator's model, with noise and gauges that are off.
# The tutorial docs/tutorial/four-gauges.md shows the same with a board.

# %%
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import loadtwin
import loadtwin.plot

folder = Path(tempfile.mkdtemp())
machine = loadtwin.Machine("examples/bench/machine.toml")
machine.loads

# %% [markdown]
# Two recordings with reference torques: one to fit the gauges, one to show what that is worth.

# %%
for name, seed in {"fit": 1, "validate": 2}.items():
    machine.simulate(folder / f"{name}.parquet", scenario="steps", duration_s=30, seed=seed, individual=7)

# %%
before = machine.evaluate(folder / "validate.parquet")
machine.calibrate(folder / "fit.parquet", output=folder / "calibrated.toml")
calibrated = loadtwin.Machine(folder / "calibrated.toml")
after = calibrated.evaluate(folder / "validate.parquet")
{load: [figures["loads"][load]["nmae_percent"]["full"] for figures in (before, after)] for load in machine.loads}

# %%
recording = pq.read_table(folder / "validate.parquet")
estimates, state = calibrated.replay(recording)
loadtwin.plot.loads(estimates)
loadtwin.plot.innovations(estimates)

# %% [markdown]
# The estimates are a table of Arrow: any library takes them.

# %%
table = pa.table(estimates)
inside = {}
for load in machine.loads:
    valid = table[f"{load}_fault"].to_numpy() == loadtwin.plot.NO_FAULT
    inside[load] = float(np.mean(valid))
inside

# %%
for load in machine.loads:
    error = [figures["loads"][load]["nmae_percent"]["full"] for figures in (before, after)]
    assert error[1] < error[0] and error[1] < 1.0, (load, error)
    assert inside[load] > 0.95, (load, inside)
