"""Time and processor time of an archive on one core and on two: python archive_speed.py ARCHIVE [REPEATS].

The runs alternate; of their repeats the median, the least and the most are printed. Each run has new results, which are
removed. One core: all processes are bound to it.
"""

import contextlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from simulated_archive import made

TICK = os.sysconf("SC_CLK_TCK")
RUNS = {
    ("processes", 1): ["loadtwin.archive", "--processes", "1"],
    ("processes", 2): ["loadtwin.archive", "--processes", "2"],
    ("Spark", 1): ["loadtwin.spark", "--master", "local[1]"],
    ("Spark", 2): ["loadtwin.spark", "--master", "local[2]"],
}


class ProcessorTime:
    """Processor time of a process and all that descend from it [s]; ends of short ones are missed."""

    def __init__(self, root):
        self.family = {root}
        self.ticks = {}

    def sample(self):
        for status in sorted(Path("/proc").glob("[0-9]*/stat"), key=lambda path: int(path.parent.name)):
            try:
                fields = status.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            process = int(status.parent.name)
            if process in self.family or int(fields[1]) in self.family:
                self.family.add(process)
                self.ticks[process] = int(fields[11]) + int(fields[12])

    @property
    def seconds(self):
        return sum(self.ticks.values()) / TICK


def measure(archive, results, module, options, cores):
    began = time.monotonic()
    process = subprocess.Popen(
        ["taskset", "-c", ",".join(map(str, range(cores))), sys.executable, "-m", module, archive]
        + ["-o", str(results), "--json", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    used = ProcessorTime(process.pid)
    # Seldom: where both cores are used, looking takes time from what is measured.
    while process.poll() is None:
        used.sample()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1)
    total = time.monotonic() - began
    return total, used.seconds, json.loads(process.stdout.read())


def spread(values, digits=1):
    middle, *ends = (f"{of(values):.{digits}f}" for of in (statistics.median, min, max))
    return f"{middle} ({' to '.join(ends)})"


def main():
    archive, repeats = sys.argv[1], int((sys.argv[2:] or ["1"])[0])
    found, first = {run: [] for run in RUNS}, None
    for _ in range(repeats):
        for run, (module, *options) in RUNS.items():
            with tempfile.TemporaryDirectory() as folder:
                results = Path(folder) / "results"
                total, used, done = measure(archive, results, module, options, run[1])
                first = first or made(results)
                assert made(results) == first, "other bits"
                shutil.rmtree(results)
            found[run].append((total, done["seconds"], used))
            print(*run, *(f"{value:.1f}" for value in found[run][-1]), flush=True)
    for (engine, cores), runs in found.items():
        total, job, used = map(spread, zip(*runs))
        print(f"{engine} on {cores}: {total} s, the job alone {job} s, processor {used} s")
    print(f"{done['samples']} samples; time of 2 cores by that of 1:")
    for engine in ("processes", "Spark"):
        pairs = list(zip(found[engine, 2], found[engine, 1]))
        total, job = (spread([two[k] / one[k] for two, one in pairs], 2) for k in (0, 1))
        print(f"{engine}: {total}, the job alone {job}")


if __name__ == "__main__":
    main()
