"""Peak memory [bytes] of a replay of a stream: python stream_memory.py ROWS arrays|DuckDB.

The batches are made while they are read, so that only what loadtwin keeps counts.
"""

import re
import sys
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import loadtwin

rows, source = int(sys.argv[1]), sys.argv[2]
machine = loadtwin.Machine(
    """
format = 1
name = "axis"
rate_hz = 1000
[balance]
unit = "Nm"
drive = { name = "torque", unit = "Nm", noise_std = 0.01 }
position = { name = "angle", unit = "rad", gain = 1e-4 }
inertia = 0.01
nominal = 1.0
[tuning]
cutoff_hz = 20
"""
)
BLOCK = 10_000


def batches():
    for start in range(0, rows, BLOCK):
        t = np.arange(start, min(rows, start + BLOCK)) / 1000.0
        angle = 2 * np.sin(t)
        torque = -0.02 * np.sin(t) + 0.1 * np.cos(3 * t)
        yield pa.record_batch({"t [s]": t, "torque [Nm]": torque, "angle [rad]": angle})


schema = pa.schema([("t [s]", pa.float64()), ("torque [Nm]", pa.float64()), ("angle [rad]", pa.float64())])
if source == "arrays":
    reader = pa.RecordBatchReader.from_batches(schema, batches())
else:
    query = """select i / 1000 as "t [s]", -0.02 * sin(i / 1000) + 0.1 * cos(3 * i / 1000) as "torque [Nm]",
        2 * sin(i / 1000) as "angle [rad]" from range(?) as rows(i)"""
    # Of several threads it holds more or less of its own, by their timing.
    reader = duckdb.connect(config={"threads": 1}).sql(query, params=[rows]).to_arrow_reader(BLOCK)
stream = machine.stream(reader)
found = sum(batch.num_rows for batch in pa.RecordBatchReader.from_stream(stream))
assert found == rows, found
# Not `ru_maxrss`: that begins with the peak of the process that started this one.
print(1024 * int(re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]))
