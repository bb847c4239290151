"""Helper processes that import what their tasks need while the command that they help is itself starting."""

import contextlib
import gc
import importlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from experiments.parallel.workers import deaf_children, processes, processors

NEEDED = {"reproduce": ("experiments.reproducing.grid", "experiments.reproducing.loops")}
"""Commands with helpers, and the modules that the first tasks need."""
MOST_TOGETHER = 12
"""Processes that share the work of a command, at most."""
_DRAWING = ("experiments.report.page", "experiments.report.figures.laws", "experiments.report.figures.tracking")
_THREADS = "--threads"


class EarlyHelpers:
    """Helpers that begin before the command does, whose options have yet to be checked."""

    def __init__(self) -> None:
        self._kept = contextlib.ExitStack()
        self._pool: ProcessPoolExecutor | None = None
        self._count = 0

    def begin(self, arguments: Sequence[str]) -> None:
        """Start those that a command line asks for, if there are processors for them."""
        count = helpers_of(arguments)
        if not count:
            return
        self._pool, self._count = self._kept.enter_context(processes(count)), count
        try:
            with deaf_children():
                for _ in range(count):
                    self._pool.submit(load, NEEDED[arguments[0]])
        except OSError:  # the command tries again, and reports
            self.end()

    def take(self, count: int) -> contextlib.AbstractContextManager[ProcessPoolExecutor] | None:
        """The pool of so many helpers, if that is what was begun: once, for the block that it is used in."""
        if self._pool is None or self._count != count:
            return None
        return self._taken(self._pool)

    def end(self) -> None:
        """Terminate them unless they were taken."""
        if self._pool is not None:
            self._pool = None
            with contextlib.suppress(SystemExit), self._kept:
                raise SystemExit

    @contextlib.contextmanager
    def _taken(self, pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
        self._pool = None
        with self._kept.pop_all():
            yield pool


EARLY = EarlyHelpers()
"""Those of this process."""


def helpers_of(arguments: Sequence[str]) -> int:
    """How many helpers a command line asks for; 0 if there are none to begin early."""
    if not arguments or arguments[0] not in NEEDED or {"-h", "--help"} & {*arguments}:
        return 0
    threads = "0"
    for one, following in zip(arguments, [*arguments[1:], ""], strict=True):
        name, _, value = one.partition("=")
        if name == _THREADS:
            threads = value or following
    if not threads.isdecimal() or int(threads) > processors():
        return 0
    return together(int(threads)) - 1


def together(threads: int) -> int:
    """How many processes work together if so many threads are asked for, 0 for one per processor.

    A paper's worth of runs has no work for more than MOST_TOGETHER; the engine has, for the other threads.
    """
    return min(threads or processors(), MOST_TOGETHER)


def load(modules: Sequence[str]) -> None:
    """Import modules in a helper, which ends before its garbage matters."""
    gc.disable()
    for module in modules:
        importlib.import_module(module)


def load_drawing() -> None:
    """Import what draws figures of reports in a helper."""
    load(_DRAWING)
