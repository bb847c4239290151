"""Options of `trackslip bench`. Importing this starts no simulator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.world import MAX_DURATION, MAX_THREADS, MIN_DURATION
from trackslip.errors import InvalidValueError, require_at_most, require_positive

MAX_ROBOTS = 10_000
MAX_REPEATS = 1000


@dataclass(frozen=True)
class BenchConfig:
    """Measure how fast it simulates: bare physics, a fleet, the scanner before it, and the closed loop.

    With `env`, the learning environments instead; with `grid`, a grid of a thousand runs.
    """

    sizes: tuple[int, ...] = (1, 25, 256)
    """Numbers of robots, each measured at each number of threads."""
    thread_counts: tuple[int, ...] = (1, 2)
    """Numbers of worker threads."""
    seconds: float = 20.0
    """Simulated time in each measurement, of all robots together [s]; the closed loop gets a tenth."""
    repeats: int = 5
    """Rounds, in each of which every case is measured in short turns; the results are medians."""
    env: bool = False
    """Measure the gymnasium environments, natively vectorised and one by one, against the bare engine."""
    env_size: int = 64
    """Number of robots in them."""
    grid: bool = False
    """Measure a large grid of runs, once on each number of processes in --thread-counts, against the bare engine."""
    grid_runs: int = 1000
    """Number of runs in it, a multiple of 25."""
    grid_duration: float = 30.0
    """Length of each [s]."""
    seed: int = 0
    """Root of all random numbers."""
    out: Path = Path("out/bench")
    """Folder for the results."""

    def __post_init__(self) -> None:
        for name, values, most in (
            ("sizes", self.sizes, MAX_ROBOTS),
            ("thread_counts", self.thread_counts, MAX_THREADS),
        ):
            if not values:
                raise InvalidValueError(name, values, "at least one number")
            if len(set(values)) < len(values):
                raise InvalidValueError(name, values, "all different")
            for value in values:
                if not 1 <= value <= most:
                    raise InvalidValueError(name, value, f"an integer from 1 to {most}")
        require_positive("seconds", self.seconds)
        require_at_most("seconds", self.seconds, MAX_DURATION, "s")
        if not 1 <= self.repeats <= MAX_REPEATS:
            raise InvalidValueError("repeats", self.repeats, f"an integer from 1 to {MAX_REPEATS}")
        if not 1 <= self.env_size <= MAX_ROBOTS:
            raise InvalidValueError("env_size", self.env_size, f"an integer from 1 to {MAX_ROBOTS}")
        if self.env and self.grid:
            raise InvalidValueError("grid", self.grid, "without --env")
        if not 25 <= self.grid_runs <= MAX_ROBOTS or self.grid_runs % 25:
            raise InvalidValueError("grid_runs", self.grid_runs, f"a multiple of 25 from 25 to {MAX_ROBOTS}")
        if not MIN_DURATION <= self.grid_duration <= MAX_DURATION:
            raise InvalidValueError("grid_duration", self.grid_duration, f"from {MIN_DURATION:g} to {MAX_DURATION:g} s")
        if self.seed < 0:
            raise InvalidValueError("seed", self.seed, "an integer >= 0")
