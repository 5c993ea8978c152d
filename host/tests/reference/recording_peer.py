"""Writes the recordings that `host/tests/recording_files/main.rs` reads.

recording_peer.py BASE.csv DIR    writes them to DIR, and what is right to DIR/manifest.json

Each is the recording BASE.csv as another program writes it: pyarrow, polars,
duckdb and pandas (Parquet), asammdf 8.8.28 (MDF4), spreadsheets and loggers
(text). `expect` is `same` (equal samples and references), `samples` (equal
samples; the references have another rate), `pulse` (the index as 0 and 1),
`noted` (a part of the samples) or `refused`; `says` is in the note or in the refusal.
"""

import csv
import json
import sys
from pathlib import Path

import duckdb
import numpy as np
import pandas
import polars
import pyarrow as pa
import pyarrow.parquet as pq
from asammdf import MDF, Signal
from asammdf.blocks.conversion_utils import from_dict
from foreign_files import write_foreign_files
from unread_parts import write_unread_parts
from unsorted_mdf import unsorted_mdf

UNITS = {
    "t": "s",
    "ta1": "µm/m",
    "ta2": "µm/m",
    "ta3": "µm/m",
    "encoder_main": "counts",
    "index": "counts",
    "torque_main": "Nm",
}
NAMES = list(UNITS)
NO_UNITS = "[channels]\n" + "".join(f"{n} = {{ unit = '{u}' }}\n" for n, u in UNITS.items())
EPOCH = 1_780_000_000_000_000_000  # ns
STEP = 2_000_000  # ns


