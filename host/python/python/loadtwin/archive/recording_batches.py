"""Recordings of an archive as batches, their time in seconds of one clock."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

#: Rows that are in memory at once.
ROWS = 65_536

#: Names of a time column beside ``t``.
_TIME = ("timestamps", "timestamp", "time", "zeit")


class RecordingBatches:
    """A recording, read batch by batch.

    A time of timestamps becomes seconds since 1970 (UTC), so that recordings follow one another.

    Parameters
    ----------
    path : str
        A Parquet file.

    Attributes
    ----------
    first_s : float or None
        Time of the first row [s]; none where it has no time.

    Raises
    ------
    OSError, pyarrow.ArrowException
        When the file is damaged, as reading does.
    """

    def __init__(self, path: str) -> None:
        self._file = pq.ParquetFile(path, page_checksum_verification=True)
        self._schema = self._file.schema_arrow
        self._time = _time_column(self._schema)
        self.first_s = None
        batches = self._batches()
        first = next(batches, None)
        self._rest = batches if first is None else itertools.chain([first], batches)
        if first is not None and self._time is not None:
            value = first.column(self._time)[0].as_py() if first.num_rows else None
            self.first_s = float(value) if isinstance(value, (int, float)) else None

    def reader(self) -> pa.RecordBatchReader:
        """Give all batches, once."""
        schema = self._schema
        if self._time is not None and pa.types.is_timestamp(schema.field(self._time).type):
            schema = schema.set(self._time, pa.field("t", pa.float64(), metadata={"unit": "s"}))
        return pa.RecordBatchReader.from_batches(schema, self._rest)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _batches(self) -> Iterator[pa.RecordBatch]:
        for batch in self._file.iter_batches(batch_size=ROWS, use_threads=False):
            yield self._in_seconds(batch)

    def _in_seconds(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        if self._time is None or not pa.types.is_timestamp(batch.schema.field(self._time).type):
            return batch
        stamps = batch.column(self._time).cast(pa.timestamp("ns", batch.schema.field(self._time).type.tz))
        numbers = stamps.cast(pa.int64())
        whole = np.asarray(numbers.fill_null(0))
        # Seconds and nanoseconds apart: together they have more digits than a float.
        seconds = whole // 1_000_000_000 + (whole % 1_000_000_000) * 1e-9
        t = pa.array(seconds, mask=np.asarray(numbers.is_null()))
        field = pa.field("t", pa.float64(), metadata={"unit": "s"})
        return batch.set_column(self._time, field, t)


def _time_column(schema: pa.Schema) -> int | None:
    names = [name.split("[")[0].split("(")[0].strip() for name in schema.names]
    if "t" in names:
        return names.index("t")
    return next((k for k, name in enumerate(names) if name.lower() in _TIME), None)
