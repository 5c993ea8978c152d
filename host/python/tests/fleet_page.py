"""Pages of a fleet: python fleet_page.py FOLDER MACHINES.

Three simulated machines are replayed; the page then has so many rows, with names of their own.
"""

import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from simulated_archive import GEARBOX, add_machine, describe, recording

from loadtwin.archive import Options, outcome, run

archive, machines = Path(sys.argv[1]), int(sys.argv[2])
whole = recording(seed=1, seconds=24)
add_machine(archive, "g<b>1 & \"2'", whole, 4)
channel = whole.schema.get_field_index("ta1")
scaled = whole.set_column(channel, whole.schema.field(channel), pc.multiply(whole["ta1"], 1.5))
add_machine(archive, "scaled", scaled, 4)
add_machine(archive, "undescribed", whole, 2)
sn = '"1e4:5e5,2e6:1e5"'
names = ('"g<b>1 & ""2\'"', "scaled")
describe(
    archive,
    [f"{name},2026-01-01,{GEARBOX},main_shaft,{sn},-3e6:3e6" for name in names],
    "machine,from,description,load,sn,range",
)
done = run(archive, processes=1, options=Options())
results = Path(done["results"])
three = pq.read_table(results / outcome.MACHINES)
faults = pq.read_table(results / outcome.FAULTS)
copies = machines - len(three)
rows = three.take([k % len(three) for k in range(copies)])
rows = rows.set_column(0, "machine", pa.array([f"machine-{k}" for k in range(copies)]))
outcome.write_page(results / "page", pa.concat_tables([three, rows]), faults)
print(results / "page" / "index.html")
