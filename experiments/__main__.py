"""Where `trackslip` starts: an interrupt prints one line, even while modules are being imported."""

import contextlib
import gc
import io
import os
import signal
import sys
from collections.abc import Iterator

_HELPED = "reproduce"


def main() -> None:
    """Load the command line and run it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _quit)  # cli restores it when the command's modules are there
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every terminal knows every character
    gc.disable()  # cli restores it, too: what is imported is no garbage
    with _helpers():
        from experiments.starting.put_off import put_off

        put_off()
        from experiments.cli import main as run

        run()


@contextlib.contextmanager
def _helpers() -> Iterator[None]:
    """Start helpers of the command that has some; they end with the block if the command doesn't take them."""
    if sys.argv[1:2] != [_HELPED]:  # what starts processes takes a while to be imported
        yield
        return
    from experiments.parallel.early import EARLY

    EARLY.begin(sys.argv[1:])
    try:
        yield
    finally:
        EARLY.end()


def _quit(*_: object) -> None:
    """Leave at once: KeyboardInterrupt in a half-imported module could surface as any other error."""
    os.write(2, b"trackslip: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    main()
