"""An executor whose tasks this process and its helpers share: whoever waits for a result does tasks meanwhile."""

import contextlib
import os
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from experiments.parallel.by_file import Filed, filed
from experiments.parallel.workers import deaf_children


@dataclass(frozen=True)
class _Task:
    do: Callable[[], Any]
    future: Future[Any] = field(default_factory=Future)


class HelpedExecutor(Executor):
    """Helper processes begin tasks in the order in which they were submitted; `wait` does those that nobody has begun.

    Only one thread may submit and wait.
    """

    def __init__(self, pool: ProcessPoolExecutor, helpers: int, files: str) -> None:
        """`pool`: of so many processes; `files`: how the paths of files begin through which large results come."""
        self._pool, self._helpers, self._files = pool, helpers, files
        self._lock = threading.Lock()  # of what follows
        self._free = helpers
        self._waiting: deque[_Task] = deque()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a helper that is free do a task, else the first who has time."""
        task = _Task(partial(fn, *args, **kwargs))
        with self._lock:
            self._waiting.append(task)
        with deaf_children():
            self._hand_out()
        return task.future

    def prepare(self, do: Callable[[], Any]) -> None:
        """Let helpers do something as soon as they are free, as import what their next tasks need.

        That is done as often as there are helpers; one that is free before the others may do it for them.
        """
        with deaf_children(), contextlib.suppress(BrokenExecutor):  # the next result reports it
            for _ in range(self._helpers):
                self._pool.submit(do)

    def wait(self, future: Future[Any], meanwhile: Callable[[], bool]) -> Any:
        """The result of a task; until there is one, do others that nobody has begun, and after them `meanwhile`.

        That is called again and again as long as it returns that it has done something.
        """
        while not future.done() and (self._do_next() or meanwhile()):
            pass
        return future.result()

    def _do_next(self) -> bool:
        """Do a task that nobody has begun, if there is one."""
        with self._lock:
            task = self._waiting.popleft() if self._waiting else None
        if task is None:
            return False
        try:
            task.future.set_result(task.do())
        except Exception as error:
            task.future.set_exception(error)
        return True

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Forget tasks that nobody has begun."""
        with self._lock:
            self._waiting.clear()

    def _hand_out(self) -> None:
        with self._lock:
            if not self._free or not self._waiting:
                return
            task = self._waiting.popleft()
            self._free -= 1
        try:
            answer = self._pool.submit(filed, self._files, task.do)
        except Exception as error:
            self._give_up(error)
            task.future.set_exception(error)
        else:
            answer.add_done_callback(partial(self._returned, task))

    def _returned(self, task: _Task, answer: Future[Any]) -> None:
        """Pass a helper's answer on and give it its next task."""
        try:
            result = answer.result()
            task.future.set_result(result.read() if isinstance(result, Filed) else result)
        except (BrokenExecutor, CancelledError) as error:  # the pool can't be asked here: it may hold its lock
            self._give_up(error)
            task.future.set_exception(error)
            return
        except BaseException as error:
            task.future.set_exception(error)
        with self._lock:
            self._free += 1
        self._hand_out()

    def _give_up(self, error: BaseException) -> None:
        """No helper is left: tasks that wait fail, too."""
        with self._lock:
            self._free = 0
            waiting = [*self._waiting]
            self._waiting.clear()
        for task in waiting:
            task.future.set_exception(error)


@contextlib.contextmanager
def result_files() -> Iterator[str]:
    """How the paths of files begin through which results come; those that are left when the block ends are deleted."""
    folder, name = Path(tempfile.gettempdir()), f"trackslip-{os.getpid()}-"
    try:
        yield str(folder / name)
    finally:
        for file in folder.glob(f"{name}*"):
            with contextlib.suppress(OSError):
                file.unlink()
