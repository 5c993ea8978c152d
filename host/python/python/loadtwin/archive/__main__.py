"""``python -m loadtwin.archive ARCHIVE``: replay an archive on the cores of this computer."""

import sys

from .options import given, parser, results_folder
from .run import replayed
from .text import program


def main() -> int:
    """Run the command line."""
    options = parser("python -m loadtwin.archive", "Replay the days of an archive that are not up to date.")
    options.add_argument("--processes", type=int, metavar="N", help="machines at once; absent: one for each core")
    arguments = options.parse_args()
    start = lambda: replayed(
        arguments.archive, results_folder(arguments), arguments.processes, given(arguments)
    )
    return program(arguments, "loadtwin.archive", start)


if __name__ == "__main__":
    sys.exit(main())