class Writer:
    def __init__(self, base, folder):
        self.folder = Path(folder)
        self.manifest = []
        with open(base, encoding="utf-8") as file:
            rows = list(csv.reader(file))[1:]
        self.cells = rows
        self.n = len(rows)
        column = lambda k: np.array([float(r[k]) if r[k] else np.nan for r in rows])
        self.data = {name: column(k) for k, name in enumerate(NAMES)}

    def add(self, name, expect="same", says="", layout=""):
        entry = {"file": name, "expect": expect, "says": says, "layout": layout}
        self.manifest.append(entry)
        return self.folder / name

    # --- text ---------------------------------------------------------------

    def text(self, name, *, delimiter=",", comma=False, encoding="utf-8", head=(), header=True,
             end="\n", names=None, time=None, index=None, quote=False, units_row=False, extra=(),
             **known):
        path = self.add(name, **known)
        lines = list(head)
        titles = [f"{n} [{UNITS[n]}]" for n in NAMES] if names is None else list(names)
        titles += [title for title, _ in extra]
        wrap = (lambda cell: f'"{cell}"') if quote else (lambda cell: cell)
        if header:
            lines.append(delimiter.join(map(wrap, titles)))
        if units_row:
            lines.append(delimiter.join(UNITS[n] for n in NAMES))
        for i, row in enumerate(self.cells):
            cells = [cell.replace(".", ",") if comma else cell for cell in row]
            if time:
                cells[0] = time(i)
            if index:
                cells[5] = index(row[5])
            cells += [value(i) for _, value in extra]
            lines.append(delimiter.join(map(wrap, cells)))
        path.write_bytes((end.join(lines) + end).encode(encoding))

    def all_text(self):
        semi = 'delimiter = ";"'
        for d, label in ((";", "semicolon"), ("\t", "tab"), ("|", "bar")):
            for comma in (False, True):
                for encoding in ("utf-8-sig", "windows-1252", "utf-16", "utf-16-le", "utf-16-be"):
                    name = f"{label}-{'comma' if comma else 'point'}-{encoding}.csv"
                    says = "decimal_comma = true" if comma else "delimiter"
                    self.text(name, delimiter=d, comma=comma, encoding=encoding, says=says)
        self.text("stated.csv", delimiter=";", comma=True, encoding="windows-1252", says="nothing",
                  layout='delimiter = ";"\ndecimal_comma = true\nencoding = "windows-1252"')
        self.text("not-comma.csv", delimiter=";", comma=True, expect="refused",
                  says="decimal_comma = true", layout="decimal_comma = false")
        self.text("other-delimiter.csv", delimiter=";", expect="refused", says="column `t` is missing",
                  layout='delimiter = ","')
        self.text("parentheses.csv", names=[f"{n} ({UNITS[n]})" for n in NAMES])
        self.text("returns.csv", end="\r", expect="refused", says="its lines end with CR alone")
        self.text("capitals.csv", names=[f"{n.upper()} [{UNITS[n]}]" if n == "ta1" else f"{n} [{UNITS[n]}]" for n in NAMES],
                  expect="refused", says="did you mean `TA1`?")
        for name, written in (("thousands", '"1,234.5"'), ("apostrophes", "1'234.5")):
            self.text(f"{name}.csv", index=lambda _, written=written: written, expect="refused",
                      says="without separators between thousands")
        for k, line in enumerate(("sep=;", '"sep=;"', "SEP=;")):
            self.text(f"sep-{k}.csv", delimiter=";", head=[line])
        self.text("sep-tab.csv", delimiter="\t", head=["sep=\t"], end="\r\n")
        self.text("sep-skipped.csv", delimiter=";", head=["sep=;", "a remark"], layout="skip_lines = 2")
        self.text("sep-comma.csv", head=["sep=,"], end="\r\n")
        self.text("quoted.csv", delimiter=";", comma=True, quote=True, says=semi.split()[0])
        spare = [("spare", lambda i: "x"), ("spare", lambda i: ""), ("", lambda i: "1")]
        self.text("duplicates.csv", extra=spare)
        self.text("duplicate-wanted.csv", extra=[("ta1 [µm/m]", lambda i: "1")], expect="refused",
                  says="`ta1` is there twice")
        self.text("duplicate-semicolon.csv", delimiter=";", extra=spare * 3)
        self.text("remark.csv", extra=[("remark", lambda i: "a b")])
        self.text("duplicate-reference.csv", extra=[("torque_main [kNm]", lambda i: "1")],
                  expect="refused", says="`torque_main` is there twice")
        self.text("names.csv", names=["time", "CH1", "CH2 [V]", "CH3 [µm/m]", "enc", "z", "M"],
                  layout="[channels]\nt = { unit = 's' }\nta1 = { column = 'CH1', unit = 'µm/m' }\n"
                  "ta2 = { column = 'CH2', unit = 'um/m' }\nta3 = { column = 'CH3' }\n"
                  "encoder_main = { column = 'enc', unit = 'counts' }\n"
                  "index = { column = 'z', unit = 'counts' }\n"
                  "torque_main = { column = 'M', unit = 'Nm' }\n")
        self.text("no-units.csv", names=NAMES, layout=NO_UNITS)
        self.text("no-units-refused.csv", names=NAMES, expect="refused",
                  says="`unit` of the channel under [recording.channels]")
        self.text("units-row.csv", names=NAMES, units_row=True)
        self.text("units-row-semicolon.csv", names=NAMES, units_row=True, delimiter=";", comma=True)
        swapped = ["t [s]", "ta2 [µm/m]", "ta1 [µm/m]"] + [f"{n} [{UNITS[n]}]" for n in NAMES[3:]]
        self.text("swapped.csv", names=swapped,
                  layout="[channels]\nta1 = { column = 'ta2' }\nta2 = { column = 'ta1' }\n")
        self.text("no-header.csv", header=False,
                  layout=f"columns = {json.dumps([f'{n} [{UNITS[n]}]' for n in NAMES], ensure_ascii=False)}")
        self.text("no-header-semicolon.csv", header=False, delimiter=";", comma=True,
                  layout=f"columns = {json.dumps([f'{n} [{UNITS[n]}]' for n in NAMES], ensure_ascii=False)}")
        self.text("no-header-refused.csv", header=False, delimiter=";", comma=True, expect="refused",
                  says="is not a header")
        self.times_and_pulses()

    def times_and_pulses(self):
        def stamp(pattern, digits, zone=""):
            def at(i):
                time = np.datetime64(EPOCH + STEP * i, "ns").astype(str)
                date, clock = time.split("T")
                clock = clock[: 9 + digits]
                year, month, day = date.split("-")
                return pattern.format(y=year, m=month, d=day, c=clock) + zone
            return at
        bare = ["t"] + [f"{n} [{UNITS[n]}]" for n in NAMES[1:]]
        self.text("iso.csv", names=bare, time=stamp("{y}-{m}-{d}T{c}", 3))
        self.text("iso-space.csv", names=["timestamp"] + bare[1:], time=stamp("{y}-{m}-{d} {c}", 6))
        self.text("iso-zone.csv", names=bare, time=stamp("{y}-{m}-{d}T{c}", 3, "+02:00"))
        self.text("german.csv", names=["Zeit"] + bare[1:], delimiter=";", comma=True,
                  time=lambda i: stamp("{d}.{m}.{y} {c}", 3)(i).replace(".", "#", 2).replace(".", ",").replace("#", "."))
        american = "[channels.t]\ntype = 'timestamp'\nformat = '%m/%d/%Y %H:%M:%S%.f'\n"
        self.text("american.csv", names=bare, time=stamp("{m}/{d}/{y} {c}", 3), layout=american)
        self.text("american-refused.csv", names=bare, time=stamp("{m}/{d}/{y} {c}", 3), expect="refused",
                  says="`format` of the channel under")
        self.text("half-days.csv", names=bare, time=stamp("{m}/{d}/{y} {c} PM", 3), expect="refused",
                  says="`format` of the channel under")
        self.text("zone-once.csv", names=bare, time=lambda i: stamp("{y}-{m}-{d} {c}", 3)(i) + ("Z" if i > 900 else ""),
                  expect="refused", says="with a zone in each row or in none")
        for name, form in (("zone-digits", "{y}-{m}-{d}T{c}+0200"), ("zone-hours", "{y}-{m}-{d} {c} +02:00"),
                           ("zone-name", "{y}-{m}-{d} {c} UTC"), ("slashes", "{y}/{m}/{d} {c}"),
                           ("compact", "{y}{m}{d}T{c}Z")):
            self.text(f"{name}.csv", names=bare, time=stamp(form, 3))
        self.text("clock.csv", names=bare, time=lambda i: f"0:00:{i * 0.002:06.3f}")
        self.text("days.csv", names=bare, time=lambda i: f"0 days 00:00:{i * 0.002:09.6f}")
        self.text("milliseconds.csv", names=["t [ms]"] + bare[1:], time=lambda i: str(2 * i))
        self.text("timestamps.csv", names=["timestamps"] + bare[1:])
        pulse = [n.replace("index [counts]", "index") for n in [f"{n} [{UNITS[n]}]" for n in NAMES]]
        for k, (no, yes) in enumerate((("false", "true"), ("FALSE", "TRUE"), ("False", "True"),
                                       ("off", "on"), ("no", "yes"))):
            self.text(f"bool-{k}.csv", names=pulse, expect="pulse", index=lambda c: yes if c else no)
        self.text("bool-stated.csv", names=pulse, expect="pulse", index=lambda c: "1" if c else "0",
                  layout="[channels.index]\ntype = 'boolean'\n")

    # --- Parquet --------------------------------------------------------------

    def arrays(self):
        arrays = {}
        for name, values in self.data.items():
            arrays[name] = pa.array(values, mask=np.isnan(values))
        return arrays

    def parquet(self, name, arrays, *, units=True, schema_names=None, options=None, **known):
        path = self.add(name, **known)
        fields = []
        for field, array in arrays.items():
            metadata = {"unit": UNITS[field]} if units and field in UNITS else None
            fields.append(pa.field(field, array.type, metadata=metadata))
        table = pa.Table.from_arrays(list(arrays.values()), schema=pa.schema(fields))
        if schema_names:
            table = table.rename_columns(schema_names)
        pq.write_table(table, path, **(options or {}))

    def all_parquet(self):
        plain = self.arrays()
        self.parquet("pyarrow.parquet", plain)
        for codec in ("none", "snappy", "gzip", "brotli", "zstd", "lz4"):
            self.parquet(f"pyarrow-{codec}.parquet", plain, options={"compression": codec})
        self.parquet("pyarrow-v2.parquet", plain, options={"data_page_version": "2.0"})
        self.parquet("pyarrow-groups.parquet", plain, options={"row_group_size": 101})
        self.parquet("pyarrow-pages.parquet", plain, options={"data_page_size": 256, "use_dictionary": False})
        self.parquet("pyarrow-split.parquet", plain,
                     options={"use_dictionary": False, "use_byte_stream_split": True})
        change = lambda **new: {**plain, **new}
        cast = lambda name, kind: {name: plain[name].cast(kind)}
        self.parquet("float16.parquet", change(**cast("ta1", pa.float16())))
        self.parquet("float32.parquet", change(**cast("ta2", pa.float32())))
        for kind in (pa.int64(), pa.uint64(), pa.int32(), pa.uint32()):
            self.parquet(f"encoder-{kind}.parquet", change(**cast("encoder_main", kind)))
        ta3 = self.data["ta3"]
        text = pa.array([f"{v:.3f}" for v in ta3])
        for kind in (pa.decimal32(9, 3), pa.decimal64(12, 3), pa.decimal128(12, 3)):
            digits = text.cast(pa.decimal128(12, 3)).cast(kind)
            self.parquet(f"decimal{kind.bit_width}.parquet", change(ta3=digits))
        self.parquet("dictionary.parquet", change(ta3=plain["ta3"].dictionary_encode()))
        self.parquet("dictionary-index.parquet", change(index=plain["index"].dictionary_encode()))
        self.parquet("text.parquet", change(ta3=text), expect="refused", says="`type` of the channel")
        typed = "[channels.ta3]\ntype = 'number'\n"
        self.parquet("text-stated.parquet", change(ta3=text), layout=typed)
        self.parquet("text-dictionary.parquet", change(ta3=text.dictionary_encode()), layout=typed)
        ns = EPOCH + STEP * np.arange(self.n)
        for unit, divide in (("ms", 10**6), ("us", 10**3), ("ns", 1)):
            whole = pa.array(ns // divide)
            self.parquet(f"timestamp-{unit}.parquet", change(t=whole.cast(pa.timestamp(unit))))
            self.parquet(f"timestamp-{unit}-zone.parquet",
                         change(t=whole.cast(pa.timestamp(unit, tz="Europe/Berlin"))))
            since = pa.array((ns - EPOCH) // divide)
            self.parquet(f"duration-{unit}.parquet", change(t=since.cast(pa.duration(unit))))
        self.parquet("time32.parquet", change(t=pa.array(((ns - EPOCH) // 10**6).astype("i4")).cast(pa.time32("ms"))))
        self.parquet("time64.parquet", change(t=pa.array(ns - EPOCH).cast(pa.time64("ns"))))
        stamps = pa.array(np.datetime_as_string(ns.astype("M8[ns]"), unit="ms"))
        self.parquet("timestamp-text.parquet", change(t=stamps), layout="[channels.t]\ntype = 'timestamp'\n")
        pulse = pa.array(~np.isnan(self.data["index"]))
        no_unit = {k: v for k, v in plain.items() if k != "index"} | {"pulse": pulse}
        as_pulse = "[channels.index]\ncolumn = 'pulse'\n"
        self.parquet("bool.parquet", no_unit, expect="pulse", layout=as_pulse)
        self.parquet("bool-int8.parquet", no_unit | {"pulse": pulse.cast(pa.int8())}, expect="pulse",
                     layout=as_pulse + "unit = '1'\n")
        self.parquet("bool-dictionary.parquet", no_unit | {"pulse": pulse.cast(pa.int8()).dictionary_encode()},
                     expect="pulse", layout=as_pulse + "unit = '1'\n")
        self.parquet("no-units.parquet", plain, units=False, layout=NO_UNITS)
        titles = [f"{n} [{UNITS[n]}]" for n in NAMES]
        self.parquet("titles.parquet", plain, units=False, schema_names=titles)
        spare = plain | {"spare": text, "other": text}
        self.parquet("duplicates.parquet", spare, schema_names=NAMES + ["spare", "spare"])
        self.parquet("duplicate-wanted.parquet", spare, schema_names=NAMES + ["spare", "ta1"],
                     expect="refused", says="`ta1` is there twice")
        self.parquet("asammdf-export.parquet", plain, units=False, schema_names=["timestamps"] + titles[1:])
        self.polars_and_duckdb(titles)
        self.pandas(titles)

    def polars_and_duckdb(self, titles):
        columns = {}
        for title, name in zip(titles, NAMES):
            values = polars.Series(title, self.data[name])
            columns[title] = values.fill_nan(None)
        frame = polars.DataFrame(columns)
        frame.write_parquet(self.add("polars.parquet"))
        frame.write_parquet(self.add("polars-zstd.parquet"), compression="zstd", row_group_size=500)
        since = polars.Series("t", STEP * np.arange(self.n)).cast(polars.Duration("ns"))
        frame.with_columns(since).drop(titles[0]).write_parquet(self.add("polars-duration.parquet"))
        stamps = polars.Series("t", EPOCH + STEP * np.arange(self.n)).cast(polars.Datetime("ns"))
        frame.with_columns(stamps.alias("Time")).drop(titles[0]).write_parquet(self.add("polars-datetime.parquet"))
        single = frame.with_columns(polars.col(titles[2]).cast(polars.Float32))
        single.write_parquet(self.add("polars-f32.parquet"), compression="snappy")
        db = duckdb.connect()
        db.register("frame", frame.to_arrow())
        for name, options in (("duckdb", ""), ("duckdb-zstd", ", COMPRESSION zstd"),
                              ("duckdb-v2", ", PARQUET_VERSION v2"), ("duckdb-groups", ", ROW_GROUP_SIZE 2048")):
            path = self.add(f"{name}.parquet")
            db.execute(f"COPY (SELECT * FROM frame) TO '{path}' (FORMAT parquet{options})")
        path = self.add("duckdb-timestamp.parquet")
        db.execute(
            "COPY (SELECT TIMESTAMP '2026-01-01' + INTERVAL (1) MICROSECOND * CAST(round(\"t [s]\" * 1e6) AS BIGINT)"
            f" AS t, * EXCLUDE \"t [s]\" FROM frame) TO '{path}' (FORMAT parquet)")

    def pandas(self, titles):
        frame = pandas.DataFrame({title: self.data[name] for title, name in zip(titles, NAMES)})
        nan = 'written_nan = "missing"'
        frame.to_parquet(self.add("pandas.parquet", layout=nan))
        stamped = frame.drop(columns=titles[0])
        stamped.index = pandas.to_datetime(EPOCH + STEP * np.arange(self.n), unit="ns")
        stamped.index.name = "t"
        stamped.to_parquet(self.add("pandas-datetime.parquet", layout=nan))
        stamped.index = pandas.to_timedelta(STEP * np.arange(self.n), unit="ns")
        stamped.index.name = "time"
        stamped.to_parquet(self.add("pandas-timedelta.parquet", layout=nan))
        stamped.index = self.data["t"]
        stamped.index.name = "timestamps"
        stamped.to_parquet(self.add("pandas-float.parquet", layout=nan))
        frame.to_parquet(self.add("pandas-fields.parquet", layout=nan), engine="pyarrow", compression=None)

    # --- MDF4 -----------------------------------------------------------------

    def signal(self, name, rows=slice(None), at=None, values=None, unit=None, **options):
        t = self.data["t"][rows] if at is None else at
        values = self.data[name][rows] if values is None else values
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(len(values), bool)
        if missing.any():
            options["invalidation_bits"] = missing
            values = np.nan_to_num(values)
        unit = UNITS.get(name, "") if unit is None else unit
        return Signal(values, t, name=name, unit=unit, **options)

    def signals(self, names=NAMES[1:], **options):
        return [self.signal(name, **options) for name in names]

    def mdf(self, name, groups, *, version="4.10", compression=0, before=None, **known):
        path = self.add(name, **known)
        mdf = MDF(version=version)
        for group in groups:
            mdf.append(group, common_timebase=True)
        if before:
            before(mdf)
        mdf.save(path, compression=compression, overwrite=True)
        mdf.close()

    def all_mdf(self):
        everything = self.signals()
        for version in ("4.00", "4.10", "4.11", "4.20"):
            for compression in (0, 1, 2):
                self.mdf(f"plain-{version}-{compression}.mf4", [everything], version=version,
                         compression=compression)
        self.types()
        self.groups()
        self.rates()
        self.unsorted()

    def types(self):
        others = lambda *names: self.signals([n for n in NAMES[1:] if n not in names])
        ta1, ta2, ta3 = (self.data[n] for n in ("ta1", "ta2", "ta3"))
        half = self.signal("ta1", values=ta1.astype("<f2"))
        for compression in (0, 2):
            self.mdf(f"half-{compression}.mf4", [others("ta1") + [half]], compression=compression)
        scaled = Signal((ta1 / 4).astype("<f2"), self.data["t"], name="ta1", unit="µm/m",
                        conversion={"a": 4.0, "b": 0.0})
        self.mdf("half-scaled.mf4", [others("ta1") + [scaled]])
        both = [self.signal("ta1", values=ta1.astype("<f2")), self.signal("ta2", values=ta2.astype("<f4"))]
        self.mdf("half-and-single.mf4", [both + others("ta1", "ta2")])
        self.mdf("half-apart.mf4", [others("ta1"), [half]])
        words = np.round(ta3 * 1000)
        for kind in ("<i4", "<i8"):
            ints = Signal(words.astype(kind), self.data["t"], name="ta3", unit="µm/m",
                          conversion={"a": 0.001, "b": 0.0})
            self.mdf(f"linear-{kind[1:]}.mf4", [others("ta3") + [ints]])
        shift = Signal((words + 500_000).astype("<u4"), self.data["t"], name="ta3", unit="µm/m",
                       conversion={"a": 0.001, "b": -500.0})
        self.mdf("linear-u4.mf4", [others("ta3") + [shift]], compression=1)
        for kind in ("<u4", "<i4", "<i8", "<u8"):
            self.mdf(f"encoder-{kind[1:]}.mf4",
                     [others("encoder_main") + [self.signal("encoder_main", values=self.data["encoder_main"].astype(kind))]])
        for k, name in enumerate(("ta1", "ta3", "torque_main", "encoder_main", "index")):
            # The unit of the conversion holds where the channel has none.
            plain = self.signal(name, unit="")
            plain.conversion = from_dict({"a": 1.0, "b": 0.0, "unit": UNITS[name]})
            plain.conversion.unit = UNITS[name]
            self.mdf(f"conversion-unit-{k}.mf4", [others(name) + [plain]])
        self.mdf("no-unit.mf4", [others("ta1") + [self.signal("ta1", unit="")]], expect="refused",
                 says="`ta1` has no unit")
        self.mdf("no-unit-stated.mf4", [others("ta1") + [self.signal("ta1", unit="")]],
                 layout="[channels.ta1]\nunit = 'µm/m'\n")
        # Text of variable length beside the sensors.
        texts = np.array([f"line {i} {'x' * (i % 17)}" for i in range(self.n)], dtype="S")
        note = Signal(texts, self.data["t"], name="note", encoding="utf-8")
        for compression in (0, 2):
            self.mdf(f"vlsd-{compression}.mf4", [self.signals() + [note]], compression=compression)
        label = lambda values: Signal(values, self.data["t"], name="pulse", unit="", conversion={
            "val_0": 0, "text_0": b"low", "val_1": 1, "text_1": b"high", "default": b""})
        pulse = ~np.isnan(self.data["index"])
        stated = "[channels.index]\ncolumn = 'pulse'\nunit = '1'\n"
        self.mdf("labels.mf4", [others("index") + [label(pulse.astype("<u1"))]], expect="pulse", layout=stated)
        bit = Signal(pulse, self.data["t"], name="pulse", unit="")
        self.mdf("bit.mf4", [others("index") + [bit]], expect="pulse", layout=stated)
        byte = Signal(pulse.astype("<u1"), self.data["t"], name="pulse", unit="")
        self.mdf("byte.mf4", [others("index") + [byte]], expect="pulse", layout=stated)
        single = Signal(pulse.astype("<f4"), self.data["t"], name="pulse", unit="")
        self.mdf("pulse-single.mf4", [others("index") + [single]], expect="pulse", layout=stated)
        self.mdf("pulse-apart.mf4", [others("index"), [byte]], expect="pulse", layout=stated)
        text = Signal(np.array([b"high", b"low "] * (self.n // 2)), self.data["t"], name="ta1",
                      unit="µm/m", encoding="utf-8")
        self.mdf("text.mf4", [others("ta1") + [text]], expect="refused", says="`ta1` holds text")

    def groups(self):
        t = self.data["t"]
        none = [Signal(np.array([], "<f8"), np.array([], "<f8"), name="event_marker")]
        page = [Signal(np.array([1.0]), np.array([0.0]), name="cal_page")]
        slow = np.arange(0.0, t[-1], 0.5)
        warm = [Signal(20.0 + slow, slow, name="housing_temperature", unit="°C")]
        everything = self.signals()
        for k, before in enumerate(([none], [page], [warm], [none, page, warm], [page, page])):
            self.mdf(f"before-{k}.mf4", [*before, everything])
            self.mdf(f"after-{k}.mf4", [everything, *before], compression=2)
        gauges = self.signals(["ta1", "ta2", "ta3"])
        motion = self.signals(["encoder_main", "index"])
        torque = self.signals(["torque_main"])
        for k, groups in enumerate(([gauges, motion, torque], [torque, motion, gauges], [motion, gauges + torque],
                                    [warm, torque, gauges + motion], [gauges + motion, torque],
                                    *[[self.signals([n]) for n in NAMES[1:]]])):
            self.mdf(f"devices-{k}.mf4", groups)
        late = lambda names, by: [self.signal(n, at=t + by) for n in names]
        self.mdf("device-late.mf4", [gauges, late(["encoder_main", "index"], 0.0003), torque],
                 says="beside the other channels")
        spare = lambda: Signal(t, t, name="spare")
        for k, groups in enumerate(([everything + [spare(), spare()]], [everything, [spare()], [spare()]],
                                    [[spare()], everything + [spare()]], [everything + [spare()] * 5],
                                    [[spare(), spare()], everything])):
            self.mdf(f"duplicate-{k}.mf4", groups)
        self.mdf("duplicate-wanted.mf4", [everything + self.signals(["ta1"])], expect="refused",
                 says="`ta1` is there twice")
        renamed = [self.signal(n) for n in NAMES[1:]]
        for signal in renamed:
            signal.name = f"Bench.{signal.name}\\XCP:1"
        layout = "[channels]\n" + "".join(f"{n} = {{ column = 'Bench.{n}\\XCP:1' }}\n" for n in NAMES[1:])
        self.mdf("renamed.mf4", [renamed], layout=layout)
        self.mdf("renamed-groups.mf4", [renamed[3:], renamed[:3]], layout=layout)
        self.stops()

    def stops(self):
        n = self.n
        part = lambda a, b: self.signals(rows=slice(a, b))
        halves = [part(0, n // 2), part(n // 2, n)]
        self.mdf("stopped.mf4", halves, says="follow each other")
        self.mdf("stopped-backwards.mf4", halves[::-1], says="follow each other")
        self.mdf("stopped-thrice.mf4", [part(0, 400), part(400, 401), part(401, n)], says="follow each other")
        self.mdf("stopped-many.mf4", [part(i, min(i + 100, n)) for i in range(0, n, 100)], compression=2)
        ends = [self.signals(NAMES[1:-1], rows=slice(a, b)) for a, b in ((0, 700), (700, n))]
        self.mdf("stopped-reference.mf4", [*ends, self.signals(["torque_main"])], says="follow each other")
        self.mdf("stopped-both.mf4", [ends[0], self.signals(["torque_main"], rows=slice(0, 900)), ends[1],
                                     self.signals(["torque_main"], rows=slice(900, n))])
        again = self.signals(rows=slice(0, n // 2))
        self.mdf("restarted-at-zero.mf4", [again, again], expect="refused",
                 says="`index` is in the channel groups 1 and 2 over the same time")
        self.mdf("chosen.mf4", [again, self.signals()],
                 layout="[channels]\n" + "".join(f"{n} = {{ group = '2' }}\n" for n in NAMES[1:]))

    def rates(self):
        t = self.data["t"]
        thin = [self.signal(n, rows=slice(None, None, 10)) for n in NAMES[1:]]
        self.mdf("slow-copy.mf4", [thin, self.signals()], says="with other periods")
        fine = np.arange(t[0], t[-1], 0.0002)
        dense = [Signal(np.interp(fine, t, np.nan_to_num(self.data[n])), fine, name=n, unit=UNITS[n]) for n in NAMES[1:]]
        self.mdf("fast-copy.mf4", [dense, self.signals()], says="with other periods")
        sensors = self.signals(NAMES[1:-1])
        for k, step in enumerate((10, 50)):
            reference = [self.signal("torque_main", rows=slice(None, None, step))]
            self.mdf(f"slow-reference-{k}.mf4", [sensors, reference], expect="samples", says="is interpolated")
            self.mdf(f"slow-reference-first-{k}.mf4", [reference, sensors], expect="samples", says="is interpolated")
        torque = [Signal(np.interp(fine, t, self.data["torque_main"]), fine, name="torque_main", unit="Nm")]
        self.mdf("fast-reference.mf4", [torque, sensors], expect="samples", says="is averaged")
        others = self.signals([n for n in NAMES[1:] if n != "ta3"])
        thin = [self.signal("ta3", rows=slice(None, None, 5))]
        self.mdf("sensor-rates.mf4", [others, thin], expect="refused", says="all sensors at one rate")
        self.mdf("sensor-rates-first.mf4", [thin, others], expect="refused", says="all sensors at one rate")

    # --- MDF4, records of several groups in one stream ---------------------------

    def unsorted(self):
        t = self.data["t"]
        slow = np.arange(0.0, t[-1], 0.25)
        warm = {"housing_temperature": (20.0 + slow, "°C")}
        plain = {n: (np.nan_to_num(self.data[n]), UNITS[n]) for n in NAMES[1:] if n != "index"}
        plain["pulse"] = ((~np.isnan(self.data["index"])).astype("f8"), "1")
        stated = "[channels.index]\ncolumn = 'pulse'\n"
        for k, groups in enumerate(([(t, plain), (slow, warm)], [(slow, warm), (t, plain)],
                                    [(t, {n: plain[n] for n in list(plain)[:3]}), (t, {n: plain[n] for n in list(plain)[3:]})],
                                    [(t, {n: plain[n] for n in list(plain)[:4]}), (slow, warm), (t, {n: plain[n] for n in list(plain)[4:]})],
                                    [(t, {n: v}) for n, v in plain.items()])):
            # Whole, and in blocks within which records end anywhere.
            for name, written in (("", {}), ("-blocks", dict(split=777)), ("-wide", dict(split=70001, id_size=8)),
                                  ("-dz", dict(split=5001, width=0)), ("-dzt", dict(split=4999, width=33))):
                path = self.add(f"unsorted-{k}{name}.mf4", expect="pulse", layout=stated)
                path.write_bytes(unsorted_mdf(groups, **written))
                with MDF(path) as mdf:
                    found = mdf.get("ta3")
                    assert np.array_equal(found.samples, self.data["ta3"])


def main():
    writer = Writer(sys.argv[1], sys.argv[2])
    writer.all_text()
    writer.all_parquet()
    writer.all_mdf()
    write_foreign_files(writer)
    write_unread_parts(writer)
    manifest = json.dumps(writer.manifest, ensure_ascii=False, indent=1)
    (writer.folder / "manifest.json").write_text(manifest, encoding="utf-8")


if __name__ == "__main__":
    main()
