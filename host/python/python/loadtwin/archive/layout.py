"""Folders of an archive and of its results."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
from pathlib import Path

from .. import Error
from .complete_file import write_complete

#: Folder of the recordings in the archive: ``machine=NAME/day=YYYY-MM-DD/*.parquet``.
RECORDINGS = "recordings"

#: File by which a folder of results is recognised.
MARK = "results.json"


@dataclasses.dataclass(frozen=True)
class Recording:
    """A file of an archive with what shows that it was changed."""

    path: str
    size: int
    modified_ns: int

    @property
    def name(self) -> str:
        """Name of the file."""
        return os.path.basename(self.path)


class Archive:
    """An archive of recordings.

    Parameters
    ----------
    folder : path-like
        It holds ``recordings/machine=NAME/day=YYYY-MM-DD/*.parquet`` and ``descriptions.csv``.

    Raises
    ------
    Error
        When it is none.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder).absolute()
        if not self.folder.is_dir():
            raise Error(f"{folder}: no such folder")
        self.recordings = self.folder / RECORDINGS
        if not self.recordings.is_dir():
            raise Error(f"{folder}: no archive: it has no folder {RECORDINGS}/machine=NAME/day=YYYY-MM-DD")

    def machines(self) -> list[str]:
        """Names of the machines.

        Raises
        ------
        Error
            When there is none.
        """
        found = sorted(_partitions(self.recordings, "machine"))
        if not found:
            raise Error(f"{self.recordings}: empty archive: no folder machine=NAME")
        return found

    def days(self, machine: str) -> dict[str, list[Recording]]:
        """Recordings of a machine by day, in the order of their names.

        A key that is no date is as its folder has it.
        """
        found = {}
        folder = self.recordings / f"machine={machine}"
        if folder.is_dir():
            for day in sorted(_partitions(folder, "day")):
                recordings = _recordings(folder / f"day={day}")
                if recordings:
                    found[day] = recordings
        return found


class Results:
    """Results of an archive.

    Parameters
    ----------
    folder : path-like
        ``estimates/machine=NAME/day=YYYY-MM-DD/*.parquet`` and others are written into it.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder).absolute()

    def estimates(self, machine: str) -> Path:
        """Folder with the estimates of a machine, by day."""
        return self.folder / "estimates" / f"machine={machine}"

    def days(self, machine: str) -> Path:
        """Folder with the table of the days of a machine."""
        return self.folder / "days" / f"machine={machine}"

    def begin(self, archive: Archive) -> None:
        """Make the folder, unless it holds something else.

        Raises
        ------
        Error
            When it does, or cannot be written.
        """
        if self.folder.is_relative_to(archive.recordings):
            raise Error(f"{self.folder}: results inside the recordings; allowed: another folder")
        mark = self.folder / MARK
        try:
            if self.folder.exists() and not mark.is_file() and any(self.folder.iterdir()):
                raise Error(
                    f"{self.folder}: holds files of others; allowed: a new or empty folder, or one with "
                    f"earlier results ({MARK})"
                )
            if not mark.is_file():
                write_complete(mark, json.dumps({"loadtwin": "results of an archive", "format": 1}) + "\n")
        except OSError as error:
            raise Error(f"{self.folder}: {error.strerror or error}") from None


def is_date(day: str) -> bool:
    """Whether a folder's day is a date."""
    try:
        return datetime.date.fromisoformat(day).isoformat() == day
    except ValueError:
        return False


def _partitions(folder: Path, key: str) -> list[str]:
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if entry.name.startswith(f"{key}=") and entry.is_dir()]
    return [name[len(key) + 1 :] for name in names if len(name) > len(key) + 1]


def _recordings(folder: Path) -> list[Recording]:
    found = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".parquet") and not entry.name.startswith((".", "_")):
                # A link that leads nowhere is a recording that cannot be read.
                there = entry.stat() if os.path.exists(entry.path) else entry.stat(follow_symlinks=False)
                found.append(Recording(entry.path, there.st_size, there.st_mtime_ns))
    return sorted(found, key=lambda recording: recording.name)
