"""Replay of an archive: recordings of many machines over many days.

``python -m loadtwin.archive ARCHIVE`` works on the cores of one computer, as ``loadtwin replay
--archive ARCHIVE`` does, ``python -m loadtwin.spark ARCHIVE`` on Apache Spark.
"""

from .options import Options
from .run import run

__all__ = ["Options", "run"]
