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

from ._loadtwin import Error, __version__
from .estimates import Estimates, Stream
from .machine import Machine

__all__ = ["Error", "Estimates", "Machine", "Stream", "__version__"]
