"""Where `trackslip` starts: an interrupt costs one line from the first import on."""

from __future__ import annotations

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from experiments.cli import main as run
    except KeyboardInterrupt:
        print("trackslip: interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
