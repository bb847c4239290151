"""Helper processes that import what their tasks need while the command that they help is still starting."""

import contextlib
import gc
import importlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from experiments.parallel.workers import deaf_children, processes, processors
from experiments.starting.put_off import put_off
from experiments.starting.quick_matplotlib import import_matplotlib

NEEDED = {"reproduce": ("experiments.reproducing.grid", "experiments.reproducing.loops")}
"""Commands with helpers, and the modules that the helpers' first tasks need."""
_THREADS = "--threads"


class EarlyHelpers:
    """Helpers that were started before their command was."""

    def __init__(self) -> None:
        self._kept = contextlib.ExitStack()
        self._pool: ProcessPoolExecutor | None = None
        self._count = 0

    def start(self, arguments: Sequence[str]) -> None:
        """Start those of a command line, if it has any."""
        command = arguments[0] if arguments else ""
        count = helpers_of(arguments)
        if command not in NEEDED or not count:
            return
        self._pool, self._count = self._kept.enter_context(processes(count)), count
        with deaf_children():
            for _ in range(count):
                self._pool.submit(load, NEEDED[command])

    def take(self, count: int) -> contextlib.AbstractContextManager[ProcessPoolExecutor] | None:
        """So many helpers, if they were started; only once."""
        if self._pool is None or self._count != count:
            return None
        pool, self._pool = self._pool, None
        return self._until_end(pool)

    @contextlib.contextmanager
    def _until_end(self, pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
        with self._kept.pop_all():
            yield pool


EARLY = EarlyHelpers()
"""Those of this process."""


def helpers_of(arguments: Sequence[str]) -> int:
    """The number of processes that a command line asks for besides its own; 0 if it can't be told yet."""
    if any(one in ("-h", "--help") for one in arguments):
        return 0
    threads = "0"
    for k, one in enumerate(arguments):
        name, _, value = one.partition("=")
        if name == _THREADS:
            threads = value or "".join(arguments[k + 1 : k + 2])
    if not threads.isdecimal():
        return 0
    return max(0, (int(threads) or processors()) - 1)


def load_drawing() -> None:
    """Import what draws figures of reports."""
    import_matplotlib()
    load(("experiments.report.reproduction",))


def load(modules: Sequence[str]) -> None:
    """Import modules; what they make while they are imported is no garbage."""
    gc.disable()
    put_off()
    for module in modules:
        importlib.import_module(module)
    gc.freeze()
    gc.enable()
