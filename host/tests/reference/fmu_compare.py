"""Runs an FMU on a recording and compares it with `loadtwin replay --estimates`, bit for bit.

fmu_compare.py FMU RECORDING ESTIMATES
"""

import sys

import numpy as np
import pyarrow.parquet as pq
from fmpy.validation import validate_fmu
from fmu_run import Fmu, Inputs, refused

fmu_path, recording, estimates = sys.argv[1:]
problems = validate_fmu(fmu_path)
assert problems == [], problems

fmu = Fmu(fmu_path)
inputs = Inputs(fmu, recording)
lag = fmu.machine["lag_samples"]
loads = [load["name"] for load in fmu.machine["load"]]
sensors = [s["name"] for kind in ("channel", "encoder") for s in fmu.machine.get(kind, [])]
time = lambda row: row * fmu.period

whole = fmu.instance()
# Runs beside it with other inputs and must not matter.
other = fmu.instance(5.0)
# Goes on from a saved state from the middle on.
part, middle = fmu.instance(1234.5), inputs.rows // 2
found = []
for row in range(inputs.rows + lag):
    if row == middle:
        state = whole.saved()
        part.restore(state)
        assert part.get() == whole.get()
        assert part.saved() == state
    for instance in [whole] + [part] * (row >= middle):
        if row < inputs.rows:
            inputs.give(instance, row)
        else:
            # Where estimates lag, the last ones come with samples of which nothing is delivered.
            instance.set_truths(inputs.truth_references, [False] * len(inputs.truth_references))
        instance.step(time(row))
    found.append(whole.get())
    if row >= middle:
        assert part.get() == found[-1], row
    if row < 500:
        other.step(5.0 + time(row))

# The whole again from the state in the middle, in the same instance.
whole.restore(state)
for row in range(middle, min(middle + 100, inputs.rows)):
    inputs.give(whole, row)
    whole.step(time(row))
    assert whole.get() == found[row], row

# Errors of either version of FMI leave it as it is.
before = whole.saved()
refused(whole.set_reals, inputs.real_references[:1], [float("nan")])
refused(whole.set_reals, [len(fmu.references)], [0.0])
refused(whole.step, time(row) + 7.5 * fmu.period)
refused(whole.fmi.doStep, time(row + 1), 2 * fmu.period)
refused(whole.restore, before[:-1])
assert whole.saved() == before

expected = pq.read_table(estimates)
assert expected.num_rows == inputs.rows


def compare(name, column, values, where=None):
    """Asserts that values are those of a column, as f32."""
    values = np.array(values, np.float32)
    column = expected[column].to_pandas().to_numpy(dtype=np.float32)
    where = np.ones(len(column), bool) if where is None else where
    same = values.view(np.uint32) == column.view(np.uint32)
    wrong = np.flatnonzero(~same & where)
    assert len(wrong) == 0, f"{name}: {len(wrong)} rows, first {wrong[0]}: {values[wrong[0]]}, {column[wrong[0]]}"


of_load, of_sensor = found[lag:], found[: inputs.rows]
for load in loads:
    for name in (load, f"{load}_std", f"{load}_fault"):
        compare(name, name, [row[name] for row in of_load])
    valid = [row[f"{load}_valid"] for row in of_load]
    assert valid == [fault == 31 for fault in expected[f"{load}_fault"].to_pylist()], load
for sensor in sensors:
    is_used = ~np.isnan(expected[f"{sensor}_nis"].to_pandas().to_numpy(dtype=float))
    for name in (f"{sensor}_innovation", f"{sensor}_nis"):
        compare(name, name, [row[name] for row in of_sensor], is_used)
    compare(sensor, f"{sensor}_fault", [row[f"{sensor}_fault"] for row in of_sensor])
valid = [np.mean([row[f"{load}_valid"] for row in of_load]) for load in loads]
print(inputs.rows, max(valid))
