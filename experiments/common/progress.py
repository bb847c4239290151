"""Progress of a stage, on standard error: a bar on a terminal, a line a minute in the log of a long
command.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from experiments.common.streams import printable

_PAUSE: Final = 60.0  # time between lines in a log [s]

SIMULATED: Final = "s simulated"
"""Unit of simulated time, which is not the time that the computation takes."""
Advance = Callable[[float], None]  # called with the amount done since the last call


@contextmanager
def progress(
    stage: str, total: float | None, unit: str = SIMULATED, done: float = 0.0
) -> Iterator[Advance]:
    """Show a stage's progress, by default in simulated seconds; `done` is the amount done before
    the block.
    """
    stage = printable(stage)
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _logged(stage, total, unit, done)
        return
    count = TextColumn("" if total is None else "{task.completed:.0f}/{task.total:.0f} " + unit)
    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(),
        count,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(stage, total=total, completed=int(done))
        yield lambda passed: bar.advance(task, passed)
        bar.update(task, total=total or 1.0, completed=total or 1.0)


def _logged(stage: str, total: float | None, unit: str, done: float) -> Advance:
    shown = time.monotonic()

    def advance(passed: float) -> None:
        nonlocal done, shown
        done += passed
        if time.monotonic() - shown > _PAUSE:
            shown = time.monotonic()
            amount = f"{done:.0f} {unit}"
            if total:
                amount = f"{done:.0f} of {total:.0f} {unit} ({done / total:.0%})"
            print(f"{stage}: {amount}", file=sys.stderr, flush=True)

    return advance
