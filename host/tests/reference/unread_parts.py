"""Writes recordings of which a part is not read for `recording_peer.py`, each with the note that says so, and values
that no f64 holds.
"""

import numpy as np
import pandas
import pyarrow as pa
import pyarrow.parquet as pq

NAMES = ["ta1", "ta2", "ta3", "encoder_main", "index", "torque_main"]


def write_unread_parts(writer):
    n = writer.n
    t = writer.data["t"]
    without = lambda *names: [name for name in NAMES if name not in names]
    part = lambda rows, names=NAMES: writer.signals(names, rows=rows)
    first, second = slice(0, n // 2), slice(n // 2, n)
    for name in ("ta3", "encoder_main"):
        says = f"is not read: it lacks `{name}`"
        writer.mdf(f"part-without-{name}.mf4", [part(first), part(second, without(name))], expect="noted",
                   says="channel group 2 (t = 1.5 s to 2.998 s) " + says)
        writer.mdf(f"begins-without-{name}.mf4", [part(first, without(name)), part(second)], expect="noted",
                   says="channel group 1 (t = 0 s to 1.498 s) " + says)
    writer.mdf("part-without-reference.mf4", [part(first), part(second, without("torque_main"))], expect="samples",
               says="channel group 2 lacks `torque_main`: missing in its rows")
    gauges, motion = ["ta1", "ta2", "ta3", "torque_main"], ["encoder_main", "index"]
    writer.mdf("part-of-two-groups.mf4", [part(first, gauges), part(slice(0, n), motion), part(second, gauges[:2])],
               expect="noted", says="channel group 3 (t = 1.5 s to 2.998 s) is not read: it lacks `ta3`")
    sensors = writer.signals(without("torque_main"))
    other_clock = [writer.signal("torque_main", at=t + 1000.0)]
    writer.mdf("other-clock.mf4", [sensors, other_clock], expect="noted",
               says="`torque_main` (t = 1000 s to 1002.998 s) has no sample in the time of the other channels "
                    "(t = 0 s to 2.998 s)")
    for name in ("Torque_Main", "torque main"):
        renamed = writer.signal("torque_main")
        renamed.name = name
        writer.mdf(f"like-{name[6:7] == '_'}.mf4", [sensors, [renamed]], expect="noted",
                   says=f'no column `torque_main` (`column = "{name}"`')
    counts(writer, sensors)
    times(writer)


def counts(writer, sensors):
    """Counts of a counter of 64 bits: 2^53 and more is not exact."""
    plain = writer.data["encoder_main"].astype("i8")
    others = [signal for signal in sensors if signal.name != "encoder_main"]
    for power in (53, 60):
        wide = plain + 2**power
        writer.mdf(f"counts-{power}.mf4", [others + [writer.signal("encoder_main", values=wide.astype("u8"))]],
                   expect="refused", says="row 1, column `encoder_main`: found `")
        for kind in (pa.int64(), pa.uint64()):
            columns = dict(table(writer))
            columns["encoder_main [counts]"] = pa.array(wide, kind)
            path = writer.add(f"counts-{power}-{kind}.parquet", "refused", "counts below 2^53")
            pq.write_table(pa.table(columns), path)
    # Whole turns of 32 bits more, in all that counts.
    columns = dict(table(writer))
    for name in ("encoder_main", "index"):
        more = writer.data[name] + 2.0**52
        columns[f"{name} [counts]"] = pa.array([None if np.isnan(x) else int(x) for x in more], pa.int64())
    pq.write_table(pa.table(columns), writer.add("counts-52.parquet"))


def times(writer):
    """Times as text, which is read where it is stated, and as dates, which have no time of day."""
    start = pandas.Timestamp("2026-03-31T12:00:00")
    stamps = [(start + pandas.Timedelta(round(s * 1e9), "ns")).isoformat() + "Z" for s in writer.data["t"]]
    columns = dict(table(writer))
    del columns["t [s]"]
    columns["t"] = pa.array(stamps)
    pq.write_table(pa.table(columns), writer.add("stamps-of-text.parquet", "refused", "column `t` holds Utf8; allowed"))
    stated = "[channels]\nt = { type = 'timestamp' }\n"
    pq.write_table(pa.table(columns), writer.add("stamps-of-text-stated.parquet", layout=stated))
    columns["t"] = pa.array(range(writer.n), pa.int32()).cast(pa.date32())
    pq.write_table(pa.table(columns), writer.add("dates.parquet", "refused", "column `t` holds Date32; allowed"))


def table(writer):
    for name, unit in zip(["t", *NAMES], ["s", "µm/m", "µm/m", "µm/m", "counts", "counts", "Nm"]):
        yield f"{name} [{unit}]", pa.array(writer.data[name], from_pandas=True)
