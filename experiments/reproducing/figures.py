"""Figures drawn by several workers while others compute."""

import os
from collections.abc import Callable, Iterable
from functools import partial

from matplotlib.figure import Figure

from experiments.parallel.executors import Workers
from experiments.report.page import Drawn, draw
from experiments.report.reproduction import Sketch
from sim.stopwatch import Stopwatch, timed

_LAST = 19  # the lowest priority


class Figures:
    """Figures that workers draw."""

    def __init__(self, workers: Workers, pdf: bool) -> None:
        """`pdf` also draws them as PDF."""
        self._workers, self._pdf = workers, pdf
        self._begun: dict[str, Callable[[], tuple[Drawn | None, dict[str, float]]]] = {}

    def begin(self, sketches: Iterable[Sketch], aside: bool = False) -> None:
        """Begin to draw those that were not begun before; where nothing runs beside this, it waits until the end.

        `aside` leaves the processors to whatever else wants them.
        """
        begin = partial if self._workers.inline else self._workers.begin
        for name, make in sketches:
            if name not in self._begun:
                self._begun[name] = begin(timed, "report", _draw_aside if aside else draw, name, make, self._pdf)

    def drawn(self, watch: Stopwatch) -> dict[str, Drawn]:
        """All of them by name, when they are drawn; `watch` gets the work of all workers together."""
        found = {}
        for name, result in self._begun.items():
            one, times = result()
            watch.add(times)
            if one is not None:
                found[name] = one
        return found


def _draw_aside(name: str, make: Callable[[], Figure | None], pdf: bool) -> Drawn | None:
    """Draw in a process that comes last from now on."""
    if hasattr(os, "nice"):
        os.nice(_LAST)
    return draw(name, make, pdf)
