"""Replays of tables and streams on the shipped gearbox recording: the same bits from pyarrow, polars, pandas and
DuckDB, also cut anywhere; bounded memory; interrupts, forks and dropped streams.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import duckdb
import h5py
import numpy as np
import pandas
import polars
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from nptdms import ChannelObject, TdmsFile, TdmsWriter

import loadtwin

GEARBOX = "examples/gearbox/calibrated.toml"
RECORDING = "examples/gearbox/start-stop.parquet"


class TestReplay(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.machine = loadtwin.Machine(GEARBOX)
        self.table = pq.read_table(RECORDING)[:12000]

    def at(self, name):
        return str(Path(self.folder.name) / name)

    def test_tables_of_all_libraries_give_the_same(self):
        whole = pa.table(self.machine.replay(self.table)[0])
        frame = self.table.to_pandas()
        frame.columns = [f"{f.name} [{f.metadata[b'unit'].decode()}]" for f in self.table.schema]
        names = dict(zip(self.table.schema.names, frame.columns))
        connection, other = duckdb.connect(), duckdb.connect()
        for each in (connection, other):
            each.register("recording", self.table.rename_columns(list(names.values())))
        tables = {
            "pyarrow": self.table,
            "polars": polars.from_arrow(self.table).rename(names),
            "pandas": frame,
            "DuckDB": connection.sql("select * from recording"),
            "batches of DuckDB": other.sql("select * from recording").to_arrow_reader(2048),
            "stream": self.table.to_reader(max_chunksize=777),
        }
        for name, table in tables.items():
            with self.subTest(name):
                found, _ = self.machine.replay(table)
                self.assertTrue(pa.table(found).equals(whole))
        found, _ = self.machine.replay(self.table)
        self.assertEqual(polars.DataFrame(found).height, len(found))
        self.assertEqual(len(pandas.DataFrame.from_arrow(found)), len(found))
        self.assertEqual(duckdb.sql("select count(*) from found").fetchall(), [(len(found),)])

    def test_a_cut_anywhere_gives_the_same_bits(self):
        whole = pa.table(self.machine.replay(self.table)[0])
        cuts = sorted(np.random.default_rng(1).integers(2, len(self.table), 5).tolist())
        pieces, state = [], None
        for start, end in zip([0, *cuts], [*cuts, len(self.table)]):
            piece, state = self.machine.replay(self.table[start:end], state, more=end < len(self.table))
            pieces.append(pa.table(piece))
        self.assertTrue(pa.concat_tables(pieces).combine_chunks().equals(whole.combine_chunks()))

    def test_other_formats_in_three_lines(self):
        signals = {f"{f.name} [{f.metadata[b'unit'].decode()}]": self.table[f.name].to_numpy() for f in self.table.schema}
        whole, _ = self.machine.replay(self.table)
        with TdmsWriter(self.at("r.tdms")) as writer:
            writer.write_segment([ChannelObject("log", name, values) for name, values in signals.items()])
        scipy.io.savemat(self.at("r.mat"), {"signals": [signals[name] for name in signals], "names": list(signals)})
        with h5py.File(self.at("r.h5"), "w") as file:
            for field in self.table.schema:
                file[field.name] = self.table[field.name].to_numpy()
                file[field.name].attrs["unit"] = field.metadata[b"unit"].decode()

        # TDMS
        group = TdmsFile.read(self.at("r.tdms"))["log"]
        tdms = pa.table({channel.name: pa.array(channel[:], from_pandas=True) for channel in group.channels()})
        # MAT
        mat = scipy.io.loadmat(self.at("r.mat"), chars_as_strings=True)
        mat = pa.table([pa.array(row, from_pandas=True) for row in mat["signals"]], [name.strip() for name in mat["names"]])
        # HDF5
        with h5py.File(self.at("r.h5")) as file:
            unit = lambda data: {"unit": data.attrs["unit"]}
            schema = pa.schema([pa.field(name, pa.float64(), metadata=unit(data)) for name, data in file.items()])
            hdf5 = pa.table([pa.array(data[:], from_pandas=True) for data in file.values()], schema=schema)

        for name, table in {"TDMS": tdms, "MAT": mat, "HDF5": hdf5}.items():
            with self.subTest(name):
                found, _ = self.machine.replay(table)
                self.assertTrue(pa.table(found).equals(pa.table(whole)))

    def test_a_stream_takes_no_more_memory_when_it_is_longer(self):
        script = Path(__file__).with_name("stream_memory.py")

        def peak(rows, source):
            call = [sys.executable, script, str(rows), source]
            return int(subprocess.run(call, check=True, capture_output=True, text=True).stdout)

        rows = int(os.environ.get("LOADTWIN_ROWS", "400000"))
        for source in ("arrays", "DuckDB"):
            with self.subTest(source):
                short, long = peak(100_000, source), peak(rows, source)
                print(f"{source}: {short / 1e6:.0f} MB for 100000 rows, {long / 1e6:.0f} MB for {rows}")
                self.assertLess(long, 1.05 * short + 8e6)

    def test_many_calls_leave_nothing_behind(self):
        part = self.table[:1000]

        def resident():
            pages = Path("/proc/self/statm").read_text().split()[1]
            return int(pages) * os.sysconf("SC_PAGE_SIZE")

        text = Path(GEARBOX).read_text().replace("rate_hz = 500", "rate_hz = 0")
        wrong = [
            lambda: self.machine.replay(part, b"none"),
            lambda: self.machine.replay(part.drop_columns(["ta1"])),
            lambda: self.machine.replay(part, filter="none"),
            lambda: self.machine.replay(self.at("none.parquet")),
            lambda: loadtwin.Machine(text),
        ]

        def call(times):
            for k in range(times):
                self.machine.replay(part, more=True)
                # A stream that nobody reads.
                self.machine.stream(part)
                with self.assertRaises(loadtwin.Error):
                    wrong[k % len(wrong)]()

        call(50)
        before = resident()
        calls = int(os.environ.get("LOADTWIN_CALLS", "1000"))
        began = time.monotonic()
        call(calls)
        grown = resident() - before
        print(f"{3 * calls} calls: {grown / 1e6:.1f} MB more, {time.monotonic() - began:.0f} s")
        self.assertLess(grown, 8e6)

    def test_an_interrupt_ends_a_long_call(self):
        def endless():
            batch = self.table.to_batches()[0].slice(0, 1000)
            time_of = batch.schema.get_field_index("t")
            rows = 0
            while True:
                columns = batch.columns
                columns[time_of] = pa.array((np.arange(1000) + rows) / 500.0)
                rows += 1000
                yield pa.RecordBatch.from_arrays(columns, schema=batch.schema)

        # A process started in the background of a script ignores interrupts.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        self.addCleanup(signal.signal, signal.SIGINT, before)
        for call in (
            lambda: self.machine.replay(pa.RecordBatchReader.from_batches(self.table.schema, endless())),
            lambda: self.machine.diagnose(RECORDING),
        ):
            timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
            timer.start()
            began = time.monotonic()
            with self.assertRaises(KeyboardInterrupt):
                call()
            self.assertLess(time.monotonic() - began, 30)

    def test_a_program_ends_while_replays_run(self):
        begin = """
