"""Replay of the machines of an archive on the cores of this computer, with progress on a terminal."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from typing import Any

from .. import Error, _loadtwin
from .options import Options


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
        Machines that are replayed at once, each on a thread; one for each core where absent.
    options : Options, optional
        How it is replayed.

    Returns
    -------
    dict
        ``machines``, ``days``, ``replayed_days``, ``samples``, ``verdicts``, ``faults``, ``seconds``, ``results``,
        ``page``.

    Raises
    ------
    Error
        When the archive or the folder of the results is refused.
    OSError
        When results cannot be written.

    Examples
    --------
    >>> import loadtwin, os, tempfile
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
    target = results if results is not None else os.path.join(archive, "results")
    figures, _ = replayed(archive, target, processes, options or Options())
    return json.loads(figures)


def replayed(
    archive: str | os.PathLike[str], results: str | os.PathLike[str], processes: int | None, options: Options
) -> tuple[str, str]:
    """Replay all machines; give the figures of the run as JSON and as text."""
    if processes is not None and processes < 1:
        raise Error(f"processes: found {processes}, allowed: 1 and more")
    show = _show if sys.stderr.isatty() else None
    return _loadtwin.replay_archive(archive, results, dataclasses.astuple(options), processes, show)


def _show(done: int, machines: int) -> None:
    print(f"\r{done} of {machines} machines", end="\n" if done == machines else "", file=sys.stderr)
