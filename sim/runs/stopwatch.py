"""Time measurement for the stages of a computation, and for control steps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np


@dataclass
class Stopwatch:
    """A stopwatch for the total time in each stage, and for the time of each control step."""

    stages: dict[str, float] = field(default_factory=dict)
    """Wall-clock time by name of the stage [s]."""
    steps: dict[str, list[float]] = field(default_factory=dict)
    """Wall-clock times of each control step, by name of the run [s]."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the duration of the `with` block to the time of stage `name`."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - began

    def add(self, stages: Mapping[str, float]) -> None:
        """Add times by stage, from another stopwatch [s]."""
        for name, time_spent in stages.items():
            self.stages[name] = self.stages.get(name, 0.0) + time_spent


@dataclass(frozen=True)
class StepTimes:
    """Computing times of the control steps of a run, each of them for one robot."""

    median: float
    """Median time [s]."""
    p99: float
    """Time that 99 % of the steps don't exceed [s]."""
    worst: float
    """Longest time [s]."""

    @classmethod
    def of(cls, steps: Sequence[float]) -> Self:
        """The times of steps (T,) [s]."""
        return cls(
            median=float(np.median(steps)),
            p99=float(np.percentile(steps, 99)),
            worst=max(steps),
        )

    @classmethod
    def slowest(cls, times: Iterable[StepTimes]) -> StepTimes:
        """The times of several runs, of which the slowest counts."""
        known = list(times)
        return cls(
            median=max(each.median for each in known),
            p99=max(each.p99 for each in known),
            worst=max(each.worst for each in known),
        )

    def warning(self, name: str, period: float) -> str | None:
        """A warning on the controller `name` if commands are due every `period` [s], and some or
        many steps take longer; None if none does.
        """
        due = f"but commands are due every {1e3 * period:.3g} ms"
        if self.p99 > period:
            return f"{name} takes {self} a step, {due}"
        if self.worst > period:
            return f"{name} is late in at most 1 % of the steps: it takes {self} a step, {due}"
        return None

    def __str__(self) -> str:
        """The times in words."""
        return f"{1e3 * self.p99:.3g} ms (99 %; {1e3 * self.worst:.3g} ms at worst)"
