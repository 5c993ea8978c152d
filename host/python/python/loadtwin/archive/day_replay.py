"""Replay of one day of a machine: estimates of each recording, sums, the state after it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pyarrow as pa

from .. import Error, __version__, _loadtwin
from . import verdict
from .carried_state import CarriedState
from .days import Day
from .descriptions import Described, Entry
from .estimates_file import in_words, write_estimates
from .layout import Recording
from .options import Options
from .recording_batches import RecordingBatches

#: Range of the counts where none is given [nominal load].
NOMINAL_LOADS = 1.5

#: Part of a period by which a gap of whole periods may be off.
_HALF = 0.5


@dataclasses.dataclass
class DayReplay:
    """Replay of the recordings of a day.

    Parameters
    ----------
    entry : Entry
        Row of the table of descriptions.
    described : Described
        The description.
    options : Options
        How it is replayed.
    folder : Path
        Folder of the estimates of the day.
    carried : CarriedState
        State before the day; after :meth:`run`, that after it.
    """

    entry: Entry
    described: Described
    options: Options
    folder: Path
    carried: CarriedState
    sums: verdict.Sums | None = None

    def run(self, recordings: list[Recording]) -> Day:
        """Replay the recordings in their order; one that cannot be replayed is left out."""
        if self.carried.description_sha256 != self.described.sha256:
            self.carried = dataclasses.replace(
                self.carried, state=None, description_sha256=self.described.sha256
            )
        self._begin_counts()
        rows = [self._recording(recording) for recording in recordings]
        fault, damage = self._damage()
        sums = self.sums or {"samples": 0, "valid": 0, "seconds": 0.0, "loads": [], "sensors": []}
        loads = [{**load, "damage": damage if load["name"] == self.entry.load else None} for load in sums["loads"]]
        return {
            **sums,
            "loads": loads,
            "verdict": verdict.verdict(self.sums),
            "recordings": rows,
            "fault": fault,
            "name": self.described.machine.name,
            "description": self.entry.path,
            "description_sha256": self.described.sha256,
            "loadtwin": __version__,
        }

    def _begin_counts(self) -> None:
        """Begin counts of the load that is to be counted, where they are not begun."""
        load = self.entry.load
        if not load or load in self.carried.counts:
            return
        nominal = NOMINAL_LOADS * dict(self.described.machine._description.nominal)[load]
        low, high = self.entry.range or (-nominal, nominal)
        counts = {**self.carried.counts, load: _loadtwin.empty_counts(low, high, None)}
        self.carried = dataclasses.replace(self.carried, counts=counts)

    def _damage(self) -> tuple[str | None, float | None]:
        if not self.entry.sn:
            return None, None
        try:
            return None, _loadtwin.damage_of(self.carried.counts[self.entry.load], self.entry.sn)
        except Error as error:
            return f"damage: {error}", None

    def _recording(self, recording: Recording) -> dict[str, Any]:
        row = {"name": recording.name, "samples": 0, "continued": False, "notes": [], "fault": None}
        try:
            state, why = self._state_for(recording)
            row["notes"] += [why] if why else []
            try:
                samples, notes = self._replay(recording, state)
                row["continued"] = state is not None
            except Error as error:
                if state is None:
                    raise
                # What no state goes on to may be a recording of its own.
                samples, notes = self._replay(recording, None)
                row["notes"].append(f"began anew: {error}")
            row["samples"] = samples
            row["notes"] += notes
        except Error as error:
            row["fault"] = str(error)
        return row

    def _state_for(self, recording: Recording) -> tuple[bytes | None, str | None]:
        """Give the state that goes on with a recording, and why there is none."""
        if self.carried.state is None or self.carried.end_s is None:
            return None, None
        begin_s = self._open(recording).first_s
        if begin_s is None:
            return None, None
        if begin_s <= self.carried.end_s:
            return None, f"began anew: its time begins at {begin_s} s, not after {self.carried.end_s} s"
        description = self.described.machine._description
        missing = (begin_s - self.carried.end_s) * description.rate_hz - 1.0
        if missing > description.largest_gap + _HALF:
            return None, f"began anew: {begin_s - self.carried.end_s:.3f} s after the recording before"
        return self.carried.state, None

    def _open(self, recording: Recording) -> RecordingBatches:
        try:
            return RecordingBatches(recording.path)
        except (OSError, pa.ArrowException) as error:
            raise Error(in_words(error)) from None

    def _replay(self, recording: Recording, state: bytes | None) -> tuple[int, list[str]]:
        batches = self._open(recording)
        description = self.described.machine._description
        try:
            stream = description.stream(
                batches.reader(),
                state,
                self.options.sensors,
                self.options.filter,
                description.has_state,
                list(self.carried.counts.items()),
            )
            loads = list(self.described.machine.loads) if self.options.columns == "loads" else None
            reader = pa.RecordBatchReader.from_stream(stream)
            rows = write_estimates(reader, self.folder / recording.name, loads)
        finally:
            batches.close()
        sums = json.loads(stream.sums)
        self.sums = verdict.add(self.sums, sums)
        self.carried = dataclasses.replace(
            self.carried,
            state=stream.state,
            end_s=sums["span_s"][1] if sums["span_s"] else self.carried.end_s,
            counts=dict(stream.counts),
        )
        return rows, stream.notes
