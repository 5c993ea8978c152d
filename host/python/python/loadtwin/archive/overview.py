"""A machine in one row: its state, its figures, its faults."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from . import days, verdict
from .days import Day

_FAULT = pa.struct({"day": pa.string(), "recording": pa.string(), "fault": pa.string()})

#: A row for each machine, with its faults.
SCHEMA = pa.schema(
    {
        "machine": pa.string(),
        "name": pa.string(),
        # State on the last day with samples, and the first day of it.
        "verdict": pa.string(),
        "since": pa.string(),
        "days": pa.int64(),
        "replayed_days": pa.int64(),
        "first_day": pa.string(),
        "last_day": pa.string(),
        "samples": pa.int64(),
        "seconds": pa.float64(),
        "valid_percent": pa.float64(),
        # Of all days and sensors, 1 in a consistent filter.
        "nis": pa.float64(),
        # On the last day with samples, of the sensor that contradicts most.
        "sensor": pa.string(),
        "contradicting_percent": pa.float64(),
        "bias": pa.float64(),
        "contradicting_days": pa.int64(),
        "load": pa.string(),
        "damage": pa.float64(),
        # Recorded time until the damage is 1, at the mean rate so far [s].
        "remaining_s": pa.float64(),
        "description": pa.string(),
        "recordings": pa.list_(pa.string()),
        "faults": pa.list_(_FAULT),
    }
)

Overview = dict[str, Any]


def of(machine: str, rows: dict[str, Day], replayed: int) -> Overview:
    """Sum up the days of a machine.

    Parameters
    ----------
    machine : str
        Its name in the archive.
    rows : dict of str to dict
        Its days.
    replayed : int
        Days that were replayed in this run.

    Returns
    -------
    dict
        A row of `SCHEMA`.
    """
    order = sorted(rows)
    with_samples = [day for day in order if rows[day]["samples"]]
    last = rows[with_samples[-1]] if with_samples else None
    samples = sum(row["samples"] for row in rows.values())
    sensors = [sensor for row in rows.values() for sensor in row["sensors"]]
    used = sum(sensor["used"] for sensor in sensors)
    worst = verdict.worst(last["sensors"]) if last else None
    load, damage = damage_of(last)
    state = last["verdict"] if last else "no data"
    return {
        "machine": machine,
        "name": last and last["name"],
        "verdict": state,
        "since": _since(rows, with_samples, state),
        "days": len(rows),
        "replayed_days": replayed,
        "first_day": order[0] if order else None,
        "last_day": order[-1] if order else None,
        "samples": samples,
        "seconds": sum(row["seconds"] for row in rows.values()),
        "valid_percent": 100.0 * sum(row["valid"] for row in rows.values()) / samples if samples else None,
        "nis": sum(sensor["nis"] for sensor in sensors) / used if used else None,
        "sensor": worst and worst["name"],
        "contradicting_percent": worst and 100.0 * verdict.share(worst),
        "bias": worst["bias"] / worst["used"] if worst and worst["used"] else None,
        "contradicting_days": sum(row["verdict"] == "contradicts" for row in rows.values()),
        "load": load,
        "damage": damage,
        "remaining_s": remaining_s(load, damage, rows),
        "description": last and last["description"],
        "recordings": [
            f"recordings/machine={machine}/day={with_samples[-1]}/{recording['name']}"
            for recording in (last["recordings"] if last else [])
            if recording["samples"]
        ],
        "faults": days.faults(rows),
    }


def failed(machine: str, fault: str) -> Overview:
    """Give the row of a machine that could not be replayed at all."""
    empty = of(machine, {}, 0)
    return {**empty, "faults": [{"day": "", "recording": "", "fault": fault}]}


def damage_of(row: Day | None) -> tuple[str | None, float | None]:
    """Give the load that is counted on a day, and its damage."""
    for load in row["loads"] if row else []:
        if load["damage"] is not None:
            return load["name"], load["damage"]
    return None, None


def remaining_s(load: str | None, damage: float | None, rows: dict[str, Day]) -> float | None:
    """Give the recorded time until the damage is 1, at the mean rate of the days so far [s].

    ``T (1 - D) / D`` with the damage ``D`` after the time ``T``; 0 where the damage is 1 or more, and
    none where there is no damage (Palmgren 1924, Miner 1945: linear accumulation).
    """
    if not damage:
        return None
    counted_s = sum(row["seconds"] for row in rows.values() if any(each["name"] == load for each in row["loads"]))
    return counted_s * max(0.0, 1.0 - damage) / damage


def _since(rows: dict[str, Day], with_samples: list[str], state: str) -> str | None:
    since = None
    for day in reversed(with_samples):
        if rows[day]["verdict"] != state:
            break
        since = day
    return since
