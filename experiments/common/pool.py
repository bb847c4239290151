"""Where tasks run: in this process, in worker processes, or on a Dask cluster, behind one
interface.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from dataclasses import dataclass
from itertools import islice
from typing import Any

from trackslip.errors import TrackslipError, first_line


class WorkersFailedError(TrackslipError):
    """Raised if workers have died; results that they returned earlier are kept."""


@dataclass(frozen=True)
class Workers:
    """An executor, and the number of tasks that it runs at once; without an executor, tasks run in
    this process.
    """

    executor: futures.Executor | None = None
    count: int = 1

    def each(self, do: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
        """Submit tasks as workers become free, and yield results as they arrive; raises
        WorkersFailedError.
        """
        if self.executor is None:
            yield from map(do, tasks)
            return
        queue = iter(tasks)
        try:
            pending = {self.executor.submit(do, task) for task in islice(queue, self.count)}
            while pending:
                done, pending = futures.wait(pending, return_when=futures.FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    pending |= {self.executor.submit(do, task) for task in islice(queue, 1)}
        except Exception as error:
            lost = isinstance(error, futures.BrokenExecutor | futures.CancelledError)
            if lost or type(error).__module__.startswith("distributed"):
                raise WorkersFailedError(f"a worker died ({type(error).__name__})") from error
            raise


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers(name: str, count: int) -> contextlib.AbstractContextManager[Workers]:
    """Context with the workers `name`: "inline", "processes" (`count` of them), or a scheduler,
    dask://HOST:PORT.
    """
    if name == "inline":
        return contextlib.nullcontext(Workers())
    return _processes(count) if name == "processes" else _cluster(name)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[Workers]:
    """Start worker processes, which end at once if this process is interrupted, and after their
    tasks if it fails.
    """
    pool = futures.ProcessPoolExecutor(
        count, multiprocessing.get_context("spawn"), initializer=_begin
    )
    try:
        yield Workers(pool, count)
    except KeyboardInterrupt:  # no waiting, because a worker killed while sending would never end
        for child in multiprocessing.active_children():
            child.kill()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("MUJOCO_GL", "disable")  # workers draw nothing
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    multiprocessing.parent_process().join()  # type: ignore[union-attr]
    os._exit(1)


@contextlib.contextmanager
def _cluster(name: str, patience: float = 10.0) -> Iterator[Workers]:
    """Connect to a cluster whose workers can import trackslip; wait at most `patience` [s] for the
    first worker.
    """
    try:
        from distributed import Client

        client = Client(name.replace("dask", "tcp", 1), timeout=patience, set_as_default=False)
        client.wait_for_workers(1, timeout=patience)
        client.run(exec, "import sim.fleet")
    except ImportError as error:
        raise TrackslipError(
            f'--executor {name}: {error}; pip install -e ".[dask]" here and there'
        ) from error
    except OSError as error:
        raise TrackslipError(
            f"--executor {name}: no workers answer there ({first_line(error)})"
        ) from error
    with client:
        yield Workers(client.get_executor(pure=False), sum(client.nthreads().values()))
