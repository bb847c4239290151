"""The entry point of `trackslip`: runs the command line and ends an interrupt with one line, whenever it comes."""

import contextlib
import io
import os
import signal
import sys
from types import FrameType
from typing import NoReturn

_AGAIN = 2.0  # when an interrupt is repeated that a library has swallowed [s]


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM: a class of its own, as Python ends by a signal after a plain one in the code of a text."""


class _Interrupts:
    """Turns Ctrl-C and SIGTERM into KeyboardInterrupts."""

    def __init__(self) -> None:
        self.received = False
        self._numbers = [
            number
            for name in ("SIGINT", "SIGTERM", "SIGALRM")
            if (number := getattr(signal, name, None)) and signal.getsignal(number) is not signal.SIG_IGN
        ]
        for number in self._numbers:
            signal.signal(number, self._interrupt)

    def ignore(self) -> None:
        """From now on, the process ends by itself, with its own exit code: no signal in any thread can end it."""
        for number in self._numbers:
            while signal.getsignal(number) is not signal.SIG_IGN:
                with contextlib.suppress(Interrupted):  # of a signal that has just come
                    signal.signal(number, signal.SIG_IGN)

    def _interrupt(self, number: int, frame: FrameType | None) -> NoReturn:
        self.received = True
        sys.unraisablehook = lambda _: None  # a callback that is interrupted can't raise, and would print a traceback
        if hasattr(signal, "SIGALRM"):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        raise Interrupted


def main() -> None:
    """Load the command line and run it."""
    interrupts = _Interrupts()
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every terminal knows every character
    try:
        from experiments.cli import main as run  # here, as an interrupt may come while modules are imported

        run()
    except Exception:
        if not interrupts.received:
            raise
        _interrupted()  # in a half-imported module, an interrupt may surface as any other error
    except KeyboardInterrupt:
        _interrupted()
    finally:
        interrupts.ignore()


def _open_closed_streams() -> None:
    """Lead standard streams that the shell has closed, as by `>&-`, to nowhere: files would take their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False))


def _interrupted() -> NoReturn:
    print("trackslip: interrupted", file=sys.stderr)
    sys.exit(130)


if __name__ == "__main__":
    main()
