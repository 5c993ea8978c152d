"""Tables and pages of all machines, written at the end of a run."""

from __future__ import annotations

import collections
import csv
import io
import json
import time
from importlib import resources
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from . import verdict
from .complete_file import complete, write_complete
from .machine_page import FOLDER
from .options import Options
from .overview import SCHEMA

#: Tables in the folder of the results.
MACHINES, FAULTS, CONTRADICTING = "machines.parquet", "faults.parquet", "contradicting.csv"

_FAULTS = pa.schema({"machine": pa.string(), "day": pa.string(), "recording": pa.string(), "fault": pa.string()})

#: Columns of the fleet's page, as they are in its data.
_PAGE = (
    ("machine", None), ("verdict", None), ("since", None), ("last_day", None), ("seconds", 1), ("valid_percent", 2),
    ("nis", 3), ("sensor", None), ("contradicting_percent", 2), ("damage", None),
    ("remaining_s", 0),
)  # fmt: skip


def write(results: Path, machines: pa.Table, options: Options, began: float) -> dict[str, Any]:
    """Write the tables and the page of all machines.

    Parameters
    ----------
    results : Path
        Folder of the results.
    machines : pyarrow.Table
        A row of :data:`overview.SCHEMA` for each machine, in any order.
    options : Options
    began : float
        Begin of the run, of ``time.monotonic``.

    Returns
    -------
    dict
        Figures of the run.
    """
    machines = machines.cast(SCHEMA).sort_by("machine")
    lists = machines.drop_columns(["faults", "recordings"])
    with complete(results / MACHINES) as part:
        pq.write_table(lists, part, compression="zstd")
    faults = _faults(machines)
    with complete(results / FAULTS) as part:
        pq.write_table(faults, part, compression="zstd")
    write_complete(results / CONTRADICTING, _contradicting(machines))
    if options.page:
        write_page(results / FOLDER, lists, faults)
    counted = collections.Counter(machines["verdict"].to_pylist())
    return {
        "machines": machines.num_rows,
        "days": pc.sum(machines["days"]).as_py() or 0,
        "replayed_days": pc.sum(machines["replayed_days"]).as_py() or 0,
        "samples": pc.sum(machines["samples"]).as_py() or 0,
        "verdicts": {name: counted.get(name, 0) for name in verdict.VERDICTS},
        "faults": faults.num_rows,
        "seconds": round(time.monotonic() - began, 3),
        "results": str(results),
    }


def _faults(machines: pa.Table) -> pa.Table:
    rows = [
        {"machine": machine, **fault}
        for machine, faults in zip(machines["machine"].to_pylist(), machines["faults"].to_pylist())
        for fault in faults
    ]
    return pa.Table.from_pylist(rows, _FAULTS)


def _contradicting(machines: pa.Table) -> str:
    """Machines whose innovations contradict their description, with what `diagnose` needs."""
    text = io.StringIO()
    columns = ("machine", "since", "sensor", "contradicting_percent", "bias", "nis", "description", "recordings")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in machines.filter(pc.equal(machines["verdict"], "contradicts")).to_pylist():
        row["recordings"] = " ".join(row["recordings"])
        cells = (row[name] for name in columns)
        writer.writerow([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in cells])
    return text.getvalue()


def write_page(folder: Path, machines: pa.Table, faults: pa.Table) -> None:
    """Write the page of the fleet and the frame of the machines' own pages.

    Parameters
    ----------
    folder : Path
        Folder of the pages.
    machines : pyarrow.Table
        A row for each machine.
    faults : pyarrow.Table
        All faults.
    """
    counted = collections.Counter(faults["machine"].to_pylist())
    columns = {}
    for name, digits in _PAGE:
        values = machines[name].to_pylist()
        if digits is not None:
            values = [None if value is None else round(value, digits) for value in values]
        columns[name] = values
    columns["faults"] = [counted.get(machine, 0) for machine in columns["machine"]]
    write_complete(folder / "fleet.js", f"const fleet = {json.dumps(columns, separators=(',', ':'))};\n")
    for page in resources.files(__package__).joinpath("page").iterdir():
        if page.is_file():
            write_complete(folder / page.name, page.read_bytes())
