"""Estimates of a replay: read while it goes on (``Stream``), or all in memory (``Estimates``)."""

from __future__ import annotations

from typing import Any

from . import _loadtwin


class _Exported:
    """Hands out columns by the Arrow PyCapsule interface."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """Hand out the batches as a capsule of the C stream interface."""
        return self._inner.__arrow_c_stream__(requested_schema)


class Estimates(_Exported):
    """Estimates in memory, one row a sample.

    A load ``X`` has the columns ``X``, ``X_std`` and ``X_fault``, a sensor ``Y`` the columns
    ``Y_innovation``, ``Y_nis`` and ``Y_fault``; 31 is no fault. Any library that reads
    ``__arrow_c_stream__`` takes it without a copy.

    Attributes
    ----------
    notes : list of str
        How the recording was read, where that is not plain.

    Examples
    --------
    >>> import pyarrow, loadtwin
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> estimates, state = machine.replay("examples/gearbox/start-stop.parquet")
    >>> table = pyarrow.table(estimates)
    >>> table.schema.field("main_shaft").type
    DataType(float)
    """

    def __init__(self, inner: Any, notes: list[str]) -> None:
        super().__init__(inner)
        self.notes = notes

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._inner)

    def __repr__(self) -> str:
        """Return the size."""
        return f"<loadtwin.Estimates: {len(self)} rows, {len(self.columns)} columns>"

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self._inner.columns

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return dict(self._inner.units)


class Stream(_Exported):
    """Estimates that are made while they are read, once.

    Attributes
    ----------
    state : bytes or None
        The state after the last row, once all rows are read; none where rows are resampled, or where estimates lag
        and no other part follows.
    notes : list of str
        How the recording was read, where that is not plain, once all rows are read.

    Examples
    --------
    >>> import pyarrow, loadtwin
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> stream = machine.stream("examples/gearbox/start-stop.parquet")
    >>> reader = pyarrow.RecordBatchReader.from_stream(stream)
    >>> sum(batch.num_rows for batch in reader), len(stream.state) > 0
    (45000, True)
    """

    def read_all(self) -> Estimates:
        """Read all estimates into memory; an interrupt ends the replay."""
        return Estimates(self._inner.collect(), self.notes)

    @property
    def state(self) -> bytes | None:
        """The state after the last row."""
        return self._inner.state

    @property
    def notes(self) -> list[str]:
        """How the recording was read, where that is not plain."""
        return self._inner.notes


def start(
    description: _loadtwin.Description,
    recording: Any,
    state: bytes | None,
    sensors: str | None,
    filter: str,
    more: bool,
) -> Stream:
    """Start a replay."""
    return Stream(description.stream(recording, state, sensors, filter, more))
