"""Files that are complete or absent, whenever a process is killed."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

#: End of the name of a file that is being written; its name begins with a point.
PART = ".part"


@contextlib.contextmanager
def complete(path: Path) -> Iterator[Path]:
    """Give a name to write to; the file is at `path` once it is complete and on the disk.

    Parameters
    ----------
    path : Path
        Name of the complete file; one that is there is replaced.

    Yields
    ------
    Path
        A name in the same folder.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name[:100]}.{secrets.token_hex(8)}{PART}")
    try:
        yield part
        with open(part, "rb") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_complete(path: Path, content: bytes | str) -> None:
    """Write a complete file."""
    with complete(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def remove_parts(folder: Path) -> None:
    """Remove what killed processes left in a folder and those in it."""
    for part in folder.rglob(f".*{PART}"):
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait for a lock between processes; the kernel frees that of a killed one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
