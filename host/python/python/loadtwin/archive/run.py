"""Run over an archive with processes of this computer."""

from __future__ import annotations

import concurrent.futures
import errno
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import pyarrow as pa

from .. import Error
from . import outcome, overview
from .descriptions import Entry, read_table
from .layout import Archive, Results
from .machine_history import MachineHistory
from .options import Options

#: What is wrong with the disk of the results ends the run: every machine would have it.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)

#: Times that a pool of processes may break before the machines left are given a process each.
_BREAKS = 2

#: Everything that is needed to replay a machine, in any process.
Work = tuple[Archive, Results, str, list[Entry], Options]


def replay_machine(work: Work) -> overview.Overview:
    """Replay the days of a machine that are not up to date.

    Parameters
    ----------
    work : tuple
        Archive, results, name of the machine, its descriptions, options.

    Returns
    -------
    dict
        Its row of the table of the machines; where it cannot be replayed, with the fault.

    Raises
    ------
    OSError
        When the disk of the results is full or cannot be written.
    """
    machine = work[2]
    try:
        return MachineHistory(*work).run()
    except OSError as error:
        if error.errno in _FULL:
            raise
        return overview.failed(machine, str(error))
    except Exception as error:  # noqa: BLE001: the other machines go on
        return overview.failed(machine, f"{type(error).__name__}: {error}")


def prepared(archive: str | os.PathLike[str], results: str | os.PathLike[str], options: Options) -> list[Work]:
    """Check archive and results, and give the work for each machine.

    Raises
    ------
    Error
        When the archive is none, is empty, or has no table of descriptions; when the folder of the
        results holds something else.
    """
    found, target = Archive(archive), Results(results)
    machines = found.machines()
    entries = read_table(found.folder)
    target.begin(found)
    return [(found, target, machine, entries.get(machine, []), options) for machine in machines]


def run(
    archive: str | os.PathLike[str],
    results: str | os.PathLike[str] | None = None,
    *,
    processes: int | None = None,
    options: Options | None = None,
) -> dict[str, Any]:
    """Replay all machines of an archive, those days that are not up to date.

    Parameters
    ----------
    archive : path-like
        Folder with ``recordings/machine=NAME/day=YYYY-MM-DD/*.parquet`` and ``descriptions.csv``.
    results : path-like, optional
        Folder of the results; ``results`` in the archive where absent.
    processes : int, optional
        Processes; one for each core where absent. A script that has several calls this under
        ``if __name__ == "__main__":``, as for every pool of processes.
    options : Options, optional
        How it is replayed.

    Returns
    -------
    dict
        ``machines``, ``days``, ``replayed_days``, ``samples``, ``verdicts``, ``faults``, ``seconds``, ``results``.

    Raises
    ------
    Error
        When the archive or the folder of the results is refused.

    Examples
    --------
    >>> import loadtwin, os, shutil, tempfile
    >>> from loadtwin.archive import run
    >>> machine = loadtwin.Machine("examples/gearbox/machine.toml")
    >>> with tempfile.TemporaryDirectory() as archive:
    ...     day = os.path.join(archive, "recordings/machine=g1/day=2026-11-28")
    ...     os.makedirs(day)
    ...     _ = machine.simulate(os.path.join(day, "a.parquet"), scenario="steps", duration_s=4)
    ...     with open(os.path.join(archive, "descriptions.csv"), "w") as table:
    ...         _ = table.write(f"machine,from,description\\ng1,2026-01-01,{machine.path}\\n")
    ...     done = run(archive, processes=1)
    >>> done["machines"], done["samples"], done["faults"]
    (1, 2000, 0)
    """
    began, options = time.monotonic(), options or Options()
    target = results if results is not None else os.path.join(archive, "results")
    works = prepared(archive, target, options)
    processes = processes or len(os.sched_getaffinity(0))
    if processes < 1:
        raise Error(f"processes: found {processes}, allowed: 1 and more")
    alone = processes == 1 or len(works) == 1
    rows = map(replay_machine, works) if alone else _in_processes(works, processes)
    rows = list(_shown(rows, len(works)))
    return outcome.write(Results(target).folder, pa.Table.from_pylist(rows, overview.SCHEMA), options, began)


def _shown(rows: Iterator[overview.Overview], machines: int) -> Iterator[overview.Overview]:
    for done, row in enumerate(rows, 1):
        yield row
        if sys.stderr.isatty():
            print(f"\r{done} of {machines} machines", end="\n" if done == machines else "", file=sys.stderr)


def _in_processes(works: list[Work], processes: int) -> Iterator[overview.Overview]:
    for _ in range(_BREAKS):
        done: list[Work] = []
        for work, row in _in_pool(works, processes):
            done.append(work)
            yield row
        names = {work[2] for work in done}
        works = [work for work in works if work[2] not in names]
    # Some machine ends its process: each has one of its own.
    for work in works:
        rows = [row for _, row in _in_pool([work], 1)]
        yield rows[0] if rows else overview.failed(work[2], "its process was ended, also when it ran alone")


def _in_pool(works: list[Work], processes: int) -> Iterator[tuple[Work, overview.Overview]]:
    """Give what is done, until all is or a process is ended from outside."""
    if not works:
        return
    # A fork would have locks of threads that it does not have.
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(min(processes, len(works)), mp_context=context) as pool:
        futures = {pool.submit(replay_machine, work): work for work in works}
        try:
            for future in concurrent.futures.as_completed(futures):
                try:
                    yield futures[future], future.result()
                except BrokenProcessPool:
                    continue
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
