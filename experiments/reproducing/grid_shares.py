"""The paper's grid, shared out before the simulator has been imported."""

from dataclasses import replace

from experiments.options.grid import GridConfig
from experiments.parallel.by_name import call
from experiments.parallel.executors import Workers
from experiments.parallel.workers import processors


class GridShares:
    """The grid's runs, which workers drive and measure."""

    def __init__(self, config: GridConfig, workers: Workers) -> None:
        """Begin to drive."""
        cells = len(config.radii) * len(config.speeds)
        count = min(workers.count, cells)
        self.places = places(cells, count)
        """Which runs are in each share."""
        own = replace(config, threads=max(1, (config.threads or processors()) // count))
        self.results = [workers.begin(call, "experiments.reproducing.grid:drive_share", own, at) for at in self.places]
        """Each is called for what a worker drove, a Share."""


def places(runs: int, workers: int) -> list[list[int]]:
    """Which of the runs are in each worker's share: their radii are as different as those of all.

    The last one is three quarters as large as the others: as a rule it is that of this process, which joins them late.
    """
    turns = [*range(workers)] * 3 + [*range(workers - 1)]
    return [[k for k in range(runs) if turns[k % len(turns)] == worker] for worker in range(workers)]
