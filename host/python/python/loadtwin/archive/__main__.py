"""``python -m loadtwin.archive ARCHIVE``: replay an archive with processes of this computer."""

import sys

from .options import given, parser, results_folder
from .run import run
from .text import program


def main() -> int:
    """Run the command line."""
    options = parser("python -m loadtwin.archive", "Replay the days of an archive that are not up to date.")
    options.add_argument("--processes", type=int, metavar="N", help="processes; absent: one for each core")
    arguments = options.parse_args()
    start = lambda: run(
        arguments.archive,
        results_folder(arguments),
        processes=arguments.processes,
        options=given(arguments),
    )
    return program(arguments, "loadtwin.archive", start)


if __name__ == "__main__":
    sys.exit(main())
