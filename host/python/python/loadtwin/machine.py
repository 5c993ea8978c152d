"""A machine by its description, and what loadtwin does with it."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path
from typing import Any

from . import _loadtwin
from .command import command, recordings
from .estimates import Estimates, Stream, start


class Machine:
    """A machine by its description.

    Parameters
    ----------
    description : path-like or str
        The name of a TOML file, or the text of one: a text has more than one line. A text names
        its files by absolute paths.

    Attributes
    ----------
    path : pathlib.Path
        The file with the description.
    name : str
        Name of the machine.
    rate_hz : float
        Samples a second.
    loads : dict of str to str
        Unit of each load by its name.

    Raises
    ------
    Error
        With file, line, field and the allowed range, when the description is refused.

    Examples
    --------
    >>> import loadtwin
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> machine.rate_hz, machine.loads
    (500.0, {'main_shaft': 'Nm', 'high_speed_shaft': 'Nm'})
    """

    def __init__(self, description: str | os.PathLike[str]) -> None:
        if isinstance(description, str) and "\n" in description:
            folder = tempfile.mkdtemp(prefix="loadtwin-")
            # With the machine, also where its description is refused.
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
            self.path = Path(folder) / "machine.toml"
            self.path.write_text(description, encoding="utf-8")
        else:
            self.path = Path(description).absolute()
        self._description = _loadtwin.Description(self.path)

    def __repr__(self) -> str:
        """Return the name."""
        return f"<loadtwin.Machine: {self.name}>"

    @property
    def name(self) -> str:
        """Name of the machine."""
        return self._description.name

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return self._description.rate_hz

    @property
    def loads(self) -> dict[str, str]:
        """Unit of each load by its name."""
        return dict(self._description.loads)

    def replay(
        self,
        recording: Any,
        state: bytes | None = None,
        *,
        sensors: str | None = None,
        filter: str = "aekf",
        more: bool = False,
    ) -> tuple[Estimates, bytes | None]:
        """Run the estimator on a recording.

        Parameters
        ----------
        recording : path-like, or an object with ``__arrow_c_stream__``
            A file (CSV, Parquet, MDF4), or a table or stream with the time ``t`` and the
            channels of the description. A unit is in the metadata of a field or in its name, as
            in ``t [s]``.
        state : bytes, optional
            The state after the part of the recording before, with which this one goes on to the bit.
        sensors : str, optional
            Set of sensors; the first of the description where absent.
        filter : {"aekf", "steady"}
            The filter.
        more : bool
            Another part follows. Samples whose estimates lag come with that part.

        Returns
        -------
        estimates : Estimates
            One row a sample.
        state : bytes or None
            The state at the end; none where rows are resampled, or where estimates lag and no
            other part follows.

        Raises
        ------
        Error
            When the recording or the state is refused.

        Examples
        --------
        >>> import pyarrow.parquet, loadtwin
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> table = pyarrow.parquet.read_table("examples/gearbox/start-stop.parquet")
        >>> first, state = machine.replay(table[:5000], more=True)
        >>> second, state = machine.replay(table[5000:], state)
        >>> len(first), len(second)
        (5000, 40000)
        """
        stream = self.stream(recording, state, sensors=sensors, filter=filter, more=more)
        return stream.read_all(), stream.state

    def stream(
        self,
        recording: Any,
        state: bytes | None = None,
        *,
        sensors: str | None = None,
        filter: str = "aekf",
        more: bool = False,
    ) -> Stream:
        """Run the estimator as its estimates are read, in memory that does not grow.

        Parameters
        ----------
        recording, state, sensors, filter, more
            As for :meth:`replay`. Of a stream, the first million rows are held in memory where
            the machine has an index pulse: they show how it was recorded.

        Returns
        -------
        Stream
            Read once, by any library that reads ``__arrow_c_stream__``.

        Examples
        --------
        >>> import pyarrow, loadtwin
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> stream = machine.stream("examples/gearbox/start-stop.parquet")
        >>> pyarrow.table(stream).num_rows
        45000
        """
        return start(self._description, recording, state, sensors, filter, more)

    def evaluate(self, recording: Any, **options: Any) -> dict[str, Any]:
        """Replay a recording and report error, consistency and flags.

        Parameters
        ----------
        recording : path-like, or an object with ``__arrow_c_stream__``
            As for :meth:`replay`.
        **options
            Options of ``loadtwin replay``, as ``report="page.html"`` for ``--report page.html``.

        Returns
        -------
        dict
            What ``loadtwin replay --json`` prints.

        Examples
        --------
        >>> import loadtwin
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> found = machine.evaluate("examples/gearbox/start-stop.parquet")
        >>> found["samples"], sorted(found["loads"])
        (45000, ['high_speed_shaft', 'main_shaft'])
        """
        with recordings([recording]) as files:
            return command("replay", self.path, *files, **options)

    def build(self, output: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
        """Make the model image that firmware and host run.

        Parameters
        ----------
        output : path-like
            The image.
        **options
            Options of ``loadtwin build``.

        Returns
        -------
        dict
            What ``loadtwin build --json`` prints.

        Examples
        --------
        >>> import loadtwin, os, tempfile
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     built = machine.build(os.path.join(folder, "gearbox.image"))
        >>> built["machine"]
        '850 kW gearbox'
        """
        return command("build", self.path, output=output, **options)

    def calibrate(self, *recording: Any, **options: Any) -> dict[str, Any]:
        """Fit gauges to recordings with reference loads.

        Parameters
        ----------
        *recording
            Recordings, as for :meth:`replay`.
        **options
            Options of ``loadtwin calibrate``, as ``output="calibrated.toml"``.

        Returns
        -------
        dict
            What ``loadtwin calibrate --json`` prints.

        Examples
        --------
        >>> import loadtwin
        >>> machine = loadtwin.Machine("examples/gearbox/machine.toml")
        >>> fitted = machine.calibrate("examples/gearbox/start-stop.parquet")
        >>> fitted["machine"]
        '850 kW gearbox'
        """
        return self._on_recordings("calibrate", recording, options)

    def tune(self, *recording: Any, **options: Any) -> dict[str, Any]:
        """Choose the noise of the filter.

        Parameters
        ----------
        *recording
            Recordings, as for :meth:`replay`.
        **options
            Options of ``loadtwin tune``.

        Returns
        -------
        dict
            What ``loadtwin tune --json`` prints.

        Examples
        --------
        >>> import loadtwin, os, tempfile
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     rec = os.path.join(folder, "rec.parquet")
        ...     _ = machine.simulate(rec, scenario="steps", duration_s=8)
        ...     tuned = machine.tune(rec, sensors="torque-arm-1", method="likelihood", keep_r=True)
        >>> tuned["machine"]
        '850 kW gearbox'
        """
        return self._on_recordings("tune", recording, options)

    def diagnose(self, *recording: Any, **options: Any) -> dict[str, Any]:
        """Find which physical effect the description lacks, and add it.

        Parameters
        ----------
        *recording
            Recordings, as for :meth:`replay`.
        **options
            Options of ``loadtwin diagnose``, as ``output="improved.toml"``.

        Returns
        -------
        dict
            What ``loadtwin diagnose --json`` prints.

        Examples
        --------
        >>> import loadtwin, os, tempfile
        >>> plant = loadtwin.Machine("examples/feed-drive/plant.toml")
        >>> machine = loadtwin.Machine("examples/feed-drive/drive.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     rec = os.path.join(folder, "rec.parquet")
        ...     _ = plant.simulate(rec, scenario="reversals", duration_s=20)
        ...     found = machine.diagnose(rec)
        >>> found["verdict"], found["effects"]
        ('none', [])
        """
        return self._on_recordings("diagnose", recording, options)

    def simulate(self, output: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
        """Write a recording of a machine that is not there.

        Parameters
        ----------
        output : path-like
            The recording (.csv, .parquet or .mf4).
        **options
            Options of ``loadtwin simulate``, as ``scenario="steps"``, ``seed=3``,
            ``effect=["backlash", "thermal-drift=0.5"]``.

        Returns
        -------
        dict
            What ``loadtwin simulate --json`` prints.

        Examples
        --------
        >>> import loadtwin, os, tempfile
        >>> machine = loadtwin.Machine("examples/gearbox/machine.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     rec = os.path.join(folder, "rec.parquet")
        ...     machine.simulate(rec, scenario="steps", duration_s=2)["samples"]
        1000
        """
        return command("simulate", self.path, output=output, **options)

    def life(self, *estimates: Any, **options: Any) -> dict[str, Any]:
        """Count load cycles and compute damage-equivalent loads.

        Parameters
        ----------
        *estimates
            Estimates of :meth:`replay`, or recordings with measured loads, in the order of time.
        **options
            Options of ``loadtwin life``, as ``sn=[(1e6, 200e3), (1e8, 100e3)]``.

        Returns
        -------
        dict
            What ``loadtwin life --json`` prints.

        Examples
        --------
        >>> import loadtwin
        >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
        >>> estimates, state = machine.replay("examples/gearbox/start-stop.parquet")
        >>> sorted(machine.life(estimates)["loads"])
        ['high_speed_shaft', 'main_shaft']
        """
        with recordings(estimates) as files:
            return command("life", *files, machine=self.path, **options)

    def _on_recordings(
        self, name: str, recording: tuple[Any, ...], options: dict[str, Any]
    ) -> dict[str, Any]:
        with recordings(recording) as files:
            return command(name, self.path, *files, **options)