import sys, loadtwin, pyarrow as pa, pyarrow.parquet as pq, pandas
machine = loadtwin.Machine(sys.argv[1])
table = pq.read_table(sys.argv[2])
def endless():
    while True:
        yield from table.to_batches(max_chunksize=1000)
endless = pa.RecordBatchReader.from_batches(table.schema, endless())
"""
        for end, code in {
            # Refused at once: a unit is missing.
            "machine.replay(pandas.read_parquet(sys.argv[2]))": 1,
            "stream = machine.stream(endless)": 0,
            "machine.stream(endless)": 0,
            "next(iter(pa.RecordBatchReader.from_stream(machine.stream(table)))); raise KeyError": 1,
        }.items():
            for _ in range(5):
                done = subprocess.run(
                    [sys.executable, "-c", begin + end, GEARBOX, RECORDING], capture_output=True, text=True, timeout=60
                )
                self.assertEqual(done.returncode, code, f"{end}\n{done.stderr}")

    def test_a_stream_of_a_forked_process_is_refused(self):
        stream = self.machine.stream(self.table)
        child = os.fork()
        if child == 0:
            try:
                stream.read_all()
                os._exit(1)
            except loadtwin.Error:
                os._exit(0)
        self.assertEqual(os.waitpid(child, 0)[1], 0)
        self.assertEqual(len(stream.read_all()), len(self.table))

    def test_a_dropped_stream_reads_no_more(self):
        read = 0

        def batches():
            nonlocal read
            for batch in self.table.to_batches(max_chunksize=100):
                read += 1
                time.sleep(0.01)
                yield batch

        stream = self.machine.stream(pa.RecordBatchReader.from_batches(self.table.schema, batches()))
        del stream
        time.sleep(0.5)
        self.assertLess(read, 10)

    def test_estimates_that_lag_are_given_once(self):
        machine = loadtwin.Machine("examples/rotor/machine.toml")
        machine.simulate(self.at("rotor.parquet"), duration_s=1)
        table = pq.read_table(self.at("rotor.parquet"))
        text = Path("examples/rotor/machine.toml").read_text()
        Path(self.at("lag.toml")).write_text(text.replace("[rotor]", "[rotor]\nlag_samples = 3", 1))
        machine = loadtwin.Machine(self.at("lag.toml"))
        _, state = machine.replay(table[:2000])
        self.assertIsNone(state)
        first, state = machine.replay(table[:2000], more=True)
        second, _ = machine.replay(table[2000:], state)
        self.assertEqual(len(first) + len(second), len(table))

    def test_an_error_is_of_the_package(self):
        with self.assertRaises(loadtwin.Error) as caught:
            self.machine.replay(self.table, filter="none")
        again = pickle.loads(pickle.dumps(caught.exception))
        self.assertEqual((type(again), str(again)), (loadtwin.Error, str(caught.exception)))

    def test_other_threads_run_meanwhile(self):
        done = threading.Event()
        counted = 0
        thread = threading.Thread(target=lambda: (self.machine.replay(RECORDING), done.set()))
        thread.start()
        while not done.wait(0.001):
            counted += 1
        thread.join()
        self.assertGreater(counted, 5)


if __name__ == "__main__":
    unittest.main()
