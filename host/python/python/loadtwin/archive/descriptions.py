"""Table of the descriptions of an archive: which one holds for a machine on a day."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import hashlib
from pathlib import Path

from .. import Error
from ..machine import Machine

#: Name of the table in the archive.
TABLE = "descriptions.csv"

_REQUIRED = ("machine", "from", "description")
_OPTIONAL = ("to", "sha256", "load", "sn", "range")


@dataclasses.dataclass(frozen=True)
class Entry:
    """A row of the table.

    Attributes
    ----------
    first, last : str
        First and last day for which it holds; `last` is empty where it holds until another does.
    path : str
        The description.
    sha256 : str
        Hash that it has to have; empty where none is stated.
    load : str
        Load whose cycles are counted; empty for none.
    sn : list of (float, float)
        Points of the S-N curve, cycles and range of the load; empty for none.
    range : (float, float) or None
        Loads that the levels of the counts cover; absent: 1.5 times the nominal load.
    """

    first: str
    last: str
    path: str
    sha256: str
    load: str
    sn: list[tuple[float, float]]
    range: tuple[float, float] | None


class Described:
    """A description as it is in its files now.

    Attributes
    ----------
    machine : Machine
    sha256 : str
        Of the description, followed by the files that it names in the order of their paths.

    Raises
    ------
    Error
        When it is refused, or has another hash than stated.
    """

    def __init__(self, entry: Entry) -> None:
        path = Path(entry.path)
        if not path.is_file():
            raise Error(f"{path}: no such description ({TABLE})")
        self.machine = Machine(path)
        digest = hashlib.sha256(path.read_bytes())
        for named in sorted(self.machine._description.named_files):
            digest.update(Path(named).read_bytes())
        self.sha256 = digest.hexdigest()
        if entry.sha256 not in ("", self.sha256):
            raise Error(f"{path}: its SHA-256 is {self.sha256}, {TABLE} has {entry.sha256}")
        loads = self.machine.loads
        if entry.load and entry.load not in loads:
            raise Error(f"{TABLE}: found load {entry.load!r}, allowed: {', '.join(loads)}")


def read_table(archive: Path) -> dict[str, list[Entry]]:
    """Read the table.

    Parameters
    ----------
    archive : Path
        Folder of the archive.

    Returns
    -------
    dict of str to list of Entry
        By machine, in the order of `first`.

    Raises
    ------
    Error
        With the line that is refused.
    """
    path = archive / TABLE
    if not path.is_file():
        raise Error(f"{path}: no such table; it has a row for each description: {', '.join(_REQUIRED)}")
    found: dict[str, list[Entry]] = {}
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        columns = [name.strip() for name in reader.fieldnames or []]
        reader.fieldnames = columns
        for name in _REQUIRED:
            if name not in columns:
                raise Error(f"{path}: no column {name!r}; found: {', '.join(columns) or 'none'}")
        for name in columns:
            if name not in _REQUIRED + _OPTIONAL:
                raise Error(f"{path}: unknown column {name!r}; allowed: {', '.join(_REQUIRED + _OPTIONAL)}")
        for row in reader:
            try:
                machine, entry = _entry(row, archive)
                entries = found.setdefault(machine, [])
                if any(entry.first == other.first for other in entries):
                    raise ValueError(f"machine {machine!r} has two descriptions from {entry.first} on")
                entries.append(entry)
            except ValueError as error:
                raise Error(f"{path}:{reader.line_num}: {error}") from None
    for entries in found.values():
        entries.sort(key=lambda entry: entry.first)
    return found


def at(entries: list[Entry], day: str) -> Entry:
    """Give the description that holds on a day.

    Raises
    ------
    Error
        Where none does.
    """
    begun = [entry for entry in entries if entry.first <= day]
    if not begun:
        first = f"the first one is valid from {entries[0].first} on" if entries else "it has none"
        raise Error(f"no description for this machine on {day} in {TABLE}: {first}")
    if begun[-1].last and day > begun[-1].last:
        raise Error(f"no description for this machine on {day} in {TABLE}: one ends on {begun[-1].last}")
    return begun[-1]


def _entry(row: dict[str, str], archive: Path) -> tuple[str, Entry]:
    if None in row or None in row.values():
        raise ValueError("another number of cells than the header has")
    cell = {name: value.strip() for name, value in row.items()}
    if not cell["machine"] or not cell["description"]:
        raise ValueError("machine or description is empty")
    sn, load, span = cell.get("sn", ""), cell.get("load", ""), cell.get("range", "")
    if (sn or span) and not load:
        raise ValueError("sn or range without the load that they are for")
    last = cell.get("to", "")
    return cell["machine"], Entry(
        first=_date("from", cell["from"]),
        last=last and _date("to", last),
        path=str(archive / cell["description"]),
        sha256=cell.get("sha256", "").lower(),
        load=load,
        sn=[_pair("sn", pair) for pair in sn.split(",")] if sn else [],
        range=_pair("range", span) if span else None,
    )


def _date(name: str, text: str) -> str:
    try:
        return datetime.date.fromisoformat(text).isoformat()
    except ValueError:
        raise ValueError(f"{name}: found {text!r}, allowed: a date, as 2026-11-28") from None


def _pair(name: str, text: str) -> tuple[float, float]:
    try:
        first, second = map(float, text.split(":"))
    except ValueError:
        raise ValueError(f"{name}: found {text!r}, allowed: two numbers with a colon between") from None
    return first, second
