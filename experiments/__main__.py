"""The entry point of `trackslip`: Ctrl-C and SIGTERM end it with one line and exit code 130."""

import os
import signal
import sys
import time
from importlib.util import find_spec
from types import FrameType

PACKAGES = ("models", "sim", "trackslip")
"""Packages that a module with the same name, earlier on Python's path, would hide."""
CLEANING = 5.0
"""Time after an interrupt during which further ones are ignored, so that cleaning up can finish
[s].
"""


def main() -> None:
    """Load the command line and run it."""
    for name in PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.submodule_search_locations is None:
            print(
                f"trackslip: {spec.origin} hides the package {name}: rename or move it",
                file=sys.stderr,
            )
            sys.exit(2)
    signals: list[float] = []

    def stop(number: int, frame: FrameType | None) -> None:
        signals.append(time.monotonic())
        if len(signals) == 1 or signals[-1] - signals[0] > CLEANING:
            raise KeyboardInterrupt

    numbers = [
        n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN
    ]
    for number in numbers:
        signal.signal(number, stop)
    try:
        # here, because an interrupt may come during imports
        from experiments.cli import main as run

        run()
    except SystemExit:
        if not signals:
            raise
    except BaseException:  # an interrupted import may raise any type
        if not signals:
            raise
        print("trackslip: interrupted", file=sys.stderr)
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)  # the command has ended: its exit code stands
    if signals:
        sys.stderr.flush()
        os._exit(130)  # a normal exit would wait for killed workers


if __name__ == "__main__":
    main()
