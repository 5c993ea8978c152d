# %% [markdown]
# # From load to damage
#
# The torque of a gearbox, estimated from gauges on its housing, counted by rainflow. The recording comes in pieces, as
# from a logger that begins a new file every minute: the state goes from one to the next, so that the estimates
# are those of the whole, bit for bit.

# %%
import tempfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

import loadtwin
import loadtwin.plot

folder = Path(tempfile.mkdtemp())
machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
recording = pq.read_table("examples/gearbox/start-stop.parquet")
rows = int(60 * machine.rate_hz)

# %%
pieces, state = [], None
for start in range(0, len(recording), rows):
    last = start + rows >= len(recording)
    piece, state = machine.replay(recording[start : start + rows], state, more=not last)
    pieces.append(pa.table(piece))
estimates = pa.concat_tables(pieces)
len(pieces), len(state)

# %%
loadtwin.plot.loads(estimates)

# %%
life = machine.life(estimates, load="main_shaft", sn=[(1e4, 5e5), (2e6, 1e5)])
loadtwin.plot.cycles(life, "main_shaft")
found = life["loads"]["main_shaft"]
found["damage_equivalent_load"], found["damage"]

# %% [markdown]
# The measured torque, which this recording has, counted the same way.

# %%
reference = "torque_main"
measured = machine.life(recording, load=reference)
measured["loads"][reference]["damage_equivalent_load"]

# %%
whole, _ = machine.replay(recording)
assert pa.table(whole).combine_chunks().equals(estimates.combine_chunks())
assert found["damage"] and found["damage_equivalent_load"]["3"] > 0
