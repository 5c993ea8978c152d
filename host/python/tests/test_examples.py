"""Every description that ships: Python has the estimates and figures of the command, and at least 0.8 of its speed."""

import json
import os
import subprocess
import tempfile
import time
import tomllib
import unittest
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import loadtwin

GEARBOX = "examples/gearbox/calibrated.toml"
RECORDING = "examples/gearbox/start-stop.parquet"

#: Descriptions of machines; `calibration.toml` describes a calibration.
DESCRIPTIONS = [str(path) for path in sorted(Path("examples").glob("**/*.toml")) if path.name != "calibration.toml"]

#: Throughput of Python, at least, and of the command [-].
LEAST_THROUGHPUT = 0.8


def command(*arguments):
    return subprocess.run([os.environ["LOADTWIN"], *arguments], capture_output=True, text=True)


def drive_recording(balance, rate_hz, seconds=5):
    """A motion with the columns of a drive without sensors of its own."""
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    motion = balance.get("position") or balance["speed"]
    angle = np.sin(2 * t) if "position" in balance else 2 * np.cos(2 * t)
    drive = balance["drive"]
    force = np.round((0.1 * np.cos(2 * t) + 0.3 * np.sign(np.cos(2 * t))) / drive.get("gain", 1))
    columns = {"t [s]": t, f"{drive['name']} [{drive['unit']}]": force}
    columns[f"{motion['name']} [{motion['unit']}]"] = np.round(angle / motion.get("gain", 1e-3)) * (
        1 if "gain" in motion else 1e-3
    )
    for load in balance.get("load", []):
        columns[f"{load['name']} [{load['unit']}]"] = force
    return pa.table(columns)


class TestExamples(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def at(self, name):
        return str(self.folder / name)

    def recording(self, description):
        """A description that can be replayed, and a recording of its machine; none where none can be."""
        if description == GEARBOX:
            return description, RECORDING
        text = Path(description).read_text()
        described = tomllib.loads(text)
        if "bearing" in described and "calibration" not in described["bearing"]:
            # Not before it is calibrated.
            return description, None
        if "balance" not in described:
            scenario = {"scenario": "lc1"} if "bearing" in described else {}
            loadtwin.Machine(description).simulate(self.at("r.parquet"), force=True, duration_s=1, **scenario)
            return description, self.at("r.parquet")
        pq.write_table(drive_recording(described["balance"], described["rate_hz"]), self.at("r.parquet"))
        if "nominal" not in described["balance"]:
            self.refuse(description, "balance.nominal")
            text = text.replace("[balance]", "[balance]\nnominal = 2.0", 1)
        Path(self.at("drive.toml")).write_text(text)
        return self.at("drive.toml"), self.at("r.parquet")

    def refuse(self, description, reason):
        """Both refuse to replay it, in the same words."""
        said = command("replay", description, self.at("r.parquet")).stderr
        with self.assertRaises(loadtwin.Error) as found:
            loadtwin.Machine(description).replay(self.at("r.parquet"))
        self.assertIn(reason, said)
        said, found = (text[text.index(reason) :].strip() for text in (said, str(found.exception)))
        self.assertEqual(said, found)

    def test_estimates_and_figures_are_those_of_the_command(self):
        self.assertGreaterEqual(len(DESCRIPTIONS), 15)
        for description in DESCRIPTIONS:
            with self.subTest(description):
                path, recording = self.recording(description)
                if recording is None:
                    self.refuse(path, "bearing.calibration")
                    continue
                said = command("replay", path, recording, "--estimates", self.at("e.parquet"), "--json", "--force")
                self.assertEqual(said.returncode, 0, said.stderr)
                theirs = pq.read_table(self.at("e.parquet"))
                machine = loadtwin.Machine(path)
                ours, _ = machine.replay(pq.read_table(recording))
                self.assertEqual(pa.table(ours).schema.names, theirs.schema.names)
                self.assertTrue(pa.table(ours).equals(theirs))
                self.assertGreater(len(ours), 100)
                figures, said = machine.evaluate(recording), json.loads(said.stdout)
                del figures["samples_per_second"], said["samples_per_second"]
                self.assertEqual(figures, said)

    def test_a_table_is_replayed_as_fast_as_a_file_by_the_command(self):
        machine, table = loadtwin.Machine(GEARBOX), pq.read_table(RECORDING)
        ours, theirs = [], []
        # In turns, the best of each: other programs slow single ones down.
        for _ in range(20):
            said = command("replay", GEARBOX, RECORDING, "--json")
            theirs.append(json.loads(said.stdout)["samples_per_second"])
            began = time.perf_counter()
            machine.replay(table)
            ours.append(len(table) / (time.perf_counter() - began))
            if len(ours) >= 5 and max(ours) >= LEAST_THROUGHPUT * max(theirs):
                break
        print(f"Python {max(ours):.0f} samples/s, the command {max(theirs):.0f}")
        self.assertGreaterEqual(max(ours), LEAST_THROUGHPUT * max(theirs))


if __name__ == "__main__":
    unittest.main()
