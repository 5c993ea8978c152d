"""The ``loadtwin`` command."""

import signal
import sys

from ._loadtwin import program


def main() -> None:
    """Run the command line."""
    # The command has its own way to end on an interrupt, and on a closed pipe.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(program(["loadtwin", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
