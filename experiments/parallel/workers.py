"""Worker processes that exit with their parent and ignore Ctrl-C, which the parent handles."""

import atexit
import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor


@contextlib.contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes, which are terminated if the block raises an exception.

    Tasks must be submitted within `deaf_children`, as that is when the processes start.
    """
    _start_tracker()
    # fresh interpreters: forked ones would inherit the state of the engine's threads
    with _terminated(ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_begin)) as pool:
        yield pool


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _terminated(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    """Terminate a pool's processes if the block raises an exception."""
    with pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _start_tracker() -> None:
    """Start the process that frees what killed ones leave; it does so without a warning after the error's one line."""
    if os.name != "posix":  # others need none
        return
    from multiprocessing import resource_tracker

    sys.warnoptions.append("ignore:resource_tracker:UserWarning")
    try:
        resource_tracker.ensure_running()  # it is given these options
    finally:
        sys.warnoptions.pop()


@contextlib.contextmanager
def deaf_children() -> Iterator[None]:
    """Let processes that are started in the block ignore Ctrl-C from the start; this process ignores it meanwhile."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _begin() -> None:
    atexit.register(os._exit, 0)  # leave it to the system to take everything apart
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
