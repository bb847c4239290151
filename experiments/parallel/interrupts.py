"""Interrupts that are postponed until a short operation is complete."""

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def interrupts_later() -> Iterator[None]:
    """Postpone Ctrl-C and SIGTERM until the block ends, then raise KeyboardInterrupt if there was one."""
    if threading.current_thread() is not threading.main_thread():  # other threads aren't interrupted
        yield
        return
    caught: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, lambda which, _: caught.append(which))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if caught:
        raise KeyboardInterrupt
