"""Time measurement for the stages of a computation."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Stopwatch:
    """A stopwatch for the total time in each stage."""

    stages: dict[str, float] = field(default_factory=dict)
    """Wall-clock time by name of the stage [s]."""

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
