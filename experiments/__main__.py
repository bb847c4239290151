"""Where `trackslip` starts: an interrupt prints one line, even while modules are being imported."""

import gc
import io
import os
import signal
import sys


def main() -> None:
    """Load the command line and run it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _quit)  # cli restores it when the command's modules are there
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every terminal knows every character
    gc.disable()  # cli restores it, too: what is imported is no garbage
    from experiments.parallel.early import EARLY
    from experiments.starting.put_off import put_off

    EARLY.begin(sys.argv[1:])
    put_off()
    from experiments.cli import main as run

    try:
        run()
    finally:
        EARLY.end()


def _quit(*_: object) -> None:
    """Leave at once: KeyboardInterrupt in a half-imported module could surface as any other error."""
    os.write(2, b"trackslip: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    main()
