"""All days of one machine, in their order: what is up to date stays, what follows a change is replayed."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from typing import Any

from .. import Error, __version__
from . import carried_state, days, descriptions, machine_page, overview
from .carried_state import CarriedState
from .complete_file import locked, remove_parts
from .day_replay import DayReplay
from .days import Day
from .descriptions import Described, Entry
from .layout import Archive, Recording, Results, is_date
from .options import Options

#: Time between two writings of the table of the days [s]; a kill loses no more.
_SAVE_S = 2.0


@dataclasses.dataclass
class MachineHistory:
    """The days of a machine.

    Parameters
    ----------
    archive : Archive
    results : Results
    machine : str
        Its name in the archive.
    entries : list of Entry
        Its rows of the table of descriptions.
    options : Options
    """

    archive: Archive
    results: Results
    machine: str
    entries: list[Entry]
    options: Options

    def run(self) -> overview.Overview:
        """Replay what is not up to date.

        Of several processes that are given the same machine, one works and the others wait.

        Returns
        -------
        dict
            A row of the table of the machines.

        Raises
        ------
        OSError
            When results cannot be written.
        """
        folder = self.results.days(self.machine)
        with locked(folder / ".lock"):
            remove_parts(folder)
            remove_parts(self.results.estimates(self.machine))
            self._rows = days.read(folder)
            self._described: dict[tuple[str, str, str], Described | Error] = {}
            self._saved = time.monotonic()
            replayed, carried = 0, CarriedState()
            recorded = self.archive.days(self.machine)
            for day in sorted({*recorded, *self._rows}):
                row, carried, is_new = self._day(day, recorded.get(day, []), carried)
                self._rows[day] = row
                replayed += is_new
                if is_new and time.monotonic() - self._saved > _SAVE_S:
                    self._save()
            if replayed:
                self._save()
            if self.options.page:
                machine_page.write(self.results.folder, self.machine, self._rows, is_new=replayed > 0)
            return overview.of(self.machine, self._rows, replayed)

    def _save(self) -> None:
        days.write(self.results.days(self.machine), self._rows)
        self._saved = time.monotonic()

    def _day(
        self, day: str, recordings: list[Recording], carried: CarriedState
    ) -> tuple[Day, CarriedState, bool]:
        """Give a day, the state after it, and whether it was replayed."""
        folder = self.results.estimates(self.machine) / f"day={day}"
        before = self._rows.get(day)
        if before is not None:
            after = carried_state.read(folder, before["state_sha256"])
            if not recordings:
                # Recordings that were removed leave their results.
                return before, after or carried, False
        entry, described, fault = self._description(day)
        made_from = self._made_from(recordings, carried, entry, described)
        if before is not None:
            is_same = after is not None and before["made_from"] == made_from
            # What failed may have been a disk or a network.
            if is_same and not days.has_fault(before) and not self.options.again:
                return before, after, False
            # From here on until the row is written anew, the day is not up to date.
            del self._rows[day]
            self._save()
        if fault or entry is None or described is None:
            row, after = _failed(fault, recordings), carried
        else:
            replay = DayReplay(entry, described, self.options, folder, carried)
            row = replay.run(recordings)
            after = replay.carried
        kept = {recording["name"] for recording in row["recordings"] if recording["samples"]}
        for stale in folder.glob("*.parquet"):
            if stale.name not in kept:
                stale.unlink()
        after.write(folder)
        return {**row, "day": day, "made_from": made_from, "state_sha256": after.sha256}, after, True

    def _description(self, day: str) -> tuple[Entry | None, Described | None, str]:
        """Give the description of a day, or why there is none."""
        try:
            if not is_date(day):
                raise Error(f"day={day}: found {day!r}, allowed: a date, as day=2026-11-28")
            entry = descriptions.at(self.entries, day)
            key = (entry.path, entry.sha256, entry.load)
            if key not in self._described:
                try:
                    self._described[key] = Described(entry)
                except (Error, OSError) as error:
                    self._described[key] = Error(str(error))
            found = self._described[key]
            if isinstance(found, Error):
                raise found
            return entry, found, ""
        except Error as error:
            return None, None, str(error)

    def _made_from(
        self, recordings: list[Recording], carried: CarriedState, entry: Entry | None, described: Described | None
    ) -> str:
        """Hash of all that a day is made from."""
        parts: list[Any] = [
            [[recording.name, recording.size, recording.modified_ns] for recording in recordings],
            carried.sha256,
            described and described.sha256,
            entry and [entry.load, entry.sn, entry.range],
            [self.options.sensors, self.options.filter, self.options.columns],
        ]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _failed(fault: str, recordings: list[Recording]) -> Day:
    """Give the row of a day without a description."""
    return {
        "verdict": "no data",
        "samples": 0,
        "valid": 0,
        "seconds": 0.0,
        "loads": [],
        "sensors": [],
        "recordings": [
            {"name": recording.name, "samples": 0, "continued": False, "notes": [], "fault": None}
            for recording in recordings
        ],
        "fault": fault,
        "name": None,
        "description": None,
        "description_sha256": None,
        "loadtwin": __version__,
    }
