"""Options of a run over an archive (sensors, filter, columns, pages) and their command-line parser."""

from __future__ import annotations

import argparse
import dataclasses
import os


@dataclasses.dataclass(frozen=True)
class Options:
    """How the machines of an archive are replayed.

    Attributes
    ----------
    sensors : str or None
        Set of sensors; the first of each description where absent.
    filter : {"aekf", "steady"}
        The filter.
    columns : {"all", "loads"}
        Columns of the estimates that are kept.
    again : bool
        Replay all days again, also those that are up to date.
    page : bool
        Write the pages.
    """

    sensors: str | None = None
    filter: str = "aekf"
    columns: str = "all"
    again: bool = False
    page: bool = True


def parser(program: str, description: str) -> argparse.ArgumentParser:
    """Give a parser of the options that all runs have."""
    parser = argparse.ArgumentParser(prog=program, description=description)
    parser.add_argument("archive", help="folder with recordings/ and descriptions.csv")
    parser.add_argument("-o", "--results", help="folder of the results; absent: ARCHIVE/results")
    parser.add_argument("--sensors", metavar="SET", help="set of sensors; absent: the first of each description")
    parser.add_argument("--filter", choices=("aekf", "steady"), default="aekf", help="the filter")
    parser.add_argument("--columns", choices=("all", "loads"), default="all", help="columns of the estimates")
    parser.add_argument("--again", action="store_true", help="replay all days again")
    parser.add_argument("--no-page", dest="page", action="store_false", help="write no pages")
    parser.add_argument("--json", action="store_true", help="print one object")
    return parser


def given(arguments: argparse.Namespace) -> Options:
    """Give the options of parsed arguments."""
    names = [field.name for field in dataclasses.fields(Options)]
    return Options(**{name: getattr(arguments, name) for name in names})


def results_folder(arguments: argparse.Namespace) -> str:
    """Give the folder of the results."""
    return arguments.results or os.path.join(arguments.archive, "results")
