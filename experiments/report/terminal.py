"""Progress bars and tables on the terminal."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import timedelta
from typing import TYPE_CHECKING

import rich.box
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from sim.runs import Progress as Report

_BETWEEN_LINES = 60.0  # [s]
_RATED = ("s", "steps", "runs")  # units whose rates tell something


class _Rate(ProgressColumn):
    """How fast it goes."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The rate of the last half minute."""
        return Text("" if task.speed is None else _rate(task.speed, self._unit))


@contextlib.contextmanager
def progress(stage: str, total: float, unit: str = "s", done: float = 0.0) -> Iterator[Report]:
    """A progress bar on standard error, by default in simulated seconds; call what it yields to move it.

    Where standard error is no terminal, a line a minute. `done` was there before.
    """
    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} " + unit),
        *((_Rate(unit),) if unit in _RATED else ()),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(stage, total, unit, done)
        return
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(stage, total=total)
        bar.update(task, completed=done)
        try:
            yield lambda passed: bar.advance(task, passed)
        except BaseException:
            bar.live.transient = True  # leave the terminal to the error message
            raise
        bar.update(task, completed=total)


def _lines(stage: str, total: float, unit: str, done: float) -> Report:
    """Prints how far it is, for the logs of long jobs."""
    began = printed = time.monotonic()
    now = done

    def report(passed: float) -> None:
        nonlocal now, printed
        now += passed
        elapsed = time.monotonic() - began
        if time.monotonic() - printed >= _BETWEEN_LINES and now > done:
            printed = time.monotonic()
            rate = (now - done) / elapsed
            left = timedelta(seconds=round((total - now) / rate))
            speed = f"{_rate(rate, unit)}, " if unit in _RATED else ""
            text = f"{stage}: {now:.0f}/{total:.0f} {unit}, {speed}{left} left"
            print(text, file=sys.stderr, flush=True)

    return report


def _rate(rate: float, unit: str) -> str:
    return f"{rate:,.0f} x real time" if unit == "s" else f"{rate:,.0f} {unit}/s"


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; every column but the first is right-aligned. Numbers that don't exist, NaN, are dashes."""
    table = Table(
        title=title, title_justify="left", title_style="bold", box=rich.box.SIMPLE_HEAD, padding=(0, 0), pad_edge=False
    )
    for k, name in enumerate(header):
        table.add_column(escape(name), justify="left" if k == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*("-" if cell in ("nan", "+nan") else escape(cell) for cell in row))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 160  # a file has no width: cut nothing
    console.print(table)
