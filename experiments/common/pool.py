"""Where tasks run: in this process, in worker processes, or on a Dask cluster, behind one
interface.
"""

import contextlib
import logging
import math
import os
import pickle
import queue
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from experiments.common.leftovers import undone
from trackslip.errors import TrackslipError, first_line

CHECK: Final = 1.0
"""Time between checks that a cluster lives, while no result arrives [s]."""
GRACE: Final = 5.0
"""Time after which a cluster without workers, or without a scheduler, is given up: a nanny of Dask
starts a dead worker again in less [s].
"""
PATIENCE: Final = 10.0
"""Longest time until a cluster's scheduler and its first worker answer [s]."""


class WorkersFailedError(TrackslipError):
    """Raised if workers have died; results that they returned earlier are kept."""


@dataclass(frozen=True)
class Workers:
    """How tasks are submitted, and the number of tasks that run at once; by default, tasks run in
    this process.
    """

    submit: Callable[[Callable[[Any], Any], Any], futures.Future[Any]] | None = None
    count: int = 1
    check: Callable[[], object] = lambda: None
    """Called every now and then; raises WorkersFailedError if no result can come any more."""

    def each(self, do: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
        """Submit tasks as workers become free, and yield results as they arrive; raises
        WorkersFailedError.
        """
        if self.submit is None:
            yield from map(do, tasks)
            return
        remaining = iter(tasks)
        pending = {self.submit(do, task) for task in islice(remaining, self.count)}
        while pending:
            done, pending = futures.wait(pending, CHECK, futures.FIRST_COMPLETED)
            if not done:
                self.check()
            for future in done:
                yield _result_of(future)
                pending |= {self.submit(do, task) for task in islice(remaining, 1)}


def _result_of(future: futures.Future[Any]) -> Any:
    """The result of a task that is done; raises its error, or WorkersFailedError."""
    try:
        return future.result()
    except futures.CancelledError as error:  # by Dask, when the connection closes
        raise WorkersFailedError("the scheduler has stopped") from error
    except Exception as error:
        if type(error).__module__.startswith("distributed"):
            raise WorkersFailedError(f"a worker died ({type(error).__name__})") from error
        raise


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers(
    name: str, count: int, wait: bool = False
) -> contextlib.AbstractContextManager[Workers]:
    """Context with the workers `name`: "inline", "processes" (`count` of them), or a scheduler,
    dask://HOST:PORT. If all workers of a cluster have died, `wait` waits for others.
    """
    if name == "inline":
        return contextlib.nullcontext(Workers())
    return _processes(count) if name == "processes" else _cluster(name, wait)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[Workers]:
    """Start worker processes, each with a thread here that passes tasks to it; they end with the
    block.
    """
    idle: queue.SimpleQueue[subprocess.Popen[bytes]] = queue.SimpleQueue()

    def do_in_process(do: Callable[[Any], Any], task: Any) -> Any:
        process = idle.get()
        try:
            return _result(process, do, task)
        finally:
            idle.put(process)

    # the threads end after the processes, whose pipes they read
    with futures.ThreadPoolExecutor(count) as threads, contextlib.ExitStack() as started:
        for _ in range(count):
            process = started.enter_context(_start_process())
            started.enter_context(undone(process.kill))
            idle.put(process)
        yield Workers(lambda do, task: threads.submit(do_in_process, do, task), count)


def _start_process() -> subprocess.Popen[bytes]:
    """Start a process that does tasks until its standard input ends."""
    path = [os.path.abspath(folder) for folder in sys.path]  # the empty name is this folder
    return subprocess.Popen(
        # -P, because the path is complete
        [sys.executable, "-P", "-m", "experiments.common.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={
            "MUJOCO_GL": "disable",  # workers draw nothing
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path),
        },
        process_group=0,  # out of reach of the terminal's Ctrl-C
    )


def _result(process: subprocess.Popen[bytes], do: Callable[[Any], Any], task: Any) -> Any:
    """Let a process do a task; returns its result, or raises its error or WorkersFailedError."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        pickle.dump(pickle.dumps((do, task)), process.stdin)
        process.stdin.flush()
        outcome = pickle.load(process.stdout)
    except (OSError, EOFError, pickle.UnpicklingError) as error:
        code = process.wait()
        raise WorkersFailedError(f"a worker died (exit code {code})") from error
    succeeded, result = pickle.loads(outcome)
    if not succeeded:
        raise result
    return result


@contextlib.contextmanager
def _cluster(name: str, wait: bool) -> Iterator[Workers]:
    """Connect to a cluster whose workers can import trackslip."""
    with contextlib.ExitStack() as connected:
        try:
            from distributed import Client

            connected.enter_context(_quiet())
            address = name.replace("dask", "tcp", 1)
            client = Client(address, timeout=PATIENCE, set_as_default=False)
            connected.callback(_close, client)
            client.wait_for_workers(1, timeout=PATIENCE)
            client.run(exec, "import sim.fleet.fleet")
        except ImportError as error:
            raise TrackslipError(
                f'--executor {name}: {error}; pip install -e ".[dask]" here and there'
            ) from error
        except OSError as error:
            raise TrackslipError(
                f"--executor {name}: no workers answer there ({first_line(error)})"
            ) from error
        cluster = _Cluster(name, client, wait)
        yield Workers(cluster.submit, sum(client.nthreads().values()), cluster.check)


class _Cluster:
    """A Dask cluster, watched for the death of its scheduler or of all its workers."""

    def __init__(self, name: str, client: Any, wait: bool) -> None:
        self._name = name
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._wait = wait
        self._deserted: float | None = None
        """Time at which all workers were found missing [s], None while there are some."""

    def submit(self, do: Callable[[Any], Any], task: Any) -> futures.Future[Any]:
        """Submit a task."""
        future: futures.Future[Any] = self._executor.submit(do, task)
        return future

    def check(self) -> None:
        """Raise WorkersFailedError if the scheduler is gone, or if all workers are and none is
        waited for.
        """
        try:
            alive = bool(self._client.nthreads())
        except Exception as error:  # of several kinds, while the connection closes
            raise WorkersFailedError(f"{self._name}: the scheduler has stopped") from error
        now = time.monotonic()
        if alive:
            self._deserted = None
        elif self._deserted is None:
            self._deserted = now
        elif now - self._deserted > GRACE:
            if not self._wait:
                raise WorkersFailedError(f"{self._name}: all workers have died")
            self._deserted = math.inf  # say so once
            print(f"{self._name}: all workers have died; waiting for others", file=sys.stderr)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Log nothing: Dask would say on 40 lines what an error here says on one."""
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


def _close(client: Any) -> None:
    """Disconnect from a scheduler, which may not answer any more."""
    with contextlib.suppress(OSError):
        client.close(timeout=CHECK)
