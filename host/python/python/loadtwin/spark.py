"""Replay of an archive on Apache Spark: ``python -m loadtwin.spark ARCHIVE``.

Spark hands out machines. A task reads the days of its machine by itself, in their order and batch
by batch, as the state goes from day to day: recordings and estimates are never shuffled. Archive
and results lie on a file system that all executors see.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import time
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from py4j.protocol import Py4JError
from pyspark import SparkConf, SparkContext
from pyspark.errors import PySparkException

from . import Error, _loadtwin
from .archive.options import Options, given, parser, results_folder
from .archive.text import program

if TYPE_CHECKING:
    from pyspark.sql import SparkSession

#: Partitions for each task that runs at once: the more, the less the last of them runs alone.
_PARTITIONS = 32

#: Java only hands out machines: its optimising compiler and concurrent collector take the cores of the estimators.
_JAVA = "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC"


def run(
    spark: SparkSession,
    archive: str | os.PathLike[str],
    results: str | os.PathLike[str] | None = None,
    *,
    partitions: int | None = None,
    options: Options | None = None,
) -> dict[str, Any]:
    """Replay all machines of an archive, those days that are not up to date.

    Parameters
    ----------
    spark : pyspark.sql.SparkSession
        Its executors have this package.
    archive, results, options
        As for :func:`loadtwin.archive.run`.
    partitions : int, optional
        Partitions of the machines; 32 for each task that runs at once where absent.

    Returns
    -------
    dict
        As of :func:`loadtwin.archive.run`.

    Raises
    ------
    Error
        When the archive or the folder of the results is refused.
    """
    target = results if results is not None else os.path.join(archive, "results")
    figures, _ = _replayed(spark.sparkContext, archive, target, partitions, options or Options())
    return json.loads(figures)


def _replayed(
    context: SparkContext,
    archive: str | os.PathLike[str],
    results: str | os.PathLike[str],
    partitions: int | None,
    options: Options,
) -> tuple[str, str]:
    """Replay all machines; give the figures of the run as JSON and as text."""
    began = time.monotonic()
    tasks = _loadtwin.archive_tasks(archive, results, dataclasses.astuple(options))
    if partitions is None:
        partitions = _PARTITIONS * context.defaultParallelism
    partitions = max(1, min(partitions, len(tasks)))
    # Not a table of Spark SQL: Java would load and compile its planner, for seconds.
    rows = context.parallelize([task for _, task in tasks], partitions).mapPartitions(_rows).collect()
    folder = os.path.abspath(results)
    return _loadtwin.write_outcome(folder, rows, options.page, time.monotonic() - began)


def _rows(tasks: Iterator[bytes]) -> Iterator[bytes]:
    """Replay machines, one after the other; give a row for each."""
    return map(_loadtwin.replay_task, tasks)


def _context(arguments: argparse.Namespace) -> SparkContext:
    # Of the versions of pandas, which Spark looks at and nothing here uses.
    warnings.filterwarnings("ignore", category=FutureWarning, module="pyspark")
    # Workers of this computer run the Python that has this package.
    os.environ.setdefault("PYSPARK_PYTHON", sys.executable)
    settings = SparkConf().setAppName("loadtwin")
    if arguments.master:
        settings.setMaster(arguments.master)
    settings.set("spark.ui.showConsoleProgress", "false")
    settings.set("spark.driver.extraJavaOptions", _JAVA)
    for setting in arguments.conf:
        key, _, value = setting.partition("=")
        settings.set(key, value)
    context = SparkContext.getOrCreate(settings)
    context.setLogLevel("ERROR")
    return context


def _run_in_context(arguments: argparse.Namespace) -> tuple[str, str]:
    context = _context(arguments)
    try:
        return _replayed(
            context, arguments.archive, results_folder(arguments), arguments.partitions, given(arguments)
        )
    finally:
        context.stop()


def main() -> int:
    """Run the command line."""
    options = parser("python -m loadtwin.spark", "Replay the days of an archive that are not up to date, on Spark.")
    options.add_argument("--master", help="master of Spark, as local[2]; absent: by the configuration of Spark")
    options.add_argument("--partitions", type=int, metavar="N", help="partitions of the machines")
    options.add_argument("--conf", action="append", default=[], metavar="KEY=VALUE", help="setting of Spark")
    arguments = options.parse_args()

    def start() -> tuple[str, str]:
        # What is wrong with the archive is said before Spark starts.
        options = dataclasses.astuple(given(arguments))
        _loadtwin.archive_tasks(arguments.archive, results_folder(arguments), options)
        try:
            return _run_in_context(arguments)
        except (PySparkException, Py4JError, ConnectionError) as error:
            reason = next(iter(str(error).splitlines()), type(error).__name__)
            raise Error(f"Spark ended: {reason}; run it again: days that are done stay") from None

    return program(arguments, "loadtwin.spark", start)


if __name__ == "__main__":
    sys.exit(main())
