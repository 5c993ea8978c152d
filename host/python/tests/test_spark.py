"""The archive on Spark: the bits of one process, for any partitions, after kills; faults in the table."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import pyarrow.parquet as pq
from pyspark.sql import SparkSession
from simulated_archive import day_folder, day_name, made, make

from loadtwin import archive, spark

# Machines, their days, and the length of a day [s]: short, as what is tested is how days are handed out and
# continued. The length of the figures of docs/scale.md, or an archive that is there already, may be given.
MACHINES, DAYS = 50, 20
SECONDS = int(os.environ.get("LOADTWIN_DAY_SECONDS", "3"))
ARCHIVE = os.environ.get("LOADTWIN_ARCHIVE")


def processes_of(parent):
    """Processes that descend from one."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents.setdefault(int(fields[1]), []).append(int(status.parent.name))
    found, open_ = [], [parent]
    while open_:
        children = parents.get(open_.pop(), [])
        found += children
        open_ += children
    return found


def commands(processes):
    found = {}
    for process in processes:
        try:
            found[process] = Path(f"/proc/{process}/cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
    return found


class TestSpark(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.archive = Path(ARCHIVE or folder.name + "/archive")
        if not ARCHIVE:
            make(cls.archive, MACHINES, DAYS, SECONDS)
        cls.alone = archive.run(cls.archive, Path(folder.name) / "alone")
        cls.made = made(cls.alone["results"])
        cls.folder = Path(folder.name)
        cls.addClassCleanup(lambda: SparkSession.getActiveSession() and SparkSession.getActiveSession().stop())

    def setUp(self):
        self.results = self.folder / "results"
        self.addCleanup(shutil.rmtree, self.results, ignore_errors=True)

    def session(self):
        os.environ["PYSPARK_PYTHON"] = sys.executable
        builder = SparkSession.builder.master("local[2]").config("spark.ui.enabled", "false")
        session = builder.config("spark.ui.showConsoleProgress", "false").getOrCreate()
        session.sparkContext.setLogLevel("ERROR")
        return session

    def test_any_partitions_give_the_same_bits(self):
        self.assertEqual((self.alone["machines"], self.alone["faults"]), (MACHINES, 0))
        self.assertEqual(len([name for name in self.made if name.endswith("_state")]), MACHINES * DAYS)
        for partitions in (1, 2, 7):
            with self.subTest(partitions):
                results = self.folder / f"of-{partitions}"
                self.addCleanup(shutil.rmtree, results, ignore_errors=True)
                done = spark.run(self.session(), self.archive, results, partitions=partitions)
                self.assertEqual((done["replayed_days"], done["verdicts"]), (MACHINES * DAYS, self.alone["verdicts"]))
                self.assertEqual(made(results), self.made)
                for table in ("machines.parquet", "faults.parquet"):
                    self.assertTrue(pq.read_table(results / table).equals(pq.read_table(self.folder / "alone" / table)))
        self.assertEqual(spark.run(self.session(), self.archive, results)["replayed_days"], 0)

    def test_a_poisoned_recording_is_in_the_table_of_faults(self):
        path = day_folder(self.archive, "gearbox-2", 1) / "rec.parquet"
        good, there = path.read_bytes(), path.stat()
        path.write_bytes(good[: len(good) // 2] + os.urandom(500))
        done = spark.run(self.session(), self.archive, self.results)
        self.assertEqual((done["faults"], done["samples"]), (1, self.alone["samples"] // DAYS // MACHINES * (MACHINES * DAYS - 1)))
        (fault,) = pq.read_table(self.results / "faults.parquet").to_pylist()
        self.assertEqual((fault["machine"], fault["day"], fault["recording"]), ("gearbox-2", day_name(1), "rec.parquet"))
        found = made(self.results)
        others = {name for name in self.made if "machine=gearbox-2/" not in name}
        self.assertEqual({name: found[name] for name in others}, {name: self.made[name] for name in others})
        # Whole again, with the time that it had.
        path.write_bytes(good)
        os.utime(path, ns=(there.st_atime_ns, there.st_mtime_ns))
        self.assertEqual(spark.run(self.session(), self.archive, self.results)["replayed_days"], DAYS - 1)
        self.assertEqual(made(self.results), self.made)

    # --- kills ------------------------------------------------------------

    def start(self):
        # Its log is for whoever looks at a failure.
        with open(self.folder / "spark.log", "w") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "loadtwin.spark", self.archive, "-o", self.results, "--master", "local[2,4]"]
                + ["--no-page", "--conf", "spark.ui.enabled=false"],
                stderr=log,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )

    def wait_for_days(self, process, days):
        deadline = time.monotonic() + 120
        while len(list(self.results.rglob("_state"))) < days:
            self.assertIsNone(process.poll(), (self.folder / "spark.log").read_text()[-2000:])
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.01)

    def kill_worker(self, process):
        """Kill a worker of Python: a child of the daemon that Spark starts."""
        lines = commands(processes_of(process.pid))
        daemons = [found for found, line in lines.items() if "pyspark.daemon" in line]
        workers = [found for daemon in daemons for found in processes_of(daemon)]
        self.assertTrue(workers, "no worker to kill")
        os.kill(workers[-1], signal.SIGKILL)

    def test_killed_workers_and_a_killed_job_lose_nothing(self):
        process = self.start()
        self.wait_for_days(process, 3)
        self.kill_worker(process)
        self.wait_for_days(process, MACHINES * DAYS // 3)
        # All at once: Python, Java, its workers.
        for victim in [process.pid, *processes_of(process.pid)]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
        process.communicate()
        done = len(list(self.results.rglob("_state")))
        self.assertLess(done, MACHINES * DAYS - 2, "it was done before it was killed")
        process = self.start()
        self.wait_for_days(process, done + 2)
        self.kill_worker(process)
        said, _ = process.communicate(timeout=600)
        self.assertEqual(process.returncode, 0, (self.folder / "spark.log").read_text()[-3000:])
        self.assertIn(f"{MACHINES} machines, {MACHINES * DAYS} days", said)
        self.assertEqual(made(self.results), self.made)
        self.assertEqual(list(self.results.rglob("*.part")), [])

    def test_what_is_no_archive_is_said_without_spark(self):
        done = subprocess.run(
            [sys.executable, "-m", "loadtwin.spark", self.folder / "none"], capture_output=True, text=True, check=False
        )
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertEqual(done.stderr, f"loadtwin.spark: {self.folder}/none: no such folder\n")


if __name__ == "__main__":
    unittest.main()
