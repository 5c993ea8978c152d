"""What a run over an archive prints."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

from .. import Error
from . import outcome
from .machine_page import FOLDER


def report(done: dict[str, Any]) -> str:
    """Give the figures of a run as text."""
    verdicts = ", ".join(f"{count} {name}" for name, count in done["verdicts"].items() if count)
    lines = [
        f"{done['machines']} machines, {done['days']} days, {done['samples']} samples; "
        f"{done['replayed_days']} days replayed",
        f"state: {verdicts}",
    ]
    if done["faults"]:
        lines.append(f"faults: {done['faults']} ({done['results']}/{outcome.FAULTS})")
    if done["verdicts"]["contradicts"]:
        lines.append(f"to diagnose: {done['results']}/{outcome.CONTRADICTING}")
    if done["page"]:
        lines.append(f"page: {done['results']}/{FOLDER}/index.html")
    return "\n".join(lines)


def program(arguments: argparse.Namespace, name: str, run: Callable[[], dict[str, Any]]) -> int:
    """Run and print; give the exit code."""
    try:
        done = {**run(), "page": arguments.page}
    except (Error, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    print(json.dumps(done) if arguments.json else report(done))
    return 0
