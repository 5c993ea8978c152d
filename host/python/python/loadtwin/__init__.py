"""Virtual load sensor for rotating machines.

The estimators are those of the ``loadtwin`` command and of the board, bit for bit. Recordings and
estimates are tables of any library that speaks the Arrow PyCapsule interface.

Examples
--------
>>> import loadtwin
>>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
>>> estimates, state = machine.replay("examples/gearbox/start-stop.parquet")
>>> len(estimates), estimates.units["main_shaft"]
(45000, 'Nm')
"""

import atexit
import os

from . import _loadtwin
from ._loadtwin import Error, __version__
from .estimates import Estimates, Stream
from .machine import Machine

__all__ = ["Error", "Estimates", "Machine", "Stream", "__version__"]

# A replay reads objects of Python on a thread of its own.
atexit.register(_loadtwin.end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_loadtwin.forget_all)
