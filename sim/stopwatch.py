"""Time spent in the stages of a computation."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Stopwatch:
    """Total time spent in each stage."""

    stages: dict[str, float] = field(default_factory=dict)
    """Stage -> wall-clock time [s]."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time spent in the `with` block to the stage `name`."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - began

    def add(self, stages: Mapping[str, float]) -> None:
        """Add times [s] that another stopwatch measured."""
        for name, time_spent in stages.items():
            self.stages[name] = self.stages.get(name, 0.0) + time_spent
