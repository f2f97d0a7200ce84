"""`python -m relume`: the command line."""

import sys

from . import run_command_line


def main() -> int:
    """Runs the command line of this process."""
    return run_command_line(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
