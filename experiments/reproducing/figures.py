"""Figures drawn by several workers while others compute."""

from collections.abc import Callable, Iterable
from functools import partial

from experiments.parallel.executors import Workers
from experiments.report.page import Drawn, draw
from experiments.report.reproduction import Sketch
from sim.stopwatch import Stopwatch, timed


class Figures:
    """Figures that workers draw."""

    def __init__(self, workers: Workers, pdf: bool) -> None:
        """`pdf` also draws them as PDF."""
        self._workers, self._pdf = workers, pdf
        self._begun: dict[str, Callable[[], tuple[Drawn | None, dict[str, float]]]] = {}

    def begin(self, sketches: Iterable[Sketch]) -> None:
        """Begin to draw those that were not begun before; where nothing runs beside this, it waits until the end."""
        begin = partial if self._workers.inline else self._workers.begin
        for name, make in sketches:
            if name not in self._begun:
                self._begun[name] = begin(timed, "report", draw, name, make, self._pdf)

    def drawn(self, watch: Stopwatch) -> dict[str, Drawn]:
        """All of them by name, when they are drawn; `watch` gets the work of all workers together."""
        found = {}
        for name, result in self._begun.items():
            one, times = result()
            watch.add(times)
            if one is not None:
                found[name] = one
        return found
