"""`python -m relume`: the command line."""

import os
import sys

from . import run_command_line


def main() -> int:
    """Runs the command line of this process."""
    # Mesa's layer that picks a GPU by the desktop writes errors where there is no desktop; we pick our own.
    os.environ.setdefault("NODEVICE_SELECT", "1")
    return run_command_line(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
