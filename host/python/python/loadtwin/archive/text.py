"""Frame of the command lines over archives: runs, prints the figures as JSON or text, gives the exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from .. import Error


def program(arguments: argparse.Namespace, name: str, run: Callable[[], tuple[str, str]]) -> int:
    """Run and print the figures, as JSON or text; give the exit code."""
    try:
        figures, text = run()
    except (Error, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    print(figures if arguments.json else text)
    return 0
