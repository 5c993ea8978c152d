"""The commands of loadtwin as functions: options in, the object that ``--json`` prints out."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from typing import Any

from ._loadtwin import Error, write_parquet


def command(name: str, *arguments: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Run a command in a process of its own, which an interrupt ends.

    Parameters
    ----------
    name : str
        The command.
    *arguments
        Its arguments.
    **options
        Its options: ``duration_s=5`` is ``--duration-s 5``, ``force=True`` is ``--force``, a list
        repeats the option, a list of tuples is joined as the option wants it (``A:B,C:D``).

    Returns
    -------
    dict
        What the command prints with ``--json``.

    Raises
    ------
    Error
        With the command's message.
    """
    line = [name, *map(os.fspath, arguments), *_flags(options), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "loadtwin", *line],
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    if done.returncode != 0:
        said = done.stderr.strip() or f"loadtwin {name} ended with {done.returncode}"
        raise Error(said.removeprefix("loadtwin: ").removeprefix("error: "))
    return json.loads(done.stdout)


def _flags(options: dict[str, Any]) -> Iterator[str]:
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            yield flag
        elif isinstance(value, (list, tuple)) and any(isinstance(v, tuple) for v in value):
            yield f"{flag}={','.join(':'.join(map(str, pair)) for pair in value)}"
        elif isinstance(value, list):
            for each in value:
                yield f"{flag}={each}"
        else:
            yield f"{flag}={os.fspath(value) if isinstance(value, os.PathLike) else value}"


@contextlib.contextmanager
def recordings(given: Sequence[Any]) -> Iterator[list[str]]:
    """Give the names of files with the recordings; a table is written to one."""
    with tempfile.TemporaryDirectory(prefix="loadtwin-") as folder:
        files = []
        for number, recording in enumerate(given):
            if isinstance(recording, (str, os.PathLike)):
                files.append(os.fspath(recording))
            else:
                files.append(os.path.join(folder, f"{number}.parquet"))
                write_parquet(recording, files[-1])
        yield files
