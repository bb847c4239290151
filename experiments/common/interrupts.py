"""The end of an interrupted command: in seconds, with one line, exit code 130 and nothing
half-written.

Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt in the main thread. Python drops exceptions that
are raised in callbacks of weak references and in `__del__`, and libraries catch some, so the
interrupt is raised again until the main thread handles it. If the process hasn't ended PATIENCE
after the first signal, because its main thread is deaf in a long call into a library, another
thread ends it.
"""

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any, Final, NoReturn

SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that interrupt; Windows has no SIGHUP."""
EXIT_CODE: Final = 130
"""Exit code of interrupted commands, as in a shell after Ctrl-C."""
PATIENCE: Final = 3.0
"""Time after the first signal after which the process is ended [s]."""
PAUSE: Final = 0.5
"""Time between interrupts [s]: enough to clean up in a generator that is deleted, where a further
interrupt would be dropped.
"""


def run_interruptible(run: Callable[[], None]) -> None:
    """Call `run` in the main thread; an interrupt ends the process with EXIT_CODE.

    Ignored signals, as after `nohup` and in a shell's background, stay ignored.
    """
    interrupts = _Interrupts()
    told = False
    try:
        try:
            interrupts.begin()
            run()
        finally:
            interrupts.finish()
    except BaseException as error:  # an interrupted import may raise any type
        if not interrupts.raised:
            raise
        told = isinstance(error, SystemExit)  # the command itself has printed a line
    if interrupts.raised:
        with contextlib.suppress(OSError):  # the terminal may be gone
            print(end="", flush=True)
        with contextlib.suppress(OSError):
            print("" if told else "trackslip: interrupted\n", end="", file=sys.stderr, flush=True)
        interrupts.end_process()


class _Interrupts:
    """Raises interrupts in the main thread, and ends the process if that doesn't act on them."""

    def __init__(self) -> None:
        self.raised = False
        """Whether an interrupt was raised in the main thread."""
        self._finished = False
        """Whether the command has ended, so that nothing is raised any more."""
        self._numbers: list[int] = []
        self._undo_all: Callable[[], None] = lambda: None

    def begin(self) -> None:
        """Begin to raise interrupts."""
        for name in SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                self._numbers.append(number)
                signal.signal(number, self._interrupt)
        sys.unraisablehook = self._report_dropped
        # the last at exit, because Python then restores the default, death by the signal
        atexit.register(self._ignore)

        # Python writes a byte here for each signal, even while the main thread is deaf
        woken, wake = os.pipe()
        if sys.platform != "win32":
            os.set_blocking(wake, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, args=(woken,), daemon=True).start()

        # imported only now, because it takes longer than all the rest
        from experiments.common.leftovers import undo_all

        self._undo_all = undo_all

    def finish(self) -> None:
        """Raise no interrupts from here on: the command has ended, and its exit code stands."""
        self._finished = True

    def end_process(self) -> NoReturn:
        """Undo what is unfinished, and end the process without waiting for anything."""
        self._undo_all()
        os._exit(EXIT_CODE)

    def _ignore(self) -> None:
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: interrupt the main thread, unless it is cleaning up after an
        interrupt.
        """
        if not self._finished and not _handles_interrupt():
            self.raised = True
            raise KeyboardInterrupt

    def _report_dropped(self, dropped: Any) -> None:
        """Report an exception that Python drops, unless it may be an interrupt or result from
        one.
        """
        if not self.raised:
            sys.__unraisablehook__(dropped)

    def _watch(self, woken: int) -> None:
        """Wait for a signal; then repeat it, and end the process after PATIENCE."""
        number = 0
        while number not in self._numbers:
            number = os.read(woken, 1)[0]
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            time.sleep(PAUSE)
            if not self._finished:
                _send(number)
        if not self._finished:
            # not by Python's sys.stderr, which the main thread may have locked
            with contextlib.suppress(OSError):
                os.write(2, b"trackslip: interrupted\n")
            # the main thread may complain when its files vanish
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        self.end_process()


def _handles_interrupt() -> bool:
    """Whether an interrupt is being handled: by `except`, by `finally`, or at the end of `with`."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _send(number: int) -> None:
    """Send a signal to the main thread, which also interrupts its waiting."""
    if sys.platform == "win32":
        signal.raise_signal(number)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, number)
