"""Progress bars on the terminal, and lines in the log of a long command."""

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

_FIRST_LINE = 2.0  # how long a command may be silent in a log [s]
_BETWEEN_LINES = 60.0  # [s]
_RATED = ("s", "steps", "runs")  # units whose rates mean something

Advance = Callable[[float], None]  # call it with what has been done since the last call


class _Rate(ProgressColumn):
    """The rate over the last half minute, empty at first."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        return Text("" if task.speed is None else rate_text(task.speed, self._unit))


def progress(stage: str, total: float, unit: str = "s", done: float = 0.0) -> AbstractContextManager[Advance]:
    """A progress bar on standard error, by default in simulated seconds; call what it yields to advance it.

    Where standard error is no terminal, a line after two seconds and then one a minute. `done` counts as done before.
    """
    count = TextColumn("{task.completed:.0f}/{task.total:.0f} " + unit)
    columns = (count, *((_Rate(unit),) if unit in _RATED else ()), TimeElapsedColumn(), TimeRemainingColumn())
    return _shown(stage, total, done, columns, lambda now, elapsed: progress_line(now, total, unit, done, elapsed))


def busy(stage: str) -> AbstractContextManager[Advance]:
    """A spinner for a stage of unknown progress."""
    return _shown(stage, None, 0.0, (TimeElapsedColumn(),), lambda _, elapsed: f"{elapsed:.0f} s")


@contextmanager
def _shown(
    stage: str, total: float | None, done: float, columns: Sequence[ProgressColumn], text: Callable[[float, float], str]
) -> Iterator[Advance]:
    console = Console(stderr=True)
    if not console.is_terminal:
        with _logged(stage, done, text) as advance:
            yield advance
        return
    with Progress(TextColumn("{task.description:<34}"), BarColumn(), *columns, console=console) as bar:
        task = bar.add_task(stage, total=total)
        bar.update(task, completed=done)
        try:
            yield lambda passed: bar.advance(task, passed)
        except BaseException:
            bar.live.transient = True  # leave the terminal to the error message
            raise
        bar.update(task, total=total or 1.0, completed=total or 1.0)


@contextmanager
def _logged(stage: str, done: float, text: Callable[[float, float], str]) -> Iterator[Advance]:
    """Lines for the log of a long command; `text` describes what is done after how many seconds."""
    began = time.monotonic()
    now = done
    finished = threading.Event()

    def advance(passed: float) -> None:
        nonlocal now
        now += passed

    def print_lines() -> None:
        pause = _FIRST_LINE
        while not finished.wait(pause):
            print(f"{stage}: {text(now, time.monotonic() - began)}", file=sys.stderr, flush=True)
            pause = _BETWEEN_LINES

    printer = threading.Thread(target=print_lines, daemon=True)
    printer.start()
    try:
        yield advance
    finally:
        finished.set()
        printer.join()


def progress_line(now: float, total: float, unit: str, done: float, elapsed: float) -> str:
    """Progress of a stage and its remaining time."""
    text = f"{now:.0f}/{total:.0f} {unit}"
    if now <= done:
        return text
    rate = (now - done) / elapsed
    speed = f", {rate_text(rate, unit)}" if unit in _RATED else ""
    return f"{text}{speed}, {timedelta(seconds=round((total - now) / rate))} left"


def rate_text(rate: float, unit: str) -> str:
    """A rate of progress [1/s] as it is shown."""
    return f"{rate:,.0f} x real time" if unit == "s" else f"{rate:,.0f} {unit}/s"
