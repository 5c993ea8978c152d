"""Data of a machine's own page: its days."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from . import days, overview, verdict
from .complete_file import write_complete
from .days import Day

#: Folder of the pages in the results.
FOLDER = "page"


def write(results: Path, machine: str, rows: dict[str, Day], is_new: bool) -> None:
    """Write the data of a machine's page, where it is absent or the machine has new days."""
    path = results / FOLDER / "machines" / f"{machine}.js"
    if is_new or not path.is_file():
        write_complete(path, f"show({json.dumps(data(machine, rows), separators=(',', ':'))});\n")


def data(machine: str, rows: dict[str, Day]) -> dict[str, Any]:
    """Give what the page of a machine shows."""
    last = rows[max(rows)] if rows else {}
    return {
        "machine": machine,
        "name": last.get("name"),
        "description": last.get("description"),
        "sha256": last.get("description_sha256"),
        "days": [_day(day, rows[day]) for day in sorted(rows)],
        "faults": days.faults(rows),
    }


def _day(day: str, row: Day) -> dict[str, Any]:
    worst = verdict.worst(row["sensors"])
    used = sum(sensor["used"] for sensor in row["sensors"])
    load, damage = overview.damage_of(row)
    return {
        "day": day,
        "verdict": row["verdict"],
        "seconds": round(row["seconds"], 3),
        "valid": _percent(row["valid"], row["samples"]),
        "nis": round(sum(sensor["nis"] for sensor in row["sensors"]) / used, 4) if used else None,
        "sensor": worst and worst["name"],
        "contradicting": worst and round(100 * verdict.share(worst), 2),
        "loads": [[load["name"], load["unit"], load["lowest"], load["highest"]] for load in row["loads"]],
        "load": load,
        "damage": damage,
    }


def _percent(part: int, of: int) -> float | None:
    return round(100 * part / of, 2) if of else None
