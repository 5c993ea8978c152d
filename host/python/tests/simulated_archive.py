"""Makes archives of simulated gearboxes, and hashes what runs over them have made: python simulated_archive.py
FOLDER MACHINES DAYS SECONDS.
"""

import concurrent.futures
import datetime
import hashlib
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as pq

import loadtwin

GEARBOX = Path("examples/gearbox/machine.toml").absolute()
FIRST = datetime.date(2026, 11, 1)
HEADER = "machine,from,description"


def day_name(number):
    return (FIRST + datetime.timedelta(number)).isoformat()


def day_folder(archive, machine, number):
    folder = Path(archive) / "recordings" / f"machine={machine}" / f"day={day_name(number)}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def recording(seed, seconds, description=GEARBOX):
    """One recording of a gearbox of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.parquet"
        loadtwin.Machine(description).simulate(path, scenario="turbulent", duration_s=seconds, seed=seed)
        return pq.read_table(path)


def add_machine(archive, machine, whole, days):
    """Cut a recording into days."""
    rows = len(whole) // days
    for day in range(days):
        pq.write_table(whole[day * rows : (day + 1) * rows], day_folder(archive, machine, day) / "rec.parquet")


def describe(archive, rows, header=HEADER):
    Path(archive, "descriptions.csv").write_text("\n".join([header, *rows]) + "\n")


def _machine(work):
    archive, number, days, seconds = work
    add_machine(archive, f"gearbox-{number}", recording(number, days * seconds), days)


def make(archive, machines, days, seconds):
    """An archive of `machines`, each with `days` of so many `seconds`."""
    works = [(str(archive), number, days, seconds) for number in range(1, machines + 1)]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        list(pool.map(_machine, works))
    describe(archive, [f"gearbox-{number},2026-01-01,{GEARBOX}" for number in range(1, machines + 1)])


def made(results):
    """Hash of every estimate, state and table of days, by its name."""
    found = {}
    for part in ("estimates", "days"):
        for path in sorted((Path(results) / part).rglob("*")):
            if path.is_file() and path.name != ".lock":
                found[str(path.relative_to(results))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


if __name__ == "__main__":
    make(sys.argv[1], *map(int, sys.argv[2:]))
