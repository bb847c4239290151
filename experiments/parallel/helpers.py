"""An executor whose tasks this process and its helpers share: whoever waits for a result does tasks meanwhile."""

import contextlib
import os
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
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

    def __init__(self, pool: ProcessPoolExecutor, helpers: int) -> None:
        """`pool`: of so many processes."""
        self._pool, self._helpers, self._free = pool, helpers, helpers
        self._files = Path(tempfile.gettempdir(), f"trackslip-{os.getpid()}-")  # how the names of files begin
        self._waiting: deque[_Task] = deque()
        self._lock = threading.Lock()  # of both

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a helper that is free do a task, else the first who has time."""
        task = _Task(partial(fn, *args, **kwargs))
        with self._lock:
            self._waiting.append(task)
        with deaf_children():
            self._hand_out()
        return task.future

    def prepare(self, do: Callable[[], Any]) -> None:
        """Let helpers do something before their next tasks, as import what these need."""
        with deaf_children():
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
        """Forget tasks that nobody has begun, and results that nobody has asked for."""
        with self._lock:
            self._waiting.clear()
        for file in self._files.parent.glob(f"{self._files.name}*"):
            with contextlib.suppress(OSError):
                file.unlink()

    def _hand_out(self) -> None:
        with self._lock:
            if not self._free or not self._waiting:
                return
            task = self._waiting.popleft()
            self._free -= 1
        try:
            self._pool.submit(filed, str(self._files), task.do).add_done_callback(partial(self._returned, task))
        except Exception as error:  # the helpers died
            task.future.set_exception(error)

    def _returned(self, task: _Task, answer: Future[Any]) -> None:
        """Pass a helper's answer on and give it its next task."""
        with self._lock:
            self._free += 1
        try:
            result = answer.result()
            task.future.set_result(result.read() if isinstance(result, Filed) else result)
        except BaseException as error:
            task.future.set_exception(error)
        self._hand_out()
