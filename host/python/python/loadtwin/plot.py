"""Plots of estimates with matplotlib: ``pip install loadtwin[plot]``.

Each function takes a table with ``__arrow_c_stream__``, as :class:`loadtwin.Estimates` or one of
pyarrow, and returns the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa

#: Number of a load or sensor without a fault.
NO_FAULT = 31


def _table(estimates: Any) -> pa.Table:
    return estimates if isinstance(estimates, pa.Table) else pa.table(estimates)


def _column(table: pa.Table, name: str) -> np.ndarray:
    return table[name].to_numpy().astype(float)


def _label(table: pa.Table, name: str) -> str:
    unit = (table.schema.field(name).metadata or {}).get(b"unit")
    return f"{name} [{unit.decode()}]" if unit else name


def _with_std(table: pa.Table) -> list[str]:
    names = table.schema.names
    return [name for name in names if f"{name}_std" in names and f"{name}_fault" in names]


def loads(
    estimates: Any,
    names: Sequence[str] | None = None,
    *,
    reference: Any = None,
    axes: Any = None,
) -> list[Any]:
    """Draw loads over time with two standard deviations; what is not valid is left out.

    Parameters
    ----------
    estimates : table
        Estimates.
    names : sequence of str, optional
        Loads; all where absent.
    reference : dict of str to array, optional
        A measured curve for a load, as long as the estimates.
    axes : sequence of matplotlib axes, optional
        One for each load.

    Returns
    -------
    list of matplotlib axes

    Examples
    --------
    >>> import loadtwin, loadtwin.plot
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> estimates, _ = machine.replay("examples/gearbox/start-stop.parquet")
    >>> [axis.get_ylabel() for axis in loadtwin.plot.loads(estimates)]
    ['main_shaft [Nm]', 'high_speed_shaft [Nm]']
    """
    table = _table(estimates)
    names = list(names or _with_std(table))
    if axes is None:
        _, grid = plt.subplots(len(names), 1, sharex=True, squeeze=False)
        axes = grid[:, 0]
    t = _column(table, "t")
    for axis, name in zip(axes, names):
        valid = _column(table, f"{name}_fault") == NO_FAULT
        value = np.where(valid, _column(table, name), np.nan)
        std = _column(table, f"{name}_std")
        axis.fill_between(t, value - 2 * std, value + 2 * std, alpha=0.3, label="2 σ")
        axis.plot(t, value, label="estimate")
        if reference and name in reference:
            axis.plot(t, reference[name], "k--", linewidth=0.8, label="reference")
        axis.set_ylabel(_label(table, name))
        axis.legend(loc="upper right")
    axes[-1].set_xlabel("t [s]")
    return list(axes)


def innovations(estimates: Any, names: Sequence[str] | None = None, *, axes: Any = None) -> list[Any]:
    """Draw the normalised innovation squared of each sensor, and its flags.

    Parameters
    ----------
    estimates : table
        Estimates.
    names : sequence of str, optional
        Sensors; all where absent.
    axes : sequence of matplotlib axes, optional
        One for each sensor.

    Returns
    -------
    list of matplotlib axes

    Examples
    --------
    >>> import loadtwin, loadtwin.plot
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> estimates, _ = machine.replay("examples/gearbox/start-stop.parquet", sensors="torque-arm-3")
    >>> len(loadtwin.plot.innovations(estimates)) > 3
    True
    """
    table = _table(estimates)
    found = [name.removesuffix("_nis") for name in table.schema.names if name.endswith("_nis")]
    names = list(names or found)
    if axes is None:
        _, grid = plt.subplots(len(names), 1, sharex=True, squeeze=False)
        axes = grid[:, 0]
    t = _column(table, "t")
    for axis, name in zip(axes, names):
        nis = _column(table, f"{name}_nis")
        flagged = _column(table, f"{name}_fault") != NO_FAULT
        axis.semilogy(t, nis, ".", markersize=1)
        axis.semilogy(t[flagged], nis[flagged], "r.", markersize=2)
        axis.axhline(9.0, color="k", linewidth=0.8)
        axis.set_ylabel(name)
    axes[-1].set_xlabel("t [s]")
    return list(axes)


def orbits(estimates: Any, nodes: Sequence[int], *, turns_from_s: float = 0.0, axes: Any = None) -> list[Any]:
    """Draw a rotor's displacements at nodes, y over x.

    Parameters
    ----------
    estimates : table
        Estimates with nodes, as ``replay --nodes`` writes them.
    nodes : sequence of int
        Nodes.
    turns_from_s : float
        Time from which they are drawn [s].
    axes : sequence of matplotlib axes, optional
        One for each node.

    Returns
    -------
    list of matplotlib axes

    Examples
    --------
    >>> import pyarrow, loadtwin.plot
    >>> circle = pyarrow.table({"t": [0.0, 1.0], "node3_x": [1e-6, 0.0], "node3_y": [0.0, 1e-6]})
    >>> loadtwin.plot.orbits(circle, [3])[0].get_title()
    'node 3'
    """
    table = _table(estimates)
    if axes is None:
        _, grid = plt.subplots(1, len(nodes), squeeze=False)
        axes = grid[0]
    part = _column(table, "t") >= turns_from_s
    for axis, node in zip(axes, nodes):
        x, y = (1e6 * _column(table, f"node{node}_{direction}")[part] for direction in "xy")
        axis.plot(x, y)
        axis.set_aspect("equal")
        axis.set_title(f"node {node}")
        axis.set_xlabel("x [µm]")
        axis.set_ylabel("y [µm]")
    return list(axes)


def cycles(life: dict[str, Any], load: str, *, axis: Any = None) -> Any:
    """Draw the ranges of a load's cycles over how often they are exceeded.

    Parameters
    ----------
    life : dict
        What :meth:`loadtwin.Machine.life` returns.
    load : str
        Name of the load.
    axis : matplotlib axes, optional
        Where to draw.

    Returns
    -------
    matplotlib axes

    Examples
    --------
    >>> import loadtwin, loadtwin.plot
    >>> machine = loadtwin.Machine("examples/gearbox/calibrated.toml")
    >>> estimates, _ = machine.replay("examples/gearbox/start-stop.parquet")
    >>> loadtwin.plot.cycles(machine.life(estimates), "main_shaft").get_xlabel()
    'cycles of this range or a larger one'
    """
    if axis is None:
        _, axis = plt.subplots()
    found = life["loads"][load]
    ranges, counts = np.array(sorted(found["cycles"], reverse=True)).T
    axis.step(np.cumsum(counts), ranges, where="pre")
    axis.set_xscale("log")
    axis.set_xlabel("cycles of this range or a larger one")
    axis.set_ylabel(f"range of {load} [{found['unit']}]")
    return axis
