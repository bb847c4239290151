"""The entry point of `trackslip`: Ctrl-C, SIGTERM and SIGHUP end it with one line and exit code
130.
"""

import sys
from typing import Final

from experiments.common.interrupts import run_interruptible

PACKAGES: Final = ("models", "sim", "trackslip")
"""Packages that a module with the same name, earlier on Python's path, would hide."""


def main() -> None:
    """Load the command line and run it."""
    run_interruptible(_run)


def _run() -> None:
    # these imports stand here, because an interrupt may come during them
    from importlib.util import find_spec

    from experiments.common import streams

    streams.prepare()
    for name in PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.submodule_search_locations is None:
            print(
                f"trackslip: {spec.origin} hides the package {name}: rename or move it",
                file=sys.stderr,
            )
            sys.exit(2)
    from experiments.cli import main as run

    run()


if __name__ == "__main__":
    main()
