"""Writer of the estimates of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from .. import Error
from .complete_file import complete

#: Rows of a row group.
ROWS = 262_144


def write_estimates(estimates: pa.RecordBatchReader, path: Path, loads: list[str] | None) -> int:
    """Write estimates to a complete file, in the order of their rows.

    Parameters
    ----------
    estimates : pyarrow.RecordBatchReader
        Estimates of a replay, made while they are read.
    path : Path
        The file (Parquet).
    loads : list of str, optional
        Names of loads, of which alone the columns are kept; absent: all columns.

    Returns
    -------
    int
        Rows.

    Raises
    ------
    Error
        When the recording cannot be read or replayed to its end.
    OSError
        When the file cannot be written.
    """
    kept = estimates.schema.names
    if loads is not None:
        kept = ["t"] + [name + end for name in loads for end in ("", "_std", "_fault")]
    schema = pa.schema([estimates.schema.field(name) for name in kept], estimates.schema.metadata)
    rows, waiting, count = 0, [], 0
    with complete(path) as part:
        with pq.ParquetWriter(part, schema, compression="zstd") as writer:
            for batch in _read(estimates):
                waiting.append(batch.select(kept))
                count += batch.num_rows
                if count >= ROWS:
                    writer.write_table(pa.Table.from_batches(waiting, schema), row_group_size=count)
                    rows, waiting, count = rows + count, [], 0
            if waiting:
                writer.write_table(pa.Table.from_batches(waiting, schema), row_group_size=count)
    return rows + count


def _read(estimates: pa.RecordBatchReader) -> Iterator[pa.RecordBatch]:
    try:
        yield from estimates
    except (OSError, pa.ArrowException) as error:
        raise Error(in_words(error)) from None


def in_words(error: Exception) -> str:
    """Give the first line of an error, without the layers that it came through."""
    text = (str(error).strip() or type(error).__name__).splitlines()[0]
    for layer in ("External error: ", "C Data interface error: "):
        text = text.removeprefix(layer)
    return text
