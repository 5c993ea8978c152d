"""Replay of an archive: recordings of many machines over many days.

``python -m loadtwin.archive ARCHIVE`` works with processes of one computer, ``python -m
loadtwin.spark ARCHIVE`` on Apache Spark; both run :class:`MachineHistory` for each machine.
"""

from .layout import Archive, Results
from .machine_history import MachineHistory
from .options import Options
from .run import run

__all__ = ["Archive", "MachineHistory", "Options", "Results", "run"]
