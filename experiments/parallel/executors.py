"""`concurrent.futures` executors by name: this process, worker processes, Dask."""

import contextlib
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from typing import Any, Protocol, TypeVar

from experiments.parallel.early import EARLY, together
from experiments.parallel.helpers import HelpedExecutor, result_files
from experiments.parallel.workers import deaf_children, processes
from trackslip.errors import TrackslipError, first_line

_AHEAD = 2  # submitted tasks per worker, so that no worker waits for its next one
_PATIENCE = 10  # how long a scheduler may take to answer [s]
_IMPORT_PATIENCE = 20  # how long a worker may take to import the simulator [s]

Task = TypeVar("Task")
Result = TypeVar("Result", covariant=True)


class WorkersFailedError(TrackslipError):
    """Workers have died; the results they returned before are kept."""


def nothing() -> bool:
    """There is nothing to do."""
    return False


class Promise(Protocol[Result]):
    """The result of a task, when it is there."""

    def __call__(self, meanwhile: Callable[[], bool] = nothing) -> Result:
        """See `Workers.begin`."""


@dataclass(frozen=True)
class Workers:
    """An executor and the number of tasks it runs at once."""

    executor: Executor
    count: int
    """Including this process where it does tasks, too."""

    @property
    def inline(self) -> bool:
        """Whether tasks run in this process, one after another."""
        return isinstance(self.executor, InlineExecutor)

    def each(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield each task's result as soon as it is ready; raises WorkersFailedError when a worker dies."""
        ahead = 1 if self.inline else _AHEAD * self.count
        left = iter(tasks)
        pending = self._submitted(do, islice(left, ahead))
        with _named_failures():
            while pending:
                done, pending = futures.wait(pending, return_when=futures.FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    pending |= self._submitted(do, islice(left, 1))

    def begin(self, do: Callable[..., Result], *arguments: Any) -> Promise[Result]:
        """Let a worker do a task; call what is returned for its result, which raises WorkersFailedError, too.

        What is returned takes something to do here until the result is there, piece by piece: a callable that returns
        whether it has done one. Only workers that this process is one of need it. Without other processes, a task waits
        until its result is asked for.
        """
        if self.inline:
            once = cache(partial(do, *arguments))
            return lambda meanwhile=nothing: once()
        with self._starting():
            future = self.executor.submit(do, *arguments)

        def result(meanwhile: Callable[[], bool] = nothing) -> Result:
            with _named_failures():
                if isinstance(self.executor, HelpedExecutor):
                    return self.executor.wait(future, meanwhile)
                return future.result()

        return result

    def prepare(self, do: Callable[[], Any]) -> None:
        """Let helpers of this process, if it has any, do something as soon as they are free."""
        if isinstance(self.executor, HelpedExecutor):
            self.executor.prepare(do)

    def _submitted(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> set[Future[Result]]:
        with self._starting():
            return {self.executor.submit(do, task) for task in tasks}

    def _starting(self) -> contextlib.AbstractContextManager[None]:
        """What tasks are submitted in, as that is when processes start."""
        return deaf_children() if isinstance(self.executor, futures.ProcessPoolExecutor) else contextlib.nullcontext()


@contextlib.contextmanager
def _named_failures() -> Iterator[None]:
    """Turn the failures of workers, not those of their tasks, into WorkersFailedErrors."""
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
        with processes(jobs) as pool:
            yield Workers(pool, jobs)
    else:
        with _dask(name) as found:
            yield found


@contextlib.contextmanager
def helped(threads: int) -> Iterator[Workers]:
    """This process and its helpers: as many together as the option `threads` asks for, up to MOST_TOGETHER."""
    count = together(threads)
    if count == 1:
        yield Workers(InlineExecutor(), 1)
        return
    with (
        result_files() as files,  # until no helper can make any
        EARLY.take(count - 1) or processes(count - 1) as pool,
        HelpedExecutor(pool, count - 1, files) as executor,
    ):
        yield Workers(executor, count)


@contextlib.contextmanager
def _dask(name: str) -> Iterator[Workers]:
    address, option = name.replace("dask://", "tcp://", 1), f"--executor {name}"
    try:
        from distributed import Client
    except ImportError as error:
        raise TrackslipError(f'{option}: {error}; pip install "trackslip[dask]"') from error
    try:
        connect: Any = Client  # untyped
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
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
    deadline = time.monotonic() + _IMPORT_PATIENCE
    for future, one in pending.items():
        try:
            future.result(timeout=max(0.0, deadline - time.monotonic()))
        except Exception as error:  # of whatever type the cluster reports
            why = f"{type(error).__name__}: {first_line(error)}"
            who = f"{executor}: the scheduler or its worker {one}"
            raise TrackslipError(f"{who} can't import trackslip; install it there ({why})") from error


def _import_simulator() -> None:
    import sim.fleet  # noqa: F401
