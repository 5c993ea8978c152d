"""Archives by the Python package, on a simulated gearbox cut into four days: estimates have the bits of one replay,
sums and damage are those of ``evaluate`` and ``life``, whatever is late, broken, killed or changed.
"""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from simulated_archive import GEARBOX, HEADER, add_machine, day_folder, day_name, describe, made, make, recording

import loadtwin
from loadtwin.archive import Options, run

DAYS = 4
PLAIN = f"g,2026-01-01,{GEARBOX}"


class TestArchive(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.whole = recording(seed=1, seconds=24)
        cls.machine = loadtwin.Machine(GEARBOX)
        cls.estimates = pa.table(cls.machine.replay(cls.whole)[0]).combine_chunks()

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.archive = Path(folder.name) / "archive"
        self.results = self.archive / "results"

    def one_machine(self, rows=(PLAIN,), header=HEADER):
        add_machine(self.archive, "g", self.whole, DAYS)
        describe(self.archive, rows, header)

    def run_all(self, **options):
        return run(self.archive, processes=1, options=Options(**options))

    def days(self, machine="g"):
        return pq.read_table(self.results / "days" / f"machine={machine}" / "days.parquet", partitioning=None).to_pylist()

    def faults(self):
        return pq.read_table(self.results / "faults.parquet").to_pylist()

    def written(self, machine="g"):
        parts = sorted((self.results / "estimates" / f"machine={machine}").rglob("*.parquet"))
        return pa.concat_tables(pq.read_table(part, partitioning=None) for part in parts).combine_chunks()

    # --- figures ----------------------------------------------------------

    def test_days_have_the_bits_of_one_recording(self):
        self.one_machine()
        done = self.run_all()
        self.assertEqual((done["machines"], done["days"], done["replayed_days"]), (1, DAYS, DAYS))
        self.assertEqual(done["samples"], len(self.whole))
        self.assertTrue(self.written().equals(self.estimates))
        self.assertEqual([row["recordings"][0]["continued"] for row in self.days()], [False] + [True] * (DAYS - 1))

    def test_summaries_are_those_of_replay(self):
        self.one_machine()
        self.run_all()
        path = self.archive / "whole.parquet"
        pq.write_table(self.whole, path)
        theirs = self.machine.evaluate(path)
        rows = self.days()
        for k, sensor in enumerate(theirs["consistency"]["sensors"]):
            ours = [row["sensors"][k] for row in rows]
            total = lambda key: sum(part[key] for part in ours)
            self.assertEqual(ours[0]["name"], sensor["name"])
            self.assertEqual(total("compared"), sensor["compared"])
            self.assertAlmostEqual(100 * total("contradicting") / total("compared"), sensor["contradicting_percent"])
            self.assertAlmostEqual(total("nis") / total("used"), sensor["nis"], delta=1e-9)
            self.assertAlmostEqual(total("bias") / total("used"), sensor["bias"], delta=1e-9)
            flags = {}
            for name, count in (flag for part in ours for flag in part["flags"]):
                flags[name] = flags.get(name, 0) + count
            self.assertEqual(flags, sensor["flags"])
        for k, (name, load) in enumerate(theirs["loads"].items()):
            valid = sum(row["loads"][k]["valid"] for row in rows)
            self.assertEqual(rows[0]["loads"][k]["name"], name)
            self.assertAlmostEqual(100 * valid / len(self.whole), load["valid_percent"])
            is_valid = pc.equal(self.estimates[f"{name}_fault"], 31)
            extremes = pc.min_max(self.estimates[name].filter(is_valid)).as_py()
            self.assertEqual(min(row["loads"][k]["lowest"] for row in rows), extremes["min"])
            self.assertEqual(max(row["loads"][k]["highest"] for row in rows), extremes["max"])

    def test_damage_of_days_is_that_of_one_count(self):
        sn = '"1e4:5e5,2e6:1e5"'
        self.one_machine([f"{PLAIN},main_shaft,{sn},-3e6:3e6"], f"{HEADER},load,sn,range")
        self.run_all()
        damage = [row["loads"][0]["damage"] for row in self.days()]
        self.assertEqual(damage, sorted(damage))
        theirs = self.machine.life(
            self.estimates, load="main_shaft", sn=[(1e4, 5e5), (2e6, 1e5)], range=[(-3e6, 3e6)]
        )
        self.assertGreater(damage[-1], 0)
        self.assertAlmostEqual(damage[-1] / theirs["loads"]["main_shaft"]["damage"], 1, delta=1e-9)
        machines = pq.read_table(self.results / "machines.parquet").to_pylist()
        self.assertEqual((machines[0]["load"], machines[0]["damage"]), ("main_shaft", damage[-1]))
        # So many times the recorded time bring the damage to 1.
        seconds = sum(row["seconds"] for row in self.days())
        self.assertAlmostEqual(damage[-1] * (1 + machines[0]["remaining_s"] / seconds), 1, delta=1e-9)

    def test_timestamps_follow_one_another(self):
        t = self.whole.schema.get_field_index("t")
        stamps = pc.round(pc.multiply(self.whole["t"], 1e9)).cast(pa.int64())
        stamps = pc.add(stamps, 1_790_000_000_000_000_000).cast(pa.timestamp("ns", "UTC"))
        whole = self.whole.set_column(t, "time", stamps)
        add_machine(self.archive, "g", whole, DAYS)
        describe(self.archive, [PLAIN])
        self.run_all()
        self.assertEqual(self.faults(), [])
        self.assertEqual([row["recordings"][0]["continued"] for row in self.days()], [False] + [True] * (DAYS - 1))
        first = self.written()["t"][0].as_py()
        self.assertAlmostEqual(first, 1_790_000_000 + self.whole["t"][0].as_py(), places=6)
        loads = ["main_shaft", "main_shaft_fault"]
        self.assertTrue(self.written().select(loads).equals(self.estimates.select(loads)))

    def test_only_loads_are_kept(self):
        self.one_machine()
        self.run_all(columns="loads")
        names = self.written().schema.names
        self.assertEqual(names[:4], ["t", "main_shaft", "main_shaft_std", "main_shaft_fault"])
        self.assertTrue(self.written().equals(self.estimates.select(names)))
        self.assertEqual(len(names), 7)

    def test_a_gap_starts_the_estimator_anew(self):
        self.one_machine()
        path = day_folder(self.archive, "g", 2) / "rec.parquet"
        table = pq.read_table(path)
        pq.write_table(table[500:], path)
        self.run_all()
        row = self.days()[2]["recordings"][0]
        self.assertFalse(row["continued"])
        self.assertIn("1.002 s after the recording before", row["notes"][0])
        alone = pa.table(self.machine.replay(table[500:])[0])
        found = pq.read_table(self.results / "estimates/machine=g" / f"day={day_name(2)}/rec.parquet", partitioning=None)
        self.assertTrue(found.combine_chunks().equals(alone.combine_chunks()))

    def test_the_command_makes_the_same_files(self):
        self.one_machine()
        done = self.run_all(columns="loads")
        other = self.archive.parent / "other"
        command = [sys.executable, "-m", "loadtwin", "replay", "--archive", self.archive, "-o", other, "--columns", "loads"]
        printed = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True).stdout
        theirs = json.loads(printed)
        self.assertEqual(list(theirs), list(done))
        own = {"seconds": 0, "results": ""}
        self.assertEqual({**theirs, **own}, {**done, **own})
        self.assertEqual(made(other), made(self.results))
        for table in ("machines.parquet", "faults.parquet", "contradicting.csv", "page/fleet.js", "page/machines/g.js"):
            self.assertEqual((other / table).read_bytes(), (self.results / table).read_bytes(), table)
        again = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        self.assertIn(f"1 machines, {DAYS} days, {len(self.whole)} samples; 0 days replayed", again)
        one = [*command[:4], "machine.toml", "recording.csv", "--columns", "loads"]
        for refused in ([*command, "--estimates", "x.csv"], one):
            wrong = subprocess.run(refused, capture_output=True, text=True, check=False)
            self.assertEqual((wrong.returncode, wrong.stdout), (2, ""))

    # --- runs again -------------------------------------------------------

    def test_what_is_up_to_date_stays(self):
        self.one_machine()
        self.run_all()
        times = {path: path.stat().st_mtime_ns for path in self.results.glob("estimates/**/*") if path.is_file()}
        self.assertEqual(self.run_all()["replayed_days"], 0)
        self.assertEqual(times, {path: path.stat().st_mtime_ns for path in times})
        before = made(self.results)
        self.assertEqual(self.run_all(again=True)["replayed_days"], DAYS)
        self.assertEqual(made(self.results), before)

    def test_a_late_day_and_a_late_recording(self):
        self.one_machine()
        self.run_all()
        whole = made(self.results)
        shutil.rmtree(self.results)
        path = day_folder(self.archive, "g", 1) / "rec.parquet"
        path.rename(self.archive / "late.parquet")
        self.run_all()
        (self.archive / "late.parquet").rename(path)
        self.assertEqual(self.run_all()["replayed_days"], DAYS - 1)
        self.assertEqual(made(self.results), whole)
        # The day is given in two recordings, the second one late.
        table = pq.read_table(path)
        path.unlink()
        pq.write_table(table[:1000], path.with_name("a.parquet"))
        self.run_all()
        pq.write_table(table[1000:], path.with_name("b.parquet"))
        self.run_all()
        self.assertTrue(self.written().equals(self.estimates))

    def test_a_replaced_recording_is_replayed_with_the_days_after_it(self):
        self.one_machine()
        self.run_all()
        whole = made(self.results)
        path = day_folder(self.archive, "g", 2) / "rec.parquet"
        good = path.read_bytes()
        table = pq.read_table(path)
        channel = table.schema.get_field_index("ta1")
        changed = pc.add(table["ta1"], 1e-7)
        pq.write_table(table.set_column(channel, table.schema.field(channel), changed), path)
        self.assertEqual(self.run_all()["replayed_days"], 2)
        self.assertEqual([name for name, digest in made(self.results).items() if digest == whole[name] and day_name(2) in name], [])
        path.write_bytes(good)
        self.run_all()
        self.assertTrue(self.written().equals(self.estimates))

    def test_removed_recordings_leave_their_results(self):
        self.one_machine()
        self.run_all()
        before = made(self.results)
        for day in range(DAYS - 1):
            shutil.rmtree(day_folder(self.archive, "g", day))
        self.assertEqual(self.run_all()["replayed_days"], 0)
        self.assertEqual(made(self.results), before)
        self.run_all(again=True)
        self.assertTrue(self.written().equals(self.estimates))

    def test_a_damaged_table_or_state_is_made_again(self):
        self.one_machine()
        self.run_all()
        whole = made(self.results)
        table = self.results / "days/machine=g/days.parquet"
        state = self.results / "estimates/machine=g" / f"day={day_name(1)}" / "_state"
        for path in (table, state):
            for content in (b"", path.read_bytes()[:-20]):
                path.write_bytes(content)
                self.run_all()
                self.assertEqual(made(self.results), whole)

    def test_a_changed_description_counts_from_its_day_on(self):
        text = GEARBOX.read_text()
        shutil.copytree(GEARBOX.parent, self.archive / "gearbox")
        path = self.archive / "gearbox" / "later.toml"
        path.write_text(text)
        self.one_machine([PLAIN, f"g,{day_name(2)},gearbox/later.toml"])
        self.run_all()
        first = self.days()
        path.write_text(text.replace("format = 1", "# corrected\nformat = 1"))
        self.assertEqual(self.run_all()["replayed_days"], DAYS - 2)
        hashes = [row["description_sha256"] for row in self.days()]
        self.assertEqual(hashes[:2], [row["description_sha256"] for row in first[:2]])
        self.assertNotEqual(hashes[2], first[2]["description_sha256"])

    def test_killed_runs_leave_nothing_and_lose_nothing(self):
        make(self.archive, machines=2, days=12, seconds=6)
        self.run_all()
        whole = made(self.results)
        for kill in range(6):
            shutil.rmtree(self.results) if kill % 3 == 0 else None
            process = subprocess.Popen(
                [sys.executable, "-m", "loadtwin.archive", self.archive, "--processes", "2"], start_new_session=True
            )
            deadline = time.monotonic() + 60
            before = len(list(self.results.rglob("_state")))
            while process.poll() is None and len(list(self.results.rglob("_state"))) < before + 3:
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.005)
            self.assertIsNone(process.poll(), "it was done before it was killed")
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self.run_all()
        self.assertEqual(made(self.results), whole)
        self.assertEqual(list(self.results.rglob("*.part")), [])

    # --- faults -----------------------------------------------------------

    def poison(self, name, day, change):
        path = day_folder(self.archive, name, day) / "rec.parquet"
        good = path.read_bytes()
        change(path)
        return path, good

    def test_faults_are_in_a_table_and_the_rest_goes_on(self):
        def page(path):
            # In the pages of a channel: found only when its rows are read. Columns that are no channel are not read.
            group = pq.ParquetFile(path).metadata.row_group(0)
            (chunk,) = (group.column(k) for k in range(group.num_columns) if group.column(k).path_in_schema == "ta1")
            content = bytearray(path.read_bytes())
            middle = chunk.data_page_offset + chunk.total_compressed_size // 3
            content[middle : middle + 2000] = bytes(2000)
            path.write_bytes(content)

        changes = {
            "noise": lambda path: path.write_bytes(os.urandom(5000)),
            "empty": lambda path: path.write_bytes(b""),
            "cut": lambda path: path.write_bytes(path.read_bytes()[:-3000]),
            "page": page,
            "columns": lambda path: pq.write_table(pq.read_table(path).drop_columns(["ta1"]), path),
            "rate": lambda path: pq.write_table(pq.read_table(path)[::7], path),
            "link": lambda path: (path.unlink(), path.symlink_to("nowhere")),
        }
        for name in ["good", *changes]:
            add_machine(self.archive, name, self.whole, DAYS)
        describe(self.archive, [f"{name},2026-01-01,{GEARBOX}" for name in ["good", *changes]])
        poisoned = [self.poison(name, 1, change) for name, change in changes.items()]
        done = self.run_all()
        found = {fault["machine"]: fault for fault in self.faults()}
        self.assertEqual((sorted(found), done["faults"]), (sorted(changes), len(changes)))
        for name in changes:
            self.assertEqual((found[name]["day"], found[name]["recording"]), (day_name(1), "rec.parquet"))
            self.assertTrue(found[name]["fault"])
            self.assertEqual([row["samples"] > 0 for row in self.days(name)], [True, False, True, True])
            self.assertEqual(list((self.results / f"estimates/machine={name}/day={day_name(1)}").glob("*.parquet")), [])
        self.assertIn("ta1", found["columns"]["fault"])
        self.assertTrue(self.written("good").equals(self.estimates))
        # Once the recordings are whole, so are the results.
        for path, good in poisoned:
            path.unlink()
            path.write_bytes(good)
        self.assertEqual(self.run_all()["faults"], 0)
        for name in changes:
            self.assertTrue(self.written(name).equals(self.estimates), name)

    def test_days_without_a_description(self):
        for name in ("none", "later", "ended", "invalid", "hash", "good"):
            add_machine(self.archive, name, self.whole, DAYS)
        day_folder(self.archive, "good", 0).parent.joinpath("day=2026-13-45").mkdir()
        shutil.copy(day_folder(self.archive, "good", 0) / "rec.parquet", self.archive / "recordings/machine=good/day=2026-13-45")
        (self.archive / "wrong.toml").write_text(GEARBOX.read_text().replace("rate_hz = 500", "rate_hz = 0"))
        described = [
            f"later,{day_name(2)},,{GEARBOX},",
            f"ended,2026-01-01,{day_name(1)},{GEARBOX},",
            f"invalid,2026-01-01,,{GEARBOX},",
            f"invalid,{day_name(2)},,wrong.toml,",
            f"hash,2026-01-01,,{GEARBOX},{'0' * 64}",
            f"good,2026-01-01,,{GEARBOX},",
        ]
        describe(self.archive, described, "machine,from,to,description,sha256")
        self.run_all()
        found = {}
        for fault in self.faults():
            found.setdefault(fault["machine"], []).append(fault)
        days = {machine: [fault["day"] for fault in faults] for machine, faults in found.items()}
        every = [day_name(day) for day in range(DAYS)]
        self.assertEqual(
            days,
            {"none": every, "later": every[:2], "ended": every[2:], "invalid": every[2:], "hash": every, "good": ["2026-13-45"]},
        )
        for machine, said in {
            "none": "it has none", "later": f"valid from {day_name(2)} on", "ended": f"ends on {day_name(1)}",
            "invalid": "rate_hz", "hash": "SHA-256", "good": "a date",
        }.items():  # fmt: skip
            self.assertIn(said, found[machine][0]["fault"])
        self.assertTrue(self.written("good").equals(self.estimates))
        machines = {row["machine"]: row for row in pq.read_table(self.results / "machines.parquet").to_pylist()}
        self.assertEqual((machines["none"]["verdict"], machines["invalid"]["samples"]), ("no data", len(self.whole) // 2))

    def test_machines_that_contradict_their_description(self):
        add_machine(self.archive, "good", self.whole, DAYS)
        scaled = self.whole.schema.get_field_index("ta1")
        values = pc.multiply(self.whole["ta1"], 1.5)
        add_machine(self.archive, "scaled", self.whole.set_column(scaled, self.whole.schema.field(scaled), values), DAYS)
        for day in range(2):
            shutil.copy(day_folder(self.archive, "good", day) / "rec.parquet", day_folder(self.archive, "scaled", day))
        describe(self.archive, [f"{name},2026-01-01,{GEARBOX}" for name in ("good", "scaled")])
        self.assertEqual(self.run_all()["verdicts"]["contradicts"], 1)
        with open(self.results / "contradicting.csv", newline="") as file:
            (row,) = csv.DictReader(file)
        self.assertEqual((row["machine"], row["since"], row["sensor"]), ("scaled", day_name(2), "ta1"))
        self.assertTrue((self.archive / row["recordings"]).is_file())
        self.assertEqual(row["description"], str(GEARBOX))

    # --- refused ----------------------------------------------------------

    def refused(self, *said):
        done = subprocess.run(
            [sys.executable, "-m", "loadtwin.archive", self.archive], capture_output=True, text=True, check=False
        )
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        for text in said:
            self.assertIn(text, done.stderr)

    def test_what_is_no_archive_is_refused(self):
        self.refused("no such folder")
        self.archive.mkdir()
        self.refused("no archive", "machine=NAME")
        (self.archive / "recordings").mkdir()
        self.refused("empty archive")
        add_machine(self.archive, "g", self.whole, 1)
        self.refused("descriptions.csv", "no such table")
        row = f"g,2026-01-01,{GEARBOX}"
        for rows, header, said in [
            ([row], "machine,description", "no column 'from'"),
            ([row + ",1"], HEADER + ",colour", "unknown column 'colour'"),
            ([f"g,yesterday,{GEARBOX}"], HEADER, "descriptions.csv:2: from: found 'yesterday'"),
            ([row, "g,2026-01-01"], HEADER, "descriptions.csv:3: another number of cells"),
            ([row, row], HEADER, "two descriptions from 2026-01-01"),
            ([f"g,2026-01-01,{GEARBOX},1e4:1"], HEADER + ",sn", "without the load"),
            ([f"g,2026-01-01,{GEARBOX},main_shaft,1e4"], HEADER + ",load,sn", "two numbers with a colon"),
        ]:
            with self.subTest(said):
                describe(self.archive, rows, header)
                self.refused(said)
        describe(self.archive, [row])
        self.results.mkdir()
        (self.results / "mine.txt").write_text("mine")
        self.refused("holds files of others")
        self.assertEqual([path.name for path in self.results.iterdir()], ["mine.txt"])


if __name__ == "__main__":
    unittest.main()
