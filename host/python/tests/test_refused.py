"""Wrong input, in at least a hundred forms, is an exception with a reason, and never the end of the process."""

import gc
import os
import re
import tempfile
import unittest
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import loadtwin

GEARBOX = "examples/gearbox/calibrated.toml"
RECORDING = "examples/gearbox/start-stop.parquet"


class Liar:
    """Hands out something that is no stream."""

    def __init__(self, capsule):
        self.capsule = capsule

    def __arrow_c_stream__(self, requested_schema=None):
        if isinstance(self.capsule, Exception):
            raise self.capsule
        return self.capsule


class TestRefused(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.machine = loadtwin.Machine(GEARBOX)
        cls.table = pq.read_table(RECORDING)[:2000]
        cls.text = Path(GEARBOX).read_text()
        cls.refused = 0

    @classmethod
    def tearDownClass(cls):
        assert cls.refused >= 100, f"{cls.refused} wrong inputs"

    def refuse(self, call, *said, error=loadtwin.Error):
        with self.assertRaises(error) as found:
            call()
        for text in said:
            self.assertIn(text, str(found.exception))
        type(self).refused += 1

    def replaced(self, name, values):
        at = self.table.schema.get_field_index(name)
        values = pa.array(values)
        return self.table.set_column(at, self.table.schema.field(name).with_type(values.type), values)

    def test_tables(self):
        t = self.table["t"].to_numpy()
        first = [n for n in self.table.schema.names if n != "t"][0]
        values = self.table[first].to_numpy().astype(float)
        infinite, nan = values.copy(), values.copy()
        infinite[7], nan[7] = np.inf, np.nan
        holes = t.copy()
        holes[1000:] += 1000.0
        unit = lambda unit: self.table.replace_schema_metadata().cast(
            pa.schema([f.with_metadata({"unit": unit}) if f.name == first else f for f in self.table.schema])
        )
        tables = {
            "no columns": pa.table({}),
            "no rows": self.table[:0],
            "one row": self.table[:1],
            "no time": self.table.drop_columns(["t"]),
            "a channel missing": self.table.drop_columns([first]),
            "a channel twice": self.table.append_column(self.table.schema.field(first), self.table[first]),
            "time that stands": self.replaced("t", np.zeros(len(t))),
            "time that runs backwards": self.replaced("t", t[::-1].copy()),
            "time without numbers": self.replaced("t", [None] * len(t)),
            "time with a hole": self.replaced("t", holes),
            "another rate": self.replaced("t", 3 * t),
            "time that no clock shows": self.replaced("t", t + 1e15),
            "text": self.replaced(first, ["a"] * len(t)),
            "lists": self.replaced(first, [[1.0]] * len(t)),
            "structures": self.replaced(first, [{"a": 1}] * len(t)),
            "bytes": self.replaced(first, [b"1"] * len(t)),
            "dates": self.replaced(first, pa.array([0] * len(t), pa.date32())),
            "infinity": self.replaced(first, infinite),
            "NaN": self.replaced(first, nan),
            "an unknown unit": unit("furlong"),
            "a unit of another quantity": unit("kg"),
        }
        for channel in ("ta1", "ta2", "ta3", "encoder_main"):
            tables[f"no {channel}"] = self.table.drop_columns([channel])
            tables[f"text as {channel}"] = self.replaced(channel, ["1"] * len(t))
            tables[f"lists as {channel}"] = self.replaced(channel, [[1.0]] * len(t))
        for name, table in tables.items():
            with self.subTest(name):
                self.refuse(lambda: self.machine.replay(table), "table")

    def test_streams(self):
        other = pa.record_batch({"x": [1.0]})

        def fails():
            yield self.table.to_batches()[0]
            raise RuntimeError("the disk is gone")

        read = self.table.to_reader()
        self.machine.replay(read)
        started = self.machine.stream(self.table)
        started.read_all()
        cases = {
            "a producer that fails": pa.RecordBatchReader.from_batches(self.table.schema, fails()),
            "a stream that was read": read,
            "no capsule": Liar(1),
            "none": Liar(None),
            "a capsule of a schema": Liar(self.table.schema.__arrow_c_schema__()),
            "a capsule that was moved": Liar(self.moved()),
            "a method that fails": Liar(RuntimeError("no")),
            "batches of another schema": Liar(other.__arrow_c_stream__()),
            "a number": 7,
            "a list": [1, 2],
            "nothing": None,
        }
        for name, stream in cases.items():
            with self.subTest(name):
                self.refuse(lambda: self.machine.replay(stream), error=Exception)
        self.refuse(started.read_all, "once", error=RuntimeError)
        self.refuse(started.__arrow_c_stream__, "once", error=RuntimeError)

    def moved(self):
        capsule = self.table.__arrow_c_stream__()
        pa.RecordBatchReader._import_from_c_capsule(capsule)
        return capsule

    def test_files_and_options(self):
        with tempfile.TemporaryDirectory() as folder:
            at = lambda name: os.path.join(folder, name)
            Path(at("noise.parquet")).write_bytes(b"PAR1" + bytes(range(256)))
            Path(at("empty.csv")).write_text("")
            Path(at("video.mp4")).write_bytes(b"\0\0\0\x18ftypmp42")
            for name in ("noise.parquet", "empty.csv", "video.mp4", "missing.csv", ""):
                with self.subTest(name):
                    self.refuse(lambda: self.machine.replay(at(name)))
            self.refuse(lambda: self.machine.replay(RECORDING, sensors="none"), "none")
            self.refuse(lambda: self.machine.replay(RECORDING, filter="best"), "aekf")
            self.refuse(lambda: self.machine.replay(RECORDING, 7), error=TypeError)
            self.refuse(lambda: self.machine.evaluate(RECORDING, colour="red"), "colour")
            self.refuse(lambda: self.machine.simulate(at("a.parquet"), scenario="none"), "none")
            self.refuse(lambda: self.machine.simulate(at("a.xls")), "xls")
            self.refuse(lambda: self.machine.build(GEARBOX), "calibrated.toml")
            self.refuse(lambda: self.machine.life(), "required")

    def test_states(self):
        _, state = self.machine.replay(self.table, more=True)
        rest = pq.read_table(RECORDING)[2000:3000]
        for name, wrong in {
            "empty": b"",
            "text": b"loadtwin state 1\n",
            "cut": state[:-1],
            "longer": state + b"\0",
            **{
                f"another bit of byte {k}": state[:k] + bytes([state[k] ^ 1]) + state[k + 1 :]
                for k in range(0, len(state), len(state) // 20)
            },
        }.items():
            with self.subTest(name):
                self.refuse(lambda: self.machine.replay(rest, wrong), "state")
        other = loadtwin.Machine("examples/gearbox/machine.toml")
        self.refuse(lambda: other.replay(rest, state), "another model")
        self.refuse(lambda: self.machine.replay(self.table, state), "table")
        self.machine.replay(rest, state)

    def test_descriptions(self):
        cases = {
            "no text": "\n",
            "no TOML": "what\never",
            "another format": self.text.replace("format = 1", "format = 99"),
            "an unknown field": self.text + "\n[nothing]\nx = 1\n",
            "a rate of zero": self.text.replace("rate_hz = 500", "rate_hz = 0"),
            "a rate that is text": self.text.replace("rate_hz = 500", 'rate_hz = "fast"'),
            "cut in the middle": self.text[: len(self.text) // 2],
            "control characters": "\0\n\0",
            "no rate": re.sub(r"(?m)^rate_hz = .*$", "", self.text),
            "a field twice": self.text.replace("rate_hz = 500", "rate_hz = 500\nrate_hz = 500"),
            "a rate that is not finite": self.text.replace("rate_hz = 500", "rate_hz = inf"),
            "a negative rate": self.text.replace("rate_hz = 500", "rate_hz = -500"),
            "a rate without end": self.text.replace("rate_hz = 500", "rate_hz = 1e300"),
        }
        # Nothing stays of a text, and nobody is warned of it.
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            before, tempfile.tempdir = tempfile.tempdir, folder
            try:
                for name, text in cases.items():
                    with self.subTest(name):
                        self.refuse(lambda: loadtwin.Machine(text))
                self.assertEqual(loadtwin.Machine(self.text).rate_hz, 500.0)
                gc.collect()
                self.assertEqual(os.listdir(folder), [])
            finally:
                tempfile.tempdir = before
        self.assertEqual([str(warning.message) for warning in warned], [])
        self.refuse(lambda: loadtwin.Machine("examples/none.toml"), "none.toml")
        self.refuse(lambda: loadtwin.Machine(RECORDING), "Parquet")
        self.refuse(lambda: loadtwin.Machine("examples"))
        self.refuse(lambda: loadtwin.Machine(7), error=TypeError)


if __name__ == "__main__":
    unittest.main()
