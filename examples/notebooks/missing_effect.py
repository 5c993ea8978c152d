# %% [markdown]
# # Find and mend a missing effect
#
# The gearbox of the test drive has friction that its description lacks. `diagnose` finds it and writes a
# description with it; a recording that took no part shows what it is worth.

# %%
import tempfile
from pathlib import Path

import loadtwin
import loadtwin.plot

folder = Path(tempfile.mkdtemp())
text = Path("examples/bench/machine.toml").read_text()
machine = loadtwin.Machine(text.replace("rate_hz = 2000", "rate_hz = 250"))

# %%
for name, seed in {"fit": 1, "validate": 2}.items():
    machine.simulate(
        folder / f"{name}.parquet", scenario="reversals", duration_s=30, seed=seed, effect="coulomb-friction"
    )

# %%
before = machine.evaluate(folder / "validate.parquet")
before["nis_mean"], {load: of["nmae_percent"]["full"] for load, of in before["loads"].items()}

# %% [markdown]
# NIS is near 1: a filter that estimates an unknown load absorbs the friction into the load. The reference shows it.

# %%
found = machine.diagnose(folder / "fit.parquet", output=folder / "better.toml")
found["verdict"], [effect["name"] for effect in found["effects"]]

# %%
better = loadtwin.Machine(folder / "better.toml")
after = better.evaluate(folder / "validate.parquet")
{load: of["nmae_percent"]["full"] for load, of in after["loads"].items()}

# %%
estimates, _ = better.replay(folder / "validate.parquet")
loadtwin.plot.loads(estimates)

# %%
assert [effect["name"] for effect in found["effects"]] == ["coulomb-friction"], found["effects"]
error = [figures["loads"]["motor_torque"]["nmae_percent"]["full"] for figures in (before, after)]
assert error[1] < 0.5 * error[0], error
