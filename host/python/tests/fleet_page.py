"""Writes the page of a fleet for a test in a browser: python fleet_page.py FOLDER MACHINES. Prints its path.

Three simulated machines are replayed; the page then has so many rows, with names of their own.
"""

import json
import sys
from pathlib import Path

import pyarrow.compute as pc
from simulated_archive import GEARBOX, add_machine, describe, recording

from loadtwin.archive import Options, run

archive, machines = Path(sys.argv[1]), int(sys.argv[2])
whole = recording(seed=1, seconds=24)
add_machine(archive, "g<b>1 & \"2'", whole, 4)
channel = whole.schema.get_field_index("ta1")
scaled = whole.set_column(channel, whole.schema.field(channel), pc.multiply(whole["ta1"], 1.5))
add_machine(archive, "scaled", scaled, 4)
add_machine(archive, "undescribed", whole, 2)
sn = '"1e4:5e5,2e6:1e5"'
names = ('"g<b>1 & ""2\'"', "scaled")
(archive / "design.csv").write_text("range,cycles_per_hour\n2e5,30\n")
describe(
    archive,
    [f"{name},2026-01-01,{GEARBOX},main_shaft,{sn},-3e6:3e6,design.csv" for name in names],
    "machine,from,description,load,sn,range,design",
)
done = run(archive, processes=1, options=Options())
results = Path(done["results"])
fleet = results / "page" / "fleet.js"
begin, end = "const fleet = ", ";\n"
three = json.loads(fleet.read_text().removeprefix(begin).removesuffix(end))
copies = machines - done["machines"]
rows = {name: column + [column[k % len(column)] for k in range(copies)] for name, column in three.items()}
rows["machine"] = three["machine"] + [f"machine-{k}" for k in range(copies)]
fleet.write_text(f"{begin}{json.dumps(rows)}{end}")
print(results / "page" / "index.html")
