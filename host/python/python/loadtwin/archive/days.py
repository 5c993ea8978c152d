"""Table of the days of a machine: summary of each, and by what it was made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from .complete_file import complete

#: Name of the table in the folder of a machine.
TABLE = "days.parquet"

_COUNT = pa.int64()
_FLAGS = pa.map_(pa.string(), _COUNT)

_RECORDING = pa.struct(
    {
        "name": pa.string(),
        "samples": _COUNT,
        # Whether the estimator went on from the recording before, or began anew.
        "continued": pa.bool_(),
        "notes": pa.list_(pa.string()),
        "fault": pa.string(),
    }
)

_LOAD = pa.struct(
    {
        "name": pa.string(),
        "unit": pa.string(),
        "valid": _COUNT,
        "lowest": pa.float32(),
        "highest": pa.float32(),
        "sum": pa.float64(),
        "flags": _FLAGS,
        # By the S-N curve of the table of descriptions, since the first day.
        "damage": pa.float64(),
    }
)

_SENSOR = pa.struct(
    {
        "name": pa.string(),
        "compared": _COUNT,
        "contradicting": _COUNT,
        "used": _COUNT,
        # Sums over those used.
        "bias": pa.float64(),
        "nis": pa.float64(),
        "flags": _FLAGS,
    }
)

#: One row a day.
SCHEMA = pa.schema(
    {
        "day": pa.string(),
        "verdict": pa.string(),
        "samples": _COUNT,
        "valid": _COUNT,
        "seconds": pa.float64(),
        "loads": pa.list_(_LOAD),
        "sensors": pa.list_(_SENSOR),
        "recordings": pa.list_(_RECORDING),
        "fault": pa.string(),
        "name": pa.string(),
        "description": pa.string(),
        "description_sha256": pa.string(),
        "loadtwin": pa.string(),
        # Hash of all that the day was made from, and of the state after it.
        "made_from": pa.string(),
        "state_sha256": pa.string(),
    }
)

#: A day as a row of the table.
Day = dict[str, Any]


def read(folder: Path) -> dict[str, Day]:
    """Read the table of a machine; one that is absent or damaged has no days, which are made again."""
    try:
        table = pq.read_table(folder / TABLE, schema=SCHEMA, partitioning=None)
    except (OSError, pa.ArrowException):
        return {}
    days = table.to_pylist(maps_as_pydicts="strict")
    return {day["day"]: day for day in days}


def write(folder: Path, days: dict[str, Day]) -> None:
    """Write the table of a machine."""
    rows = [days[day] for day in sorted(days)]
    with complete(folder / TABLE) as part:
        pq.write_table(pa.Table.from_pylist(rows, SCHEMA), part, compression="zstd")


def faults(days: dict[str, Day]) -> list[dict[str, str]]:
    """List the faults of a machine's days and recordings."""
    found = []
    for day, row in sorted(days.items()):
        if row["fault"]:
            found.append({"day": day, "recording": "", "fault": row["fault"]})
        for recording in row["recordings"]:
            if recording["fault"]:
                found.append({"day": day, "recording": recording["name"], "fault": recording["fault"]})
    return found


def has_fault(row: Day) -> bool:
    """Whether the day or one of its recordings has a fault."""
    return bool(row["fault"]) or any(recording["fault"] for recording in row["recordings"])
