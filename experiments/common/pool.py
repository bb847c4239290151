"""Executors by name (this process, worker processes, a Dask cluster), and interrupts that leave no process behind."""

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice
from types import FrameType, TracebackType
from typing import Any, TypeVar

from trackslip.errors import TrackslipError, first_line

_AHEAD = 2  # submitted tasks per worker, so that no worker waits for its next one
_GRACE = 1.0  # time for the tasks of terminated workers to end [s]
_CONNECT_TIMEOUT = 10  # of a Dask scheduler [s]
_IMPORT_TIMEOUT = 20  # for a Dask worker to import the simulator [s]
_INTERRUPTS = {getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGALRM") if hasattr(signal, name)}

Task = TypeVar("Task")
Result = TypeVar("Result")


class WorkersFailedError(TrackslipError):
    """Workers have died; the results they returned before are kept."""


@dataclass(frozen=True)
class Workers:
    """An executor and the number of tasks it runs at once."""

    executor: Executor
    count: int

    @property
    def inline(self) -> bool:
        """True if tasks run in this process, one after another."""
        return isinstance(self.executor, InlineExecutor)

    def each(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield each task's result as soon as it is ready; raises WorkersFailedError when a worker dies."""
        left = iter(tasks)

        def submitted(count: int) -> set[Future[Result]]:
            return {self.executor.submit(do, task) for task in islice(left, count)}

        with _worker_failures():
            pending = submitted(1 if self.inline else _AHEAD * self.count)
            while pending:
                done, pending = futures.wait(pending, return_when=futures.FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    pending |= submitted(1)

    def map(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Submit all tasks now and yield their results in order; raises WorkersFailedError when a worker dies."""
        with _worker_failures():
            pending = [self.executor.submit(do, task) for task in tasks]

        def results() -> Iterator[Result]:
            with _worker_failures():
                for future in pending:
                    yield future.result()

        return results()


@contextlib.contextmanager
def _worker_failures() -> Iterator[None]:
    """Turn failures of workers, but not of their tasks, into WorkersFailedErrors."""
    try:
        yield
    except (futures.BrokenExecutor, futures.CancelledError) as error:
        raise WorkersFailedError("a worker died") from error
    except Exception as error:
        if not type(error).__module__.startswith("distributed"):
            raise
        raise WorkersFailedError(f"the cluster fails ({type(error).__name__})") from error


class InlineExecutor(Executor):
    """Runs each task in this process as soon as it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run the call; the future that is returned is already done."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class WorkerProcesses(ProcessPoolExecutor):
    """Processes that ignore Ctrl-C, which this process handles, and that end with it.

    As a context, it waits for them to end; within a second or so if the block raises an exception.
    """

    def __init__(self, count: int) -> None:
        # fresh interpreters: forked ones would inherit the state of the engine's threads
        with interrupts_later():
            super().__init__(count, multiprocessing.get_context("spawn"), initializer=_begin)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See Executor. The first submission starts the processes."""
        with interrupts_later(), _sigint_blocked():
            return super().submit(_run, fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self.shutdown()
                return
        except BaseException:
            self._terminate()
            raise
        self._terminate()

    def _terminate(self) -> None:
        """End the tasks, or if they don't within _GRACE, the processes."""
        with interrupts_later():
            self.shutdown(wait=False, cancel_futures=True)
            children = multiprocessing.active_children()
            for child in children:
                child.terminate()
            deadline = time.monotonic() + _GRACE
            for child in children:
                child.join(max(0.0, deadline - time.monotonic()))
                if child.is_alive():
                    child.kill()
                    child.join(_GRACE)


class _Task:
    """The task that a worker process runs. SIGTERM ends it, and all later ones as they begin, by a KeyboardInterrupt.

    The process itself ends when there are no more tasks: if it were killed while it writes to the pipe of results, the
    pool would wait for the rest for ever.
    """

    def __init__(self) -> None:
        self._terminated = self._running = False

    def run(self, do: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
        """Call a function."""
        self._running = True
        try:
            if self._terminated:
                raise KeyboardInterrupt
            return do(*arguments, **options)
        finally:
            self._running = False

    def terminate(self, number: int, frame: FrameType | None) -> None:
        """Handle SIGTERM."""
        self._terminated, running, self._running = True, self._running, False
        sys.unraisablehook = lambda _: None  # a callback that is interrupted can't raise, and would print a traceback
        if running:
            raise KeyboardInterrupt


_TASK = _Task()  # that of this process


def _run(do: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    return _TASK.run(do, *arguments, **options)


def _begin() -> None:
    """Prepare a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # blocked anyway, where signals can be
    signal.signal(signal.SIGTERM, _TASK.terminate)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # workers draw nothing; else MuJoCo, when it is imported, looks for GLFW in a process that outlives a killed worker
    os.environ.setdefault("MUJOCO_GL", "disable")


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))


@contextlib.contextmanager
def _sigint_blocked() -> Iterator[None]:
    """Block SIGINT, where that is possible, for processes that are started in the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def interrupts_later() -> Iterator[None]:
    """Postpone Ctrl-C and SIGTERM until the block ends."""
    if threading.current_thread() is not threading.main_thread():  # other threads aren't interrupted
        yield
        return
    caught: list[int] = []
    before = {number: signal.getsignal(number) for number in _INTERRUPTS}
    try:
        for number in before:
            signal.signal(number, lambda which, _: caught.append(which))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if caught:
            signal.raise_signal(caught[0])


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def workers(name: str, jobs: int) -> Iterator[Workers]:
    """Workers of the executor called `name`; `jobs` is the number of processes of `processes`.

    Raises:
        TrackslipError: when the executor's library isn't installed, its scheduler can't be reached, or its workers
            can't import trackslip.
    """
    if name == "inline" or (name == "processes" and jobs <= 1):
        yield Workers(InlineExecutor(), 1)
    elif name == "processes":
        with WorkerProcesses(jobs) as pool:
            yield Workers(pool, jobs)
    else:
        with _dask(name) as found:
            yield found


@contextlib.contextmanager
def _dask(name: str) -> Iterator[Workers]:
    address, option = name.replace("dask://", "tcp://", 1), f"--executor {name}"
    try:
        from distributed import Client
    except ImportError as error:
        raise TrackslipError(f'{option}: {error}; pip install "trackslip[dask]"') from error
    try:
        connect: Any = Client  # untyped
        client = connect(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise TrackslipError(f"{option}: no scheduler answers there ({error})") from error
    with contextlib.ExitStack() as stack:
        logging.disable()  # distributed logs tracebacks of its own when a cluster fails
        stack.callback(logging.disable, logging.NOTSET)
        stack.enter_context(client)
        there = client.scheduler_info(n_workers=-1)["workers"]
        count = sum(worker["nthreads"] for worker in there.values())
        if count < 1:
            raise TrackslipError(f"{option}: the scheduler has no workers")
        _require_trackslip(client, list(there), option)
        pool = client.get_executor(pure=False)
        stack.callback(pool.shutdown, wait=False)
        yield Workers(pool, count)


def _require_trackslip(client: Any, addresses: Sequence[str], executor: str) -> None:
    """Raise TrackslipError unless scheduler and workers can import trackslip; tasks they can't load never finish."""
    pending = {client.submit(_import_simulator, workers=[one], pure=False): one for one in addresses}
    deadline = time.monotonic() + _IMPORT_TIMEOUT
    for future, one in pending.items():
        try:
            future.result(timeout=max(0.0, deadline - time.monotonic()))
        except Exception as error:  # of whatever type the cluster reports
            why = f"{type(error).__name__}: {first_line(error)}"
            who = f"{executor}: the scheduler or its worker {one}"
            raise TrackslipError(f"{who} can't import trackslip; install it there ({why})") from error


def _import_simulator() -> None:
    import sim.fleet  # noqa: F401
