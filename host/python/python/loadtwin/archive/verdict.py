"""Sums of a day, and whether they contradict the description."""

from __future__ import annotations

from typing import Any

from .. import _loadtwin

#: States of a machine, the worst first.
VERDICTS = ("contradicts", "not valid", "no data", "fits")

#: Part of the samples in which some load is valid, below which a day is not valid.
VALID = 0.5

Sums = dict[str, Any]


def add(total: Sums | None, sums: Sums) -> Sums:
    """Add the sums of a recording to those before it on the same day.

    Parameters
    ----------
    total : dict or None
        Sums so far.
    sums : dict
        Of a replay: ``samples``, ``valid``, ``span_s``, ``loads``, ``sensors``.

    Returns
    -------
    dict
        Both; ``seconds`` is the time that the recordings span.
    """
    span = sums["span_s"] or [0.0, 0.0]
    sums = {**sums, "seconds": span[1] - span[0]}
    if total is None:
        return sums
    return {
        "samples": total["samples"] + sums["samples"],
        "valid": total["valid"] + sums["valid"],
        "seconds": total["seconds"] + sums["seconds"],
        "loads": _added(total["loads"], sums["loads"], ("valid", "sum")),
        "sensors": _added(total["sensors"], sums["sensors"], ("compared", "contradicting", "used", "bias", "nis")),
    }


def disagrees(sensor: dict[str, Any]) -> bool:
    """Whether a sensor contradicts the description, by the rule of ``loadtwin replay``."""
    contradicting, used = sensor["contradicting"], sensor["used"]
    often = contradicting >= _loadtwin.SETTLED and share(sensor) > _loadtwin.CONTRADICTING
    biased = used > _loadtwin.SETTLED and abs(sensor["bias"] / used) > _loadtwin.BIASED
    return often or biased


def share(sensor: dict[str, Any]) -> float:
    """Part of the readings of a sensor that contradict the description."""
    return sensor["contradicting"] / max(sensor["compared"], 1)


def worst(sensors: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Give the sensor that contradicts most."""

    def bad(sensor: dict[str, Any]) -> tuple[bool, float, float]:
        return disagrees(sensor), share(sensor), abs(sensor["bias"]) / max(sensor["used"], 1)

    return max(sensors, key=bad, default=None)


def verdict(sums: Sums | None) -> str:
    """Give the state of the machine on a day, one of `VERDICTS`.

    Examples
    --------
    >>> from loadtwin.archive.verdict import verdict
    >>> sensor = {"compared": 1000, "contradicting": 3, "used": 1000, "bias": 20.0, "nis": 990.0}
    >>> verdict({"samples": 1000, "valid": 900, "sensors": [sensor]})
    'fits'
    >>> verdict({"samples": 1000, "valid": 900, "sensors": [sensor | {"bias": -700.0}]})
    'contradicts'
    """
    if sums is None or sums["samples"] == 0:
        return "no data"
    if any(map(disagrees, sums["sensors"])):
        return "contradicts"
    return "not valid" if sums["valid"] < VALID * sums["samples"] else "fits"


def _added(before: list[dict[str, Any]], after: list[dict[str, Any]], keys: tuple[str, ...]) -> list[dict[str, Any]]:
    # One description holds for a day: the same loads and sensors in the same order.
    return [_both(a, b, keys) for a, b in zip(before, after, strict=True)]


def _both(a: dict[str, Any], b: dict[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    both = {**a, **{key: a[key] + b[key] for key in keys}}
    for key, extreme in (("lowest", min), ("highest", max)):
        if key in a:
            known = [value for value in (a[key], b[key]) if value is not None]
            both[key] = extreme(known) if known else None
    flags = a["flags"].keys() | b["flags"].keys()
    both["flags"] = {flag: a["flags"].get(flag, 0) + b["flags"].get(flag, 0) for flag in sorted(flags)}
    return both
