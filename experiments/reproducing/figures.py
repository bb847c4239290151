"""Figures drawn while others compute, and by all workers at the end."""

from collections.abc import Iterable

from experiments.parallel.executors import Promise, Workers
from experiments.report.page import Drawn, draw
from experiments.report.reproduction import Sketch
from sim.stopwatch import Stopwatch, timed


class Figures:
    """Figures of a report."""

    def __init__(self, workers: Workers, pdf: bool) -> None:
        """`pdf` also draws them as PDF."""
        self._workers, self._pdf = workers, pdf
        self._waiting: list[Sketch] = []
        self._begun: dict[str, Promise[tuple[Drawn | None, dict[str, float]]]] = {}
        self._done: dict[str, tuple[Drawn | None, dict[str, float]]] = {}

    def add(self, sketches: Iterable[Sketch]) -> None:
        """Draw those, too, that were not added before."""
        known = {*self._done, *self._begun, *(name for name, _ in self._waiting)}
        self._waiting += [sketch for sketch in sketches if sketch[0] not in known]

    def draw_one(self) -> bool:
        """Draw one of those that wait, here and now; whether there was one."""
        if not self._waiting:
            return False
        name, make = self._waiting.pop(0)
        self._done[name] = timed("report", draw, name, make, self._pdf)
        return True

    def share(self) -> None:
        """Let workers begin to draw those that wait."""
        for name, make in self._waiting:
            self._begun[name] = self._workers.begin(timed, "report", draw, name, make, self._pdf)
        self._waiting.clear()

    def drawn(self, watch: Stopwatch) -> dict[str, Drawn]:
        """All of them by name; workers draw those that wait. `watch` gets the work of all workers together."""
        self.share()
        self._done |= {name: result() for name, result in self._begun.items()}
        for _, times in self._done.values():
            watch.add(times)
        return {name: one for name, (one, _) in self._done.items() if one is not None}
